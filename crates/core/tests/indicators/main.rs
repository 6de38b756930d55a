//! Condition indicators against an independent implementation: `reference.json`, made by
//! `reference.py` beside it.

#![allow(clippy::print_stderr, reason = "how near the two implementations are, and what was skipped")]

use std::io::Read;
use std::path::{Path, PathBuf};

use flate2::read::GzDecoder;
use gearwatch_core::indicators::envelope::EnvelopeState;
use gearwatch_core::indicators::plan::{IndicatorState, Known};
use gearwatch_core::indicators::velocity::Weighted;
use gearwatch_core::indicators::{ChannelIndicator, GearIndicator, Indicators};
use gearwatch_core::spectral::angle::AngleTrack;
use gearwatch_core::spectral::kaiser::KaiserWindow;
use gearwatch_core::train::{StageKinematics, Train};
use num_complex::Complex64;
use serde_json::Value;

/// Relative. What differs is the order of sums, and the table of the interpolation (1e-7 a tap).
const TOLERANCE: f64 = 1e-6;

/// Of the signal's rms, added to the relative one: a line far below the mesh lines has their share
/// of the table's error.
const OF_RMS: f64 = 1e-9;

/// Half width of the main lobe that windows are weighted with before the transform (bins): that of
/// the signal path.
const WEIGHTING: f64 = 1.4;

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is not a number"))
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("a list").iter().map(number).collect()
}

fn train(case: &Value) -> Train {
    let mut order = 1.0;
    let (mut shafts, mut stages) = (vec![("shaft0".to_owned(), 1.0)], Vec::new());
    for (i, teeth) in case["teeth"].as_array().expect("teeth").iter().enumerate() {
        let [pinion, wheel] = [0, 1].map(|k| number(&teeth[k]) as u32);
        let stage = StageKinematics::pair(&format!("stage{i}"), pinion, wheel, order);
        order = stage.wheel_order;
        stages.push(stage);
        shafts.push((format!("shaft{}", i + 1), order));
    }
    Train { motor_order: 1.0, shafts, stages, nominal_input_hz: 25.0 }
}

/// The signal of a made case.
fn made(case: &Value, track: &AngleTrack) -> Vec<f64> {
    let n = number(&case["samples"]) as usize;
    let tones: Vec<Vec<f64>> = case["tones"].as_array().expect("tones").iter().map(numbers).collect();
    let bursts: Vec<Vec<f64>> = case["bursts"].as_array().expect("bursts").iter().map(numbers).collect();
    let value = |i: usize| {
        let angle = track.at(i as f64 / n as f64 - 0.5);
        let mut x = number(&case["offset"]);
        for t in &tones {
            x += t[1] * (std::f64::consts::TAU * t[0] * angle + t[2]).cos();
        }
        for b in &bursts {
            let turn = (b[0] * angle).rem_euclid(1.0);
            x += b[1] * (-turn / b[2]).exp() * (std::f64::consts::TAU * b[3] * turn).sin();
        }
        x + number(&case["noise"]) * ((i as f64 * 0.754_877_666_2 + 0.1).sin() * 43_758.545_3).fract()
    };
    (0..n).map(value).collect()
}

/// Transform of the weighted window, term by term of a plain FFT.
fn transform(samples: &[f64], window: &KaiserWindow) -> Vec<Complex64> {
    let plan = realfft::RealFftPlanner::new().plan_fft_forward(samples.len());
    let mut input: Vec<f64> = samples.iter().zip(&window.coefficients).map(|(x, w)| x * w).collect();
    let mut out = plan.make_output_vec();
    plan.process(&mut input, &mut out).expect("lengths fit");
    out
}

/// Largest relative difference; each value and each sigma of a case.
fn compare(case: &Value, samples: &[f64], track: &AngleTrack) -> f64 {
    let train = train(case);
    let rate_hz = number(&case["sample_rate_hz"]);
    let window = KaiserWindow::new(samples.len(), WEIGHTING);
    let bins = transform(samples, &window);
    let mut state = IndicatorState::default();
    let mut found = Indicators::unknown(train.stages.len());
    let spectrum = Weighted {
        bins: &bins,
        samples: samples.len(),
        sum_squares: window.sum_squares,
        sum: window.sum,
        sample_rate_hz: rate_hz,
    };
    let known = Known { unit: case["unit"].as_str().expect("a unit"), spectrum, usable_band: 0.45 };
    state.channel(samples, &known, &mut found);
    state.gears(&train, samples, track, &mut found);

    let floor = OF_RMS * found.get(ChannelIndicator::Rms).value;
    let mut worst: f64 = 0.0;
    let mut check = |what: String, found: [f64; 2], wanted: &Value| {
        if wanted.is_null() {
            assert!(found[0].is_nan(), "{what} is {found:?}, and should not be known");
            return;
        }
        for (found, wanted) in found.into_iter().zip(numbers(wanted)) {
            let off = (found - wanted).abs();
            assert!(off < TOLERANCE * wanted.abs() + floor, "{what}: {found} and {wanted}");
            worst = worst.max(off / wanted.abs());
        }
    };
    for which in ChannelIndicator::ALL {
        let x = found.get(which);
        check(format!("{} {}", case["name"], which.name()), [x.value, x.sigma], &case["signal"][which.name()]);
    }
    for (stage, gears) in found.gears.iter().enumerate() {
        for (gear, side) in gears.iter().zip(["pinion", "wheel"]) {
            let wanted = &case["gears"][format!("{stage}.{side}")];
            assert_eq!(f64::from(gear.revolutions), wanted["revolutions"].as_f64().unwrap_or(0.0));
            for which in GearIndicator::ALL {
                let x = gear.get(which);
                let what = format!("{} {stage}.{side} {}", case["name"], which.name());
                check(what, [x.value, x.sigma], &wanted[which.name()]);
            }
        }
    }
    let band = numbers(&case["envelope"]["band_hz"]);
    let mut envelope = EnvelopeState::new(samples.len());
    envelope.transform(samples);
    assert!(envelope.envelope([band[0], band[1]], rate_hz, track));
    let orders = numbers(&case["envelope"]["orders"]);
    for (order, wanted) in orders.iter().zip(case["envelope"]["depths"].as_array().expect("depths")) {
        let line = envelope.line(*order, track.revolutions());
        check(format!("{} envelope at {order}", case["name"]), [line.depth.value, line.floor], wanted);
    }
    worst
}

fn reference() -> Value {
    serde_json::from_str(include_str!("reference.json")).expect("JSON")
}

fn track(case: &Value) -> AngleTrack {
    let mut track = AngleTrack::default();
    track.set_polynomial(&numbers(&case["angle"]));
    track
}

fn columns(path: &Path) -> Vec<Vec<f64>> {
    let mut text = String::new();
    GzDecoder::new(std::fs::File::open(path).expect("the file opens")).read_to_string(&mut text).expect("gzip text");
    let mut out: Vec<Vec<f64>> = Vec::new();
    for line in text.lines().skip(1) {
        for (i, field) in line.split(',').enumerate() {
            if out.len() <= i {
                out.push(Vec::new());
            }
            out[i].push(f64::from(field.trim().parse::<f32>().expect("a number")));
        }
    }
    out
}

/// Two stages whose shafts share points and two whose do not, ramps, bursts, all units: every
/// value, sigma and revolution count.
#[test]
fn oracle_scipy_made_signals() {
    let reference = reference();
    let cases = reference["made"].as_array().expect("cases");
    assert_eq!(cases.len(), 5);
    for case in cases {
        let track = track(case);
        let worst = compare(case, &made(case, &track), &track);
        eprintln!("{}: {worst:.1e}", case["name"]);
    }
}

/// A healthy and a cracked gear of the simulator.
#[test]
fn oracle_scipy_simulated_recordings() {
    let reference = reference();
    let columns = columns(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/indicators/simulated.csv.gz")));
    let cases = reference["simulated"].as_array().expect("cases");
    assert_eq!(cases.len(), columns.len());
    for (case, samples) in cases.iter().zip(&columns) {
        let worst = compare(case, samples, &track(case));
        eprintln!("{}: {worst:.1e}", case["name"]);
    }
}

/// Windows of real recordings of a healthy and a broken gear, four channels each.
#[test]
fn oracle_scipy_real_recordings() {
    let folder = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/gfd_spectraquest"));
    if !folder.is_dir() {
        eprintln!("skipped: there is no {}", folder.display());
        return;
    }
    let reference = reference();
    let cases = reference["recorded"].as_array().expect("cases");
    assert_eq!(cases.len(), 8);
    for case in cases {
        let path = folder.join(format!("{}.csv.gz", case["file"].as_str().expect("a name")));
        let channel = number(&case["channel"]) as usize;
        let samples = &columns(&path)[channel][..number(&case["samples"]) as usize];
        let worst = compare(case, samples, &track(case));
        eprintln!("{} channel {channel}: {worst:.1e}", case["file"]);
    }
}
