//! One event a turn in the change of a shaft's comb, told from noise line by line and summed over
//! all lines.
//!
//! Where one tooth at angle `θ` changed, line `n` of the change is `Δ_n = G_n exp(−2πi n θ)`, and
//! `G` (the pulse and the path) is smooth in `n` but for resonances. So products `Δ_{n+l} Δ*_n`
//! have the phase `−2π l θ` over the whole comb and in every channel, and their sum, turned back by
//! the best `θ`, grows with the number of lines while noise grows with its root: lines far below
//! the noise each take part. Each line counts by what its neighbours show (Wiener's weight), so
//! that parts of the comb with nothing in them add no noise.

use num_complex::Complex64;
use std::f64::consts::TAU;

use crate::change::comb::{self, Difference};
use crate::question::Question;
use crate::read::lines::SHAFT_MULTIPLES;

/// Longest distance of two lines that are multiplied. Every second line of a comb may lie under
/// another shaft's; beyond eight lines a path's phase has turned.
const LAGS: usize = 8;
/// Lines on each side whose power says how much a line counts, how many of them must be there, and
/// the most that one of them says (power over noise).
const BESIDE: usize = 5;
const MOST: f64 = 30.0;
/// Power over its expectation from which a line counts no more: one line shall not decide.
const LOUD: f64 = 4.0;
/// Angles of the tooth that are tried in a turn: 16 to the shortest wave.
const ANGLES: usize = 16 * LAGS;
/// Lines that a channel must show.
const LEAST_LINES: usize = 20;

/// What one pulse a turn makes of a change.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pulse {
    /// The sum over its standard deviation in noise alone, mean over pairs times root of their
    /// number.
    pub score: f64,
    /// The sum over what lines of this power would make of one pulse: 1 for one tooth, less where
    /// the change is of another kind.
    pub share: f64,
}

/// Sums of one pair by lag.
#[derive(Default)]
struct Sums {
    products: [Complex64; LAGS],
    variance: f64,
    expected: f64,
}

impl Sums {
    fn add(&mut self, lines: &[Option<(Complex64, f64)>]) {
        let seen = |k: usize| lines[k].map(|(d, noise)| d / noise.max(f64::MIN_POSITIVE).sqrt());
        let power: Vec<Option<f64>> = (0..lines.len()).map(|k| seen(k).map(|u| u.norm_sqr().min(MOST))).collect();
        if power.iter().flatten().count() < LEAST_LINES {
            return;
        }
        // Power of the change over noise as the lines beside have it.
        let around = |k: usize| {
            let beside = (k.saturating_sub(BESIDE)..(k + BESIDE + 1).min(lines.len())).filter(|i| *i != k);
            let (sum, count) =
                beside.filter_map(|i| power[i]).fold((0.0, 0.0), |(sum, count), p| (sum + p, count + 1.0));
            (sum / f64::max(count, 1.0) - 1.0).max(0.0)
        };
        let weighted: Vec<Option<(Complex64, f64)>> = (0..lines.len())
            .map(|k| {
                let u = seen(k)?;
                let over = around(k);
                let weight = over.sqrt() / (over + 1.0);
                let loud = (LOUD * (over + 1.0)).sqrt();
                Some((u * (weight * (loud / u.norm().max(f64::MIN_POSITIVE)).min(1.0)), weight * over.sqrt()))
            })
            .collect();
        for lag in 1..=LAGS.min(lines.len()) {
            for (a, b) in weighted.iter().zip(&weighted[lag..]) {
                if let (Some((a, own)), Some((b, other))) = (a, b) {
                    let product = b * a.conj();
                    self.products[lag - 1] += product;
                    self.variance += 0.5 * product.norm_sqr();
                    self.expected += own * other;
                }
            }
        }
    }

    /// The sum at the best angle of the tooth.
    fn best(&self) -> f64 {
        let at = |angle: usize| {
            let turned = |(l, p): (usize, &Complex64)| {
                (p * Complex64::from_polar(1.0, TAU * ((l + 1) * angle) as f64 / ANGLES as f64)).re
            };
            self.products.iter().enumerate().map(turned).sum::<f64>()
        };
        (0..ANGLES).map(at).fold(0.0, f64::max)
    }
}

/// How far the change of a shaft's comb is one pulse a turn. The first orders take no part: what
/// loosens or drags a shaft makes a row of them with even phases too.
pub fn pulse(changes: &[Difference]) -> Pulse {
    let mut pairs: Vec<usize> = changes.iter().map(|d| d.pair).collect();
    pairs.dedup();
    let (mut score, mut sum, mut expected) = (0.0, 0.0, 0.0);
    for pair in &pairs {
        let mut sums = Sums::default();
        let beyond = |d: &Difference| sums.add(d.lines.get(usize::from(SHAFT_MULTIPLES)..).unwrap_or(&[]));
        changes.iter().filter(|d| d.pair == *pair).for_each(beyond);
        let best = sums.best();
        score += best / sums.variance.max(f64::MIN_POSITIVE).sqrt();
        sum += best;
        expected += sums.expected;
    }
    if expected <= 0.0 {
        return Pulse::default();
    }
    Pulse { score: score / (pairs.len() as f64).sqrt(), share: sum / expected }
}

/// Places beside a comb where pulses are sought: parts of its order, in eighths.
const PLACES: u8 = 7;

/// Largest score of a pulse beside a shaft's comb. A single event gives neighbouring lines phases
/// that advance evenly wherever they are read, and one that comes every few turns gives them so at
/// parts of an order too; what strikes once a turn is on the comb alone.
pub fn largest_beside(q: &Question<'_>, shaft: usize) -> f64 {
    let score = |k: u8| pulse(&comb::beside(q, shaft, f64::from(k) / f64::from(PLACES + 1))).score;
    (1..=PLACES).map(score).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read::dsp::Transforms;
    use crate::read::features::line_at;
    use gearwatch_check::orders::OrderSpectrum;
    use rand::{RngExt, SeedableRng};

    const LINES: usize = 300;

    /// A change of four pairs in noise of power 1: `pattern` gives line `n` its amplitude and
    /// phase, every second line lies under another shaft's.
    fn changes(seed: u64, pattern: &dyn Fn(usize) -> Complex64) -> Vec<Difference> {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut normal = move || {
            let (u, v): (f64, f64) = (random.random(), random.random());
            Complex64::from_polar((-(1.0 - u).ln()).sqrt(), TAU * v)
        };
        let pair = |pair: usize| {
            let line = |n: usize| (pattern(n) + normal(), 1.0);
            let lines = (1..=LINES).map(line).enumerate().map(|(k, l)| (k % 2 == 0).then_some(l)).collect();
            Difference { pair, channel: 0, lines }
        };
        (0..4).map(pair).collect()
    }

    /// A tooth whose every line stands at the noise and is clear nowhere: 148 products a lag of
    /// power 1 in noise of power 1.
    #[test]
    fn analytic_a_pulse_is_found_in_lines_that_are_no_stronger_than_noise() {
        let found = pulse(&changes(1, &|n| Complex64::from_polar(1.0, -TAU * 0.37 * n as f64)));
        assert!(found.score > 20.0 && (0.6..1.5).contains(&found.share), "{found:?}");
    }

    /// Noise alone: four pairs, each the largest of some twenty independent sums, come to about 2
    /// √4 and not beyond the bound of belief.
    #[test]
    fn analytic_noise_holds_no_pulse() {
        let scores: Vec<f64> = (0..40).map(|seed| pulse(&changes(seed, &|_| Complex64::ZERO)).score).collect();
        assert!(scores.iter().all(|s| (1.5..8.0).contains(s)), "{scores:?}");
    }

    /// Errors of all teeth of 31, of strong lines: the phases of the residues have no order.
    #[test]
    fn analytic_errors_of_all_teeth_are_no_pulse() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        for seed in 0..20 {
            let errors: Vec<f64> = (0..31).map(|_| random.random::<f64>() - 0.5).collect();
            let turned = |n: usize, (i, e): (usize, &f64)| Complex64::from_polar(3.0 * e, -TAU * (n * i) as f64 / 31.0);
            let sum = |n: usize| errors.iter().enumerate().map(|t| turned(n, t)).sum::<Complex64>();
            let found = pulse(&changes(seed, &sum));
            assert!(found.share < 0.5, "{found:?}");
        }
    }

    /// A loose shaft or friction makes a row of its first orders with even phases: no tooth.
    #[test]
    fn analytic_a_row_of_first_orders_is_no_pulse() {
        let row = |n: usize| Complex64::from_polar(if n <= 12 { 5.0 } else { 0.0 }, 0.9 * n as f64);
        let found = pulse(&changes(3, &row));
        assert!(found.score < 8.0, "{found:?}");
    }

    /// Pulses at one angle of each turn, of 64 turns in noise: their score on the comb is far above
    /// any beside it. Of pulses every other turn it is not above that halfway between two lines.
    #[test]
    fn analytic_what_strikes_every_other_turn_is_beside_the_comb_too() {
        const TURNS: usize = 64;
        const SAMPLES: usize = 256;
        let scores = |every: usize| -> (f64, f64) {
            let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(11);
            let mut sample = |n: usize| {
                let strikes = n % SAMPLES == 77 && (n / SAMPLES).is_multiple_of(every);
                random.random::<f64>() - 0.5 + if strikes { 6.0 } else { 0.0 }
            };
            let signal: Vec<f64> = (0..TURNS * SAMPLES).map(&mut sample).collect();
            let nothing = vec![false; signal.len() / 2 + 1];
            let spectrum = OrderSpectrum::of(&mut Transforms::default(), &signal, &nothing);
            let score = |k: u8| {
                let shift = f64::from(k) / f64::from(PLACES + 1);
                let line = |n: usize| {
                    let at = (n as f64 + shift) * TURNS as f64;
                    line_at(&spectrum.bins, &spectrum.floor, at).map(|l| (l.amplitude, l.noise))
                };
                pulse(&[Difference { pair: 0, channel: 0, lines: (1..120).map(line).collect() }]).score
            };
            (score(0), (1..=PLACES).map(score).fold(0.0, f64::max))
        };
        let (on, beside) = scores(1);
        assert!(on > 20.0 && on > 3.0 * beside, "{on} {beside}");
        let (on, beside) = scores(2);
        assert!(on > 12.0 && on < 1.2 * beside, "{on} {beside}");
    }
}
