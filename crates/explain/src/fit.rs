//! How the simulator's own model accounts for it: signatures, sizes, and the joint refit.

pub mod least_squares;
pub mod refit;
pub mod shape;
pub mod sizes;
pub mod terms;
