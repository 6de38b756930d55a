//! Phases of mesh lines where the angle at which a session began is not known.
//!
//! A session that begins `δ` later, as an angle of the mesh, turns harmonic `h` by `h δ`. Each mesh
//! of each pair of recordings has a `δ` of its own, which is eliminated: of all, the one that
//! leaves least. What is left says how the teeth, shafts and bearings changed.

use std::f64::consts::{PI, TAU};

use super::lines::Line;
use crate::fit::least_squares::losses;

/// Places between turns of the highest harmonic from which a search starts.
const PLACES: usize = 6;
/// Steps of Gauss and Newton from the best of them.
const STEPS: usize = 4;

/// A phase that stands beside others of its mesh and pair.
#[derive(Clone, Copy, Debug)]
struct Turn {
    /// Mesh harmonic.
    harmonic: f64,
    /// (rad).
    rad: f64,
    /// Standard deviation (rad).
    sigma: f64,
}

/// An angle within ± π.
pub fn wrapped(rad: f64) -> f64 {
    (rad + PI).rem_euclid(TAU) - PI
}

/// What is left of phases of one mesh and pair (rad, within ± π) at the beginning that leaves
/// least.
fn aligned(turns: &[Turn]) -> Vec<f64> {
    let highest = turns.iter().map(|t| t.harmonic).fold(0.0, f64::max);
    let left = |delta: f64| turns.iter().map(move |t| wrapped(t.rad - t.harmonic * delta));
    let mut scaled = vec![0.0; turns.len()];
    let mut cost = |delta: f64| -> f64 {
        scaled.iter_mut().zip(left(delta).zip(turns)).for_each(|(scaled, (r, t))| *scaled = r / t.sigma);
        losses(&scaled)
    };
    let places = PLACES * highest.ceil() as usize;
    let at = |k: usize| TAU * k as f64 / places as f64;
    let costs = (0..places).map(|k| (cost(at(k)), at(k)));
    let Some((mut least, mut delta)) = costs.min_by(|a, b| a.0.total_cmp(&b.0)) else { return Vec::new() };
    for _ in 0..STEPS {
        let (mut slope, mut curve) = (0.0, 0.0);
        for (r, t) in left(delta).zip(turns) {
            // The weight of a t distribution, as the fit itself has it.
            let weight = 1.0 / (t.sigma * t.sigma + 0.25 * r * r);
            slope += weight * t.harmonic * r;
            curve += weight * t.harmonic * t.harmonic;
        }
        let next = delta + slope / curve;
        let value = cost(next);
        if value >= least {
            break;
        }
        (least, delta) = (value, next);
    }
    left(delta).collect()
}

/// The same of lines, each group of one `key` by itself; `None` where a line has no phase.
pub fn of_lines<K: PartialEq>(
    lines: &[Line],
    key: &dyn Fn(usize) -> K,
    sigma: &dyn Fn(usize) -> f64,
    phase: &dyn Fn(usize) -> Option<f64>,
) -> Vec<Option<f64>> {
    let mut out = vec![None; lines.len()];
    let mut open: Vec<usize> = (0..lines.len()).collect();
    while let Some(&first) = open.first() {
        let of = key(first);
        let (group, rest): (Vec<usize>, Vec<usize>) = open.into_iter().partition(|&i| key(i) == of);
        open = rest;
        let known: Vec<(usize, f64)> = group.into_iter().filter_map(|i| Some((i, phase(i)?))).collect();
        let turn = |&(i, rad): &(usize, f64)| Turn { harmonic: f64::from(lines[i].harmonic), rad, sigma: sigma(i) };
        let turns: Vec<Turn> = known.iter().map(turn).collect();
        for ((i, _), left) in known.iter().zip(aligned(&turns)) {
            out[*i] = Some(left);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Eight harmonics of a session that began 2.1 rad later: nothing is left, and of a third
    /// harmonic that the machine itself turned by 0.5, that remains but for what the tails leave of
    /// its pull, `w 3·0.5 / Σ w h²` with a weight that its own distance makes small.
    #[test]
    fn analytic_where_a_session_begins_is_no_turn() {
        let turns = |by: f64| -> Vec<Turn> {
            let of =
                |h: f64| Turn { harmonic: h, rad: wrapped(2.1 * h + if h == 3.0 { by } else { 0.0 }), sigma: 0.05 };
            (1..=8).map(|h| of(f64::from(h))).collect()
        };
        assert!(aligned(&turns(0.0)).iter().all(|r| r.abs() < 1e-9));
        let left = aligned(&turns(0.5));
        assert!((left[2] - 0.5).abs() < 0.01, "{left:?}");
        assert!(left.iter().enumerate().all(|(k, r)| k == 2 || r.abs() < 0.01), "{left:?}");
        assert!(aligned(&[]).is_empty());
        assert!((wrapped(3.5) - (3.5 - TAU)).abs() < 1e-12 && (wrapped(-0.5) + 0.5).abs() < 1e-12);
    }
}
