//! By which turn of a shaft two recordings differ, and which lines of its comb are its own.

use num_complex::Complex64;
use std::f64::consts::TAU;

use crate::change::locate::REPEAT_SIGMA;
use crate::question::Question;
use crate::read::dsp::{self, MAIN_LOBE_BINS, Transforms};
use crate::read::features::{ChannelFeatures, LineValue, RecordingFeatures};

/// Power over noise from which a line's phase is used.
pub const CLEAR: f64 = 5.0;
/// Nats by which an agreement of phases must lie beyond what the best of all turns comes to by
/// chance: in 1 of 150 recordings. Phases without order agree by `a` at one turn with probability
/// `exp(−lines a²)`, and there are as many independent turns as the highest line has waves.
const NO_CHANCE: f64 = 5.0;
/// Turns that are looked at, and the share of the best agreement that they need. A damaged tooth
/// turns the phases of so many lines that the phases alone may agree best a tooth off.
const TURNS: usize = 8;
const NEARLY: f64 = 0.6;
/// Share of a line's power above which what another line leaks into it spoils its phase.
const LEAKED: f64 = 0.05;

/// Whether lines of the other shafts reach into a line of a shaft's comb.
pub fn crowded(
    q: &Question<'_>,
    recording: &RecordingFeatures,
    channel: &ChannelFeatures,
    shaft: usize,
    n: usize,
) -> bool {
    let order = q.train.shafts[shaft].1 * n as f64;
    let Some(own) = channel.combs[shaft].get(n - 1) else { return true };
    (0..q.train.shafts.len()).filter(|j| *j != shaft).any(|j| reaches(q, (recording, channel), j, order, own))
}

/// Whether a line of a shaft's comb reaches into what is read at an order.
pub fn reaches(
    q: &Question<'_>,
    (recording, channel): (&RecordingFeatures, &ChannelFeatures),
    shaft: usize,
    order: f64,
    own: &LineValue,
) -> bool {
    let of_shaft = q.train.shafts[shaft].1;
    let k = (order / of_shaft).round();
    let distance = (order - k * of_shaft).abs() * recording.revolutions;
    // A line is read from the three bins about it.
    let nearest = (distance - 1.0).max(0.0);
    if k < 1.0 || nearest >= MAIN_LOBE_BINS as f64 {
        return false;
    }
    let leak = dsp::window_response(nearest).norm_sqr() / dsp::window_response(0.0).norm_sqr();
    let other = channel.combs[shaft].get(k as usize - 1).map_or(0.0, |l| l.amplitude.norm_sqr());
    leak * other > LEAKED * own.amplitude.norm_sqr() + own.noise
}

/// A line in recording and reference.
pub struct Twin {
    /// Multiple of the shaft.
    pub n: usize,
    /// In the recording.
    pub now: LineValue,
    /// In the reference.
    pub before: LineValue,
}

impl Twin {
    /// Recording, turned by `ψ` revolutions of the shaft, minus reference, and its noise power.
    pub fn change(&self, psi: f64) -> (Complex64, f64) {
        let before = self.before.amplitude;
        let delta = self.now.amplitude * Complex64::from_polar(1.0, -TAU * self.n as f64 * psi) - before;
        (delta, self.now.noise + self.before.noise + 2.0 * REPEAT_SIGMA.powi(2) * before.norm_sqr())
    }
}

/// Turn `ψ` (revolutions) of the shaft between two recordings, and the agreement of phases there.
///
/// Of the turns at which the phases agree nearly best it is the one that leaves the least change
/// (Cauchy's likelihood: few lines may change much).
pub fn turn(lines: &[&Twin]) -> Option<(f64, f64)> {
    let phases: Vec<(usize, Complex64)> = lines
        .iter()
        .filter(|l| l.now.ratio() > CLEAR && l.before.ratio() > CLEAR)
        .map(|l| (l.n, l.now.amplitude * l.before.amplitude.conj()))
        .map(|(n, product)| (n, product / product.norm()))
        .collect();
    let highest_line = phases.iter().map(|p| p.0).max()?;
    let by_chance = (((highest_line as f64).ln() + NO_CHANCE) / phases.len() as f64).sqrt();
    let agreement = |psi: f64| {
        phases.iter().map(|(n, u)| (u * Complex64::from_polar(1.0, -TAU * *n as f64 * psi)).re).sum::<f64>()
            / phases.len() as f64
    };
    // All turns at once: the agreement over an even grid is a transform of the phases gathered by
    // line.
    let count = 4 * highest_line;
    let mut grid = vec![Complex64::ZERO; count];
    for (n, u) in &phases {
        grid[*n] += u;
    }
    Transforms::default().forward(&mut grid);
    let at = |k: usize| grid[k % count].re;
    let mut peaks: Vec<usize> = (0..count).filter(|k| at(*k) >= at(k + count - 1) && at(*k) > at(k + 1)).collect();
    peaks.sort_by(|a, b| at(*b).total_cmp(&at(*a)));
    let highest = peaks.first().map_or(0.0, |k| at(*k));
    peaks.retain(|k| at(*k) >= NEARLY * highest);
    let step = 0.05 / count as f64;
    let fine = |k: &usize| {
        let middle = *k as f64 / count as f64;
        (-20..=20)
            .map(|i| middle + f64::from(i) * step)
            .map(|psi| (psi, agreement(psi)))
            .max_by(|x, y| x.1.total_cmp(&y.1))
    };
    let left = |psi: f64| {
        let one = |l: &&Twin| {
            let (delta, noise) = l.change(psi);
            (delta.norm_sqr() / noise.max(f64::MIN_POSITIVE)).ln_1p()
        };
        lines.iter().map(one).sum::<f64>()
    };
    peaks
        .iter()
        .take(TURNS)
        .filter_map(fine)
        .filter(|(_, agreement)| *agreement > by_chance)
        .map(|(psi, agreement)| (psi, agreement, left(psi)))
        .min_by(|a, b| a.2.total_cmp(&b.2))
        .map(|(psi, agreement, _)| (psi, agreement))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    const TEETH: usize = 31;

    fn line(amplitude: Complex64) -> LineValue {
        LineValue { amplitude, noise: 1e-4 }
    }

    /// Eight mesh harmonics of teeth with random errors through a path of random phases, the
    /// recording turned by `psi`, one of its teeth off by `damage`.
    fn twins(seed: u64, psi: f64, damage: f64) -> Vec<Twin> {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let errors: Vec<f64> = (0..TEETH).map(|_| random.random::<f64>() - 0.5).collect();
        let of = |n: usize, i: usize| Complex64::from_polar(1.0, -TAU * (n * i) as f64 / TEETH as f64);
        (1..8 * TEETH)
            .map(|n| {
                let path = Complex64::from_polar(1.0, TAU * random.random::<f64>());
                let sum: Complex64 = errors.iter().enumerate().map(|(i, e)| e * of(n, i)).sum();
                let turned = (sum + damage * of(n, 7)) * Complex64::from_polar(1.0, TAU * n as f64 * psi);
                Twin { n, now: line(turned * path), before: line(sum * path) }
            })
            .collect()
    }

    /// The turn is found to a tenth of the shortest wave, without damage and with a tooth that is
    /// off by half as much as all others together (root of 31 times 0.29 is 1.6).
    #[test]
    fn analytic_a_turn_is_found_beside_a_damaged_tooth() {
        for (seed, damage) in (0..12).flat_map(|seed| [0.0, 0.8].map(|d| (seed, d))) {
            let psi = 0.07 * (seed + 1) as f64;
            let all = twins(seed, psi, damage);
            let (found, _) = turn(&all.iter().collect::<Vec<_>>()).unwrap();
            let off = found - psi - (found - psi).round();
            assert!(off.abs() < 0.1 / (8 * TEETH) as f64, "{seed} {damage}: {found} for {psi}");
        }
    }

    /// Recordings of two different gears have no turn.
    #[test]
    fn analytic_other_teeth_have_no_turn() {
        let wrong = |seed: u64| {
            let (a, b) = (twins(seed, 0.0, 0.0), twins(seed + 100, 0.0, 0.0));
            let mixed: Vec<Twin> =
                a.into_iter().zip(b).map(|(a, b)| Twin { n: a.n, now: a.now, before: b.before }).collect();
            turn(&mixed.iter().collect::<Vec<_>>()).is_some()
        };
        assert_eq!((0..20).filter(|s| wrong(*s)).count(), 0);
    }
}
