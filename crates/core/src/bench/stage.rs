//! A stage: a gear pair or a planetary set, as the bench file says it.

use serde::{Deserialize, Serialize};

use super::gearing::{Gearing, Hand, Helix, Member, Planetary, RolesError};

/// A gear pair or a planetary set that joins two shafts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "StageKeys", into = "StageKeys")]
pub struct Stage {
    /// Unique name.
    pub name: String,
    /// Normal module (mm, > 0).
    pub module_mm: f64,
    /// In the normal section (degrees, 10–35).
    pub pressure_angle_deg: f64,
    /// (mm, > 0).
    pub face_width_mm: f64,
    /// Total, along the line of action (µm, ≥ 0).
    pub backlash_um: f64,
    /// Fraction of critical of the mesh mode (0–1).
    pub mesh_damping_ratio: f64,
    /// From +x, counter-clockwise, seen from the motor, pinion to wheel (degrees).
    pub line_of_centres_deg: f64,
    /// The driving gear, on shaft i; of a planetary stage the sun, wherever it is.
    pub pinion: Gear,
    /// The driven gear, on shaft i + 1; of a planetary stage the ring, wherever it is.
    pub wheel: Gear,
    /// What makes it another stage than one external spur pair.
    pub gearing: Gearing,
}

/// One gear.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gear {
    /// Number of teeth (5 to [`MOST_TEETH`](super::MOST_TEETH)).
    pub teeth: u32,
    /// Bore diameter (mm); a quarter of the pitch diameter where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bore_mm: Option<f64>,
    /// (kg); that of a solid disc with the bore where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mass_kg: Option<f64>,
    /// (kg m²); that of a solid disc with the bore where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub inertia_kg_m2: Option<f64>,
    /// Profile shift coefficient x by the normal module (-2 to 2, positive away from the axis); 0,
    /// or what the centre distance asks for, where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub profile_shift: Option<f64>,
    /// Tip diameter (mm); that which leaves the standard clearance where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tip_diameter_mm: Option<f64>,
}

impl Gear {
    /// As a bench file has it that gives no more than the teeth.
    pub const fn with_teeth(teeth: u32) -> Self {
        Self { teeth, bore_mm: None, mass_kg: None, inertia_kg_m2: None, profile_shift: None, tip_diameter_mm: None }
    }
}

/// Word of the key `kind`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StageKind {
    /// Straight teeth.
    #[default]
    Spur,
    /// Helical teeth.
    Helical,
    /// Sun, planets on a carrier, ring.
    Planetary,
}

impl StageKind {
    /// As a file says it.
    pub fn word(self) -> &'static str {
        match self {
            Self::Spur => "spur",
            Self::Helical => "helical",
            Self::Planetary => "planetary",
        }
    }

    fn is_spur(&self) -> bool {
        *self == Self::Spur
    }
}

impl Stage {
    /// By the word of the file.
    pub fn kind(&self) -> StageKind {
        match (&self.gearing.planetary, &self.gearing.helix) {
            (Some(_), _) => StageKind::Planetary,
            (None, Some(_)) => StageKind::Helical,
            (None, None) => StageKind::Spur,
        }
    }

    /// Helix angle on the reference cylinder (rad), 0 for straight teeth.
    pub fn helix_rad(&self) -> f64 {
        self.gearing.helix.as_ref().map_or(0.0, |helix| helix.angle_deg.to_radians())
    }

    /// Pressure angle in the transverse section (rad): `tan α_t = tan α_n / cos β`.
    pub fn transverse_angle_rad(&self) -> f64 {
        let normal = self.pressure_angle_deg.to_radians();
        match &self.gearing.helix {
            None => normal,
            Some(_) => (normal.tan() / self.helix_rad().cos()).atan(),
        }
    }

    /// Reference radius (m) of a gear with so many teeth: `r = m_n z / (2 cos β)`.
    pub fn reference_radius_m(&self, teeth: u32) -> f64 {
        0.5e-3 * self.module_mm * f64::from(teeth) / self.helix_rad().cos()
    }

    /// What the file calls the two gears in [`Stage::pinion`] and [`Stage::wheel`].
    pub fn gear_names(&self) -> [&'static str; 2] {
        if self.gearing.planetary.is_some() { ["sun", "ring"] } else { ["pinion", "wheel"] }
    }

    /// All gears by the names of the file; the planet stands for all planets.
    pub fn gears(&self) -> Vec<(String, &Gear)> {
        let [first, second] = self.gear_names();
        let mut out = vec![(first.to_owned(), &self.pinion), (second.to_owned(), &self.wheel)];
        out.extend(self.gearing.planetary.iter().map(|p| ("planet".to_owned(), &p.planet)));
        out.extend(self.gearing.idlers.iter().enumerate().map(|(i, gear)| (format!("idlers[{i}]"), gear)));
        out
    }
}

fn module_mm() -> f64 {
    3.0
}
fn pressure_angle_deg() -> f64 {
    20.0
}
fn face_width_mm() -> f64 {
    20.0
}
fn backlash_um() -> f64 {
    80.0
}
fn mesh_damping_ratio() -> f64 {
    0.06
}

/// The stage as the file has it, with the keys of all kinds. What the file leaves out is left out
/// again when it is written.
#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StageKeys {
    name: String,
    #[serde(default, skip_serializing_if = "StageKind::is_spur")]
    kind: StageKind,
    #[serde(default = "module_mm")]
    module_mm: f64,
    #[serde(default = "pressure_angle_deg")]
    pressure_angle_deg: f64,
    #[serde(default = "face_width_mm")]
    face_width_mm: f64,
    #[serde(default = "backlash_um")]
    backlash_um: f64,
    #[serde(default = "mesh_damping_ratio")]
    mesh_damping_ratio: f64,
    #[serde(default)]
    line_of_centres_deg: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    helix_angle_deg: Option<f64>,
    #[serde(default, skip_serializing_if = "is_false")]
    profile_shifted: bool,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    centre_distance_mm: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    fixed: Option<Member>,
    #[serde(default, rename = "in", skip_serializing_if = "Option::is_none")]
    input: Option<Member>,
    #[serde(default, rename = "out", skip_serializing_if = "Option::is_none")]
    output: Option<Member>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pinion: Option<PairGearKeys>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    wheel: Option<PairGearKeys>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    idlers: Vec<Gear>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    sun: Option<Gear>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    planet: Option<PlanetKeys>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    ring: Option<Gear>,
}

fn is_false(x: &bool) -> bool {
    !x
}

/// A gear of a pair.
#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PairGearKeys {
    teeth: u32,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    bore_mm: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    mass_kg: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    inertia_kg_m2: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    profile_shift: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    tip_diameter_mm: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    hand: Option<Hand>,
    #[serde(default, skip_serializing_if = "is_false")]
    internal: bool,
}

/// The planets, all alike.
#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlanetKeys {
    teeth: u32,
    count: u32,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    positions_deg: Vec<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    bore_mm: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    mass_kg: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    inertia_kg_m2: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    profile_shift: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    tip_diameter_mm: Option<f64>,
}

impl PairGearKeys {
    fn gear(&self) -> Gear {
        let Self { teeth, bore_mm, mass_kg, inertia_kg_m2, profile_shift, tip_diameter_mm, .. } = *self;
        Gear { teeth, bore_mm, mass_kg, inertia_kg_m2, profile_shift, tip_diameter_mm }
    }

    fn of(gear: Gear, hand: Option<Hand>, internal: bool) -> Self {
        let Gear { teeth, bore_mm, mass_kg, inertia_kg_m2, profile_shift, tip_diameter_mm } = gear;
        Self { teeth, bore_mm, mass_kg, inertia_kg_m2, profile_shift, tip_diameter_mm, hand, internal }
    }
}

/// A stage whose keys do not go with its kind.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
enum KeysError {
    /// A spur pair lacks it; said as for any other key.
    #[error("missing field `{0}`")]
    Missing(&'static str),
    /// The kind cannot do without it.
    #[error("kind = {:?} has no {key:?}; expected {example}", kind.word())]
    Needed { kind: StageKind, key: &'static str, example: &'static str },
    /// It belongs to another kind.
    #[error("kind = {:?} takes no {key:?}; that is a key of {of}", kind.word())]
    Foreign { kind: StageKind, key: &'static str, of: &'static str },
    /// The members of a planetary stage.
    #[error(transparent)]
    Roles(#[from] RolesError),
    #[error("pinion.internal is set; only the wheel can be an internal gear")]
    InternalPinion,
}

/// The value of a key that the kind cannot do without.
fn needed<T>(value: Option<T>, key: &'static str, kind: StageKind, example: &'static str) -> Result<T, KeysError> {
    value.ok_or(match kind {
        StageKind::Spur => KeysError::Missing(key),
        _ => KeysError::Needed { kind, key, example },
    })
}

impl TryFrom<StageKeys> for Stage {
    type Error = KeysError;

    fn try_from(keys: StageKeys) -> Result<Self, KeysError> {
        let kind = keys.kind;
        let foreign = |there: bool, key: &'static str, of: &'static str| {
            if there { Err(KeysError::Foreign { kind, key, of }) } else { Ok(()) }
        };
        let planetary = kind == StageKind::Planetary;
        if planetary {
            let pair = "a spur or helical pair; a planetary stage has sun, planet and ring";
            foreign(keys.pinion.is_some(), "pinion", pair)?;
            foreign(keys.wheel.is_some(), "wheel", pair)?;
            foreign(!keys.idlers.is_empty(), "idlers", pair)?;
            foreign(keys.centre_distance_mm.is_some(), "centre_distance_mm", "a pair of pinion and wheel")?;
        } else {
            let set = "kind = \"planetary\"";
            foreign(keys.sun.is_some(), "sun", set)?;
            foreign(keys.planet.is_some(), "planet", set)?;
            foreign(keys.ring.is_some(), "ring", set)?;
            foreign(keys.fixed.is_some(), "fixed", set)?;
            foreign(keys.input.is_some(), "in", set)?;
            foreign(keys.output.is_some(), "out", set)?;
        }
        if kind == StageKind::Spur {
            foreign(keys.helix_angle_deg.is_some(), "helix_angle_deg", "kind = \"helical\" and \"planetary\"")?;
            let handed = [&keys.pinion, &keys.wheel].into_iter().flatten().any(|gear| gear.hand.is_some());
            foreign(handed, "hand", "kind = \"helical\"")?;
        }
        let mut gearing = Gearing {
            profile_shifted: keys.profile_shifted,
            centre_distance_mm: keys.centre_distance_mm,
            ..Gearing::default()
        };
        let (pinion, wheel) = if planetary {
            let sun = needed(keys.sun, "sun", kind, "sun = { teeth = 28 }")?;
            let ring = needed(keys.ring, "ring", kind, "ring = { teeth = 100 }")?;
            let planet = needed(keys.planet, "planet", kind, "planet = { teeth = 36, count = 4 }")?;
            let PlanetKeys {
                teeth,
                bore_mm,
                mass_kg,
                inertia_kg_m2,
                profile_shift,
                tip_diameter_mm,
                count,
                positions_deg,
            } = planet;
            let (fixed, input, output) = Member::roles(keys.fixed, keys.input, keys.output)?;
            let planet = Gear { teeth, bore_mm, mass_kg, inertia_kg_m2, profile_shift, tip_diameter_mm };
            gearing.planetary = Some(Planetary { planets: count, planet, positions_deg, fixed, input, output });
            gearing.helix = keys.helix_angle_deg.map(|angle_deg| Helix { angle_deg, hands: [None, None] });
            (sun, ring)
        } else {
            let pinion = needed(keys.pinion, "pinion", kind, "pinion = { teeth = 23, hand = \"right\" }")?;
            let wheel = needed(keys.wheel, "wheel", kind, "wheel = { teeth = 57, hand = \"left\" }")?;
            if pinion.internal {
                return Err(KeysError::InternalPinion);
            }
            if kind == StageKind::Helical {
                let angle_deg = needed(keys.helix_angle_deg, "helix_angle_deg", kind, "helix_angle_deg = 15.0")?;
                gearing.helix = Some(Helix { angle_deg, hands: [pinion.hand, wheel.hand] });
            }
            gearing.internal = wheel.internal;
            gearing.idlers = keys.idlers;
            (pinion.gear(), wheel.gear())
        };
        Ok(Self {
            name: keys.name,
            module_mm: keys.module_mm,
            pressure_angle_deg: keys.pressure_angle_deg,
            face_width_mm: keys.face_width_mm,
            backlash_um: keys.backlash_um,
            mesh_damping_ratio: keys.mesh_damping_ratio,
            line_of_centres_deg: keys.line_of_centres_deg,
            pinion,
            wheel,
            gearing,
        })
    }
}

impl From<Stage> for StageKeys {
    fn from(stage: Stage) -> Self {
        let kind = stage.kind();
        let Gearing { helix, internal, idlers, planetary, profile_shifted, centre_distance_mm } = stage.gearing;
        let hands = helix.as_ref().map_or([None, None], |helix| helix.hands);
        let mut keys = Self {
            name: stage.name,
            kind,
            module_mm: stage.module_mm,
            pressure_angle_deg: stage.pressure_angle_deg,
            face_width_mm: stage.face_width_mm,
            backlash_um: stage.backlash_um,
            mesh_damping_ratio: stage.mesh_damping_ratio,
            line_of_centres_deg: stage.line_of_centres_deg,
            helix_angle_deg: helix.map(|helix| helix.angle_deg),
            profile_shifted,
            centre_distance_mm,
            fixed: None,
            input: None,
            output: None,
            pinion: None,
            wheel: None,
            idlers,
            sun: None,
            planet: None,
            ring: None,
        };
        if let Some(set) = planetary {
            let Gear { teeth, bore_mm, mass_kg, inertia_kg_m2, profile_shift, tip_diameter_mm } = set.planet;
            let (count, positions_deg) = (set.planets, set.positions_deg);
            keys.planet = Some(PlanetKeys {
                teeth,
                count,
                positions_deg,
                bore_mm,
                mass_kg,
                inertia_kg_m2,
                profile_shift,
                tip_diameter_mm,
            });
            (keys.fixed, keys.input, keys.output) = (Some(set.fixed), Some(set.input), Some(set.output));
            (keys.sun, keys.ring) = (Some(stage.pinion), Some(stage.wheel));
        } else {
            keys.pinion = Some(PairGearKeys::of(stage.pinion, hands[0], false));
            keys.wheel = Some(PairGearKeys::of(stage.wheel, hands[1], internal));
        }
        keys
    }
}
