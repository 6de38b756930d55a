//! What is wrong with a planetary stage: a pin out of place, damaged teeth.

use std::f64::consts::TAU;
use std::sync::Arc;

use gearwatch_core::bench::Bench;
use gearwatch_sim::etd::Etd;
use gearwatch_sim::lines::line;
use gearwatch_sim::mesh::Pairs;
use gearwatch_sim::model::TrainModel;
use gearwatch_sim::rk4::Rk4;
use gearwatch_sim::rotation::Profile;
use gearwatch_sim::setup::SimSetup;

use super::super::RATE_HZ;
use super::{alone, with};

/// Mean forces of the sun's meshes over some eleven mesh cycles at a crawl, the first planet's pin
/// ahead of its place.
fn crawl(bench: &Bench, error_um: f64, torque_nm: f64) -> (TrainModel, [f64; 4]) {
    let setup = with(bench, "planet_position", "p.planet_1", &[("error_um", error_um)]);
    let model = TrainModel::new(&setup, Profile::constant(0.5), Profile::constant(torque_nm), 1).expect("model");
    let mut rk4 = Rk4::new(&model, 1.0 / (RATE_HZ * 2.0)).expect("stepper");
    let mut sums = [0.0; 4];
    let (skip, count) = (16_384, 32_768);
    for step in 0..skip + count {
        rk4.step_located().expect("steps");
        if step >= skip {
            let reference = model.rotation.at(rk4.time()).0;
            for (planet, sum) in sums.iter_mut().enumerate() {
                *sum +=
                    model.contact(planet, reference, &rk4.state, &mut Pairs::default()).0.force_n / f64::from(count);
            }
        }
    }
    (model, sums)
}

/// A pin that is ahead by the usual 20 µm, at a load that keeps all planets in mesh. The error is a
/// quarter each of four patterns of planets (all alike, two that go once round, one that
/// alternates). Alike it changes no load, for the torque stays. The alternating pattern leaves all
/// central members where they are, so that each planet stands alone: its meshes k_s and k_r carry
/// the same force F, its pin k_p carries 2 F cos α, and
/// `F (1/k_s + 1/k_r + 4 cos² α / k_p) = −2 e cos α` for a pin ahead by e. So
/// `F_1 − F_2 + F_3 − F_4` is that F whatever floats. The once-round patterns lie between nothing,
/// where sun and carrier float, and twice the alternating one, where they cannot give way; the
/// first planet loses a quarter to three quarters of F.
#[test]
fn analytic_a_pin_out_of_place_unloads_its_planet() {
    let bench = alone([28, 36, 100], 4, ["sun", "carrier"]);
    let (error_um, torque_nm) = (20.0, 600.0);
    let (model, forces) = crawl(&bench, error_um, torque_nm);
    let mean = forces.iter().sum::<f64>() / 4.0;
    assert!((mean / (torque_nm * model.force_per_torque[0]) - 1.0).abs() < 1e-2, "{mean}");
    let [k_sun, k_ring] = [0, 4].map(|mesh: usize| model.contacts[mesh].mean_stiffness_n_per_m);
    let cos = 20_f64.to_radians().cos();
    let pin = bench.shafts[1].bearing_n_per_m;
    let expected = 2.0 * 1e-6 * error_um * cos / (1.0 / k_sun + 1.0 / k_ring + 4.0 * cos * cos / pin);
    let alternating = -(forces[0] - forces[1] + forces[2] - forces[3]);
    assert!((alternating / expected - 1.0).abs() < 0.01, "{alternating} {expected} {forces:?}");
    let lost = mean - forces[0];
    assert!(lost > 0.25 * expected && lost < 0.75 * expected, "{forces:?} {expected}");
    assert!(forces[1] > mean && forces[3] > mean && forces[2] > forces[0], "{forces:?}");
}

/// The same pin at a tenth of the load: its planet carries nothing any more, and the others take
/// what it leaves.
#[test]
fn analytic_a_pin_out_of_place_idles_at_light_load() {
    let bench = alone([28, 36, 100], 4, ["sun", "carrier"]);
    let (model, forces) = crawl(&bench, 20.0, 60.0);
    let whole = 4.0 * 60.0 * model.force_per_torque[0];
    assert!(forces[0].abs() < 1e-2 * whole, "{forces:?} {whole}");
    assert!((forces[1..].iter().sum::<f64>() / whole - 1.0).abs() < 1e-2, "{forces:?} {whole}");
}

/// A damaged tooth shows at its own rate against the carrier: sun N times a turn of `n_s − n_c`
/// (once each planet), planet and ring likewise; a healthy stage shows nothing between the lines of
/// its planets. In the frame of the carrier the mesh force of one planet repeats with z teeth.
#[test]
fn analytic_damaged_teeth_of_every_member() {
    let bench = alone([28, 36, 100], 4, ["sun", "carrier"]);
    let healthy = SimSetup::nominal(&bench);
    for (place, teeth) in [("p.sun", 28), ("p.ring", 100), ("p.planet_2", 36), ("p.planet_2.ring_side", 36)] {
        let broken = with(&bench, "pitting", place, &[("area_fraction", 0.3)]);
        let comb = |setup: &SimSetup| {
            let model = TrainModel::new(setup, Profile::constant(20.0), Profile::constant(60.0), 1).expect("model");
            let model = Arc::new(model);
            let mut etd = Etd::<1>::new([model.clone()], 1.0 / RATE_HZ).expect("stepper");
            let (mut phase, mut force) = (Vec::new(), Vec::new());
            let mesh = if place.ends_with("ring_side") || place == "p.ring" { 5 } else { 1 };
            let mut state = Vec::new();
            for step in 0..20_000 {
                etd.step().expect("steps");
                if step >= 6_000 {
                    etd.state(0, &mut state);
                    let reference = model.rotation.at(etd.time()).0;
                    phase.push(TAU * model.phase(mesh, reference, model.pinion_rad(mesh, &state)));
                    force.push(model.contact(mesh, reference, &state, &mut Pairs::default()).0.force_n);
                }
            }
            let mean = force.iter().sum::<f64>() / force.len() as f64;
            // Once a turn of the gear, a few times over, beside the mesh's own harmonics.
            let harmonics = (2..6).map(|k| line(&force, &phase, f64::from(k) / f64::from(teeth)).norm());
            harmonics.fold(0.0, f64::max) / mean
        };
        let (sound, damaged) = (comb(&healthy), comb(&broken));
        assert!(damaged > 5.0 * sound, "{place}: {damaged:.1e} {sound:.1e}");
    }
}
