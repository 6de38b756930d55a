//! A mode of the path that came, went or moved a little: at all speeds the background changes about
//! one frequency, over far less than a band of it.
//!
//! Near a mode of frequency `f₀` and damping ratio `ζ` the logarithm of a response changes by
//! `Re[(a + i b) ζ / (ζ + i ε)]`, `ε = f/f₀ − 1`, whatever small change the mode undergoes (of its
//! pole or of its share in the response, to first order). Each channel has `a` and `b` of its own,
//! by least squares over narrow bands of what is left when the train's lines are taken out. What
//! counts is the gain at all speeds together beyond that at the one speed that shows most: lines
//! that nobody listed, and skirts of those that were, stand elsewhere at another speed.
//!
//! Meshes make noise, and teeth that changed make more of it or less. It stands out where modes
//! that stay carry it to a sensor: there the background rises, or falls, by a peak `a` of one sign
//! on all channels, of any width and place. What the best such peak accounts for is not counted
//! either.

use std::ops::Range;

use crate::read::SAME_SPEED;
use crate::read::narrow;
use crate::read::scan::Twin;

/// Modes that are tried: lowest (Hz), highest (of the highest band), step (ln), damping ratios.
const LOWEST_HZ: f64 = 100.0;
const HIGHEST: f64 = 0.95;
const STEP: f64 = 0.01;
const DAMPING_RATIOS: [f64; 3] = [0.01, 0.02, 0.04];
/// How far about a mode bands are read (damping ratios).
const REACH: f64 = 4.0;
/// Largest score of one band: a line that nobody listed does not decide.
const LIMIT: f64 = 5.0;
/// Neighbouring bands overlap by half.
const INDEPENDENT: f64 = 0.5;
/// Least bands in which a channel tells of a mode at a speed.
const LEAST_BANDS: usize = 4;
/// Damping ratios of peaks of noise: narrow, or several that have grown into one.
const NOISE_DAMPING_RATIOS: [f64; 5] = [0.01, 0.02, 0.04, 0.08, 0.16];
/// Odds that a bench has such a mode, before it is looked for: as of a family of lines.
const PRIOR: f64 = 1e-3;

/// The mode that accounts best for what the background did.
#[derive(Clone, Debug)]
pub struct MovedMode {
    /// Frequency (Hz): of the mode, or of a notch that it makes with others.
    pub hz: f64,
    /// ln of the odds against a background that moved by chance.
    pub nats: f64,
    /// Gain of each channel in log likelihood (nats).
    pub by_channel: Vec<f64>,
}

impl MovedMode {
    /// The channel that alone shows it: on every other it gains less than the odds against a mode.
    pub fn of_one_channel(&self) -> Option<usize> {
        let shows: Vec<usize> = (0..self.by_channel.len()).filter(|c| self.by_channel[*c] > -PRIOR.ln()).collect();
        if let ([own], true) = (&shows[..], self.by_channel.len() > 1) { Some(*own) } else { None }
    }

    /// In words.
    pub fn describe(&self) -> String {
        let by_channel: Vec<String> = self.by_channel.iter().map(|g| format!("{g:.0}")).collect();
        format!(
            "a mode near {:.0} Hz that moved accounts for the background at all speeds: {} nats by channel, odds of e^{:.1}",
            self.hz,
            by_channel.join(", "),
            self.nats
        )
    }
}

/// What the narrow bands of one channel did in one pair.
struct Row {
    channel: usize,
    /// Pairs of one speed have the same.
    speed: usize,
    /// Change (ln amplitude) over its standard deviation, limited, and that deviation.
    bands: Vec<Option<(f64, f64)>>,
}

/// A band of one channel at one speed: `Σ 1/σ²`, `Σ score/σ` and the number of pairs that have it.
#[derive(Clone, Copy, Default)]
struct Band {
    weight: f64,
    right: f64,
    pairs: usize,
}

/// Where modes are sought.
struct Search<'a> {
    /// Of the bands (Hz).
    middles: &'a [f64],
    /// By channel, speed and band.
    bands: Vec<Vec<Vec<Band>>>,
}

/// Sums of the normal equations of one channel at one speed.
#[derive(Clone, Copy, Default)]
struct Sums {
    normal: [f64; 3],
    right: [f64; 2],
    /// Bands that were read.
    bands: usize,
}

impl Sums {
    fn plus(self, other: Self) -> Self {
        Self {
            normal: std::array::from_fn(|k| self.normal[k] + other.normal[k]),
            right: std::array::from_fn(|k| self.right[k] + other.right[k]),
            bands: self.bands + other.bands,
        }
    }

    fn is_told(&self) -> bool {
        self.bands >= LEAST_BANDS
    }

    /// Gain in log likelihood of the best `a` and `b` (nats).
    fn gain(&self) -> f64 {
        let ([aa, ab, bb], [a, b]) = (self.normal, self.right);
        let determinant = aa * bb - ab * ab;
        let told = self.is_told() && determinant > 1e-6 * aa * bb;
        if told { 0.5 * INDEPENDENT * (bb * a * a - 2.0 * ab * a * b + aa * b * b) / determinant } else { 0.0 }
    }
}

/// A mode that was tried.
struct Tried {
    hz: f64,
    /// Its bands.
    near: Range<usize>,
    /// By channel and speed, whether there are bands enough.
    told: Vec<Vec<bool>>,
    /// Gain beyond what one speed alone shows (nats).
    gain: f64,
    by_channel: Vec<f64>,
}

/// `ζ² / (ζ² + ε²)`, the part of a mode that does not change its sign, and the part that does.
fn form(middle: f64, hz: f64, damping: f64) -> [f64; 2] {
    let off = (middle / hz - 1.0) / damping;
    [1.0 / (1.0 + off * off), off / (1.0 + off * off)]
}

impl<'a> Search<'a> {
    fn new(middles: &'a [f64], rows: &[Row], channels: usize, speeds: usize) -> Self {
        let mut bands = vec![vec![vec![Band::default(); middles.len()]; speeds]; channels];
        for row in rows {
            for (own, band) in bands[row.channel][row.speed].iter_mut().zip(&row.bands) {
                let Some((score, sigma)) = band else { continue };
                own.weight += sigma.powi(-2);
                own.right += score / sigma;
                own.pairs += 1;
            }
        }
        Self { middles, bands }
    }

    /// Gain of a mode.
    fn tried(&self, hz: f64, damping: f64) -> Tried {
        let end = |sign: f64| self.middles.partition_point(|m| *m < hz * (1.0 + sign * REACH * damping));
        let near = end(-1.0)..end(1.0);
        let forms: Vec<[f64; 2]> = self.middles[near.clone()].iter().map(|m| form(*m, hz, damping)).collect();
        let sums = |bands: &Vec<Band>| {
            bands[near.clone()].iter().zip(&forms).fold(Sums::default(), |sums, (band, [a, b])| {
                let normal = [a * a, a * b, b * b].map(|ab| band.weight * ab);
                sums.plus(Sums { normal, right: [a * band.right, b * band.right], bands: band.pairs })
            })
        };
        let sums: Vec<Vec<Sums>> = self.bands.iter().map(|speeds| speeds.iter().map(sums).collect()).collect();
        // A speed that tells nothing by itself has no part in what all show.
        let of = |c: &Vec<Sums>| c.iter().filter(|s| s.is_told()).fold(Sums::default(), |all, s| all.plus(*s)).gain();
        let by_channel: Vec<f64> = sums.iter().map(of).collect();
        let alone = |speed: usize| sums.iter().map(|c| c[speed].gain()).sum::<f64>();
        let speeds = sums.first().map_or(0, Vec::len);
        let most = (0..speeds).map(alone).fold(0.0, f64::max);
        let told = sums.iter().map(|c| c.iter().map(Sums::is_told).collect()).collect();
        Tried { hz, near, told, gain: by_channel.iter().sum::<f64>() - most, by_channel }
    }

    /// What the best peak of noise accounts for in the bands of a mode (nats): one sign on all
    /// channels.
    fn of_noise(&self, tried: &Tried) -> f64 {
        let middles = &self.middles[tried.near.clone()];
        let merged = |(speeds, told): (&Vec<Vec<Band>>, &Vec<bool>)| -> Vec<(f64, f64)> {
            let told = || speeds.iter().zip(told).filter(|(_, told)| **told).map(|(bands, _)| bands);
            let band = |k: usize| {
                told().fold((0.0, 0.0), |(weight, right), bands| (weight + bands[k].weight, right + bands[k].right))
            };
            tried.near.clone().map(band).collect()
        };
        let channels: Vec<Vec<(f64, f64)>> = self.bands.iter().zip(&tried.told).map(merged).collect();
        let (Some(low), Some(high)) = (middles.first(), middles.last()) else { return 0.0 };
        let places = places(*low, *high);
        let peaks = places.flat_map(|hz| NOISE_DAMPING_RATIOS.map(|damping| (hz, damping)));
        let gain = |(hz, damping): (f64, f64)| {
            let peak: Vec<f64> = middles.iter().map(|m| form(*m, hz, damping)[0]).collect();
            let of = |bands: &Vec<(f64, f64)>| -> [f64; 2] {
                let add = |(normal, sum): (f64, f64), ((weight, right), a): (&(f64, f64), &f64)| {
                    (normal + weight * a * a, sum + right * a)
                };
                let (normal, sum) = bands.iter().zip(&peak).fold((0.0, 0.0), add);
                let of = |sign: f64| 0.5 * INDEPENDENT * (sign * sum).max(0.0).powi(2) / normal;
                if normal > 0.0 { [of(1.0), of(-1.0)] } else { [0.0; 2] }
            };
            let [rises, falls] = channels.iter().map(of).fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d]);
            rises.max(falls)
        };
        peaks.map(gain).fold(0.0, f64::max)
    }

    /// The best mode, and its gain beyond what one speed alone and what noise may do.
    fn best(&self) -> Option<(Tried, f64)> {
        let modes = places(LOWEST_HZ, HIGHEST * self.middles.last()?);
        let modes = modes.flat_map(|hz| DAMPING_RATIOS.map(|damping| (hz, damping)));
        let mut tried: Vec<Tried> = modes.map(|(hz, damping)| self.tried(hz, damping)).collect();
        tried.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        let mut best: Option<(Tried, f64)> = None;
        for mode in tried {
            if best.as_ref().is_some_and(|(_, gain)| mode.gain <= *gain) {
                break;
            }
            let gain = mode.gain.min(mode.by_channel.iter().sum::<f64>() - self.of_noise(&mode));
            if best.as_ref().is_none_or(|(_, known)| gain > *known) {
                best = Some((mode, gain));
            }
        }
        best
    }

    /// The best mode with its odds: so many modes apart by a width could have been tried.
    fn moved(&self) -> Option<MovedMode> {
        let (Tried { hz, by_channel, .. }, gain) = self.best()?;
        let width = 2.0 * DAMPING_RATIOS[0];
        let apart = (HIGHEST * self.middles.last()? / LOWEST_HZ).ln() / width;
        Some(MovedMode { hz, nats: gain - apart.ln() + PRIOR.ln(), by_channel })
    }
}

/// Frequencies that are tried (Hz).
fn places(low_hz: f64, high_hz: f64) -> impl Iterator<Item = f64> {
    let count = ((high_hz / low_hz).ln() / STEP) as usize;
    (0..=count).map(move |k| low_hz * (STEP * k as f64).exp())
}

/// The mode that accounts best for how the background of recordings differs from that of their
/// references; `None` where there are not two speeds.
pub fn moved_mode(twins: &[Twin<'_>], channels: &[String]) -> Option<MovedMode> {
    let mut speeds: Vec<f64> = Vec::new();
    let mut rows = Vec::new();
    let rate = twins.iter().map(|t| t.recording.sample_rate_hz).fold(f64::INFINITY, f64::min);
    let middles = narrow::middles(rate);
    for twin in twins.iter().filter(|t| t.reference.is_some()) {
        let hz = twin.recording.input_hz;
        let known = speeds.iter().position(|s| (s / hz - 1.0).abs() < SAME_SPEED);
        let speed = known.unwrap_or_else(|| {
            speeds.push(hz);
            speeds.len() - 1
        });
        for (channel, name) in channels.iter().enumerate() {
            let changes = narrow::changes(twin, name, &middles)?;
            rows.push(Row { channel, speed, bands: scores(&changes) });
        }
    }
    if speeds.len() < 2 { None } else { Search::new(&middles, &rows, channels.len(), speeds.len()).moved() }
}

/// Scores of the bands of a row, limited, and their standard deviation (ln amplitude).
fn scores(changes: &[Option<(f64, f64)>]) -> Vec<Option<(f64, f64)>> {
    let of = |band: Option<(f64, f64)>| band.map(|(off, sigma)| ((off / sigma).clamp(-LIMIT, LIMIT), 0.5 * sigma));
    narrow::standard(changes, |_| 0.0).into_iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use num_complex::Complex64;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const SIGMA: f64 = 0.15;

    /// Two channels at two speeds: noise of a deviation of 0.15 (ln) in bands that overlap by half,
    /// and what a change does at each speed.
    fn ask(seed: u64, change: &dyn Fn(usize, f64) -> f64) -> MovedMode {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let middles = narrow::middles(8192.0);
        let mut row = |channel: usize, speed: usize| {
            let halves: Vec<f64> = (0..=middles.len()).map(|_| StandardNormal.sample(&mut random)).collect();
            let noise = halves.windows(2).map(|w| (w[0] + w[1]) / 2f64.sqrt());
            let of = |(hz, z): (&f64, f64)| Some(((z + change(speed, *hz) / SIGMA).clamp(-LIMIT, LIMIT), SIGMA));
            Row { channel, speed, bands: middles.iter().zip(noise).map(of).collect() }
        };
        let rows = [row(0, 0), row(1, 0), row(0, 1), row(1, 1)];
        Search::new(&middles, &rows, 2, 2).moved().unwrap()
    }

    /// Of two channels one shows it where the other gains less than `ln 1000`; the only channel
    /// cannot tell its own path from the housing's.
    #[test]
    fn analytic_a_mode_of_one_channel() {
        let of =
            |by_channel: &[f64]| MovedMode { hz: 500.0, nats: 9.0, by_channel: by_channel.to_vec() }.of_one_channel();
        assert_eq!(of(&[2.0, 40.0]), Some(1));
        assert_eq!(of(&[7.5, 40.0]), None);
        assert_eq!(of(&[40.0]), None);
    }

    /// Two speeds with three bands each tell nothing together either, however alike: what one of
    /// them shows alone could not be taken off.
    #[test]
    fn analytic_few_bands_at_each_speed_tell_nothing() {
        let middles: Vec<f64> = (0..6).map(|k| 160.0 + 4.0 * f64::from(k)).collect();
        let bands = |n: usize| (0..6).map(|k| (k < n).then_some((4.0, SIGMA))).collect();
        let gain = |n: usize| {
            let rows = [0, 1].map(|speed| Row { channel: 0, speed, bands: bands(n) });
            Search::new(&middles, &rows, 1, 2).tried(166.0, 0.04).gain
        };
        assert_eq!(gain(3), 0.0);
        assert!(gain(6) > 5.0);
    }

    /// Noise whose power rises fivefold about two modes that stay: none moved. Beside it one that
    /// moves by 2 % is found.
    #[test]
    fn analytic_noise_that_rises_about_modes_is_no_mode_that_moved() {
        let peak = |hz: f64, f0: f64| 1.0 / (1.0 + ((hz / f0 - 1.0) / 0.02).powi(2));
        let rises = |hz: f64| 0.5 * (1.0 + 4.0 * (peak(hz, 700.0) + peak(hz, 1500.0))).ln();
        let noise = ask(2, &|_, hz| rises(hz));
        assert!(noise.nats < 0.0, "{noise:?}");
        let moved = moves_by(0.02);
        let both = ask(2, &|_, hz| rises(hz) + moved(1, hz));
        assert!(both.nats > 5.0 && (both.hz / 1000.0 - 1.0).abs() < 0.04, "{both:?}");
    }

    /// ln of what a mode of 2 % at 1 kHz that is heard eight times as loud as all else, and makes
    /// no notch with it, does when it moves by a part.
    fn moves_by(part: f64) -> impl Fn(usize, f64) -> f64 {
        let loud = |hz: f64, f0: f64| {
            let r = hz / f0;
            (1.0 + Complex64::new(0.0, 8.0 * 0.04) / Complex64::new(1.0 - r * r, 0.04 * r)).norm().ln()
        };
        move |_, hz| loud(hz, 1000.0 * (1.0 + part)) - loud(hz, 1000.0)
    }

    /// A mode that moves by 2 % is found within its width, on both channels; at one speed alone the
    /// same is none, and of forty benches whose background is noise none has one: the odds before
    /// it is looked for are a thousandth.
    #[test]
    fn analytic_a_mode_that_moved_does_so_at_all_speeds() {
        let moved = moves_by(0.02);
        let found = ask(1, &moved);
        assert!(found.nats > 5.0 && (found.hz / 1000.0 - 1.0).abs() < 0.04, "{found:?}");
        assert!(found.by_channel.iter().all(|g| *g > 5.0), "{found:?}");
        let at_one_speed = ask(1, &|speed, hz| if speed == 0 { moved(speed, hz) } else { 0.0 });
        assert!(at_one_speed.nats < 0.0, "{at_one_speed:?}");
        for seed in 0..40 {
            assert!(ask(seed, &|_, _| 0.0).nats < 0.0);
        }
    }
}
