//! Data before physics: clipping, flat lines, drop-outs.

use gearwatch_core::block::Quality;

/// What the samples themselves say.
#[derive(Clone, Copy, Debug)]
pub struct Integrity {
    /// The level at which samples pile up, where they do.
    pub clipped_at: Option<f64>,
    /// Samples in runs of at least 16 equal values.
    pub frozen: usize,
    /// The source flagged an overload.
    pub overload: bool,
}

/// Samples that must pile up before a signal counts as clipped: a sine at full scale of an
/// unclipped converter shows one or two.
const PILE: usize = 6;
/// At least one sample in so many of the pile begins a run: a signal that is held at a limit stays
/// there for some samples, whereas the highest peak of a quiet train whose teeth meet again and
/// again comes back to the same height, one sample at a time.
const HELD: usize = 50;
/// Widths of the pile (share of the range): a clean limit, and one behind which an amplifier still
/// adds noise.
const WIDTHS: [f64; 2] = [1e-3, 4e-3];
/// How many times as many samples the pile holds as the slice of its width next to it, and as such
/// a slice on average over [`BESIDE`] slices: the turning points of a sine thin out inwards by
/// 2.4 and 4.
const OVER_NEXT: usize = 5;
const OVER_BESIDE: usize = 6;
const BESIDE: usize = 8;
/// Equal samples in a row that count as frozen.
const FROZEN: usize = 16;

/// The end of the range at which samples pile up.
struct End<'a> {
    samples: &'a [f64],
    limit: f64,
    /// From the limit inwards.
    inwards: f64,
    width: f64,
}

impl End<'_> {
    /// Samples between two distances from the limit, in widths.
    fn between(&self, from: f64, to: f64) -> usize {
        let distance = |x: f64| (x - self.limit) * self.inwards / self.width;
        self.samples.iter().filter(|&&x| (from..to).contains(&distance(x))).count()
    }

    /// Runs of two or more samples within the width.
    fn runs(&self) -> usize {
        let inside = |x: f64| (x - self.limit) * self.inwards < self.width;
        let begins = |w: &[f64]| inside(w[1]) && inside(w[2]) && !inside(w[0]);
        self.samples.windows(3).filter(|w| begins(w)).count()
    }

    fn is_heap(&self) -> bool {
        let count = self.between(0.0, 1.0);
        count >= PILE
            && count > OVER_NEXT * (self.between(1.0, 2.0) + 1)
            && count * BESIDE > OVER_BESIDE * self.between(1.0, 1.0 + BESIDE as f64)
            && count <= HELD * self.runs()
    }
}

/// Looks at one gap-free run.
pub fn check(samples: &[f64], quality: Quality) -> Integrity {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for &x in samples {
        low = low.min(x);
        high = high.max(x);
    }
    let clipped = |limit: f64, inwards: f64| {
        WIDTHS.iter().any(|share| End { samples, limit, inwards, width: share * (high - low) }.is_heap())
    };
    let clipped_at = match (clipped(high, -1.0), clipped(low, 1.0)) {
        (true, true) => Some(0.5 * (high.abs() + low.abs())),
        (true, false) => Some(high.abs()),
        (false, true) => Some(low.abs()),
        (false, false) => None,
    };
    Integrity { clipped_at, frozen: frozen(samples), overload: quality.contains(Quality::OVERLOAD) }
}

/// Samples in runs of equal values: a cable that is off, a converter that stands.
pub fn frozen<T: PartialEq>(samples: &[T]) -> usize {
    samples.chunk_by(|a, b| a == b).map(<[T]>::len).filter(|run| *run >= FROZEN).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sine(limit: f64) -> Vec<f64> {
        (0..8192).map(|n| (0.0371 * f64::from(n)).sin().clamp(-limit, limit)).collect()
    }

    /// A period of 128 samples whose one highest peak lasts a sample: 64 equal maxima, and nothing
    /// is clipped. The same held at nine tenths is.
    #[test]
    fn regress_peaks_that_recur_are_not_clipped() {
        let turn = |order: f64, n: i32| (std::f64::consts::TAU * order * f64::from(n) / 128.0).cos();
        let periodic: Vec<f64> = (0..8192).map(|n| turn(20.0, n) + 0.6 * turn(33.0, n) + 0.4 * turn(11.0, n)).collect();
        assert_eq!(check(&periodic, Quality::GOOD).clipped_at, None);
        let held: Vec<f64> = periodic.iter().map(|x| x.clamp(-1.0, 1.0)).collect();
        assert!(check(&held, Quality::GOOD).clipped_at.is_some_and(|level| (level - 1.0).abs() < 1e-9));
    }

    /// Clipped deep, with noise behind the limit; a sine whose samples fall on the same phases in
    /// every period is not.
    #[test]
    fn analytic_noise_behind_the_limit_hides_no_clipping() {
        let mut state = 1u64;
        let mut even = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 33) as f64 / f64::from(u32::MAX >> 1) - 0.5
        };
        let loud: Vec<f64> = (0..24_576).map(|_| ((0..12).map(|_| even()).sum::<f64>()).clamp(-1.0, 1.0)).collect();
        let noisy: Vec<f64> = loud.iter().map(|x| x + 1e-3 * (even() + even())).collect();
        assert!(check(&noisy, Quality::GOOD).clipped_at.is_some_and(|level| (level - 1.0).abs() < 2e-3));
        let coherent: Vec<f64> = (0..8000).map(|n| (std::f64::consts::TAU * f64::from(n) / 100.0).cos()).collect();
        assert_eq!(check(&coherent, Quality::GOOD).clipped_at, None);
    }

    #[test]
    fn analytic_equal_samples_in_a_row_are_frozen() {
        let samples: Vec<f64> = (0..100).map(|n| if n < 40 { 0.25 } else { f64::from(n) }).collect();
        assert_eq!(frozen(&samples), 40);
    }

    /// A sine clipped at 0.7 piles up there; a whole one has its own turning points at the ends, in
    /// which it thins out.
    #[test]
    fn analytic_clipped_sine_piles_up_and_a_whole_one_does_not() {
        let clipped = check(&sine(0.7), Quality::GOOD).clipped_at;
        assert!(clipped.is_some_and(|level| (level - 0.7).abs() < 1e-9), "{clipped:?}");
        assert_eq!(check(&sine(2.0), Quality::GOOD).clipped_at, None);
    }
}
