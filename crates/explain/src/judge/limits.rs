//! What the recordings keep from being told: settings that are missing, channels and recordings
//! that could not be used.

use gearwatch_core::recording::Recording;

use crate::judge::report::{Explanation, NamedEffect};
use crate::read::features::{RecordingFeatures, Steady};

/// Speeds and loads count as one within these relative differences.
const ONE_SPEED: f64 = 0.05;
const ONE_LOAD: f64 = 0.2;

fn spread(values: &[f64]) -> Option<f64> {
    let (low, high) = values.iter().fold((f64::INFINITY, 0.0f64), |(l, h), v| (l.min(*v), h.max(*v)));
    (!values.is_empty()).then(|| high / low - 1.0)
}

/// Missing settings of the recordings that are judged.
pub fn settings(recordings: &[RecordingFeatures]) -> Vec<String> {
    let mut out = Vec::new();
    let speeds: Vec<f64> = recordings.iter().map(|r| r.input_hz).collect();
    if spread(&speeds).is_some_and(|s| s < ONE_SPEED) {
        out.push(format!(
            "one speed ({:.1} Hz at the input shaft): a change of the sensor path is told from one of the gears by the background alone, not by frequency",
            speeds[0]
        ));
    }
    let torques: Vec<f64> = recordings.iter().map(|r| r.brake_torque_nm).filter(|t| t.is_finite()).collect();
    if torques.len() < recordings.len() {
        let silent: Vec<&str> =
            recordings.iter().filter(|r| !r.brake_torque_nm.is_finite()).map(|r| r.name.as_str()).collect();
        out.push(format!("no brake torque is stated in {}: no law of load there", silent.join(", ")));
    }
    if !torques.is_empty() && spread(&torques).is_some_and(|s| s < ONE_LOAD) {
        out.push(format!("one load ({:.0} N m): what grows with the torque is not told from geometry", torques[0]));
    }
    let silent: Vec<String> = recordings
        .iter()
        .filter(|r| !r.display_motor_hz.is_finite())
        .map(|r| format!("{} ({:.2} Hz at the input shaft)", r.name, r.input_hz))
        .collect();
    if !silent.is_empty() {
        out.push(format!(
            "no motor speed was measured (none is stated, or exactly the nominal one), it was read from the mesh lines: {}; slip and clock are not judged there",
            silent.join(", ")
        ));
    }
    out
}

/// Why the recordings are judged without a reference, where some was given.
pub fn unmatched(recordings: &[RecordingFeatures], references: &[RecordingFeatures]) -> String {
    if references.is_empty() {
        return "none of the reference recordings can be used: judged without a reference".into();
    }
    format!(
        "no reference matches a recording in speed (3 %) and load (5 %), so it was judged without: recorded at {}, the reference at {}",
        points(recordings),
        points(references)
    )
}

/// Speeds and loads in words.
fn points(recordings: &[RecordingFeatures]) -> String {
    let mut all: Vec<String> =
        recordings.iter().map(|r| format!("{:.1} Hz {:.0} N m", r.input_hz, r.brake_torque_nm)).collect();
    all.dedup();
    all.join(", ")
}

/// Channels of a judged recording that stand still: a cable that is off, a sensor without supply.
pub fn dead_channels(recording: &Recording, steady: &Steady<'_>, sensors: &[String]) -> Vec<String> {
    sensors
        .iter()
        .filter(|s| recording.channels.contains_key(*s) && !steady.channels.iter().any(|c| c.0 == s.as_str()))
        .map(|s| {
            format!(
                "{}: channel {s} stands still for most of it and was left out; check cable and supply",
                recording.name
            )
        })
        .collect()
}

/// Channels whose source flagged an overload although no samples pile up at a limit: an amplifier
/// ahead of the converter, or a filter behind it.
pub fn overloads(recordings: &[RecordingFeatures]) -> Vec<String> {
    let mut out = Vec::new();
    for r in recordings {
        for c in r.channels.iter().filter(|c| c.integrity.overload && c.integrity.clipped_at.is_none()) {
            out.push(format!("{}: the acquisition flagged an overload of {}; lines may be distorted", r.name, c.name));
        }
    }
    out
}

/// What was named and kept lines from being compared with the reference.
pub fn not_compared(e: &Explanation) -> Vec<String> {
    let sentence = |n: &NamedEffect| match n.effect.as_str() {
        "clipping" => Some(format!(
            "clipping of {}: its lines were not compared with the reference; mend it, and record again",
            n.place
        )),
        "belt_slip" => Some(
            "belt_slip: at another speed lines were not compared with the reference; mend it, and record again".into(),
        ),
        _ => None,
    };
    e.effects.iter().filter_map(sentence).collect()
}
