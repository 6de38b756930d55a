//! Explains where simulation and recordings differ: locates, names, models and judges.
//!
//! ```text
//! recordings ─► instrument ─► measure (read) ─► change ─► name ⇄ fit ─► judge ─► Explanation
//! reference  ─►    faults of sensors    lines     against   effects    recordings
//! sheet      ─►    and converters                 the model and sizes  held out
//! ```
//!
//! [`explain`](mod@explain) goes the whole way. All steps know what was measured (`question`), and
//! what an effect that was found is (`finding`). Beside them: what sensors could not show
//! (`blind`), the concealed benchmark (`prove`), and amplitude tables instead of recordings
//! (`tables`, `paper`).
//!
//! ```
//! use gearwatch_core::bench::Bench;
//! use gearwatch_explain::error::ExplainError;
//! use gearwatch_explain::explain::{Input, explain};
//!
//! let bench = Bench::from_toml(gearwatch_sim::shipped::DEMO_BENCH)?;
//! let input = Input { bench: &bench, recordings: &[], reference: &[], without: &[] };
//! let answer = explain(&input, &mut |step| eprintln!("{step}"));
//! assert!(matches!(answer, Err(ExplainError::NoRecording)));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod change;
pub mod explain;
pub mod finding;
pub mod fit;
pub mod instrument;
pub mod judge;
pub mod measure;
pub mod name;
pub mod question;
pub mod read;

pub mod blind;
pub mod drill;
pub mod error;
pub mod paper;
pub mod prove;
pub mod tables;
