//! What can be wrong with the teeth of a stage: damage that changes stiffness, and deviations of
//! the flanks.
//!
//! Everything that sits on one tooth goes through one evaluation of that tooth's sections, so that
//! a composite fault is not the sum of its parts.

use std::collections::BTreeMap;

use gearwatch_core::bench::term::Harmonic;
use num_complex::Complex;

use crate::geometry::GearGeometry;

mod problem;

pub use problem::{ToothError, ToothProblem};

/// How a tooth is broken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BreakageKind {
    /// A fraction of the face width is gone over the whole height; the body keeps its stiffness.
    Width,
    /// A fraction of the tooth height is gone, from the tip.
    Height,
}

/// A broken tooth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Breakage {
    /// Fraction that is gone (0–1); 1 is the whole tooth in either kind.
    pub fraction: f64,
    /// Of what.
    pub kind: BreakageKind,
}

/// A circular pit (Liang, Zhang, Liu & Zuo 2016).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pit {
    /// Diameter on the flank (m).
    pub diameter_m: f64,
    /// Depth (m).
    pub depth_m: f64,
    /// Height of its centre above the pitch line (m), towards the tip.
    pub height_m: f64,
}

/// A rectangular spall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spall {
    /// Extent along the face width (m).
    pub width_m: f64,
    /// Extent along the tooth height (m).
    pub length_m: f64,
    /// Depth (m).
    pub depth_m: f64,
    /// Height of its centre above the pitch line (m), towards the tip.
    pub height_m: f64,
}

/// A crack that starts at the root of the loaded flank, over the whole width.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crack {
    /// Depth q (m).
    pub depth_m: f64,
    /// Inclination v between crack and tooth centre line (rad); 60° is usual.
    pub angle_rad: f64,
}

/// Damage of one tooth.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ToothDamage {
    /// Broken off.
    pub breakage: Option<Breakage>,
    /// Side by side along the face width; they do not overlap.
    pub pits: Vec<Pit>,
    /// Flaked off.
    pub spall: Option<Spall>,
    /// Cracked at the root.
    pub crack: Option<Crack>,
}

/// A wave on a gear that repeats each revolution, such as a ghost of the index wheel of the machine
/// that cut it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wave {
    /// Periods per revolution (> 0); a whole number for a ghost.
    pub order: f64,
    /// Amplitude along the line of action (m).
    pub amplitude_m: f64,
    /// Phase at tooth 0 (rad).
    pub phase_rad: f64,
}

/// Tip relief: `C_a ((ξ − ξ_start)/l)^n` over the last `l` of the path before the tip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TipRelief {
    /// Depth C_a at the tip (m).
    pub depth_m: f64,
    /// Length l / base pitch (0–1).
    pub length_fraction: f64,
    /// Power n: 1 linear, 2 parabolic.
    pub power: i32,
}

/// What is wrong with one gear.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GearModifications {
    /// Damage by tooth number (0 is the tooth that meshes at phase 0). Overrides `all_teeth` on
    /// that tooth.
    pub teeth: BTreeMap<u32, ToothDamage>,
    /// The same damage on every tooth.
    pub all_teeth: ToothDamage,
    /// Cumulative pitch error by tooth (m); positive is missing material, so the tooth touches
    /// late. Empty for none.
    pub pitch_error_m: Vec<f64>,
    /// Eccentricity ε of the gear's axis (m): half of the peak to peak runout.
    pub eccentricity_m: f64,
    /// Direction of the eccentricity at phase 0, from the line of centres, in the sense of rotation
    /// (rad).
    pub eccentricity_phase_rad: f64,
    /// Waves that repeat each revolution.
    pub waves: Vec<Wave>,
    /// The stiffness of pairs goes with 1 + Σ over the turn of the gear, tooth 0 entering at 0.
    pub stiffness_waves: Vec<Harmonic>,
    /// Material taken off at the tips.
    pub tip_relief: Option<TipRelief>,
    /// Worn depth (m) of all driving flanks along the line of action, at equally spaced places of
    /// the pair's path from its entry to its exit; straight between them, held beyond. Empty for
    /// none.
    pub worn_m: Vec<f64>,
    /// In place of [`Self::worn_m`] for helical teeth: by bands of equal width along the face, the
    /// end that enters first in front. Empty where all of the face is worn alike.
    pub worn_bands_m: Vec<Vec<f64>>,
}

impl GearModifications {
    /// Puts the gear off its axis by so much more (m), in a direction at phase 0 (rad): centre
    /// distances from an axis add as vectors.
    pub fn add_eccentricity(&mut self, more_m: f64, phase_rad: f64) {
        let own = Complex::from_polar(self.eccentricity_m, self.eccentricity_phase_rad);
        let sum = own + Complex::from_polar(more_m, phase_rad);
        // A gear that ran true is off by exactly what is added.
        (self.eccentricity_m, self.eccentricity_phase_rad) =
            if self.eccentricity_m == 0.0 { (more_m, phase_rad) } else { sum.to_polar() };
    }

    /// Puts each tooth off its place by so much more (m).
    pub fn add_pitch_errors(&mut self, more_m: &[f64]) {
        self.pitch_error_m.resize(more_m.len(), 0.0);
        self.pitch_error_m.iter_mut().zip(more_m).for_each(|(own, more)| *own += more);
    }

    /// Changes the damage of one tooth, starting from what all teeth have.
    pub fn damage_tooth(&mut self, tooth: u32, change: impl FnOnce(&mut ToothDamage)) {
        change(self.teeth.entry(tooth).or_insert_with(|| self.all_teeth.clone()));
    }

    /// The same gear as another mesh sees it: its tooth `n` is tooth `n + shift` of `teeth` there,
    /// that mesh is `ahead` cycles ahead, and angles are counted from a line turned by `angle_rad`.
    pub(crate) fn turned(&self, shift: i64, ahead: f64, angle_rad: f64, teeth: u32) -> Self {
        let z = i64::from(teeth);
        let back = std::f64::consts::TAU * ahead / f64::from(teeth) + angle_rad;
        let mut out = self.clone();
        out.teeth = self
            .teeth
            .iter()
            .map(|(&tooth, damage)| ((i64::from(tooth) + shift).rem_euclid(z) as u32, damage.clone()))
            .collect();
        if self.pitch_error_m.len() == teeth as usize {
            out.pitch_error_m.rotate_right(shift.rem_euclid(z) as usize);
        }
        out.eccentricity_phase_rad -= back;
        for wave in &mut out.waves {
            wave.phase_rad -= wave.order * back;
        }
        for wave in &mut out.stiffness_waves {
            // cos(order (θ − back)) written out.
            let (sin, cos) = (wave.order * back).sin_cos();
            (wave.cos, wave.sin) = (wave.cos * cos - wave.sin * sin, wave.cos * sin + wave.sin * cos);
        }
        out
    }

    /// Worn depth by place of the path in slice `j` of `count` along the face (m).
    pub(crate) fn worn_in_slice_m(&self, j: usize, count: usize) -> &[f64] {
        self.worn_bands_m.get(j * self.worn_bands_m.len() / count.max(1)).unwrap_or(&self.worn_m)
    }

    /// Changes the damage of every tooth.
    pub fn damage_all(&mut self, change: impl Fn(&mut ToothDamage)) {
        change(&mut self.all_teeth);
        self.teeth.values_mut().for_each(change);
    }
}

/// Depth at a share of the pair's path of [`GearModifications::worn_m`] (m).
pub(crate) fn worn_at(worn_m: &[f64], share: f64) -> f64 {
    let Some(last) = worn_m.len().checked_sub(1) else { return 0.0 };
    let x = share.clamp(0.0, 1.0) * last as f64;
    let before = (x as usize).min(last.saturating_sub(1));
    let after = (before + 1).min(last);
    worn_m[before] + (x - before as f64) * (worn_m[after] - worn_m[before])
}

/// What is wrong with the pair as a whole.
#[derive(Clone, Debug, PartialEq)]
pub struct PairModifications {
    /// Profile error by mesh harmonic: amplitude (m) and phase (rad) of
    /// `Σ e_h cos(2π h (u − u_pitch) + φ_h)`, common to all pairs; h = 1 first. Positive is missing
    /// material.
    pub profile_error: Vec<(f64, f64)>,
    /// By how much every other pair of teeth stands back (m): the simplest teeth whose spacing
    /// scatters by this standard deviation between neighbours.
    ///
    /// Spacing errors of teeth that nobody measured leave the mean of the mesh force as it is where
    /// pairs surely carry, but decide when a pair meets and leaves. Over alternating pairs the mesh
    /// harmonics are the mean of two teeth, a quadrature of the scatter that is exact in its
    /// variance; the half harmonics mean nothing.
    pub alternating_m: f64,
    /// Wear depth (m) at the place of fastest sliding; in proportion to sliding along the path, 0
    /// at the pitch point.
    pub wear_m: f64,
    /// Wear beyond the pitch point over wear as far before it: sliding is as fast, the force and
    /// the way that a spot slides are not.
    pub recess_wear: f64,
    /// Factor on the stiffness of every tooth pair.
    pub stiffness_factor: f64,
    /// Misalignment of the axes in the plane of action (rad).
    pub misalignment_rad: f64,
    /// Lead slope of both gears (m over the face width), as [`crate::mesh::Lead::slope_m`]; helical
    /// pairs only. Misaligned axes add to it.
    pub lead_slope_m: f64,
    /// Crown of both gears (m), as [`crate::mesh::Lead::crown_m`]; helical pairs only.
    pub crown_m: f64,
    /// Factor on the coupling of tooth pairs through the bodies.
    pub coupling_factor: f64,
    /// Power of the load in the stiffness `F/δ`, relative to the reference load: `(F/F_ref)^n`,
    /// beside the Hertz law. About the static load spur pairs vibrate by the tangent of that law,
    /// `1/(1 − n)` times as stiff; slices of helical ones by the secant.
    pub load_exponent: f64,
    /// Load (N) at which `load_exponent` changes nothing; the nominal load.
    pub reference_load_n: f64,
    /// Coefficient of friction between the flanks.
    pub friction: f64,
    /// By how much both flanks stand back everywhere (m): a planet out of its place. Where two
    /// gears mesh alone it only turns one against the other.
    pub offset_m: f64,
    /// Change of the operating centre distance (m).
    pub centre_shift_m: f64,
    /// The stiffness of pairs goes with 1 + Σ over the mesh cycle, 0 where a pair is at the pitch
    /// point.
    pub stiffness_waves: Vec<Harmonic>,
}

impl Default for PairModifications {
    fn default() -> Self {
        Self {
            profile_error: Vec::new(),
            alternating_m: 0.0,
            wear_m: 0.0,
            recess_wear: 1.0,
            stiffness_factor: 1.0,
            misalignment_rad: 0.0,
            lead_slope_m: 0.0,
            crown_m: 0.0,
            coupling_factor: 1.0,
            load_exponent: 0.0,
            reference_load_n: 1000.0,
            friction: 0.0,
            offset_m: 0.0,
            centre_shift_m: 0.0,
            stiffness_waves: Vec::new(),
        }
    }
}

/// Everything that is wrong with the teeth of one stage; the default is nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ToothModifications {
    /// The driving gear.
    pub pinion: GearModifications,
    /// The driven gear.
    pub wheel: GearModifications,
    /// Both together.
    pub pair: PairModifications,
}

impl ToothModifications {
    /// All teeth but damaged ones are alike, and nothing turns with a gear: beside the damage the
    /// law of the teeth repeats with the mesh cycle.
    pub(crate) fn repeat_with_the_mesh(&self) -> bool {
        let even = |gear: &GearModifications| {
            gear.pitch_error_m.iter().all(|&error| error == 0.0)
                && gear.eccentricity_m == 0.0
                && gear.waves.is_empty()
                && gear.stiffness_waves.is_empty()
        };
        even(&self.pinion) && even(&self.wheel) && self.pair.alternating_m == 0.0
    }
}

impl ToothDamage {
    /// True where the other flank is damaged as well.
    pub(crate) fn affects_back_flank(&self) -> bool {
        self.breakage.is_some()
    }

    /// What cannot be, in a sentence that says what would be right; `place` names the tooth.
    pub fn check(&self, place: &str, gear: &GearGeometry) -> Result<(), ToothError> {
        self.problem(gear).map_or(Ok(()), |problem| Err(ToothError { place: place.to_owned(), problem }))
    }

    fn problem(&self, gear: &GearGeometry) -> Option<ToothProblem> {
        let (flank, half_module) = (gear.flank_height_m(), 0.5 * gear.module_m);
        if let Some(Breakage { fraction, .. }) = self.breakage
            && !(fraction > 0.0 && fraction <= 1.0)
        {
            return Some(ToothProblem::Breakage(fraction));
        }
        for pit in &self.pits {
            if !(pit.diameter_m > 0.0 && pit.diameter_m <= flank) {
                return Some(ToothProblem::PitDiameter {
                    found_mm: 1e3 * pit.diameter_m,
                    flank_mm: 1e3 * flank,
                    module_mm: 1e3 * gear.module_m,
                });
            }
            if !(pit.depth_m > 0.0 && pit.depth_m <= half_module) {
                return Some(ToothProblem::PitDepth { found_mm: 1e3 * pit.depth_m, most_mm: 1e3 * half_module });
            }
        }
        let pitted: f64 = self.pits.iter().map(|p| p.diameter_m).sum();
        if pitted > gear.face_width_m * (1.0 + 1e-9) {
            return Some(ToothProblem::Pits { needed_mm: 1e3 * pitted, width_mm: 1e3 * gear.face_width_m });
        }
        if let Some(spall) = self.spall {
            let found = [spall.width_m, spall.length_m, spall.depth_m];
            let most = [gear.face_width_m, flank, half_module];
            if !found.iter().zip(&most).all(|(found, most)| *found > 0.0 && found <= most) {
                return Some(ToothProblem::Spall { found_mm: found.map(|x| 1e3 * x), most_mm: most.map(|x| 1e3 * x) });
            }
        }
        let crack = self.crack?;
        let half_root = gear.half_root_m();
        let reach = crack.depth_m * crack.angle_rad.sin();
        let fits = crack.depth_m > 0.0 && reach > 0.0 && reach <= 1.6 * half_root;
        (!fits).then(|| ToothProblem::Crack {
            depth_mm: 1e3 * crack.depth_m,
            angle_deg: crack.angle_rad.to_degrees(),
            root_mm: 2e3 * half_root,
        })
    }

    /// Height above the gear centre (m) of a point `height_m` above the pitch line.
    fn height_above_centre_m(gear: &GearGeometry, height_m: f64) -> f64 {
        let roll = gear.roll_at_radius_m(gear.pitch_radius_m);
        gear.flank_point_m(gear.load_angle_rad(roll)).0 + height_m
    }

    /// Length of the contact line (m) that pits and spall take away at height `y_m`, and the
    /// greatest depth there (m).
    pub(crate) fn lost_length_m(&self, gear: &GearGeometry, y_m: f64) -> (f64, f64) {
        let (mut length, mut depth) = (0.0, 0.0_f64);
        for (chord, d) in self.recesses(gear, y_m) {
            length += chord;
            depth = depth.max(d);
        }
        (length, depth)
    }

    /// Chord along the width (m) and depth (m) of each pit and of the spall at height `y_m`.
    fn recesses(&self, gear: &GearGeometry, y_m: f64) -> impl Iterator<Item = (f64, f64)> {
        let pits = self.pits.iter().filter_map(move |pit| {
            let off = y_m - Self::height_above_centre_m(gear, pit.height_m);
            let chord_2 = 0.25 * pit.diameter_m * pit.diameter_m - off * off;
            (chord_2 > 0.0).then(|| (2.0 * chord_2.sqrt(), pit.depth_m))
        });
        let spall = self.spall.iter().filter_map(move |spall| {
            let off = y_m - Self::height_above_centre_m(gear, spall.height_m);
            (off.abs() < 0.5 * spall.length_m).then_some((spall.width_m, spall.depth_m))
        });
        pits.chain(spall)
    }

    /// Area (m²) and second moment of area (m⁴) that carry at height `y_m`, where the healthy half
    /// thickness is `h_m`.
    ///
    /// Crack: `A = (h + h_c) L`, `I = (h + h_c)³ L / 12` where `h ≥ h_c = r_b sin α₂ − q sin v`
    /// (Wu, Zuo & Parey 2008 with the misprints put right). Pits:
    /// `ΔI = ΔL d³/12 + A ΔA (h − d/2)²/(A − ΔA)` (parallel axes about the shifted centroid).
    pub(crate) fn section(&self, gear: &GearGeometry, y_m: f64, h_m: f64) -> (f64, f64) {
        let mut width = gear.face_width_m;
        if let Some(Breakage { fraction, kind: BreakageKind::Width }) = self.breakage {
            width *= 1.0 - fraction;
        }
        let thickness = match self.crack {
            Some(crack) => {
                let left = gear.half_root_m() - crack.depth_m * crack.angle_rad.sin();
                h_m + h_m.min(left)
            }
            None => 2.0 * h_m,
        };
        let mut area = thickness * width;
        let mut inertia = thickness.powi(3) * width / 12.0;
        // A broken tooth that is also pitted loses the pits in proportion to the width that is
        // left.
        let kept = width / gear.face_width_m;
        for (chord, depth) in self.recesses(gear, y_m) {
            // A pit cannot take more than nine tenths of a section: near the tip a tooth is thin.
            let depth = depth.min(0.9 * thickness);
            let lost = chord * kept * depth;
            let arm = 0.5 * (thickness - depth);
            inertia -= chord * kept * depth.powi(3) / 12.0 + area * lost * arm * arm / (area - lost);
            area -= lost;
        }
        (area, inertia)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

    /// Errors of a gear that was made true are what is added, and further ones add to them.
    #[test]
    fn analytic_pitch_errors_add_tooth_by_tooth() {
        let mut gear = GearModifications::default();
        gear.add_pitch_errors(&[1e-6, -2e-6, 0.0]);
        assert_eq!(gear.pitch_error_m, [1e-6, -2e-6, 0.0]);
        gear.add_pitch_errors(&[1e-6, 2e-6, -3e-6]);
        assert_eq!(gear.pitch_error_m, [2e-6, 0.0, -3e-6]);
    }

    /// Two at right angles are off by √2 halfway between; two that are opposite leave none.
    #[test]
    fn analytic_eccentricities_add_as_vectors() {
        let mut gear = GearModifications::default();
        gear.add_eccentricity(5e-6, 0.3);
        assert_eq!((gear.eccentricity_m, gear.eccentricity_phase_rad), (5e-6, 0.3));
        gear.add_eccentricity(5e-6, 0.3 + FRAC_PI_2);
        assert!((gear.eccentricity_m - 5e-6 * 2.0f64.sqrt()).abs() < 1e-18);
        assert!((gear.eccentricity_phase_rad - 0.3 - FRAC_PI_4).abs() < 1e-12);
        gear.add_eccentricity(gear.eccentricity_m, gear.eccentricity_phase_rad + PI);
        assert!(gear.eccentricity_m < 1e-18);
    }
}
