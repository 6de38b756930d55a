//! Where an effect sits.

use gearwatch_core::bench::{Bench, Stage};

use super::{Effect, EffectError, values::nearest};

/// Kinds of places, as in the explanation contract.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlaceKind {
    /// A gear pair, by the stage's name.
    Stage,
    /// One gear: `<stage>.pinion` or `<stage>.wheel`; `<stage>.sun`, `<stage>.ring`;
    /// `<stage>.planet_<k>` or `<stage>.idler_<k>` with the flanks towards sun or pinion, and the
    /// same with `.ring_side` or `.wheel_side`.
    Gear,
    /// `<stage>.ring` of a planetary stage.
    Ring,
    /// A planet's pin: `<stage>.planet_<k>`.
    Planet,
    /// `<stage>.carrier`.
    Carrier,
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
            Self::Gear => "STAGE.pinion or STAGE.wheel; STAGE.sun, STAGE.ring, STAGE.planet_K, STAGE.idler_K",
            Self::Ring => "STAGE.ring",
            Self::Planet => "STAGE.planet_K",
            Self::Carrier => "STAGE.carrier",
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
    /// A planet or an idler.
    Middle {
        /// Index of its stage.
        stage: usize,
        /// From 0.
        gear: usize,
        /// By its flanks towards ring or wheel, otherwise towards sun or pinion.
        second: bool,
    },
    /// The pin of a planet.
    Pin {
        /// Index of its stage.
        stage: usize,
        /// From 0.
        planet: usize,
    },
    /// The carrier of a planetary stage.
    Carrier(usize),
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
        let planetary = || {
            let set = |(i, stage): (usize, &'_ Stage)| {
                stage.gearing.planetary.as_ref().map(|set| (i, stage.name.clone(), set.planets as usize))
            };
            stages().filter_map(set)
        };
        match kind {
            PlaceKind::Stage => stages().map(|(i, stage)| (stage.name.clone(), Self::Stage(i))).collect(),
            PlaceKind::Gear => stages()
                .flat_map(|(i, stage)| {
                    let [first, last] = stage.gear_names();
                    let mut out = vec![
                        (format!("{}.{first}", stage.name), Self::Gear { stage: i, wheel: false }),
                        (format!("{}.{last}", stage.name), Self::Gear { stage: i, wheel: true }),
                    ];
                    let planets = stage.gearing.planetary.as_ref().map_or(0, |set| set.planets as usize);
                    let (what, count) =
                        if planets > 0 { ("planet", planets) } else { ("idler", stage.gearing.idlers.len()) };
                    for gear in 0..count {
                        let name = format!("{}.{what}_{}", stage.name, gear + 1);
                        out.push((name.clone(), Self::Middle { stage: i, gear, second: false }));
                        out.push((format!("{name}.{last}_side"), Self::Middle { stage: i, gear, second: true }));
                    }
                    out
                })
                .collect(),
            PlaceKind::Ring => planetary()
                .map(|(stage, name, _)| (format!("{name}.ring"), Self::Gear { stage, wheel: true }))
                .collect(),
            PlaceKind::Planet => planetary()
                .flat_map(|(stage, name, planets)| {
                    let pin = move |planet| (format!("{name}.planet_{}", planet + 1), Self::Pin { stage, planet });
                    (0..planets).map(pin)
                })
                .collect(),
            PlaceKind::Carrier => {
                planetary().map(|(stage, name, _)| (format!("{name}.carrier"), Self::Carrier(stage))).collect()
            }
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
