//! Whole runs.

use std::collections::BTreeMap;

use gearwatch_core::bench::EffectSpec;
use gearwatch_core::one_shot::each_window;
use gearwatch_core::pipeline::{Pipeline, PipelineConfig};
use gearwatch_sim::growth::{Duty, Growing, Growth, GrowthError, LineGroup, Plan, Step, run};
use gearwatch_sim::scenario::Scenario;
use gearwatch_sim::shipped;
use gearwatch_sim::source::{SimConfig, SimError, Simulator};

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
        let depths = |step: &Step| match &step.growing {
            Growing::Wear(wear) => wear.worn_m().concat(),
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
    let first = |growth: &Growth, kind: LineGroup| {
        let of = growth.indicators.iter().zip(&growth.merits).filter(|(indicator, _)| indicator.kind == kind);
        of.filter_map(|(_, merit)| merit.first_hours).fold(f64::INFINITY, f64::min)
    };
    assert!(first(&wear, LineGroup::Mesh) < 1500.0);
    assert!(wear.limit.is_some() && wear.ended.is_none());
    let crack = followed(&plan("root_crack", "stage1.pinion", 600.0, 20_000.0));
    let (_, end) = crack.ended.expect("a broken tooth");
    assert_eq!(crack.limit.as_ref().map(|(at, _)| *at), Some(end));
    assert!(first(&crack, LineGroup::PinionSidebands) < first(&crack, LineGroup::Mesh), "{:?}", crack.merits);
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
    let of = |name: &str, plan: Plan| Plan { bench: shipped::bench(name).unwrap(), ..plan };
    let planets = of("planetary-parallel", plan("tooth_wear", "planetary", 60.0, 1.0));
    assert!(refused(&planets).to_string().contains("not for planets"), "{}", refused(&planets));
    let crack = of("helical-two-stage", plan("root_crack", "fast.pinion", 60.0, 1.0));
    assert!(refused(&crack).to_string().contains("spur teeth alone"), "{}", refused(&crack));
    assert!(matches!(refused(&plan("eccentricity", "stage1.pinion", 60.0, 1.0)), GrowthError::NoLaw(_)));
    assert!(refused(&plan("tooth_wear", "stage1", 60.0, 0.0)).to_string().contains("hours"));
    let mut shares = plan("tooth_wear", "stage1", 60.0, 1.0);
    shares.duties[0].share = 0.5;
    assert!(refused(&shares).to_string().contains("shares"));
    let mut counted = plan("pitting", "stage1.pinion", 60.0, 1.0);
    counted.effect.parameters.insert("teeth".into(), 3.0);
    assert!(refused(&counted).to_string().contains("counted from none"));
}

/// The lines of a step against windows of its recording: the worn bench stepped through time,
/// sampled and judged by the pipeline, deviates from the healthy one as the steady states say.
/// Noise of the sensor and of forty windows: 0.3 percent.
#[test]
fn oracle_a_step_as_the_pipeline_sees_it() {
    let plan = Plan { steps: 2, ..plan("tooth_wear", "stage1", 60.0, 200.0) };
    let growth = followed(&plan);
    let means = |step: &Step| {
        let scenario = Scenario { duration_s: Some(10.0), ..Scenario::default() };
        let config = SimConfig { bench: plan.bench.clone(), effects: Vec::new(), scenario, seed: plan.seed, t0: 0 };
        let mut simulator = Simulator::changed(config, |setup| step.growing.apply(setup)).unwrap();
        let pipeline = Pipeline::new(&plan.bench, &PipelineConfig::default(), None).unwrap();
        let (mut sums, mut count) = ([0.0; 5], 0.0);
        each_window::<_, SimError>(&pipeline, &mut simulator, &mut |_, window| {
            (0..5).for_each(|h| sums[h] += window.stages[0].harmonics[h].amplitude.value);
            count += 1.0;
            Ok(())
        })
        .unwrap();
        sums.map(|sum| sum / count)
    };
    let (healthy, worn) = (means(&growth.steps[0]), means(&growth.steps[2]));
    for (i, indicator) in growth.indicators.iter().enumerate().filter(|(_, i)| i.kind == LineGroup::Mesh) {
        let h = indicator.harmonic as usize - 1;
        let (seen, said) = (100.0 * (worn[h] / healthy[h] - 1.0), growth.deviations_percent(i)[2]);
        assert!(said.abs() > 20.0 && (seen - said).abs() < 0.3, "{}x: {seen} {said}", h + 1);
    }
}
