//! What the sheet says by itself: lines beyond the band of the acquisition, lines that coincide, a
//! speed that looks like rpm.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;
use gearwatch_core::verdict::HARMONICS;

use crate::{Finding, Look, Severity};

/// Anti-aliasing filters of instruments begin to fall here, and what lies above the second is
/// filtered in all of them (shares of the rate).
const FILTER_BEGINS: f64 = 0.39;
const FILTERED: f64 = 0.45;
/// Lines closer than this to each other fall together in a window of a second (Hz): the main lobe
/// of its spectrum.
const TOGETHER_HZ: f64 = 2.0;
/// A motor that turns faster than this (Hz) is rare, and its speed in rpm is common.
pub(crate) const FAST_MOTOR_HZ: f64 = 400.0;

/// The fastest input shaft that is stated (Hz): by the recordings, else by the sheet.
fn fastest_input_hz(train: &Train, looks: &[Look]) -> f64 {
    let points = looks.iter().flat_map(|look| &look.recording.operating_points);
    let stated = points.map(|point| point.motor_speed_hz).filter(|hz| hz.is_finite() && *hz > 0.0);
    stated.map(|hz| hz / train.motor_order).reduce(f64::max).unwrap_or(train.nominal_input_hz)
}

/// The lowest sample rate of the recordings, else that of the sheet (Hz).
fn rate_hz(bench: &Bench, looks: &[Look]) -> f64 {
    let rates = looks.iter().flat_map(|look| look.channels.values()).map(|channel| channel.sample_rate_hz);
    rates.reduce(f64::min).unwrap_or(bench.acquisition.sample_rate_hz)
}

pub(crate) fn findings(bench: &Bench, looks: &[Look]) -> Vec<Finding> {
    let train = Train::new(bench);
    let input_hz = fastest_input_hz(&train, looks);
    let rate = rate_hz(bench, looks);
    let mut out = Vec::new();
    out.extend(units(bench, &train, input_hz, rate));
    out.extend(band(&train, input_hz, rate));
    out.extend(coinciding(&train, input_hz));
    out
}

/// A motor speed that puts even the mesh frequency beyond the band, and as rpm does not: `said`
/// where it stands, `option` how it is written as rpm.
fn unit(train: &Train, motor_hz: f64, rate: f64, said: &str, option: &str) -> Option<Finding> {
    let lowest = train.stages.iter().map(|stage| stage.mesh_order).reduce(f64::min)?;
    let mesh_hz = lowest * motor_hz / train.motor_order;
    (motor_hz > FAST_MOTOR_HZ && mesh_hz > FILTERED * rate && mesh_hz / 60.0 < FILTERED * rate).then(|| Finding {
        id: "speed_unit",
        severity: Severity::Wrong,
        recording: String::new(),
        place: "motor".into(),
        found: format!("{said}, which puts the lowest mesh frequency at {mesh_hz:.0} Hz"),
        expected: format!("a mesh frequency below {:.0} Hz, {FILTERED} of the sample rate", FILTERED * rate),
        advice: format!("as rpm it is {:.4} Hz: write {option}", motor_hz / 60.0),
    })
}

/// The same of the nominal speed, and of the fastest that is stated for a recording.
fn units(bench: &Bench, train: &Train, input_hz: f64, rate: f64) -> Vec<Finding> {
    let nominal = bench.motor.speed_hz;
    // As it was typed: the way through the belt's ratio leaves the last digits of a double.
    let stated = (1e9 * input_hz * train.motor_order).round() / 1e9;
    let of_sheet = unit(train, nominal, rate, &format!("speed_hz = {nominal}"), &format!("speed_rpm = {nominal}"));
    let of_recording =
        || unit(train, stated, rate, &format!("a motor speed of {stated} Hz is stated"), &format!("{stated}rpm"));
    of_sheet.into_iter().chain(if stated == nominal { None } else { of_recording() }).collect()
}

fn band(train: &Train, input_hz: f64, rate: f64) -> Vec<Finding> {
    let mut out = Vec::new();
    for stage in &train.stages {
        let hz = |k: usize| stage.harmonic_order(k) * input_hz;
        let above = |limit: f64| (1..=HARMONICS).find(|k| hz(*k) > limit * rate);
        let needed = hz(HARMONICS) / FILTER_BEGINS;
        let found = |k: usize, limit: f64| {
            format!("{k}x lies at {:.0} Hz, above {limit} of the sample rate of {rate} Hz", hz(k))
        };
        let (severity, found, advice) = match (above(FILTERED), above(FILTER_BEGINS)) {
            (Some(1), _) => (
                Severity::Wrong,
                found(1, FILTERED),
                format!(
                    "no line of this stage can be judged: record at {needed:.0} Hz or more, or correct speed and teeth"
                ),
            ),
            (Some(k), _) => (
                Severity::Doubtful,
                found(k, FILTERED),
                format!("it and what lies above is not judged: record at {needed:.0} Hz or more"),
            ),
            (None, Some(k)) => (
                Severity::Note,
                found(k, FILTER_BEGINS),
                format!("the anti-alias filter may take part of it: record at {needed:.0} Hz or more"),
            ),
            (None, None) => continue,
        };
        out.push(Finding {
            id: "band",
            severity,
            recording: String::new(),
            place: stage.name.clone(),
            found,
            expected: format!("1x to 5x below {:.0} Hz", FILTER_BEGINS * rate),
            advice,
        });
    }
    out
}

fn coinciding(train: &Train, input_hz: f64) -> Vec<Finding> {
    let mut out = Vec::new();
    for (i, a) in train.stages.iter().enumerate() {
        for b in &train.stages[i + 1..] {
            for (k, m) in (1..=HARMONICS).flat_map(|k| (1..=HARMONICS).map(move |m| (k, m))) {
                let apart_hz = (a.harmonic_order(k) - b.harmonic_order(m)).abs() * input_hz;
                if apart_hz < TOGETHER_HZ {
                    out.push(Finding {
                        id: "coinciding_lines",
                        severity: Severity::Note,
                        recording: String::new(),
                        place: format!("{} and {}", a.name, b.name),
                        found: format!("{k}x of the one and {m}x of the other are {apart_hz:.2} Hz apart"),
                        expected: format!("{TOGETHER_HZ} Hz or more, which a window of a second tells apart"),
                        advice: "both show the sum, and are marked `shared` in every verdict: judge by the other lines"
                            .into(),
                    });
                }
            }
        }
    }
    out
}
