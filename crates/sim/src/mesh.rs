//! One stage's gear pair: which tooth pairs touch at a mesh phase, how stiff they are, and by how
//! much their flanks deviate.
//!
//! **Phase.** The mesh phase u counts mesh cycles: `u = θ₁ z₁ / 2π` with the pinion's actual angle
//! θ₁. Pair n, pinion tooth `n mod z₁` on wheel tooth `n mod z₂`, nominally enters at u = n and
//! leaves at u = n + ε.
//!
//! **Approach.** δ > 0 presses the driving flanks together along the line of action. Pair p carries
//! `F_p` with `C F = δ − gap` over the pairs in contact, where C is the compliance matrix: on its
//! diagonal the pair alone (Hertz contact, bending, shear, axial compression, foundation), off it
//! the part that both pairs share through the gear bodies, `c_ij = 0.6 sqrt(f_i f_j)`.
//!
//! **Frame.** Local to the stage: x from the pinion's centre to the wheel's, the pinion turns from
//! x towards y. The line of action has the direction (sin α_w, cos α_w).

mod axes;
mod check;
mod face;
mod face_table;
mod fit;
mod helical;
mod joint;
mod near;
mod options;
mod pairs;
mod problem;
mod stage;
mod tables;
mod touch;

use gearwatch_core::bench::Bench;

use self::axes::ShiftFactors;
use self::check::check;
pub use self::face::Face;
pub(crate) use self::face_table::FaceTable;
use self::fit::Fit;
pub(crate) use self::helical::iso_stiffness_n_per_m;
pub use self::helical::{HelicalGears, HelicalMesh, Lead};
pub use self::joint::Joint;
use self::near::{Turns, tooth};
pub use self::options::MeshOptions;
pub use self::pairs::{MAX_PAIRS, MeshForce, Pair, Pairs};
pub use self::problem::{MeshError, MeshProblem};
pub use self::stage::StageMesh;
pub use self::tables::FlankStore;
use self::tables::{GapShape, GearTables, Side};
pub use self::touch::{SLOTS, SetLaw, Touch};
use crate::faults::ToothModifications;
use crate::geometry::{GearGeometry, Mounting, PairGeometry};
use crate::hertz::Material;
use crate::meshes::{MeshKind, MeshPlace};

/// How far (mesh cycles) before entry and after exit a pair is watched for corner contact.
const CORNER_REACH: f64 = 0.3;

/// What the pair's compliance takes from the load; made once per load, not once per call.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoadPoint {
    /// Mesh force (N).
    pub load_n: f64,
    /// Contact compliance (m/N) of a pair that carries all of it, and of one that carries half.
    hertz_alone: f64,
    hertz_shared: f64,
    /// Half width (mesh cycles) over which a pair goes from sharing to carrying alone; 0 jumps.
    blend: f64,
    /// `½ / blend`.
    half_per_blend: f64,
    /// Factor on every pair's compliance.
    factor: f64,
    /// Opening (m) of misaligned flanks at the far end of the face.
    wedge_m: f64,
    /// Exponent of the load in the stiffness of the pairs.
    hardening: f64,
}

/// Where the mesh stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshState {
    /// Mesh phase u (mesh cycles).
    pub phase: f64,
    /// Displacement of the pinion's axis relative to the wheel's beyond the nominal centres (m), in
    /// the local frame (x, y). It moves the contact along the flanks; its part in the approach δ is
    /// the caller's.
    pub displacement_m: [f64; 2],
}

/// One stage's gear pair, with whatever is wrong with its teeth. An immutable plan.
#[derive(Clone)]
pub struct MeshModel {
    geometry: PairGeometry,
    material: Material,
    options: MeshOptions,
    modifications: ToothModifications,
    pinion: GearTables,
    wheel: GearTables,
    /// Corner gap = lead² (c₀ + c₁ lead), at entry and at exit (m).
    corner: [[f64; 2]; 2],
    coupling: f64,
    backlash_m: f64,
    reference_stiffness_n_per_m: f64,
    /// Cosine and sine amplitude of the profile error by harmonic (m).
    profile_error: Vec<[f64; 2]>,
    shifts: ShiftFactors,
    pinion_turns: Turns,
    wheel_turns: Turns,
    /// Stiffness follows the turn of a gear or the mesh cycle beyond what the teeth do.
    varies: bool,
    warnings: Vec<String>,
}

impl MeshModel {
    /// The spur pair of stage `stage` (from 0) of a bench; [`StageMesh`] knows helical ones too.
    ///
    /// # Errors
    /// For a stage that cannot be, in a sentence that says what would be right.
    pub fn new(
        bench: &Bench,
        stage: usize,
        options: &MeshOptions,
        teeth: &ToothModifications,
    ) -> Result<Self, MeshError> {
        Self::with_flanks(bench, stage, options, teeth, &mut FlankStore::default())
    }

    /// As [`Self::new`], with the tables of flanks that were made before.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_flanks(
        bench: &Bench,
        stage: usize,
        options: &MeshOptions,
        teeth: &ToothModifications,
        flanks: &mut FlankStore,
    ) -> Result<Self, MeshError> {
        let place = MeshPlace { stage, kind: MeshKind::Chain { from: 0 } };
        Self::of_mesh(bench, place, options, teeth, flanks)
    }

    /// The spur pair of a mesh of a bench.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn of_mesh(
        bench: &Bench,
        place: MeshPlace,
        options: &MeshOptions,
        teeth: &ToothModifications,
        flanks: &mut FlankStore,
    ) -> Result<Self, MeshError> {
        let Some(spec) = bench.stages.get(place.stage) else { return Err(MeshError::no_stage(bench, place.stage)) };
        let material = Material {
            youngs_modulus_pa: bench.gear_material.youngs_modulus_pa,
            poisson_ratio: bench.gear_material.poisson_ratio,
        };
        let made = place
            .geometry(bench)
            .map_err(MeshProblem::from)
            .and_then(|gears| Self::made(gears, material, options, teeth, (Fit::of_stage(spec)?, flanks)));
        made.map_err(|problem| MeshError { stage: place.name(bench), problem })
    }

    /// The pair of a pinion and a wheel; `backlash_m` is the total backlash along the line of
    /// action at nominal centres.
    pub fn from_gears(
        (pinion, wheel): (GearGeometry, GearGeometry),
        material: Material,
        options: &MeshOptions,
        teeth: &ToothModifications,
        backlash_m: f64,
    ) -> Result<Self, MeshProblem> {
        let fit = Fit { backlash_m, centre_distance_m: None };
        Self::made((pinion, wheel), material, options, teeth, (fit, &mut FlankStore::default()))
    }

    pub(in crate::mesh) fn made(
        (pinion, wheel): (GearGeometry, GearGeometry),
        material: Material,
        options: &MeshOptions,
        teeth: &ToothModifications,
        (fit, flanks): (Fit, &mut FlankStore),
    ) -> Result<Self, MeshProblem> {
        let Fit { backlash_m, centre_distance_m } = fit;
        let mounting = Mounting { centre_distance_m, centre_shift_m: teeth.pair.centre_shift_m };
        let geometry = PairGeometry::mounted(pinion, wheel, mounting)?;
        let backlash_m = backlash_m + geometry.play_m;
        check(&material, options, teeth, backlash_m)?;
        // Two points of the exact gap; between them the cubic is within 1 %.
        let corner = [false, true].map(|exit| {
            let (near, far) = (0.5 * CORNER_REACH, CORNER_REACH);
            let at = |lead: f64| geometry.corner_gap_m(lead, exit) / (lead * lead);
            let slope = (at(far) - at(near)) / (far - near);
            [at(near) - slope * near, slope]
        });
        let mut warnings = Vec::new();
        // Wear is shared by the two flanks that slide on each other.
        let (wear_m, recess_wear) = (0.5 * teeth.pair.wear_m, teeth.pair.recess_wear);
        // The wheel's tip makes the entry, the pinion's tip the exit.
        let mut tables = |side, gear, corner| {
            GearTables::new(
                side,
                &geometry,
                &material,
                options,
                gear,
                GapShape { wear_m, recess_wear, corner },
                (&mut *flanks, &mut warnings),
            )
        };
        let pinion = tables(Side::Pinion, &teeth.pinion, corner[1])?;
        let wheel = tables(Side::Wheel, &teeth.wheel, corner[0])?;
        let coupling = options.body_coupling.unwrap_or(0.0) * teeth.pair.coupling_factor;
        let mut model = Self {
            material,
            options: *options,
            modifications: teeth.clone(),
            pinion,
            wheel,
            corner,
            coupling,
            backlash_m,
            reference_stiffness_n_per_m: 0.0,
            profile_error: teeth
                .pair
                .profile_error
                .iter()
                .map(|(a, phase)| [a * phase.cos(), a * phase.sin()])
                .collect(),
            shifts: ShiftFactors::new(&geometry),
            pinion_turns: Turns::new(geometry.pinion.teeth),
            wheel_turns: Turns::new(geometry.wheel.teeth),
            varies: !(teeth.pair.stiffness_waves.is_empty()
                && teeth.pinion.stiffness_waves.is_empty()
                && teeth.wheel.stiffness_waves.is_empty()),
            geometry,
            warnings,
        };
        // The stiffness of a lone pair at the pitch point is scale enough for the load point's own
        // lengths.
        model.reference_stiffness_n_per_m = 1.0 / model.healthy_pitch_compliance();
        Ok(model)
    }

    fn healthy_pitch_compliance(&self) -> f64 {
        let s = self.geometry.pitch_phase();
        let (pinion, wheel) = (self.pinion.back(0).at(s), self.wheel.back(0).at(s));
        let width = self.face_width_m();
        let hertz =
            self.options.hertz.compliance_m_per_n(&self.material, width, self.modifications.pair.reference_load_n);
        pinion.compliance + wheel.compliance + hertz
    }

    /// Geometry of the pair.
    pub fn geometry(&self) -> &PairGeometry {
        &self.geometry
    }

    /// Material of both gears.
    pub fn material(&self) -> &Material {
        &self.material
    }

    /// What was made.
    pub fn options(&self) -> &MeshOptions {
        &self.options
    }

    /// What is wrong with the teeth.
    pub fn modifications(&self) -> &ToothModifications {
        &self.modifications
    }

    /// Where a formula was used at the border of its validity, in sentences.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Base pitch p_b (m): one mesh cycle along the line of action.
    pub fn base_pitch_m(&self) -> f64 {
        self.geometry.base_pitch_m
    }

    /// Nominal contact ratio ε.
    pub fn contact_ratio(&self) -> f64 {
        self.geometry.contact_ratio
    }

    /// Base radii of pinion and wheel (m).
    pub fn base_radii_m(&self) -> [f64; 2] {
        [self.geometry.pinion.base_radius_m, self.geometry.wheel.base_radius_m]
    }

    /// Operating pressure angle α_w (rad).
    pub fn operating_angle_rad(&self) -> f64 {
        self.geometry.operating_angle_rad
    }

    /// Mean mesh stiffness c_γ b by ISO 6336-1, method B (N/m): what to hold the model's mean
    /// stiffness against.
    ///
    /// # Formula
    /// For spur gears `q' = 0.04723 + 0.15551/z₁ + 0.25791/z₂ − 0.00635 x₁ − 0.11654 x₁/z₁ −
    /// 0.00193 x₂ − 0.24188 x₂/z₂ + 0.00529 x₁² + 0.00182 x₂²` (mm µm/N), made for x₁ ≥ x₂ and −0.5
    /// ≤ x₁ + x₂ ≤ 2; `c' = 0.8 C_B / q'` with `C_B = (1 + 0.5 (1.2 − 1.25)) (1 − 0.02 (20° − α))`,
    /// `c_γ = c' (0.75 ε_α + 0.25)` for solid steel gears at 100 N/mm and more; other materials in
    /// proportion to E, lighter loads by the fourth root of the load per width / 100 N/mm. The norm
    /// claims no better than ± 30 %; it takes the bodies for solid discs, so that torsion of a
    /// blank over its bore is not in it.
    pub fn iso_stiffness_n_per_m(&self, load_n: f64) -> f64 {
        iso_stiffness_n_per_m(self, 0.0, self.geometry.pinion.pressure_angle_rad, load_n)
    }

    /// Coefficient of friction between the flanks.
    pub fn friction(&self) -> f64 {
        self.modifications.pair.friction
    }

    fn face_width_m(&self) -> f64 {
        self.geometry.pinion.face_width_m.min(self.geometry.wheel.face_width_m)
    }

    /// What the compliances take from a mesh force of `load_n` (N; the static or slowly changing
    /// part).
    pub fn at_load(&self, load_n: f64) -> LoadPoint {
        let load = load_n.abs();
        let pair = &self.modifications.pair;
        let width = self.face_width_m();
        let hertz = |share: f64| self.options.hertz.compliance_m_per_n(&self.material, width, share * load);
        let mut factor = 1.0 / pair.stiffness_factor;
        if pair.load_exponent != 0.0 {
            factor *= (load.max(crate::hertz::LEAST_LOAD_N) / pair.reference_load_n).powf(-pair.load_exponent);
        }
        let blend = if self.options.corner_contact {
            (load / self.reference_stiffness_n_per_m / self.corner[0][0]).sqrt().clamp(1e-3, 0.1)
        } else {
            0.0
        };
        LoadPoint {
            load_n,
            hertz_alone: hertz(1.0),
            hertz_shared: hertz(0.5),
            blend,
            half_per_blend: 0.5 / blend,
            factor,
            wedge_m: pair.misalignment_rad.abs() * width,
            hardening: pair.load_exponent,
        }
    }
}

impl std::fmt::Debug for MeshModel {
    /// Without the tables.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("MeshModel")
            .field("geometry", &self.geometry)
            .field("options", &self.options)
            .field("warnings", &self.warnings)
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects;

    /// Amplitudes of 1x to 5x of the static transmission error (m) of the shipped single pair with
    /// an effect at a brake torque (N m).
    fn static_error(effect: &str, torque_nm: f64) -> [f64; 5] {
        let mut bench = crate::shipped::bench("single-pair").unwrap();
        bench.effects.clear();
        let spec =
            gearwatch_core::bench::EffectSpec { effect: effect.into(), place: "stage1".into(), parameters: [].into() };
        let specs = if effect.is_empty() { vec![] } else { vec![spec] };
        let setup = effects::setup(&bench, &specs).unwrap();
        let mesh = MeshModel::new(&setup.bench, 0, &setup.mesh, &setup.teeth[0]).unwrap();
        let load = mesh.at_load(torque_nm / mesh.base_radii_m()[1]);
        let angles: Vec<f64> = (0..4096).map(|i| std::f64::consts::TAU * f64::from(i) / 512.0).collect();
        let error: Vec<f64> =
            angles.iter().map(|angle| mesh.static_point(angle / std::f64::consts::TAU, &load).0).collect();
        std::array::from_fn(|h| crate::lines::line(&error, &angles, (h + 1) as f64).norm())
    }

    /// The shipped single pair (23 / 57 teeth, 20 mm) by hand: q' = 0.05852, c' = 13.33, c_γ = 20.2
    /// N/(mm µm), 4.03e8 N/m.
    #[test]
    fn literature_mesh_stiffness_of_iso_6336() {
        let bench = crate::shipped::bench("single-pair").unwrap();
        let mesh = MeshModel::new(&bench, 0, &MeshOptions::default(), &ToothModifications::default()).unwrap();
        let found = mesh.iso_stiffness_n_per_m(1e4);
        assert!((found / 4.03e8 - 1.0).abs() < 2e-3, "{found:.4e}");
        // A sixteenth of 100 N/mm halves it.
        assert!((mesh.iso_stiffness_n_per_m(125.0) / found - 0.5).abs() < 1e-9);
    }

    /// What the help of `tooth_wear` and `tip_relief` says: worn flanks raise 1x by 17 dB and lower
    /// 2x and 5x on this pair at 60 N m; under relief 1x only rises with the load from 10 to 240 N
    /// m, while 3x has a minimum.
    #[test]
    fn analytic_wear_and_relief_do_what_their_help_says() {
        let (even, worn) = (static_error("", 60.0), static_error("tooth_wear", 60.0));
        let decibel: Vec<f64> = worn.iter().zip(even).map(|(w, e)| 20.0 * (w / e).log10()).collect();
        assert!(decibel[0] > 14.0 && decibel[1] < -2.0 && decibel[4] < -10.0, "{decibel:?}");
        let loads = [10.0, 30.0, 60.0, 90.0, 120.0, 150.0, 180.0, 210.0, 240.0];
        let relieved: Vec<[f64; 5]> = loads.iter().map(|&torque| static_error("tip_relief", torque)).collect();
        assert!(relieved.windows(2).all(|w| w[1][0] > w[0][0]), "{relieved:?}");
        let third: Vec<f64> = relieved.iter().map(|lines| lines[2]).collect();
        let least = (0..third.len()).min_by(|&a, &b| third[a].total_cmp(&third[b])).unwrap();
        assert!(least > 0 && least + 1 < third.len(), "{third:?}");
    }
}
