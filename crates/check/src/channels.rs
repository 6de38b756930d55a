//! Channels that are missing, faulty or in another unit; rates that contradict; a load that is not
//! stated.

use gearwatch_core::baseline::Baseline;
use gearwatch_core::bench::Bench;
use gearwatch_core::health::sample_state;
use gearwatch_core::verdict::InstrumentState;

use crate::look::LookChannel;
use crate::{Finding, Look, Severity};

/// Rates that differ by less are the same (relative): clocks of instruments are off by some 10 ppm,
/// and text files round.
const SAME_RATE: f64 = 0.01;
/// What time stamps may be off (relative, and s): those of a PC come late by some milliseconds.
const STAMP_DRIFT: f64 = 1e-3;
const STAMP_JITTER_S: f64 = 0.02;
/// Length of the pieces whose samples are looked at (s).
const PIECE_S: f64 = 1.0;
/// An offset of so many standard deviations is a wrong bias, as in the pipeline.
const LARGEST_OFFSET: f64 = 10.0;

pub(crate) fn findings(bench: &Bench, look: &Look, baseline: Option<&Baseline>) -> Vec<Finding> {
    let mut out = Vec::new();
    out.extend(missing(bench, look));
    for (name, channel) in &look.channels {
        out.extend(unit(bench, look, name, channel));
        out.extend(samples(look, name, channel));
    }
    out.extend(rates(look));
    out.extend(torque(look, baseline));
    out
}

/// The sheet's rate against the recordings', where they differ.
pub(crate) fn other_rate(bench: &Bench, look: &Look) -> Option<(f64, f64)> {
    let sheet = bench.acquisition.sample_rate_hz;
    let rates = look.channels.values().map(|channel| channel.sample_rate_hz);
    rates.into_iter().find(|rate| (rate / sheet - 1.0).abs() > SAME_RATE).map(|rate| (rate, sheet))
}

fn finding(look: &Look, id: &'static str, place: &str, found: String, expected: String, advice: &str) -> Finding {
    Finding {
        id,
        severity: Severity::Doubtful,
        recording: look.name().to_owned(),
        place: place.to_owned(),
        found,
        expected,
        advice: advice.to_owned(),
    }
}

fn missing(bench: &Bench, look: &Look) -> Vec<Finding> {
    let there: Vec<&str> = look.channels.keys().map(String::as_str).collect();
    let absent = bench.sensors.iter().filter(|sensor| !look.channels.contains_key(&sensor.name));
    absent
        .map(|sensor| {
            let found = format!("no channel of this name; there are {}", there.join(", "));
            let advice = format!("check cable and set-up, or name a column: --channel {}=COLUMN", sensor.name);
            finding(look, "channel_missing", &sensor.name, found, "a channel for each [[sensor]]".into(), &advice)
        })
        .collect()
}

fn unit(bench: &Bench, look: &Look, name: &str, channel: &LookChannel) -> Option<Finding> {
    let sensor = bench.sensors.iter().find(|sensor| sensor.name == name)?;
    (*channel.unit != *sensor.unit).then(|| {
        let found = format!("its values are in {:?}", &*channel.unit);
        let expected = format!("{:?}, as the bench file says", sensor.unit);
        finding(look, "unit", name, found, expected, "correct one of them (--unit, [[sensor]] unit)")
    })
}

/// What the samples show of the instrument, second by second.
fn samples(look: &Look, name: &str, channel: &LookChannel) -> Option<Finding> {
    let piece = ((PIECE_S * channel.sample_rate_hz) as usize).clamp(64, 1 << 16);
    let mut states: Vec<(InstrumentState, usize)> = Vec::new();
    let mut all = 0;
    let mut values = Vec::with_capacity(piece);
    for piece in channel.runs.iter().flat_map(|run| run.samples.chunks_exact(piece)) {
        all += 1;
        values.clear();
        values.extend(piece.iter().map(|x| f64::from(*x)));
        let state = sample_state(&values, LARGEST_OFFSET);
        match states.iter_mut().find(|(known, _)| *known == state) {
            _ if state == InstrumentState::Ok => {}
            Some((_, count)) => *count += 1,
            None => states.push((state, 1)),
        }
    }
    let &(state, count) = states.iter().max_by_key(|(_, count)| *count)?;
    let found = format!("{count} of {all} seconds are {}", state.code());
    let mut finding = finding(
        look,
        state.code(),
        name,
        found,
        "samples of a sound instrument".into(),
        "no rank is given for such windows; check sensor, cable, range and driver",
    );
    if 2 * count < all {
        finding.severity = Severity::Note;
    }
    Some(finding)
}

fn rates(look: &Look) -> Option<Finding> {
    look.stamped_rates().find_map(|(sensor, rate)| {
        let off_s = (rate.stamped_hz / rate.stated_hz - 1.0).abs() * rate.span_s;
        (off_s > STAMP_DRIFT * rate.span_s + STAMP_JITTER_S).then(|| {
            let found = format!("the time stamps of {:.1} s say {:.6} samples a second", rate.span_s, rate.stamped_hz);
            let expected = format!("{} Hz, as the recording states", rate.stated_hz);
            finding(look, "time_stamps", sensor, found, expected, "correct the stated rate, or the clock that stamps")
        })
    })
}

fn torque(look: &Look, baseline: Option<&Baseline>) -> Option<Finding> {
    if look.torques().next().is_some() || look.channels.is_empty() {
        return None;
    }
    let expected = match baseline.map(|b| b.runs.iter().any(|run| run.brake_torque_nm.is_some())) {
        Some(true) => "the torque at the brake, by which the baseline tells loads apart",
        _ => "the torque at the brake: load alone moves a line by up to 10 dB",
    };
    let advice = "state it: --torque, brake_torque_nm in the sidecar file, or /operating_point";
    Some(finding(look, "torque_missing", "brake", "no torque is stated".into(), expected.into(), advice))
}
