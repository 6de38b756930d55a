//! Blocks of samples that come twice: a driver that hands over its buffer again.

/// A stretch of samples that is equal, value for value, to an earlier one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Repeat {
    /// Position of the earlier one.
    pub first: usize,
    /// From the earlier to the later one (samples).
    pub lag: usize,
    /// Samples that are equal.
    pub length: usize,
}

/// Shortest stretch that is believed, and the changes of value in it. That 32 noisy values recur by
/// chance in seven codes has a probability of 10⁻¹⁴ a pair.
const LEAST_LENGTH: usize = 64;
const LEAST_CHANGES: usize = 32;
/// Neighbouring values by which a place is known again.
const GRAM: usize = 8;
/// One place in so many is kept, by the value there: the same in both stretches, wherever they lie.
const KEPT_BITS: u32 = 4;
/// Places that are kept at a time.
const PLACES: usize = 2048;
/// Samples beside a stretch that are compared.
const BESIDE: usize = 64;
/// Fewer say nothing.
const LEAST_BESIDE: usize = 16;
/// Samples by which a tone is known.
const TONE_SAMPLES: usize = 512;

/// The first block that comes twice, if there is one.
///
/// A signal without noise recurs too, with its period, and then everywhere: a repeated block ends
/// where the next one begins, and beside it most samples differ. Where the same buffer fills the
/// whole window there is nothing beside it: it is told from a tone in counts, whose samples recur
/// exactly after some periods and nearly after one.
pub fn repeated_block(samples: &[f64]) -> Option<Repeat> {
    let n = samples.len();
    let mut places = [u32::MAX; PLACES];
    let mut at = 0;
    while at + GRAM <= n {
        let kept = scatter(samples[at].to_bits()) >> (64 - KEPT_BITS) == 0;
        let gram = &samples[at..at + GRAM];
        if !kept || gram.iter().all(|x| *x == gram[0]) {
            at += 1;
            continue;
        }
        let hash = gram.iter().fold(0, |hash: u64, x| scatter(hash.rotate_left(7) ^ x.to_bits()));
        let place = &mut places[(hash >> 32) as usize % PLACES];
        let earlier = *place as usize;
        *place = u32::try_from(at).unwrap_or(u32::MAX);
        if earlier >= at || samples[earlier..earlier + GRAM] != *gram {
            at += 1;
            continue;
        }
        let repeat = stretch(samples, earlier, at);
        if is_block(samples, repeat) {
            return Some(repeat);
        }
        // What follows within the stretch says the same.
        at = (repeat.first + repeat.lag + repeat.length).max(at + 1);
    }
    None
}

/// Fibonacci hashing: the upper bits depend on all bits of the value.
fn scatter(bits: u64) -> u64 {
    (bits ^ (bits >> 29)).wrapping_mul(0x9e37_79b9_7f4a_7c15)
}

/// The whole stretch about two equal places.
fn stretch(samples: &[f64], earlier: usize, later: usize) -> Repeat {
    let before = (0..earlier).take_while(|k| samples[earlier - 1 - k] == samples[later - 1 - k]).count();
    let after = samples[earlier..].iter().zip(&samples[later..]).take_while(|(a, b)| a == b).count();
    Repeat { first: earlier - before, lag: later - earlier, length: before + after }
}

fn is_block(samples: &[f64], repeat: Repeat) -> bool {
    let Repeat { first, lag, length } = repeat;
    if length < LEAST_LENGTH || lag < LEAST_LENGTH {
        return false;
    }
    let changes = samples[first..first + length].windows(2).filter(|pair| pair[0] != pair[1]).count();
    if changes < LEAST_CHANGES {
        return false;
    }
    let end = first + length;
    let beside =
        (first.saturating_sub(BESIDE)..first).chain(end..(end + BESIDE).min(samples.len().saturating_sub(lag)));
    let (mut all, mut equal) = (0, 0);
    for k in beside {
        all += 1;
        equal += usize::from(samples[k] == samples[k + lag]);
    }
    if all < LEAST_BESIDE { !is_tone(samples, lag) } else { 2 * equal < all }
}

/// The samples nearly recur sooner than after `lag`: one part in fifty of the power is all that
/// differs.
fn is_tone(samples: &[f64], lag: usize) -> bool {
    let mean = samples[..lag].iter().sum::<f64>() / lag as f64;
    let length = lag.min(TONE_SAMPLES).min(samples.len() - lag);
    let product = |shift: usize| -> f64 {
        let pairs = samples[..length].iter().zip(&samples[shift..]);
        pairs.map(|(a, b)| (a - mean) * (b - mean)).sum()
    };
    let power = product(0);
    // Neighbours are alike in every slow signal: only what comes after the first turn counts.
    let turned = (1..lag).find(|shift| product(*shift) < 0.0).unwrap_or(lag);
    (turned..lag.saturating_sub(turned)).any(|shift| product(shift) > 0.98 * power)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Random;

    fn noise(n: usize) -> Vec<f64> {
        let mut random = Random(11);
        (0..n).map(|_| random.normal()).collect()
    }

    /// A block that is handed over twice, at once or later, as floating-point values and as counts
    /// of a 12-bit converter.
    #[test]
    fn analytic_a_block_that_comes_twice_is_found() {
        for scale in [1.0, 300.0, 3.0] {
            let round = |x: &f64| if scale > 1.0 { (x * scale).round() } else { *x };
            let samples: Vec<f64> = noise(16_384).iter().map(round).collect();
            assert_eq!(repeated_block(&samples), None, "{scale}");
            for (from, length, to) in [(5000, 256, 5256), (2000, 1024, 9000), (300, 4096, 4396)] {
                let mut repeated = samples.clone();
                let block = samples[from..from + length].to_vec();
                repeated[to..to + length].copy_from_slice(&block);
                let found = repeated_block(&repeated).expect("the block");
                assert_eq!(found.lag, to - from, "{scale}");
                // Values beside the block may be equal by chance.
                assert!((length..length + 8).contains(&found.length), "{found:?}");
            }
            let frozen: Vec<f64> = samples.iter().copied().take(1638).cycle().take(16_384).collect();
            assert_eq!(repeated_block(&frozen).map(|r| r.lag), Some(1638));
        }
    }

    /// Tones without noise recur by themselves, in counts and as floating-point values.
    #[test]
    fn analytic_a_signal_that_recurs_is_no_block() {
        for counts in [3.0, 30.0, 1000.0, 30_000.0] {
            let sine: Vec<f64> = (0..16_384).map(|n| (counts * (0.0115 * f64::from(n)).sin()).round()).collect();
            assert_eq!(repeated_block(&sine), None, "{counts}");
        }
        let tone = |n: u32| (std::f64::consts::TAU * f64::from(n) * 1000.0 / 16_000.0).sin() as f32;
        let exact: Vec<f64> = (0..16_000).map(|n| f64::from(tone(n))).collect();
        assert_eq!(repeated_block(&exact), None);
    }

    /// A hundred windows of counts with few codes: chance makes no block.
    #[test]
    fn analytic_few_codes_make_no_block() {
        let samples: Vec<f64> = noise(100 * 16_384).iter().map(|x| (0.75 * x).round()).collect();
        assert!(samples.chunks(16_384).all(|window| repeated_block(window).is_none()));
    }
}
