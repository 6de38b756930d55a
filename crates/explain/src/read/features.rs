//! What explain reads from a recording: speed, complex order lines with their local noise, floors, and the spectra they came from.

mod background;
mod line_fit;

use num_complex::Complex64;

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use crate::read::carriers;
use crate::read::dsp::{self, Transforms};
use crate::read::integrity::{self, Integrity};
use crate::read::lines::{self, Line};

pub use self::background::FloorBand;
pub use self::line_fit::LineValue;
pub use gearwatch_check::kinematics::comb_orders;
pub use gearwatch_check::steady::{Steady, Unused, steady};

use self::background::{bands, floor_of, occupied};
use self::line_fit::{LineFit, comb};

/// Distance of two listed lines from which they are told apart (bins): the joint fit pays for it with ten times the noise of a line alone.
const SEPARABLE_BINS: f64 = 0.5;
/// Share of the sample rate up to which lines are used: below the usual anti-alias corner.
pub const USABLE_BAND: f64 = 0.45;
/// Bins between neighbours of a shaft's comb above which the whole comb is taken out.
const COMB_SPACING: f64 = 40.0;

/// One channel of one recording.
pub struct ChannelFeatures {
    /// Sensor name.
    pub name: String,
    /// Unit of the samples.
    pub unit: String,
    /// In the order of [`RecordingFeatures::lines`]; `None` where the line lies outside the usable band.
    pub values: Vec<Option<LineValue>>,
    /// All multiples of each shaft's speed, from 1, in the order of the train's shafts: what repeats with one revolution of it.
    pub combs: Vec<Vec<LineValue>>,
    /// Background.
    pub floor: Vec<FloorBand>,
    /// Spectrum over shaft angle; bin `k` is order `k / revolutions`.
    pub order_spectrum: Vec<Complex64>,
    /// Mean noise power per bin of `order_spectrum`.
    pub order_floor: Vec<f64>,
    /// Spectrum over time of what stays when the train's lines are taken out over angle; bin `k` is `k × hz_per_bin`.
    pub remainder: Vec<Complex64>,
    /// Mean noise power per bin of `remainder`.
    pub remainder_floor: Vec<f64>,
    /// Samples over even steps of shaft angle.
    pub angle_signal: Vec<f64>,
    /// Clipping, flat lines, values that are not numbers.
    pub integrity: Integrity,
}

/// A recording at one operating point.
pub struct RecordingFeatures {
    /// File name or label.
    pub name: String,
    /// Motor speed as displayed (Hz); `NaN` where unknown.
    pub display_motor_hz: f64,
    /// Torque at the brake as set (N m); `NaN` where unknown.
    pub brake_torque_nm: f64,
    /// Input-shaft speed that the gear lines show (Hz).
    pub input_hz: f64,
    /// Input-shaft speed by the tacho (Hz).
    pub tacho_input_hz: Option<f64>,
    /// Mean log excess of the comb at `input_hz`.
    pub comb_score: f64,
    /// Mesh harmonics that carried the angle.
    pub carriers: usize,
    /// Revolutions of the input shaft in the recording.
    pub revolutions: f64,
    /// Revolution of the input shaft at the first sample as counted from the first tacho pulse; 0 without a tacho.
    pub start_rev: f64,
    /// Width of a bin of the time spectrum (Hz).
    pub hz_per_bin: f64,
    /// Samples per second.
    pub sample_rate_hz: f64,
    /// The lines that were read.
    pub lines: Vec<Line>,
    /// Bins that the train's lines take, in order spectra and (as near as the speed is steady) in time spectra.
    pub taken: Vec<bool>,
    /// Input-shaft angle at each sample (revolutions).
    pub phase_rev: Vec<f64>,
    /// By channel.
    pub channels: Vec<ChannelFeatures>,
}

impl RecordingFeatures {
    /// Frequency of an order (Hz).
    pub fn order_hz(&self, order: f64) -> f64 {
        order * self.input_hz
    }

    /// Position of an order in the order spectra.
    pub fn order_bin(&self, order: f64) -> f64 {
        order * self.revolutions
    }
}

/// Reads one steady recording, given the input-shaft speed that the comb search found.
pub fn read(
    transforms: &mut Transforms,
    bench: &Bench,
    train: &Train,
    steady: &Steady<'_>,
    input_hz: f64,
    comb_score: f64,
) -> RecordingFeatures {
    let rate = steady.sample_rate_hz;
    let len = steady.channels.iter().map(|c| c.2.samples.len()).min().unwrap_or(0);
    let tacho = steady.tacho_angle(train);
    let tacho_input_hz = tacho.as_ref().map(|t| t.1);
    let start: Vec<f64> = (0..len).map(|n| input_hz * n as f64 / rate).collect();
    let slowest = train.shafts.iter().map(|s| s.1).fold(f64::INFINITY, f64::min) * input_hz;
    let half_width = (0.4 * slowest).min(1.5);
    let mesh_orders: Vec<f64> = train.stages.iter().map(|s| s.mesh_order).collect();
    let signals: Vec<&[f64]> = steady.channels.iter().map(|c| c.2.samples.as_slice()).collect();
    // The tacho follows the wander of the speed, the comb knows its mean against the sample clock: start from both.
    let start = match &tacho {
        Some((angle, speed)) => (0..len).map(|n| at_sample(angle, n as f64 * input_hz / speed)).collect(),
        None => start,
    };
    let (angle, carried) = carriers::refine(transforms, &signals, rate, &start, &mesh_orders, half_width);
    let revolutions = (angle[len - 1] - angle[0]) * len as f64 / (len - 1) as f64;
    let input_hz = revolutions * rate / len as f64;
    let start_rev = tacho.as_ref().map_or(0.0, |t| t.0[0]);
    let lines = lines::of_train(train, bench.belt.is_some(), SEPARABLE_BINS / revolutions);
    let taken = occupied(len / 2 + 1, lines.iter().map(|l| l.order * revolutions));
    let mut of_shafts = taken.clone();
    for (_, order) in &train.shafts {
        // A shaft's whole comb can go where that leaves most bins free.
        let spacing = order * revolutions;
        if spacing > COMB_SPACING {
            let count = ((len / 2) as f64 / spacing) as usize;
            let whole = occupied(len / 2 + 1, (1..=count).map(|m| m as f64 * spacing));
            of_shafts.iter_mut().zip(whole).for_each(|(a, b)| *a |= b);
        }
    }
    let channels = steady
        .channels
        .iter()
        .map(|(name, unit, run)| {
            let samples = &run.samples[..len];
            let angle_signal = dsp::resample_to_angle(transforms, samples, &angle);
            let order_spectrum = dsp::windowed_spectrum(transforms, &angle_signal);
            let highest = USABLE_BAND * rate / input_hz;
            let order_floor = floor_of(&order_spectrum, &taken);
            let combs: Vec<Vec<LineValue>> = train
                .shafts
                .iter()
                .map(|(_, order)| comb(&order_spectrum, &order_floor, order * revolutions, highest * revolutions))
                .collect();
            let fit = LineFit {
                spectrum: &order_spectrum,
                floor: &order_floor,
                lines: &lines,
                shafts: &train.shafts,
                combs: &combs,
                revolutions,
            };
            let values = fit.all(highest);
            let floor = bands(&order_spectrum, &taken, rate / len as f64, rate);
            let remainder = dsp::remainder_over_time(transforms, &order_spectrum, &of_shafts, &angle);
            let remainder_floor = floor_of(&remainder, &of_shafts);
            ChannelFeatures {
                name: (*name).to_owned(),
                unit: (*unit).to_owned(),
                values,
                combs,
                floor,
                order_spectrum,
                order_floor,
                remainder,
                remainder_floor,
                angle_signal,
                integrity: integrity::check(samples, run.quality),
            }
        })
        .collect();
    RecordingFeatures {
        name: steady.recording.name.clone(),
        display_motor_hz: steady.display_motor_hz,
        brake_torque_nm: steady.brake_torque_nm,
        input_hz,
        tacho_input_hz,
        comb_score,
        carriers: carried,
        revolutions,
        start_rev,
        hz_per_bin: rate / len as f64,
        sample_rate_hz: rate,
        lines,
        taken: of_shafts,
        phase_rev: angle,
        channels,
    }
}

/// Angle by the tacho at a time in its own samples: where the sample clock is off, sample `n` was not taken at `n` steps of the tacho's time.
fn at_sample(angle: &[f64], position: f64) -> f64 {
    let k = (position as usize).min(angle.len() - 2);
    angle[k] + (angle[k + 1] - angle[k]) * (position - k as f64)
}
