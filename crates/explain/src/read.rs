//! What was measured: speed and teeth, complex lines with their noise, and what is heard beside
//! them.

pub use gearwatch_check::{comb, dsp, integrity, kinematics, lines};

/// Operating points count as one within these relative differences of speed and of torque.
pub const SAME_SPEED: f64 = 0.03;
/// See [`SAME_SPEED`].
pub const SAME_TORQUE: f64 = 0.05;

pub mod combs;
pub mod displacement;
pub mod envelope;
pub mod features;
pub mod fixed;
pub mod fluctuation;
pub mod folded;
pub mod moved_mode;
pub mod narrow;
pub mod order_swing;
pub mod plain;
pub mod ratio;
pub mod scan;
pub mod surprise;
pub mod transients;
pub mod wander;
