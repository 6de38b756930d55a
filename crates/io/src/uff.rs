//! Universal file format, dataset 58 (functions at nodal degrees of freedom) as text and as binary
//! 58b.
//!
//! Layout after "Universal File Formats for Modal Analysis Testing", University of Cincinnati
//! (UC-SDRL), dataset 58.

use gearwatch_core::block::UnixNanos;

mod read;
mod write;

pub use read::{Parsed, parse};
pub use write::{Form, WriteError, write};

/// One real function of time with even steps.
#[derive(Clone, Debug, PartialEq)]
pub struct Dataset {
    /// Response point, else the first identification line.
    pub name: String,
    /// Of the ordinate; absent where the file says `NONE`.
    pub unit: Option<String>,
    /// Samples per second.
    pub sample_rate_hz: f64,
    /// Time of the first sample, 0 where the file has no date.
    pub t0: UnixNanos,
    /// Ordinates.
    pub values: Values,
}

/// Ordinates in the precision of the file.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// Type 2.
    Single(Vec<f32>),
    /// Type 4.
    Double(Vec<f64>),
}

impl Values {
    /// Number of ordinates.
    pub fn len(&self) -> usize {
        match self {
            Self::Single(values) => values.len(),
            Self::Double(values) => values.len(),
        }
    }

    /// There is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// In order.
    pub fn iter(&self) -> impl Iterator<Item = f64> + '_ {
        let (single, double): (&[f32], &[f64]) = match self {
            Self::Single(values) => (values, &[]),
            Self::Double(values) => (&[], values),
        };
        single.iter().map(|&v| f64::from(v)).chain(double.iter().copied())
    }
}

const MONTHS: [&str; 12] = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"];
