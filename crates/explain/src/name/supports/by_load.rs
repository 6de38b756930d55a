//! Changes that are a function of frequency, but another one at every load.
//!
//! Sensor, mounting and housing are linear: a changed path is the same at every load. What the load
//! presses together or drives is not: a bearing in a seat with play, teeth that share the load or
//! stiffen by it, friction of the teeth. Each is a prediction by frequency and load, which is held
//! against functions of frequency of any form that each load has for itself, against laws of lines
//! over load, and against what is the same at every load.

use super::{SAID, Support, bearings, friction, meshes, of_a_mode, seat};
use crate::change::frequency::{BELIEVED, Free, Frequency, Points, log_mean_exp};
use crate::change::locate::Cell;
use crate::finding::Finding;
use crate::fit::refit;
use crate::name::path::{IN_SET, SUREST};
use crate::question::Question;

/// Effects of a load, by what they do at the frequency of each line.
const OF_LOAD: [&str; 4] = [bearings::PLAY, friction::EFFECT, "load_dependent_stiffness", "misalignment"];

/// Whether an effect is one of a load.
pub fn is_of_load(effect: &str) -> bool {
    OF_LOAD.contains(&effect)
}

/// What the load does, where that is likelier than all that is the same at every load; asked where
/// functions of frequency may differ from load to load.
pub fn by_load(q: &Question<'_>, cells: &[Cell], by_frequency: &Frequency, steps: &mut Vec<String>) -> Option<Finding> {
    if !by_frequency.may_go_with_load() {
        return None;
    }
    let (free, beside) = Free::by_load(cells, &Points::of(q))?;
    let plain = refit::sheet::setup(q.bench)?;
    let mut all = bearings::bearings(q, &plain, &free)?;
    for carried in seat::seats(q, &plain, &free) {
        match all.iter_mut().find(|s| (s.effect, &s.place) == (carried.effect, &carried.place)) {
            // The bearing itself, or what the housing carries there.
            Some(own) => own.odds = log_mean_exp(&[own.odds, carried.odds]),
            None => all.push(carried),
        }
    }
    all.extend(meshes::meshes(q, &plain, &free));
    all.extend(friction::friction(q, &plain, &free));
    all.sort_by(|a, b| b.odds.total_cmp(&a.odds));
    let mode = of_a_mode(&free);
    let said: Vec<String> =
        all.iter().take(SAID).map(|s| format!("{} at {} by {:.1}", s.effect, s.place, s.odds)).collect();
    steps.push(format!(
        "functions of frequency that each load has for itself: {:.1} nats over a common one, all together {beside:.1} over orders; beyond them the mesh lines favour a mode of the housing by {mode:.1}, {}",
        by_frequency.by_load,
        said.join(", ")
    ));
    let most = all.iter().map(|s| s.odds).fold(mode.max(0.0), f64::max);
    let share = |odds: f64| (odds - most).exp();
    let sum = share(0.0) + share(mode) + all.iter().map(|s| share(s.odds)).sum::<f64>();
    let of_load: Vec<&Support> = all.iter().filter(|s| is_of_load(s.effect)).collect();
    let (best, others) = of_load.split_first()?;
    let together: f64 = of_load.iter().map(|s| share(s.odds)).sum::<f64>() / sum;
    if together < 0.5 || best.odds + beside.max(0.0) < BELIEVED {
        return None;
    }
    let mut f = Finding::new(best.effect, best.place.clone(), SUREST * share(best.odds) / sum);
    let near = others.iter().filter(|s| share(s.odds) > IN_SET * share(best.odds));
    f.alternatives.extend(near.map(|s| (s.effect, s.place.clone())));
    f.evidence.place = "lines of all sensors".into();
    f.evidence.law = "a function of frequency that differs from load to load, as that of no path does".into();
    f.evidence.shape = format!(
        "what the sheet makes of it agrees with the mesh lines better than functions of any form, by {:.1} nats",
        best.odds
    );
    Some(f)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::change::frequency;
    use crate::fit::shape;
    use crate::name::supports::at;
    use crate::name::supports::passing::{self, At};
    use crate::name::supports::tests::{measured, put, still};
    use crate::prove;

    /// The lines of an unchanged bench with changes put in their place: those that friction of the
    /// teeth makes, with the load, are named; the same at every load are not, nor is a mode.
    #[test]
    fn conform_what_goes_with_the_load_is_told_from_a_path() {
        let case = prove::case(4, 0, None).unwrap();
        let measured = measured(&case);
        let q = measured.question();
        let plain = refit::sheet::setup(q.bench).unwrap();
        let model = shape::model(&plain, &q.comparison.pairs).unwrap();
        let mut cells = still(&q);
        let lines: Vec<At> = at(&Free::of_meshes(&cells, &Points::of(&q)).unwrap());
        let passed = passing::passed(&model, &plain, &lines).unwrap();
        let largest = q.comparison.pairs.iter().map(|p| p.torque_nm).fold(0.0, f64::max);
        let ask = |cells: &[Cell]| {
            let by_frequency = frequency::frequency(cells, Points::of(&q)).unwrap();
            let mut steps = Vec::new();
            (by_load(&q, cells, &by_frequency, &mut steps), by_frequency.by_load, steps)
        };
        let rubs = |line: usize, load: f64| friction::rise(&passed[line], 0.5, 1.8 * load);
        let load = |line: usize| q.comparison.pairs[lines[line].0].torque_nm / largest;
        put(&mut cells, &lines, &|line| rubs(line, load(line)));
        let (found, nats, steps) = ask(&cells);
        let found = found.unwrap_or_else(|| panic!("{nats} {steps:?}"));
        assert!((found.effect, &found.place) == (friction::EFFECT, &q.bench.stages[0].name), "{found:?} {steps:?}");
        put(&mut cells, &lines, &|line| rubs(line, 1.0));
        let (found, nats, steps) = ask(&cells);
        assert!(found.is_none(), "{nats} {steps:?}");
        let hz = 1.1 * lines[lines.len() / 2].2;
        put(&mut cells, &lines, &|line| {
            let u = lines[line].2 / hz;
            0.5 * (1.0 + (0.8 * u * u / ((1.0 - u * u).powi(2) + (0.04 * u).powi(2)).sqrt()).powi(2)).ln()
        });
        let (found, nats, steps) = ask(&cells);
        assert!(found.is_none(), "{nats} {steps:?}");
    }
}
