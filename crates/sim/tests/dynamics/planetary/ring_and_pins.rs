//! A ring that is not round, and defects in the bearings of planets.

use std::sync::Arc;

use gearwatch_core::bench::{Bench, EffectSpec};
use gearwatch_core::train::Train;
use gearwatch_sim::effects::{self, Law, Line};
use gearwatch_sim::etd::Etd;
use gearwatch_sim::lines::line;
use gearwatch_sim::mesh::Pairs;
use gearwatch_sim::model::TrainModel;
use gearwatch_sim::render::{Rendered, steady as rendered};
use gearwatch_sim::rotation::Profile;
use gearwatch_sim::setup::SimSetup;

use super::super::RATE_HZ;
use super::{alone, with};

/// Forces of the sun's meshes as the planets pass the lobes of the ring, by the line at so many
/// passings a turn of the carrier, at a slow turn and a load that keeps all planets in mesh.
fn passing(bench: &Bench, lobes: u32, amplitude_um: f64) -> (TrainModel, [nalgebra::Complex<f64>; 4]) {
    let parameters = [("lobes", f64::from(lobes)), ("amplitude_um", amplitude_um)];
    let setup = with(bench, "ring_deformation", "p.ring", &parameters);
    let speed_hz = 4.0;
    let model = TrainModel::new(&setup, Profile::constant(speed_hz), Profile::constant(600.0), 1).expect("model");
    let model = Arc::new(model);
    let mut etd = Etd::<1>::sampled(model.clone(), RATE_HZ).expect("stepper");
    let steps = (1.0 / (RATE_HZ * etd.step_s())).round() as usize;
    let carrier = 28.0 / 128.0;
    // Two turns of the carrier.
    let count = (2.0 / (carrier * speed_hz) * RATE_HZ).round() as usize;
    let (mut angles, mut forces) = (Vec::new(), [const { Vec::new() }; 4]);
    let mut state = Vec::new();
    for n in 0..(4096 + count) * steps {
        etd.step().expect("steps");
        if n < 4096 * steps || n % steps != 0 {
            continue;
        }
        etd.state(0, &mut state);
        let reference = model.rotation.at(etd.time()).0;
        angles.push(reference);
        for (planet, forces) in forces.iter_mut().enumerate() {
            forces.push(model.contact(planet, reference, &state, &mut Pairs::default()).0.force_n);
        }
    }
    let order = f64::from(lobes) * carrier;
    let out = forces.map(|forces| line(&forces, &angles, order));
    (Arc::try_unwrap(model).unwrap_or_else(|model| (*model).clone()), out)
}

/// Two lobes under four planets: opposite planets meet them alike, neighbours opposed. That pattern
/// leaves all central members where they are, so that each planet stands alone between sun, ring
/// and pin: `F (1/k_s + 1/k_r + 4 cos² α / k_p) = g`, as of a pin out of place, with the way g of
/// the ring's flanks alone. Bending without stretching moves them by `w sin α` outwards and `(w/2)
/// cos α` along the ring. Measured 0.2 %, since the mean stiffness stands for that over the mesh
/// cycle; bound 1 %.
#[test]
fn analytic_two_lobes_load_the_planets_in_turns() {
    let bench = alone([28, 36, 100], 4, ["sun", "carrier"]);
    let (model, forces) = passing(&bench, 2, 20.0);
    let [k_sun, k_ring] = [0, 4].map(|mesh: usize| model.contacts[mesh].mean_stiffness_n_per_m);
    let (sin, cos) = 20_f64.to_radians().sin_cos();
    let way = 20e-6 * (sin * sin + 0.25 * cos * cos).sqrt();
    let pin = bench.shafts[1].bearing_n_per_m;
    let expected = way / (1.0 / k_sun + 1.0 / k_ring + 4.0 * cos * cos / pin);
    let alternating = 0.25 * (forces[0] - forces[1] + forces[2] - forces[3]).norm();
    assert!((alternating / expected - 1.0).abs() < 0.01, "{alternating} {expected}");
    // Nothing of it is left for all planets together.
    assert!(forces.iter().sum::<nalgebra::Complex<f64>>().norm() < 0.02 * alternating, "{forces:?}");
}

/// Four lobes under four planets: all planets meet one at once, the ring turns a little against the
/// carrier and no load moves: measured 6e-6 of what two lobes do, bound 1e-4.
#[test]
fn analytic_as_many_lobes_as_planets_move_no_load() {
    let bench = alone([28, 36, 100], 4, ["sun", "carrier"]);
    let two = passing(&bench, 2, 20.0).1;
    let four = passing(&bench, 4, 20.0).1;
    for (two, four) in two.iter().zip(&four) {
        assert!(four.norm() < 1e-4 * two.norm(), "{four} {two}");
    }
}

/// The stage with pins, teeth and a sun that are as in usual stages.
fn usual() -> Bench {
    let mut bench = alone([28, 36, 100], 4, ["sun", "carrier"]);
    let effect = |effect: &str, place: &str, name: &str, value: f64| EffectSpec {
        effect: effect.into(),
        place: place.into(),
        parameters: [(name.to_owned(), value)].into(),
    };
    bench.effects = vec![
        effect("planet_position", "p.planet_2", "error_um", 5.0),
        effect("carrier_eccentricity", "p.carrier", "runout_um", 10.0),
        effect("profile_error", "p", "e1_um", 1.0),
        effect("eccentricity", "p.sun", "runout_um", 6.0),
    ];
    bench
}

fn run(setup: &SimSetup, torque_nm: f64) -> Rendered {
    rendered(setup, 20.0, torque_nm, 5, 0.5, 2.4).expect("runs")
}

/// The lines that a ring out of round declares rise on a stage with usual errors, more than lines
/// midway between multiples of the carrier's speed. A load that keeps all planets in mesh: where
/// they part and meet again the motion does not repeat, and there is something at all orders.
#[test]
fn conform_ring_deformation() {
    let bench = usual();
    let (effect, values) = {
        let spec = EffectSpec { effect: "ring_deformation".into(), place: "p.ring".into(), parameters: [].into() };
        effects::resolve(&spec, &bench).expect("resolves")
    };
    let signature = effect.signature(&values, &bench);
    let runs = [
        &with(&bench, "ring_deformation", "p.ring", &[("amplitude_um", 5.0)]),
        &with(&bench, "damping", "p", &[("factor", 1.0)]),
    ]
    .map(|setup| run(setup, 300.0));
    let change = |order: f64| {
        let of = |run: &Rendered| line(&run.samples[0], &run.angles_rad, order);
        (of(&runs[0]) - of(&runs[1])).norm()
    };
    let orders: Vec<f64> =
        signature.lines.iter().filter_map(|at| if let Line::Order(order) = at { Some(*order) } else { None }).collect();
    let declared = orders.iter().map(|&order| change(order)).fold(0.0, f64::max);
    let carrier = 28.0 / 128.0;
    let between = orders.iter().map(|&order| change(order + 0.5 * carrier)).fold(0.0, f64::max);
    assert!(declared > 1e-4 && between < 0.05 * declared, "{declared:.1e} {between:.1e}");
    let spec = EffectSpec {
        effect: "ring_deformation".into(),
        place: "p.ring".into(),
        parameters: [("lobes".to_owned(), 2.5)].into(),
    };
    let said = effects::setup(&bench, &[spec]).expect_err("refused").to_string();
    assert!(said.contains("lobes is 2.5") && said.contains("whole number"), "{said}");
}

/// The teeth press each planet along the circle of the pins, in the sense that its bearing's load
/// zone takes, whichever member drives.
#[test]
fn analytic_teeth_press_planets_along_their_circle() {
    for members in [["sun", "carrier"], ["carrier", "sun"]] {
        let bench = alone([28, 36, 100], 4, members);
        let model = TrainModel::new(&SimSetup::nominal(&bench), Profile::constant(20.0), Profile::constant(60.0), 1)
            .expect("model");
        let linear = &model.linear;
        assert_eq!(linear.pins.len(), 4);
        for pin in &linear.pins {
            let meshes = [pin.planet, 4 + pin.planet];
            let force = |axis: usize| -> f64 {
                // Where a unit force on the planet acts, the meshes' forces act as −F row.
                let place = linear.names.iter().position(|name| {
                    *name == format!("p.planet_{}.{}", pin.planet + 1, ["radial", "tangential"][axis])
                });
                let at = place.expect("a coordinate");
                assert_eq!(pin.forces[axis][at], 1.0);
                meshes.iter().map(|&mesh| -linear.mesh[mesh][at] * model.force_per_torque[mesh]).sum()
            };
            assert!(force(0).abs() < 1e-9 * force(1).abs(), "{}", force(0));
            assert!(force(1) * pin.pressed > 0.0, "{members:?}: {} {}", force(1), pin.pressed);
        }
    }
}

/// What a defect in a planet's bearing adds on a stage with usual errors: power at its passages;
/// in the planet's bore it comes and goes with the planet's turn on its pin, on the pin it does
/// not. It goes with the load.
#[test]
fn conform_planet_bearing() {
    let bench = usual();
    let spec = EffectSpec { effect: "planet_bearing".into(), place: "p.planet_1".into(), parameters: [].into() };
    let (effect, values) = effects::resolve(&spec, &bench).expect("resolves");
    let signature = effect.signature(&values, &bench);
    assert_eq!(signature.load, Law::Power(1.0));
    let turns = Train::new(&bench).stages[0].mesh_order / 36.0;
    let Line::Order(passages) = signature.lines[0] else { panic!("an order") };
    assert!((passages - 5.43 * turns).abs() < 1e-12);
    let power = |on_pin: f64, torque_nm: f64| {
        let runs = [
            &with(&bench, "planet_bearing", "p.planet_1", &[("on_pin", on_pin)]),
            &with(&bench, "planet_bearing", "p.planet_1", &[("amplitude", 0.0)]),
        ]
        .map(|setup| run(setup, torque_nm));
        let change = runs[0].samples[0].iter().zip(&runs[1].samples[0]).map(|(a, b)| (a - b) * (a - b));
        let square: Vec<f64> = change.collect();
        let mean = square.iter().sum::<f64>() / square.len() as f64;
        let part = |order: f64| line(&square, &runs[0].angles_rad, order).norm() / mean;
        (mean.sqrt(), part(passages), part(turns), part(passages * 0.63))
    };
    let (bore, pin) = (power(0.0, 120.0), power(1.0, 120.0));
    // The sequence of pushes has the slip of the cage: lines are broad, as of a shaft's bearing.
    assert!(pin.1 > 0.4 && pin.3 < 0.25 * pin.1 && pin.2 < 0.2, "pin: {pin:?}");
    assert!(bore.2 > 1.0, "bore: {bore:?}");
    let doubled = power(1.0, 240.0);
    assert!((doubled.0 / pin.0 - 2.0).abs() < 0.1, "{pin:?} {doubled:?}");
    let spec = EffectSpec { parameters: [("on_pin".to_owned(), 0.5)].into(), ..spec };
    let said = effects::setup(&bench, &[spec]).expect_err("refused").to_string();
    assert!(said.contains("on_pin is 0.5") && said.contains("0 for the bore"), "{said}");
}
