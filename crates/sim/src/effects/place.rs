//! Where an effect sits.

use gearwatch_core::bench::Bench;

use super::{Effect, EffectError, values::nearest};

/// Kinds of places, as in the explanation contract.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlaceKind {
    /// A gear pair, by the stage's name.
    Stage,
    /// One gear: `<stage>.pinion` or `<stage>.wheel`.
    Gear,
    /// A shaft, by name.
    Shaft,
    /// A sensor, by name.
    Sensor,
    /// `housing`: all paths.
    Housing,
    /// `belt`.
    Belt,
    /// `motor`.
    Motor,
    /// `coupling`: between drive and first shaft.
    Coupling,
    /// `brake`.
    Brake,
    /// `acquisition`: all channels.
    Acquisition,
}

impl PlaceKind {
    /// How such a place is written.
    pub const fn pattern(self) -> &'static str {
        match self {
            Self::Stage => "STAGE",
            Self::Gear => "STAGE.pinion or STAGE.wheel",
            Self::Shaft => "SHAFT",
            Self::Sensor => "SENSOR",
            Self::Housing => "housing",
            Self::Belt => "belt",
            Self::Motor => "motor",
            Self::Coupling => "coupling",
            Self::Brake => "brake",
            Self::Acquisition => "acquisition",
        }
    }
}

/// A place on a given bench.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// A gear pair.
    Stage(usize),
    /// A pinion or wheel.
    Gear {
        /// Index of its stage.
        stage: usize,
        /// The driven gear of the pair.
        wheel: bool,
    },
    /// A shaft.
    Shaft(usize),
    /// A sensor.
    Sensor(usize),
    /// All paths.
    Housing,
    /// The belt.
    Belt,
    /// The motor.
    Motor,
    /// Between drive and first shaft.
    Coupling,
    /// The brake.
    Brake,
    /// All channels.
    Acquisition,
}

impl Place {
    /// All places of a kind on a bench, with their names.
    pub fn all(kind: PlaceKind, bench: &Bench) -> Vec<(String, Self)> {
        let stages = || bench.stages.iter().enumerate();
        match kind {
            PlaceKind::Stage => stages().map(|(i, stage)| (stage.name.clone(), Self::Stage(i))).collect(),
            PlaceKind::Gear => stages()
                .flat_map(|(i, stage)| {
                    [
                        (format!("{}.pinion", stage.name), Self::Gear { stage: i, wheel: false }),
                        (format!("{}.wheel", stage.name), Self::Gear { stage: i, wheel: true }),
                    ]
                })
                .collect(),
            PlaceKind::Shaft => {
                bench.shafts.iter().enumerate().map(|(i, shaft)| (shaft.name.clone(), Self::Shaft(i))).collect()
            }
            PlaceKind::Sensor => {
                bench.sensors.iter().enumerate().map(|(i, sensor)| (sensor.name.clone(), Self::Sensor(i))).collect()
            }
            PlaceKind::Housing => vec![("housing".into(), Self::Housing)],
            PlaceKind::Belt => bench.belt.iter().map(|_| ("belt".into(), Self::Belt)).collect(),
            PlaceKind::Motor => vec![("motor".into(), Self::Motor)],
            PlaceKind::Coupling => vec![("coupling".into(), Self::Coupling)],
            PlaceKind::Brake => vec![("brake".into(), Self::Brake)],
            PlaceKind::Acquisition => vec![("acquisition".into(), Self::Acquisition)],
        }
    }

    /// All places where an effect may sit on a bench, with their names.
    pub fn of(effect: &dyn Effect, bench: &Bench) -> Vec<(String, Self)> {
        effect.places().iter().flat_map(|&kind| Self::all(kind, bench)).collect()
    }

    /// The place with a name.
    ///
    /// # Errors
    /// When the bench has no such place for this effect; the message names those that it has.
    pub fn parse(text: &str, effect: &dyn Effect, bench: &Bench) -> Result<Self, EffectError> {
        let all = Self::of(effect, bench);
        match all.iter().find(|(name, _)| name == text) {
            Some(&(_, place)) => Ok(place),
            None => Err(EffectError::UnknownPlace {
                effect: effect.id(),
                found: text.to_owned(),
                bench: bench.name.clone(),
                nearest: nearest(text, all.iter().map(|(name, _)| name.as_str())).to_owned(),
                known: all.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", "),
            }),
        }
    }
}
