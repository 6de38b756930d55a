//! Geometry of standard involute spur gears, external and internal, and of a pair of them at its operating centre distance.
//!
//! Standard proportions (ISO 53, profile A): addendum `h_a* = 1`, clearance `c* = 0.25`, no profile shift.
//! Positions on the flank are *roll coordinates*: the distance ξ along the line of action from the tangent point on
//! the gear's own base circle, so that the roll angle is ξ / r_b and the radius is `sqrt(r_b² + ξ²)`.
//!
//! A tooth of an internal gear is the space between two teeth of an external one: it grows towards the root, which is the larger circle. Its heights are counted
//! towards the tip all the same, so that they are negative radii.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

mod pair;
mod problem;

pub use pair::PairGeometry;
pub use problem::{GearError, PairError};

/// Addendum / module (ISO 53).
pub const ADDENDUM: f64 = 1.0;
/// Tip clearance / module (ISO 53, profile A).
pub const CLEARANCE: f64 = 0.25;

/// Involute function `inv α = tan α − α` (radians).
pub fn involute(angle_rad: f64) -> f64 {
    angle_rad.tan() - angle_rad
}

/// One gear. All lengths in metres, angles in radians.
#[derive(Clone, Debug, PartialEq)]
pub struct GearGeometry {
    /// Number of teeth z.
    pub teeth: u32,
    /// Module m.
    pub module_m: f64,
    /// Pressure angle α₀ at the reference circle.
    pub pressure_angle_rad: f64,
    /// Addendum / module h_a*; 1 for spur gears, in the transverse section of helical ones less.
    pub addendum: f64,
    /// Tip clearance / module c*.
    pub clearance: f64,
    /// Face width L.
    pub face_width_m: f64,
    /// Radius of the bore, the rigid inner border of the gear body; of an internal gear the outer border of its rim.
    pub bore_radius_m: f64,
    /// Reference radius `r = m z / 2`.
    pub reference_radius_m: f64,
    /// Base radius `r_b = r cos α₀`.
    pub base_radius_m: f64,
    /// Tip radius `r_a = r + h_a* m`; of an internal gear `r − h_a* m`, or more where its teeth are cut back for its mate.
    pub tip_radius_m: f64,
    /// Root radius `r_f = r − (h_a* + c*) m`; of an internal gear `r + (h_a* + c*) m`.
    pub root_radius_m: f64,
    /// Half of the tooth angle on the base circle, `α₂ = π/(2z) + inv α₀`; of an internal gear `inv α₀ − π/(2z)`, by which the angle of the load is the same formula.
    pub half_base_angle_rad: f64,
    /// The teeth are inside.
    pub internal: bool,
}

/// Rim of an internal gear beyond its roots / module where the sheet says nothing.
pub const RIM: f64 = 3.0;

impl GearGeometry {
    /// A gear from what a bench file says of it; `which` names it in errors.
    pub fn new(
        which: &str,
        teeth: u32,
        module_m: f64,
        pressure_angle_rad: f64,
        face_width_m: f64,
        bore_radius_m: f64,
    ) -> Result<Self, GearError> {
        let rack = [ADDENDUM, CLEARANCE];
        Self::with_rack(which, teeth, [module_m, pressure_angle_rad], rack, face_width_m, bore_radius_m)
    }

    /// As [`Self::new`], with module (m) and pressure angle (rad) and with addendum and clearance by the module that are not those of the standard rack.
    pub(crate) fn with_rack(
        which: &str,
        teeth: u32,
        [module_m, pressure_angle_rad]: [f64; 2],
        [addendum, clearance]: [f64; 2],
        face_width_m: f64,
        bore_radius_m: f64,
    ) -> Result<Self, GearError> {
        if teeth < 5 {
            return Err(GearError::FewTeeth { which: which.to_owned(), teeth });
        }
        for (name, value) in [("module", module_m), ("face width", face_width_m)] {
            if !(value.is_finite() && value > 0.0) {
                return Err(GearError::Length { which: which.to_owned(), name, found_mm: value * 1e3 });
            }
        }
        if !(pressure_angle_rad > 0.1 && pressure_angle_rad < 0.7) {
            let found_deg = pressure_angle_rad.to_degrees();
            return Err(GearError::PressureAngle { which: which.to_owned(), found_deg });
        }
        let reference_radius_m = 0.5 * module_m * f64::from(teeth);
        let root_radius_m = reference_radius_m - (addendum + clearance) * module_m;
        if !(bore_radius_m.is_finite() && bore_radius_m > 0.0 && bore_radius_m < root_radius_m) {
            let (found_mm, root_mm) = (2e3 * bore_radius_m, 2e3 * root_radius_m);
            return Err(GearError::Bore { which: which.to_owned(), found_mm, root_mm });
        }
        Ok(Self {
            teeth,
            module_m,
            pressure_angle_rad,
            addendum,
            clearance,
            face_width_m,
            bore_radius_m,
            reference_radius_m,
            base_radius_m: reference_radius_m * pressure_angle_rad.cos(),
            tip_radius_m: reference_radius_m + addendum * module_m,
            root_radius_m,
            half_base_angle_rad: PI / (2.0 * f64::from(teeth)) + involute(pressure_angle_rad),
            internal: false,
        })
    }

    /// An internal gear; its rim ends at `outer_radius_m`.
    pub fn internal(
        which: &str,
        teeth: u32,
        module_m: f64,
        pressure_angle_rad: f64,
        face_width_m: f64,
        outer_radius_m: f64,
    ) -> Result<Self, GearError> {
        // Numbers that no gear has are refused as those of an external one, whose bore always fits.
        let bore = 0.125 * module_m * f64::from(teeth);
        let external = Self::new(which, teeth, module_m, pressure_angle_rad, face_width_m, bore)?;
        let reference = external.reference_radius_m;
        let root_radius_m = reference + (ADDENDUM + CLEARANCE) * module_m;
        if !(outer_radius_m.is_finite() && outer_radius_m > root_radius_m) {
            let (found_mm, root_mm) = (2e3 * outer_radius_m, 2e3 * root_radius_m);
            return Err(GearError::Rim { which: which.to_owned(), found_mm, root_mm });
        }
        let tip_radius_m = reference - ADDENDUM * module_m;
        if tip_radius_m <= external.base_radius_m {
            let fewest = (2.0 * ADDENDUM / (1.0 - pressure_angle_rad.cos())).ceil();
            let angle_deg = pressure_angle_rad.to_degrees();
            return Err(GearError::NoInvolute { which: which.to_owned(), teeth, fewest, angle_deg });
        }
        Ok(Self {
            bore_radius_m: outer_radius_m,
            tip_radius_m,
            root_radius_m,
            half_base_angle_rad: involute(pressure_angle_rad) - PI / (2.0 * f64::from(teeth)),
            internal: true,
            ..external
        })
    }

    /// Half of the tooth's thickness at its root (m): on the base circle of external gears, where the classical tooth begins.
    pub fn half_root_m(&self) -> f64 {
        if self.internal {
            self.flank_point_m(self.load_angle_rad(self.roll_at_radius_m(self.root_radius_m))).1
        } else {
            self.base_radius_m * self.half_base_angle_rad.sin()
        }
    }

    /// Base pitch `p_b = 2π r_b / z`.
    pub fn base_pitch_m(&self) -> f64 {
        TAU * self.base_radius_m / f64::from(self.teeth)
    }

    /// Roll coordinate ξ of the flank at a radius; 0 at or below the base circle.
    pub fn roll_at_radius_m(&self, radius_m: f64) -> f64 {
        (radius_m * radius_m - self.base_radius_m * self.base_radius_m).max(0.0).sqrt()
    }

    /// Angle α₁ between the tooth force at roll coordinate ξ and the normal to the tooth's centre line:
    /// `α₁ = ξ / r_b − α₂`.
    pub fn load_angle_rad(&self, roll_m: f64) -> f64 {
        roll_m / self.base_radius_m - self.half_base_angle_rad
    }

    /// Height y above the gear centre and half thickness h of the involute flank where the load angle is `a`:
    /// `y = r_b[(a + α₂) sin a + cos a]`, `h = r_b[(a + α₂) cos a − sin a]`.
    pub fn flank_point_m(&self, a: f64) -> (f64, f64) {
        self.flank_point_of(a, a.sin_cos())
    }

    /// As [`Self::flank_point_m`], from the load angle and its sine and cosine.
    pub(crate) fn flank_point_of(&self, a: f64, (sin, cos): (f64, f64)) -> (f64, f64) {
        let roll = a + self.half_base_angle_rad;
        let (height, half) = (self.base_radius_m * (roll * sin + cos), self.base_radius_m * (roll * cos - sin));
        if self.internal { (-height, -half) } else { (height, half) }
    }

    /// Where the flank begins that a rack with sharp addendum `h_a* m` generates; below it lies the fillet:
    /// `r_c² = (r_b tan α₀ − h_a* m / sin α₀)² + r_b²`. `None` where the rack undercuts the flank.
    pub fn involute_start_radius_m(&self) -> Option<f64> {
        let roll = self.base_radius_m * self.pressure_angle_rad.tan()
            - self.addendum * self.module_m / self.pressure_angle_rad.sin();
        (roll >= 0.0).then(|| roll.hypot(self.base_radius_m))
    }

    /// Height of the involute part of the tooth, from the start of the involute (or the root, whichever is higher) to the tip.
    pub fn flank_height_m(&self) -> f64 {
        if self.internal {
            return self.root_radius_m - self.tip_radius_m;
        }
        self.tip_radius_m - self.base_radius_m.max(self.root_radius_m)
    }
}

/// Limits of the rack-generated fillet's parameter γ: from the root (π/2) to the start of the involute (α₀).
pub(crate) fn fillet_range(gear: &GearGeometry) -> (f64, f64) {
    (FRAC_PI_2, gear.pressure_angle_rad)
}
