//! What the samples of a window say of the instrument.

use pulp::{Arch, Simd, WithSimd};

use crate::block::Quality;
use crate::verdict::InstrumentState;
use crate::window::Window;

/// Share of a window that one and the same value may fill in a row.
const STUCK_SHARE: usize = 8;

/// Samples of which the extremes are found at a time.
const CHUNK: usize = 512;

/// Samples at the extreme value from which clipping is looked at.
const PILE: usize = 5;

/// Samples whose smallest distance stands for the step of the converter.
const STEP_SAMPLES: usize = 512;

/// The top level of a sampled sine holds at most so many times what the level below it holds.
const EDGE: f64 = 2.4;

/// Logarithm of the probability from which on chance is out of the question: 10⁻⁹ a window, a few in a year of 64 channels.
const LN_CHANCE: f64 = -20.7;

/// The pile at the extreme by the samples just below it: 2.4 for a sine at most, far less for noise; 7 and more for noise that is
/// clipped at 2.5 sigma.
const PILE_RATIO: usize = 4;

/// What is wrong with the samples. The worst comes first: values that are not numbers, what the source says, what the values show.
/// An offset of more than `largest_offset` standard deviations is a wrong bias.
pub fn instrument_state(window: &Window, largest_offset: f64) -> InstrumentState {
    let Some(range) = Range::of(&window.samples) else { return InstrumentState::NotFinite };
    let has = |bits| window.quality.contains(bits);
    if has(Quality::SENSOR_FAULT) || has(Quality::INVALID) {
        InstrumentState::SensorFault
    } else if longest_run(&window.samples) >= window.samples.len() / STUCK_SHARE {
        InstrumentState::FlatLine
    } else if has(Quality::OVERLOAD) || range.is_clipped(&window.samples) {
        InstrumentState::Overload
    } else if range.is_far_from_zero(&window.samples, largest_offset) {
        InstrumentState::Bias
    } else if has(Quality::SETTLING) {
        InstrumentState::Settling
    } else if window.clock_trouble {
        InstrumentState::ClockTrouble
    } else {
        InstrumentState::Ok
    }
}

/// The smallest and the largest value, and how many samples have them.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Range {
    lowest: f64,
    highest: f64,
    at_lowest: usize,
    at_highest: usize,
}

impl Range {
    /// `None` where a value is not finite, or there is none.
    fn of(samples: &[f64]) -> Option<Self> {
        let mut range = Self { lowest: f64::INFINITY, highest: f64::NEG_INFINITY, at_lowest: 0, at_highest: 0 };
        for chunk in samples.chunks(CHUNK) {
            let (lowest, highest) = extremes(chunk)?;
            // Only the few chunks that reach as far as those before are counted through.
            if lowest < range.lowest {
                (range.lowest, range.at_lowest) = (lowest, 0);
            }
            if lowest == range.lowest {
                range.at_lowest += count(chunk, lowest);
            }
            if highest > range.highest {
                (range.highest, range.at_highest) = (highest, 0);
            }
            if highest == range.highest {
                range.at_highest += count(chunk, highest);
            }
        }
        (!samples.is_empty()).then_some(range)
    }

    /// Samples pile up at the largest or the smallest value.
    fn is_clipped(&self, samples: &[f64]) -> bool {
        let band = 0.01 * (self.highest - self.lowest);
        piles_up(samples, self.at_highest, self.highest, band) || piles_up(samples, self.at_lowest, self.lowest, band)
    }

    /// The mean lies more than `largest` standard deviations from zero.
    fn is_far_from_zero(&self, samples: &[f64], largest: f64) -> bool {
        // What crosses zero is not far from it; only the rest is worth a second look.
        if self.lowest <= 0.0 && self.highest >= 0.0 {
            return false;
        }
        let count = samples.len() as f64;
        let mean = samples.iter().sum::<f64>() / count;
        let variance = samples.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / count;
        mean * mean > largest * largest * variance
    }
}

fn count(samples: &[f64], value: f64) -> usize {
    samples.iter().filter(|x| **x == value).count()
}

fn piles_up(samples: &[f64], pile: usize, extreme: f64, band: f64) -> bool {
    pile >= PILE && (is_wall(samples, pile, extreme, band) || is_unlikely(samples, pile, extreme, band))
}

/// The pile outweighs all that lies beside it.
fn is_wall(samples: &[f64], pile: usize, extreme: f64, band: f64) -> bool {
    let beside = |reach: f64| samples.iter().filter(|x| **x != extreme && (**x - extreme).abs() <= reach).count();
    if pile <= PILE_RATIO * beside(band) {
        return false;
    }
    // Coarse counts: the level next to the extreme may lie farther than 1 % of the range.
    let next = samples.iter().filter(|x| **x != extreme).map(|x| (x - extreme).abs()).fold(f64::INFINITY, f64::min);
    pile > PILE_RATIO * beside(1.5 * next)
}

/// The pile is small, but by chance it cannot be: with `c` samples in the band below the extreme, and steps of the converter `q` wide, a
/// level holds `λ = c q / band` on the mean (up to [`EDGE`] times as much at the edge of a sine), and Chernoff's bound
/// `P(X ≥ k) ≤ exp(k − λ − k ln(k / λ))` says how probable `k` further samples at the extreme are. Signals that repeat exactly pile up
/// at other values too, and where a step is wider than the band, [`is_wall`] has said all there is to say.
fn is_unlikely(samples: &[f64], pile: usize, extreme: f64, band: f64) -> bool {
    let share = step(samples) / band;
    if share >= 1.0 {
        return false;
    }
    let near = |x: &&f64| **x != extreme && (**x - extreme).abs() <= band;
    let expected = EDGE * (samples.iter().filter(near).count() + 1) as f64 * share;
    let further = (pile - 1) as f64;
    if further <= expected || further - expected - further * (further / expected).ln() > LN_CHANCE {
        return false;
    }
    !samples.iter().filter(near).any(|x| PILE_RATIO * count(samples, *x) >= pile)
}

/// Width of the converter's steps: the smallest distance between values of the first samples. Larger than the true one where these
/// samples have none that are neighbours, never smaller.
fn step(samples: &[f64]) -> f64 {
    let mut first = [f64::INFINITY; STEP_SAMPLES];
    let count = samples.len().min(STEP_SAMPLES);
    let first = &mut first[..count];
    first.copy_from_slice(&samples[..count]);
    first.sort_unstable_by(f64::total_cmp);
    first.windows(2).map(|pair| pair[1] - pair[0]).filter(|d| *d > 0.0).fold(f64::INFINITY, f64::min)
}

/// Smallest and largest value; `None` where one is not finite.
fn extremes(samples: &[f64]) -> Option<(f64, f64)> {
    Arch::new().dispatch(Extremes(samples))
}

struct Extremes<'a>(&'a [f64]);

impl WithSimd for Extremes<'_> {
    type Output = Option<(f64, f64)>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Option<(f64, f64)> {
        let (body, rest) = S::as_simd_f64s(self.0);
        let (quads, odd) = body.as_chunks::<4>();
        let zero = simd.splat_f64s(0.0);
        let mut low = [simd.splat_f64s(f64::INFINITY); 4];
        let mut high = [simd.splat_f64s(f64::NEG_INFINITY); 4];
        let mut poison = [zero; 4];
        for quad in quads {
            for l in 0..4 {
                low[l] = simd.min_f64s(low[l], quad[l]);
                high[l] = simd.max_f64s(high[l], quad[l]);
                // 0 · x is not zero for what is not finite.
                poison[l] = simd.mul_add_e_f64s(quad[l], zero, poison[l]);
            }
        }
        for x in odd {
            low[0] = simd.min_f64s(low[0], *x);
            high[0] = simd.max_f64s(high[0], *x);
            poison[0] = simd.mul_add_e_f64s(*x, zero, poison[0]);
        }
        let bad = poison.iter().any(|p| simd.reduce_sum_f64s(*p) != 0.0) || rest.iter().any(|x| !x.is_finite());
        let lowest = low.iter().map(|l| simd.reduce_min_f64s(*l)).chain(rest.iter().copied());
        let highest = high.iter().map(|h| simd.reduce_max_f64s(*h)).chain(rest.iter().copied());
        (!bad).then(|| (lowest.fold(f64::INFINITY, f64::min), highest.fold(f64::NEG_INFINITY, f64::max)))
    }
}

/// Length of the longest run of one value.
fn longest_run(samples: &[f64]) -> usize {
    let step = (samples.len() / STUCK_SHARE / 2).max(1);
    // A run that matters covers at least one point of this coarse comb together with its neighbour on it.
    let suspicious = samples.windows(step + 1).step_by(step).any(|w| w[0] == w[step]);
    if !suspicious {
        return 0;
    }
    let (mut longest, mut run) = (1, 1);
    for pair in samples.windows(2) {
        run = if pair[0] == pair[1] { run + 1 } else { 1 };
        longest = longest.max(run);
    }
    longest
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(n: usize) -> Vec<f64> {
        // Sum of twelve uniform numbers less six: nearly normal, sigma 1.
        let mut state = 1u64;
        let mut uniform = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..n).map(|_| (0..12).map(|_| uniform()).sum::<f64>() - 6.0).collect()
    }

    fn state_of(samples: Vec<f64>) -> InstrumentState {
        let mut window = Window::empty();
        window.samples = samples;
        instrument_state(&window, 10.0)
    }

    #[test]
    fn analytic_clipped_noise_is_overload_and_clean_noise_is_not() {
        assert_eq!(state_of(noise(16_384)), InstrumentState::Ok);
        for limit in [1.0, 2.0, 2.5] {
            let clipped = noise(16_384).into_iter().map(|x| x.clamp(-limit, limit)).collect();
            assert_eq!(state_of(clipped), InstrumentState::Overload, "{limit}");
            let one_sided = noise(16_384).into_iter().map(|x| x.min(limit)).collect();
            assert_eq!(state_of(one_sided), InstrumentState::Overload, "{limit}, one side");
        }
    }

    /// One sample in a thousand lies at the limits of noise that is clipped at 3.29 sigma: about eight at each of them in 16 384 samples.
    #[test]
    fn analytic_one_sample_in_a_thousand_that_is_clipped_is_overload() {
        let all = noise(20 * 16_384);
        let flagged = all.chunks(16_384).filter(|window| {
            let clipped = window.iter().map(|x| x.clamp(-3.2, 3.2)).collect();
            state_of(clipped) == InstrumentState::Overload
        });
        // Sums of twelve uniform numbers have thinner tails than a normal variable: 3.2 of theirs are its 3.29.
        assert!(flagged.count() >= 19);
        assert!(all.chunks(16_384).all(|window| state_of(window.to_vec()) == InstrumentState::Ok));
    }

    /// Twelve sigma from zero is a wrong bias, nine are not; which side does not matter.
    #[test]
    fn analytic_an_offset_beyond_all_that_moves_is_bias() {
        let offset = |by: f64| noise(4096).into_iter().map(|x| x + by).collect();
        for (by, expected) in
            [(12.0, InstrumentState::Bias), (-12.0, InstrumentState::Bias), (9.0, InstrumentState::Ok)]
        {
            assert_eq!(state_of(offset(by)), expected, "{by}");
        }
    }

    /// Quantised sines and noise pile up at their extremes by nature.
    #[test]
    fn analytic_coarse_counts_are_not_overload() {
        for counts in [3.0, 5.0, 30.0, 100.0, 1000.0, 30_000.0] {
            let sine = (0..16_384).map(|i| (counts * (0.0115 * f64::from(i)).sin()).round());
            assert_eq!(state_of(sine.collect()), InstrumentState::Ok, "sine of {counts} counts");
            let rough = noise(16_384).into_iter().map(|x| (counts / 4.0 * x).round()).collect();
            assert_eq!(state_of(rough), InstrumentState::Ok, "noise of {counts} counts");
        }
    }

    #[test]
    fn analytic_flat_stuck_and_not_finite() {
        assert_eq!(state_of(vec![0.25; 4096]), InstrumentState::FlatLine);
        let mut stuck = noise(4096);
        stuck[1000..1600].fill(0.3);
        assert_eq!(state_of(stuck), InstrumentState::FlatLine);
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut samples = noise(4096);
            samples[17] = bad;
            assert_eq!(state_of(samples), InstrumentState::NotFinite);
        }
    }
}
