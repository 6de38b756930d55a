//! Explains where simulation and recordings differ: locates, names, models and judges.
//!
//! `instrument` → `measure` (`read`) → `change` → `name` ⇄ `fit` → `judge`; [`explain`](mod@explain) goes the whole way. Beside it: what sensors could not show (`blind`), the concealed
//! benchmark (`prove`), and amplitude tables instead of recordings (`tables`, `paper`).

pub mod change;
pub mod explain;
pub mod fit;
pub mod instrument;
pub mod judge;
pub mod measure;
pub mod name;
pub mod read;

pub mod blind;
pub mod drill;
pub mod error;
pub mod paper;
pub mod prove;
pub mod tables;
