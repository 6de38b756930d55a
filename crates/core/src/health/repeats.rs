//! Blocks of samples that come twice: a driver that hands over its buffer again.
//!
//! Most of the work is to pick the places that are kept. It is done for a piece of the window at a
//! time, without a branch a sample: one that goes either way in a sixteenth of the samples costs
//! more than all the rest.

use crate::spectral::kernels::kernels;

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
/// Samples among which places are picked at a time; one bit says of each whether it is kept.
const PIECE: usize = 2048;
const WORD: usize = 64;
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
    // The last places have no whole gram.
    let starts = (samples.len() + 1).saturating_sub(GRAM);
    let mut places = [u32::MAX; PLACES];
    let (mut picked, mut hashes) = ([0_u32; PIECE], [0_u32; PIECE]);
    // What follows within a stretch says the same as its beginning.
    let mut from = 0;
    for (piece, values) in samples[..starts].chunks(PIECE).enumerate() {
        let count = pick(values, piece * PIECE, &mut picked);
        hash_grams(samples, &picked[..count], &mut hashes);
        for (at, hash) in picked[..count].iter().map(|at| *at as usize).zip(hashes) {
            let gram = &samples[at..at + GRAM];
            if at < from || gram.iter().all(|x| *x == gram[0]) {
                continue;
            }
            let place = &mut places[hash as usize % PLACES];
            let earlier = *place as usize;
            *place = at as u32;
            if earlier >= at || samples[earlier..earlier + GRAM] != *gram {
                continue;
            }
            let repeat = stretch(samples, earlier, at);
            if is_block(samples, repeat) {
                return Some(repeat);
            }
            from = repeat.first + repeat.lag + repeat.length;
        }
    }
    None
}

/// Puts the places that are kept into `picked`, the first of the piece being place `first`; how
/// many they are.
fn pick(piece: &[f64], first: usize, picked: &mut [u32; PIECE]) -> usize {
    let mut words = [0; PIECE / WORD];
    kept_places(piece, &mut words);
    let mut count = 0;
    for (at, word) in words.iter().enumerate() {
        let mut word = *word;
        while word != 0 {
            picked[count] = (first + at * WORD) as u32 + word.trailing_zeros();
            word &= word - 1;
            count += 1;
        }
    }
    count
}

kernels! {
    /// A bit for each sample whose value is one of those kept.
    fn kept_places<'a>(_simd; samples: &'a [f64], words: &'a mut [u64]) -> () {
        for (values, word) in samples.chunks(WORD).zip(words) {
            let mut kept = [0_u8; WORD];
            for (kept, x) in kept.iter_mut().zip(values) {
                *kept = u8::from(is_kept(*x));
            }
            *word = 0;
            for (at, eight) in kept.as_chunks::<8>().0.iter().enumerate() {
                // Multiplied so, the lowest bits of the eight bytes meet in the upper byte.
                let bits = u64::from_le_bytes(*eight).wrapping_mul(0x0102_0408_1020_4080) >> 56;
                *word |= bits << (8 * at);
            }
        }
    }
}

/// The lower half of the bits of a value with the upper half in them: of values that were floats of
/// 32 bits, or are whole numbers, all that differs is in the upper one.
#[inline(always)]
fn fold(x: f64) -> u64 {
    let bits = x.to_bits();
    (bits ^ (bits >> 29)) & 0xffff_ffff
}

/// A place with this value is kept: the upper bits of Fibonacci's hash, in a form that vectors have
/// an instruction for.
#[inline(always)]
fn is_kept(x: f64) -> bool {
    (fold(x) * 0x9e37_79b9) & (u64::MAX << (32 - KEPT_BITS)) & 0xffff_ffff == 0
}

/// Factors of the hash: digits of the golden ratio, made odd.
const FACTORS: [u32; GRAM] =
    [0x9e37_79b9, 0x7f4a_7c15, 0xf39c_c061, 0x5ced_c835, 0x1082_276b, 0xf3a2_7251, 0xf86c_6a11, 0xd0c1_8e95];

kernels! {
    /// A multilinear hash of the gram at each place, no term of which waits for another (D. Lemire,
    /// O. Kaser, "Strongly universal string hashing is fast", The Computer Journal 57 (2014) 1624).
    fn hash_grams<'a>(_simd; samples: &'a [f64], places: &'a [u32], hashes: &'a mut [u32]) -> () {
        for (at, out) in places.iter().zip(hashes) {
            let Some(gram) = samples[*at as usize..].first_chunk::<GRAM>() else { continue };
            let mut terms = [0_u64; GRAM];
            for k in 0..GRAM {
                terms[k] = fold(gram[k]) * FACTORS[k] as u64;
            }
            let mut sum = 0_u64;
            for term in terms {
                sum = sum.wrapping_add(term);
            }
            *out = (sum >> 32) as u32;
        }
    }
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

    /// Looked at one by one, for every length about the words of a piece, and a whole one. Some one
    /// place in sixteen is kept: of 2048 the number has a standard deviation of 11.
    #[test]
    fn oracle_places_are_picked() {
        let samples = noise(PIECE);
        let mut picked = [0; PIECE];
        for n in (0..=2 * WORD + 1).chain([PIECE - 1, PIECE]) {
            let count = pick(&samples[..n], 4096, &mut picked);
            let one_by_one: Vec<u32> = (0..n).filter(|k| is_kept(samples[*k])).map(|k| 4096 + k as u32).collect();
            assert_eq!(picked[..count], one_by_one, "{n}");
        }
        let kept = pick(&samples, 0, &mut picked);
        assert!(kept.abs_diff(PIECE >> KEPT_BITS) < 44, "{kept}");
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
