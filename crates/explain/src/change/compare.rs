//! Recordings against their reference, line by line, at the same operating point.

use gearwatch_check::orders::NOISE_BINS;

use crate::read::dsp::median;
use crate::read::features::{ChannelFeatures, LineValue, RecordingFeatures, USABLE_BAND};
use crate::read::lines::Family;
use crate::read::{SAME_SPEED, SAME_TORQUE};

/// Power over noise from which a line is compared, in the recording or in the reference.
pub const CLEAR: f64 = 6.0;

/// A line in a recording and in its reference.
#[derive(Clone, Copy, Debug)]
pub struct LineChange {
    /// Position of the pair.
    pub pair: usize,
    /// Position of the channel among the sensors of the pair.
    pub channel: usize,
    /// Where the line belongs.
    pub family: Family,
    /// Order of the input shaft.
    pub order: f64,
    /// (Hz).
    pub frequency_hz: f64,
    /// Power in the recording, noise taken off, not below 0.
    pub power: f64,
    /// Power in the reference, likewise.
    pub reference_power: f64,
    /// Noise power of the stronger of both.
    pub noise: f64,
    /// ln of the amplitude ratio; lines below their noise count as their noise.
    pub log_ratio: f64,
    /// Phase in the recording less phase in the reference (rad): each is of the angle at which its
    /// recording began.
    pub turn: f64,
    /// Phase in the reference (rad).
    pub reference_phase: f64,
    /// Variance of `log_ratio` from noise alone; that of `turn` is as large.
    pub variance: f64,
    /// Variance that noise gives `log_ratio` if the line did not change: of its power, the share
    /// that differs counts.
    pub unchanged: f64,
    /// Share of the power of what stands beside the line that differs between both recordings.
    pub differs: f64,
}

/// A recording, one of its channels, and a line in it.
type Seen<'a> = (&'a RecordingFeatures, &'a ChannelFeatures, LineValue);

impl LineChange {
    /// Of a line (pair, channel, family, order of the input shaft) in a recording and in its
    /// reference; `None` beyond the usable band and where neither shows it clearly.
    pub fn of(
        (pair, channel, family, order): (usize, usize, Family, f64),
        [(recording, a, x), (reference, b, y)]: [Seen<'_>; 2],
    ) -> Option<Self> {
        let frequency_hz = recording.order_hz(order);
        let (px, py) = (x.amplitude.norm_sqr(), y.amplitude.norm_sqr());
        let noise = x.noise.max(y.noise);
        if frequency_hz > USABLE_BAND * recording.sample_rate_hz * 0.97 || px.max(py) < CLEAR * noise {
            return None;
        }
        let ratio = Ratio::of([px, py], [x.noise, y.noise]);
        let differs = differs([(recording, a), (reference, b)], order);
        Some(Self {
            pair,
            channel,
            family,
            order,
            frequency_hz,
            power: (px - x.noise).max(0.0),
            reference_power: (py - y.noise).max(0.0),
            noise,
            log_ratio: ratio.log,
            turn: (x.amplitude * y.amplitude.conj()).arg(),
            reference_phase: y.amplitude.arg(),
            variance: ratio.variance,
            unchanged: differs * ratio.unchanged,
            differs,
        })
    }
}

/// A line in a recording over that in its reference, as noise lets it be known.
#[derive(Clone, Copy, Debug)]
pub struct Ratio {
    /// ln of the amplitudes' ratio; a line below its noise counts as its noise.
    pub log: f64,
    /// Variance of `log`.
    pub variance: f64,
    /// The same if the line did not change. Less where it rises out of the noise: how far it rose
    /// is not known, but that it was below the noise is.
    pub unchanged: f64,
}

impl Ratio {
    /// By powers and noise powers in the recording and in the reference.
    pub fn of(powers: [f64; 2], noises: [f64; 2]) -> Self {
        let [x, y] = [0, 1].map(|k| powers[k].max(noises[k]));
        let (log, variance) = (0.5 * (x / y).ln(), 0.5 * (noises[0] / x + noises[1] / y));
        // The difference of two amplitudes scatters by the root mean square of their noise,
        // whatever they are.
        let [a, b] = powers.map(|p| (2.0 * p / (noises[0] + noises[1])).sqrt());
        Self { log, variance, unchanged: variance.min((log / (a - b)).powi(2)) }
    }
}

/// The background of a band in a recording and in its reference.
#[derive(Clone, Copy, Debug)]
pub struct FloorChange {
    /// Position of the pair.
    pub pair: usize,
    /// Position of the channel.
    pub channel: usize,
    /// (Hz).
    pub frequency_hz: f64,
    /// ln of the amplitude ratio.
    pub log_ratio: f64,
    /// Variance of `log_ratio` from the finite number of bins.
    pub variance: f64,
}

/// A recording and the reference at the same speed and load.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    /// Position of the recording.
    pub recording: usize,
    /// Position of the reference.
    pub reference: usize,
    /// Motor speed (Hz).
    pub speed_hz: f64,
    /// Brake torque (N m).
    pub torque_nm: f64,
    /// ln of the speed in the recording over that in the reference: settings repeat to tenths of a
    /// per cent.
    pub speed_gap: f64,
    /// The recording takes no part in fits; its reference, which shows the bench as it was, does.
    pub held_out: bool,
}

/// All changes between recordings and reference.
#[derive(Clone)]
pub struct Comparison {
    /// Pairs at the same operating point.
    pub pairs: Vec<Pair>,
    /// Channel names that occur in every pair.
    pub channels: Vec<String>,
    /// Lines.
    pub lines: Vec<LineChange>,
    /// Background.
    pub floors: Vec<FloorChange>,
}

impl Comparison {
    /// The comparison with the recordings of some pairs held out of fits.
    pub fn holding_out(&self, held: &[usize]) -> Self {
        let mut out = self.clone();
        out.pairs.iter_mut().enumerate().for_each(|(p, pair)| pair.held_out = held.contains(&p));
        out
    }
}

/// Median of `(|x| − |y|)²` of two complex Gaussian values of a mean power of 1 (drawn).
const SQUARE_OF_NOISE: f64 = 0.188;
/// Bins that count as if all of them differed: few tell little.
const AS_IF_NOISE: usize = 20;

/// Share of the power of what stands beside a line that differs between two recordings.
///
/// It is noise in part only. What the errors of all teeth of two gears make together repeats with
/// the hunting tooth: its lines stand closer than a recording resolves, and are as high in every
/// session. Where most of it repeats the share comes out up to 2.4 times too large.
fn differs(recordings: [(&RecordingFeatures, &ChannelFeatures); 2], order: f64) -> f64 {
    let revolutions = recordings[0].0.revolutions;
    let centre = (order * revolutions).round() as usize;
    let beside = |k: usize| {
        let at = |(r, channel): (&RecordingFeatures, &ChannelFeatures)| {
            let bin = (k as f64 * r.revolutions / revolutions).round() as usize;
            let free = !*r.taken.get(bin)?;
            free.then_some((channel.order_spectrum.get(bin)?.norm(), *channel.order_floor.get(bin)?))
        };
        let ((x, noise_x), (y, noise_y)) = (at(recordings[0])?, at(recordings[1])?);
        Some(([x, y], 0.5 * (noise_x + noise_y)))
    };
    share_that_differs((centre.saturating_sub(NOISE_BINS)..=centre + NOISE_BINS).filter_map(beside))
}

/// The same of the amplitudes of bins in both recordings, with their noise power.
fn share_that_differs(bins: impl Iterator<Item = ([f64; 2], f64)>) -> f64 {
    let share = |([x, y], noise): ([f64; 2], f64)| (x - y).powi(2) / (SQUARE_OF_NOISE * noise);
    let mut all: Vec<f64> = bins.map(share).chain([1.0; AS_IF_NOISE]).collect();
    median(&mut all).min(1.0)
}

/// ln of the ratio of speeds: by the tachos where there are two, whatever the sample clocks say.
fn speed_gap(recording: &RecordingFeatures, reference: &RecordingFeatures) -> f64 {
    match (recording.tacho_input_hz, reference.tacho_input_hz) {
        (Some(a), Some(b)) => (a / b).ln(),
        _ => (recording.input_hz / reference.input_hz).ln(),
    }
}

/// Pairs recordings with references and compares them.
pub fn compare(recordings: &[RecordingFeatures], references: &[RecordingFeatures]) -> Comparison {
    let mut pairs = Vec::new();
    for (i, rec) in recordings.iter().enumerate() {
        let gap = |r: &RecordingFeatures| {
            let torque = (r.brake_torque_nm - rec.brake_torque_nm).abs() / rec.brake_torque_nm.abs().max(1e-9);
            ((r.input_hz / rec.input_hz - 1.0).abs(), if torque.is_finite() { torque } else { 0.0 })
        };
        let best = references
            .iter()
            .enumerate()
            .map(|(j, r)| (j, gap(r)))
            .filter(|(_, (speed, torque))| *speed < SAME_SPEED && *torque < SAME_TORQUE)
            .min_by(|a, b| (a.1.0 + a.1.1).total_cmp(&(b.1.0 + b.1.1)));
        if let Some((j, _)) = best {
            let speed_hz = if rec.display_motor_hz.is_finite() { rec.display_motor_hz } else { rec.input_hz };
            pairs.push(Pair {
                recording: i,
                reference: j,
                speed_hz,
                torque_nm: rec.brake_torque_nm,
                speed_gap: speed_gap(rec, &references[j]),
                held_out: false,
            });
        }
    }
    let mut channels: Vec<String> = Vec::new();
    if let Some(first) = pairs.first() {
        for c in &recordings[first.recording].channels {
            let everywhere = pairs.iter().all(|p| {
                recordings[p.recording].channels.iter().any(|d| d.name == c.name)
                    && references[p.reference].channels.iter().any(|d| d.name == c.name)
            });
            if everywhere {
                channels.push(c.name.clone());
            }
        }
        // A clipped channel shows lines of its own; the others tell more without it.
        let clipped = |name: &String| {
            pairs.iter().any(|p| {
                let channel = recordings[p.recording].channels.iter().find(|d| d.name == *name);
                channel.is_some_and(|d| d.integrity.clipped_at.is_some())
            })
        };
        if channels.iter().any(|c| !clipped(c)) {
            channels.retain(|c| !clipped(c));
        }
    }
    let mut out = Comparison { pairs, channels, lines: Vec::new(), floors: Vec::new() };
    for (p, pair) in out.pairs.iter().enumerate() {
        let (rec, reference) = (&recordings[pair.recording], &references[pair.reference]);
        for (c, name) in out.channels.iter().enumerate() {
            let (Some(a), Some(b)) =
                (rec.channels.iter().find(|d| d.name == *name), reference.channels.iter().find(|d| d.name == *name))
            else {
                continue;
            };
            for (i, line) in rec.lines.iter().enumerate() {
                let Some(j) = reference.lines.iter().position(|l| l.family == line.family) else { continue };
                let (Some(x), Some(y)) = (a.values[i], b.values[j]) else { continue };
                let at = (p, c, line.family, line.order);
                out.lines.extend(LineChange::of(at, [(rec, a, x), (reference, b, y)]));
            }
            for (x, y) in a.floor.iter().zip(&b.floor) {
                let bins = x.bins.min(y.bins) as f64;
                if bins < 12.0 || !(x.power > 0.0 && y.power > 0.0) {
                    continue;
                }
                // The logarithm of the lower quartile of n exponentials varies by p/((1 − p) n
                // ln²(1 − p)) = 4.03/n, in each of both recordings; neighbouring bins of this
                // window go in pairs.
                let variance = 0.25 * 2.0 * 4.03 / (bins / 2.0);
                out.floors.push(FloorChange {
                    pair: p,
                    channel: c,
                    frequency_hz: x.frequency_hz,
                    log_ratio: 0.5 * (x.power / y.power).ln(),
                    variance,
                });
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_1_SQRT_2;

    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;

    /// Of lines that repeat to 6 % the score scatters by one where they stand out of the noise, and
    /// by less within it, where an amplitude cannot fall below 0. One of ten times the noise where
    /// there was none before scores `ln 10 / √((ln 10 / 10)² + 0.06²) = 9.7`, while its logarithm
    /// alone, of which half a neper is noise, comes to 3.2.
    #[test]
    fn analytic_scores_of_an_unchanged_line_scatter_by_one() {
        let score = |amplitudes: [f64; 2]| {
            let ratio = Ratio::of(amplitudes.map(|a| a * a), [1.0; 2]);
            ratio.log / (ratio.unchanged + 0.0036).sqrt()
        };
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        for (amplitude, least) in [(0.0, 0.4), (1.0, 0.6), (3.0, 0.9), (10.0, 0.95), (100.0, 0.95)] {
            let mut measured = || {
                let real = amplitude * (1.0 + 0.06 * FRAC_1_SQRT_2 * normal()) + FRAC_1_SQRT_2 * normal();
                real.hypot(FRAC_1_SQRT_2 * normal())
            };
            let scores: Vec<f64> = (0..4000).map(|_| score([measured(), measured()])).collect();
            let scatter = (scores.iter().map(|s| s * s).sum::<f64>() / 4000.0).sqrt();
            // 4000 draws know it to 1.1 %.
            assert!((least..1.05).contains(&scatter), "{amplitude}: {scatter}");
        }
        assert!((score([10.0, 0.0]) - 9.68).abs() < 0.01);
    }

    /// Of noise alone all differs (the median of 240 squares scatters by 13 %), of noise of a
    /// quarter of the power a quarter to 2.4 times that, of what repeats wholly next to nothing.
    /// Three bins tell nothing: all of it may differ.
    #[test]
    fn analytic_what_repeats_between_lines_is_no_noise() {
        let mut random = ChaCha8Rng::seed_from_u64(11);
        let mut normal =
            || -> f64 { FRAC_1_SQRT_2 * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut random) };
        let mut share = |bins: usize, noise: f64| {
            let mut bin = |_| {
                let common = [0, 1].map(|_| (1.0 - noise).sqrt() * normal());
                let measured = [0, 1].map(|_| common.map(|z| z + noise.sqrt() * normal()));
                (measured.map(|[re, im]| re.hypot(im)), 1.0)
            };
            share_that_differs((0..bins).map(&mut bin).collect::<Vec<_>>().into_iter())
        };
        assert!(share(240, 1.0) > 0.6);
        // Beside what is far higher only noise in phase with it counts: 0.455 / 0.188 times as
        // much.
        assert!((0.25..0.25 * 0.455 / SQUARE_OF_NOISE + 0.1).contains(&share(240, 0.25)));
        assert!(share(240, 0.0) < 0.01);
        assert_eq!(share(3, 0.0), 1.0);
    }
}
