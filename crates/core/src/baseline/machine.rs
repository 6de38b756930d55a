//! What of a bench its baseline rests on: which lines are looked for, where, and in which unit.
//! Names of the bench, stiffness, damping and tolerances are the simulator's business, and leave a
//! baseline as it is.

use serde::{Deserialize, Serialize};

use crate::bench::Bench;

/// The part of a bench file that a baseline belongs to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Machine {
    /// Motor speed / input-shaft speed; 1 without a belt.
    pub belt_ratio: f64,
    /// From motor to brake.
    pub stages: Vec<Teeth>,
    /// Sorted by name.
    pub sensors: Vec<Mounted>,
    /// Shaft and pulses per revolution of the tacho; `None` where there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tacho: Option<(String, f64)>,
}

/// Teeth of a stage.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Teeth {
    /// The stage.
    pub name: String,
    /// Of the driving gear; of the sun in a planetary stage.
    pub pinion: u32,
    /// Of the driven gear; of the ring in a planetary stage.
    pub wheel: u32,
    /// Planets and the members' parts, in words; `None` for a pair.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub planets: Option<String>,
}

/// What of a planetary stage decides where its lines are, besides the teeth of sun and ring.
fn planets(set: &crate::bench::Planetary) -> String {
    let [fixed, input, output] = [set.fixed, set.input, set.output].map(crate::bench::Member::word);
    let at = if set.positions_deg.is_empty() { String::new() } else { format!(" at {:?} degrees", set.positions_deg) };
    format!("{} of {} teeth{at}, {fixed} fixed, {input} in, {output} out", set.planets, set.planet.teeth)
}

/// A sensor and where it sits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mounted {
    /// The sensor.
    pub name: String,
    /// The shaft whose bearing it sits on.
    pub shaft: String,
    /// As in the bench file (degrees).
    pub direction_deg: f64,
    /// Of its values.
    pub unit: String,
}

/// A field that differs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Change {
    /// The field with both values, such as `stage "stage1": wheel.teeth was 40, is 41`.
    pub sentence: String,
    /// What was learned means something else now: no reason makes it fit again.
    pub new_lines: bool,
}

/// A baseline that was tied to another state of its bench file by hand.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rebinding {
    /// When (ns since the epoch).
    pub t_ns: i64,
    /// Why it still holds, in the words of who did it.
    pub reason: String,
    /// What had changed, a sentence each; empty for a file that did not say what it rests on.
    pub changes: Vec<String>,
}

impl Machine {
    /// Of a bench.
    pub fn of(bench: &Bench) -> Self {
        let teeth = |stage: &crate::bench::Stage| Teeth {
            name: stage.name.clone(),
            pinion: stage.pinion.teeth,
            wheel: stage.wheel.teeth,
            planets: stage.gearing.planetary.as_ref().map(planets),
        };
        let mounted = |sensor: &crate::bench::Sensor| Mounted {
            name: sensor.name.clone(),
            shaft: sensor.shaft.clone(),
            direction_deg: sensor.direction_deg,
            unit: sensor.unit.clone(),
        };
        let mut sensors: Vec<Mounted> = bench.sensors.iter().map(mounted).collect();
        sensors.sort_by(|a, b| a.name.cmp(&b.name));
        Self {
            belt_ratio: bench.belt.as_ref().map_or(1.0, |belt| belt.ratio),
            stages: bench.stages.iter().map(teeth).collect(),
            sensors,
            tacho: bench.tacho.as_ref().map(|tacho| (tacho.shaft.clone(), tacho.pulses_per_rev)),
        }
    }

    /// What differs in `now`, field by field.
    pub fn changes(&self, now: &Self) -> Vec<Change> {
        let mut out = Vec::new();
        let mut changed = |field: String, was: &dyn std::fmt::Display, is: &dyn std::fmt::Display, new_lines| {
            out.push(Change { sentence: format!("{field} was {was}, is {is}"), new_lines });
        };
        if self.belt_ratio != now.belt_ratio {
            changed("belt.ratio".to_owned(), &self.belt_ratio, &now.belt_ratio, true);
        }
        if self.stages.len() != now.stages.len() {
            changed("the number of stages".to_owned(), &self.stages.len(), &now.stages.len(), true);
        }
        for (was, is) in self.stages.iter().zip(&now.stages) {
            let field = |what: &str| format!("stage {:?}: {what}", is.name);
            if was.name != is.name {
                changed(field("name"), &was.name, &is.name, true);
            }
            let [first, second] = if is.planets.is_some() { ["sun", "ring"] } else { ["pinion", "wheel"] };
            for (gear, was, is) in [(first, was.pinion, is.pinion), (second, was.wheel, is.wheel)] {
                if was != is {
                    changed(field(&format!("{gear}.teeth")), &was, &is, true);
                }
            }
            if was.planets != is.planets {
                let said = |planets: &Option<String>| planets.clone().unwrap_or_else(|| "none, a pair".to_owned());
                changed(field("planets"), &said(&was.planets), &said(&is.planets), true);
            }
        }
        for was in &self.sensors {
            let field = |what: &str| format!("sensor {:?}: {what}", was.name);
            let Some(is) = now.sensors.iter().find(|is| is.name == was.name) else {
                changed(format!("sensor {:?}", was.name), &"there", &"left out", false);
                continue;
            };
            if was.shaft != is.shaft {
                changed(field("shaft"), &was.shaft, &is.shaft, false);
            }
            if was.direction_deg != is.direction_deg {
                changed(field("direction_deg"), &was.direction_deg, &is.direction_deg, false);
            }
            if was.unit != is.unit {
                changed(field("unit"), &was.unit, &is.unit, true);
            }
        }
        let tacho = |tacho: &Option<(String, f64)>| match tacho {
            Some((shaft, pulses)) => format!("{pulses} pulses per revolution of {shaft:?}"),
            None => "none".to_owned(),
        };
        if self.tacho != now.tacho {
            changed("tacho".to_owned(), &tacho(&self.tacho), &tacho(&now.tacho), false);
        }
        out
    }
}
