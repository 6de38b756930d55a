//! Made recordings with one thing in them each, from the samples to the answer.

use super::*;
use crate::judge::report::Status;
use crate::name::first::turning_kg;
use gearwatch_core::bench::*;
use gearwatch_core::block::{OperatingPoint, Quality};
use gearwatch_core::recording::{Channel, Segment};
use gearwatch_sim::linear::DIRECT_PATH_MASS_KG;
use rand::{RngExt, SeedableRng};
use std::f64::consts::TAU;

mod outside;

const RATE_HZ: f64 = 8192.0;
const SAMPLES: usize = 3 * 8192;

fn bench() -> Bench {
    let shaft = |name: &str| Shaft {
        inertia_kg_m2: 0.002,
        torsion_nm_per_rad: 2e4,
        torsion_damping_nm_s_per_rad: 0.4,
        bearing_n_per_m: 1.5e8,
        bearing_damping_n_s_per_m: 1e3,
        ..Shaft::named(name)
    };
    let stage = Stage {
        name: "stage1".into(),
        module_mm: 2.0,
        pressure_angle_deg: 20.0,
        face_width_mm: 20.0,
        backlash_um: 80.0,
        mesh_damping_ratio: 0.06,
        line_of_centres_deg: 0.0,
        pinion: Gear::with_teeth(23),
        wheel: Gear::with_teeth(41),
        gearing: Default::default(),
    };
    let motor = Motor { speed_hz: 30.0, inertia_kg_m2: 0.008, slip_slope_nm_s_per_rad: 2.0 };
    Bench {
        brake: Brake { torque_nm: 40.0, inertia_kg_m2: 0.01 },
        sensors: ["acc_1", "acc_2"]
            .iter()
            .map(|name| Sensor {
                name: (*name).into(),
                shaft: "input".into(),
                direction_deg: 0.0,
                unit: "m/s^2".into(),
            })
            .collect(),
        acquisition: Acquisition { sample_rate_hz: RATE_HZ },
        ..Bench::new("test", motor, vec![shaft("input"), shaft("output")], vec![stage])
    }
}

/// The same with a belt of this ratio between motor and input shaft.
fn belted(ratio: f64) -> Bench {
    let belt =
        Belt { ratio, stiffness_nm_per_rad: 4000.0, damping_nm_s_per_rad: 1.2, length_mm: None, motor_pulley_mm: None };
    Bench { belt: Some(belt), ..bench() }
}

/// What a recording holds: mesh harmonics, sidebands, shaft orders, white noise, and something
/// more.
fn record(speed_hz: f64, torque_nm: f64, seed: u64, teeth: f64, more: &dyn Fn(usize, f64, f64) -> f64) -> Recording {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let mut uniform = move || -> f64 { random.random() };
    let mut lines: Vec<(f64, f64)> = (1..=8).map(|h| (teeth * f64::from(h), 2.0 / f64::from(h))).collect();
    for h in 1..=5 {
        for k in 1..=4 {
            for order in [1.0, teeth / 41.0] {
                lines.extend(
                    [-1.0, 1.0].map(|s| (teeth * f64::from(h) + s * order * f64::from(k), 0.08 / f64::from(k))),
                );
            }
        }
    }
    lines.extend((1..=12).map(|k| (f64::from(k), 0.1)));
    let phases: Vec<f64> = lines.iter().map(|_| uniform()).collect();
    let mut lines: Vec<((f64, f64), f64)> = lines.into_iter().zip(phases).collect();
    let speed = speed_hz * (1.0 + 2e-3 * (uniform() - 0.5));
    let start = uniform();
    // What an acquisition with a filter lets through.
    lines.retain(|((order, _), _)| order * speed < 0.5 * RATE_HZ);
    let mut recording = Recording { name: format!("{speed_hz}hz-{torque_nm}nm"), ..Recording::default() };
    for (c, name) in ["acc_1", "acc_2"].iter().enumerate() {
        let samples = (0..SAMPLES)
            .map(|n| {
                let t = n as f64 / RATE_HZ;
                let angle = start + speed * t;
                let gears: f64 = lines.iter().map(|((o, a), p)| a * (TAU * (o * angle + p)).cos()).sum();
                let noise: f64 = (0..4).map(|_| uniform() - 0.5).sum::<f64>() * 0.5;
                gears + noise + more(c, t, angle)
            })
            .collect();
        let segment = Segment { t0: 0, first_sample_index: 0, samples, quality: Quality::GOOD };
        let channel = Channel { sample_rate_hz: RATE_HZ, unit: "m/s^2".into(), segments: vec![segment] };
        recording.channels.insert((*name).into(), channel);
    }
    recording.operating_points.push(OperatingPoint {
        t: 0,
        motor_speed_hz: speed_hz,
        brake_torque_nm: torque_nm,
        temperature_c: f64::NAN,
    });
    recording
}

/// Speed (Hz) and torque (N m) of the recordings of a session.
const POINTS: [(f64, f64); 4] = [(20.0, 20.0), (20.0, 40.0), (30.0, 20.0), (30.0, 40.0)];

fn session(seed: u64, teeth: f64, more: &dyn Fn(usize, f64, f64) -> f64) -> Vec<Recording> {
    POINTS.iter().zip(seed..).map(|(&(speed, torque), s)| record(speed, torque, s, teeth, more)).collect()
}

/// A session of a sheet with its teeth, whose recordings hold an order of the input shaft besides,
/// of an amplitude (m/s²) by speed and torque.
fn with_order(seed: u64, order: f64, amplitude: &dyn Fn(f64, f64) -> f64) -> Vec<Recording> {
    let one = |(&(speed, torque), s): (&(f64, f64), u64)| {
        record(speed, torque, s, 23.0, &|_, _, angle| amplitude(speed, torque) * (TAU * order * angle).cos())
    };
    POINTS.iter().zip(seed..).map(one).collect()
}

fn ask(recordings: &[Recording], reference: &[Recording]) -> Explanation {
    explain(&Input { bench: &bench(), recordings, reference, without: &[] }, &mut |_| {}).unwrap().explanation
}

fn nothing(_: usize, _: f64, _: f64) -> f64 {
    0.0
}

fn first(answer: &Explanation) -> (&str, &str) {
    answer.effects.first().map_or(("", ""), |e| (e.effect.as_str(), e.place.as_str()))
}

/// Two sessions of one bench, other phases and other noise: nothing to explain, and the same words
/// each time.
#[test]
fn conform_unchanged_bench_is_consistent_and_answers_repeat() {
    let (now, before) = (session(1, 23.0, &nothing), session(50, 23.0, &nothing));
    let answer = ask(&now, &before);
    assert_eq!(answer.status, Status::Consistent, "{:?}", answer.steps);
    assert_eq!(format!("{answer:?}"), format!("{:?}", ask(&now, &before)));
}

/// A reference half as long, of the same bench: noise has less power in a finer bin, and that is no
/// change of the background.
#[test]
fn regress_a_shorter_reference_is_no_change_of_the_background() {
    let (now, mut before) = (session(1, 23.0, &nothing), session(50, 23.0, &nothing));
    for run in before.iter_mut().flat_map(|r| r.channels.values_mut()).flat_map(|c| &mut c.segments) {
        run.samples.truncate(SAMPLES / 2);
    }
    for (recordings, reference) in [(&now, &before), (&before, &now)] {
        let answer = ask(recordings, reference);
        assert_eq!(answer.status, Status::Consistent, "{:?}", answer.steps);
    }
}

/// Power at ±1 of the wheel's shaft about every mesh harmonic is run-out of the wheel.
#[test]
fn analytic_first_sidebands_are_eccentricity() {
    let more = |_: usize, _: f64, angle: f64| {
        let shaft = 23.0 / 41.0;
        (1..=6)
            .map(|h| {
                let mesh = 23.0 * f64::from(h);
                0.3 * ((TAU * (mesh - shaft) * angle).cos() + (TAU * (mesh + shaft) * angle + 1.0).cos())
            })
            .sum()
    };
    let answer = ask(&session(1, 23.0, &more), &session(50, 23.0, &nothing));
    assert_eq!(first(&answer), ("eccentricity", "stage1.wheel"), "{:?}", answer.steps);
}

/// 33 waves on the flanks of 23 teeth: new lines at order 33 of the pinion and where the mesh mixes
/// it to, all of remainder 10.
#[test]
fn analytic_new_lines_of_one_remainder_are_a_ghost() {
    let more = |_: usize, _: f64, angle: f64| {
        let mixed = [-1.0, 1.0].map(|h| 0.12 * (TAU * (33.0 + 23.0 * h) * angle + h).cos());
        0.4 * (TAU * 33.0 * angle).cos() + mixed.iter().sum::<f64>()
    };
    let answer = ask(&session(1, 23.0, &more), &session(50, 23.0, &nothing));
    assert_eq!(first(&answer), ("ghost_component", "stage1.pinion"), "{:?}", answer.steps);
    let order = answer.effects[0].parameters["order"];
    assert!((order.value() - 33.0).abs() < 2.0 * order.sigma(), "{order:?}");
}

/// The orders of both shafts rise and the mesh harmonics stay: friction of their teeth.
#[test]
fn analytic_orders_of_both_shafts_without_the_mesh_are_friction() {
    let more = |_: usize, _: f64, angle: f64| {
        let orders = (1..=12).flat_map(|k| [1.0, 23.0 / 41.0].map(|order| f64::from(k) * order));
        orders.map(|order| 0.25 * (TAU * order * angle + 2.0 * order).cos()).sum()
    };
    let answer = ask(&session(1, 23.0, &more), &session(50, 23.0, &nothing));
    assert_eq!(first(&answer), ("tooth_friction", "stage1"), "{:?}", answer.steps);
}

/// A line that keeps its 250 Hz at both speeds on one sensor is picked up from the mains. (60 Hz
/// would be order 3 of 20 Hz and order 2 of 30 Hz: no recording at these speeds tells it from the
/// shaft.)
#[test]
fn analytic_fixed_line_on_one_sensor_is_pickup() {
    let more = |c: usize, t: f64, _: f64| if c == 1 { 0.6 * (TAU * 250.0 * t).cos() } else { 0.0 };
    let answer = ask(&session(1, 23.0, &more), &session(50, 23.0, &nothing));
    assert_eq!(first(&answer), ("electrical_pickup", "acc_2"), "{:?}", answer.steps);
    let amplitude = answer.effects[0].parameters["amplitude"];
    // Noise of 0.29 rms in a 3 s window stands at 0.006; the estimate carries 6 % at least.
    assert!((amplitude.value() - 0.6).abs() < 2.0 * amplitude.sigma(), "{amplitude:?}");
}

/// Without any reference a wrong tooth number shows: mesh lines, sidebands and shaft orders fit 24
/// teeth.
#[test]
fn analytic_other_teeth_are_counted() {
    let answer = ask(&session(1, 24.0, &nothing), &[]);
    assert_eq!(first(&answer), ("wrong_tooth_count", "stage1.pinion"), "{:?}", answer.steps);
    assert!((answer.effects[0].parameters["teeth"].value() - 24.0).abs() < 0.5);
}

/// The last wheel moves no mesh line. Two teeth more on the sheet than in the recordings show in
/// the sidebands of its shaft alone; as many as there are, and nothing is said.
#[test]
fn analytic_other_teeth_of_the_last_wheel_are_counted_by_its_sidebands() {
    let mut sheet = bench();
    sheet.stages[0].wheel.teeth = 43;
    let now = session(1, 23.0, &nothing);
    let answer = explain(&Input { bench: &sheet, recordings: &now, reference: &[], without: &[] }, &mut |_| {});
    let answer = answer.unwrap().explanation;
    assert_eq!(first(&answer), ("wrong_tooth_count", "stage1.wheel"), "{:?}", answer.steps);
    assert!((answer.effects[0].parameters["teeth"].value() - 41.0).abs() < 0.5);
    assert_eq!(first(&ask(&now, &[])), ("", ""));
}

/// One channel twice as large, lines and background alike.
#[test]
fn analytic_one_factor_for_everything_is_scaling() {
    let mut now = session(1, 23.0, &nothing);
    for recording in &mut now {
        let channel = recording.channels.get_mut("acc_1").unwrap();
        channel.segments[0].samples.iter_mut().for_each(|x| *x *= 2.0);
    }
    let answer = ask(&now, &session(50, 23.0, &nothing));
    assert_eq!(first(&answer), ("scaling", "acc_1"), "{:?}", answer.steps);
    let factor = answer.effects[0].parameters["factor"];
    assert!((factor.value() - 2.0).abs() < 2.0 * factor.sigma(), "{factor:?}");
}

/// Recordings that cannot be judged are refused in sentences that name the recording and what would
/// be right.
#[test]
fn conform_bad_recordings_are_refused_in_words() {
    let refuse = |recordings: &[Recording]| {
        let input = Input { bench: &bench(), recordings, reference: &[], without: &[] };
        explain(&input, &mut |_| {}).err().map(|e| e.to_string()).unwrap_or_default()
    };
    assert!(refuse(&[]).contains("no recording"));
    let good = record(20.0, 20.0, 1, 23.0, &nothing);
    let mut unit = good.clone();
    unit.channels.get_mut("acc_1").unwrap().unit = "g".into();
    assert!(refuse(&[unit]).contains("is in \"g\""));
    let mut rate = good.clone();
    rate.channels.get_mut("acc_1").unwrap().sample_rate_hz = 5000.0;
    assert!(refuse(&[rate]).contains("5000 Hz"));
    let mut short = good.clone();
    short.channels.values_mut().for_each(|c| c.segments[0].samples.truncate(1000));
    assert!(refuse(&[short]).contains("revolutions"));
    let mut names = good.clone();
    names.channels = good.channels.into_iter().map(|(k, v)| (format!("other {k}"), v)).collect();
    assert!(refuse(&[names]).contains("none of its channels"));
}

/// Order 5 of the output shaft, 2.8 of the input and so of no other row: in proportion to the
/// torque it is the brake's, the same at both loads a speed that fluctuates. No reference is
/// needed.
#[test]
fn analytic_one_order_of_a_shaft_is_named_by_its_law_over_torque() {
    let points = [(20.0, 20.0), (20.0, 40.0), (30.0, 20.0), (30.0, 40.0)];
    let with = |size: &dyn Fn(f64) -> f64| -> Vec<Recording> {
        let one = |(i, &(speed, torque)): (usize, &(f64, f64))| {
            let amplitude = size(torque);
            let more = |_: usize, _: f64, angle: f64| amplitude * (TAU * 5.0 * 23.0 / 41.0 * angle).cos();
            record(speed, torque, 1 + i as u64, 23.0, &more)
        };
        points.iter().enumerate().map(one).collect()
    };
    let grows = ask(&with(&|torque| 0.015 * torque), &[]);
    assert_eq!(first(&grows), ("torque_ripple", "brake"), "{:?}", grows.steps);
    let stays = ask(&with(&|_| 0.4), &[]);
    assert_eq!(first(&stays), ("speed_fluctuation", "output"), "{:?}", stays.steps);
    assert!((stays.effects[0].parameters["order"].value() - 5.0).abs() < 0.5);
    assert!(ask(&session(1, 23.0, &nothing), &[]).effects.is_empty());
    // What the reference has too is nothing new.
    assert_eq!(ask(&with(&|_| 0.4), &with(&|_| 0.4)).status, Status::Consistent);
    let new = ask(&with(&|_| 0.4), &session(50, 23.0, &nothing));
    assert_eq!(first(&new), ("speed_fluctuation", "output"), "{:?}", new.steps);
    assert!(new.effects[0].evidence.support.contains("row"), "{:?}", new.effects[0].evidence);
}

/// 33 waves on the flanks of 23 teeth, without a reference: order 33 of the pinion stands above all
/// that lies between the mesh harmonics.
#[test]
fn analytic_one_order_between_the_mesh_harmonics_is_a_ghost() {
    let more = |_: usize, _: f64, angle: f64| 0.3 * (TAU * 33.0 * angle).cos();
    let answer = ask(&session(1, 23.0, &more), &[]);
    assert_eq!(first(&answer), ("ghost_component", "stage1.pinion"), "{:?}", answer.steps);
    let order = answer.effects[0].parameters["order"];
    assert!((order.value() - 33.0).abs() < 2.0 * order.sigma(), "{order:?}");
    // The tenth component of a pitch error stands beside every mesh harmonic alike.
    let pitch = |_: usize, _: f64, angle: f64| {
        let beside = [10.0, 13.0, 33.0, 36.0, 56.0, 59.0].map(|order: f64| (TAU * order * angle + order).cos());
        0.3 * beside.iter().sum::<f64>()
    };
    let answer = ask(&session(1, 23.0, &pitch), &[]);
    assert!(answer.effects.iter().all(|e| e.effect != "ghost_component"), "{:?}", answer.steps);
}

/// A push 3.72 times a turn of the input shaft, 6.63 of the output: both are usual races, and the
/// sensor that hears it more tells which.
#[test]
fn analytic_the_sensor_that_hears_a_bearing_more_tells_its_shaft() {
    let place = |loud: usize| {
        // Bursts of noise: no lines, all envelope.
        let more = move |c: usize, t: f64, angle: f64| {
            let since = (3.72 * angle).fract() / 3.72;
            let noise = (43_758.545 * (12.9898 * t * RATE_HZ).sin()).fract();
            (if c == loud { 2.0 } else { 0.7 }) * (-since / 0.03).exp() * noise
        };
        let mut bench = bench();
        bench.sensors[1].shaft = "output".into();
        let recordings = session(1, 23.0, &more);
        let input = Input { bench: &bench, recordings: &recordings, reference: &[], without: &[] };
        let answer = explain(&input, &mut |_| {}).unwrap().explanation;
        assert_eq!(first(&answer).0, "bearing_defect", "{:?}", answer.steps);
        first(&answer).1.to_owned()
    };
    assert_eq!((place(0).as_str(), place(1).as_str()), ("input", "output"));
}

/// Twelve multiples of order 3.43, each at five times the noise of its bin, a third of what a line
/// must have to be called new: together they are a bearing's. Lines as faint anywhere are not.
#[test]
fn analytic_faint_multiples_of_one_order_are_a_bearing() {
    // A Hann window of N samples puts a line of amplitude A at A² N / (6 σ²) of noise of variance
    // σ².
    let amplitude = (5.0 * 6.0 * (1.0 / 12.0) / SAMPLES as f64).sqrt();
    let lines = |orders: Vec<f64>| {
        move |_: usize, _: f64, angle: f64| -> f64 { orders.iter().map(|o| amplitude * (TAU * o * angle).cos()).sum() }
    };
    let before = session(50, 23.0, &nothing);
    let passages = lines((1..=12).map(|k| 3.43 * f64::from(k)).collect());
    let answer = ask(&session(1, 23.0, &passages), &before);
    let (effect, shaft) = first(&answer);
    assert_eq!(effect, "bearing_defect", "{:?}", answer.steps);
    // Races of either shaft may be passed so often.
    let turns = if shaft == "output" { 23.0 / 41.0 } else { 1.0 };
    let order = turns * answer.effects[0].parameters["order"].value();
    assert!((order / 3.43 - 1.0).abs() < 2e-3, "{order}");
    let anywhere = lines((1..=12).map(|k| 3.43 * f64::from(k) + (0.618 * f64::from(k * k)).fract()).collect());
    assert_eq!(ask(&session(1, 23.0, &anywhere), &before).status, Status::Consistent);
}

/// All speeds behind the display, without a tacho: by the same share at both loads the sample clock
/// is off, in proportion to the torque the belt slips. The recordings' speeds scatter by ±0.1 % as
/// those of a drive do.
#[test]
fn analytic_slip_grows_with_the_load_and_a_wrong_clock_does_not() {
    let belted = belted(2.0);
    let behind = |share: &dyn Fn(f64) -> f64| -> Explanation {
        let mut now = session(1, 23.0, &nothing);
        for point in now.iter_mut().flat_map(|r| &mut r.operating_points) {
            point.motor_speed_hz *= 2.0 / (1.0 - share(point.brake_torque_nm));
        }
        explain(&Input { bench: &belted, recordings: &now, reference: &[], without: &[] }, &mut |_| {})
            .unwrap()
            .explanation
    };
    let slips = behind(&|torque| 0.012 * torque / 40.0);
    assert_eq!(first(&slips), ("belt_slip", "belt"), "{:?}", slips.steps);
    let percent = slips.effects[0].parameters["slip_percent"];
    assert!((percent.value() - 1.2).abs() < 3.0 * percent.sigma(), "{percent:?}");
    let fast = behind(&|_| 0.006);
    assert_eq!(first(&fast), ("clock_offset", "acquisition"), "{:?}", fast.steps);
    let ppm = fast.effects[0].parameters["ppm"];
    assert!((ppm.value() - 1e6 * 0.006 / 0.994).abs() < 3.0 * ppm.sigma(), "{ppm:?}");
}

/// A sheet that says 2.5 for a belt of 2: named with the ratio that fits, and nothing else, without
/// a tacho. The sheet's own ratio gets no name.
#[test]
fn regress_a_wrong_belt_ratio_is_named() {
    let mut now = session(1, 23.0, &nothing);
    now.iter_mut().flat_map(|r| &mut r.operating_points).for_each(|point| point.motor_speed_hz *= 2.0);
    for (stated, named) in [(2.5, true), (1.3, true), (2.0, false)] {
        let belted = belted(stated);
        let input = Input { bench: &belted, recordings: &now, reference: &[], without: &[] };
        let Answer { explanation, bench } = explain(&input, &mut |_| {}).unwrap();
        let all: Vec<&str> = explanation.effects.iter().map(|e| e.effect.as_str()).collect();
        assert_eq!(all, if named { vec!["wrong_belt_ratio"] } else { vec![] }, "{stated}: {:?}", explanation.steps);
        if named {
            let ratio = explanation.effects[0].parameters["ratio"];
            assert!((ratio.value() - 2.0).abs() < 3.0 * ratio.sigma(), "{stated}: {ratio:?}");
            assert!((bench.belt.unwrap().ratio / 2.0 - 1.0).abs() < 0.01, "{stated}");
        }
    }
}

/// A sheet of 23 teeth for a pinion of 24, behind a belt of 2 that the sheet has right: another
/// ratio puts the mesh lines as well, but not the sidebands and orders of the input shaft.
#[test]
fn analytic_other_teeth_behind_a_belt_are_no_other_ratio() {
    let mut now = session(1, 24.0, &nothing);
    now.iter_mut().flat_map(|r| &mut r.operating_points).for_each(|point| point.motor_speed_hz *= 2.0);
    let belted = belted(2.0);
    let input = Input { bench: &belted, recordings: &now, reference: &[], without: &[] };
    let answer = explain(&input, &mut |_| {}).unwrap().explanation;
    assert_eq!(first(&answer), ("wrong_tooth_count", "stage1.pinion"), "{:?}", answer.steps);
    assert_eq!(answer.effects.len(), 1, "{:?}", answer.steps);
}

/// A component of order 200.37 lies below half the sample rate at 20 Hz and is folded at 30 Hz, in
/// one channel and without a reference.
#[test]
fn analytic_a_line_that_folds_at_one_speed_is_aliasing() {
    let folds = |channel: usize, _: f64, angle: f64| {
        if channel == 1 { 0.2 * (TAU * 200.37 * angle).cos() } else { 0.0 }
    };
    let answer = ask(&session(1, 23.0, &folds), &[]);
    assert_eq!(first(&answer), ("aliasing", "acc_2"), "{:?}", answer.steps);
}

/// The angle of the whole train swings at 3.7 Hz, at every speed and on both sensors: a speed that
/// fluctuates by 0.4 %, with and without a reference; a reference that swings alike says that
/// nothing is new.
#[test]
fn analytic_a_swing_of_fixed_frequency_is_a_speed_that_fluctuates() {
    let (hz, depth) = (3.7, 4e-3);
    // Samples are taken at the times at which a train that turns evenly has the angle of the one
    // that swings.
    let swung = |seed: u64| -> Vec<Recording> {
        let mut all = session(seed, 23.0, &nothing);
        for recording in &mut all {
            for channel in recording.channels.values_mut() {
                let even = channel.segments[0].samples.clone();
                let at = |n: usize| {
                    let t = n as f64 / RATE_HZ;
                    let position = (t + depth / (TAU * hz) * (TAU * hz * t).sin()) * RATE_HZ;
                    let k = (position.max(1.0) as usize).min(SAMPLES - 3);
                    let x = position - k as f64;
                    let [a, b, c, d] = [even[k - 1], even[k], even[k + 1], even[k + 2]];
                    b + 0.5 * x * (c - a + x * (2.0 * a - 5.0 * b + 4.0 * c - d + x * (3.0 * (b - c) + d - a)))
                };
                channel.segments[0].samples = (0..SAMPLES).map(at).collect();
            }
        }
        all
    };
    for reference in [Vec::new(), session(50, 23.0, &nothing)] {
        let answer = ask(&swung(1), &reference);
        assert_eq!(first(&answer), ("speed_fluctuation", "input"), "{:?}", answer.steps);
        let found = answer.effects[0].parameters["frequency_hz"];
        assert!((found.value() - hz).abs() < 3.0 * found.sigma(), "{found:?}");
        let percent = answer.effects[0].parameters["depth_percent"];
        assert!((percent.value() - 100.0 * depth).abs() < 2.0 * percent.sigma(), "{percent:?}");
    }
    assert_eq!(ask(&swung(1), &swung(50)).status, Status::Consistent);
}

/// Without a reference, behind a belt: what grows with the torque at the third order of the motor
/// is ripple of its torque, what stays a speed that fluctuates, by turns of the input shaft.
#[test]
fn analytic_orders_of_a_motor_behind_a_belt_need_no_reference() {
    let ratio = 2.07;
    let belted = belted(ratio);
    let of = |amplitude: &dyn Fn(f64, f64) -> f64| {
        let mut now = with_order(1, 3.0 * ratio, amplitude);
        now.iter_mut().flat_map(|r| &mut r.operating_points).for_each(|point| point.motor_speed_hz *= ratio);
        let input = Input { bench: &belted, recordings: &now, reference: &[], without: &[] };
        explain(&input, &mut |_| {}).unwrap().explanation
    };
    let growing = of(&|_, torque| 0.02 * torque);
    assert_eq!(first(&growing), ("torque_ripple", "motor"), "{:?}", growing.steps);
    assert_eq!(growing.effects[0].parameters["order"].value(), 3.0);
    let steady = of(&|_, _| 0.6);
    assert_eq!(first(&steady), ("speed_fluctuation", "input"), "{:?}", steady.steps);
    assert_eq!(steady.effects[0].parameters["order"].value(), 3.0 * ratio);
}

/// Without a reference: a shaft out of balance by 100 mm/s on a gearbox of 25 kg is named, one by
/// 6.3 mm/s is not; the first sidebands of the wheel far above the others are run-out.
#[test]
fn analytic_what_happens_once_a_turn_needs_no_reference() {
    let shaft = 23.0 / 41.0;
    let kg = turning_kg(&bench(), 1);
    // `a = m e ω² / M`, `G = e ω` at the highest speed.
    let heavy = |grade_mm_per_s: f64| {
        let eccentricity_m = 1e-3 * grade_mm_per_s / (TAU * shaft * 30.0);
        let force = move |speed: f64, _: f64| kg * eccentricity_m * (TAU * shaft * speed).powi(2) / DIRECT_PATH_MASS_KG;
        ask(&with_order(1, shaft, &force), &[])
    };
    let answer = heavy(100.0);
    assert_eq!(first(&answer), ("unbalance", "output"), "{:?}", answer.steps);
    assert!(answer.steps.iter().any(|s| s.contains("out of balance by 100")), "{:?}", answer.steps);
    assert_eq!(heavy(6.3).status, Status::Consistent);
    let eccentric = |_: usize, _: f64, angle: f64| {
        let sides = (1..=6).map(|h| {
            let mesh = 23.0 * f64::from(h);
            0.5 * ((TAU * (mesh - shaft) * angle).cos() + (TAU * (mesh + shaft) * angle + 1.0).cos())
        });
        sides.sum::<f64>()
    };
    let answer = ask(&session(1, 23.0, &eccentric), &[]);
    assert_eq!(first(&answer), ("eccentricity", "stage1.wheel"), "{:?}", answer.steps);
    assert_eq!(ask(&session(1, 23.0, &nothing), &[]).status, Status::Consistent);
}
