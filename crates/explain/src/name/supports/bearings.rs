//! Bearings of a shaft that are softer, damped otherwise or loose in their seats, as predictions of
//! what lines do.
//!
//! A load holds a shaft with play in its seat to one side. Along it the bearing is as stiff as
//! ever; across it the shaft rolls in the seat: the force keeps its size and turns with the shaft,
//! and of the stiffness a share `d / (d + g)` is left at a static deflection `d` and a radial gap
//! `g`. So a line changes the more, the less the load is.

use gearwatch_sim::setup::SimSetup;
use rayon::prelude::*;

use super::passing::{self, At, FORMS, Passed};
use super::{OFF, Support, at, odds_of, with};
use crate::change::frequency::{Free, Points};
use crate::change::locate::Cell;
use crate::fit::refit;
use crate::fit::shape::{self, Model};
use crate::question::Question;

/// Effects with their parameter and the sizes that are tried, as likely each.
pub(super) const EFFECTS: [(&str, &str, &[f64]); 3] = [
    ("bearing_compliance", "factor", &[0.15, 0.22, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.15, 1.3, 1.6, 2.0]),
    ("damping", "factor", &[0.1, 0.16, 0.25, 0.4, 0.6, 1.6, 2.5, 4.0, 6.0, 9.0]),
    (PLAY, "gap_um", &[1.0, 2.0, 4.0, 8.0, 15.0, 30.0, 60.0, 120.0]),
];
pub(super) const PLAY: &str = "looseness";
/// Least share of a bearing's stiffness that is left across the load: the least factor that the
/// library has for a bearing.
const LEAST_LEFT: f64 = 0.1;

/// What is asked of one shaft's bearings.
struct Asked<'a> {
    q: &'a Question<'a>,
    model: &'a Model,
    lines: &'a [At],
    shaft: usize,
}

/// Every effect of every shaft's bearings; `None` without a model of the meshes.
pub(super) fn bearings(q: &Question<'_>, plain: &SimSetup, free: &Free) -> Option<Vec<Support>> {
    let model = shape::model(plain, &q.comparison.pairs)?;
    let lines: Vec<At> = at(free);
    let shafts = 0..q.bench.shafts.len();
    let asked: Vec<_> = shafts.flat_map(|shaft| EFFECTS.map(|effect| (shaft, effect))).collect();
    let asked = asked.into_par_iter().filter(|(_, (effect, ..))| !q.without.contains(effect));
    let of = |(shaft, effect)| Asked { q, model: &model, lines: &lines, shaft }.support(plain, free, effect);
    asked.map(of).collect()
}

/// What some lines do by a finding of a shaft's bearings, on average over all its sizes and what
/// the sensors may read, as likely as the changes that are `fitted` make them; `None` of another
/// finding, or without a model of the meshes. The lines are given with their channels.
pub(super) fn foreseen(
    q: &Question<'_>,
    fitted: &[Cell],
    (effect, place): (&str, &str),
    lines: &[(usize, At)],
) -> Option<Vec<f64>> {
    let (free, plain) = (Free::of_meshes(fitted, &Points::of(q))?, refit::sheet::setup(q.bench)?);
    let model = shape::model(&plain, &q.comparison.pairs)?;
    let shaft = q.bench.shafts.iter().position(|s| s.name == place)?;
    let asked = *EFFECTS.iter().find(|e| e.0 == effect)?;
    let known = at(&free);
    let all: Vec<At> = known.iter().copied().chain(lines.iter().map(|l| l.1)).collect();
    let asking = Asked { q, model: &model, lines: &all, shaft };
    let sizes = asking.each_size(&plain, asked)?;
    let evidence = |size: &Size| -> Vec<f64> {
        let predicted = |line: usize, form: usize| asking.change(size, line, form);
        free.by_forms(FORMS, &predicted).into_iter().map(|nats| nats + size.likely).collect()
    };
    let evidence: Vec<Vec<f64>> = sizes.par_iter().map(evidence).collect();
    let most = evidence.iter().flatten().copied().reduce(f64::max)?;
    let sum: f64 = evidence.iter().flatten().map(|nats| (nats - most).exp()).sum();
    let mut out = vec![0.0; lines.len()];
    for (size, evidence) in sizes.iter().zip(&evidence) {
        for (channel, weights) in free.of_channels(FORMS, evidence, most) {
            for (i, _) in lines.iter().enumerate().filter(|(_, line)| line.0 == channel) {
                let of_form = |(form, weight): (usize, &f64)| weight * asking.change(size, known.len() + i, form);
                out[i] += weights.iter().enumerate().map(of_form).sum::<f64>() / sum;
            }
        }
    }
    Some(out)
}

/// A size of an effect.
struct Size {
    size: f64,
    /// Its prior (nats).
    likely: f64,
    /// What is passed on without it, by line, and with it.
    passed: [Vec<Passed>; 2],
}

impl Asked<'_> {
    /// What a line does by a size, in one of the forms.
    fn change(&self, size: &Size, line: usize, form: usize) -> f64 {
        // The pinion is on the shaft before the stage, the wheel on that behind it.
        let gear = usize::from(self.shaft > self.lines[line].1);
        passing::change(&size.passed[0][line], &size.passed[1][line], gear, form)
    }

    /// Every size of an effect, for a bearing that is as the sheet says or off by its tolerance.
    fn each_size(&self, plain: &SimSetup, (effect, parameter, sizes): (&str, &str, &[f64])) -> Option<Vec<Size>> {
        let mut all = Vec::new();
        let place = &self.q.bench.shafts[self.shaft].name;
        for (off, likely) in OFF {
            let usual = with(plain, "bearing_compliance", place, ("factor", (off * refit::STIFFNESS_TOLERANCE).exp()))?;
            let before = passing::passed(self.model, &usual, self.lines)?;
            for size in sizes {
                let after = if effect == PLAY {
                    self.loose(&usual, &before, 1e-6 * size)
                } else {
                    with(&usual, effect, place, (parameter, *size))
                        .and_then(|changed| passing::passed(self.model, &changed, self.lines))
                };
                let Some(after) = after else { continue };
                let likely = likely.ln() - (sizes.len() as f64).ln();
                all.push(Size { size: *size, likely, passed: [before.clone(), after] });
            }
        }
        Some(all)
    }

    fn support(&self, plain: &SimSetup, free: &Free, asked: (&'static str, &str, &[f64])) -> Option<Support> {
        let any = free.log_evidence();
        let odds = |size: &Size| {
            let evidence = free.log_evidence_of(FORMS, &|line, form| self.change(size, line, form));
            (size.size, evidence - any + size.likely)
        };
        let (odds, size) = odds_of(&self.each_size(plain, asked)?.iter().map(odds).collect::<Vec<_>>())?;
        Some(Support { effect: asked.0, place: self.q.bench.shafts[self.shaft].name.clone(), odds, size })
    }

    /// What is passed on where the seat has a radial gap (m): across the load as by a bearing that
    /// is softer, along it as before.
    fn loose(&self, usual: &SimSetup, before: &[Passed], gap_m: f64) -> Option<Vec<Passed>> {
        let shaft = &usual.bench.shafts[self.shaft];
        let mut after = before.to_vec();
        for (stage, pairs) in self.model.meshes.iter().enumerate() {
            // The pinion is on the shaft before the stage, the wheel on that behind it.
            let Some(gear @ (0 | 1)) = self.shaft.checked_sub(stage) else { continue };
            for (pair, (.., force_n)) in pairs.iter().enumerate() {
                let deflection_m = force_n / shaft.bearing_n_per_m;
                let left = left_across(deflection_m, gap_m).max(LEAST_LEFT);
                let softer = with(usual, "bearing_compliance", &shaft.name, ("factor", left))?;
                let own: Vec<usize> =
                    (0..self.lines.len()).filter(|i| self.lines[*i].0 == pair && self.lines[*i].1 == stage).collect();
                let lines: Vec<At> = own.iter().map(|i| self.lines[*i]).collect();
                for (line, passed) in own.into_iter().zip(passing::passed(self.model, &softer, &lines)?) {
                    after[line][gear][1] = passed[gear][1];
                }
            }
        }
        Some(after)
    }
}

/// Share of its stiffness that a bearing has across the load, whose seat has a radial gap (m) and
/// which the load deflects (m).
pub(super) fn left_across(deflection_m: f64, gap_m: f64) -> f64 {
    deflection_m / (deflection_m + gap_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::name::supports::tests::{measured, put, still};
    use crate::name::supports::{of_a_mode, stage_of};
    use crate::prove;

    /// A spring that acts along the radius beyond a gap, held to one side by a load: its force a
    /// little along the load and a little across it, by difference quotients.
    #[test]
    fn analytic_a_loose_seat_is_softer_across_the_load_alone() {
        let (gap, deflection, step) = (12e-6, 5e-6, 1e-9);
        let force = |x: f64, y: f64| {
            let r = x.hypot(y);
            [(r - gap) * x / r, (r - gap) * y / r]
        };
        let rest = gap + deflection;
        let along = (force(rest + step, 0.0)[0] - force(rest - step, 0.0)[0]) / (2.0 * step);
        let across = (force(rest, step)[1] - force(rest, -step)[1]) / (2.0 * step);
        // The quotient across errs by the square of step / rest, 3e-9.
        assert!((along - 1.0).abs() < 1e-8 && (across - left_across(deflection, gap)).abs() < 1e-8);
        assert_eq!(left_across(deflection, 0.0), 1.0);
    }

    /// The lines of an unchanged bench, with what a loose seat or a soft bearing of the output does
    /// to them in their place: the shaft is found and told from its mate, and each from the other
    /// and from a mode.
    #[test]
    fn conform_a_loose_seat_is_told_from_a_soft_bearing() {
        let case = prove::case(4, 0, None).unwrap();
        let measured = measured(&case);
        let q = measured.question();
        let plain = refit::sheet::setup(q.bench).unwrap();
        let model = shape::model(&plain, &q.comparison.pairs).unwrap();
        let mut cells = still(&q);
        let lines = at(&Free::of_meshes(&cells, &Points::of(&q)).unwrap());
        let asked = Asked { q: &q, model: &model, lines: &lines, shaft: 1 };
        let before = passing::passed(&model, &plain, &lines).unwrap();
        let place = &q.bench.shafts[1].name;
        let soft = with(&plain, "bearing_compliance", place, ("factor", 0.5)).unwrap();
        let changed = [
            (PLAY, asked.loose(&plain, &before, 8e-6).unwrap()),
            ("bearing_compliance", passing::passed(&model, &soft, &lines).unwrap()),
        ];
        for (effect, after) in changed {
            // As much across the line of action as along it.
            put(&mut cells, &lines, &|line| passing::change(&before[line], &after[line], 1, 7));
            let free = Free::of_meshes(&cells, &Points::of(&q)).unwrap();
            let mut found = bearings(&q, &plain, &free).unwrap();
            found.sort_by(|a, b| b.odds.total_cmp(&a.odds));
            let said: Vec<String> =
                found.iter().map(|f| format!("{} {} {:.1} {:.2}", f.effect, f.place, f.odds, f.size.0)).collect();
            let best = &found[0];
            assert!(best.effect == effect && best.place == *place, "{effect}: {said:?}");
            assert!(best.odds > found[1].odds + 3.0 && best.odds > of_a_mode(&free) + 3.0, "{effect}: {said:?}");
            // What one pair does is foreseen from the others, but for sizes and shares beside the
            // right ones that do nearly as well: to a third in amplitude.
            let (held, fitted): (Vec<Cell>, Vec<Cell>) = cells.iter().partition(|c| c.pair == 0);
            let asked = |c: &Cell| Some((c.channel, (c.pair, stage_of(c.family?), c.frequency_hz)));
            let asked: Vec<(usize, At)> = held.iter().filter_map(asked).collect();
            let foreseen = foreseen(&q, &fitted, (effect, place), &asked).unwrap();
            let square = |of: &dyn Fn(usize) -> f64| (0..held.len()).map(|i| of(i).powi(2)).sum::<f64>();
            let (left, all) = (square(&|i| held[i].change - foreseen[i]), square(&|i| held[i].change));
            assert!(left < 0.1 * all, "{effect}: {left} of {all}");
            assert!(super::foreseen(&q, &fitted, ("tip_relief", place), &asked).is_none());
        }
    }
}
