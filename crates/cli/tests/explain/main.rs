//! `gearwatch explain` as a user runs it, on recordings of the simulator; real recordings where
//! they are at hand.

mod answer;
mod bad_input;
mod fixture;
mod laws;
mod limited;
mod load_trend;
mod only;
mod spectraquest;
mod tables;
mod walk_through;
