//! The laws by themselves.

use std::collections::BTreeMap;

use gearwatch_sim::effects;
use gearwatch_sim::growth::{
    Constants, Duty, FlankPoint, GROWING, PLACES, PitGrowth, RootSection, Wear, bending_factor, contact_modulus_pa,
    grown, tension_factor,
};
use gearwatch_sim::mesh::MeshModel;
use gearwatch_sim::setup::SimSetup;
use gearwatch_sim::shipped;

pub(crate) fn bare() -> SimSetup {
    let mut bench = shipped::bench("single-pair").unwrap();
    bench.effects.clear();
    effects::setup(&bench, &[]).unwrap()
}

pub(crate) fn constants(effect: &str, given: &[(&str, f64)]) -> Constants {
    let table = GROWING.iter().find(|(id, _)| *id == effect).unwrap().1;
    Constants::new(table, &given.iter().map(|&(name, value)| (name.to_owned(), value)).collect()).unwrap()
}

/// A constant pressure p over a contact of constant width, N passages: the depth is `k p s N`, in
/// the first step and in the sum of many. The width cancels in `p̄ · 2a`, so that a place under a
/// load per width F' loses `k F' |1 − v₂/v₁|` in one passage whatever its curvature.
#[test]
fn analytic_archard_at_constant_pressure() {
    let setup = bare();
    let mesh = MeshModel::new(&setup.bench, 0, &setup.mesh, &setup.teeth[0]).unwrap();
    let pair = mesh.geometry();
    let (k, per_width, passages) = (3e-17, 4e4, 1e6);
    for cycles in [0.05, 0.4, pair.pitch_phase(), 1.1, 1.5] {
        let point = FlankPoint::new(&mesh, cycles, per_width * pair.pinion.face_width_m, pair.pinion.face_width_m);
        let [own, other] = pair.rolls_m(cycles);
        // v₂/v₁ = ω₂ ξ₂/(ω₁ ξ₁).
        let ratio = other / own * f64::from(pair.pinion.teeth) / f64::from(pair.wheel.teeth);
        let depth = k * point.mean_pressure_pa * point.sliding_m[0] * passages;
        let closed = k * per_width * (1.0 - ratio).abs() * passages;
        assert!((depth - closed).abs() < 1e-12 * closed + 1e-20, "{cycles}: {depth:e} {closed:e}");
        // The wheel slides the other way over the pinion: the same speed, seen from the slower or
        // faster flank.
        let back = k * per_width * (1.0 - 1.0 / ratio).abs() * passages;
        let wheel = k * point.mean_pressure_pa * point.sliding_m[1] * passages;
        assert!((wheel - back).abs() < 1e-12 * back + 1e-20);
        assert!((point.mean_pressure_pa * 2.0 * point.half_width_m / per_width - 1.0).abs() < 1e-12);
    }
}

/// Where one pair carries all of the load the worn depth over hours is that closed form with all of
/// the force, at both flanks, whatever happens where two pairs share.
#[test]
fn analytic_wear_of_the_single_zone_over_hours() {
    let setup = bare();
    let mesh = MeshModel::new(&setup.bench, 0, &setup.mesh, &setup.teeth[0]).unwrap();
    let pair = mesh.geometry();
    let duty = Duty { motor_hz: 25.0, torque_nm: 60.0, share: 1.0 };
    let mut wear = Wear::new(&setup, 0, &constants("tooth_wear", &[("k_m2_per_n", 2e-18)])).unwrap();
    wear.advance(&setup.bench, &[duty], 100.0);
    // Well within the zone of single contact, ε − 1 to 1: corner contact narrows it by some
    // hundredths.
    let at = |cycles: f64| (cycles / pair.contact_ratio * (PLACES - 1) as f64).round() as usize;
    let force = duty.mesh_force_n(&setup.bench, 0);
    assert!((force - 60.0 / mesh.base_radii_m()[1]).abs() < 1e-9);
    for place in at(pair.contact_ratio - 1.0 + 0.1)..=at(0.9) {
        let cycles = pair.contact_ratio * place as f64 / (PLACES - 1) as f64;
        let [own, other] = pair.rolls_m(cycles);
        let ratio = other / own * 23.0 / 57.0;
        let per_width = force / pair.pinion.face_width_m;
        for (flank, revolutions, slid) in [(0, 25.0, 1.0 - ratio), (1, 25.0 * 23.0 / 57.0, 1.0 - 1.0 / ratio)] {
            let closed = 2e-18 * per_width * f64::abs(slid) * revolutions * 3600.0 * 100.0;
            let found = wear.worn_m()[flank][place];
            assert!((found - closed).abs() < 1e-9 * closed + 1e-18, "{cycles}: {found:e} {closed:e}");
        }
    }
}

/// Only k times the hours counts; a schedule of two equal duties is one duty.
#[test]
fn analytic_wear_goes_by_k_and_hours_together() {
    let setup = bare();
    let duty = Duty { motor_hz: 25.0, torque_nm: 60.0, share: 1.0 };
    let halves = [Duty { share: 0.5, ..duty }, Duty { share: 0.5, ..duty }];
    let worn = |k: f64, hours: f64, duties: &[Duty]| {
        let mut wear = Wear::new(&setup, 0, &constants("tooth_wear", &[("k_m2_per_n", k)])).unwrap();
        wear.advance(&setup.bench, duties, hours);
        wear.size_m()
    };
    let once = worn(1e-17, 300.0, &[duty]);
    assert!((worn(3e-17, 100.0, &[duty]) / once - 1.0).abs() < 1e-9);
    assert!((worn(1e-17, 300.0, &halves) / once - 1.0).abs() < 1e-12);
}

/// Paris' law with a constant factor, `ΔK = Y σ √(π a)`, against its integral
/// `N = (a₀^(1−m/2) − a^(1−m/2)) / (C (Y σ √π)^m (m/2 − 1))` for m on both sides of 2.
#[test]
fn oracle_paris_integral_for_any_m_but_2() {
    let (c, stress) = (6.9e-12, 1.12 * 300.0);
    for m in [1.6, 2.5, 3.0, 4.16] {
        let rate = |a: f64| c * (stress * (std::f64::consts::PI * a).sqrt()).powf(m);
        let power = 1.0 - 0.5 * m;
        let closed = |from: f64, to: f64| {
            (from.powf(power) - to.powf(power)) / (c * (stress * std::f64::consts::PI.sqrt()).powf(m) * (0.5 * m - 1.0))
        };
        let (from, to) = (0.5e-3, 3.2e-3);
        let (found, left) = grown(from, closed(from, to), 1.0, rate);
        assert_eq!(left, 0.0);
        assert!((found / to - 1.0).abs() < 1e-8, "m = {m}: {found:e}");
        // A border stops it, and what is left of the cycles is what the rest would have taken.
        let (found, left) = grown(from, closed(from, to), 2e-3, rate);
        assert_eq!(found, 2e-3);
        assert!((left / closed(2e-3, to) - 1.0).abs() < 1e-6, "m = {m}: {left:e}");
    }
}

/// Factors of an edge crack: both 1.12 of a short one, 1.12 to 10 % up to 0.4 of the width in
/// bending (Dowling, Mechanical Behavior of Materials, figure 8.13), and the polynomials of Brown &
/// Srawley 1966 that Tada, Paris & Irwin give beside the closed forms: 2.2 % at most between the
/// two.
#[test]
fn literature_factors_of_an_edge_crack() {
    assert!((bending_factor(0.0) - 1.122).abs() < 1e-12 && (tension_factor(0.0) - 1.122).abs() < 1e-12);
    for alpha in [0.1_f64, 0.2, 0.3, 0.4, 0.5] {
        let bending = 1.122 - 1.40 * alpha + 7.33 * alpha * alpha - 13.08 * alpha.powi(3) + 14.0 * alpha.powi(4);
        assert!((bending_factor(alpha) / bending - 1.0).abs() < 0.025, "{alpha}: {} {bending}", bending_factor(alpha));
        let tension = 1.122 - 0.231 * alpha + 10.55 * alpha * alpha - 21.71 * alpha.powi(3) + 30.382 * alpha.powi(4);
        assert!((tension_factor(alpha) / tension - 1.0).abs() < 0.02, "{alpha}: {} {tension}", tension_factor(alpha));
        assert!(alpha > 0.4 || (bending_factor(alpha) / 1.12 - 1.0).abs() < 0.13);
    }
}

/// Nominal bending at the root of a tooth that is loaded at its tip, against Lewis' form factor:
/// `σ = F_t/(b m Y)`, Y = 0.3335 for 23 teeth of 20° (Shigley, table 14-2, between 22 and 24).
/// Lewis' factor has the same parabola, with fillets as they were drawn: a tenth is allowed.
#[test]
fn literature_root_stress_against_lewis() {
    let setup = bare();
    let mesh = MeshModel::new(&setup.bench, 0, &setup.mesh, &setup.teeth[0]).unwrap();
    let gear = &mesh.geometry().pinion;
    let force = 1000.0;
    let [bending, compression] =
        RootSection::new(gear).stresses_pa(gear, gear.roll_at_radius_m(gear.tip_radius_m), force);
    let lewis = force * gear.pressure_angle_rad.cos() / (gear.face_width_m * gear.module_m * 0.3335);
    assert!((bending / lewis - 1.0).abs() < 0.1, "{bending:e} {lewis:e}");
    assert!(compression > 0.0 && compression < 0.2 * bending);
}

/// Pressure at the pitch point of two steel gears by hand: `p₀ = √(F' E*/(π R))`, and Z_E = 189.8
/// √MPa of ISO 6336-2 for steel on steel is `√(E*/π)` with its E and ν.
#[test]
fn literature_elasticity_factor_of_iso_6336() {
    let steel = gearwatch_sim::hertz::Material { youngs_modulus_pa: 206e9, poisson_ratio: 0.3 };
    // Of two bodies, ISO counts E' = 2 E*: Z_E² = E*/π.
    let factor = (contact_modulus_pa(&steel) * 1e-6 / std::f64::consts::PI).sqrt();
    assert!((factor - 189.8).abs() < 0.1, "{factor}");
}

/// Of 400 drawn gears 63.2 % have a pit by `η = N₁/(−ln 0.99)^(1/e)`, and half by the median
/// `η (ln 2)^(1/e)`: within three standard deviations of the count.
#[test]
fn analytic_first_pits_are_weibull() {
    let setup = bare();
    let law = constants("pitting", &[("endurance_mpa", 800.0), ("weibull_slope", 2.0), ("growth_cycles", 1e12)]);
    let duty = Duty { motor_hz: 25.0, torque_nm: 240.0, share: 1.0 };
    let gears = 400;
    let with_pits = |quantile: f64| {
        let count = (0..gears)
            .filter(|&seed| {
                let mut pits = PitGrowth::new(&setup, (0, false), 0.5e-3, law.clone(), seed).unwrap();
                let (_, one_in_a_hundred) = pits.outlook(&setup, &duty);
                let scale = one_in_a_hundred / (-0.99_f64.ln()).sqrt();
                pits.advance(&setup, &[duty], scale * (-(1.0 - quantile).ln()).sqrt());
                pits.size().1 > 0
            })
            .count();
        count as f64
    };
    for quantile in [0.2, 0.5, 0.632] {
        let (found, expected) = (with_pits(quantile), quantile * gears as f64);
        let allowed = 3.0 * (expected * (1.0 - quantile)).sqrt();
        // Once a pit has begun, the pressure on its tooth rises: that makes further pits, not first
        // ones.
        assert!((found - expected).abs() < allowed, "{quantile}: {found} of {expected} ± {allowed}");
    }
}

/// Constants are checked like parameters of effects.
#[test]
fn conform_constants_that_cannot_be() {
    let table = GROWING[0].1;
    let given = |name: &str, value: f64| BTreeMap::from([(name.to_owned(), value)]);
    let said = Constants::new(table, &given("k", 1e-17)).unwrap_err().to_string();
    assert!(said.contains("k_m2_per_n"), "{said}");
    let said = Constants::new(table, &given("k_m2_per_n", 1.0)).unwrap_err().to_string();
    assert!(said.contains("expected") && said.contains("usual"), "{said}");
    for (effect, table) in GROWING {
        assert!(effects::find(effect).is_ok());
        for constant in *table {
            assert!(constant.min <= constant.usual && constant.usual <= constant.max, "{}", constant.name);
        }
    }
}
