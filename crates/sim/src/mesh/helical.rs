//! The mesh of a helical pair by thin slices along the face width.
//!
//! # Formula
//! Each slice is a spur pair in the transverse section (Z. Wan, H. Cao, Y. Zi, W. He, Y. Chen,
//! "Mesh stiffness calculation using an accumulated integral potential energy method and dynamic
//! analysis of helical gears", Mech. Mach. Theory 92 (2015) 447): with normal module `m_n`, normal
//! pressure angle `α_n` and helix angle `β`
//!
//! ```text
//! m_t = m_n / cos β      tan α_t = tan α_n / cos β      tan β_b = tan β cos α_t      ε_β = b sin β / (π m_n)
//! h_a = m_n,  c = c* m_n:  by m_t they are cos β and c* cos β; the profile shift x m_n is x cos β
//! ```
//!
//! and a slice at `x` of the width `b` (from the middle) is `ε_β x / b` mesh cycles behind.
//! Approach `δ` and force `F` are those along the *transverse* line of action; `F tan β_b` pushes
//! along the axis. Bodies and teeth of a slice give way as in the transverse section; the contact,
//! of length `Δx / cos β_b` under `F / cos β_b`, gives way along the normal, which is `cos β_b` of
//! `δ`: for a law `C_h ∝ L^-p F^-q` its compliance is that of the spur slice times
//! `(cos β_b)^(p + q - 2)`. All slices share `δ`, less the missing material `g(x)` of lead slope
//! and crown:
//!
//! ```text
//! F(u, δ) = 1/N Σ_j F_spur(u - ε_β x_j / b, δ - g(x_j))
//! ```
//!
//! # Limits
//! At `β = 0` this is the spur model. Slices do not hold each other: the part of the tooth beside a
//! loaded one does not help it, so that the ends of contact lines are too soft and load is spread a
//! little too evenly. Bending of the teeth along the axis by the axial force is left out, and so is
//! the tilt of the gears by its moment. A break of the width takes away the slices at the end that
//! enters last; pits are spread over the width.

use gearwatch_core::bench::{Bench, Gear};

use super::face::{Cut, Face};
use super::{Fit, FlankStore, LoadPoint, MeshError, MeshModel, MeshOptions, MeshProblem, MeshState};
use crate::faults::ToothModifications;
use crate::geometry::{ADDENDUM, CLEARANCE, Cutting, GearError, GearGeometry, PairGeometry, Tip};
use crate::hertz::{Hertz, Material};

/// A helical pair as a sheet has it; lengths in metres, angles in radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HelicalGears {
    /// Of pinion and wheel.
    pub teeth: [u32; 2],
    /// Normal module m_n.
    pub module_m: f64,
    /// Normal pressure angle α_n.
    pub pressure_angle_rad: f64,
    /// Helix angle β on the reference cylinder (0 to below π/4).
    pub helix_rad: f64,
    /// Common face width b.
    pub face_width_m: f64,
    /// Bores of pinion and wheel.
    pub bore_radii_m: [f64; 2],
    /// Profile shift x of pinion and wheel, by the normal module.
    pub profile_shifts: [f64; 2],
    /// Tips of pinion and wheel; shortened by the normal module.
    pub tips: [Tip; 2],
}

/// Missing material along the face width (m), the same at all profiles.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lead {
    /// At the one end more than at the other, rising towards the end that enters last: lead slope
    /// of both gears and misaligned axes together.
    pub slope_m: f64,
    /// At both ends more than in the middle: crown of both gears, parabolic.
    pub crown_m: f64,
}

impl Lead {
    /// At a place by the face width, −½ to ½, the least being 0 or, for a slope, in the middle.
    fn gap_m(self, x: f64) -> f64 {
        self.slope_m * x + 4.0 * self.crown_m * x * x
    }
}

/// A helical mesh. An immutable plan.
#[derive(Clone, Debug)]
pub struct HelicalMesh {
    gears: HelicalGears,
    /// The transverse section over the whole width.
    transverse: MeshModel,
    face: Face,
}

/// Slices a mesh cycle of overlap, and the least of a face.
const SLICES_A_CYCLE: f64 = 24.0;
/// Where the law repeats with the mesh cycle a table holds it, which takes finer slices at no cost.
const SLICES_OF_A_TABLE: f64 = 96.0;
const FEWEST_SLICES: usize = 16;

impl HelicalMesh {
    /// A pair cut into `slices` parts (1 to 1000); 24 a mesh cycle of overlap leave less than 1 %
    /// of single harmonics.
    ///
    /// # Errors
    /// For a pair that cannot be, in a sentence that says what would be right.
    pub fn new(
        gears: HelicalGears,
        material: Material,
        options: &MeshOptions,
        teeth: &ToothModifications,
        lead: Lead,
        slices: usize,
    ) -> Result<Self, MeshProblem> {
        if !(1..=1000).contains(&slices) {
            return Err(MeshProblem::Slices(slices));
        }
        let fit = Fit { backlash_m: 0.0, centre_distance_m: None };
        Self::made(gears, material, options, teeth, (lead, slices), (fit, &mut FlankStore::default()))
    }

    /// The pair of stage `stage` (from 0) of a bench, with the slices that its overlap asks for.
    /// Misaligned axes are a lead slope.
    ///
    /// # Errors
    /// For a stage that cannot be, in a sentence that says what would be right.
    pub fn of_stage(
        bench: &Bench,
        stage: usize,
        options: &MeshOptions,
        teeth: &ToothModifications,
        flanks: &mut FlankStore,
    ) -> Result<Self, MeshError> {
        let Some(spec) = bench.stages.get(stage) else { return Err(MeshError::no_stage(bench, stage)) };
        let of_stage = |problem: MeshProblem| MeshError { stage: spec.name.clone(), problem };
        let shift = spec.pair_shift().map_err(|error| of_stage(GearError::from(error).into()))?;
        let fit = Fit::of_stage(spec).map_err(of_stage)?;
        let module_m = spec.module_mm * 1e-3;
        let bore = |gear: &Gear| gear.bore_mm.map_or(0.25 * spec.reference_radius_m(gear.teeth), |mm| mm * 0.5e-3);
        let face_width_m = spec.face_width_mm * 1e-3;
        let gears = HelicalGears {
            teeth: [spec.pinion.teeth, spec.wheel.teeth],
            module_m,
            pressure_angle_rad: spec.pressure_angle_deg.to_radians(),
            helix_rad: spec.helix_rad(),
            face_width_m,
            bore_radii_m: [bore(&spec.pinion), bore(&spec.wheel)],
            profile_shifts: shift.coefficients,
            tips: [&spec.pinion, &spec.wheel].map(|gear| crate::meshes::tip(gear, shift.tip_shortening)),
        };
        let material = Material {
            youngs_modulus_pa: bench.gear_material.youngs_modulus_pa,
            poisson_ratio: bench.gear_material.poisson_ratio,
        };
        let mut of_sections = teeth.clone();
        let of_axes_m = std::mem::take(&mut of_sections.pair.misalignment_rad) * face_width_m;
        let slope_m = of_axes_m + std::mem::take(&mut of_sections.pair.lead_slope_m);
        let lead = Lead { slope_m, crown_m: std::mem::take(&mut of_sections.pair.crown_m) };
        let overlap = face_width_m * gears.helix_rad.sin() / (std::f64::consts::PI * module_m);
        let a_cycle = if of_sections.repeat_with_the_mesh() { SLICES_OF_A_TABLE } else { SLICES_A_CYCLE };
        let slices = ((a_cycle * overlap).ceil() as usize).clamp(FEWEST_SLICES, 1000);
        Self::made(gears, material, options, &of_sections, (lead, slices), (fit, flanks)).map_err(of_stage)
    }

    fn made(
        gears: HelicalGears,
        material: Material,
        options: &MeshOptions,
        teeth: &ToothModifications,
        (lead, slices): (Lead, usize),
        (fit, flanks): (Fit, &mut FlankStore),
    ) -> Result<Self, MeshProblem> {
        let HelicalGears { module_m, pressure_angle_rad, helix_rad, face_width_m, .. } = gears;
        if !(0.0..std::f64::consts::FRAC_PI_4).contains(&helix_rad) {
            return Err(MeshProblem::Helix(helix_rad.to_degrees()));
        }
        let (sin, cos) = helix_rad.sin_cos();
        let transverse_angle =
            if helix_rad == 0.0 { pressure_angle_rad } else { (pressure_angle_rad.tan() / cos).atan() };
        let section = |i: usize, which: &str| {
            let cut = Cutting {
                module_m: module_m / cos,
                pressure_angle_rad: transverse_angle,
                addendum: ADDENDUM * cos,
                clearance: CLEARANCE * cos,
                profile_shift: gears.profile_shifts[i] * cos,
                tip: match gears.tips[i] {
                    Tip::Shortened(by) => Tip::Shortened(by * cos),
                    at => at,
                },
            };
            GearGeometry::cut(which, gears.teeth[i], &cut, face_width_m, gears.bore_radii_m[i])
        };
        let pair = (section(0, "pinion")?, section(1, "wheel")?);
        let mut model =
            |teeth: &ToothModifications| MeshModel::made(pair.clone(), material, options, teeth, (fit, &mut *flanks));
        let base_helix_rad = (helix_rad.tan() * transverse_angle.cos()).atan();
        let overlap_ratio = face_width_m * sin / (std::f64::consts::PI * module_m);
        let load_exponent = match options.hertz {
            Hertz::Linear => 0.0,
            Hertz::LoadDependent => 0.1,
        };
        let hertz_factor = base_helix_rad.cos().powf(options.hertz.length_exponent() + load_exponent - 2.0);
        let mut face = Face::new(slices, overlap_ratio, base_helix_rad, hertz_factor, |x| lead.gap_m(x));
        let transverse = model(&face.whole(teeth))?;
        face.break_off(teeth, model)?;
        Ok(Self { gears, transverse, face })
    }

    /// The section of the whole face, and the face.
    pub fn into_parts(self) -> (MeshModel, Face) {
        (self.transverse, self.face)
    }

    /// Transverse contact ratio ε_α and overlap ratio ε_β.
    pub fn contact_ratios(&self) -> [f64; 2] {
        [self.transverse.contact_ratio(), self.face.overlap_ratio()]
    }

    /// Geometry of the transverse section.
    pub fn transverse(&self) -> &PairGeometry {
        self.transverse.geometry()
    }

    /// Helix angle β_b on the base cylinders (rad).
    pub fn base_helix_rad(&self) -> f64 {
        self.face.base_helix_rad()
    }

    /// Force along the axis (N) at a mesh force along the transverse line of action.
    pub fn axial_force_n(&self, force_n: f64) -> f64 {
        force_n * self.face.base_helix_rad().tan()
    }

    /// What the compliances take from a mesh force along the transverse line of action (N).
    pub fn at_load(&self, load_n: f64) -> LoadPoint {
        self.face.at_load(&self.transverse, load_n)
    }

    /// Stiffness (N/m) of all contact lines inside their path, whatever the load, deviations and
    /// corner contact.
    pub fn stiffness_n_per_m(&self, phase: f64, load: &LoadPoint) -> f64 {
        let of_slice = |cut: Cut<'_>| cut.mesh.stiffness_n_per_m(phase - cut.lag, load);
        self.face.cuts(&self.transverse).map(of_slice).sum::<f64>() / self.face.count()
    }

    /// Static approach (m) under the load, the static transmission error, and the tangent stiffness
    /// (N/m) there. `None` without load or where nothing can touch.
    pub fn static_point(&self, phase: f64, load: &LoadPoint) -> Option<(f64, f64)> {
        self.face.static_point(&self.transverse, &MeshState { phase, displacement_m: [0.0; 2] }, load, load.load_n)
    }

    /// Mean mesh stiffness c_γ b by ISO 6336-1, method B (N/m), as
    /// [`MeshModel::iso_stiffness_n_per_m`] for spur gears: with the virtual teeth
    /// `z_n = z / cos³ β` and the single stiffness times `cos β`.
    pub fn iso_stiffness_n_per_m(&self, load_n: f64) -> f64 {
        let HelicalGears { helix_rad, pressure_angle_rad, .. } = self.gears;
        iso_stiffness_n_per_m(&self.transverse, helix_rad, pressure_angle_rad, load_n)
    }
}

/// c_γ b by ISO 6336-1, method B (N/m), of a transverse section whose teeth have a helix angle and
/// a normal pressure angle (rad).
pub(crate) fn iso_stiffness_n_per_m(section: &MeshModel, helix_rad: f64, normal_angle_rad: f64, load_n: f64) -> f64 {
    let pair = section.geometry();
    let cos = helix_rad.cos();
    // An internal gear is one of infinitely many teeth.
    let by_teeth = |gear: &GearGeometry| if gear.internal { 0.0 } else { cos.powi(3) / f64::from(gear.teeth) };
    let [small, large] = if pair.is_internal() {
        let inside = by_teeth(&pair.pinion).max(by_teeth(&pair.wheel));
        [inside, 0.0]
    } else {
        [by_teeth(&pair.pinion), by_teeth(&pair.wheel)]
    };
    // By the normal module.
    let [x1, x2] = [&pair.pinion, &pair.wheel].map(|gear| gear.profile_shift / cos);
    let shifted = -0.00635 * x1 - 0.11654 * x1 * small - 0.00193 * x2 - 0.24188 * x2 * large
        + 0.00529 * x1 * x1
        + 0.00182 * x2 * x2;
    let flexibility = 0.04723 + 0.15551 * small + 0.25791 * large + shifted;
    let basic_rack = (1.0 + 0.5 * (1.2 - 1.25)) * (1.0 - 0.02 * (20.0 - normal_angle_rad.to_degrees()));
    let youngs_modulus = section.material().youngs_modulus_pa / 2.06e11;
    let single = 0.8 * basic_rack / flexibility * youngs_modulus * cos;
    let width_m = pair.pinion.face_width_m.min(pair.wheel.face_width_m);
    // Of the load along the line of action: a tenth less than the norm's tangential one.
    let light = (load_n.abs() / (1e5 * width_m)).clamp(1e-4, 1.0).powf(0.25);
    // N/(mm µm) times 1e9 is N/m per metre of width.
    single * light * (0.75 * section.contact_ratio() + 0.25) * 1e9 * width_m
}

#[cfg(test)]
mod tests {
    use super::*;
    use num_complex::Complex64;
    use std::f64::consts::{PI, TAU};

    const MATERIAL: Material = Material { youngs_modulus_pa: 2.06e11, poisson_ratio: 0.3 };
    const LOAD_N: f64 = 3000.0;

    fn gears(helix_rad: f64) -> HelicalGears {
        HelicalGears {
            teeth: [23, 67],
            module_m: 2e-3,
            pressure_angle_rad: 20_f64.to_radians(),
            helix_rad,
            face_width_m: 25e-3,
            bore_radii_m: [8e-3, 16e-3],
            profile_shifts: [0.0; 2],
            tips: [Tip::Shortened(0.0); 2],
        }
    }

    fn mesh(gears: HelicalGears, options: &MeshOptions, lead: Lead, slices: usize) -> HelicalMesh {
        HelicalMesh::new(gears, MATERIAL, options, &ToothModifications::default(), lead, slices).unwrap()
    }

    /// Harmonics 1 to 5 of a function over one mesh cycle, at places beside those where pairs come
    /// and go.
    fn harmonics(f: impl Fn(f64) -> f64) -> [Complex64; 5] {
        let n = 480;
        let values: Vec<f64> = (0..n).map(|i| f((f64::from(i) + 0.37) / f64::from(n))).collect();
        std::array::from_fn(|h| {
            let turned =
                |i: usize| Complex64::from_polar(2.0 / f64::from(n), -TAU * ((h + 1) * i) as f64 / f64::from(n));
            values.iter().enumerate().map(|(i, v)| v * turned(i)).sum()
        })
    }

    /// At no helix angle stiffness and static transmission error are those of the spur model to
    /// 1e-9, at any phase and for any number of slices; and so they are, to what the overlap is, at
    /// a helix angle of 1e-10 rad away from the places where pairs come and go.
    #[test]
    fn analytic_no_helix_is_the_spur_model() {
        for options in [MeshOptions::default(), MeshOptions::classical()] {
            let gear = |teeth, bore| GearGeometry::new("gear", teeth, 2e-3, 20_f64.to_radians(), 25e-3, bore).unwrap();
            let pair = (gear(23, 8e-3), gear(67, 16e-3));
            let spur = MeshModel::from_gears(pair, MATERIAL, &options, &ToothModifications::default(), 0.0).unwrap();
            for (helix, slices) in [(0.0, 1), (0.0, 7), (1e-10, 16)] {
                let helical = mesh(gears(helix), &options, Lead::default(), slices);
                let (load, own) = (spur.at_load(LOAD_N), helical.at_load(LOAD_N));
                for i in 0..50 {
                    let phase = 0.02 * f64::from(i) + 0.003;
                    let (k, of_slices) = (spur.stiffness_n_per_m(phase, &load), helical.stiffness_n_per_m(phase, &own));
                    assert!((of_slices / k - 1.0).abs() < 1e-9, "{helix} {slices} {phase}: {of_slices} {k}");
                    let (error, _) = spur.static_point(phase, &load);
                    let (found, _) = helical.static_point(phase, &own).unwrap();
                    assert!((found / error - 1.0).abs() < 1e-9, "{helix} {slices} {phase}: {found} {error}");
                }
            }
        }
    }

    /// At a whole overlap ratio the slices stand at equal phases over whole cycles: no harmonic
    /// below the number of slices is left, neither of the stiffness nor of the static transmission
    /// error with corner contact.
    #[test]
    fn analytic_whole_overlap_leaves_no_mesh_harmonics() {
        for overlap in [1.0, 2.0] {
            let helix = (overlap * PI * 2e-3 / 25e-3_f64).asin();
            let slices = 48;
            let helical = mesh(gears(helix), &MeshOptions::default(), Lead::default(), slices);
            assert!((helical.contact_ratios()[1] - overlap).abs() < 1e-12);
            let load = helical.at_load(LOAD_N);
            let mean = helical.stiffness_n_per_m(0.0, &load);
            for line in harmonics(|u| helical.stiffness_n_per_m(u, &load)) {
                assert!(line.norm() < 1e-9 * mean, "{}", line.norm() / mean);
            }
            let error = helical.static_point(0.0, &load).unwrap().0;
            for line in harmonics(|u| helical.static_point(u, &load).unwrap().0) {
                assert!(line.norm() < 1e-9 * error, "{}", line.norm() / error);
            }
        }
    }

    /// Stiffness harmonics are those of the transverse section times
    /// `sin(π k ε_β) / (N sin(π k ε_β / N))`, which goes to the sinc of a continuous face.
    #[test]
    fn analytic_harmonics_fall_by_the_sinc_of_the_overlap() {
        let helix = (0.4 * PI * 2e-3 / 25e-3_f64).asin();
        let slices = 12;
        // 480 points a cycle and 12 slices of 0.4 cycles: every slice falls on a point, so that
        // jumps cost nothing.
        let helical = mesh(gears(helix), &MeshOptions::classical(), Lead::default(), slices);
        let alone = mesh(HelicalGears { ..gears(helix) }, &MeshOptions::classical(), Lead::default(), 1);
        let load = helical.at_load(LOAD_N);
        let (found, of_one) =
            (harmonics(|u| helical.stiffness_n_per_m(u, &load)), harmonics(|u| alone.stiffness_n_per_m(u, &load)));
        for (k, (found, one)) in (1..=5).zip(found.iter().zip(of_one)) {
            let turn = PI * f64::from(k) * 0.4;
            let factor = turn.sin() / (slices as f64 * (turn / slices as f64).sin());
            assert!((found - one * factor).norm() < 1e-9 * of_one[0].norm(), "{k}: {found} {one} {factor}");
        }
    }

    /// The mean stiffness follows the helix angle as c_γ of ISO 6336-1 does (`cos β`, virtual
    /// teeth, contact ratio): by as much as the norm claims for a stiffness, 30 %; found are 15 %
    /// at 30°. The stiffness itself is 0.62 of the norm's on this pair with straight teeth: its
    /// bodies give way down to their bores, which the norm's solid discs do not.
    #[test]
    fn literature_mean_stiffness_follows_iso_6336() {
        let mean_of = |degrees: f64| {
            let helical = mesh(gears(degrees.to_radians()), &MeshOptions::default(), Lead::default(), 32);
            let load = helical.at_load(LOAD_N);
            let mean = (0..40).map(|i| helical.stiffness_n_per_m(f64::from(i) / 40.0, &load)).sum::<f64>() / 40.0;
            mean / helical.iso_stiffness_n_per_m(LOAD_N)
        };
        let spur = mean_of(0.0);
        for degrees in [5.0, 15.0, 30.0] {
            let found = mean_of(degrees);
            assert!((found / spur - 1.0).abs() < 0.3, "{degrees}: {found}, spur {spur}");
        }
        assert!((0.55..0.7).contains(&spur), "{spur}");
    }

    /// A lead slope that opens the face by far more than the teeth give way leaves a part of it
    /// loaded. For slices of stiffness k and a wedge of depth `s` over the width,
    /// `F = k δ² / (2 s)` while a part is loaded: a quarter of the load has half of the approach,
    /// from the corner on. A crown raises the approach.
    #[test]
    fn analytic_lead_slope_loads_a_part_of_the_face() {
        let options = MeshOptions { hertz: Hertz::Linear, corner_contact: false, ..MeshOptions::default() };
        // A whole overlap: the mesh is as stiff everywhere, on the whole.
        let helix = (1.0 * PI * 2e-3 / 25e-3_f64).asin();
        let slope_m = 200e-6;
        let wedged = mesh(gears(helix), &options, Lead { slope_m, crown_m: 0.0 }, 1000);
        let from_corner = |load_n: f64| {
            let load = wedged.at_load(load_n);
            let all = (0..40).map(|i| wedged.static_point(f64::from(i) / 40.0, &load).unwrap().0);
            all.sum::<f64>() / 40.0 + 0.5 * slope_m
        };
        let (full, quarter) = (from_corner(LOAD_N), from_corner(0.25 * LOAD_N));
        assert!(full < slope_m, "{full}");
        // The mesh is not equally stiff along the width, one contact line being there or two: 10 %.
        assert!((quarter / full - 0.5).abs() < 0.05, "{quarter} {full}");
        let crowned = mesh(gears(helix), &options, Lead { slope_m: 0.0, crown_m: 10e-6 }, 200);
        let plain = mesh(gears(helix), &options, Lead::default(), 200);
        let load = plain.at_load(LOAD_N);
        assert!(crowned.static_point(0.1, &load).unwrap().0 > plain.static_point(0.1, &load).unwrap().0);
    }

    /// Transverse quantities of a pair by hand: β = 15°, m_n = 2 mm, α_n = 20°, 23/67 teeth, b = 25
    /// mm.
    #[test]
    fn analytic_geometry_of_a_pair() {
        let helical = mesh(gears(15_f64.to_radians()), &MeshOptions::default(), Lead::default(), 8);
        let pair = helical.transverse();
        let near = |found: f64, expected: f64, what: &str| assert!((found - expected).abs() < 5e-5, "{what}: {found}");
        near(1e3 * pair.pinion.reference_radius_m, 23.81135, "r1");
        near(1e3 * (pair.pinion.tip_radius_m - pair.pinion.reference_radius_m), 2.0, "h_a");
        near(1e3 * (pair.pinion.reference_radius_m - pair.pinion.root_radius_m), 2.5, "h_f");
        near(pair.operating_angle_rad.to_degrees(), 20.6469, "alpha_t");
        near(helical.base_helix_rad().to_degrees(), 14.0761, "beta_b");
        near(helical.contact_ratios()[1], 1.0298, "overlap");
        near(helical.axial_force_n(1000.0) / 1000.0, 0.2507, "axial");
    }
}
