//! Samples that are missing without a mark: every line's phase steps by its frequency times the
//! time that is missing, all at one instant.
//!
//! The lines are the narrow peaks of the recording itself, so that a wrong sheet cannot make a gap.
//! Before and after each instant the phase of each line is read over half a second. A wander of the
//! speed turns all phases in proportion to frequency too, but slowly: as if some few samples were
//! missing, everywhere a little.
//!
//! A machine that slips turns later from one instant on: all phases step as if there were too many
//! samples. Nothing is lost then. By the machine's own period more it would seem lost, so both
//! directions are asked.

use num_complex::Complex64;
use std::f64::consts::TAU;

use super::repetition;
use super::samples::BY_CHANCE;
use crate::read::dsp::{self, Transforms, median};

/// Length over which phases are read before and after an instant (s).
const SIDE_S: f64 = 0.4;
/// Samples gathered at a time (s): the grid of instants.
const BLOCK_S: f64 = 0.005;
/// Lines of a channel that are used, their least power over the background, and their least
/// distance (Hz): the window tells them apart.
const LINES: usize = 24;
const ABOVE: f64 = 30.0;
const APART_HZ: f64 = 6.0;
/// Highest line (Hz): above it the wander of the speed smears phases over half a second.
const HIGHEST_HZ: f64 = 2500.0;
/// Longest stretch that is sought (s).
const LONGEST_S: f64 = 0.4;
/// Most by which a machine that slips turns later (s): a fifth of a turn at 50 Hz.
const LATEST_S: f64 = 0.004;
/// Lines of all channels step together: their phases' noise is in part the same.
const TEMPER: f64 = 0.5;
/// Most that the phase of one line counts, and nats within which two lengths of a gap are the same.
const MOST_SURE: f64 = 30.0;
const AS_WELL: f64 = 5.0;
/// Least power about an instant, over the usual, of a line that is used there: two lines that
/// nearly coincide beat, and where they cancel their phase turns round by itself.
const PRESENT: f64 = 0.5;
/// Instants that are looked at closely, each farther than a side from the others.
const LOOKED_AT: usize = 6;

/// An instant at which the phases of all lines step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// First sample after it, within [`Step::within`] samples.
    pub at: usize,
    /// How far off `at` may be: phases are read over a side, so the instant is known to a fifth of
    /// it.
    pub within: usize,
    /// Samples that are missing, and the standard deviation of that; negative where the machine
    /// turns later from there on.
    pub samples: (f64, f64),
    /// Nats over no step.
    pub gain: f64,
}

impl Step {
    /// Whether samples are missing, beside machines that turn later by so many samples at most:
    /// what slips catches up, too, so that steps twice as long are its own either way.
    pub fn is_gap(&self, late: f64) -> bool {
        self.samples.0 > 2.0 * late
    }

    /// Samples by which the machine turns later.
    pub fn late(&self) -> f64 {
        -self.samples.0
    }
}

/// A narrow line of a channel.
struct Line {
    hz: f64,
    /// Sums over blocks, turned back by its own frequency.
    blocks: Vec<Complex64>,
}

/// Narrow peaks of a channel, the plainest first.
fn peaks(transforms: &mut Transforms, samples: &[f64], rate: f64) -> Vec<f64> {
    let spectrum = dsp::windowed_spectrum(transforms, samples);
    let bin_hz = rate / samples.len() as f64;
    let power: Vec<f64> = spectrum.iter().map(|b| b.norm_sqr()).collect();
    let half = ((20.0 / bin_hz) as usize).max(20);
    let last = ((HIGHEST_HZ.min(0.4 * rate)) / bin_hz) as usize;
    let first = (15.0 / bin_hz) as usize + 1;
    let mut found: Vec<(f64, f64)> = Vec::new();
    for k in first.max(1)..last.min(power.len().saturating_sub(2)) {
        if power[k] < power[k - 1] || power[k] < power[k + 1] {
            continue;
        }
        let mut about: Vec<f64> = power[k.saturating_sub(half)..(k + half).min(power.len())].to_vec();
        let floor = median(&mut about);
        if power[k] > ABOVE * floor {
            // Parabola through the logarithms about the peak.
            let (a, b, c) = (power[k - 1].ln(), power[k].ln(), power[k + 1].ln());
            let shift = 0.5 * (a - c) / (a - 2.0 * b + c);
            let offset = if shift.is_finite() { shift.clamp(-0.5, 0.5) } else { 0.0 };
            found.push(((k as f64 + offset) * bin_hz, power[k] / floor));
        }
    }
    found.sort_by(|x, y| y.1.total_cmp(&x.1));
    let mut kept: Vec<f64> = Vec::new();
    for (hz, _) in found {
        if kept.len() < LINES && kept.iter().all(|k| (k - hz).abs() > APART_HZ) {
            kept.push(hz);
        }
    }
    kept
}

fn line(samples: &[f64], hz: f64, rate: f64, block: usize) -> Line {
    let step = Complex64::from_polar(1.0, -TAU * hz / rate);
    let blocks = samples
        .chunks(block)
        .enumerate()
        .map(|(k, part)| {
            let mut turn = Complex64::from_polar(1.0, -TAU * (hz * (k * block) as f64 / rate).fract());
            part.iter().fold(Complex64::ZERO, |sum, x| {
                let next = sum + turn * x;
                turn *= step;
                next
            })
        })
        .collect();
    Line { hz, blocks }
}

/// Phase steps of all lines at each instant.
struct Steps {
    hz: Vec<f64>,
    /// By instant, then line.
    phases: Vec<Vec<f64>>,
    /// Concentration of each line's phase steps where nothing happens.
    weight: Vec<f64>,
    /// Power of the line about each instant over its median, 1 at most and 0 below [`PRESENT`].
    presence: Vec<Vec<f64>>,
}

impl Steps {
    fn of(lines: &[Line], side: usize) -> Option<Self> {
        let count = lines.first()?.blocks.len();
        if count < 4 * side {
            return None;
        }
        // Half a Hann window that falls to nothing away from the instant: neighbours 2.5 Hz off are
        // told apart, and what is near the instant counts most.
        let window: Vec<f64> = (0..side).map(|k| 0.5 - 0.5 * (TAU * (k as f64 + 0.5) / side as f64).cos()).collect();
        let sum = |blocks: &[Complex64]| blocks.iter().zip(&window).map(|(b, w)| b * w).sum::<Complex64>();
        let turn = |l: &Line, at: usize| sum(&l.blocks[at..at + side]) * sum(&l.blocks[at - side..at]).conj();
        let turns: Vec<Vec<Complex64>> =
            (side..count - side).map(|at| lines.iter().map(|l| turn(l, at)).collect()).collect();
        let usual: Vec<f64> = (0..lines.len())
            .map(|l| median(&mut turns.iter().map(|t| t[l].norm()).collect::<Vec<f64>>()).max(f64::MIN_POSITIVE))
            .collect();
        let presence = turns
            .iter()
            .map(|t| t.iter().zip(&usual).map(|(z, usual)| z.norm() / usual).map(presence).collect())
            .collect();
        let phases = turns.iter().map(|t| t.iter().map(|z| z.arg()).collect()).collect();
        let mut out =
            Self { hz: lines.iter().map(|l| l.hz).collect(), weight: vec![1.0; lines.len()], phases, presence };
        // Beside a gap the peak of a line is not at its frequency: what its steps have in common is
        // that error, and is taken off. Weights by what is left, in the median, so that the
        // instants about a gap do not count; both again with the wander that they give.
        for _ in 0..3 {
            let wander: Vec<f64> = (0..out.phases.len()).map(|k| out.best(k, 0.0, wander_s()).0).collect();
            for l in 0..out.hz.len() {
                let turn = |k: usize, off: f64| wrapped(out.phases[k][l] - TAU * out.hz[l] * wander[k] - off);
                let count = out.phases.len();
                let mean = (0..count).map(|k| Complex64::from_polar(1.0, turn(k, 0.0))).sum::<Complex64>().arg();
                let mut left: Vec<f64> = (0..count).map(|k| turn(k, mean)).collect();
                let off = mean + median(&mut left);
                let mut squares: Vec<f64> = (0..count).map(|k| turn(k, off).powi(2)).collect();
                // The median of a squared normal deviate is 0.455 of its variance.
                out.weight[l] = (0.455 / median(&mut squares).max(1e-6)).min(MOST_SURE);
                out.phases.iter_mut().for_each(|p| p[l] = wrapped(p[l] - off));
            }
        }
        Some(out)
    }

    /// Log likelihood of an instant at which all lines agree.
    fn agreement(&self, at: usize) -> f64 {
        self.weight.iter().zip(&self.presence[at]).map(|(w, presence)| w * presence).sum()
    }

    /// The time that is missing (s, negative where there is too much), at least and at most so
    /// long, and its log likelihood. Of times that agree as well, the machine's own period apart,
    /// the shortest; backwards no longer than a machine slips.
    fn best(&self, at: usize, least_s: f64, most_s: f64) -> (f64, f64) {
        let highest = self.hz.iter().copied().fold(1.0, f64::max);
        let step = 1.0 / (10.0 * highest);
        let count = (most_s / step).ceil() as i64;
        let first = if least_s > 0.0 { -(LATEST_S / step).ceil() as i64 } else { -count };
        // Each line's step, turned on from one time to the next.
        let lines = self.phases[at].iter().zip(&self.hz).zip(self.weight.iter().zip(&self.presence[at]));
        let mut left: Vec<(Complex64, Complex64)> = lines
            .map(|((p, hz), (w, presence))| {
                let from = Complex64::from_polar(w * presence, p - TAU * hz * first as f64 * step);
                (from, Complex64::from_polar(1.0, -TAU * hz * step))
            })
            .collect();
        let all: Vec<(f64, f64)> = (first..=count)
            .map(|k| {
                let sum = left.iter().map(|l| l.0.re).sum();
                left.iter_mut().for_each(|l| l.0 *= l.1);
                (k as f64 * step, sum)
            })
            .filter(|(x, _)| x.abs() >= least_s)
            .collect();
        let highest = |some: &mut dyn Iterator<Item = (f64, f64)>| {
            some.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0.0, f64::NEG_INFINITY))
        };
        let most = highest(&mut all.iter().copied());
        if least_s <= 0.0 {
            return most;
        }
        let as_well = all.iter().filter(|x| TEMPER * (most.1 - x.1) < AS_WELL);
        let Some(near) = as_well.map(|x| x.0).min_by(|a, b| a.abs().total_cmp(&b.abs())) else { return most };
        // Up to the top of that peak.
        highest(&mut all.iter().copied().filter(|x| (x.0 - near).abs() < 5.5 * step))
    }
}

/// What a line counts by its power over the usual.
fn presence(share: f64) -> f64 {
    if share < PRESENT { 0.0 } else { share.min(1.0) }
}

/// An angle within half a turn.
fn wrapped(x: f64) -> f64 {
    x - TAU * (x / TAU).round()
}

/// Time by which the wander of the speed moves lines over a side (s).
fn wander_s() -> f64 {
    repetition::OF_SPEED * SIDE_S
}

/// Instants of a run of all channels at which the phases of all lines step, in the order of time.
pub fn steps(transforms: &mut Transforms, channels: &[&[f64]], rate: f64) -> Vec<Step> {
    let block = ((BLOCK_S * rate) as usize).max(1);
    let side = (SIDE_S / BLOCK_S).round() as usize;
    let lines: Vec<Line> = channels
        .iter()
        .flat_map(|x| {
            let whole = x.len() / block * block;
            peaks(transforms, &x[..whole], rate)
                .into_iter()
                .map(|hz| line(&x[..whole], hz, rate, block))
                .collect::<Vec<_>>()
        })
        .collect();
    if lines.len() < 4 {
        return Vec::new();
    }
    let Some(steps) = Steps::of(&lines, side) else { return Vec::new() };
    let usual: Vec<f64> = (0..steps.phases.len()).map(|k| steps.best(k, 0.0, wander_s()).1).collect();
    let middle = median(&mut usual.clone());
    let mut order: Vec<usize> = (0..usual.len()).collect();
    let short: Vec<f64> = usual.iter().enumerate().map(|(k, usual)| steps.agreement(k) - usual).collect();
    order.sort_by(|a, b| short[*b].total_cmp(&short[*a]));
    let mut looked: Vec<usize> = Vec::new();
    for k in order {
        if looked.len() < LOOKED_AT && looked.iter().all(|l| l.abs_diff(k) > side / 2) {
            looked.push(k);
        }
    }
    // Instants and lengths that were tried, against the probability that any of them wins by
    // chance.
    let tried = steps.phases.len() as f64 * LONGEST_S * rate;
    let needed = (tried / BY_CHANCE).ln();
    let mut out: Vec<Step> = Vec::new();
    for k in looked {
        // Where even full agreement would not be enough nothing is sought.
        if TEMPER * short[k] < needed {
            break;
        }
        let about = k.saturating_sub(side / 2)..(k + side / 2).min(usual.len());
        let Some((at, missing, likelihood)) = about
            .step_by(2)
            .map(|at| {
                let (x, likelihood) = steps.best(at, wander_s(), LONGEST_S);
                (at, x, likelihood)
            })
            .max_by(|a, b| (a.2 - usual[a.0]).total_cmp(&(b.2 - usual[b.0])))
        else {
            continue;
        };
        let gain = TEMPER * (likelihood - usual[at]);
        if gain > needed && likelihood > repetition::OF_PHASES * middle {
            let information: f64 = steps.hz.iter().zip(&steps.weight).map(|(hz, w)| w * (TAU * hz).powi(2)).sum();
            let sigma = (TEMPER * information).sqrt().recip().hypot(0.25 * wander_s());
            out.push(Step {
                at: (at + side) * block,
                within: 3 * block,
                samples: (missing * rate, sigma * rate),
                gain,
            });
        }
    }
    // Seen from either side, one step is one: of two within a side the plainer counts.
    out.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let mut apart: Vec<Step> = Vec::new();
    for step in out {
        if apart.iter().all(|s| s.at.abs_diff(step.at) >= side * block) {
            apart.push(step);
        }
    }
    apart.sort_by_key(|s| s.at);
    apart
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    const RATE_HZ: f64 = 8192.0;

    /// Lines of two shafts with a wander of a thousandth, in noise.
    fn run(len: usize, seed: u64) -> Vec<f64> {
        run_of(len, seed, 0.561, |t| t)
    }

    /// The same of another ratio of the shafts, and at the instants of another clock.
    fn run_of(len: usize, seed: u64, ratio: f64, clock: impl Fn(f64) -> f64) -> Vec<f64> {
        let mut state = seed;
        let mut even = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..len)
            .map(|n| {
                let t = clock(n as f64 / RATE_HZ);
                let turn = 29.7 * (t + 2e-4 * (PI * t).sin() / PI);
                let shafts = [(1.0, 1.0), (2.0, 0.6), (16.4 * ratio, 0.4), (60.0 * ratio, 0.6)].into_iter();
                let meshes = (1..=3).flat_map(|h| {
                    let (order, size) = (23.0 * f64::from(h), 1.0 / f64::from(h));
                    let beside = [-1.0, -ratio, ratio, 1.0].map(|s| (order + s, 0.5 * size));
                    beside.into_iter().chain([(order, 2.0 * size)])
                });
                let lines: f64 =
                    shafts.chain(meshes).map(|(order, a)| a * (TAU * order * turn + order * order).cos()).sum();
                lines + 2.0 * (even() + even() + even() - 1.5)
            })
            .collect()
    }

    /// Lines of 400 and 400.5 Hz of amplitudes 1 and 0.9 cancel to a tenth once in two seconds, at
    /// 1 s: there they have no vote, and half a period on they have a whole one.
    #[test]
    fn analytic_lines_that_cancel_have_no_vote() {
        let beating = |n: usize| {
            let t = n as f64 / RATE_HZ;
            (TAU * 400.0 * t).cos() - 0.9 * (TAU * 400.5 * (t - 1.0)).cos()
        };
        let samples: Vec<f64> = (0..4 * 8192).map(beating).collect();
        let block = (BLOCK_S * RATE_HZ) as usize;
        let side = (SIDE_S / BLOCK_S).round() as usize;
        let steps = Steps::of(&[line(&samples, 400.0, RATE_HZ, block)], side).unwrap();
        let presence = |s: f64| steps.presence[(s * RATE_HZ) as usize / block - side][0];
        assert_eq!((presence(1.0), presence(3.0)), (0.0, 0.0));
        assert_eq!(presence(2.0), 1.0);
    }

    /// Sidebands of two shafts that nearly coincide (12 and 6.476 Hz: 7 and 13 of them are 0.19 Hz
    /// apart) cancel every five seconds, about all mesh harmonics at one instant, and turn their
    /// phases round: nothing is missing there. The same run with 300 samples cut out where they do
    /// not cancel has lost them.
    #[test]
    fn regress_lines_that_beat_have_lost_nothing() {
        let beating = |seed: u64| -> Vec<f64> {
            let noise = run(5 * 8192, seed);
            let quiet = |n: usize| 0.05 * noise[n];
            (0..5 * 8192)
                .map(|n| {
                    let t = n as f64 / RATE_HZ;
                    let line = |hz: f64| (TAU * hz * (t - 2.5)).cos();
                    let about = |mesh: f64| {
                        let pair = |k: f64| line(mesh + k * 84.0) - line(mesh + k * 13.0 * 12.0 * 34.0 / 63.0);
                        line(mesh) * 0.1 + pair(1.0) + pair(-1.0)
                    };
                    about(408.0) + about(816.0) + about(1224.0) + quiet(n)
                })
                .collect()
        };
        for seed in 0..4 {
            let x = beating(seed);
            let found = steps(&mut Transforms::default(), &[&x], RATE_HZ);
            assert!(found.is_empty(), "{found:?}");
            let mut cut = x;
            cut.drain(8192..8492);
            let found = steps(&mut Transforms::default(), &[&cut], RATE_HZ);
            assert_eq!(found.len(), 1, "{found:?}");
            assert!((found[0].samples.0 - 300.0).abs() < 4.0 * found[0].samples.1, "{found:?}");
        }
    }

    /// A shaft that slips by 14 samples within 2 ms turns later from there on. Where every line is
    /// a multiple of half a turn, two turns less 14 samples would do as well: nothing is lost.
    /// Beside that a step of 14 samples the other way is the machine's own, one of 300 is not.
    #[test]
    fn regress_a_machine_that_slips_has_lost_nothing() {
        for seed in 0..4 {
            let slips = |t: f64| t - 14.0 / RATE_HZ * ((t - 2.4) / 0.002).clamp(0.0, 1.0);
            let x = run_of(5 * 8192, seed, 0.5, slips);
            let found = steps(&mut Transforms::default(), &[&x], RATE_HZ);
            assert_eq!(found.len(), 1, "{found:?}");
            assert!((found[0].late() - 14.0).abs() < 4.0 * found[0].samples.1 && !found[0].is_gap(0.0), "{found:?}");
            let of = |samples: f64| Step { samples: (samples, 1.0), ..found[0] }.is_gap(found[0].late());
            assert!(!of(14.0) && of(300.0));
        }
    }

    /// Cut out of the middle, 40 to 3000 samples are counted, and found to a quarter of the 0.4 s
    /// over which phases are read; nothing is cut out of a run that wanders.
    #[test]
    fn regress_lost_samples_are_counted_and_placed() {
        for lost in [40usize, 300, 512, 3000] {
            let mut x = run(5 * 8192, lost as u64);
            x.drain(20_000..20_000 + lost);
            let found = steps(&mut Transforms::default(), &[&x], RATE_HZ);
            assert_eq!(found.len(), 1, "{lost}: {found:?}");
            assert!(found[0].at.abs_diff(20_000) < 819, "{lost}: {found:?}");
            assert!((found[0].samples.0 - lost as f64).abs() < 4.0 * found[0].samples.1, "{lost}: {found:?}");
        }
        for seed in 0..5 {
            let found = steps(&mut Transforms::default(), &[&run(5 * 8192, 100 + seed)], RATE_HZ);
            assert!(found.is_empty(), "{found:?}");
        }
    }
}
