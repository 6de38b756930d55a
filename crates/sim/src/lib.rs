//! Simulator of the gear bench: mesh stiffness, faults, dynamics, effects, sensors.

pub mod campbell;
pub mod contact;
pub mod effects;
pub mod etd;
pub mod faults;
pub mod foundation;
pub mod geometry;
pub mod hertz;
pub mod impact;
pub mod linear;
pub mod lines;
pub mod mesh;
pub mod modal;
pub mod model;
pub mod path;
pub mod planetary;
pub mod render;
pub mod rk4;
pub mod rotation;
pub mod scenario;
pub mod setup;
pub mod shipped;
pub mod signatures;
pub mod source;
mod springs;
pub mod steady;
mod stepper;
pub mod terms;
pub mod tooth;

#[cfg(test)]
mod test_bench;
