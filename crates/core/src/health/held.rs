//! Values that are held, or so few that they carry nothing: dead channels, stuck ones, staircases,
//! converters with few codes in use.

use crate::spectral::kernels::kernels;

/// How a signal is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hold {
    /// It hardly ever changes: no line of any machine is in it.
    Dead,
    /// One value fills an eighth of it in a row.
    Stuck,
    /// Every value comes several times in a row: sampled more slowly than stated, or filled up by
    /// repetition.
    Staircase,
}

/// A signal with fewer changes of value than one in so many samples is dead: 32 in a window of 16
/// 384 make 16 periods at most.
const DEAD_SHARE: usize = 512;
/// Share of a window that one and the same value may fill in a row.
const STUCK_SHARE: usize = 8;
/// Runs of equal values from which on a rhythm is looked for: that all of 32 are whole multiples of
/// two by chance has a probability of 2⁻³².
const STAIRS: u32 = 32;
/// Longest run that is counted: steps beyond [`DEAD_SHARE`] are dead, and neighbouring ones may be
/// equal.
const LONGEST_RUN: usize = 4 * DEAD_SHARE;
/// One run in so many may be out of step: a sample that was lost, two neighbours that were equal.
const OUT_OF_STEP: u32 = 20;

/// Values from which on a converter is fine enough. A tone of amplitude `A` steps has 2A + 1 of
/// them, and its line is wrong by up to `(2/π) |J₁(2πA)| ≤ (2/π²)/√A` steps: 3.9 % at seven values,
/// 5 % and more below. The second rank begins at 4 %.
///
/// # Source
/// B. Widrow, I. Kollár, "Quantization Noise" (2008), the describing function of a quantised sine.
const LEAST_VALUES: usize = 7;
/// Samples of a comb over the window by which a value that most samples have is found.
const COMB: usize = 256;

/// How the signal is held, if it is. A window of fewer than two samples says nothing.
pub fn hold(samples: &[f64]) -> Option<Hold> {
    let n = samples.len();
    if n < 2 {
        return None;
    }
    let equal = equal_pairs(&samples[..n - 1], &samples[1..]) as usize;
    let changes = n - 1 - equal;
    if changes * DEAD_SHARE < n {
        return Some(Hold::Dead);
    }
    // The least that a stuck signal shows; a staircase shows half of all samples.
    if equal + 1 < n / STUCK_SHARE {
        return None;
    }
    let mut lengths = [0_u32; LONGEST_RUN + 1];
    let (mut run, mut longest) = (1, 1);
    for pair in samples.windows(2) {
        if pair[0] == pair[1] {
            run += 1;
            continue;
        }
        lengths[run.min(LONGEST_RUN)] += 1;
        longest = longest.max(run);
        run = 1;
    }
    if longest.max(run) >= n / STUCK_SHARE {
        return Some(Hold::Stuck);
    }
    is_staircase(&lengths).then_some(Hold::Staircase)
}

kernels! {
    /// Positions at which two arrays of the same length have the same value.
    fn equal_pairs<'a>(simd; a: &'a [f64], b: &'a [f64]) -> f64 {
        let ((a, a_rest), (b, b_rest)) = (S::as_simd_f64s(a), S::as_simd_f64s(b));
        let ((a, a_odd), (b, b_odd)) = (a.as_chunks::<4>(), b.as_chunks::<4>());
        let (zero, one) = (simd.splat_f64s(0.0), simd.splat_f64s(1.0));
        // Four counts, so that none waits for the addition before.
        let mut counts = [zero; 4];
        for (a, b) in a.iter().zip(b) {
            for lane in 0..4 {
                let equal = simd.equal_f64s(a[lane], b[lane]);
                counts[lane] = simd.add_f64s(counts[lane], simd.select_f64s(equal, one, zero));
            }
        }
        for (a, b) in a_odd.iter().zip(b_odd) {
            let equal = simd.equal_f64s(*a, *b);
            counts[0] = simd.add_f64s(counts[0], simd.select_f64s(equal, one, zero));
        }
        let mut all = 0.0;
        for count in counts {
            all += simd.reduce_sum_f64s(count);
        }
        for (a, b) in a_rest.iter().zip(b_rest) {
            all += f64::from(u8::from(a == b));
        }
        all
    }
}

/// Nearly all runs are whole multiples of the commonest, which is longer than one sample.
fn is_staircase(lengths: &[u32]) -> bool {
    let all: u32 = lengths.iter().sum();
    let Some((step, _)) = lengths.iter().enumerate().rev().max_by_key(|(_, count)| **count) else { return false };
    let in_step: u32 = lengths.iter().step_by(step.max(1)).sum();
    step >= 2 && all >= STAIRS && (all - in_step) * OUT_OF_STEP <= all
}

/// The converter has too few codes in use: fewer than seven values, or one that more than two
/// thirds of the samples have.
///
/// Of a small line in noise of standard deviation σ a converter with steps `q` shows
/// `1 − 2 exp(−2π²σ²/q²)`: 1 % too little, where the first rank begins, at σ = 0.52 q, where two
/// thirds of the samples have the one value.
///
/// # Source
/// B. Widrow, I. Kollár, "Quantization Noise" (2008): the characteristic function at one over the
/// step.
pub fn is_coarse(samples: &[f64]) -> bool {
    has_few_values(samples) || commonest(samples).is_some_and(|value| 3 * count(samples, value) > 2 * samples.len())
}

fn has_few_values(samples: &[f64]) -> bool {
    let mut seen = [0.0; LEAST_VALUES];
    let mut values = 0;
    for &x in samples {
        if seen[..values].contains(&x) {
            continue;
        }
        seen[values] = x;
        values += 1;
        if values == LEAST_VALUES {
            return false;
        }
    }
    true
}

/// The value that more than half of a comb over the samples has, if one has.
///
/// # Source
/// R. S. Boyer, J. S. Moore, "MJRTY – a fast majority vote algorithm" (1991).
fn commonest(samples: &[f64]) -> Option<f64> {
    let comb = || samples.iter().copied().step_by((samples.len() / COMB).max(1));
    let (mut candidate, mut lead) = (f64::NAN, 0_usize);
    for x in comb() {
        if lead == 0 {
            (candidate, lead) = (x, 1);
        } else if x == candidate {
            lead += 1;
        } else {
            lead -= 1;
        }
    }
    (2 * comb().filter(|x| *x == candidate).count() > comb().count()).then_some(candidate)
}

fn count(samples: &[f64], value: f64) -> usize {
    samples.iter().filter(|x| **x == value).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Random;

    fn noise(n: usize, sigma: f64) -> Vec<f64> {
        let mut random = Random(7);
        (0..n).map(|_| sigma * random.normal()).collect()
    }

    /// Every value held for 2, 3, 7, 64 and 333 samples, one sample lost in the middle; and for
    /// 1638, as a driver that repeats its block.
    #[test]
    fn analytic_a_staircase_is_told_by_its_rhythm() {
        let values = noise(16_384, 50.0);
        for step in [2, 3, 7, 64, 333] {
            let mut held: Vec<f64> = (0..16_384).map(|n| values[n / step]).collect();
            assert_eq!(hold(&held), Some(Hold::Staircase), "{step}");
            held.remove(8001);
            assert_eq!(hold(&held), Some(Hold::Staircase), "{step}, one lost");
            // Counts of a few steps, so that neighbours are equal now and then.
            let coarse: Vec<f64> = held.iter().map(|x| (x / 20.0).round()).collect();
            assert_eq!(hold(&coarse), Some(Hold::Staircase), "{step}, coarse");
        }
        let blocks: Vec<f64> = (0..16_384).map(|n| values[n / 1638]).collect();
        assert_eq!(hold(&blocks), Some(Hold::Dead), "10 values in 16 384 samples");
        assert_eq!(hold(&[0.25; 4096]), Some(Hold::Dead));
        let mut stuck = values.clone();
        stuck[9000..9000 + 2048].fill(3.0);
        assert_eq!(hold(&stuck), Some(Hold::Stuck));
        assert_eq!(hold(&values), None);
    }

    /// Counted one by one, for every length about the chunks that are counted at a time; a value
    /// that is not a number equals none.
    #[test]
    fn oracle_equal_neighbours_are_counted() {
        let mut coarse: Vec<f64> = noise(120, 1.0).iter().map(|x| x.round()).collect();
        coarse[60] = f64::NAN;
        coarse[61] = f64::NAN;
        for n in 1..coarse.len() {
            let (a, b) = (&coarse[..n], &coarse[1..=n]);
            let one_by_one = a.iter().zip(b).filter(|(a, b)| a == b).count();
            assert_eq!(equal_pairs(a, b) as usize, one_by_one, "{n}");
        }
    }

    /// Slow sines in few counts stand still for many samples, and in no rhythm.
    #[test]
    fn analytic_a_slow_sine_in_counts_is_not_held() {
        for counts in [3.0, 5.0, 30.0, 1000.0] {
            let sine: Vec<f64> = (0..16_384).map(|n| (counts * (0.0115 * f64::from(n)).sin()).round()).collect();
            assert_eq!(hold(&sine), None, "{counts}");
        }
    }

    /// Noise of 0.3 and 0.45 steps is coarse, of 0.75 steps and more it is not; a tone of 2 steps
    /// is, of 3 it is not.
    #[test]
    fn analytic_few_codes_are_coarse() {
        for (sigma, coarse) in [(0.3, true), (0.45, true), (0.75, false), (2.0, false), (500.0, false)] {
            let counts: Vec<f64> = noise(16_384, sigma).iter().map(|x| x.round()).collect();
            assert_eq!(is_coarse(&counts), coarse, "noise of {sigma} steps");
        }
        for (amplitude, coarse) in [(2.0, true), (3.0, false)] {
            let tone: Vec<f64> = (0..16_384).map(|n| (amplitude * (0.37 * f64::from(n)).sin()).round()).collect();
            assert_eq!(is_coarse(&tone), coarse, "tone of {amplitude} steps");
        }
        // One pulse in a while over a still line: hardly a sample says anything.
        let pulses: Vec<f64> = (0..16_384).map(|n| if n % 50 < 8 { f64::from(n % 977) } else { 0.0 }).collect();
        assert!(is_coarse(&pulses));
    }

    /// The line of a small tone in noise of 0.52 steps is 1 % too small, as the characteristic
    /// function says.
    #[test]
    fn literature_a_small_line_in_coarse_counts_is_too_small() {
        let mut random = Random(3);
        let (amplitude, sigma, turns, count) = (0.05, 0.52, 0.123_f64, 1 << 20);
        let (mut whole, mut coarse) = (0.0, 0.0);
        for n in 0..count {
            let tone = (std::f64::consts::TAU * turns * f64::from(n)).sin();
            let x = amplitude * tone + sigma * random.normal();
            whole += 2.0 * x * tone / f64::from(count);
            coarse += 2.0 * x.round() * tone / f64::from(count);
        }
        let expected = 1.0 - 2.0 * (-2.0 * (std::f64::consts::PI * sigma).powi(2)).exp();
        // What rounding adds is white noise of √(1/12) step: 0.0004 on this many samples, against a
        // line of 0.05; four of them.
        let error = 4.0 * (2.0 / 12.0 / f64::from(count)).sqrt() / amplitude;
        assert!((coarse / whole - expected).abs() < error, "{coarse} of {whole}, {expected} ± {error}");
    }
}
