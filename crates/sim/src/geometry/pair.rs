//! A pair of gears at its operating centre distance: path of contact, and corner contact beyond it.

use std::f64::consts::TAU;

use gearwatch_core::bench::shift::play_free_angle_rad;

use super::{GearGeometry, PairError, involute};

/// Where the gears of a pair stand.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mounting {
    /// Nominal centre distance (m); that free of play where left out.
    pub centre_distance_m: Option<f64>,
    /// By how much the axes stand further apart than nominal (m).
    pub centre_shift_m: f64,
}

/// Two gears at an operating centre distance. Gear 1, the pinion, drives. One of them may be
/// internal.
#[derive(Clone, Debug, PartialEq)]
pub struct PairGeometry {
    /// The driving gear.
    pub pinion: GearGeometry,
    /// The driven gear.
    pub wheel: GearGeometry,
    /// Centre distance a.
    pub centre_distance_m: f64,
    /// Operating pressure angle, `cos α_w = (r_b1 + r_b2) / a`; of an internal pair with the
    /// difference of the base radii.
    pub operating_angle_rad: f64,
    /// Length of the line of action between the tangent points, `T = a sin α_w`.
    pub tangent_length_m: f64,
    /// Pinion roll coordinate at which a pair enters: where the wheel's tip is,
    /// `ξ_A = T − sqrt(r_a2² − r_b2²)` of external pairs.
    pub entry_roll_m: f64,
    /// Pinion roll coordinate at which a pair leaves, `ξ_E = sqrt(r_a1² − r_b1²)`.
    pub exit_roll_m: f64,
    /// Pinion roll coordinate of the pitch point, `ξ_P = r_b1 tan α_w`.
    pub pitch_roll_m: f64,
    /// Base pitch p_b.
    pub base_pitch_m: f64,
    /// Contact ratio ε = |ξ_E − ξ_A| / p_b.
    pub contact_ratio: f64,
    /// Play along the line of action of the nominal centre distance beyond that free of play,
    /// `2 (r_b1 + r_b2)(inv α_a − inv α_w)` (m).
    pub play_m: f64,
    /// Thickness of the pinion's teeth on its working pitch circle / pitch; half without profile
    /// shift.
    pub pinion_thickness: f64,
}

impl PairGeometry {
    /// A pair at its centre distance free of play, `a = r₁ + r₂` where the gears have no profile
    /// shift together, plus `centre_shift_m`. As [`Self::mounted`].
    pub fn new(pinion: GearGeometry, wheel: GearGeometry, centre_shift_m: f64) -> Result<Self, PairError> {
        Self::mounted(pinion, wheel, Mounting { centre_distance_m: None, centre_shift_m })
    }

    /// A pair where it is mounted.
    ///
    /// Refused: interference (a tip reaches below the other gear's base circle, of shifted gears
    /// below its involute), a contact ratio below 1 or of 3 and more.
    ///
    /// Teeth of an internal gear are cut back to where the involute of its mate begins, as shapers
    /// leave them: standard tips would rub on its fillets.
    pub fn mounted(mut pinion: GearGeometry, mut wheel: GearGeometry, mounting: Mounting) -> Result<Self, PairError> {
        if pinion.internal && wheel.internal {
            return Err(PairError::BothInternal);
        }
        let internal = pinion.internal || wheel.internal;
        let (standard, bases) = if internal {
            let (inside, around) = if pinion.internal { (&wheel, &pinion) } else { (&pinion, &wheel) };
            (around.reference_radius_m - inside.reference_radius_m, around.base_radius_m - inside.base_radius_m)
        } else {
            (pinion.reference_radius_m + wheel.reference_radius_m, pinion.base_radius_m + wheel.base_radius_m)
        };
        let own_teeth = !(pinion.is_standard() && wheel.is_standard() && mounting.centre_distance_m.is_none());
        let (mut play_m, mut pinion_thickness, mut centres) = (0.0, 0.5, standard);
        if own_teeth && !internal {
            let sum = pinion.profile_shift + wheel.profile_shift;
            let tooth_sum = f64::from(pinion.teeth) + f64::from(wheel.teeth);
            let angle = pinion.pressure_angle_rad;
            let free = play_free_angle_rad(angle, sum, tooth_sum).ok_or(PairError::Thin { sum })?;
            centres = mounting.centre_distance_m.unwrap_or(if sum == 0.0 { standard } else { bases / free.cos() });
            if centres > bases {
                let at = if centres == standard { angle } else { (bases / centres).acos() };
                if mounting.centre_distance_m.is_some() {
                    play_m = 2.0 * bases * (involute(at) - involute(free));
                }
                if play_m < 0.0 {
                    return Err(PairError::Jams { found_mm: 1e3 * centres, free_mm: 1e3 * bases / free.cos() });
                }
                above_the_fillets([&pinion, &wheel], bases * at.tan())?;
                for gear in [&mut pinion, &mut wheel] {
                    gear.pitch_radius_m =
                        if at == angle { gear.reference_radius_m } else { gear.base_radius_m / at.cos() };
                }
                let pitch_radius_m = pinion.pitch_radius_m;
                pinion_thickness = f64::from(pinion.teeth) / TAU * pinion.thickness_m(pitch_radius_m) / pitch_radius_m;
            }
        }
        let centre_distance_m = centres + mounting.centre_shift_m;
        if !(centre_distance_m.is_finite() && centre_distance_m > bases && bases > 0.0) {
            let (found_mm, bases_mm) = (1e3 * centre_distance_m, 1e3 * bases);
            return Err(PairError::CentreDistance { found_mm, internal, bases_mm });
        }
        let operating_angle_rad = (bases / centre_distance_m).acos();
        let tangent_length_m = centre_distance_m * operating_angle_rad.sin();
        let base_pitch_m = pinion.base_pitch_m();
        if internal {
            let (inside, around) = if pinion.internal { (&wheel, &mut pinion) } else { (&pinion, &mut wheel) };
            cut_back(around, inside, tangent_length_m)?;
        }
        let tip_roll = |gear: &GearGeometry| gear.roll_at_radius_m(gear.tip_radius_m);
        let exit_roll_m = tip_roll(&pinion);
        let entry_roll_m = match (pinion.internal, wheel.internal) {
            (false, false) => tangent_length_m - tip_roll(&wheel),
            (false, true) => tip_roll(&wheel) - tangent_length_m,
            (true, _) => tip_roll(&wheel) + tangent_length_m,
        };
        let contact_ratio = (exit_roll_m - entry_roll_m).abs() / base_pitch_m;
        if !internal && (entry_roll_m < 0.0 || exit_roll_m > tangent_length_m) {
            let (short, long) = if entry_roll_m < 0.0 { (&pinion, &wheel) } else { (&wheel, &pinion) };
            return Err(PairError::Interference {
                long: long.teeth,
                short: short.teeth,
                angle_deg: pinion.pressure_angle_rad.to_degrees(),
                fewest: fewest_teeth(long.teeth, pinion.pressure_angle_rad, long.addendum),
                shift: short.least_shift(),
            });
        }
        if contact_ratio < 1.0 {
            return Err(PairError::LowContactRatio(contact_ratio));
        }
        if contact_ratio >= 3.0 {
            return Err(PairError::HighContactRatio(contact_ratio));
        }
        Ok(Self {
            pitch_roll_m: pinion.base_radius_m * operating_angle_rad.tan(),
            pinion,
            wheel,
            centre_distance_m,
            operating_angle_rad,
            tangent_length_m,
            entry_roll_m,
            exit_roll_m,
            base_pitch_m,
            contact_ratio,
            play_m,
            pinion_thickness,
        })
    }

    /// One of the gears is internal.
    pub fn is_internal(&self) -> bool {
        self.pinion.internal || self.wheel.internal
    }

    /// 1 where the pinion's roll coordinate grows as the pair goes on, −1 where the pinion is
    /// internal: its teeth, too, are climbed from root to tip.
    pub fn climb(&self) -> f64 {
        if self.pinion.internal { -1.0 } else { 1.0 }
    }

    /// Operating pressure angle, negative where the pinion is internal: the force on the wheel is
    /// turned by it from the tangent towards the pinion's outside.
    pub fn signed_angle_rad(&self) -> f64 {
        self.climb() * self.operating_angle_rad
    }

    /// Roll coordinates of the flanks of pinion and wheel, `s` mesh cycles after the pair's entry.
    #[inline(always)]
    pub fn rolls_m(&self, s: f64) -> [f64; 2] {
        let pinion = self.entry_roll_m + self.climb() * s * self.base_pitch_m;
        let wheel = match (self.pinion.internal, self.wheel.internal) {
            (false, false) => self.tangent_length_m - pinion,
            (false, true) => self.tangent_length_m + pinion,
            (true, _) => pinion - self.tangent_length_m,
        };
        [pinion, wheel]
    }

    /// Pinion rotation during which two pairs carry, `θ_d = (ε − 1) 2π / z₁` (rad).
    pub fn double_contact_angle_rad(&self) -> f64 {
        (self.contact_ratio - 1.0) * TAU / f64::from(self.pinion.teeth)
    }

    /// Phase of the pitch point within a pair's path, in mesh cycles since its entry.
    pub fn pitch_phase(&self) -> f64 {
        self.climb() * (self.pitch_roll_m - self.entry_roll_m) / self.base_pitch_m
    }

    /// Distance (m, along the line of action) by which a tip is still away from the mating flank
    /// when the pair is `lead` mesh cycles before its theoretical entry (`at_exit = false`) or
    /// after its theoretical exit (`true`): corner contact.
    ///
    /// Derivation: the tip of the one gear turns on its tip circle; the mating flank at the radius
    /// of the tip is turned away from it by an angle, which times the base radius is the way along
    /// the line of action. It grows as `lead²`.
    pub fn corner_gap_m(&self, lead: f64, at_exit: bool) -> f64 {
        // By symmetry the exit is the entry with the gears exchanged: `tip` owns the corner,
        // `flank` the flank.
        let (tip, flank) = if at_exit { (&self.pinion, &self.wheel) } else { (&self.wheel, &self.pinion) };
        let a = self.centre_distance_m;
        let tip_angle = (tip.base_radius_m / tip.tip_radius_m).acos();
        // Angle of the corner from the line of centres, seen from its own centre, at theoretical
        // contact.
        let at_contact = tip_angle - self.operating_angle_rad;
        let turn_tip = TAU * lead / f64::from(tip.teeth);
        let turn_flank = TAU * lead / f64::from(flank.teeth);
        let flank_inv = |radius: f64| {
            let roll = flank.roll_at_radius_m(radius) / flank.base_radius_m;
            roll - roll.atan()
        };
        if !self.is_internal() {
            // From the line of centres to the corner, `lead` before contact it stands further from
            // the line.
            let polar = |angle: f64| {
                let (sin, cos) = angle.sin_cos();
                let (x, y) = (a - tip.tip_radius_m * cos, tip.tip_radius_m * sin);
                (x.hypot(y), y.atan2(x))
            };
            let (radius_0, angle_0) = polar(at_contact);
            let (radius, angle) = polar(at_contact + turn_tip);
            // Angles towards the entry side are positive: the flank lies further back by
            // `turn_flank`, and leans back towards its tip.
            let flank_angle = angle_0 + turn_flank + flank_inv(radius) - flank_inv(radius_0);
            return ((flank_angle - angle) * flank.base_radius_m).max(0.0);
        }
        // Both gears turn in one sense. Seen along the line of action from the base circles
        // outwards the external gear's contact moves out as it drives; where the internal gear
        // drives, everything runs backwards, and the lead is one of time, whichever way.
        let centre = if tip.internal { -a } else { a };
        let polar = |angle: f64| {
            let (sin, cos) = angle.sin_cos();
            let (x, y) = (tip.tip_radius_m * cos + centre, tip.tip_radius_m * sin);
            (x.hypot(y), y.atan2(x))
        };
        // The corner leaves the contact inwards where it belongs to the internal gear, outwards
        // where to the external one.
        let away = if tip.internal { -1.0 } else { 1.0 };
        let (radius_0, angle_0) = polar(at_contact);
        let (radius, angle) = polar(at_contact + away * turn_tip);
        let flank_angle = angle_0 + away * turn_flank - (flank_inv(radius) - flank_inv(radius_0));
        (away * (flank_angle - angle) * flank.base_radius_m).max(0.0)
    }
}

/// Cuts the teeth of an internal gear back to where its mate's involute begins.
fn cut_back(around: &mut GearGeometry, inside: &GearGeometry, tangent_length_m: f64) -> Result<(), PairError> {
    let start = inside.involute_start_radius_m().map_or(0.0, |radius| inside.roll_at_radius_m(radius));
    let least = (tangent_length_m + start).hypot(around.base_radius_m);
    if least > around.tip_radius_m {
        around.tip_radius_m = least;
    }
    if around.tip_radius_m >= around.root_radius_m {
        return Err(PairError::NothingLeft { around: around.teeth, inside: inside.teeth });
    }
    Ok(())
}

/// Refuses tips that reach below the involute of the other gear.
fn above_the_fillets([pinion, wheel]: [&GearGeometry; 2], tangent_length_m: f64) -> Result<(), PairError> {
    for (long, short, [name, other]) in [(wheel, pinion, ["wheel", "pinion"]), (pinion, wheel, ["pinion", "wheel"])] {
        let start = short.involute_start_radius_m().unwrap_or(short.base_radius_m);
        let reach = (tangent_length_m - short.roll_at_radius_m(start)).max(0.0);
        // A rack's own tips touch where the involute begins: what is less than a nanometre below is
        // rounding.
        if long.roll_at_radius_m(long.tip_radius_m) > reach + 1e-9 {
            return Err(PairError::BelowInvolute {
                long: name,
                short: other,
                tip_mm: 2e3 * long.tip_radius_m,
                start_mm: 2e3 * start,
                most_mm: 2e3 * reach.hypot(long.base_radius_m),
            });
        }
    }
    Ok(())
}

/// Least number of teeth that mates with `other` teeth of this addendum / module without
/// interference (no shift).
fn fewest_teeth(other: u32, pressure_angle_rad: f64, addendum: f64) -> u32 {
    let free = |z: u32| {
        let (z, other) = (f64::from(z), f64::from(other));
        let reach = ((other / 2.0 + addendum).powi(2) - (other / 2.0 * pressure_angle_rad.cos()).powi(2)).sqrt();
        reach <= (z + other) / 2.0 * pressure_angle_rad.sin()
    };
    (5..200).find(|&z| free(z)).unwrap_or(200)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    fn pair(planet: u32, ring: u32) -> PairGeometry {
        let angle = 20_f64.to_radians();
        let inside = GearGeometry::new("planet", planet, 1e-3, angle, 0.02, 4e-3).unwrap();
        let around = GearGeometry::internal("ring", ring, 1e-3, angle, 0.02, 60e-3).unwrap();
        PairGeometry::new(inside, around, 0.0).unwrap()
    }

    /// Tooth of an internal gear at its pitch circle: half the pitch thick, and thicker towards the
    /// root; the height counts towards the tip.
    #[test]
    fn analytic_internal_tooth() {
        let ring = pair(36, 100).wheel;
        let at = |radius: f64| ring.flank_point_m(ring.load_angle_rad(ring.roll_at_radius_m(radius)));
        let (height, half) = at(ring.reference_radius_m);
        // π m / 4 along the arc; the chord is shorter by a 24 000th.
        assert!((half / (0.25e-3 * PI) - 1.0).abs() < 1e-4, "{half}");
        assert!(
            (height + ring.reference_radius_m).abs() < 1e-5 * 1e-3 + half * half / ring.reference_radius_m,
            "{height}"
        );
        assert!(at(ring.root_radius_m).1 > half && at(ring.tip_radius_m).1 < half);
        assert!(at(ring.tip_radius_m).0 > at(ring.root_radius_m).0);
    }

    /// Contact of planet and ring by hand: 36 and 100 teeth of 1 mm. The ring's tips are cut back
    /// by 0.0770 mm to where the planet's involute begins (ξ = r_b tan α − m/sin α = 3.2326 mm);
    /// the planet's tip leaves at 8.6545 mm: ε = 1.8366. With the ring driving the same way is gone
    /// backwards.
    #[test]
    fn analytic_internal_pair_by_hand() {
        let pair = pair(36, 100);
        let near = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-7, "{found} {expected}");
        near(pair.wheel.tip_radius_m - 49e-3, 0.07697e-3);
        near(pair.entry_roll_m, 3.23256e-3);
        near(pair.exit_roll_m, 8.65452e-3);
        assert!((pair.contact_ratio - 1.83663).abs() < 1e-5, "{}", pair.contact_ratio);
        let back = PairGeometry::new(pair.wheel.clone(), pair.pinion.clone(), 0.0).unwrap();
        assert!((back.contact_ratio - pair.contact_ratio).abs() < 1e-12);
        for s in [0.0, 0.7, 1.8] {
            let [planet, ring] = pair.rolls_m(s);
            let [ring_back, planet_back] = back.rolls_m(pair.contact_ratio - s);
            assert!((planet - planet_back).abs() < 1e-12 && (ring - ring_back).abs() < 1e-12);
            // Both are at one point of the line of action.
            assert!((ring - planet - pair.tangent_length_m).abs() < 1e-12);
        }
        assert!((pair.pitch_phase() + back.pitch_phase() - pair.contact_ratio).abs() < 1e-12);
    }

    /// Beyond the path the tip corner of an internal pair leaves the mating involute with the
    /// square of the lead (conjugate motion: no linear part), to either side and for either driver
    /// alike. The figures are those of an evaluation by hand: 0.2406 and 0.1841 µm at a twentieth
    /// of a cycle.
    #[test]
    fn analytic_corner_gaps_of_an_internal_pair() {
        let pair = pair(36, 100);
        let back = PairGeometry::new(pair.wheel.clone(), pair.pinion.clone(), 0.0).unwrap();
        for (at_exit, expected) in [(false, 0.2406e-6), (true, 0.1841e-6)] {
            let gap = |lead: f64| pair.corner_gap_m(lead, at_exit);
            assert!((gap(0.05) - expected).abs() < 1e-10, "{}", gap(0.05));
            assert!((gap(0.05) / gap(0.025) - 4.0).abs() < 0.05);
            assert!((gap(0.05) - back.corner_gap_m(0.05, !at_exit)).abs() < 1e-15);
        }
    }

    /// A ring too small for its pressure angle, and a gear that does not fit into it.
    #[test]
    fn conform_internal_gears_that_cannot_be() {
        let angle = 20_f64.to_radians();
        let said = GearGeometry::internal("ring", 30, 1e-3, angle, 0.02, 60e-3).unwrap_err().to_string();
        assert!(said.contains("30 teeth inside") && said.contains("34 teeth or more"), "{said}");
        let said = GearGeometry::internal("ring", 100, 1e-3, angle, 0.02, 40e-3).unwrap_err().to_string();
        assert!(said.contains("102.500 mm"), "{said}");
    }
}
