//! An order spectrum as it goes to the log and to viewers.

use serde::Serialize;

/// An order spectrum for display.
#[derive(Clone, Debug, Serialize)]
pub struct SpectrumFrame {
    /// Name of the bench.
    pub bench: String,
    /// The service watches several benches: the topic names the bench.
    #[serde(skip)]
    pub several: bool,
    /// Sensor name.
    pub channel: String,
    /// Unit of the amplitudes.
    pub unit: String,
    /// Time of the first sample (ns since the epoch).
    pub t0_ns: i64,
    /// Order of the first line, in multiples of the input shaft's speed.
    pub first_order: f64,
    /// Distance between lines.
    pub order_step: f64,
    /// Peak amplitudes.
    pub amplitude: Vec<f32>,
    /// Lines to be marked.
    pub lines: Vec<SpectrumLine>,
}

/// A marked line of a spectrum.
#[derive(Clone, Debug, Serialize)]
pub struct SpectrumLine {
    /// Order of the input shaft.
    pub order: f64,
    /// Such as `stage1 2x`.
    pub label: String,
    /// Drawn fainter and without its label.
    pub sideband: bool,
}
