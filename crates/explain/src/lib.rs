//! Explains where simulation and recordings differ: locates, names, models and judges.

pub mod paper;
pub mod tables;
