//! Explains where simulation and recordings differ: locates, names, models and judges.

pub mod alone;
pub mod angle;
pub mod comb;
pub mod compare;
pub mod direct;
pub mod dsp;
pub mod envelope;
pub mod error;
pub mod explain;
pub mod features;
pub mod integrity;
pub mod kinematics;
pub mod lines;
pub mod locate;
pub mod name;
pub mod paper;
pub mod prove;
pub mod ratio;
pub mod report;
pub mod scan;
pub mod shape;
pub mod sizes;
pub mod subname;
pub mod tables;
