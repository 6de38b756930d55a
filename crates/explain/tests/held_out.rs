//! The model that is written beside an answer, held against recordings that took no part in its
//! fit.

use gearwatch_explain::explain::{Answer, Input, explain};
use gearwatch_explain::prove;
use gearwatch_sim::effects;
use gearwatch_sim::steady::{SteadyOptions, SteadySolver};

/// The answer to the first of some drawn cases that conceals an effect and has it named.
fn named(seed: u64, effect: &str) -> Answer {
    let answers = (0..12).filter_map(|index| {
        let case = prove::case(seed, index, Some(effect))?;
        let (recordings, reference) = (&case.recordings, &case.reference);
        let input = Input { bench: &case.bench, recordings, reference, without: &[] };
        explain(&input, &mut |_| {}).ok()
    });
    let of_it = |a: &Answer| a.explanation.effects.first().is_some_and(|e| e.effect == effect);
    answers.into_iter().find(of_it).unwrap_or_else(|| panic!("{effect} was named in none of twelve cases"))
}

/// A profile error of a bench that differs from its sheet: the model that was fitted without the
/// recordings that are held out leaves less of their change than the same effect on another stage
/// or no effect does, and the bench file that is written holds it: its lines are those of the
/// effects that it names, not those of the sheet.
#[test]
fn conform_the_written_model_predicts_what_was_held_out() {
    for effect in ["tooth_wear", "bearing_compliance"] {
        let answer = named(2_026_112_301, effect);
        let fit = answer.explanation.fit.as_ref().expect("figures of what was held out");
        assert!(!fit.held_out.is_empty());
        assert!(fit.held_out_after < fit.held_out_before, "{effect}: {fit:?}");
        for rival in fit.beside.iter().filter(|b| b.what.starts_with(effect)) {
            assert!(fit.held_out_after < rival.held_out, "{effect}: {fit:?}");
        }
        let written = effects::setup(&answer.bench, &[]).expect("a bench that the simulator takes");
        assert!(answer.bench.effects.iter().any(|e| e.effect == effect));
        let options = SteadyOptions { samples_per_cycle: 128, parting: true, ..SteadyOptions::default() };
        let bench = &answer.bench;
        let mesh = gearwatch_core::train::Train::new(bench).stages[0].mesh_order;
        let solved =
            SteadySolver::new(options).solve(&written, bench.motor.speed_hz, bench.brake.torque_nm, 1, &[mesh]);
        assert!(solved.is_ok_and(|s| s.sensors.iter().all(|l| l[0].norm() > 0.0)));
    }
}
