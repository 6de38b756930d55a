//! Whole runs.

use std::collections::BTreeMap;

use gearwatch_core::bench::EffectSpec;
use gearwatch_sim::growth::{Duty, Growth, GrowthError, Kind, Plan, run};
use gearwatch_sim::shipped;

fn plan(effect: &str, place: &str, torque_nm: f64, hours: f64) -> Plan {
    let duty = Duty { motor_hz: 25.0, torque_nm, share: 1.0 };
    Plan {
        bench: shipped::bench("single-pair").unwrap(),
        effect: EffectSpec { effect: effect.into(), place: place.into(), parameters: BTreeMap::new() },
        law: BTreeMap::new(),
        duties: vec![duty],
        measured: duty,
        hours,
        steps: 6,
        limit: None,
        repeatability_percent: 2.0,
        scatter_s: 0.0,
        seed: 3,
    }
}

fn followed(plan: &Plan) -> Growth {
    run(plan, &mut |_| ()).unwrap()
}

/// Whatever grows never shrinks, and begins at its beginning.
#[test]
fn analytic_growth_is_monotone() {
    for (effect, place, torque) in
        [("tooth_wear", "stage1", 60.0), ("root_crack", "stage1.pinion", 600.0), ("pitting", "stage1.wheel", 400.0)]
    {
        let growth = followed(&plan(effect, place, torque, 1500.0));
        let sizes: Vec<f64> = growth.steps.iter().map(|step| step.size).collect();
        assert!(sizes.windows(2).all(|pair| pair[1] >= pair[0]), "{effect}: {sizes:?}");
        assert!(sizes[sizes.len() - 1] > sizes[0], "{effect}: {sizes:?} {:?}", growth.remarks);
        assert!(growth.steps.windows(2).all(|pair| pair[1].hours > pair[0].hours));
        let depths = |step: &gearwatch_sim::growth::Step| match &step.growing {
            gearwatch_sim::growth::Growing::Wear(wear) => wear.worn_m().concat(),
            _ => Vec::new(),
        };
        for pair in growth.steps.windows(2) {
            assert!(depths(&pair[0]).iter().zip(depths(&pair[1])).all(|(before, after)| after >= *before));
        }
    }
}

/// The same seed gives the same numbers to the last bit; another draws other pits.
#[test]
fn analytic_a_seed_gives_the_same_run() {
    let mut plan = Plan { steps: 3, ..plan("pitting", "stage1.pinion", 300.0, 400.0) };
    let values = |plan: &Plan| {
        let growth = followed(plan);
        growth
            .steps
            .iter()
            .flat_map(|step| step.values.iter().chain([&step.size]).map(|x| x.to_bits()))
            .collect::<Vec<_>>()
    };
    let first = values(&plan);
    assert_eq!(first, values(&plan));
    plan.seed = 4;
    assert_ne!(first, values(&plan));
}

/// Worn flanks show in the mesh harmonics, a crack in the sidebands of its shaft first.
#[test]
fn analytic_indicators_show_what_they_are_for() {
    let wear = followed(&plan("tooth_wear", "stage1", 60.0, 1500.0));
    let first = |growth: &Growth, kind: Kind| {
        let of = growth.indicators.iter().zip(&growth.merits).filter(|(indicator, _)| indicator.kind == kind);
        of.filter_map(|(_, merit)| merit.first_hours).fold(f64::INFINITY, f64::min)
    };
    assert!(first(&wear, Kind::Mesh) < 1500.0);
    assert!(wear.limit.is_some() && wear.ended.is_none());
    let crack = followed(&plan("root_crack", "stage1.pinion", 600.0, 20_000.0));
    let (_, end) = crack.ended.expect("a broken tooth");
    assert_eq!(crack.limit.as_ref().map(|(at, _)| *at), Some(end));
    assert!(first(&crack, Kind::PinionSidebands) < first(&crack, Kind::Mesh), "{:?}", crack.merits);
}

/// A crack below the threshold stands still, and the run says by how much.
#[test]
fn conform_a_crack_below_the_threshold_stands_still() {
    let growth = followed(&Plan { steps: 2, ..plan("root_crack", "stage1.pinion", 60.0, 1e4) });
    assert_eq!(growth.steps[0].size, growth.steps[2].size);
    assert!(growth.remarks.iter().any(|remark| remark.contains("stands still")), "{:?}", growth.remarks);
    assert!(growth.merits.iter().all(|merit| merit.first_hours.is_none()));
}

/// Gears and plans that growth does not know are refused with a sentence.
#[test]
fn conform_what_cannot_grow_is_refused() {
    let refused = |plan: &Plan| run(plan, &mut |_| ()).unwrap_err();
    let helical = Plan { bench: shipped::bench("helical-two-stage").unwrap(), ..plan("tooth_wear", "fast", 60.0, 1.0) };
    assert!(refused(&helical).to_string().contains("external spur"), "{}", refused(&helical));
    assert!(matches!(refused(&plan("eccentricity", "stage1.pinion", 60.0, 1.0)), GrowthError::NoLaw(_)));
    assert!(refused(&plan("tooth_wear", "stage1", 60.0, 0.0)).to_string().contains("hours"));
    let mut shares = plan("tooth_wear", "stage1", 60.0, 1.0);
    shares.duties[0].share = 0.5;
    assert!(refused(&shares).to_string().contains("shares"));
    let mut counted = plan("pitting", "stage1.pinion", 60.0, 1.0);
    counted.effect.parameters.insert("teeth".into(), 3.0);
    assert!(refused(&counted).to_string().contains("counted from none"));
}
