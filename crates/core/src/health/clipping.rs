//! Samples that pile up at the largest or the smallest value: the end of a converter or of an
//! amplifier.

use pulp::{Arch, Simd, WithSimd};

/// Samples of which the extremes are found at a time.
const CHUNK: usize = 512;

/// Samples at the extreme value from which clipping is looked at.
const PILE: usize = 5;

/// Samples whose smallest distance stands for the step of the converter.
const STEP_SAMPLES: usize = 512;

/// The top level of a sampled sine holds at most so many times what the level below it holds.
const EDGE: f64 = 2.4;

/// Logarithm of the probability from which on chance is out of the question: 10⁻⁹ a window, a few
/// in a year of 64 channels.
const LN_CHANCE: f64 = -20.7;

/// The pile at the extreme by the samples just below it: 2.4 for a sine at most, far less for
/// noise; 7 and more for noise that is clipped at 2.5 sigma.
const PILE_RATIO: usize = 4;

/// The size of the value that samples pile up at; `None` where they do not. Made for windows of up
/// to some ten thousand samples: of a long recording ask piece by piece.
pub fn clipped_at(samples: &[f64]) -> Option<f64> {
    let range = Range::of(samples)?;
    match range.clipped_ends(samples) {
        (true, true) => Some(0.5 * (range.highest.abs() + range.lowest.abs())),
        (_, true) => Some(range.highest.abs()),
        (true, _) => Some(range.lowest.abs()),
        _ => None,
    }
}

/// The smallest and the largest value, and how many samples have them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Range {
    lowest: f64,
    highest: f64,
    at_lowest: usize,
    at_highest: usize,
}

impl Range {
    /// `None` where a value is not finite, or there is none.
    pub(super) fn of(samples: &[f64]) -> Option<Self> {
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
    pub(super) fn is_clipped(&self, samples: &[f64]) -> bool {
        let (low, high) = self.clipped_ends(samples);
        low || high
    }

    /// Whether they do at the smallest, and at the largest.
    fn clipped_ends(&self, samples: &[f64]) -> (bool, bool) {
        let band = 0.01 * (self.highest - self.lowest);
        (piles_up(samples, self.at_lowest, self.lowest, band), piles_up(samples, self.at_highest, self.highest, band))
    }

    /// The mean lies more than `largest` standard deviations from zero.
    pub(super) fn is_far_from_zero(&self, samples: &[f64], largest: f64) -> bool {
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

/// The pile is small, but by chance it cannot be: with `c` samples in the band below the extreme,
/// and steps of the converter `q` wide, a level holds `λ = c q / band` on the mean (up to [`EDGE`]
/// times as much at the edge of a sine), and Chernoff's bound `P(X ≥ k) ≤ exp(k − λ − k ln(k / λ))`
/// says how probable `k` further samples at the extreme are. Signals that repeat exactly pile up at
/// other values too, and where a step is wider than the band, [`is_wall`] has said all there is to
/// say.
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

/// Width of the converter's steps: the smallest distance between values of the first samples.
/// Larger than the true one where these samples have none that are neighbours, never smaller.
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
