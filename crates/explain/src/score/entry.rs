//! Where an effect enters the equations of motion: told more surely than its name, and all that is told where the name is not.

use serde::Serialize;

/// Kinds of entry points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Entry {
    /// The data of a channel.
    Data,
    /// The way from the machine to a sensor.
    Path,
    /// Speed, clock, angle.
    Clock,
    /// A force or torque on a shaft.
    Force,
    /// A bearing.
    Bearing,
    /// The geometry of a gear or a pair of flanks.
    Geometry,
    /// The stiffness of a gear, a mesh or a shaft.
    Stiffness,
    /// Damping or friction.
    Damping,
    /// A clearance.
    Clearance,
}

impl Entry {
    /// Where an effect of the library enters.
    pub fn of(effect: &str) -> Self {
        match effect {
            "sensor_mounting" | "structural_resonance" => Self::Path,
            "clock_offset" | "belt_slip" | "speed_fluctuation" | "wrong_belt_ratio" | "wrong_tooth_count" => {
                Self::Clock
            }
            "unbalance" | "torque_ripple" => Self::Force,
            "bearing_compliance" | "bearing_defect" => Self::Bearing,
            "eccentricity" | "pitch_error" | "profile_error" | "tip_relief" | "tooth_wear" | "ghost_component" => {
                Self::Geometry
            }
            "mesh_stiffness"
            | "misalignment"
            | "load_dependent_stiffness"
            | "body_coupling"
            | "shaft_torsion"
            | "root_crack"
            | "tooth_breakage"
            | "pitting" => Self::Stiffness,
            "damping" | "tooth_friction" => Self::Damping,
            "backlash" | "looseness" => Self::Clearance,
            _ => Self::Data,
        }
    }

    /// In words.
    pub const fn describe(self) -> &'static str {
        match self {
            Self::Data => "the data",
            Self::Path => "the path to the sensor",
            Self::Clock => "speed or clock",
            Self::Force => "a force or torque",
            Self::Bearing => "a bearing",
            Self::Geometry => "the geometry of the teeth",
            Self::Stiffness => "a stiffness",
            Self::Damping => "damping or friction",
            Self::Clearance => "a clearance",
        }
    }
}
