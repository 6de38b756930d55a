//! Twins of a case: the same changes dealt to other lines, sent through the same table.
//!
//! Where nothing changed, what a line changes by is repetition and noise, whichever class it belongs to: dealing the changes anew, each in units of its own standard deviation, gives another comparison of an
//! unchanged bench. The share of twins in which any hypothesis gains as much as in the case itself is a p value that no generator had a part in (a permutation test: Good 2005).
//! A change of all lines alike has no class of its own; such twins do not see it.

use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use super::calibration::Calibration;
use super::changes::{Change, Class, Tables, weight_and_variance};
use super::table::{Hypothesis, Moves};

/// Twins.
const TWINS: usize = 39;
/// Sizes that are tried (ln of the largest change).
const SIZES: [f64; 7] = [0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2];

/// Share of twins, the case itself included, in which any hypothesis gains as much.
pub fn p_null(all: &[Change], tables: &Tables, hypotheses: &[Hypothesis], c: &Calibration) -> f64 {
    let mut spreads: Vec<Vec<f64>> = Vec::new();
    for h in hypotheses {
        if let Moves::Machine { spread, .. } = &h.moves
            && !spreads.contains(spread)
        {
            spreads.push(spread.clone());
        }
    }
    let channels = all.iter().map(|x| x.channel + 1).max().unwrap_or(0);
    for channel in 0..channels {
        let own = |class: &Class| match class {
            Class::Lines(_, k) | Class::Bands(k) => f64::from(u8::from(*k == channel)),
        };
        spreads.push(tables.classes.iter().map(own).collect());
    }
    // The repetition that suits no change best; the scale at which changes are dealt.
    let none = vec![0.0; tables.classes.len()];
    let of = |r: usize| tables.log_likelihood(r, 0.0, &none, false);
    let usual = (0..c.repetition.len()).max_by(|a, b| of(*a).total_cmp(&of(*b))).map_or(0.0, |r| c.repetition[r]);
    let found = gain(&Tables::at_repetition(all, usual, c), &spreads);
    let sigma = |x: &Change| weight_and_variance(x, usual, c).1.sqrt();
    let mut random = ChaCha8Rng::seed_from_u64(0x7477_696e);
    let (lines, bands): (Vec<usize>, Vec<usize>) = (0..all.len()).partition(|&i| all[i].family.is_some());
    let above = (0..TWINS)
        .filter(|_| {
            let mut twin = all.to_vec();
            for members in [&lines, &bands] {
                let mut dealt = members.clone();
                dealt.shuffle(&mut random);
                for (&to, &from) in members.iter().zip(&dealt) {
                    twin[to].change = all[from].change / sigma(&all[from]) * sigma(&all[to]);
                }
            }
            gain(&Tables::at_repetition(&twin, usual, c), &spreads) >= found
        })
        .count();
    (1 + above) as f64 / (1 + TWINS) as f64
}

/// Largest gain of any spread over no change.
fn gain(tables: &Tables, spreads: &[Vec<f64>]) -> f64 {
    let nothing = tables.log_likelihood(0, 0.0, &vec![0.0; tables.classes.len()], false);
    let best = |spread: &Vec<f64>| {
        SIZES.iter().map(|s| tables.log_likelihood(0, *s, spread, false)).fold(f64::NEG_INFINITY, f64::max)
    };
    spreads.iter().map(best).fold(f64::NEG_INFINITY, f64::max) - nothing
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read::lines::Family;
    use crate::score::calibration::CALIBRATION;
    use rand::RngExt;

    /// Sixty mesh lines and sixty sidebands; the mesh lines change by so much more than all repeat.
    fn changes(seed: u64, moved: f64) -> Vec<Change> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        (0..120u16)
            .map(|i| {
                let mesh = i % 2 == 0;
                let family = match mesh {
                    true => Family::Mesh { stage: 0, harmonic: 1 },
                    false => Family::Side { stage: 0, harmonic: 1, shaft: 0, offset: 1 },
                };
                let (u, v): (f64, f64) = (random.random(), random.random());
                let normal = (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos();
                let change = normal * if mesh { 0.05 + moved } else { 0.05 };
                Change {
                    pair: 0,
                    channel: 0,
                    family: Some(family),
                    frequency_hz: 100.0,
                    change,
                    noise: 1e-4,
                    extra: 0.0,
                    weight: 0.3,
                }
            })
            .collect()
    }

    fn p(all: &[Change]) -> f64 {
        let tables = Tables::new(all, &CALIBRATION);
        let mesh = Hypothesis {
            effect: "mesh_stiffness",
            place: "stage1".into(),
            order: None,
            moves: Moves::Machine { spread: vec![1.0, 0.02], rises: false },
            prior: 0.0,
        };
        p_null(all, &tables, &[mesh], &CALIBRATION)
    }

    /// Without any change p is even: of forty cases none of 1/40 is expected once, below 0.25 ten, in the middle 0.5; binomial bounds of three standard
    /// deviations. With one it is the least that 39 twins can give.
    #[test]
    fn analytic_p_is_even_without_a_change_and_least_with_one() {
        let mut all: Vec<f64> = (0..40).map(|seed| p(&changes(seed, 0.0))).collect();
        all.sort_by(f64::total_cmp);
        assert!((2..=18).contains(&all.iter().filter(|p| **p < 0.25).count()), "{all:?}");
        assert!((0.25..0.8).contains(&all[20]), "{all:?}");
        assert_eq!(p(&changes(1, 0.4)), 1.0 / 40.0);
    }
}
