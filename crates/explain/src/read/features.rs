//! What explain reads from a recording: speed, complex order lines with their local noise, floors,
//! and the spectra they came from.

mod background;
mod line_fit;

use num_complex::Complex64;

use gearwatch_check::carriers::{self, Swing};
use gearwatch_check::last_wheel::OrderSpectra;
use gearwatch_check::orders::{OrderSpectrum, Turned, floor_of, occupied};
use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use crate::read::combs::combs;
use crate::read::dsp::{self, Transforms};
use crate::read::integrity::{self, Integrity};
use crate::read::lines::{Family, Line};
use crate::read::order_swing::OrderSwing;

pub use self::background::FloorBand;
pub use self::line_fit::{LineValue, line_at};
pub use gearwatch_check::kinematics::comb_orders;
pub use gearwatch_check::orders::USABLE_BAND;
pub use gearwatch_check::steady::{Steady, Unused, steady};

use self::background::bands;
use self::line_fit::{LineFit, comb};

/// The highest frequency that the swing of the turning is read to (Hz).
pub const SWING_HZ: f64 = 20.0;
/// Bins between neighbours of a comb above which the whole comb is taken out.
const COMB_SPACING: f64 = 40.0;
/// A denser comb is taken out where it is seen: where half of its lines have so many times the
/// power of the noise, whose own median is below 1.
const SEEN: f64 = 2.0;

/// One channel of one recording.
pub struct ChannelFeatures {
    /// Sensor name.
    pub name: String,
    /// Unit of the samples.
    pub unit: String,
    /// In the order of [`RecordingFeatures::lines`]; `None` where the line lies outside the usable
    /// band.
    pub values: Vec<Option<LineValue>>,
    /// All multiples of each shaft's speed, from 1, in the order of the train's shafts: what
    /// repeats with one revolution of it.
    pub combs: Vec<Vec<LineValue>>,
    /// Background.
    pub floor: Vec<FloorBand>,
    /// Spectrum over shaft angle; bin `k` is order `k / revolutions`.
    pub order_spectrum: Vec<Complex64>,
    /// Mean noise power per bin of `order_spectrum`.
    pub order_floor: Vec<f64>,
    /// Spectrum over time of what stays when the train's lines are taken out over angle; bin `k` is
    /// `k × hz_per_bin`.
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
    /// Revolution of the input shaft at the first sample as counted from the first tacho pulse; 0
    /// without a tacho.
    pub start_rev: f64,
    /// Width of a bin of the time spectrum (Hz).
    pub hz_per_bin: f64,
    /// Samples per second.
    pub sample_rate_hz: f64,
    /// The lines that were read.
    pub lines: Vec<Line>,
    /// Bins that the train's lines take, in order spectra and (as near as the speed is steady) in
    /// time spectra.
    pub taken: Vec<bool>,
    /// Input-shaft angle at each sample (revolutions).
    pub phase_rev: Vec<f64>,
    /// How the input shaft swings about its even turning; `None` where no mesh harmonic is clear
    /// enough.
    pub swing: Option<Swing>,
    /// By channel.
    pub channels: Vec<ChannelFeatures>,
}

impl RecordingFeatures {
    /// What tells the teeth of the last wheel.
    pub fn order_spectra(&self) -> OrderSpectra<(&[Complex64], &[f64])> {
        OrderSpectra {
            sample_rate_hz: self.sample_rate_hz,
            input_hz: self.input_hz,
            tacho_input_hz: self.tacho_input_hz,
            revolutions: self.revolutions,
            channels: self.channels.iter().map(|c| (&c.order_spectrum[..], &c.order_floor[..])).collect(),
        }
    }

    /// Frequency of an order (Hz).
    pub fn order_hz(&self, order: f64) -> f64 {
        order * self.input_hz
    }
}

/// What the angle of a recording follows beside what its mesh lines show slowly.
#[derive(Clone, Copy, Debug, Default)]
pub struct Follow {
    /// A speed that fluctuates at a fixed frequency (Hz).
    pub fluctuates_hz: Option<f64>,
    /// A swing at a multiple of a shaft.
    pub swing: Option<OrderSwing>,
}

/// Reads one steady recording, given the input-shaft speed that the comb search found.
pub fn read(
    transforms: &mut Transforms,
    bench: &Bench,
    train: &Train,
    steady: &Steady<'_>,
    input_hz: f64,
    comb_score: f64,
    follow: Follow,
) -> RecordingFeatures {
    let rate = steady.sample_rate_hz;
    let turned = Turned::of(transforms, train, bench.belt.is_some(), steady, input_hz);
    let mut angle: Vec<f64> = turned.turning.angles().collect();
    let len = angle.len();
    let signals: Vec<&[f64]> = steady.channels.iter().map(|(_, _, run)| &run.samples[..len]).collect();
    let mesh_orders: Vec<f64> = train.stages.iter().map(|s| s.mesh_order).collect();
    let swing = carriers::swing(transforms, &signals, rate, &angle, &mesh_orders, SWING_HZ);
    if let (Some(hz), Some(swing)) = (follow.fluctuates_hz, &swing) {
        swing.follow(hz, &mut angle);
    }
    if let Some(swing) = follow.swing {
        swing.follow(&mut angle);
    }
    let (revolutions, input_hz) = (turned.revolutions, turned.input_hz);
    let (lines, taken) = (&turned.lines, &turned.taken);
    let spectra: Vec<(Vec<f64>, OrderSpectrum)> = signals
        .iter()
        .map(|samples| {
            let angle_signal = dsp::resample_to_angle(transforms, samples, &angle);
            let spectrum = OrderSpectrum::of(transforms, &angle_signal, taken);
            (angle_signal, spectrum)
        })
        .collect();
    let highest = USABLE_BAND * rate / input_hz;
    let beside = follow.fluctuates_hz.map_or_else(Vec::new, |hz| of_fluctuation(lines, hz / input_hz));
    let mut of_shafts = taken.clone();
    for order in combs(train, revolutions) {
        let spacing = order * revolutions;
        if spacing > COMB_SPACING || is_seen(&spectra, taken, spacing, highest * revolutions) {
            let count = ((len / 2) as f64 / spacing) as usize;
            let whole = occupied(len / 2 + 1, (1..=count).map(|m| m as f64 * spacing));
            of_shafts.iter_mut().zip(whole).for_each(|(a, b)| *a |= b);
        }
    }
    let channels = steady
        .channels
        .iter()
        .zip(spectra)
        .map(|((name, unit, run), (angle_signal, OrderSpectrum { bins: order_spectrum, floor: order_floor }))| {
            let combs: Vec<Vec<LineValue>> = train
                .shafts
                .iter()
                .map(|(_, order)| comb(&order_spectrum, &order_floor, order * revolutions, highest * revolutions))
                .collect();
            let fit = LineFit {
                spectrum: &order_spectrum,
                floor: &order_floor,
                lines,
                shafts: &train.shafts,
                combs: &combs,
                beside: &beside,
                revolutions,
            };
            let values = fit.all(highest);
            let floor = bands(&order_spectrum, taken, rate / len as f64, rate);
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
                integrity: integrity::check(&run.samples[..len], run.quality),
            }
        })
        .collect();
    RecordingFeatures {
        name: steady.recording.name.clone(),
        display_motor_hz: steady.display_motor_hz,
        brake_torque_nm: steady.brake_torque_nm,
        input_hz,
        tacho_input_hz: turned.tacho_input_hz,
        comb_score,
        carriers: turned.carriers,
        revolutions,
        start_rev: turned.start_rev,
        hz_per_bin: rate / len as f64,
        sample_rate_hz: rate,
        lines: turned.lines,
        taken: of_shafts,
        phase_rev: angle,
        swing,
        channels,
    }
}

/// Sidebands of the mesh harmonics (orders) by a fluctuation at an order of the input: what
/// following it leaves of them may lie beside a shaft's.
fn of_fluctuation(lines: &[Line], order: f64) -> Vec<f64> {
    let of_mesh = lines.iter().filter(|l| matches!(l.family, Family::Mesh { .. }));
    let beside = |l: &Line| [-2.0, -1.0, 1.0, 2.0].map(|k| l.order + k * order);
    of_mesh.flat_map(beside).collect()
}

/// Whether the lines of a comb (bins between neighbours) that no line of the train takes stand out,
/// on the mean of all channels, up to a bin.
fn is_seen(spectra: &[(Vec<f64>, OrderSpectrum)], taken: &[bool], spacing: f64, highest_bin: f64) -> bool {
    let count = (highest_bin / spacing) as usize;
    let bins = (1..=count).map(|m| (m as f64 * spacing).round() as usize).filter(|k| taken.get(*k) == Some(&false));
    let above = |k: usize| {
        let of = |s: &OrderSpectrum| s.bins[k].norm_sqr() / s.floor[k].max(f64::MIN_POSITIVE);
        spectra.iter().map(|s| of(&s.1)).sum::<f64>() / spectra.len() as f64
    };
    let mut all: Vec<f64> = bins.map(above).collect();
    !all.is_empty() && dsp::median(&mut all) > SEEN
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A comb whose lines stand at twice the amplitude of the noise is seen where they are, and not
    /// between them.
    #[test]
    fn analytic_a_comb_that_stands_out_is_seen() {
        let (spacing, bins) = (20.0, 4000);
        let value = |k: usize| Complex64::from(if k.is_multiple_of(20) { 2.0 } else { 1.0 });
        let spectrum = OrderSpectrum { bins: (0..bins).map(value).collect(), floor: vec![1.0; bins] };
        let spectra = [(Vec::new(), spectrum)];
        let taken = vec![false; bins];
        assert!(is_seen(&spectra, &taken, spacing, bins as f64 - 1.0));
        assert!(!is_seen(&spectra, &taken, spacing + 0.37, bins as f64 - 1.0));
        assert!(!is_seen(&spectra, &vec![true; bins], spacing, bins as f64 - 1.0));
    }
}
