//! One factor for lines and background alike: an amplifier, a sensitivity, a range that was set
//! otherwise.
//!
//! The change of a channel against the reference, ln of the amplitude ratio by band, is drawn from
//! one of three: the channel is as it was, but for a drift of a per cent; it has another gain, the
//! same in all bands, lines and background; or it changed over frequency, as paths and machines do.
//! Their evidences are Gaussian and in closed form; what all channels have in common is integrated
//! out. So a gain is told at one speed too.

use nalgebra::{DMatrix, DVector};

use super::cross::Cross;
use super::repetition::{OF_A_SENSOR, OF_ALL_SENSORS, OF_BANDS, OVER_FREQUENCY};
use crate::read::dsp::median;

/// Bands per octave.
const BANDS: f64 = 6.0;
/// Bins of a half band at least.
const BINS: usize = 4;
/// Scatter of changed gains (ln), and of changes over frequency: factors of two either way.
const CHANGED: f64 = 0.7;
/// Scatter of single bands beyond their noise (ln) on a bench that changed.
const UNSTEADY: [f64; 2] = [0.15, 0.4];
/// Sizes of a change over frequency (ln) that a path or a machine may make, and the distance over
/// which it is the same (ln of frequency), a third of an octave and more.
const SIZES: [f64; 3] = [0.1, 0.25, 0.6];
const REACH: f64 = 0.35;
/// What is thought of a channel beforehand: another gain, or a change over frequency.
const PRIOR_GAIN: f64 = 0.05;
const PRIOR_OTHER: f64 = 0.1;
/// All channels alike.
const PRIOR_ALL: f64 = 0.02;
/// Probability from which it is named.
const NAMED: f64 = 0.5;

/// Change of one half band of a channel.
#[derive(Clone, Copy, Debug)]
struct Band {
    ln_hz: f64,
    /// ln of the amplitude ratio.
    change: f64,
    variance: f64,
}

/// Another gain.
#[derive(Clone, Debug, PartialEq)]
pub struct Gain {
    /// Position of the channel.
    pub channel: usize,
    /// Of amplitudes against the reference, and its standard deviation.
    pub factor: (f64, f64),
    /// That it is so.
    pub probability: f64,
    /// All channels changed by one factor.
    pub all: bool,
}

/// Changes by band; the louder and the fainter half of the bins of each, so that lines and
/// background stand for themselves. Which half a bin belongs to is said by both recordings alike,
/// so that chance draws neither.
fn bands(recording: &Cross, reference: &Cross, channel: usize) -> Vec<Band> {
    let ratio = 2f64.powf(1.0 / BANDS);
    let power: Vec<(f64, f64, f64)> = recording
        .hz
        .iter()
        .zip(recording.power(channel).zip(reference.power(channel)))
        .map(|(hz, (a, b))| (*hz, a, b))
        .collect();
    let Some(first) = power.first() else { return Vec::new() };
    let mut out = Vec::new();
    let mut rest = &power[..];
    let mut low = first.0;
    while !rest.is_empty() {
        // Bands below the resolution grow until they hold enough.
        let mut count = rest.partition_point(|p| p.0 < low * ratio);
        count = count.max(2 * BINS).min(rest.len());
        let (band, after) = rest.split_at(count);
        rest = after;
        low = rest.first().map_or(f64::INFINITY, |p| p.0);
        if band.len() < 2 * BINS {
            continue;
        }
        let mut sorted = band.to_vec();
        sorted.sort_by(|x, y| (x.1 * x.2).total_cmp(&(y.1 * y.2)));
        let ln_hz = (band[0].0 * band[band.len() - 1].0).sqrt().ln();
        for half in [&sorted[..count / 2], &sorted[count / 2..]] {
            let mut changes: Vec<f64> = half.iter().map(|p| 0.5 * (p.1 / p.2).ln()).collect();
            // A median has π/2 of the variance of a mean; Hann bins are correlated with their
            // neighbours.
            let of_bin = 0.25 * (1.0 / recording.averages + 1.0 / reference.averages);
            let variance = of_bin * 1.57 * 1.5 / half.len() as f64;
            out.push(Band { ln_hz, change: median(&mut changes), variance });
        }
    }
    out
}

/// What a channel may have become.
struct Evidence {
    same: f64,
    gain: f64,
    other: f64,
}

/// Log evidence of the bands of one channel under each state, given what all channels have in
/// common.
struct Channel {
    changes: DVector<f64>,
    /// Factors of covariances: log weight, `L⁻¹ 1`, `L⁻¹ d`, log determinant.
    same: Vec<Factor>,
    gain: Vec<Factor>,
    other: Vec<Factor>,
}

/// A Gaussian of the bands about a common level.
struct Factor {
    ln_weight: f64,
    /// `1ᵀ C⁻¹ 1`, `1ᵀ C⁻¹ d`, `dᵀ C⁻¹ d`.
    ones: f64,
    mixed: f64,
    square: f64,
    ln_det: f64,
}

impl Factor {
    fn new(covariance: DMatrix<f64>, changes: &DVector<f64>, ln_weight: f64) -> Option<Self> {
        let cholesky = covariance.cholesky()?;
        let ln_det = 2.0 * cholesky.l_dirty().diagonal().iter().map(|x| x.ln()).sum::<f64>();
        let one = DVector::from_element(changes.len(), 1.0);
        let (solved_one, solved) = (cholesky.solve(&one), cholesky.solve(changes));
        Some(Self {
            ln_weight,
            ones: one.dot(&solved_one),
            mixed: one.dot(&solved),
            square: changes.dot(&solved),
            ln_det,
        })
    }

    /// ln N(d; m 1, C).
    fn ln_evidence(&self, level: f64) -> f64 {
        let misfit = self.square - 2.0 * level * self.mixed + level * level * self.ones;
        self.ln_weight - 0.5 * (misfit + self.ln_det)
    }
}

/// ln of a sum of exponentials.
fn ln_sum(values: impl Iterator<Item = f64>) -> f64 {
    let all: Vec<f64> = values.collect();
    let most = all.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if most.is_finite() { most + all.iter().map(|v| (v - most).exp()).sum::<f64>().ln() } else { most }
}

impl Channel {
    fn new(bands: &[Band]) -> Self {
        let n = bands.len();
        let changes = DVector::from_iterator(n, bands.iter().map(|b| b.change));
        let covariance = |scatter: f64, level: f64, size: f64| {
            DMatrix::from_fn(n, n, |i, j| {
                let distance = (bands[i].ln_hz - bands[j].ln_hz) / REACH;
                let alone = if i == j { bands[i].variance + scatter * scatter } else { 0.0 };
                alone + level * level + size * size * (-0.5 * distance * distance).exp()
            })
        };
        let of = |scatters: &[f64], level: f64, sizes: &[f64]| -> Vec<Factor> {
            let weight = -((scatters.len() * sizes.len()) as f64).ln();
            let pairs = scatters.iter().flat_map(|s| sizes.iter().map(move |z| (*s, *z)));
            pairs.filter_map(|(s, z)| Factor::new(covariance(s, level, z), &changes, weight)).collect()
        };
        let scatters: Vec<f64> = OF_BANDS.iter().chain(&UNSTEADY).copied().collect();
        Self {
            same: of(&OF_BANDS, OF_A_SENSOR, &OVER_FREQUENCY),
            gain: of(&OF_BANDS, CHANGED, &OVER_FREQUENCY),
            other: of(&scatters, CHANGED, &SIZES),
            changes,
        }
    }

    fn at(&self, common: f64) -> Evidence {
        let of = |factors: &[Factor]| ln_sum(factors.iter().map(|f| f.ln_evidence(common)));
        Evidence {
            same: (1.0 - PRIOR_GAIN - PRIOR_OTHER).ln() + of(&self.same),
            gain: PRIOR_GAIN.ln() + of(&self.gain),
            other: PRIOR_OTHER.ln() + of(&self.other),
        }
    }

    /// Level over all bands and its standard deviation, by the likeliest scatter.
    fn level(&self) -> (f64, f64) {
        let best = self.gain.iter().max_by(|a, b| a.ln_evidence(0.0).total_cmp(&b.ln_evidence(0.0)));
        match best {
            // The covariance has the scatter of levels in it: what is left of 1ᵀC⁻¹1 is that of the
            // bands.
            Some(f) => (f.mixed / f.ones, (1.0 / f.ones - CHANGED * CHANGED).max(0.0).sqrt().hypot(OF_A_SENSOR)),
            None => (self.changes.mean(), f64::NAN),
        }
    }
}

/// Steps of the common level, in its own standard deviations.
const STEPS: i32 = 40;

/// Channels with another gain than in the reference.
pub fn gains(recording: &Cross, reference: &Cross) -> Vec<Gain> {
    if !recording.is_like(reference) {
        return Vec::new();
    }
    let channels: Vec<Channel> =
        (0..recording.channels.len()).map(|c| Channel::new(&bands(recording, reference, c))).collect();
    if channels.iter().any(|c| c.changes.len() < 6) {
        return Vec::new();
    }
    let several = channels.len() > 1;
    // Mixture of what all have in common: a drift, or another gain of the whole front end.
    let mut points: Vec<(f64, f64, bool)> = Vec::new();
    let normal = |x: f64| (-0.5 * x * x).exp();
    let drift: Vec<f64> = (-STEPS..=STEPS).map(|k| 4.0 * f64::from(k) / f64::from(STEPS)).collect();
    let total: f64 = drift.iter().map(|x| normal(*x)).sum();
    points.extend(drift.iter().map(|x| (OF_ALL_SENSORS * x, ((1.0 - PRIOR_ALL) * normal(*x) / total).ln(), false)));
    if several {
        // Fine steps: what all have in common is known to a per cent.
        let wide: Vec<f64> = (-400..=400).map(|k| 3.0 * f64::from(k) / 400.0).collect();
        let total: f64 = wide.iter().map(|x| normal(*x)).sum();
        points.extend(wide.iter().map(|x| (CHANGED * x, (PRIOR_ALL * normal(*x) / total).ln(), true)));
    }
    let n = channels.len();
    let mut whole = Vec::with_capacity(points.len());
    let mut single: Vec<Vec<f64>> = vec![Vec::new(); n];
    for (level, ln_prior, _) in &points {
        let evidence: Vec<Evidence> = channels.iter().map(|c| c.at(*level)).collect();
        let each: Vec<f64> = evidence.iter().map(|e| ln_sum([e.same, e.gain, e.other].into_iter())).collect();
        let sum = ln_prior + each.iter().sum::<f64>();
        whole.push(sum);
        for c in 0..n {
            single[c].push(sum - each[c] + evidence[c].gain);
        }
    }
    let all = ln_sum(whole.iter().copied());
    // All alike: the level is far from 1 in common, and the channels stay as they were but for it.
    let in_common =
        ln_sum(whole.iter().zip(&points).filter(|(_, p)| p.2 && p.0.abs() > 3.0 * OF_ALL_SENSORS).map(|(w, _)| *w));
    let together = (in_common - all).exp();
    let same_in_common = |c: usize| {
        ln_sum(points.iter().filter(|p| p.2).map(|(level, ln_prior, _)| ln_prior + channels[c].at(*level).same))
            > ln_sum(points.iter().filter(|p| p.2).map(|(level, ln_prior, _)| ln_prior + channels[c].at(*level).other))
    };
    channels
        .iter()
        .enumerate()
        .filter_map(|(c, channel)| {
            let alone = (ln_sum(single[c].iter().copied()) - all).exp();
            let of_all = if together > NAMED && same_in_common(c) { together } else { 0.0 };
            let probability = alone.max(of_all);
            let (level, sigma) = channel.level();
            (probability > NAMED && level.abs() > 2.0 * sigma).then(|| Gain {
                channel: c,
                factor: (level.exp(), sigma * level.exp()),
                probability: probability.min(0.98),
                all: of_all > alone,
            })
        })
        .collect()
}
