//! Spectra over shaft angle, which the recording's own mesh lines have made even, with the noise
//! beside each line.

use gearwatch_core::train::Train;
use num_complex::Complex64;
use pulp::Arch;

use crate::carriers;
use crate::dsp::{self, Knots, MAIN_LOBE_BINS, Transforms, WindowPiece, median};
use crate::last_wheel::Bins;
use crate::lines::{self, Line};
use crate::over_angle;
use crate::powers::Paired;
use crate::steady::{Run, Steady};
use crate::turning::{Start, Turning};

/// Distance of two listed lines from which they are told apart (bins): the joint fit pays for it
/// with ten times the noise of a line alone.
const SEPARABLE_BINS: f64 = 0.5;
/// Share of the sample rate up to which lines are used: below the usual anti-alias corner.
pub const USABLE_BAND: f64 = 0.45;
/// Bins on each side of a line from which its noise is read.
pub const NOISE_BINS: usize = 60;

/// Shaft angle of a recording by its mesh lines, and what that says of its speed.
pub struct Turned {
    /// Input-shaft angle at each sample (revolutions).
    pub turning: Turning,
    /// Mesh harmonics that carried the angle.
    pub carriers: usize,
    /// Revolutions of the input shaft in the recording.
    pub revolutions: f64,
    /// Input-shaft speed that the gear lines show (Hz).
    pub input_hz: f64,
    /// The same by the tacho.
    pub tacho_input_hz: Option<f64>,
    /// Revolution of the input shaft at the first sample as counted from the first tacho pulse;
    /// 0 without a tacho.
    pub start_rev: f64,
    /// The train's lines, ascending.
    pub lines: Vec<Line>,
    /// Bins that they take.
    pub taken: Vec<bool>,
}

impl Turned {
    /// Of one steady recording, given the input-shaft speed that the comb search found.
    pub fn of<R: Run>(
        transforms: &mut Transforms,
        train: &Train,
        has_belt: bool,
        steady: &Steady<'_, R>,
        input_hz: f64,
    ) -> Self {
        let rate = steady.sample_rate_hz;
        let signals = steady.signals();
        let len = signals.iter().map(|signal| signal.len()).min().unwrap_or(0);
        let tacho = steady.tacho_angle(train);
        let slowest = train.shafts.iter().map(|s| s.1).fold(f64::INFINITY, f64::min) * input_hz;
        let half_width = (0.4 * slowest).min(1.5);
        let mesh_orders: Vec<f64> = train.stages.iter().map(|s| s.mesh_order).collect();
        let tacho_input_hz = tacho.as_ref().map(|t| t.1);
        let start_rev = tacho.as_ref().map_or(0.0, |t| t.0.at(0));
        // The tacho follows the wander of the speed, the comb knows its mean against the sample
        // clock: start from both.
        let start = match tacho {
            Some((angle, tacho_input_hz)) => Start::Pulses { angle, input_hz, tacho_input_hz, len: signals[0].len() },
            None => Start::Even { input_hz, sample_rate_hz: rate },
        };
        let mut turning = Turning::new(start, len);
        let carriers = carriers::refine(transforms, &signals, rate, &mut turning, &mesh_orders, half_width);
        let (first, last) = turning.ends();
        let revolutions = (last - first) * len as f64 / (len - 1) as f64;
        let lines = lines::of_train(train, has_belt, SEPARABLE_BINS / revolutions);
        let taken = occupied(len / 2 + 1, lines.iter().map(|l| l.order * revolutions));
        Self {
            turning,
            carriers,
            revolutions,
            input_hz: revolutions * rate / len as f64,
            tacho_input_hz,
            start_rev,
            lines,
            taken,
        }
    }
}

/// Powers of the spectrum of one channel over shaft angle up to some order, with the mean noise
/// power of each bin: what an [`OrderSpectrum`] shows, in a third of the memory and less.
pub(crate) struct OrderPowers {
    powers: Vec<f64>,
    floor: Vec<f64>,
}

/// Bins beyond the last one that is asked for, of which its noise is read.
const BEYOND: usize = 4 * NOISE_BINS + NOISE_BINS / 2;

/// Values of the window that are worked out at a time.
const WEIGHTS: usize = 512;

impl OrderPowers {
    /// Of all channels, the first so many bins.
    pub(crate) fn of(transforms: &mut Transforms, turned: &Turned, channels: &[&[f32]], bins: usize) -> Vec<Self> {
        let steps = over_angle::steps(bins + BEYOND, turned.turning.len());
        let mut resampled: Vec<_> = channels.iter().map(|_| Paired::<f32>::with_capacity(steps)).collect();
        let (mut weights, arch) = ([0.0; WEIGHTS], Arch::new());
        over_angle::resample(channels, &turned.turning, (bins + BEYOND, steps), |step, values| {
            let place = step % WEIGHTS;
            if place == 0 {
                arch.dispatch(WindowPiece { to: &mut weights, first: step, each: 1.0 / steps as f64 });
            }
            let weight = weights[place];
            resampled.iter_mut().zip(values).for_each(|(channel, x)| channel.push(f64::from(*x) * weight));
        });
        let scale = dsp::window_scale(steps).powi(2);
        let powers = |channel: Paired<f32>| {
            let all = transforms.powers(channel);
            let power = |k: usize| all.at(k) * scale;
            let bins = bins.min(all.len());
            let floor = noise(power, &turned.taken[..turned.taken.len().min(all.len())], bins);
            Self { powers: (0..bins).map(power).collect(), floor: (0..bins).map(|k| floor.at(k)).collect() }
        };
        resampled.into_iter().map(powers).collect()
    }
}

impl Bins for OrderPowers {
    fn power(&self, bin: usize) -> Option<f64> {
        self.powers.get(bin).copied()
    }

    fn floor(&self, bin: usize) -> Option<f64> {
        self.floor.get(bin).copied()
    }
}

/// The spectrum of one channel over shaft angle; bin `k` is order `k / revolutions`.
pub struct OrderSpectrum {
    /// Hann window, amplitudes.
    pub bins: Vec<Complex64>,
    /// Mean noise power of each bin.
    pub floor: Vec<f64>,
}

impl OrderSpectrum {
    /// Of what was resampled.
    pub fn of(transforms: &mut Transforms, resampled: &[f64], taken: &[bool]) -> Self {
        let bins = dsp::windowed_spectrum(transforms, resampled);
        let floor = floor_of(&bins, taken);
        Self { bins, floor }
    }
}

/// Bins within the main lobe of a line.
pub fn occupied(len: usize, positions: impl Iterator<Item = f64>) -> Vec<bool> {
    let mut taken = vec![false; len];
    for p in positions {
        let centre = p.round() as usize;
        for t in
            taken.iter_mut().take((centre + MAIN_LOBE_BINS).min(len)).skip(centre.saturating_sub(MAIN_LOBE_BINS - 1))
        {
            *t = true;
        }
    }
    taken
}

/// Mean noise power of each bin from the median of its free neighbours (median of exponential = ln
/// 2 × mean).
pub fn floor_of(spectrum: &[Complex64], taken: &[bool]) -> Vec<f64> {
    let floor = noise(|k| spectrum[k].norm_sqr(), &taken[..spectrum.len()], spectrum.len());
    (0..spectrum.len()).map(|k| floor.at(k)).collect()
}

/// Mean noise power of the first so many bins.
fn noise(power: impl Fn(usize) -> f64, taken: &[bool], bins: usize) -> Knots {
    let step = NOISE_BINS / 2;
    let mut values: Vec<f64> = Vec::new();
    let mut window = Vec::with_capacity(8 * NOISE_BINS);
    let mut centre = 0;
    while centre < bins + step {
        let mut half = NOISE_BINS;
        loop {
            window.clear();
            let high = (centre + half + 1).min(taken.len());
            let near = centre.saturating_sub(half).min(high)..high;
            window.extend(near.filter(|k| !taken[*k]).map(&power));
            // Crowded neighbourhoods are widened until enough free bins stand for the noise.
            if window.len() >= NOISE_BINS / 2 || half >= 4 * NOISE_BINS {
                break;
            }
            half *= 2;
        }
        let value = median(&mut window) / std::f64::consts::LN_2;
        values.push(if value.is_finite() && value > 0.0 {
            value
        } else {
            values.last().copied().unwrap_or(f64::MIN_POSITIVE)
        });
        centre += step;
    }
    Knots { values, step }
}
