//! Meshes that are stiffer, softer or damped otherwise, as predictions of what lines do.
//!
//! The teeth are springs of the train: with another stiffness its modes lie elsewhere, and every
//! line changes by what that does at its own frequency, on all sensors. Where meshes make noise the
//! background goes along. With one sensor that is what a changed path does.

use gearwatch_sim::setup::SimSetup;
use rayon::prelude::*;

use super::passing::{self, At, FORMS_ALONG};
use super::{OFF, Support, at, odds_of, with};
use crate::change::frequency::Free;
use crate::fit::refit;
use crate::fit::shape;
use crate::question::Question;

/// An effect, its parameter, and the sizes that are tried, as likely each.
pub(super) type Asked = (&'static str, &'static str, &'static [f64]);

/// What changes the stiffness or the damping of a stage's meshes.
pub(super) const MESHES: [Asked; 4] = [
    ("mesh_stiffness", "factor", &[0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.15, 1.3, 1.6]),
    ("load_dependent_stiffness", "exponent", &[0.1, 0.2, 0.3, 0.4, 0.5]),
    ("misalignment", "angle_mrad", &[0.15, 0.3, 0.5, 0.7, 1.0, 1.4]),
    ("damping", "factor", &[0.25, 0.5, 2.0, 4.0, 8.0]),
];
/// Powers of the mean stiffness that the exciting force goes with, as likely each: the teeth
/// deflect under a force that stays, and their errors are displacements.
const EXCITES: [f64; 2] = [0.0, 1.0];

/// Every such effect of every stage whose meshes have a model.
pub(super) fn meshes(q: &Question<'_>, plain: &SimSetup, free: &Free) -> Vec<Support> {
    let stages = 0..q.bench.stages.len();
    let asked = stages.flat_map(|stage| MESHES.map(|asked| (stage, asked)));
    let asked: Vec<(usize, Asked)> = asked.filter(|(_, (effect, ..))| !q.without.contains(effect)).collect();
    let any = free.log_evidence();
    asked.par_iter().filter_map(|&(stage, asked)| of(q, plain, (free, any), stage, asked)).collect()
}

/// One effect of a stage's meshes; `any` is the log evidence (nats) without it.
fn of(
    q: &Question<'_>,
    plain: &SimSetup,
    (free, any): (&Free, f64),
    stage: usize,
    (effect, parameter, sizes): Asked,
) -> Option<Support> {
    let (place, pairs) = (&q.bench.stages[stage].name, &q.comparison.pairs);
    let lines: Vec<At> = at(free);
    let mut all: Vec<(f64, f64)> = Vec::new();
    for (off, likely) in OFF {
        let usual = with(plain, "mesh_stiffness", place, ("factor", (off * refit::STIFFNESS_TOLERANCE).exp()))?;
        let model = shape::model(&usual, pairs)?;
        let before = passing::passed(&model, &usual, &lines)?;
        for size in sizes {
            let Some(changed) = with(&usual, effect, place, (parameter, *size)) else { continue };
            let Some(other) = shape::model(&changed, pairs) else { continue };
            let Some(after) = passing::passed(&other, &changed, &lines) else { continue };
            let stiffer = |pair: usize| (other.meshes[stage][pair].1 / model.meshes[stage][pair].1).ln();
            let excited = |line: usize| {
                let (pair, own, _) = lines[line];
                if own == stage { stiffer(pair) } else { 0.0 }
            };
            let predicted = |line: usize, form: usize| {
                EXCITES[form / FORMS_ALONG] * excited(line)
                    + passing::change(&before[line], &after[line], 0, form % FORMS_ALONG)
            };
            let evidence = free.log_evidence_of(EXCITES.len() * FORMS_ALONG, &predicted);
            all.push((*size, evidence - any + likely.ln() - (sizes.len() as f64).ln()));
        }
    }
    let (odds, size) = odds_of(&all)?;
    Some(Support { effect, place: place.clone(), odds, size })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::change::frequency::Points;
    use crate::change::locate::Cell;
    use crate::name::supports::of_a_mode;
    use crate::name::supports::tests::{measured, put, still};
    use crate::prove;

    /// The lines of an unchanged bench, with changes put in their place. Those that a misaligned
    /// mesh makes by the linear train are found, with its size, and neither a mode nor the meshes'
    /// damping accounts for them as well; those of a mode that came are no mesh's.
    #[test]
    fn conform_a_misaligned_mesh_is_told_from_a_mode() {
        let case = prove::case(4, 0, None).unwrap();
        let measured = measured(&case);
        let q = measured.question();
        let plain = refit::sheet::setup(q.bench).unwrap();
        let place = &q.bench.stages[0].name;
        let changed = with(&plain, "misalignment", place, ("angle_mrad", 0.7)).unwrap();
        let [before, after] = [&plain, &changed].map(|s| shape::model(s, &q.comparison.pairs).unwrap());
        let mut cells = still(&q);
        let lines: Vec<At> = at(&Free::of_meshes(&cells, &Points::of(&q)).unwrap());
        let forced = [(&before, &plain), (&after, &changed)].map(|(m, s)| passing::passed(m, s, &lines).unwrap());
        put(&mut cells, &lines, &|line| passing::change(&forced[0][line], &forced[1][line], 0, 1));
        let ask = |cells: &[Cell]| {
            let free = Free::of_meshes(cells, &Points::of(&q)).unwrap();
            let mut found = meshes(&q, &plain, &free);
            found.sort_by(|a, b| b.odds.total_cmp(&a.odds));
            (found, of_a_mode(&free))
        };
        let (found, mode) = ask(&cells);
        let best = &found[0];
        assert!((best.effect, &best.place) == ("misalignment", place), "{} {}", best.effect, best.odds);
        assert!(best.odds > mode + 5.0 && (best.size.0 / 0.7).ln().abs() < 0.4, "{} {mode} {:?}", best.odds, best.size);
        let hz = 1.1 * lines[lines.len() / 2].2;
        put(&mut cells, &lines, &|line| {
            let u = lines[line].2 / hz;
            0.5 * (1.0 + (0.8 * u * u / ((1.0 - u * u).powi(2) + (0.04 * u).powi(2)).sqrt()).powi(2)).ln()
        });
        let (found, mode) = ask(&cells);
        assert!(found[0].odds < mode - 5.0, "{} {} {mode}", found[0].effect, found[0].odds);
    }
}
