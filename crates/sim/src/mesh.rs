//! One stage's gear pair: which tooth pairs touch at a mesh phase, how stiff they are, and by how much their flanks deviate.
//!
//! **Phase.** The mesh phase u counts mesh cycles: `u = θ₁ z₁ / 2π` with the pinion's actual angle θ₁. Pair n, pinion
//! tooth `n mod z₁` on wheel tooth `n mod z₂`, nominally enters at u = n and leaves at u = n + ε.
//!
//! **Approach.** δ > 0 presses the driving flanks together along the line of action. Pair p carries `F_p` with
//! `C F = δ − gap` over the pairs in contact, where C is the compliance matrix: on its diagonal the pair alone
//! (Hertz contact, bending, shear, axial compression, foundation), off it the part that both pairs share through the
//! gear bodies, `c_ij = 0.6 sqrt(f_i f_j)`.
//!
//! **Frame.** Local to the stage: x from the pinion's centre to the wheel's, the pinion turns from x towards y. The
//! line of action has the direction (sin α_w, cos α_w).

mod pairs;
mod tables;

use std::f64::consts::TAU;

use gearwatch_core::bench::Bench;

pub use self::pairs::{MAX_PAIRS, MeshForce, Pair, Pairs};
use self::tables::{GapShape, GearTables, Side};
use crate::faults::ToothModifications;
use crate::geometry::{GearGeometry, PairGeometry};
use crate::hertz::{Hertz, Material};
use crate::tooth::Root;

/// How far (mesh cycles) before entry and after exit a pair is watched for corner contact.
const CORNER_REACH: f64 = 0.3;

/// A stage that cannot be: a sentence that says what was found and what would be right.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("stage {stage:?}: {problem}")]
pub struct MeshError {
    /// Name of the stage.
    pub stage: String,
    /// What is wrong, and what would be right.
    pub problem: String,
}

/// Which physics the pair has. The default is the best; [`MeshOptions::classical`] is the paper's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshOptions {
    /// Law of the Hertz contact.
    pub hertz: Hertz,
    /// Form of the tooth root.
    pub root: Root,
    /// `c₁₂ / sqrt(f₁ f₂)` of two pairs on the same bodies; `None` adds the pairs up as if each had bodies of its own.
    /// 0.6 is the middle of what finite elements give, 0.55–0.65.
    pub body_coupling: Option<f64>,
    /// Loaded teeth touch before the nominal entry and after the nominal exit.
    pub corner_contact: bool,
    /// Compliance of the gear bodies; without it a pair is 2.6 to 3 times too stiff.
    pub foundation: bool,
}

impl Default for MeshOptions {
    fn default() -> Self {
        Self {
            hertz: Hertz::LoadDependent,
            root: Root::Fillet,
            body_coupling: Some(0.6),
            corner_contact: true,
            foundation: true,
        }
    }
}

impl MeshOptions {
    /// The classical form that the paper uses: linear Hertz contact, straight root, pairs simply added up.
    pub fn classical() -> Self {
        Self {
            hertz: Hertz::Linear,
            root: Root::Straight,
            body_coupling: None,
            corner_contact: false,
            foundation: true,
        }
    }
}

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
    /// Approach (m) that misaligned flanks take up before they carry.
    offset_m: f64,
}

/// Where the mesh stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshState {
    /// Mesh phase u (mesh cycles).
    pub phase: f64,
    /// Displacement of the pinion's axis relative to the wheel's beyond the nominal centres (m), in the local frame (x, y).
    /// It moves the contact along the flanks; its part in the approach δ is the caller's.
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
    warnings: Vec<String>,
}

impl MeshModel {
    /// The pair of stage `stage` (from 0) of a bench.
    pub fn new(
        bench: &Bench,
        stage: usize,
        options: &MeshOptions,
        teeth: &ToothModifications,
    ) -> Result<Self, MeshError> {
        let Some(spec) = bench.stages.get(stage) else {
            return Err(MeshError {
                stage: format!("number {stage}"),
                problem: format!("there is no such stage; the bench has {}, numbered from 0", bench.stages.len()),
            });
        };
        let gear = |which: &str, gear: &gearwatch_core::bench::Gear| {
            let module_m = spec.module_mm * 1e-3;
            let bore_radius_m = gear.bore_mm.map_or(module_m * f64::from(gear.teeth) / 8.0, |bore| bore * 0.5e-3);
            GearGeometry::new(
                which,
                gear.teeth,
                module_m,
                spec.pressure_angle_deg.to_radians(),
                spec.face_width_mm * 1e-3,
                bore_radius_m,
            )
        };
        let material = Material {
            youngs_modulus_pa: bench.gear_material.youngs_modulus_pa,
            poisson_ratio: bench.gear_material.poisson_ratio,
        };
        gear("pinion", &spec.pinion)
            .and_then(|pinion| Ok((pinion, gear("wheel", &spec.wheel)?)))
            .and_then(|gears| Self::from_gears(gears, material, options, teeth, spec.backlash_um * 1e-6))
            .map_err(|problem| MeshError { stage: spec.name.clone(), problem })
    }

    /// The pair of a pinion and a wheel; `backlash_m` is the total backlash along the line of action at nominal centres.
    pub fn from_gears(
        (pinion, wheel): (GearGeometry, GearGeometry),
        material: Material,
        options: &MeshOptions,
        teeth: &ToothModifications,
        backlash_m: f64,
    ) -> Result<Self, String> {
        check(&material, options, teeth, backlash_m)?;
        let geometry = PairGeometry::new(pinion, wheel, teeth.pair.centre_shift_m)?;
        // Two points of the exact gap; between them the cubic is within 1 %.
        let corner = [false, true].map(|exit| {
            let (near, far) = (0.5 * CORNER_REACH, CORNER_REACH);
            let at = |lead: f64| geometry.corner_gap_m(lead, exit) / (lead * lead);
            let slope = (at(far) - at(near)) / (far - near);
            [at(near) - slope * near, slope]
        });
        let mut warnings = Vec::new();
        // Wear is shared by the two flanks that slide on each other.
        let wear_m = 0.5 * teeth.pair.wear_m;
        // The wheel's tip makes the entry, the pinion's tip the exit.
        let mut tables = |side, gear, corner| {
            GearTables::new(side, &geometry, &material, options, gear, GapShape { wear_m, corner }, &mut warnings)
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
            geometry,
            warnings,
        };
        // The stiffness of a lone pair at the pitch point is scale enough for the load point's own lengths.
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

    /// Total backlash (m) along the line of action: nominal, and `2 sin α_w` times what the centre distance has grown by.
    pub fn backlash_m(&self, state: &MeshState) -> f64 {
        let lag = self.shift(state).wheel * self.geometry.base_pitch_m;
        let sin = self.geometry.operating_angle_rad.sin();
        (self.backlash_m + 2.0 * sin * (self.modifications.pair.centre_shift_m + lag * sin)).max(0.0)
    }

    /// Coefficient of friction between the flanks.
    pub fn friction(&self) -> f64 {
        self.modifications.pair.friction
    }

    fn face_width_m(&self) -> f64 {
        self.geometry.pinion.face_width_m.min(self.geometry.wheel.face_width_m)
    }

    /// What the compliances take from a mesh force of `load_n` (N; the static or slowly changing part).
    pub fn at_load(&self, load_n: f64) -> LoadPoint {
        let load = load_n.abs();
        let pair = &self.modifications.pair;
        let width = self.face_width_m();
        let hertz = |share: f64| self.options.hertz.compliance_m_per_n(&self.material, width, share * load);
        let approach = load / self.reference_stiffness_n_per_m;
        let mut factor = 1.0 / pair.stiffness_factor;
        if pair.load_exponent != 0.0 {
            factor *= (load.max(crate::hertz::LEAST_LOAD_N) / pair.reference_load_n).powf(-pair.load_exponent);
        }
        // Flanks at an angle γ touch at one edge first: with k/b per width, F = k δ²/(2 γ b) up to δ = γ b, and
        // k (δ − γ b/2) beyond; linearised about the load.
        let wedge = pair.misalignment_rad.abs() * width;
        let mut offset_m = 0.0;
        if wedge > 0.0 {
            let part = (2.0 * approach / wedge).sqrt();
            if part >= 1.0 {
                offset_m = 0.5 * wedge;
            } else {
                let part = part.max(0.02);
                factor /= part;
                offset_m = 0.5 * part * wedge;
            }
        }
        let blend =
            if self.options.corner_contact { (approach / self.corner[0][0]).sqrt().clamp(1e-3, 0.1) } else { 0.0 };
        LoadPoint {
            load_n,
            hertz_alone: hertz(1.0),
            hertz_shared: hertz(0.5),
            blend,
            half_per_blend: 0.5 / blend,
            factor,
            offset_m,
        }
    }

    /// Pairs in contact or near it at mesh phase `phase` under a mesh force of about `load_n` (N).
    pub fn pairs(&self, phase: f64, load_n: f64, out: &mut Pairs) {
        self.pairs_at(&MeshState { phase, displacement_m: [0.0; 2] }, &self.at_load(load_n), out);
    }

    /// As [`Self::pairs`], for a prepared load and displaced axes.
    #[inline(always)]
    pub fn pairs_at(&self, state: &MeshState, load: &LoadPoint, out: &mut Pairs) {
        self.collect(state, load, self.reach(), out);
    }

    /// How far outside their path pairs are looked for (mesh cycles).
    #[inline(always)]
    fn reach(&self) -> f64 {
        if self.options.corner_contact { CORNER_REACH } else { 0.0 }
    }

    #[inline(always)]
    fn collect(&self, state: &MeshState, load: &LoadPoint, reach: f64, out: &mut Pairs) {
        let pitch = self.geometry.base_pitch_m;
        let shift = self.shift(state);
        out.clear();
        out.coupling = self.coupling;
        let common = self.common_gap_m(state.phase) + shift.gap_m + load.offset_m;
        let at = state.phase + shift.pinion;
        let mut index = (at + reach).floor();
        while at - index <= self.geometry.contact_ratio + reach {
            let s = at - index;
            let n = index;
            let pinion_tooth = tooth(n, self.geometry.pinion.teeth);
            let wheel_tooth = tooth(n, self.geometry.wheel.teeth);
            index -= 1.0;
            let (pinion, pinion_error) = self.pinion.drive(pinion_tooth);
            let (wheel, wheel_error) = self.wheel.drive(wheel_tooth);
            let Some(pair) = out.next() else { break };
            pair.index = n as i64;
            pair.pinion_tooth = pinion_tooth;
            pair.wheel_tooth = wheel_tooth;
            pair.pinion_roll_m = self.geometry.entry_roll_m + s * pitch;
            pair.wheel_roll_m = self.geometry.tangent_length_m - pair.pinion_roll_m;
            let deviation = common + pinion_error + wheel_error;
            let touches = self.pair(s, s - shift.wheel, [pinion, wheel], deviation, (load, reach), pair);
            out.keep(touches);
        }
    }

    /// As [`Self::pairs`] for the back flanks, which touch when the wheel drives the pinion: their approach is
    /// `−δ − backlash`. The back flanks carry healthy teeth's stiffness unless a tooth is broken, and no deviations.
    ///
    /// A mirror maps them to driving flanks that run backwards, `u ↦ 2 s_P + ½ − u`: tooth thickness is half a pitch.
    pub fn back_pairs(&self, phase: f64, load: &LoadPoint, out: &mut Pairs) {
        out.clear();
        out.coupling = self.coupling;
        let at = 2.0 * self.geometry.pitch_phase() + 0.5 - phase;
        let reach = self.reach();
        let mut index = (at + reach).floor();
        while at - index <= self.geometry.contact_ratio + reach {
            let s = at - index;
            let n = -index;
            index -= 1.0;
            let pinion_tooth = tooth(n, self.geometry.pinion.teeth);
            let wheel_tooth = tooth(n + 1.0, self.geometry.wheel.teeth);
            let (pinion, wheel) = (self.pinion.back(pinion_tooth), self.wheel.back(wheel_tooth));
            let Some(pair) = out.next() else { break };
            pair.index = n as i64;
            pair.pinion_tooth = pinion_tooth;
            pair.wheel_tooth = wheel_tooth;
            pair.pinion_roll_m = self.geometry.entry_roll_m + s * self.geometry.base_pitch_m;
            pair.wheel_roll_m = self.geometry.tangent_length_m - pair.pinion_roll_m;
            let touches = self.pair(s, s, [pinion, wheel], 0.0, (load, reach), pair);
            out.keep(touches);
        }
    }

    /// Compliance and gap, `deviation_m` included, of the pair at pinion position s₁ and wheel position s₂; false where it cannot touch.
    #[inline(always)]
    fn pair(
        &self,
        s1: f64,
        s2: f64,
        [pinion, wheel]: [&tables::ToothTable; 2],
        deviation_m: f64,
        (load, reach): (&LoadPoint, f64),
        out: &mut Pair,
    ) -> bool {
        let (a, b) = (pinion.at(s1), wheel.at(s2));
        let alone = {
            // Inside the single zone a pair carries all of the load.
            let inside = (s1 - (self.geometry.contact_ratio - 1.0)).min(1.0 - s1);
            if load.blend > 0.0 {
                (0.5 + inside * load.half_per_blend).clamp(0.0, 1.0)
            } else {
                f64::from(u8::from(inside >= 0.0))
            }
        };
        let mut hertz = load.hertz_shared + alone * (load.hertz_alone - load.hertz_shared);
        let lost = a.lost + b.lost;
        if lost > 0.0 {
            hertz *= self.shortened(lost);
        }
        out.compliance_m_per_n = (a.compliance + b.compliance + hertz) * load.factor;
        out.foundation_m_per_n = (a.foundation + b.foundation) * load.factor;
        out.gap_m = a.gap + b.gap + deviation_m;
        pinion.can_touch(s1, reach) & wheel.can_touch(s2, reach)
    }

    /// Factor on the contact compliance where a part of the contact line is missing.
    #[cold]
    fn shortened(&self, lost: f64) -> f64 {
        let length = (1.0 - lost).clamp(0.001, 1.0);
        match self.options.hertz {
            Hertz::Linear => 1.0 / length,
            Hertz::LoadDependent => length.powf(-self.options.hertz.length_exponent()),
        }
    }

    /// Deviation (m) that all pairs have in common at a phase: profile error by mesh harmonic, waves by revolution.
    #[inline(always)]
    fn common_gap_m(&self, phase: f64) -> f64 {
        let mut gap = 0.0;
        if !self.profile_error.is_empty() {
            let since_pitch = phase - self.geometry.pitch_phase();
            // cos(h β + φ) by powers of e^{iβ}: one sine and cosine serve all harmonics.
            let (sin, cos) = (TAU * (since_pitch - since_pitch.floor())).sin_cos();
            let (mut re, mut im) = (cos, sin);
            for &[in_phase, quadrature] in &self.profile_error {
                gap += in_phase * re - quadrature * im;
                (re, im) = (re * cos - im * sin, re * sin + im * cos);
            }
        }
        for (gear, z) in [
            (&self.modifications.pinion, self.geometry.pinion.teeth),
            (&self.modifications.wheel, self.geometry.wheel.teeth),
        ] {
            for wave in &gear.waves {
                let turns = phase / f64::from(z);
                let turns = turns - turns.floor();
                gap += wave.amplitude_m * (TAU * wave.order * turns + wave.phase_rad).cos();
            }
        }
        gap
    }

    /// What displaced axes do to the contact.
    #[inline(always)]
    fn shift(&self, state: &MeshState) -> Shift {
        let [mut x, mut y] = state.displacement_m;
        let (pinion, wheel) = (&self.modifications.pinion, &self.modifications.wheel);
        let (mut own_x, mut own_y) = (0.0, 0.0);
        for (gear, z, sense) in [(pinion, self.geometry.pinion.teeth, 1.0), (wheel, self.geometry.wheel.teeth, -1.0)] {
            if gear.eccentricity_m != 0.0 {
                let turns = state.phase / f64::from(z);
                let (sin, cos) = (TAU * (turns - turns.floor()) + gear.eccentricity_phase_rad).sin_cos();
                // The wheel turns the other way, and its displacement counts against the pinion's.
                own_x += sense * gear.eccentricity_m * cos;
                own_y += gear.eccentricity_m * sin;
            }
        }
        x += own_x;
        y += own_y;
        if x == 0.0 && y == 0.0 {
            return Shift::default();
        }
        let f = &self.shifts;
        Shift { pinion: f.pinion_x * x + f.pinion_y * y, wheel: f.wheel_x * x, gap_m: -(own_x * f.sin + own_y * f.cos) }
    }

    /// Smallest phase beyond `phase` at which a pair nominally enters or leaves (a broken tooth has its own places). With
    /// corner contact the force is continuous there; without it the stiffness jumps.
    pub fn next_event(&self, phase: f64) -> f64 {
        let mut next = f64::INFINITY;
        let newest = phase.floor() as i64 + 1;
        for n in newest - 4..=newest {
            let (pinion, _) = self.pinion.drive(tooth(n as f64, self.geometry.pinion.teeth));
            let (wheel, _) = self.wheel.drive(tooth(n as f64, self.geometry.wheel.teeth));
            for (place, on_wheel) in [(wheel.first, true), (pinion.last, false)] {
                if pinion.is_gone() || wheel.is_gone() {
                    continue;
                }
                let mut event = n as f64 + place;
                for _ in 0..2 {
                    let shift = self.shift(&MeshState { phase: event, displacement_m: [0.0; 2] });
                    event = n as f64 + place - shift.pinion + if on_wheel { shift.wheel } else { 0.0 };
                }
                if event > phase && event < next {
                    next = event;
                }
            }
        }
        next
    }

    /// Static approach (m) under `load_n` at a phase, the static transmission error, and the tangent stiffness (N/m) there.
    /// Infinite approach and no stiffness where no pair can touch.
    pub fn static_point(&self, phase: f64, load: &LoadPoint) -> (f64, f64) {
        let mut pairs = Pairs::default();
        self.pairs_at(&MeshState { phase, displacement_m: [0.0; 2] }, load, &mut pairs);
        pairs.approach_at(load.load_n).unwrap_or((f64::INFINITY, 0.0))
    }

    /// Stiffness (N/m) of the pairs inside their path taken together, whatever the load, deviations and corner contact:
    /// the k(t) of the literature.
    pub fn stiffness_n_per_m(&self, phase: f64, load: &LoadPoint) -> f64 {
        let mut pairs = Pairs::default();
        let state = MeshState { phase, displacement_m: [0.0; 2] };
        self.collect(&state, load, 0.0, &mut pairs);
        pairs.force(1.0).stiffness_n_per_m
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

/// [`Shift`] per metre of displacement.
#[derive(Clone, Copy, Debug)]
struct ShiftFactors {
    pinion_x: f64,
    pinion_y: f64,
    wheel_x: f64,
    /// Of the operating pressure angle.
    sin: f64,
    cos: f64,
}

impl ShiftFactors {
    fn new(geometry: &PairGeometry) -> Self {
        let (sin, cos) = geometry.operating_angle_rad.sin_cos();
        let a = geometry.centre_distance_m;
        // Rotation of the line of action: the line of centres turns by −y/a, the pressure angle grows by −x cos α/(a sin α).
        let per_turn = -geometry.pinion.base_radius_m / geometry.base_pitch_m;
        Self {
            pinion_x: per_turn * cos / (a * sin),
            pinion_y: -per_turn / a,
            // T = sqrt(a² − (r_b1 + r_b2)²) grows by Δa / sin α.
            wheel_x: -1.0 / sin / geometry.base_pitch_m,
            sin,
            cos,
        }
    }
}

/// What displaced axes do to the contact: advance of the pinion's position and lag of the wheel's against it (mesh
/// cycles), and the gap (m) that the gears' own eccentricity opens.
#[derive(Clone, Copy, Debug, Default)]
struct Shift {
    pinion: f64,
    wheel: f64,
    gap_m: f64,
}

/// Tooth number of pair n, a whole number of any size below 2⁵⁰: n mod z without an integer division.
#[inline(always)]
fn tooth(n: f64, teeth: u32) -> u32 {
    let z = f64::from(teeth);
    // Half a tooth up, so that rounding of the quotient cannot reach the next turn.
    let turns = ((n + 0.5) / z).floor();
    (n - turns * z) as i32 as u32
}

fn check(
    material: &Material,
    options: &MeshOptions,
    teeth: &ToothModifications,
    backlash_m: f64,
) -> Result<(), String> {
    let within = |name: &str, value: f64, low: f64, high: f64, unit: &str| {
        if value >= low && value <= high {
            Ok(())
        } else {
            Err(format!("{name} is {value}{unit}; expected {low} to {high}{unit}"))
        }
    };
    within("Young's modulus", material.youngs_modulus_pa, 1e8, 1e13, " Pa")?;
    within("Poisson's ratio", material.poisson_ratio, 0.0, 0.499, "")?;
    within("the backlash", backlash_m, 0.0, 0.01, " m")?;
    let pair = &teeth.pair;
    within("the stiffness factor", pair.stiffness_factor, 0.01, 100.0, "")?;
    within("the misalignment", pair.misalignment_rad, -0.02, 0.02, " rad")?;
    within("the body coupling", options.body_coupling.unwrap_or(0.0) * pair.coupling_factor, 0.0, 0.95, "")?;
    within("the load exponent", pair.load_exponent, 0.0, 0.5, "")?;
    within("the reference load", pair.reference_load_n, crate::hertz::LEAST_LOAD_N, 1e7, " N")?;
    within("the coefficient of friction", pair.friction, 0.0, 0.5, "")?;
    within("the wear depth", pair.wear_m, 0.0, 1e-3, " m")?;
    for (amplitude, angle) in &pair.profile_error {
        within("a profile error's amplitude", *amplitude, -1e-3, 1e-3, " m")?;
        within("a profile error's phase", *angle, -1e3, 1e3, " rad")?;
    }
    for gear in [&teeth.pinion, &teeth.wheel] {
        within("the eccentricity", gear.eccentricity_m, 0.0, 1e-3, " m")?;
        within("the eccentricity's phase", gear.eccentricity_phase_rad, -1e3, 1e3, " rad")?;
        for error in &gear.pitch_error_m {
            within("a pitch error", *error, -1e-3, 1e-3, " m")?;
        }
        for wave in &gear.waves {
            within("a wave's order", wave.order, 1e-6, 1e5, "")?;
            within("a wave's amplitude", wave.amplitude_m, 0.0, 1e-3, " m")?;
            within("a wave's phase", wave.phase_rad, -1e3, 1e3, " rad")?;
        }
        if let Some(relief) = gear.tip_relief {
            within("the tip relief's depth", relief.depth_m, 0.0, 1e-3, " m")?;
            within("the tip relief's length / base pitch", relief.length_fraction, 1e-3, 1.0, "")?;
            within("the tip relief's power", f64::from(relief.power), 1.0, 4.0, "")?;
        }
    }
    Ok(())
}
