//! Geometry of standard involute spur gears and of a pair of them at its operating centre distance.
//!
//! Standard proportions (ISO 53, profile A): addendum `h_a* = 1`, clearance `c* = 0.25`, no profile shift.
//! Positions on the flank are *roll coordinates*: the distance ξ along the line of action from the tangent point on
//! the gear's own base circle, so that the roll angle is ξ / r_b and the radius is `sqrt(r_b² + ξ²)`.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

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
    /// Radius of the bore, the rigid inner border of the gear body.
    pub bore_radius_m: f64,
    /// Reference radius `r = m z / 2`.
    pub reference_radius_m: f64,
    /// Base radius `r_b = r cos α₀`.
    pub base_radius_m: f64,
    /// Tip radius `r_a = r + h_a* m`.
    pub tip_radius_m: f64,
    /// Root radius `r_f = r − (h_a* + c*) m`.
    pub root_radius_m: f64,
    /// Half of the tooth angle on the base circle, `α₂ = π/(2z) + inv α₀`.
    pub half_base_angle_rad: f64,
}

impl GearGeometry {
    /// A gear from what a bench file says of it; `which` names it in errors.
    pub fn new(
        which: &str,
        teeth: u32,
        module_m: f64,
        pressure_angle_rad: f64,
        face_width_m: f64,
        bore_radius_m: f64,
    ) -> Result<Self, String> {
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
    ) -> Result<Self, String> {
        if teeth < 5 {
            return Err(format!("{which} has {teeth} teeth; an involute gear has at least 5"));
        }
        for (name, value) in [("module", module_m), ("face width", face_width_m)] {
            if !(value.is_finite() && value > 0.0) {
                return Err(format!("{which}: {name} is {} mm; it must be above 0", value * 1e3));
            }
        }
        if !(pressure_angle_rad > 0.1 && pressure_angle_rad < 0.7) {
            return Err(format!(
                "{which}: pressure angle is {:.3} degrees; expected 10 to 35 (20 is usual)",
                pressure_angle_rad.to_degrees()
            ));
        }
        let reference_radius_m = 0.5 * module_m * f64::from(teeth);
        let root_radius_m = reference_radius_m - (addendum + clearance) * module_m;
        if !(bore_radius_m.is_finite() && bore_radius_m > 0.0 && bore_radius_m < root_radius_m) {
            return Err(format!(
                "{which}: bore diameter is {:.3} mm; it must be above 0 and below the root diameter, {:.3} mm",
                2e3 * bore_radius_m,
                2e3 * root_radius_m
            ));
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
        })
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
        (self.base_radius_m * (roll * sin + cos), self.base_radius_m * (roll * cos - sin))
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
        self.tip_radius_m - self.base_radius_m.max(self.root_radius_m)
    }
}

/// Two gears at an operating centre distance. Gear 1, the pinion, drives.
#[derive(Clone, Debug, PartialEq)]
pub struct PairGeometry {
    /// The driving gear.
    pub pinion: GearGeometry,
    /// The driven gear.
    pub wheel: GearGeometry,
    /// Centre distance a.
    pub centre_distance_m: f64,
    /// Operating pressure angle, `cos α_w = (r_b1 + r_b2) / a`.
    pub operating_angle_rad: f64,
    /// Length of the line of action between the tangent points, `T = a sin α_w`.
    pub tangent_length_m: f64,
    /// Pinion roll coordinate at which a pair enters, `ξ_A = T − sqrt(r_a2² − r_b2²)`.
    pub entry_roll_m: f64,
    /// Pinion roll coordinate at which a pair leaves, `ξ_E = sqrt(r_a1² − r_b1²)`.
    pub exit_roll_m: f64,
    /// Pinion roll coordinate of the pitch point, `ξ_P = T z₁ / (z₁ + z₂)`.
    pub pitch_roll_m: f64,
    /// Base pitch p_b.
    pub base_pitch_m: f64,
    /// Contact ratio ε = (ξ_E − ξ_A) / p_b.
    pub contact_ratio: f64,
}

impl PairGeometry {
    /// A pair at its nominal centre distance `a = r₁ + r₂` plus `centre_shift_m`.
    ///
    /// Refused: interference (a tip reaches below the other gear's base circle), a contact ratio below 1 or of 3 and more.
    pub fn new(pinion: GearGeometry, wheel: GearGeometry, centre_shift_m: f64) -> Result<Self, String> {
        let centre_distance_m = pinion.reference_radius_m + wheel.reference_radius_m + centre_shift_m;
        let bases = pinion.base_radius_m + wheel.base_radius_m;
        if !(centre_distance_m.is_finite() && centre_distance_m > bases) {
            return Err(format!(
                "the centre distance is {:.4} mm; involutes touch only beyond the sum of the base radii, {:.4} mm",
                1e3 * centre_distance_m,
                1e3 * bases
            ));
        }
        let operating_angle_rad = (bases / centre_distance_m).acos();
        let tangent_length_m = centre_distance_m * operating_angle_rad.sin();
        let base_pitch_m = pinion.base_pitch_m();
        let entry_roll_m = tangent_length_m - wheel.roll_at_radius_m(wheel.tip_radius_m);
        let exit_roll_m = pinion.roll_at_radius_m(pinion.tip_radius_m);
        let contact_ratio = (exit_roll_m - entry_roll_m) / base_pitch_m;
        if entry_roll_m < 0.0 || exit_roll_m > tangent_length_m {
            let (short, long) = if entry_roll_m < 0.0 { (&pinion, &wheel) } else { (&wheel, &pinion) };
            return Err(format!(
                "interference: the tips of the gear with {} teeth reach below the base circle of the gear with {} teeth; \
                 at {:.1} degrees and without profile shift the smaller one needs at least {} teeth",
                long.teeth,
                short.teeth,
                pinion.pressure_angle_rad.to_degrees(),
                fewest_teeth(long.teeth, pinion.pressure_angle_rad, long.addendum)
            ));
        }
        if contact_ratio < 1.0 {
            return Err(format!(
                "the contact ratio is {contact_ratio:.3}; below 1 the teeth lose each other in every mesh. \
                 More teeth, a smaller pressure angle or a smaller centre distance raise it"
            ));
        }
        if contact_ratio >= 3.0 {
            return Err(format!(
                "the contact ratio is {contact_ratio:.3}; the model covers spur gears from 1 to below 3"
            ));
        }
        Ok(Self {
            pitch_roll_m: tangent_length_m * f64::from(pinion.teeth) / f64::from(pinion.teeth + wheel.teeth),
            pinion,
            wheel,
            centre_distance_m,
            operating_angle_rad,
            tangent_length_m,
            entry_roll_m,
            exit_roll_m,
            base_pitch_m,
            contact_ratio,
        })
    }

    /// Pinion rotation during which two pairs carry, `θ_d = (ε − 1) 2π / z₁` (rad).
    pub fn double_contact_angle_rad(&self) -> f64 {
        (self.contact_ratio - 1.0) * TAU / f64::from(self.pinion.teeth)
    }

    /// Phase of the pitch point within a pair's path, in mesh cycles since its entry.
    pub fn pitch_phase(&self) -> f64 {
        (self.pitch_roll_m - self.entry_roll_m) / self.base_pitch_m
    }

    /// Distance (m, along the line of action) by which a tip is still away from the mating flank when the pair is
    /// `lead` mesh cycles before its theoretical entry (`at_exit = false`) or after its theoretical exit (`true`): corner contact.
    ///
    /// Derivation: the tip of the one gear turns on its tip circle; the mating flank at the radius of the tip is turned
    /// away from it by an angle, which times the base radius is the way along the line of action. It grows as `lead²`.
    pub fn corner_gap_m(&self, lead: f64, at_exit: bool) -> f64 {
        // By symmetry the exit is the entry with the gears exchanged: `tip` owns the corner, `flank` the flank.
        let (tip, flank) = if at_exit { (&self.pinion, &self.wheel) } else { (&self.wheel, &self.pinion) };
        let a = self.centre_distance_m;
        let tip_angle = (tip.base_radius_m / tip.tip_radius_m).acos();
        // Angle of the corner from the line of centres, seen from its own centre, at theoretical contact and `lead` earlier.
        let at_contact = tip_angle - self.operating_angle_rad;
        let turn_tip = TAU * lead / f64::from(tip.teeth);
        let turn_flank = TAU * lead / f64::from(flank.teeth);
        let polar = |angle: f64| {
            let (sin, cos) = angle.sin_cos();
            let (x, y) = (a - tip.tip_radius_m * cos, tip.tip_radius_m * sin);
            (x.hypot(y), y.atan2(x))
        };
        let flank_inv = |radius: f64| {
            let roll = flank.roll_at_radius_m(radius) / flank.base_radius_m;
            roll - roll.atan()
        };
        let (radius_0, angle_0) = polar(at_contact);
        let (radius, angle) = polar(at_contact + turn_tip);
        // Angles towards the entry side are positive: the flank lies further back by `turn_flank`, and leans back towards its tip.
        let flank_angle = angle_0 + turn_flank + flank_inv(radius) - flank_inv(radius_0);
        ((flank_angle - angle) * flank.base_radius_m).max(0.0)
    }
}

/// Least number of teeth that mates with `other` teeth of this addendum / module without interference (no shift).
fn fewest_teeth(other: u32, pressure_angle_rad: f64, addendum: f64) -> u32 {
    let free = |z: u32| {
        let (z, other) = (f64::from(z), f64::from(other));
        let reach = ((other / 2.0 + addendum).powi(2) - (other / 2.0 * pressure_angle_rad.cos()).powi(2)).sqrt();
        reach <= (z + other) / 2.0 * pressure_angle_rad.sin()
    };
    (5..200).find(|&z| free(z)).unwrap_or(200)
}

/// Limits of the rack-generated fillet's parameter γ: from the root (π/2) to the start of the involute (α₀).
pub(crate) fn fillet_range(gear: &GearGeometry) -> (f64, f64) {
    (FRAC_PI_2, gear.pressure_angle_rad)
}
