//! Data before physics: clipping, flat lines, drop-outs.

use gearwatch_core::block::Quality;

/// What the samples themselves say.
#[derive(Clone, Copy, Debug)]
pub struct Integrity {
    /// Largest absolute value.
    pub largest: f64,
    /// Samples at the upper and lower end of the range, exactly or within a thousandth of it.
    pub at_limits: usize,
    /// Runs of two or more equal samples at the limits.
    pub runs_at_limits: usize,
    /// The level at which samples pile up, where they do.
    pub clipped_at: Option<f64>,
    /// Samples in runs of at least 16 equal values.
    pub frozen: usize,
    /// The source flagged an overload.
    pub overload: bool,
}

/// Samples that must pile up before a signal counts as clipped: a sine at full scale of an unclipped converter shows one or two.
const PILE: usize = 6;

/// Looks at one gap-free run.
pub fn check(samples: &[f64], quality: Quality) -> Integrity {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for &x in samples {
        low = low.min(x);
        high = high.max(x);
    }
    let largest = high.abs().max(low.abs());
    let near = 1e-3 * (high - low);
    let pile = |limit: f64| {
        let mut count = 0;
        let mut runs = 0;
        let mut length = 0;
        for &x in samples {
            if (x - limit).abs() <= near {
                count += 1;
                length += 1;
                if length == 2 {
                    runs += 1;
                }
            } else {
                length = 0;
            }
        }
        (count, runs)
    };
    // How many samples lie in the next slice of the same width inwards: an unclipped tail thins out, a clipped one stops at a heap.
    let inside = |limit: f64, sign: f64| {
        samples
            .iter()
            .filter(|&&x| {
                let d = sign * (limit - x);
                d > near && d <= 2.0 * near
            })
            .count()
    };
    let (top, top_runs) = pile(high);
    let (bottom, bottom_runs) = pile(low);
    let heap = |count: usize, next: usize| count >= PILE && count > 5 * (next + 1);
    let clipped_top = heap(top, inside(high, 1.0));
    let clipped_bottom = heap(bottom, inside(low, -1.0));
    let clipped_at = match (clipped_top, clipped_bottom) {
        (true, true) => Some(0.5 * (high.abs() + low.abs())),
        (true, false) => Some(high.abs()),
        (false, true) => Some(low.abs()),
        (false, false) => None,
    };
    let mut frozen = 0;
    let mut length = 1;
    for pair in samples.windows(2) {
        if pair[0] == pair[1] {
            length += 1;
            if length == 16 {
                frozen += 16;
            } else if length > 16 {
                frozen += 1;
            }
        } else {
            length = 1;
        }
    }
    Integrity {
        largest,
        at_limits: top + bottom,
        runs_at_limits: top_runs + bottom_runs,
        clipped_at,
        frozen,
        overload: quality.contains(Quality::OVERLOAD),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sine(limit: f64) -> Vec<f64> {
        (0..8192).map(|n| (0.0371 * f64::from(n)).sin().clamp(-limit, limit)).collect()
    }

    /// A sine clipped at 0.7 piles up there; a whole one has its own turning points at the ends, in which it thins out.
    #[test]
    fn analytic_clipped_sine_piles_up_and_a_whole_one_does_not() {
        let clipped = check(&sine(0.7), Quality::GOOD).clipped_at;
        assert!(clipped.is_some_and(|level| (level - 0.7).abs() < 1e-9), "{clipped:?}");
        assert_eq!(check(&sine(2.0), Quality::GOOD).clipped_at, None);
    }
}
