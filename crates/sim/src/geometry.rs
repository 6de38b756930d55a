//! Geometry of involute spur gears, external with profile shift and internal without, and of a pair
//! of them at its operating centre distance.
//!
//! Standard proportions (ISO 53, profile A): addendum `h_a* = 1`, clearance `c* = 0.25`. The rack
//! stands off by the profile shift `x m` (ISO 21771). Positions on the flank are *roll
//! coordinates*: the distance ξ along the line of action from the tangent point on the gear's own
//! base circle, so that the roll angle is ξ / r_b and the radius is `sqrt(r_b² + ξ²)`.
//!
//! A tooth of an internal gear is the space between two teeth of an external one: it grows towards
//! the root, which is the larger circle. Its heights are counted towards the tip all the same, so
//! that they are negative radii.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

mod cutting;
mod pair;
mod problem;

pub use self::cutting::{Cutting, LEAST_TIP, Tip};
pub use gearwatch_core::bench::shift::involute;
pub use pair::{Mounting, PairGeometry};
pub use problem::{GearError, PairError};

/// Addendum / module (ISO 53).
pub const ADDENDUM: f64 = 1.0;
/// Tip clearance / module (ISO 53, profile A).
pub const CLEARANCE: f64 = 0.25;

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
    /// Profile shift / module x, positive away from the axis; 0 for internal gears.
    pub profile_shift: f64,
    /// Face width L.
    pub face_width_m: f64,
    /// Radius of the bore, the rigid inner border of the gear body; of an internal gear the outer
    /// border of its rim.
    pub bore_radius_m: f64,
    /// Reference radius `r = m z / 2`.
    pub reference_radius_m: f64,
    /// Working pitch radius `r_w = r_b / cos α_w` at the nominal centre distance of its pair, the
    /// reference radius before it has a mate.
    pub pitch_radius_m: f64,
    /// Base radius `r_b = r cos α₀`.
    pub base_radius_m: f64,
    /// Tip radius `r_a = r + (h_a* + x − k) m` with the tip shortening k; of an internal gear
    /// `r − h_a* m`, or more where its teeth are cut back for its mate.
    pub tip_radius_m: f64,
    /// Root radius `r_f = r − (h_a* + c* − x) m`; of an internal gear `r + (h_a* + c*) m`.
    pub root_radius_m: f64,
    /// Half of the tooth angle on the base circle, `α₂ = (π/2 + 2 x tan α₀)/z + inv α₀`; of an
    /// internal gear `inv α₀ − π/(2z)`, by which the angle of the load is the same formula.
    pub half_base_angle_rad: f64,
    /// The teeth are inside.
    pub internal: bool,
}

/// Rim of an internal gear beyond its roots / module where the sheet says nothing.
pub const RIM: f64 = 3.0;

impl GearGeometry {
    /// A gear of the standard rack without profile shift; `which` names it in errors.
    pub fn new(
        which: &str,
        teeth: u32,
        module_m: f64,
        pressure_angle_rad: f64,
        face_width_m: f64,
        bore_radius_m: f64,
    ) -> Result<Self, GearError> {
        Self::cut(which, teeth, &Cutting::standard(module_m, pressure_angle_rad), face_width_m, bore_radius_m)
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

    /// Half of the tooth's thickness at its root (m): on the base circle of external gears, where
    /// the classical tooth begins.
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

    /// Angle α₁ between the tooth force at roll coordinate ξ and the normal to the tooth's centre
    /// line: `α₁ = ξ / r_b − α₂`.
    pub fn load_angle_rad(&self, roll_m: f64) -> f64 {
        roll_m / self.base_radius_m - self.half_base_angle_rad
    }

    /// Height y above the gear centre and half thickness h of the involute flank where the load
    /// angle is `a`: `y = r_b[(a + α₂) sin a + cos a]`, `h = r_b[(a + α₂) cos a − sin a]`.
    pub fn flank_point_m(&self, a: f64) -> (f64, f64) {
        self.flank_point_of(a, a.sin_cos())
    }

    /// As [`Self::flank_point_m`], from the load angle and its sine and cosine.
    pub(crate) fn flank_point_of(&self, a: f64, (sin, cos): (f64, f64)) -> (f64, f64) {
        let roll = a + self.half_base_angle_rad;
        let (height, half) = (self.base_radius_m * (roll * sin + cos), self.base_radius_m * (roll * cos - sin));
        if self.internal { (-height, -half) } else { (height, half) }
    }

    /// Where the flank begins that a rack with sharp addendum `h_a* m` generates; below it lies the
    /// fillet: `r_c² = (r_b tan α₀ − (h_a* − x) m / sin α₀)² + r_b²`. `None` where the rack
    /// undercuts the flank.
    pub fn involute_start_radius_m(&self) -> Option<f64> {
        let roll = self.base_radius_m * self.pressure_angle_rad.tan()
            - (self.addendum - self.profile_shift) * self.module_m / self.pressure_angle_rad.sin();
        (roll >= 0.0).then(|| roll.hypot(self.base_radius_m))
    }

    /// Thickness of an external tooth along the circle of a radius at or beyond the base circle
    /// (m): `2 r (α₂ − inv α_r)`, `cos α_r = r_b / r`.
    pub fn thickness_m(&self, radius_m: f64) -> f64 {
        2.0 * radius_m * (self.half_base_angle_rad - involute((self.base_radius_m / radius_m).min(1.0).acos()))
    }

    /// The teeth are those of a rack without shift, with standard tips.
    pub fn is_standard(&self) -> bool {
        self.profile_shift == 0.0
            && (self.internal || self.tip_radius_m == self.reference_radius_m + self.addendum * self.module_m)
    }

    /// Height of the involute part of the tooth, from the start of the involute (or the root,
    /// whichever is higher) to the tip.
    pub fn flank_height_m(&self) -> f64 {
        if self.internal {
            return self.root_radius_m - self.tip_radius_m;
        }
        self.tip_radius_m - self.base_radius_m.max(self.root_radius_m)
    }
}

/// Limits of the rack-generated fillet's parameter γ: from the root (π/2) to the start of the
/// involute (α₀).
pub(crate) fn fillet_range(gear: &GearGeometry) -> (f64, f64) {
    (FRAC_PI_2, gear.pressure_angle_rad)
}
