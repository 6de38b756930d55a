//! The past of a row as a page draws it: ranks, amplitudes and baseline over time, in columns. A
//! verdict in full is twenty times as large.

use std::collections::VecDeque;

use gearwatch_core::verdict::{HARMONICS, MachineState, Verdict};
use serde::{Serialize, Serializer};

/// Windows kept per bench, stage and channel for a page that opens later: an hour of two a second,
/// 0.5 MiB.
const KEPT: usize = 7200;

#[derive(Clone, Copy, Debug)]
struct Point {
    t0_ns: i64,
    machine: MachineState,
    level: [i8; HARMONICS],
    probability: [f32; HARMONICS],
    amplitude: [f32; HARMONICS],
    baseline: [f32; HARMONICS],
    deviation_sigma_percent: [f32; HARMONICS],
}

/// The windows of one row, oldest first.
#[derive(Clone, Debug, Default)]
pub(super) struct Past {
    unit: String,
    points: VecDeque<Point>,
}

impl Past {
    pub(super) fn push(&mut self, verdict: &Verdict) {
        verdict.unit.clone_into(&mut self.unit);
        self.keep(Point {
            t0_ns: verdict.t0,
            machine: verdict.machine,
            level: verdict.harmonics.map(|h| h.rank.level()),
            probability: verdict.harmonics.map(|h| h.rank_probability as f32),
            amplitude: verdict.harmonics.map(|h| h.amplitude.value as f32),
            baseline: verdict.harmonics.map(|h| h.baseline as f32),
            deviation_sigma_percent: verdict.harmonics.map(|h| h.deviation_percent.sigma as f32),
        });
    }

    fn keep(&mut self, point: Point) {
        // A replay that starts anew has no past.
        if self.points.back().is_some_and(|last| point.t0_ns < last.t0_ns) {
            self.points.clear();
        }
        if self.points.len() == KEPT {
            self.points.pop_front();
        }
        self.points.push_back(point);
    }

    /// The JSON object of a `past` event.
    pub(super) fn json(&self, (bench, stage, channel): &(String, String, String)) -> String {
        let column = |of: fn(&Point) -> &[f32; HARMONICS]| {
            std::array::from_fn(|k| self.points.iter().map(|p| Short(of(p)[k])).collect())
        };
        let columns = Columns {
            bench,
            stage,
            channel,
            unit: &self.unit,
            t0_ns: self.points.iter().map(|p| p.t0_ns).collect(),
            machine: self.points.iter().filter_map(|p| p.machine.code().chars().next()).collect(),
            level: std::array::from_fn(|k| self.points.iter().map(|p| letter(p.level[k])).collect()),
            p: column(|p| &p.probability),
            amp: column(|p| &p.amplitude),
            base: column(|p| &p.baseline),
            sigma: column(|p| &p.deviation_sigma_percent),
        };
        serde_json::to_string(&columns).unwrap_or_default()
    }
}

/// `?` unknown, else the digit.
fn letter(level: i8) -> char {
    u8::try_from(level).map_or('?', |level| char::from(b'0' + level.min(9)))
}

#[derive(Serialize)]
struct Columns<'a> {
    bench: &'a str,
    stage: &'a str,
    channel: &'a str,
    unit: &'a str,
    t0_ns: Vec<i64>,
    /// The first letter of the machine's state, one a window.
    machine: String,
    /// One letter a window.
    level: [String; HARMONICS],
    p: [Vec<Short>; HARMONICS],
    amp: [Vec<Short>; HARMONICS],
    base: [Vec<Short>; HARMONICS],
    sigma: [Vec<Short>; HARMONICS],
}

/// Written with five significant digits, finer than a screen can show; `null` where it is not a
/// number.
struct Short(f32);

impl Serialize for Short {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let value = f64::from(self.0);
        if value == 0.0 || !value.is_finite() {
            return if value == 0.0 { to.serialize_u8(0) } else { to.serialize_none() };
        }
        let exponent = 4 - value.abs().log10().floor() as i32;
        // Dividing by a power of ten, not multiplying by its inverse, gives the double nearest to
        // the short decimal.
        let rounded = if exponent >= 0 {
            let scale = 10_f64.powi(exponent);
            (value * scale).round() / scale
        } else {
            let scale = 10_f64.powi(-exponent);
            (value / scale).round() * scale
        };
        to.serialize_f64(rounded)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conform_numbers_are_short_and_unknown_is_null() {
        let written = |value: f32| serde_json::to_string(&Short(value)).expect("a number");
        assert_eq!(written(0.056_639_856), "0.05664");
        assert_eq!(written(-1_234_567.0), "-1234600.0");
        assert_eq!(written(0.0), "0");
        assert_eq!(written(f32::NAN), "null");
        assert_eq!(written(f32::INFINITY), "null");
    }

    #[test]
    fn conform_the_past_is_bounded_and_starts_anew_with_a_replay() {
        let mut past = Past::default();
        let unknown = [f32::NAN; HARMONICS];
        let at = |t0_ns| Point {
            t0_ns,
            machine: MachineState::Unknown,
            level: [-1; HARMONICS],
            probability: unknown,
            amplitude: unknown,
            baseline: unknown,
            deviation_sigma_percent: unknown,
        };
        for t0 in 0..KEPT as i64 + 3 {
            past.keep(at(t0));
        }
        assert_eq!(past.points.len(), KEPT);
        assert_eq!(past.points.front().map(|p| p.t0_ns), Some(3));
        past.keep(at(1));
        let key = ("bench".to_owned(), "stage1".to_owned(), "acc".to_owned());
        let object: serde_json::Value = serde_json::from_str(&past.json(&key)).expect("JSON");
        assert_eq!(object["t0_ns"], serde_json::json!([1]));
        assert_eq!(object["level"][4], "?");
        assert_eq!(object["machine"], "u");
        assert_eq!(object["p"][0], serde_json::json!([null]));
        assert_eq!(object["amp"][0], serde_json::json!([null]));
        assert_eq!(object["channel"], "acc");
    }
}
