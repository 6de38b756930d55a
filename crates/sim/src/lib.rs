//! Simulator of the gear bench: mesh stiffness, faults, dynamics, effects, sensors.

pub mod effects;
pub mod linear;
pub mod setup;

#[cfg(test)]
mod test_bench;
