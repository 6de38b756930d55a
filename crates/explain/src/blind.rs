//! What a campaign of recordings could not show: for each effect of the library the smallest size
//! that stands out, told without any data.
//!
//! A bench with the usual errors (`prove`) is solved at every operating point, once as it is, once
//! at settings that are off by as much as settings repeat, and once with an effect. The change of a
//! group of lines (ln, root mean square) over what repetition changes, `0.04` at least, is how
//! plain the effect is; from four on the finder names effects reliably. Sizes are searched for that
//! figure.
//!
//! Without a reference each line has a gain of its own that nobody knows, the same at all loads of
//! one speed. What is left of the change when the mean over loads is taken off is given beside:
//! effects with nothing left are invisible without a reference, however large.

mod campaign;

use gearwatch_core::bench::{Bench, EffectSpec};
use gearwatch_sim::effects::{self, Place};

use self::campaign::Campaign;
use crate::error::ExplainError;

/// A setting at which is recorded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Motor speed (Hz).
    pub motor_hz: f64,
    /// Torque at the brake (N m).
    pub torque_nm: f64,
}

/// What the campaign shows of an effect at a place.
#[derive(Clone, Debug, PartialEq)]
pub enum Shows {
    /// From this size on.
    From {
        /// The parameter that says how large the effect is.
        parameter: &'static str,
        /// Its least value that stands out.
        value: f64,
        /// The lines that show it best.
        lines: String,
        /// Share of the change that an unknown path leaves; `None` where no speed has two loads.
        without_reference: Option<f64>,
    },
    /// Not even the largest size of the library: how plain that is (four is enough).
    Not {
        /// Change over repetition.
        plain: f64,
    },
    /// Not judged by lines of the steady state; in words what it takes.
    Words(&'static str),
}

/// One effect at one place.
#[derive(Clone, Debug, PartialEq)]
pub struct BlindSpot {
    /// Effect id.
    pub effect: &'static str,
    /// Place.
    pub place: String,
    /// What the campaign shows of it.
    pub shows: Shows,
}

/// Effects that are found otherwise than by comparing lines.
const WORDS: &[(&str, &str)] = &[
    ("backlash", "nothing changes while the teeth stay loaded: record a load near zero, where they part"),
    (
        "bearing_defect",
        "its order must stand 8 standard scores above the envelope's scatter with a reference, 10.5 without: depends on the noise",
    ),
    ("structural_resonance", "needs a reference, and lines and background that change alike at two speeds"),
    ("sensor_mounting", "needs a reference, and lines and background that change alike at two speeds"),
    (
        "belt_slip",
        "0.25 % off the drive's display in one recording, half of that in four; a tacho tells it from the clock",
    ),
    (
        "electrical_pickup",
        "a line 20 times the local noise power at two speeds that differ by 5 %, on one sensor alone",
    ),
    ("clock_offset", "60 ppm with a tacho, about 2000 ppm without"),
    ("clipping", "samples that pile up at a limit"),
    (
        "aliasing",
        "a line at the same place on one sensor at two speeds; one that moves against the speed is not looked for",
    ),
    ("wrong_tooth_count", "one tooth, from two recordings with clear mesh lines and sidebands"),
    ("scaling", "needs a reference: a factor beyond 1.16 or below 0.86"),
];

/// The settings of a campaign when none are given: nominal and six tenths of the speed, nominal and
/// four tenths of the load.
pub fn usual_points(bench: &Bench) -> Vec<Point> {
    let (speed, torque) = (bench.motor.speed_hz, bench.brake.torque_nm);
    [0.6 * speed, speed]
        .into_iter()
        .flat_map(|motor_hz| [0.4 * torque, torque].map(|torque_nm| Point { motor_hz, torque_nm }))
        .collect()
}

/// What recordings at these settings show of every effect of the library for which `wanted` holds,
/// in the library's order.
///
/// # Errors
/// When the bench cannot be used, or has no steady state at these settings.
pub fn blind_spots(
    bench: &Bench,
    points: &[Point],
    wanted: &dyn Fn(&str) -> bool,
    progress: &mut dyn FnMut(&str),
) -> Result<Vec<BlindSpot>, ExplainError> {
    let problems = bench.problems();
    if !problems.is_empty() {
        return Err(ExplainError::Bench(problems.join("; ")));
    }
    let mut campaign = Campaign::new(bench, points).ok_or_else(|| {
        ExplainError::Bench("no steady state at these speeds and loads: the teeth part; try a larger load".into())
    })?;
    if campaign.errors < 1.0 {
        progress(&format!(
            "teeth with {:.0} % of the usual errors: with more they part at these loads",
            100.0 * campaign.errors
        ));
    }
    let mut out = Vec::new();
    for effect in effects::ALL.iter().filter(|e| wanted(e.id())) {
        progress(effect.id());
        for (place, _) in Place::of(*effect, bench) {
            let words = WORDS.iter().find(|w| w.0 == effect.id());
            let shows = match words {
                Some((_, words)) => Shows::Words(words),
                None => {
                    let known = effect.parameters();
                    let by_order = known.iter().any(|p| p.name == "order");
                    let parameters = known
                        .iter()
                        .filter(|p| !(by_order && p.name == "frequency_hz"))
                        // A factor of 1 changes nothing, and no power of it does.
                        .map(|p| {
                            (p.name.to_owned(), if p.name == "factor" && p.typical == 1.0 { 0.5 } else { p.typical })
                        })
                        .collect();
                    let spec = EffectSpec { effect: effect.id().into(), place: place.clone(), parameters };
                    if effects::resolve(&spec, bench).is_err() {
                        continue;
                    }
                    campaign.smallest(spec, bench)
                }
            };
            out.push(BlindSpot { effect: effect.id(), place, shows });
        }
    }
    Ok(out)
}

/// What more to record, from the settings alone.
pub fn advice(bench: &Bench, points: &[Point]) -> Vec<String> {
    let spread = |values: Vec<f64>| {
        let (low, high) = values.iter().fold((f64::INFINITY, 0.0f64), |(l, h), v| (l.min(*v), h.max(*v)));
        high / low
    };
    let mut out = Vec::new();
    if spread(points.iter().map(|p| p.motor_hz).collect()) < 1.5 {
        out.push(format!(
            "record a second speed, {:.0} Hz or {:.0} Hz: only speeds tell a sensor path from the gears",
            0.6 * bench.motor.speed_hz,
            bench.motor.speed_hz
        ));
    }
    if spread(points.iter().map(|p| p.torque_nm).collect()) < 2.0 {
        out.push(format!(
            "record a second load, {:.0} N m or {:.0} N m: only loads tell stiffness from geometry",
            0.4 * bench.brake.torque_nm,
            bench.brake.torque_nm
        ));
    }
    if bench.sensors.len() < 2 {
        out.push("a second sensor at the bearing of another shaft tells which shaft an effect sits on".into());
    }
    if bench.tacho.is_none() {
        out.push("a tacho on a shaft tells slip of the belt from a wrong sample clock".into());
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bench() -> Bench {
        toml::from_str(include_str!("../../sim/src/shipped/single-pair.toml")).unwrap()
    }

    /// Every effect of the library is spoken of, and one load at one speed draws advice.
    #[test]
    fn conform_words_name_effects_of_the_library() {
        for (id, _) in WORDS {
            assert!(effects::find(id).is_ok(), "{id}");
        }
        let bench = bench();
        assert!(advice(&bench, &usual_points(&bench)[..1]).len() >= 2);
    }
}
