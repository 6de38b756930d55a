//! What an engineer knows of a bench: the bench file, `format = "gearwatch-bench/1"`.
//!
//! The structs mirror the file. Reading the TOML text is the business of the `io` crate;
//! [`Bench::problems`] says what is wrong with the values, in sentences.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

pub mod beam;
pub mod bearing;
mod bounds;
pub mod gearing;
pub mod rolling;
pub mod shaft;
pub mod shift;
pub mod stage;
pub mod term;

pub use beam::{Beam, Section, Support};
pub use bearing::{Bearing, BearingOrders, IndicatorSettings};
pub use bounds::{LONGEST_NAME, MOST_PARTS, MOST_STAGES, MOST_TEETH};
pub use gearing::{Gearing, Hand, Helix, Member, Planetary};
pub use rolling::Rolling;
pub use shaft::{Shaft, ShaftKeysError};
pub use shift::{PairShift, ShiftError};
pub use stage::{Gear, Stage, StageKind};
pub use term::Term;

/// The value of the key `format`.
pub const FORMAT: &str = "gearwatch-bench/1";

/// A bench file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bench {
    /// Always [`FORMAT`].
    pub format: String,
    /// Name of the bench.
    pub name: String,
    /// The drive.
    pub motor: Motor,
    /// Left out where the motor drives the input shaft directly.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub belt: Option<Belt>,
    /// In order from motor to brake; n stages have n + 1 shafts.
    #[serde(rename = "shaft")]
    pub shafts: Vec<Shaft>,
    /// Stage i joins shaft i and shaft i + 1.
    #[serde(rename = "stage")]
    pub stages: Vec<Stage>,
    /// Material of all gears.
    #[serde(default)]
    pub gear_material: GearMaterial,
    /// The load.
    #[serde(default)]
    pub brake: Brake,
    /// Path from bearing forces to sensors; empty where unknown.
    #[serde(default, rename = "housing_mode", skip_serializing_if = "Vec::is_empty")]
    pub housing_modes: Vec<HousingMode>,
    /// Accelerometers.
    #[serde(default, rename = "sensor", skip_serializing_if = "Vec::is_empty")]
    pub sensors: Vec<Sensor>,
    /// Left out where there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tacho: Option<Tacho>,
    /// How recordings are made.
    #[serde(default)]
    pub acquisition: Acquisition,
    /// Physics beyond the nominal model, faults among it, in the words of the explanation contract.
    #[serde(default, rename = "effect", skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<EffectSpec>,
    /// Physics beyond the nominal model that no effect has a name for.
    #[serde(default, rename = "term", skip_serializing_if = "Vec::is_empty")]
    pub terms: Vec<Term>,
    /// Rolling bearings whose orders the envelope is read at.
    #[serde(default, rename = "bearing", skip_serializing_if = "Vec::is_empty")]
    pub bearings: Vec<Bearing>,
    /// What the condition indicators are told.
    #[serde(default, skip_serializing_if = "IndicatorSettings::is_empty")]
    pub indicators: IndicatorSettings,
    /// What is known of the bench's doubts.
    #[serde(default, skip_serializing_if = "Check::is_empty")]
    pub check: Check,
}

/// Doubts that somebody has looked into and found to be none.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Check {
    /// Words of findings, such as `band`, that are told as notes from now on.
    pub cleared: Vec<String>,
}

impl Check {
    fn is_empty(&self) -> bool {
        self.cleared.is_empty()
    }
}

/// The drive: `T = T_n - slope (ω - ω_n)` about the nominal speed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "MotorKeys")]
pub struct Motor {
    /// Nominal speed (Hz, > 0); a file may say `speed_rpm` in its place.
    pub speed_hz: f64,
    /// Rotor inertia (kg m², > 0).
    pub inertia_kg_m2: f64,
    /// Torque lost per rad/s of slip near the operating point (N m s/rad, > 0).
    pub slip_slope_nm_s_per_rad: f64,
}

/// As a file says it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MotorKeys {
    speed_hz: Option<f64>,
    speed_rpm: Option<f64>,
    #[serde(default = "defaults::motor_inertia_kg_m2")]
    inertia_kg_m2: f64,
    #[serde(default = "defaults::slip_slope_nm_s_per_rad")]
    slip_slope_nm_s_per_rad: f64,
}

impl TryFrom<MotorKeys> for Motor {
    type Error = &'static str;

    fn try_from(keys: MotorKeys) -> Result<Self, Self::Error> {
        let speed_hz = match (keys.speed_hz, keys.speed_rpm) {
            (Some(hz), None) => hz,
            (None, Some(rpm)) => rpm / crate::speed::RPM_PER_HZ,
            (None, None) => return Err("missing field `speed_hz` (or `speed_rpm`)"),
            (Some(_), Some(_)) => return Err("speed_hz and speed_rpm are both given; expected one of them"),
        };
        Ok(Self { speed_hz, inertia_kg_m2: keys.inertia_kg_m2, slip_slope_nm_s_per_rad: keys.slip_slope_nm_s_per_rad })
    }
}

/// The belt between motor and input shaft.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Belt {
    /// Motor speed / input-shaft speed (> 0).
    pub ratio: f64,
    /// Seen at the input shaft (N m/rad, > 0).
    #[serde(default = "defaults::belt_stiffness_nm_per_rad")]
    pub stiffness_nm_per_rad: f64,
    /// Seen at the input shaft (N m s/rad, ≥ 0).
    #[serde(default = "defaults::belt_damping_nm_s_per_rad")]
    pub damping_nm_s_per_rad: f64,
    /// Length of its pitch line, once round (mm, > 0): how often a place of it comes round.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub length_mm: Option<f64>,
    /// Pitch diameter of the motor's pulley (mm, > 0); that of the other one is `ratio` times it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motor_pulley_mm: Option<f64>,
}

/// Material of all gears.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GearMaterial {
    /// Young's modulus (Pa).
    pub youngs_modulus_pa: f64,
    /// Poisson's ratio (0–0.5).
    pub poisson_ratio: f64,
    /// (kg/m³).
    pub density_kg_per_m3: f64,
}

impl Default for GearMaterial {
    fn default() -> Self {
        Self { youngs_modulus_pa: 2.06e11, poisson_ratio: 0.3, density_kg_per_m3: 7850.0 }
    }
}

/// The load.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Brake {
    /// At the brake; a recording's operating point overrides it (N m, ≥ 0).
    pub torque_nm: f64,
    /// (kg m², > 0).
    pub inertia_kg_m2: f64,
}

impl Default for Brake {
    fn default() -> Self {
        Self { torque_nm: 0.0, inertia_kg_m2: 0.02 }
    }
}

/// One mode of the housing: the path from bearing forces to sensors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HousingMode {
    /// (Hz, > 0).
    pub frequency_hz: f64,
    /// Fraction of critical (0–1).
    pub damping_ratio: f64,
    /// Modal mass (kg, > 0).
    pub mass_kg: f64,
    /// Mode shape at each shaft's bearing and at each sensor, by name; 0 where left out.
    #[serde(default)]
    pub shape: BTreeMap<String, f64>,
}

/// An accelerometer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sensor {
    /// Unique name, the last part of its topic.
    pub name: String,
    /// The shaft whose bearing it sits on.
    pub shaft: String,
    /// As `line_of_centres_deg` (degrees).
    #[serde(default)]
    pub direction_deg: f64,
    /// `m/s^2`, `g`, `mm/s`, `V` or `1`.
    #[serde(default = "defaults::unit")]
    pub unit: String,
}

/// A tachometer or encoder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tacho {
    /// The shaft it sits on; `motor` for the motor.
    pub shaft: String,
    /// (> 0).
    #[serde(default = "defaults::pulses_per_rev")]
    pub pulses_per_rev: f64,
}

/// How recordings are made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Acquisition {
    /// (Hz, > 0).
    pub sample_rate_hz: f64,
}

impl Default for Acquisition {
    fn default() -> Self {
        Self { sample_rate_hz: 16_384.0 }
    }
}

/// An effect that is switched on: id, place and parameters of the explanation contract.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectSpec {
    /// Effect id, such as `eccentricity`.
    pub effect: String,
    /// Place, such as `stage1.pinion`.
    #[serde(rename = "where")]
    pub place: String,
    /// Parameter values by name; the unit is the end of the name.
    #[serde(default)]
    pub parameters: BTreeMap<String, f64>,
}

/// Values of keys that a bench file leaves out: those of a small laboratory bench.
mod defaults {
    pub(super) fn motor_inertia_kg_m2() -> f64 {
        0.008
    }
    pub(super) fn slip_slope_nm_s_per_rad() -> f64 {
        2.0
    }
    pub(super) fn belt_stiffness_nm_per_rad() -> f64 {
        4000.0
    }
    pub(super) fn belt_damping_nm_s_per_rad() -> f64 {
        1.0
    }
    pub(super) fn shaft_inertia_kg_m2() -> f64 {
        0.001
    }
    pub(super) fn torsion_nm_per_rad() -> f64 {
        9000.0
    }
    pub(super) fn torsion_damping_nm_s_per_rad() -> f64 {
        0.4
    }
    pub(super) fn bearing_n_per_m() -> f64 {
        1.2e8
    }
    pub(super) fn bearing_damping_n_s_per_m() -> f64 {
        1500.0
    }
    pub(super) fn modes_to_hz() -> f64 {
        6000.0
    }
    pub(super) fn shaft_damping_ratio() -> f64 {
        0.005
    }
    pub(super) fn unit() -> String {
        "m/s^2".to_owned()
    }
    pub(super) fn pulses_per_rev() -> f64 {
        1.0
    }
}

impl Bench {
    /// As a bench file has it that gives no more than these, so that a new key has its default in
    /// one place.
    pub fn new(name: impl Into<String>, motor: Motor, shafts: Vec<Shaft>, stages: Vec<Stage>) -> Self {
        Self {
            format: FORMAT.into(),
            name: name.into(),
            motor,
            belt: None,
            shafts,
            stages,
            gear_material: GearMaterial::default(),
            brake: Brake::default(),
            housing_modes: Vec::new(),
            sensors: Vec::new(),
            tacho: None,
            acquisition: Acquisition::default(),
            effects: Vec::new(),
            terms: Vec::new(),
            bearings: Vec::new(),
            indicators: IndicatorSettings::default(),
            check: Check::default(),
        }
    }

    /// The text of a bench file, as it stands: [`Self::problems`] says whether its values can be
    /// right.
    ///
    /// # Errors
    /// When it is no TOML, or a key is missing, unknown or of another type.
    pub fn from_toml(text: &str) -> Result<Self, toml::de::Error> {
        toml::from_str(text)
    }

    /// What is wrong with the values, one sentence each with place, what was found and what would
    /// be right. Empty for a usable bench.
    pub fn problems(&self) -> Vec<String> {
        let mut out = self.numbers_out_of_range();
        if self.format != FORMAT {
            out.push(format!("format is {:?}; this version reads {FORMAT:?}", self.format));
        }
        if self.stages.is_empty() {
            out.push("there is no [[stage]]; a bench has at least one gear pair".into());
        }
        if self.shafts.len() != self.stages.len() + 1 {
            out.push(format!(
                "there are {} [[shaft]] and {} [[stage]]; n stages have n + 1 shafts",
                self.shafts.len(),
                self.stages.len()
            ));
        }
        for stage in &self.stages {
            out.extend(gearing::problems(stage));
            if !(10.0..=35.0).contains(&stage.pressure_angle_deg) {
                out.push(format!(
                    "stage {:?}: pressure_angle_deg is {}; expected 10 to 35 degrees (20 is usual)",
                    stage.name, stage.pressure_angle_deg
                ));
            }
        }
        out.extend(self.names_and_places());
        for (i, bearing) in self.bearings.iter().enumerate() {
            if self.bearings[..i].iter().any(|b| b.name == bearing.name) {
                out.push(format!("the name {:?} is used by two bearings; each needs a name of its own", bearing.name));
            }
            out.extend(bearing.problems(&self.shafts));
        }
        for (i, shaft) in self.shafts.iter().enumerate() {
            out.extend(shaft.beam.iter().flat_map(|beam| beam.problems(self, i)));
        }
        out.extend(self.indicators.problems());
        out.extend(self.terms.iter().filter_map(|term| term.resolve(self).err()).map(|error| error.to_string()));
        // What cannot be at all is told first.
        if out.is_empty() { bounds::problems(self) } else { out }
    }

    /// Numbers that must be positive, or must not be negative.
    fn numbers_out_of_range(&self) -> Vec<String> {
        let mut out = Vec::new();
        let mut positive = |place: String, value: f64, unit: &str| {
            if !(value.is_finite() && value > 0.0) {
                out.push(format!("{place} is {value}; it must be a finite number above 0 {unit}"));
            }
        };
        positive("motor.speed_hz".into(), self.motor.speed_hz, "Hz");
        positive("motor.inertia_kg_m2".into(), self.motor.inertia_kg_m2, "kg m²");
        positive("motor.slip_slope_nm_s_per_rad".into(), self.motor.slip_slope_nm_s_per_rad, "N m s/rad");
        positive("acquisition.sample_rate_hz".into(), self.acquisition.sample_rate_hz, "Hz");
        positive("brake.inertia_kg_m2".into(), self.brake.inertia_kg_m2, "kg m²");
        if let Some(belt) = &self.belt {
            positive("belt.ratio".into(), belt.ratio, "");
            positive("belt.stiffness_nm_per_rad".into(), belt.stiffness_nm_per_rad, "N m/rad");
            for (key, value) in [("length_mm", belt.length_mm), ("motor_pulley_mm", belt.motor_pulley_mm)] {
                value.into_iter().for_each(|mm| positive(format!("belt.{key}"), mm, "mm"));
            }
        }
        for shaft in &self.shafts {
            // Of sections that are wrong nothing follows, and they are told.
            if shaft.beam.is_none() || shaft.torsion_nm_per_rad.is_finite() {
                positive(format!("shaft {:?}: torsion_nm_per_rad", shaft.name), shaft.torsion_nm_per_rad, "N m/rad");
            }
            positive(format!("shaft {:?}: bearing_n_per_m", shaft.name), shaft.bearing_n_per_m, "N/m");
        }
        for stage in &self.stages {
            positive(format!("stage {:?}: module_mm", stage.name), stage.module_mm, "mm");
            positive(format!("stage {:?}: face_width_mm", stage.name), stage.face_width_mm, "mm");
        }
        for (i, mode) in self.housing_modes.iter().enumerate() {
            positive(format!("housing_mode {}: frequency_hz", i + 1), mode.frequency_hz, "Hz");
            positive(format!("housing_mode {}: mass_kg", i + 1), mode.mass_kg, "kg");
            positive(format!("housing_mode {}: damping_ratio", i + 1), mode.damping_ratio, "(0.01 to 0.05 is usual)");
        }
        let mut not_negative = |place: String, value: f64, unit: &str| {
            if !(value.is_finite() && value >= 0.0) {
                out.push(format!("{place} is {value}; it must be a finite number of 0 {unit} or more"));
            }
        };
        not_negative("brake.torque_nm".into(), self.brake.torque_nm, "N m");
        if let Some(belt) = &self.belt {
            not_negative("belt.damping_nm_s_per_rad".into(), belt.damping_nm_s_per_rad, "N m s/rad");
        }
        for shaft in &self.shafts {
            let place = |what: &str| format!("shaft {:?}: {what}", shaft.name);
            not_negative(place("inertia_kg_m2"), shaft.inertia_kg_m2, "kg m²");
            not_negative(place("torsion_damping_nm_s_per_rad"), shaft.torsion_damping_nm_s_per_rad, "N m s/rad");
            not_negative(place("bearing_damping_n_s_per_m"), shaft.bearing_damping_n_s_per_m, "N s/m");
        }
        for stage in &self.stages {
            let place = |what: &str| format!("stage {:?}: {what}", stage.name);
            not_negative(place("backlash_um"), stage.backlash_um, "µm");
            not_negative(place("mesh_damping_ratio"), stage.mesh_damping_ratio, "(0.03 to 0.1 is usual)");
        }
        out
    }

    /// Names that are used twice, and things that sit on shafts that are not there.
    fn names_and_places(&self) -> Vec<String> {
        let mut out = Vec::new();
        let mut seen = std::collections::BTreeSet::new();
        let names = self.shafts.iter().map(|s| &s.name).chain(self.stages.iter().map(|s| &s.name));
        for name in names.chain(self.sensors.iter().map(|s| &s.name)) {
            if !seen.insert(name) {
                out.push(format!(
                    "the name {name:?} is used twice; shafts, stages and sensors need names of their own"
                ));
            }
        }
        for sensor in &self.sensors {
            if !self.shafts.iter().any(|s| s.name == sensor.shaft) {
                out.push(format!(
                    "sensor {:?} sits on shaft {:?}, which is not a [[shaft]]",
                    sensor.name, sensor.shaft
                ));
            }
        }
        if let Some(tacho) = &self.tacho {
            if tacho.shaft != "motor" && !self.shafts.iter().any(|s| s.name == tacho.shaft) {
                out.push(format!(
                    "the tacho sits on shaft {:?}, which is neither a [[shaft]] nor \"motor\"",
                    tacho.shaft
                ));
            }
            if !(tacho.pulses_per_rev.is_finite() && tacho.pulses_per_rev > 0.0) {
                out.push(format!("tacho.pulses_per_rev is {}; it must be above 0", tacho.pulses_per_rev));
            }
        }
        out
    }
}
