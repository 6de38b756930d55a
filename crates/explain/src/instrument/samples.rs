//! What the samples of one channel say by themselves: dead, held, clipped, coarse, repeated.

use std::collections::BTreeMap;

/// Probability by chance below which a pile, a recurrence or a lattice is believed: one in a
/// million channels.
pub const BY_CHANCE: f64 = 1e-6;
/// Share of samples that differ from the one before below which a channel stands still: a converter
/// whose sensor moves changes its code at most samples.
const MOVES: f64 = 0.02;
/// Least run of equal samples that the values of a held converter show on the mean.
const HELD: f64 = 1.9;
/// Samples that recur exactly at least: drivers repeat whole blocks, and 64 samples of 2 bits are
/// 128 bits, beyond chance in any recording.
const BLOCK: usize = 64;
/// Values in use above which steps are too fine to matter: 10 bits.
const LEVELS: usize = 1024;
/// Samples a level holds on the mean before a lattice is told from sparse values.
const PER_LEVEL: usize = 8;
/// Width of the band below an extreme whose levels say how many samples one level holds (share of
/// the range).
const BAND: f64 = 0.02;
/// The outermost level of a sampled sine holds at most so many times what the levels below it hold.
const EDGE: f64 = 2.4;

/// A part of a channel that was written twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Repeat {
    /// First sample of the copy.
    pub start: usize,
    /// Samples of the copy.
    pub len: usize,
    /// How far before it the original lies (samples).
    pub lag: usize,
}

/// One channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Facts {
    /// Standard deviation.
    pub rms: f64,
    /// Different values.
    pub distinct: usize,
    /// Share of samples that differ from the one before.
    pub moving: f64,
    /// Usual distance of neighbouring values in use; `NaN` of one value.
    pub spacing: f64,
    /// The same where the values in use are few and full; else `NaN`.
    pub step: f64,
    /// Level at which samples pile up, and how many lie there.
    pub clipped: Option<(f64, usize)>,
    /// Copies of earlier samples.
    pub repeats: Vec<Repeat>,
}

impl Facts {
    /// Looks at a gap-free run of finite samples.
    pub fn of(samples: &[f64]) -> Self {
        let count = samples.len().max(1) as f64;
        let mean = samples.iter().sum::<f64>() / count;
        let rms = (samples.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / count).sqrt();
        let moving = samples.windows(2).filter(|w| w[0] != w[1]).count() as f64 / (count - 1.0).max(1.0);
        let levels = levels(samples);
        let dead = stands_still(moving, rms);
        let spacing = spacing(&levels);
        let few = levels.len() <= LEVELS && levels.len() * PER_LEVEL <= samples.len();
        Self {
            rms,
            distinct: levels.len(),
            moving,
            spacing,
            step: if few { spacing } else { f64::NAN },
            clipped: if dead { None } else { clipped(samples, &levels) },
            repeats: if dead { Vec::new() } else { repeats(samples) },
        }
    }

    /// It stands still.
    pub fn is_dead(&self) -> bool {
        stands_still(self.moving, self.rms)
    }

    /// Samples for which each value is held, where it is: a slower converter behind a faster clock.
    /// A coarse one stays on its codes too, but its codes are few.
    pub fn held(&self) -> Option<f64> {
        let held = self.moving.recip();
        (!self.is_dead() && held > HELD && self.distinct > LEVELS).then_some(held)
    }

    /// Few values in use, each by many samples.
    pub fn is_coarse(&self) -> bool {
        self.step.is_finite() && !self.is_dead()
    }
}

fn stands_still(moving: f64, rms: f64) -> bool {
    moving < MOVES || rms == 0.0
}

/// The values in use and how many samples have each, ascending.
fn levels(samples: &[f64]) -> Vec<(f64, usize)> {
    let mut sorted = samples.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    sorted.chunk_by(|a, b| a == b).map(|same| (same[0], same.len())).collect()
}

/// The usual distance of neighbouring levels. Levels that the signal passes over make some gaps
/// wider, never narrower.
fn spacing(levels: &[(f64, usize)]) -> f64 {
    let mut gaps: Vec<f64> = levels.windows(2).map(|w| w[1].0 - w[0].0).collect();
    crate::read::dsp::median(&mut gaps)
}

/// A pile at an end of the range that chance does not make: by Chernoff's bound `P(X ≥ k) ≤ exp(k −
/// λ − k ln(k / λ))` for a level that holds `λ` samples on the mean, as the levels beside it do.
fn clipped(samples: &[f64], levels: &[(f64, usize)]) -> Option<(f64, usize)> {
    let (first, last) = (levels.first()?, levels.last()?);
    let band = BAND * (last.0 - first.0);
    let pile = |end: &(f64, usize)| {
        // A level of its own; the last digits of a float do not make another.
        let grain = 1e-6 * (last.0 - first.0);
        let at_end = |l: &&(f64, usize)| (l.0 - end.0).abs() <= grain;
        let count: usize = levels.iter().filter(at_end).map(|l| l.1).sum();
        let beside: Vec<usize> =
            levels.iter().filter(|l| !at_end(l) && (l.0 - end.0).abs() <= band).map(|l| l.1).collect();
        let (Some(most), false) = (beside.iter().max(), beside.is_empty()) else {
            // Nothing beside it: a converter with fewer levels than the band has, or a square wave;
            // no clipping can be told.
            return None;
        };
        let mean = beside.iter().sum::<usize>() as f64 / beside.len() as f64;
        let (k, expected) = ((count - 1) as f64, EDGE * mean);
        let by_chance = if k > expected { (k - expected - k * (k / expected).ln()).exp() } else { 1.0 };
        // What comes back exactly, period by period, piles up at other values as well.
        (by_chance < BY_CHANCE && count > 2 * most && held_there(samples, end.0, grain)).then_some((end.0.abs(), count))
    };
    match (pile(first), pile(last)) {
        (Some(a), Some(b)) => Some((0.5 * (a.0 + b.0), a.1 + b.1)),
        (one, other) => one.or(other),
    }
}

/// A limit holds a signal for more than one sample now and then, or the samples at it are not
/// evenly spaced as the peaks of a periodic signal are.
fn held_there(samples: &[f64], level: f64, grain: f64) -> bool {
    let at: Vec<usize> =
        samples.iter().enumerate().filter(|(_, x)| (**x - level).abs() <= grain).map(|(n, _)| n).collect();
    let mut gaps: Vec<usize> = at.windows(2).map(|w| w[1] - w[0]).collect();
    gaps.sort_unstable();
    gaps.dedup();
    gaps.first() == Some(&1) || gaps.len() > at.len() / 3
}

/// Runs that recur exactly, longest first found; a signal that recurs throughout is periodic, not
/// repeated.
fn repeats(samples: &[f64]) -> Vec<Repeat> {
    if samples.len() < 2 * BLOCK {
        return Vec::new();
    }
    let mut hashed: Vec<(u64, usize)> = hashes(samples).into_iter().enumerate().map(|(n, h)| (h, n)).collect();
    hashed.sort_unstable();
    // Copies by where they begin and how far before the original lies; the nearest original counts.
    let mut at: BTreeMap<usize, usize> = BTreeMap::new();
    for pair in hashed.windows(2) {
        let ((h, a), (g, b)) = (pair[0], pair[1]);
        if h == g
            && samples[a..a + BLOCK] == samples[b..b + BLOCK]
            && samples[a..a + BLOCK].iter().any(|x| *x != samples[a])
        {
            at.insert(b, b - a);
        }
    }
    let mut out: Vec<Repeat> = Vec::new();
    for (start, lag) in at {
        match out.last_mut() {
            Some(last) if last.lag == lag && start < last.start + last.len => last.len = start + BLOCK - last.start,
            Some(last) if start < last.start + last.len => {}
            _ => out.push(Repeat { start, len: BLOCK, lag }),
        }
    }
    let copied: usize = out.iter().map(|r| r.len).sum();
    if 2 * copied > samples.len() { Vec::new() } else { out }
}

/// Rolling hash of each run of [`BLOCK`] samples by their bits (Rabin & Karp 1987, modulo 2⁶⁴ after
/// mixing each sample).
fn hashes(samples: &[f64]) -> Vec<u64> {
    const BASE: u64 = 0x9e37_79b9_7f4a_7c15;
    let mixed: Vec<u64> = samples
        .iter()
        .map(|x| {
            let b = (x + 0.0).to_bits();
            (b ^ (b >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) ^ (b >> 32)
        })
        .collect();
    let top = (0..BLOCK - 1).fold(1u64, |p, _| p.wrapping_mul(BASE));
    let mut hash = mixed[..BLOCK].iter().fold(0u64, |h, m| h.wrapping_mul(BASE).wrapping_add(*m));
    let mut out = vec![hash];
    for n in BLOCK..samples.len() {
        hash = hash.wrapping_sub(mixed[n - BLOCK].wrapping_mul(top)).wrapping_mul(BASE).wrapping_add(mixed[n]);
        out.push(hash);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(n: usize, seed: u64) -> Vec<f64> {
        let mut state = seed;
        let mut even = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..n).map(|_| (0..12).map(|_| even()).sum::<f64>() - 6.0).collect()
    }

    /// A new value every 1638 samples is no vibration, and neither is a constant; noise is.
    #[test]
    fn regress_a_held_value_is_dead() {
        let held: Vec<f64> = noise(16_384, 1).iter().step_by(1638).flat_map(|x| [*x; 1638]).collect();
        assert!(Facts::of(&held).is_dead() && Facts::of(&[0.25; 4096]).is_dead());
        assert!(!Facts::of(&noise(16_384, 1)).is_dead());
    }

    /// 110 samples of noise at each of two limits far inside any full scale pile up there; the same
    /// noise unclipped, coarse or not, does not.
    #[test]
    fn regress_a_few_hundred_samples_at_a_limit_are_clipping() {
        let x = noise(45_000, 2);
        let clip = |limit: f64| x.iter().map(|x| x.clamp(-limit, limit)).collect::<Vec<f64>>();
        let (level, count) = Facts::of(&clip(2.82)).clipped.unwrap();
        assert!((level - 2.82).abs() < 1e-9 && (100..400).contains(&count), "{level} {count}");
        assert_eq!(Facts::of(&x).clipped, None);
        for step in [0.001, 0.01, 0.1] {
            let coarse: Vec<f64> = x.iter().map(|x| (x / step).round() * step).collect();
            assert_eq!(Facts::of(&coarse).clipped, None, "{step}");
        }
    }

    /// Of 2000 runs of noise none piles up, recurs or is dead.
    #[test]
    fn analytic_noise_is_none_of_these() {
        for seed in 0..200 {
            let facts = Facts::of(&noise(8192, seed));
            assert!(
                facts.clipped.is_none() && facts.repeats.is_empty() && !facts.is_coarse() && facts.held().is_none()
            );
        }
    }

    /// Six bits over the range are coarse, and the step is that of the converter.
    #[test]
    fn regress_few_codes_are_coarse() {
        let x: Vec<f64> = noise(20_000, 3).iter().map(|x| (x / 0.125).round() * 0.125).collect();
        let facts = Facts::of(&x);
        assert!(facts.is_coarse() && (facts.step - 0.125).abs() < 1e-9, "{facts:?}");
    }

    /// A block that is written twice is found with its length and place, also where it overwrote
    /// what came; a sine is periodic.
    #[test]
    fn regress_a_block_written_twice_is_found() {
        let mut x = noise(20_000, 4);
        let block = x[8000..8512].to_vec();
        x.splice(8512..8512, block);
        assert_eq!(Facts::of(&x).repeats, [Repeat { start: 8512, len: 512, lag: 512 }]);
        let periodic: Vec<f64> =
            (0..20_000).map(|n| (std::f64::consts::TAU * f64::from(n % 100) / 100.0).cos()).collect();
        assert!(Facts::of(&periodic).repeats.is_empty());
    }

    /// Each value four times: the converter is slower than the clock of the file.
    #[test]
    fn regress_a_staircase_is_held() {
        let x: Vec<f64> = noise(5000, 5).iter().flat_map(|x| [*x; 4]).collect();
        let held = Facts::of(&x).held().unwrap();
        assert!((held - 4.0).abs() < 0.1, "{held}");
    }
}
