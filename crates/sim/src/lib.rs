//! Simulator of the gear bench: mesh stiffness, faults, dynamics, effects, sensors.
//!
//! ```text
//! bench file ─► SimSetup ◄─ effects (wear, eccentricity, …, each with range, unit and signature)
//!                  │
//!                  ▼
//!   mesh (stiffness over the mesh cycle) ─► model (M q̈ + C q̇ + K q = f) ─► stepper or steady state ─► paths ─► sensors
//! ```
//!
//! Each formula names its source, and `docs/simulator.md` says what each part was validated
//! against. The exponential stepper ([`etd`]) makes records, the periodic steady state ([`steady`])
//! gives mesh harmonics without stepping, Runge–Kutta ([`rk4`]) is the oracle of both.
//!
//! ```
//! use gearwatch_sim::{effects, shipped};
//!
//! let bench = shipped::bench("single-pair").expect("a bench that comes with the program");
//! assert_eq!(bench.problems(), Vec::<String>::new());
//! let wear = effects::ALL.iter().find(|effect| effect.id() == "tooth_wear").expect("an effect");
//! let depth = &wear.parameters()[0];
//! assert_eq!(depth.name, "depth_um");
//! assert!(depth.min < depth.typical && depth.typical < depth.max);
//! ```

pub mod beam;
pub mod campbell;
pub mod contact;
pub mod effects;
pub mod etd;
pub mod faults;
pub mod foundation;
pub mod geometry;
pub mod growth;
pub mod hertz;
pub mod impact;
pub mod linear;
pub mod lines;
pub mod mesh;
pub mod meshes;
pub mod modal;
pub mod model;
pub mod path;
pub mod planetary;
pub mod render;
pub mod rk4;
mod rolling;
pub mod rotation;
pub mod scenario;
pub mod setup;
pub mod shipped;
pub mod signatures;
pub mod source;
mod springs;
pub mod states;
pub mod steady;
mod stepper;
pub mod terms;
pub mod tooth;

#[cfg(test)]
mod test_bench;
