//! How the teeth of an external gear are cut: the rack, how far it stands off, and where the tips
//! end.

use std::f64::consts::PI;

use super::{ADDENDUM, CLEARANCE, GearError, GearGeometry, involute};

/// Least thickness of a tooth at its tip / module. Thinner tips chip; hardened gears want 0.4 (G.
/// Niemann, H. Winter, "Maschinenelemente" II, tip thickness of cylindrical gears; DIN 3960). It is
/// asked of shifted and turned-off teeth alone.
pub const LEAST_TIP: f64 = 0.2;
/// Most profile shift / module, either way.
const MOST_SHIFT: f64 = gearwatch_core::bench::shift::MOST_SHIFT;

/// Where the tips of an external gear end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tip {
    /// Addendum `(h_a* + x − k) m`, with the tip shortening / module k.
    Shortened(f64),
    /// At a radius (m).
    At(f64),
}

/// How the teeth of an external gear are cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cutting {
    /// Module m (m).
    pub module_m: f64,
    /// Pressure angle α₀ of the rack (rad).
    pub pressure_angle_rad: f64,
    /// Addendum / module h_a*.
    pub addendum: f64,
    /// Tip clearance / module c*.
    pub clearance: f64,
    /// Profile shift / module x (-2 to 2), positive away from the axis.
    pub profile_shift: f64,
    /// Where the tips end.
    pub tip: Tip,
}

impl Cutting {
    /// By the rack of ISO 53, profile A, without profile shift; module in metres, pressure angle in
    /// radians.
    pub fn standard(module_m: f64, pressure_angle_rad: f64) -> Self {
        Self {
            module_m,
            pressure_angle_rad,
            addendum: ADDENDUM,
            clearance: CLEARANCE,
            profile_shift: 0.0,
            tip: Tip::Shortened(0.0),
        }
    }
}

impl GearGeometry {
    /// An external gear of a face width and bore radius (m); `which` names it in errors.
    ///
    /// # Errors
    /// Where there is no such gear. Of shifted teeth, and of teeth whose tips the sheet states: an
    /// undercut flank, tips below the flank, pointed tips.
    pub fn cut(
        which: &str,
        teeth: u32,
        cut: &Cutting,
        face_width_m: f64,
        bore_radius_m: f64,
    ) -> Result<Self, GearError> {
        Self::drawn(which, teeth, cut, face_width_m, bore_radius_m)?.usable(which)
    }

    /// As [`Self::cut`], whether or not its teeth can be used.
    pub(crate) fn drawn(
        which: &str,
        teeth: u32,
        cut: &Cutting,
        face_width_m: f64,
        bore_radius_m: f64,
    ) -> Result<Self, GearError> {
        let Cutting { module_m, pressure_angle_rad, addendum, clearance, profile_shift, tip } = *cut;
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
        if !(-MOST_SHIFT..=MOST_SHIFT).contains(&profile_shift) {
            return Err(GearError::Shift { which: which.to_owned(), found: profile_shift, most: MOST_SHIFT });
        }
        let z = f64::from(teeth);
        let reference_radius_m = 0.5 * module_m * z;
        let root_radius_m = reference_radius_m - (addendum + clearance - profile_shift) * module_m;
        if !(bore_radius_m.is_finite() && bore_radius_m > 0.0 && bore_radius_m < root_radius_m) {
            let (found_mm, root_mm) = (2e3 * bore_radius_m, 2e3 * root_radius_m);
            return Err(GearError::Bore { which: which.to_owned(), found_mm, root_mm });
        }
        let tip_radius_m = match tip {
            Tip::Shortened(by) => reference_radius_m + (addendum + profile_shift - by) * module_m,
            Tip::At(radius_m) => radius_m,
        };
        let thicker = 2.0 * profile_shift * pressure_angle_rad.tan() / z;
        Ok(Self {
            teeth,
            module_m,
            pressure_angle_rad,
            addendum,
            clearance,
            profile_shift,
            face_width_m,
            bore_radius_m,
            reference_radius_m,
            pitch_radius_m: reference_radius_m,
            base_radius_m: reference_radius_m * pressure_angle_rad.cos(),
            tip_radius_m,
            root_radius_m,
            half_base_angle_rad: PI / (2.0 * z) + thicker + involute(pressure_angle_rad),
            internal: false,
        })
    }

    /// Refuses teeth of their own that cannot be used.
    pub(crate) fn usable(self, which: &str) -> Result<Self, GearError> {
        if self.is_standard() {
            return Ok(self);
        }
        let which = || which.to_owned();
        let start = self.involute_start_radius_m();
        if start.is_none() && self.profile_shift != 0.0 {
            // By the normal module, whose addendum is 1.
            let (teeth, shift) = (self.teeth, self.profile_shift / self.addendum);
            return Err(GearError::Undercut { which: which(), teeth, shift, least: self.least_shift() });
        }
        let start = start.unwrap_or(self.base_radius_m).max(self.root_radius_m);
        if !(self.tip_radius_m.is_finite() && self.tip_radius_m > start) {
            let (found_mm, start_mm) = (2e3 * self.tip_radius_m, 2e3 * start);
            return Err(GearError::Tip { which: which(), found_mm, start_mm });
        }
        let (thickness, least) = (self.thickness_m(self.tip_radius_m), LEAST_TIP * self.module_m);
        if thickness < least {
            return Err(GearError::Pointed {
                which: which(),
                tip_mm: 2e3 * self.tip_radius_m,
                found_mm: 1e3 * thickness,
                least_mm: 1e3 * least,
                most_mm: 2e3 * self.radius_of_thickness_m(least),
            });
        }
        Ok(self)
    }

    /// Profile shift / module, rounded up to three decimals, from which on the rack does not
    /// undercut the teeth: `x = h_a* − z sin² α₀ / 2`, by the normal module of helical teeth too,
    /// whose addendum is 1 of that.
    pub(crate) fn least_shift(&self) -> f64 {
        let sin = self.pressure_angle_rad.sin();
        let transverse = self.addendum - 0.5 * f64::from(self.teeth) * sin * sin;
        (1e3 * transverse / self.addendum).ceil() * 1e-3
    }

    /// Radius (m) below the tip at which the teeth are as thick; they taper above the base circle.
    fn radius_of_thickness_m(&self, thickness_m: f64) -> f64 {
        let (mut low, mut high) = (self.base_radius_m, self.tip_radius_m);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.thickness_m(middle) > thickness_m { low = middle } else { high = middle }
        }
        low
    }
}
