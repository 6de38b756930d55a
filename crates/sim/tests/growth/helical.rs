//! Helical teeth: the limit without a helix, closed forms over the whole face, and ISO 6336.

use std::f64::consts::PI;

use gearwatch_core::bench::{Bench, EffectSpec, Hand, Helix};
use gearwatch_sim::effects;
use gearwatch_sim::growth::{
    Duty, FaceLoads, FlankPoint, Growing, LineGroup, PLACES, PitGrowth, Plan, Wear, contact_modulus_pa, run,
};
use gearwatch_sim::mesh::StageMesh;
use gearwatch_sim::setup::SimSetup;
use gearwatch_sim::shipped;

use super::laws::{bare, constants};

fn nominal(bench: &Bench) -> SimSetup {
    effects::setup(bench, &[]).unwrap()
}

/// The shipped single pair, its teeth at a helix angle.
fn slanted(angle_deg: f64) -> SimSetup {
    let mut bench = shipped::bench("single-pair").unwrap();
    bench.effects.clear();
    bench.stages[0].gearing.helix = Some(Helix { angle_deg, hands: [Some(Hand::Right), None] });
    assert_eq!(bench.problems(), Vec::<String>::new());
    nominal(&bench)
}

fn helical_box() -> SimSetup {
    let mut bench = shipped::bench("helical-two-stage").unwrap();
    bench.effects.clear();
    nominal(&bench)
}

fn mesh(setup: &SimSetup) -> StageMesh {
    StageMesh::new(&setup.bench, 0, &setup.mesh, &setup.teeth[0], &mut Default::default()).unwrap()
}

/// Places of the path, and the way of the other flank over them by the width of the contact,
/// `|1 − v₂/v₁|`, of the pinion.
fn places(mesh: &StageMesh) -> Vec<(f64, f64)> {
    let pair = mesh.section().geometry();
    let ratio = f64::from(pair.pinion.teeth) / f64::from(pair.wheel.teeth);
    (0..PLACES)
        .map(|i| {
            let cycles = pair.contact_ratio * i as f64 / (PLACES - 1) as f64;
            let [own, other] = pair.rolls_m(cycles);
            (cycles, (1.0 - ratio * other / own).abs())
        })
        .collect()
}

/// Integral over the path (mesh cycles) of values at its places, by trapezoids.
fn over_the_path(mesh: &StageMesh, values: impl Iterator<Item = f64>) -> f64 {
    let values: Vec<f64> = values.collect();
    let ends = 0.5 * (values[0] + values[PLACES - 1]);
    mesh.section().contact_ratio() * (values.iter().sum::<f64>() - ends) / (PLACES - 1) as f64
}

/// Under one load per width the pressure of inclined teeth is that of spur teeth of the same
/// section times √cos β_b, and the contact wider by as much: what Archard's law takes from the
/// flank is `k F' |1 − v₂/v₁|`, whatever the helix.
#[test]
fn analytic_archard_on_inclined_teeth() {
    let setup = helical_box();
    let mesh = mesh(&setup);
    let (section, helix) = (mesh.section(), mesh.face().unwrap().base_helix_rad());
    let width = section.geometry().pinion.face_width_m;
    for (cycles, slides) in places(&mesh).into_iter().step_by(20) {
        let straight = FlankPoint::new(section, cycles, 1000.0, width);
        let inclined = FlankPoint::inclined(section, cycles, 1000.0, width, helix);
        let root = helix.cos().sqrt();
        assert!((inclined.mean_pressure_pa / straight.mean_pressure_pa / root - 1.0).abs() < 1e-12);
        assert!((inclined.half_width_m / straight.half_width_m * root - 1.0).abs() < 1e-12);
        let per_k = inclined.mean_pressure_pa * inclined.sliding_m[0];
        assert!((per_k - 1000.0 / width * slides).abs() < 1e-12 * per_k + 1e-9, "{cycles}: {per_k}");
    }
}

/// All pairs at all places of the face carry the force together: by mesh cycle the path's integral
/// of the loads, as a mean over the face, is the force. Without contact off the path what is left
/// is the trapezoids' and the straight lines' between 200 phases: 0.1 %. A slice is a 25th of a
/// cycle of overlap at most, and no band is left out.
#[test]
fn analytic_loads_of_a_face_carry_the_force() {
    let mut setup = helical_box();
    setup.mesh.corner_contact = false;
    let mesh = mesh(&setup);
    for (force, bands) in [(500.0, 16), (3000.0, 5)] {
        let loads = FaceLoads::new(mesh.section(), mesh.face().unwrap(), force, (bands, PLACES), |_, _| 0.0);
        assert_eq!(loads.bands_n.len(), bands);
        let of = |band: &Vec<f64>| over_the_path(&mesh, band.iter().copied());
        let mean = loads.bands_n.iter().map(of).sum::<f64>() / bands as f64;
        assert!((mean / force - 1.0).abs() < 2e-3, "{force} N: {mean}");
        // ε_α pairs carry as a mean over the cycle.
        let carrying = (0..100).map(|i| loads.pairs_that_carry(f64::from(i) / 100.0)).sum::<f64>() / 100.0;
        assert!((carrying / mesh.section().contact_ratio() - 1.0).abs() < 0.01, "{carrying}");
    }
}

/// Archard over the whole face: each flank's depth along its normal, `worn · cos β_b`, by
/// `k |1 − v₂/v₁|` is the load per width; its integral over the path is `F/b` for each passage, as
/// above. Wear of a thousandth of a micrometre moves no load.
#[test]
fn analytic_wear_of_a_helical_face() {
    let mut setup = helical_box();
    setup.mesh.corner_contact = false;
    let mesh = mesh(&setup);
    let duty = Duty { motor_hz: 25.0, torque_nm: 120.0, share: 1.0 };
    let (k, hours) = (1e-20, 10.0);
    let mut wear = Wear::new(&setup, 0, &constants("tooth_wear", &[("k_m2_per_n", k)])).unwrap();
    wear.advance(&setup.bench, &[duty], hours);
    assert!(wear.size_m() < 1e-9 && wear.bands_m()[0].len() == 16);
    let helix = mesh.face().unwrap().base_helix_rad();
    let passages = duty.passages_per_hour(&setup.bench, 0)[0] * hours;
    let per_width = places(&mesh).into_iter().zip(wear.worn_m()[0].clone()).map(|((_, slides), worn)| {
        // Beside the pitch point both are 0.
        if slides > 0.01 { worn * helix.cos() / (k * slides * passages) } else { f64::NAN }
    });
    let mut per_width: Vec<f64> = per_width.collect();
    for i in 0..PLACES {
        if per_width[i].is_nan() {
            per_width[i] = per_width[i - 1];
        }
    }
    let found = over_the_path(&mesh, per_width.into_iter());
    let closed = duty.mesh_force_n(&setup.bench, 0) / mesh.section().geometry().pinion.face_width_m;
    assert!((found / closed - 1.0).abs() < 3e-3, "{found} {closed}");
}

/// Towards no helix the flanks wear as spur flanks do, over hours in which the load moves. The
/// overlap of 5e-5 cycles moves places of a jump by nothing; where pairs change, straight lines
/// between 200 phases stand in for the load that spur teeth solve for at each place: 1 % of the
/// deepest place.
#[test]
fn analytic_no_helix_wears_as_spur_teeth() {
    let duty = Duty { motor_hz: 25.0, torque_nm: 60.0, share: 1.0 };
    let worn = |setup: &SimSetup| {
        let mut wear = Wear::new(setup, 0, &constants("tooth_wear", &[])).unwrap();
        wear.advance(&setup.bench, &[duty], 100.0);
        wear
    };
    let (spur, slanted) = (worn(&bare()), worn(&slanted(1e-3)));
    assert_eq!((spur.bands_m()[0].len(), slanted.bands_m()[0].len()), (1, 16));
    let deepest = spur.size_m();
    for flank in 0..2 {
        for band in &slanted.bands_m()[flank] {
            for (i, (found, expected)) in band.iter().zip(&spur.worn_m()[flank]).enumerate() {
                assert!((found - expected).abs() < 0.01 * deepest, "{flank}, place {i}: {found:e} {expected:e}");
            }
        }
    }
}

/// And they pit as they do: with the same seed the same sites at the same hours.
#[test]
fn analytic_no_helix_pits_as_spur_teeth() {
    let duty = Duty { motor_hz: 25.0, torque_nm: 400.0, share: 1.0 };
    let pitted = |setup: &SimSetup| {
        let mut pits = PitGrowth::new(setup, (0, false), 0.5e-3, constants("pitting", &[]), 7).unwrap();
        let outlook = pits.outlook(setup, &duty);
        pits.advance(setup, &[duty], 1500.0);
        (outlook, pits.size())
    };
    let (((spur_pa, spur_hours), spur), ((pressure, hours), slanted)) = (pitted(&bare()), pitted(&slanted(1e-3)));
    // √ of the load at the pitch point, to 1e-4; its power 13.2 for the hours.
    assert!((pressure / spur_pa - 1.0).abs() < 1e-4 && (hours / spur_hours - 1.0).abs() < 2e-3);
    assert!(spur.1 > 5 && spur.1 == slanted.1 && spur.2 == slanted.2, "{spur:?} {slanted:?}");
    assert!((slanted.0 / spur.0 - 1.0).abs() < 1e-2, "{spur:?} {slanted:?}");
}

/// Pressure at the pitch point against ISO 6336-2:2019, σ_H0 = Z_H Z_E Z_ε Z_β √(F_t/(d₁ b) (u +
/// 1)/u) with `Z_H = √(2 cos β_b cos α_wt/(cos² α_t sin α_wt))`, `Z_ε = √(1/ε_α)` from an overlap
/// of 1 on and `Z_β = 1/√cos β`. The norm spreads the load evenly over all contact lines. In the
/// middle of the path a slice has one pair in contact, which takes 1.3 of the mean here, since
/// slices do not help each other: up to √1.3 in pressure.
#[test]
fn literature_pressure_of_iso_6336() {
    let setup = helical_box();
    let mesh = mesh(&setup);
    let (pair, helix) = (mesh.section().geometry(), 15_f64.to_radians());
    assert!(mesh.face().unwrap().overlap_ratio() > 1.0);
    let duty = Duty { motor_hz: 25.0, torque_nm: 120.0, share: 1.0 };
    let force = duty.mesh_force_n(&setup.bench, 0);
    let angle = pair.operating_angle_rad;
    let tangential = force * angle.cos();
    let zone = (2.0 * mesh.face().unwrap().base_helix_rad().cos() / (angle.cos() * angle.sin())).sqrt();
    let elasticity = (contact_modulus_pa(mesh.section().material()) / PI).sqrt();
    let ratio = 67.0 / 23.0;
    let nominal =
        tangential / (2.0 * pair.pinion.reference_radius_m * pair.pinion.face_width_m) * (ratio + 1.0) / ratio;
    let norm = zone * elasticity * (1.0 / pair.contact_ratio).sqrt() / helix.cos().sqrt() * nominal.sqrt();
    let pits = PitGrowth::new(&setup, (0, false), 0.5e-3, constants("pitting", &[]), 7).unwrap();
    let (found, _) = pits.outlook(&setup, &duty);
    assert!((1.0..1.15).contains(&(found / norm)), "{found:e} {norm:e}");
}

/// A run of a helical stage: depths of no band fall, the mesh harmonics deviate, and of pits the
/// worst tooth never heals. The other stage, helical too, is left alone.
#[test]
fn analytic_a_helical_run_is_monotone() {
    let runs = [
        ("tooth_wear", "fast", 120.0, ("k_m2_per_n", 1e-17)),
        // Some 900 MPa at the pitch line.
        ("pitting", "slow.wheel", 1200.0, ("endurance_mpa", 600.0)),
    ];
    for (effect, place, torque_nm, (constant, value)) in runs {
        let duty = Duty { motor_hz: 25.0, torque_nm, share: 1.0 };
        let plan = Plan {
            bench: shipped::bench("helical-two-stage").unwrap(),
            effect: EffectSpec { effect: effect.into(), place: place.into(), parameters: [].into() },
            law: [(constant.to_owned(), value)].into(),
            duties: vec![duty],
            measured: duty,
            hours: 600.0,
            steps: 3,
            limit: None,
            repeatability_percent: 2.0,
            scatter_s: 0.0,
            seed: 3,
        };
        let growth = run(&plan, &mut |_| ()).unwrap();
        let sizes: Vec<f64> = growth.steps.iter().map(|step| step.size).collect();
        assert!(sizes.windows(2).all(|pair| pair[1] >= pair[0]) && sizes[3] > sizes[0], "{effect}: {sizes:?}");
        let depths = |k: usize| match &growth.steps[k].growing {
            Growing::Wear(wear) => wear.bands_m().concat().concat(),
            _ => Vec::new(),
        };
        assert!(depths(1).iter().zip(depths(3)).all(|(before, after)| after >= *before));
        let mesh = |i: &usize| growth.indicators[*i].kind == LineGroup::Mesh;
        let moved = (0..growth.indicators.len()).filter(mesh).map(|i| growth.deviations_percent(i)[3].abs());
        assert!(moved.fold(0.0, f64::max) > 1.0, "{effect}");
    }
}
