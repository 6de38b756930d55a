//! A shaft as the bench file says it.

use serde::{Deserialize, Serialize};

use super::beam::{Beam, Section, Support};
use super::{GearMaterial, defaults};

/// A shaft with its bearings, without its gears.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ShaftKeys", into = "ShaftKeys")]
pub struct Shaft {
    /// Unique name.
    pub name: String,
    /// Without its gears (kg m², ≥ 0).
    pub inertia_kg_m2: f64,
    /// Between its two ends (N m/rad, > 0).
    pub torsion_nm_per_rad: f64,
    /// Between its two ends (N m s/rad, ≥ 0).
    pub torsion_damping_nm_s_per_rad: f64,
    /// Lateral, isotropic, at each gear (N/m, > 0). Of a beam the sum of its supports.
    pub bearing_n_per_m: f64,
    /// Lateral, isotropic, at each gear (N s/m, ≥ 0). Of a beam the sum of its supports.
    pub bearing_damping_n_s_per_m: f64,
    /// Along the axis, of the whole shaft, which helical gears push (N/m, > 0); a third of
    /// `bearing_n_per_m` where left out.
    pub axial_n_per_m: Option<f64>,
    /// The shaft bends: its sections, supports and seats.
    pub beam: Option<Box<Beam>>,
}

/// A shaft's keys do not fit together.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ShaftKeysError {
    /// Bearings are said twice.
    #[error(
        "shaft {name:?} has {key} and supports; expected one of them: the stiffness and damping of a shaft with sections are those of its supports"
    )]
    Both {
        /// The shaft.
        name: String,
        /// The key.
        key: &'static str,
    },
    /// Part of a beam is missing.
    #[error("shaft {name:?} has {key} and no {missing}; expected both, or neither for a shaft that does not bend")]
    Missing {
        /// The shaft.
        name: String,
        /// The key that is there.
        key: &'static str,
        /// The one that is not.
        missing: &'static str,
    },
}

/// As a file says it.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ShaftKeys {
    name: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    inertia_kg_m2: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    torsion_nm_per_rad: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    torsion_damping_nm_s_per_rad: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    bearing_n_per_m: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    bearing_damping_n_s_per_m: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    axial_n_per_m: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    wheel_mm: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pinion_mm: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    modes_to_hz: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    damping_ratio: Option<f64>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    sections: Vec<Section>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    supports: Vec<Support>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    material: Option<GearMaterial>,
}

impl Shaft {
    /// As a bench file has it that gives no more than the name.
    pub fn named(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            inertia_kg_m2: defaults::shaft_inertia_kg_m2(),
            torsion_nm_per_rad: defaults::torsion_nm_per_rad(),
            torsion_damping_nm_s_per_rad: defaults::torsion_damping_nm_s_per_rad(),
            bearing_n_per_m: defaults::bearing_n_per_m(),
            bearing_damping_n_s_per_m: defaults::bearing_damping_n_s_per_m(),
            axial_n_per_m: None,
            beam: None,
        }
    }

    /// Stiffness (N/m) and damping (N s/m) of its bearings along the axis; the damping is to the
    /// stiffness as across the axis.
    pub fn axial(&self) -> (f64, f64) {
        let stiffness = self.axial_n_per_m.unwrap_or(self.bearing_n_per_m / 3.0);
        (stiffness, self.bearing_damping_n_s_per_m * stiffness / self.bearing_n_per_m)
    }
}

/// The keys that only a beam has, as far as they are there.
fn beam(keys: &ShaftKeys) -> Result<Option<Beam>, ShaftKeysError> {
    let name = || keys.name.clone();
    let bends = !keys.sections.is_empty() || !keys.supports.is_empty();
    let of_beams = [
        ("wheel_mm", keys.wheel_mm.is_some()),
        ("pinion_mm", keys.pinion_mm.is_some()),
        ("modes_to_hz", keys.modes_to_hz.is_some()),
        ("damping_ratio", keys.damping_ratio.is_some()),
        ("material", keys.material.is_some()),
    ];
    if let Some((key, _)) = of_beams.into_iter().find(|(_, there)| *there && !bends) {
        return Err(ShaftKeysError::Missing { name: name(), key, missing: "sections" });
    }
    if !bends {
        return Ok(None);
    }
    for (key, missing, empty) in
        [("supports", "sections", keys.sections.is_empty()), ("sections", "supports", keys.supports.is_empty())]
    {
        if empty {
            return Err(ShaftKeysError::Missing { name: name(), key, missing });
        }
    }
    let twice = [
        ("bearing_n_per_m", keys.bearing_n_per_m.is_some()),
        ("bearing_damping_n_s_per_m", keys.bearing_damping_n_s_per_m.is_some()),
    ];
    if let Some((key, _)) = twice.into_iter().find(|(_, there)| *there) {
        return Err(ShaftKeysError::Both { name: name(), key });
    }
    Ok(Some(Beam {
        sections: keys.sections.clone(),
        supports: keys.supports.clone(),
        wheel_mm: keys.wheel_mm,
        pinion_mm: keys.pinion_mm,
        material: keys.material.clone().unwrap_or_default(),
        modes_to_hz: keys.modes_to_hz.unwrap_or_else(defaults::modes_to_hz),
        damping_ratio: keys.damping_ratio.unwrap_or_else(defaults::shaft_damping_ratio),
    }))
}

impl TryFrom<ShaftKeys> for Shaft {
    type Error = ShaftKeysError;

    fn try_from(keys: ShaftKeys) -> Result<Self, ShaftKeysError> {
        let beam = beam(&keys)?;
        // Where sections are wrong, what follows from them has no meaning: the sections are told.
        let usable = |value: f64| (value.is_finite() && value > 0.0).then_some(value);
        let of_sections = |of: fn(&Beam) -> f64| beam.as_ref().map(of).and_then(usable);
        let sums = beam.as_ref().map(Beam::sums);
        let plain = Self::named("");
        Ok(Self {
            inertia_kg_m2: keys
                .inertia_kg_m2
                .or_else(|| of_sections(Beam::inertia_kg_m2))
                .unwrap_or(plain.inertia_kg_m2),
            torsion_nm_per_rad: match (&beam, keys.torsion_nm_per_rad) {
                (_, Some(stated)) => stated,
                (Some(beam), None) => usable(beam.torsion_nm_per_rad()).unwrap_or(f64::INFINITY),
                (None, None) => plain.torsion_nm_per_rad,
            },
            torsion_damping_nm_s_per_rad: keys
                .torsion_damping_nm_s_per_rad
                .unwrap_or(plain.torsion_damping_nm_s_per_rad),
            bearing_n_per_m: keys
                .bearing_n_per_m
                .or(sums.and_then(|sums| usable(sums.0)))
                .unwrap_or(plain.bearing_n_per_m),
            bearing_damping_n_s_per_m: keys
                .bearing_damping_n_s_per_m
                .or(sums.map(|sums| sums.1))
                .unwrap_or(plain.bearing_damping_n_s_per_m),
            axial_n_per_m: keys.axial_n_per_m,
            beam: beam.map(Box::new),
            name: keys.name,
        })
    }
}

impl From<Shaft> for ShaftKeys {
    fn from(shaft: Shaft) -> Self {
        let stiff = shaft.beam.is_none();
        let scales = shaft.beam.as_ref().map(|beam| beam.scales(&shaft));
        let mut out = Self {
            name: shaft.name,
            inertia_kg_m2: Some(shaft.inertia_kg_m2),
            torsion_nm_per_rad: Some(shaft.torsion_nm_per_rad),
            torsion_damping_nm_s_per_rad: Some(shaft.torsion_damping_nm_s_per_rad),
            bearing_n_per_m: stiff.then_some(shaft.bearing_n_per_m),
            bearing_damping_n_s_per_m: stiff.then_some(shaft.bearing_damping_n_s_per_m),
            axial_n_per_m: shaft.axial_n_per_m,
            wheel_mm: None,
            pinion_mm: None,
            modes_to_hz: None,
            damping_ratio: None,
            sections: Vec::new(),
            supports: Vec::new(),
            material: None,
        };
        if let (Some(beam), Some((stiffness, damping))) = (shaft.beam, scales) {
            out.wheel_mm = beam.wheel_mm;
            out.pinion_mm = beam.pinion_mm;
            out.modes_to_hz = Some(beam.modes_to_hz);
            out.damping_ratio = Some(beam.damping_ratio);
            out.sections = beam.sections;
            out.supports = beam.supports;
            for support in &mut out.supports {
                support.stiffness_n_per_m *= stiffness;
                support.tilt_nm_per_rad *= stiffness;
                support.damping_n_s_per_m *= damping;
            }
            out.material = Some(beam.material);
        }
        out
    }
}
