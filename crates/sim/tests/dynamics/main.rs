//! The train's time steppers against each other, against static and modal solutions, and against
//! themselves.

use std::f64::consts::TAU;
use std::sync::Arc;

use gearwatch_core::bench::Bench;
use gearwatch_core::block::{Packet, Samples};
use gearwatch_core::source::Source;
use gearwatch_sim::etd::Etd;
use gearwatch_sim::lines::line;
use gearwatch_sim::model::TrainModel;
use gearwatch_sim::rk4::Rk4;
use gearwatch_sim::rotation::Profile;
use gearwatch_sim::scenario::Scenario;
use gearwatch_sim::setup::SimSetup;
use gearwatch_sim::shipped;
use gearwatch_sim::source::{SimConfig, Simulator};

mod beams;
mod harmonics;
mod helical;
mod oscillator;
mod planetary;
mod shifted;

const RATE_HZ: f64 = 16_384.0;

fn bare(name: &str) -> Bench {
    let mut bench = shipped::bench(name).expect("shipped");
    bench.effects.clear();
    bench
}

fn model(bench: &Bench, motor_hz: f64, torque_nm: f64, seed: u64) -> Arc<TrainModel> {
    let setup = SimSetup::nominal(bench);
    Arc::new(TrainModel::new(&setup, Profile::constant(motor_hz), Profile::constant(torque_nm), seed).expect("model"))
}

/// End readings of the first sensor at each sample.
fn exponential(model: &Arc<TrainModel>, steps_per_sample: f64, samples: usize) -> Vec<f64> {
    let mut etd = Etd::<1>::new([model.clone()], 1.0 / (RATE_HZ * steps_per_sample)).expect("stepper");
    let steps = (1.0 / (RATE_HZ * etd.step_s())).round() as u32;
    (0..samples)
        .map(|_| {
            for _ in 0..steps {
                etd.step().expect("steps");
            }
            etd.readings()[1][0][0]
        })
        .collect()
}

fn runge_kutta(model: &TrainModel, steps_per_sample: u32, samples: usize) -> Vec<f64> {
    let mut rk4 = Rk4::new(model, 1.0 / (RATE_HZ * f64::from(steps_per_sample))).expect("stepper");
    (0..samples)
        .map(|_| {
            for _ in 0..steps_per_sample {
                rk4.step_located().expect("steps");
            }
            rk4.sensor(0)
        })
        .collect()
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for value in values {
        sum += value * value;
        count += 1.0;
    }
    (sum / count).sqrt()
}

fn spread(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    rms(values.iter().map(|v| v - mean))
}

/// Two steppers that share nothing but the right-hand side agree to 1e-4 of the signal (Runge–Kutta
/// at 12 steps a sample errs by 2e-5), with even teeth and where every other pair stands back.
#[test]
fn oracle_exponential_stepping_is_runge_kutta() {
    let mut setup = SimSetup::nominal(&bare("paper-rig"));
    let mut before: Option<Vec<f64>> = None;
    for alternating_m in [0.0, 4e-6] {
        setup.teeth.iter_mut().for_each(|teeth| teeth.pair.alternating_m = alternating_m);
        let model = TrainModel::new(&setup, Profile::constant(30.0), Profile::constant(202.0), 3).expect("model");
        let model = Arc::new(model);
        let slow = runge_kutta(&model, 12, 1200);
        let fast = exponential(&model, 4.0, 1200);
        let apart = |a: &[f64], b: &[f64]| rms(a.iter().zip(b).map(|(a, b)| a - b)) / spread(&slow);
        assert!(apart(&slow, &fast) < 1e-4, "{:.2e}", apart(&slow, &fast));
        // The alternation is there: thousands of times what the steppers differ by.
        assert!(before.is_none_or(|before| apart(&before, &slow) > 0.05));
        before = Some(slow);
    }
}

/// Free flight too: at 1 N m the teeth of a pair with a coarse profile error part and meet again.
#[test]
fn oracle_rattling_teeth() {
    let mut bench = bare("single-pair");
    bench.effects.push(gearwatch_core::bench::EffectSpec {
        effect: "profile_error".into(),
        place: "stage1".into(),
        parameters: [("e1_um".to_owned(), 12.0)].into(),
    });
    let setup = gearwatch_sim::effects::setup(&bench, &[]).expect("setup");
    let model = Arc::new(TrainModel::new(&setup, Profile::constant(25.0), Profile::constant(1.0), 1).expect("model"));
    let mut etd = Etd::<1>::new([model.clone()], 0.25 / RATE_HZ).expect("stepper");
    let steps = (1.0 / (RATE_HZ * etd.step_s())).round() as u32;
    let fast: Vec<f64> = (0..100)
        .map(|_| {
            for _ in 0..steps {
                etd.step().expect("steps");
            }
            etd.readings()[1][0][0]
        })
        .collect();
    assert!(etd.effort(0).free_flight > 20, "{:?}", etd.effort(0));
    let slow = runge_kutta(&model, 16, 100);
    let error = |n: usize| rms(slow[..n].iter().zip(&fast[..n]).map(|(a, b)| a - b)) / spread(&slow);
    // Each impact amplifies what differs before it, so agreement is asked of the first flights and
    // of some later ones less.
    assert!(error(50) < 1e-4 && error(100) < 5e-3, "{:.2e} {:.2e}", error(50), error(100));
}

/// The contact compliance blends linearly between shared and lone contact, and the corner gap
/// begins as a square: these kinks bound the order to 2, so halving the step divides the error by 4
/// (a tenth of slack for where the kinks fall).
#[test]
fn analytic_order_of_the_exponential_stepper() {
    let model = model(&bare("single-pair"), 25.0, 60.0, 1);
    let finest = exponential(&model, 16.0, 600);
    let error = |parts| rms(finest.iter().zip(exponential(&model, parts, 600)).map(|(a, b)| a - b));
    let (coarse, fine) = (error(2.0), error(4.0));
    assert!(coarse / fine > 3.6, "{coarse:.2e} {fine:.2e}");
}

/// Perfect teeth at a speed where a mesh cycle is 64 steps: after settling every cycle is the same
/// to 1e-9 of the signal.
#[test]
fn analytic_speed_locked_run_is_periodic() {
    let bench = bare("single-pair");
    let motor_hz = 25.0;
    let model = model(&bench, motor_hz, 60.0, 1);
    let mesh_hz = motor_hz * 23.0;
    let mut etd = Etd::<1>::new([model], 1.0 / (64.0 * mesh_hz)).expect("stepper");
    let steps = (1.0 / (mesh_hz * etd.step_s())).round() as usize;
    let cycle = |etd: &mut Etd<1>| -> Vec<f64> {
        (0..steps)
            .map(|_| {
                etd.step().expect("steps");
                etd.readings()[1][0][0]
            })
            .collect()
    };
    // The slowest mode decays with 1.3 /s or faster: 30 s leave e^-39 of the start.
    for _ in 0..(30.0 * mesh_hz) as usize {
        cycle(&mut etd);
    }
    let (one, two) = (cycle(&mut etd), cycle(&mut etd));
    let error = one.iter().zip(&two).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / spread(&one);
    assert!(error < 1e-9, "{error:.2e}");
}

/// Mean mesh force is the static one, and at a crawl the approach follows the static transmission
/// error.
#[test]
fn analytic_static_solution() {
    let bench = bare("single-pair");
    let slow = model(&bench, 0.25, 60.0, 1);
    let mut etd = Etd::<1>::new([slow.clone()], 1.0 / RATE_HZ).expect("stepper");
    let force = 60.0 * slow.force_per_torque[0];
    let mut worst = 0.0_f64;
    let (mut sum, mut largest) = (0.0, 0.0_f64);
    for n in 0..16_384 {
        etd.step().expect("steps");
        if n < 4096 {
            continue;
        }
        let mut state = Vec::new();
        etd.state(0, &mut state);
        let phase = slow.phase(0, slow.rotation.at(etd.time()).0, slow.pinion_rad(0, &state));
        let expected = slow.contacts[0].static_approach(phase, force);
        worst = worst.max((etd.approach(0, 0) - expected).abs());
        largest = largest.max(expected);
        sum += slow.contacts[0].at(phase, etd.approach(0, 0), 0.0, &mut Default::default()).force_n;
    }
    assert!(worst < 0.01 * largest, "{worst:.2e} of {largest:.2e}");
    // 0.75 s are 4.3 mesh cycles: the mean of a ripple of 1 % over a broken cycle.
    assert!((sum / 12_288.0 / force - 1.0).abs() < 1e-3, "{} {force}", sum / 12_288.0);
}

/// With friction the drive gives what the brake takes and the teeth turn to heat:
/// `T_m Ω_m = T_b Ω_b + Σ μ F |v|`.
#[test]
fn analytic_energy_balance() {
    let mut bench = bare("single-pair");
    bench.effects.push(gearwatch_core::bench::EffectSpec {
        effect: "tooth_friction".into(),
        place: "stage1".into(),
        parameters: [("coefficient".to_owned(), 0.06)].into(),
    });
    let setup = gearwatch_sim::effects::setup(&bench, &[]).expect("setup");
    let model = Arc::new(TrainModel::new(&setup, Profile::constant(25.0), Profile::constant(60.0), 1).expect("model"));
    let mut etd = Etd::<1>::new([model.clone()], 1.0 / RATE_HZ).expect("stepper");
    let n = model.coordinates();
    let (mut drive, mut brake, mut heat) = (0.0, 0.0, 0.0);
    let mut state = Vec::new();
    let geometry = &model.linear.meshes[0];
    let [pinion, wheel] = [geometry.pinion, geometry.wheel].map(|gear| gear.angle.expect("it turns"));
    let slope = bench.motor.slip_slope_nm_s_per_rad;
    let (settle, count) = (20_000, 32_768);
    for step in 0..settle + count {
        etd.step().expect("steps");
        if step < settle {
            continue;
        }
        etd.state(0, &mut state);
        let (reference, omega, _) = model.rotation.at(etd.time());
        let ratio = model.linear.shaft_orders[1];
        let held = 60.0 * ratio;
        let motor = model.linear.motor_angle;
        let last = model.linear.shaft_angles[1].1;
        drive += (held - slope * state[n + motor]) * (omega + state[n + motor]);
        brake += 60.0 * (omega * ratio + state[n + last]);
        let (contact, _) = model.contact(0, reference, &state, &mut Default::default());
        let friction = model.contacts[0].friction;
        heat -= friction
            * (contact.friction[1] * (omega + state[n + pinion])
                + contact.friction[2] * (omega * ratio + state[n + wheel]));
    }
    let (drive, brake, heat) = (drive / f64::from(count), brake / f64::from(count), heat / f64::from(count));
    assert!(heat > 1e-3 * brake, "{heat} of {brake}");
    // Dampers take what the vibration feeds them: below 2 % of the friction here.
    assert!((drive - brake - heat).abs() < 0.02 * heat, "{drive} = {brake} + {heat}");
}

/// A step beyond the border of stability is refused with the longest that is not.
#[test]
fn conform_an_unstable_step_is_refused() {
    let model = model(&bare("single-pair"), 25.0, 60.0, 1);
    let complaint = Rk4::new(&model, 2e-4).expect_err("refused").to_string();
    assert!(complaint.contains("unstable") && complaint.contains("needs steps below"), "{complaint}");
    // Just inside the border it runs.
    let longest = Rk4::longest_stable_step(&model).expect("modes");
    let mut rk4 = Rk4::new(&model, 0.99 * longest).expect("stable");
    for _ in 0..2000 {
        rk4.step_located().expect("stays finite");
    }
}

/// Eight runs side by side give what each gives alone, bit for bit.
#[test]
fn conform_lanes_equal_single_runs() {
    let bench = bare("paper-rig");
    let models: [Arc<TrainModel>; 8] =
        std::array::from_fn(|l| model(&bench, 28.0 + 0.5 * l as f64, 150.0 + 10.0 * l as f64, l as u64));
    let mut lanes = Etd::new(models.clone(), 1.0 / RATE_HZ).expect("stepper");
    let mut singles = models.map(|m| Etd::<1>::new([m], 1.0 / RATE_HZ).expect("stepper"));
    for n in 0..400 {
        lanes.step().expect("steps");
        for (l, single) in singles.iter_mut().enumerate() {
            single.step().expect("steps");
            for half in 0..2 {
                let (a, b) = (lanes.readings()[half][0][l], single.readings()[half][0][0]);
                assert_eq!(a.to_bits(), b.to_bits(), "sample {n}, lane {l}: {a} {b}");
            }
        }
    }
}

fn packets(seed: u64, scenario: Scenario) -> Vec<Packet> {
    let bench = shipped::bench("single-pair").expect("shipped");
    let config = SimConfig { bench, effects: vec![], scenario, seed, t0: 0 };
    let mut simulator = Simulator::new(config).expect("simulator");
    std::iter::from_fn(|| simulator.next_packet().expect("packet")).collect()
}

/// The same seed gives the same packets, another seed others; blocks follow on without a gap.
#[test]
fn conform_source_is_deterministic_and_gapless() {
    let scenario = Scenario { duration_s: Some(0.5), ..Scenario::default() };
    let (one, two, other) = (packets(1, scenario.clone()), packets(1, scenario.clone()), packets(2, scenario));
    // Unknown temperatures are NaN, so packets are compared as they print.
    assert_eq!(format!("{one:?}"), format!("{two:?}"));
    assert_ne!(format!("{one:?}"), format!("{other:?}"));
    let mut next = 0;
    for packet in &one {
        if let Packet::Vibration(block) = packet {
            assert_eq!(block.first_sample_index, next);
            next += block.samples.len() as u64;
            assert!(matches!(block.samples, Samples::Counts { .. }));
        }
    }
    assert_eq!(next, 8192);
}

/// The tacho's edges are one revolution apart, to the jitter.
#[test]
fn analytic_tacho_edges() {
    let scenario = Scenario { duration_s: Some(1.0), ..Scenario::default() };
    let mut edges = Vec::new();
    for packet in packets(1, scenario) {
        if let Packet::Tacho(block) = packet {
            edges.extend(block.pulse_times);
        }
    }
    assert!((24..=26).contains(&edges.len()), "{}", edges.len());
    for pair in edges.windows(2) {
        // 2 µs of jitter at each edge, five sigma of the difference, and 1e-4 rad of vibration.
        assert!((pair[1] - pair[0] - 40_000_000).abs() < 15_000, "{}", pair[1] - pair[0]);
    }
}

/// An effect that sets in under way changes the record from then on, and not before.
#[test]
fn conform_an_event_sets_in_when_it_should() {
    let healthy = Scenario { duration_s: Some(1.0), ..Scenario::default() };
    let text = "format = \"gearwatch-scenario/1\"\nduration_s = 1.0\n[[event]]\neffect = \"electrical_pickup\"\nwhere = \"acc_1\"\n\
        start_s = 0.5\nparameters = { frequency_hz = 50.0, amplitude = 5.0 }\n";
    let struck: Scenario = toml::from_str(text).expect("scenario");
    let flat = |packets: Vec<Packet>| -> Vec<f64> {
        let blocks = packets.into_iter().filter_map(|p| if let Packet::Vibration(b) = p { Some(b) } else { None });
        blocks.flat_map(|b| b.samples.iter().collect::<Vec<_>>()).collect()
    };
    let (one, two) = (flat(packets(1, healthy)), flat(packets(1, struck)));
    assert_eq!(one[..8192], two[..8192]);
    let error = rms(one[8192..].iter().zip(&two[8192..]).map(|(a, b)| b - a));
    assert!((error - 5.0 / 2_f64.sqrt()).abs() < 0.01, "{error}");
}

/// Sidebands of a carrier with amplitude and phase modulation: upper `|m/2 + (b/2) e^{id}|`, lower
/// `|m/2 − (b/2) e^{−id}|`, to O(b²).
#[test]
fn analytic_sideband_algebra() {
    let (m, b, d) = (0.03, 0.02, 0.7_f64);
    let angles: Vec<f64> = (0..40_000).map(|n| TAU * 40.0 * f64::from(n) / 40_000.0).collect();
    let samples: Vec<f64> = angles.iter().map(|a| (1.0 + m * a.cos()) * (30.0 * a + b * (a + d).sin()).cos()).collect();
    let expected = |sign: f64| {
        let (re, im) = (0.5 * m + sign * 0.5 * b * d.cos(), 0.5 * b * d.sin());
        re.hypot(im)
    };
    assert!((line(&samples, &angles, 31.0).norm() - expected(1.0)).abs() < b * b, "upper");
    assert!((line(&samples, &angles, 29.0).norm() - expected(-1.0)).abs() < b * b, "lower");
}
