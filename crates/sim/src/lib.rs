//! Simulator of the gear bench: mesh stiffness, faults, dynamics, effects, sensors.

pub mod contact;
pub mod effects;
pub mod faults;
pub mod foundation;
pub mod geometry;
pub mod hertz;
pub mod linear;
pub mod mesh;
pub mod modal;
pub mod model;
pub mod rk4;
pub mod rotation;
pub mod setup;
pub mod steady;
pub mod tooth;

#[cfg(test)]
mod test_bench;
