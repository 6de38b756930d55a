//! A planetary stage by itself: translation and rotation of sun, carrier, ring and planets, its
//! modes by kind, and which of them a mesh harmonic can excite.
//!
//! # Formula
//! J. Lin, R. G. Parker, "Analytical characterization of the unique properties of planetary gear
//! free vibration", J. Vib. Acoust. 121 (1999) 316: coordinates in the frame of the carrier,
//! rotations as `u = r θ` on the base circles (of the carrier on the circle of the planets'
//! centres), planets radial ζ and tangential η, planet n at the angle `ψ_n`:
//!
//! ```text
//! sun mesh    δ_sn = y_s cos ψ_sn − x_s sin ψ_sn − ζ_n sin α_s − η_n cos α_s + u_s + u_n       ψ_sn = ψ_n − α_s
//! ring mesh   δ_rn = y_r cos ψ_rn − x_r sin ψ_rn + ζ_n sin α_r − η_n cos α_r + u_r − u_n       ψ_rn = ψ_n + α_r
//! pin         radial x_c cos ψ_n + y_c sin ψ_n − ζ_n,   tangential y_c cos ψ_n − x_c sin ψ_n + u_c − η_n
//! ```
//!
//! `K` is the second derivative of `½ Σ k δ²` and of the bearings' energy. Gyroscopic terms of the
//! turning carrier are left out: the frequencies are those at rest. Equal planets at equal spacing
//! have three kinds of modes: *rotational* (central members only turn, all planets alike),
//! *translational* (they only move sideways, always two of one frequency), and from four planets on
//! *planet* modes (central members at rest, N − 3 of one frequency).
//!
//! Which of them harmonic `l` of the mesh excites follows from the planets' phases,
//! `k = l z_s mod N` (R. G. Parker, "A physical explanation for the effectiveness of planet phasing
//! to suppress planetary gear vibration", J. Sound Vib. 236 (2000) 561): `k = 0` rotational,
//! `k = 1` or `N − 1` translational, any other planet modes.

use std::f64::consts::TAU;

use gearwatch_core::bench::{Bench, Member, Planetary, Stage};
use gearwatch_core::train::Train;
use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// One member.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// (kg).
    pub mass_kg: f64,
    /// Moment of inertia by the square of its radius: of the base circle, for the carrier that of
    /// the planets' centres (kg).
    pub rotary_mass_kg: f64,
    /// Sideways, of its bearing; of a planet that of its pin (N/m).
    pub bearing_n_per_m: f64,
    /// Against rotation, at its radius (N/m); 0 where it turns freely.
    pub torsion_n_per_m: f64,
}

/// A stage whose modes are not known.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PlanetaryError {
    /// The bench has fewer stages.
    #[error("there is no stage number {0}")]
    NoStage(usize),
    /// A pair.
    #[error("stage {0:?} is not planetary")]
    NotPlanetary(String),
    /// Helical planets.
    #[error("stage {0:?} has helical planets; the modes of planetary stages are those of straight teeth")]
    Helical(String),
    /// Profile shift.
    #[error("stage {0:?} has profile shift; the modes of planetary stages are those of standard teeth")]
    Shifted(String),
}

/// What the model is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanetaryParameters {
    /// Central external gear.
    pub sun: Body,
    /// What holds the planets.
    pub carrier: Body,
    /// Central internal gear.
    pub ring: Body,
    /// Each planet.
    pub planet: Body,
    /// Where the planets stand (rad).
    pub positions_rad: Vec<f64>,
    /// Mean stiffness of one mesh of sun and planet (N/m).
    pub sun_mesh_n_per_m: f64,
    /// Mean stiffness of one mesh of ring and planet (N/m).
    pub ring_mesh_n_per_m: f64,
    /// Operating pressure angles at sun and ring (rad).
    pub pressure_angles_rad: [f64; 2],
}

/// Kind of a mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModeKind {
    /// Central members turn and do not move sideways.
    Rotational,
    /// They move sideways and do not turn.
    Translational,
    /// Only planets move.
    Planet,
    /// Planets that are unequal or stand unequally mix the kinds.
    Mixed,
}

impl ModeKind {
    /// In a word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Rotational => "rotational",
            Self::Translational => "translational",
            Self::Planet => "planet",
            Self::Mixed => "mixed",
        }
    }
}

/// One mode.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanetaryMode {
    /// (Hz).
    pub frequency_hz: f64,
    /// Its kind.
    pub kind: ModeKind,
    /// `φᵀ M φ = 1`, in the order of [`PlanetaryModel::coordinates`].
    pub shape: DVector<f64>,
}

/// Part of a mode's kinetic energy below which a group of coordinates counts as at rest.
const AT_REST: f64 = 1e-8;
/// Coordinates of the central members: x, y, u of carrier, ring, sun.
const CENTRAL: usize = 9;

/// The linear model.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanetaryModel {
    /// What each coordinate is; all in metres.
    pub coordinates: Vec<String>,
    /// Diagonal of the mass matrix (kg).
    pub mass: DVector<f64>,
    /// Stiffness matrix (N/m).
    pub stiffness: DMatrix<f64>,
    /// `δ = row · q` of each sun mesh, by planet.
    pub sun_meshes: Vec<DVector<f64>>,
    /// Of each ring mesh.
    pub ring_meshes: Vec<DVector<f64>>,
}

impl PlanetaryModel {
    /// The model of some parameters.
    pub fn new(p: &PlanetaryParameters) -> Self {
        let count = p.positions_rad.len();
        let n = CENTRAL + 3 * count;
        let mut out = Self {
            coordinates: Vec::with_capacity(n),
            mass: DVector::zeros(n),
            stiffness: DMatrix::zeros(n, n),
            sun_meshes: Vec::new(),
            ring_meshes: Vec::new(),
        };
        let (carrier, ring, sun) = (0, 3, 6);
        for (at, name, body) in [(carrier, "carrier", &p.carrier), (ring, "ring", &p.ring), (sun, "sun", &p.sun)] {
            out.coordinates.extend(["x", "y", "u"].map(|axis| format!("{name}.{axis}")));
            let masses = [body.mass_kg, body.mass_kg, body.rotary_mass_kg];
            let springs = [body.bearing_n_per_m, body.bearing_n_per_m, body.torsion_n_per_m];
            for axis in 0..3 {
                out.mass[at + axis] = masses[axis];
                out.stiffness[(at + axis, at + axis)] += springs[axis];
            }
        }
        let [alpha_s, alpha_r] = p.pressure_angles_rad;
        for (i, &psi) in p.positions_rad.iter().enumerate() {
            let at = CENTRAL + 3 * i;
            out.coordinates.extend(["radial", "tangential", "u"].map(|axis| format!("planet_{}.{axis}", i + 1)));
            for (axis, mass) in [p.planet.mass_kg, p.planet.mass_kg, p.planet.rotary_mass_kg].into_iter().enumerate() {
                out.mass[at + axis] = mass;
            }
            let row = |entries: &[(usize, f64)]| {
                let mut row = DVector::zeros(n);
                entries.iter().for_each(|&(at, value)| row[at] = value);
                row
            };
            let (sin_s, cos_s) = (psi - alpha_s).sin_cos();
            let (sin_r, cos_r) = (psi + alpha_r).sin_cos();
            let (sin, cos) = psi.sin_cos();
            let sun_mesh = row(&[
                (sun, -sin_s),
                (sun + 1, cos_s),
                (sun + 2, 1.0),
                (at, -alpha_s.sin()),
                (at + 1, -alpha_s.cos()),
                (at + 2, 1.0),
            ]);
            let ring_mesh = row(&[
                (ring, -sin_r),
                (ring + 1, cos_r),
                (ring + 2, 1.0),
                (at, alpha_r.sin()),
                (at + 1, -alpha_r.cos()),
                (at + 2, -1.0),
            ]);
            let radial = row(&[(carrier, cos), (carrier + 1, sin), (at, -1.0)]);
            let tangential = row(&[(carrier, -sin), (carrier + 1, cos), (carrier + 2, 1.0), (at + 1, -1.0)]);
            for (row, k) in [
                (&sun_mesh, p.sun_mesh_n_per_m),
                (&ring_mesh, p.ring_mesh_n_per_m),
                (&radial, p.planet.bearing_n_per_m),
                (&tangential, p.planet.bearing_n_per_m),
            ] {
                out.stiffness.ger(k, row, row, 1.0);
            }
            out.sun_meshes.push(sun_mesh);
            out.ring_meshes.push(ring_mesh);
        }
        out
    }

    /// All modes in ascending order, free rotation included.
    pub fn modes(&self) -> Vec<PlanetaryMode> {
        let n = self.mass.len();
        let root = self.mass.map(f64::sqrt);
        let scaled = DMatrix::from_fn(n, n, |i, j| self.stiffness[(i, j)] / (root[i] * root[j]));
        let eigen = SymmetricEigen::new(scaled);
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        let of = |k: usize| {
            let vector = eigen.eigenvectors.column(k);
            let energy = |places: &[usize]| places.iter().map(|&i| vector[i] * vector[i]).sum::<f64>();
            let sideways = energy(&[0, 1, 3, 4, 6, 7]) > AT_REST;
            let turning = energy(&[2, 5, 8]) > AT_REST;
            let kind = match (sideways, turning) {
                (false, true) => ModeKind::Rotational,
                (true, false) => ModeKind::Translational,
                (false, false) => ModeKind::Planet,
                (true, true) => ModeKind::Mixed,
            };
            PlanetaryMode {
                frequency_hz: eigen.eigenvalues[k].max(0.0).sqrt() / TAU,
                kind,
                shape: vector.component_div(&root),
            }
        };
        order.into_iter().map(of).collect()
    }

    /// Parameters of a planetary stage of a bench.
    ///
    /// Discs where the sheet has no masses: sun and planets as
    /// [`crate::linear::gear_mass_and_inertia`], the ring a rim of three modules under its teeth,
    /// the carrier a steel disc on the planets' circle as wide as the teeth. Meshes have c_γ b of
    /// ISO 6336-1, method B, with `1/z = 0` of the ring, as the norm says for internal gears. Each
    /// member has the bearing of its shaft, the ring the stiffer of both, planets those of the
    /// carrier; the fixed member cannot turn, the others do so freely.
    ///
    /// # Errors
    /// For a stage that is not planetary, helical planets, or profile shift, in a sentence.
    pub fn parameters(bench: &Bench, stage: usize) -> Result<PlanetaryParameters, PlanetaryError> {
        let spec = bench.stages.get(stage).ok_or(PlanetaryError::NoStage(stage))?;
        let set = spec.gearing.planetary.as_ref().ok_or_else(|| PlanetaryError::NotPlanetary(spec.name.clone()))?;
        if spec.gearing.helix.is_some() {
            return Err(PlanetaryError::Helical(spec.name.clone()));
        }
        if spec.is_shifted() {
            return Err(PlanetaryError::Shifted(spec.name.clone()));
        }
        let alpha = spec.pressure_angle_deg.to_radians();
        let (module, width) = (1e-3 * spec.module_mm, 1e-3 * spec.face_width_mm);
        let radius = |teeth: u32| spec.reference_radius_m(teeth);
        let member =
            |kind: Member| if kind == set.input { Some(stage) } else { (kind == set.output).then_some(stage + 1) };
        let bearing = |kind: Member| {
            let both = [stage, stage + 1].map(|shaft| bench.shafts[shaft].bearing_n_per_m);
            member(kind).map_or(both[0].max(both[1]), |shaft| bench.shafts[shaft].bearing_n_per_m)
        };
        let rotary = |inertia: f64, radius: f64| inertia / (radius * radius);
        let added = |kind: Member| member(kind).map_or(0.0, |shaft| bench.shafts[shaft].inertia_kg_m2);
        let body = |kind: Member, mass_kg: f64, inertia: f64, radius: f64| {
            let rotary_mass_kg = rotary(inertia + added(kind), radius);
            // Ten times what the meshes have together holds it.
            let torsion_n_per_m = if kind == set.fixed { 1e11 } else { 0.0 };
            Body { mass_kg, rotary_mass_kg, bearing_n_per_m: bearing(kind), torsion_n_per_m }
        };
        let Bodies { sun, planet, ring, carrier } = bodies(bench, spec, set);
        let centres = radius(spec.pinion.teeth) + radius(set.planet.teeth);
        let [sun_base, planet_base, ring_base] =
            [spec.pinion.teeth, set.planet.teeth, spec.wheel.teeth].map(|teeth| radius(teeth) * alpha.cos());
        let pitch = std::f64::consts::PI * module * alpha.cos();
        let path = |teeth: u32, addendum: f64| {
            let tip = radius(teeth) + addendum * module;
            (tip * tip - (radius(teeth) * alpha.cos()).powi(2)).max(0.0).sqrt()
        };
        let sun_ratio = (path(spec.pinion.teeth, 1.0) + path(set.planet.teeth, 1.0) - centres * alpha.sin()) / pitch;
        let ring_ratio = (path(set.planet.teeth, 1.0) - path(spec.wheel.teeth, -1.0) + centres * alpha.sin()) / pitch;
        let mesh = |inverse_teeth: [f64; 2], contact_ratio: f64| {
            let flexibility = 0.04723 + 0.15551 * inverse_teeth[0] + 0.25791 * inverse_teeth[1];
            let basic_rack = (1.0 + 0.5 * (1.2 - 1.25)) * (1.0 - 0.02 * (20.0 - spec.pressure_angle_deg));
            let single = 0.8 * basic_rack / flexibility * bench.gear_material.youngs_modulus_pa / 2.06e11;
            single * (0.75 * contact_ratio + 0.25) * 1e9 * width
        };
        let one_by = |teeth: u32| 1.0 / f64::from(teeth);
        let (small, large) = (spec.pinion.teeth.min(set.planet.teeth), spec.pinion.teeth.max(set.planet.teeth));
        Ok(PlanetaryParameters {
            sun: body(Member::Sun, sun.0, sun.1, sun_base),
            carrier: body(Member::Carrier, carrier.0, carrier.1, centres),
            ring: body(Member::Ring, ring.0, ring.1, ring_base),
            planet: Body {
                mass_kg: planet.0,
                rotary_mass_kg: rotary(planet.1, planet_base),
                bearing_n_per_m: bearing(Member::Carrier),
                torsion_n_per_m: 0.0,
            },
            positions_rad: set.positions_turns().iter().map(|turns| TAU * turns).collect(),
            sun_mesh_n_per_m: mesh([one_by(small), one_by(large)], sun_ratio),
            ring_mesh_n_per_m: mesh([one_by(set.planet.teeth), 0.0], ring_ratio),
            pressure_angles_rad: [alpha, alpha],
        })
    }
}

/// Mass (kg) and moment of inertia (kg m²) of the bodies of a stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bodies {
    pub(crate) sun: (f64, f64),
    pub(crate) planet: (f64, f64),
    pub(crate) ring: (f64, f64),
    pub(crate) carrier: (f64, f64),
}

/// As the sheet says; where it does not, discs with their bores, a ring with its rim, and for the
/// carrier a disc on the planets' circle as wide as the teeth.
pub(crate) fn bodies(bench: &Bench, spec: &Stage, set: &Planetary) -> Bodies {
    let density = bench.gear_material.density_kg_per_m3;
    let of = |gear| crate::linear::gear_mass_and_inertia(gear, 0.0, spec, density);
    let centres = spec.reference_radius_m(spec.pinion.teeth) + spec.reference_radius_m(set.planet.teeth);
    let carrier = density * std::f64::consts::PI * 1e-3 * spec.face_width_mm * centres * centres;
    Bodies {
        sun: of(&spec.pinion),
        planet: of(&set.planet),
        ring: crate::linear::ring_mass_and_inertia(&spec.wheel, spec, density),
        carrier: (carrier, 0.5 * carrier * centres * centres),
    }
}

/// The kind of modes that harmonic `harmonic` of the mesh excites where `planets` equal planets
/// stand at equal spacing about a sun of `sun_teeth`.
pub fn excited(sun_teeth: u32, planets: u32, harmonic: u32) -> ModeKind {
    let k = u64::from(sun_teeth) * u64::from(harmonic) % u64::from(planets.max(1));
    if k == 0 {
        ModeKind::Rotational
    } else if k == 1 || k == u64::from(planets) - 1 {
        ModeKind::Translational
    } else {
        ModeKind::Planet
    }
}

/// A frequency of a stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageMode {
    /// (Hz).
    pub frequency_hz: f64,
    /// Its kind.
    pub kind: ModeKind,
    /// Modes of this frequency.
    pub count: usize,
}

/// A motor speed at which a mesh harmonic meets a mode that it can excite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanetaryCritical {
    /// Position in [`StageModes::modes`].
    pub mode: usize,
    /// Mesh harmonic, from 1.
    pub harmonic: u32,
    /// (Hz).
    pub motor_hz: f64,
}

/// The modes of a planetary stage of a bench by itself.
#[derive(Clone, Debug, PartialEq)]
pub struct StageModes {
    /// Of the stage.
    pub name: String,
    /// In ascending order, the free rotation left out.
    pub modes: Vec<StageMode>,
    /// Mean stiffness of one mesh of sun and planet (N/m).
    pub sun_mesh_n_per_m: f64,
    /// Mean stiffness of one mesh of ring and planet (N/m).
    pub ring_mesh_n_per_m: f64,
    /// Mesh frequency / speed of the first shaft.
    pub mesh_order: f64,
    /// Motor speed / speed of the first shaft.
    pub motor_order: f64,
    sun_teeth: u32,
    planets: u32,
    equally_spaced: bool,
}

/// Relative distance below which frequencies of one kind are one: rounding of the eigenvalues.
const SAME_FREQUENCY: f64 = 1e-6;
/// Slower than this (Hz) a mode is the free rotation.
const FREE_HZ: f64 = 0.1;

impl StageModes {
    /// Of stage `stage` (from 0).
    ///
    /// # Errors
    /// As [`PlanetaryModel::parameters`].
    pub fn new(bench: &Bench, stage: usize) -> Result<Self, PlanetaryError> {
        let parameters = PlanetaryModel::parameters(bench, stage)?;
        let mut modes: Vec<StageMode> = Vec::new();
        for mode in PlanetaryModel::new(&parameters).modes().into_iter().filter(|mode| mode.frequency_hz > FREE_HZ) {
            let same = |known: &&mut StageMode| {
                known.kind == mode.kind && (known.frequency_hz / mode.frequency_hz - 1.0).abs() < SAME_FREQUENCY
            };
            match modes.iter_mut().find(same) {
                Some(known) => known.count += 1,
                None => modes.push(StageMode { frequency_hz: mode.frequency_hz, kind: mode.kind, count: 1 }),
            }
        }
        let train = Train::new(bench);
        let planets = parameters.positions_rad.len() as u32;
        let even = |(i, psi): (usize, &f64)| (psi - TAU * i as f64 / f64::from(planets)).abs() < 1e-9;
        Ok(Self {
            name: bench.stages[stage].name.clone(),
            modes,
            sun_mesh_n_per_m: parameters.sun_mesh_n_per_m,
            ring_mesh_n_per_m: parameters.ring_mesh_n_per_m,
            mesh_order: train.stages[stage].mesh_order,
            motor_order: train.motor_order,
            sun_teeth: bench.stages[stage].pinion.teeth,
            planets,
            equally_spaced: parameters.positions_rad.iter().enumerate().all(even),
        })
    }

    /// The kind of modes that a mesh harmonic excites; `None` where the planets' spacing lets it
    /// excite any.
    pub fn excited(&self, harmonic: u32) -> Option<ModeKind> {
        self.equally_spaced.then(|| excited(self.sun_teeth, self.planets, harmonic))
    }

    /// Motor speeds up to `highest_motor_hz` at which harmonics 1 to `harmonics` meet a mode that
    /// they can excite, in ascending order.
    pub fn critical_speeds(&self, harmonics: u32, highest_motor_hz: f64) -> Vec<PlanetaryCritical> {
        let mut out = Vec::new();
        for (at, mode) in self.modes.iter().enumerate() {
            for harmonic in (1..=harmonics).filter(|&h| self.excited(h).is_none_or(|kind| kind == mode.kind)) {
                let motor_hz = mode.frequency_hz / (f64::from(harmonic) * self.mesh_order) * self.motor_order;
                if motor_hz <= highest_motor_hz {
                    out.push(PlanetaryCritical { mode: at, harmonic, motor_hz });
                }
            }
        }
        out.sort_by(|a, b| a.motor_hz.total_cmp(&b.motor_hz));
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Complex;

    /// The example of Lin & Parker 1999, table 1, with N planets at equal spacing.
    fn example(planets: u32) -> PlanetaryParameters {
        let body = |mass_kg, rotary_mass_kg, torsion_n_per_m| Body {
            mass_kg,
            rotary_mass_kg,
            bearing_n_per_m: 1e8,
            torsion_n_per_m,
        };
        PlanetaryParameters {
            sun: body(0.4, 0.39, 0.0),
            ring: body(2.35, 3.00, 1e9),
            carrier: body(5.43, 6.29, 0.0),
            planet: body(0.66, 0.61, 0.0),
            positions_rad: (0..planets).map(|i| TAU * f64::from(i) / f64::from(planets)).collect(),
            sun_mesh_n_per_m: 5e8,
            ring_mesh_n_per_m: 5e8,
            pressure_angles_rad: [24.6_f64.to_radians(); 2],
        }
    }

    fn found(planets: u32, kind: ModeKind) -> Vec<f64> {
        let modes = PlanetaryModel::new(&example(planets)).modes();
        modes.iter().filter(|mode| mode.kind == kind).map(|mode| mode.frequency_hz).collect()
    }

    /// Natural frequencies and kinds of modes of the example with three, four and five planets
    /// (table 2): 0.1 %.
    #[test]
    fn literature_lin_parker_1999() {
        let near = |found: &[f64], expected: &[f64], what: &str| {
            assert_eq!(found.len(), expected.len(), "{what}: {found:?}");
            for (found, expected) in found.iter().zip(expected) {
                assert!((found - expected).abs() < 1e-3 * expected + 0.5, "{what}: {found} {expected}");
            }
        };
        let rotational = [
            [0.0, 1475.7, 1930.3, 2658.3, 7462.8, 11775.3],
            [0.0, 1536.6, 1970.6, 2625.7, 7773.6, 13071.1],
            [0.0, 1567.4, 2006.1, 2614.9, 8065.4, 14253.4],
        ];
        let translational = [
            [743.2, 1102.4, 1896.0, 2276.4, 6986.3, 9647.9],
            [727.0, 1091.0, 1892.8, 2342.5, 7189.9, 10437.6],
            [710.0, 1072.1, 1888.1, 2425.3, 7382.2, 11172.5],
        ];
        for (i, planets) in [3, 4, 5].into_iter().enumerate() {
            near(&found(planets, ModeKind::Rotational), &rotational[i], "rotational");
            // Each of them twice.
            let twice: Vec<f64> = translational[i].iter().flat_map(|&f| [f, f]).collect();
            near(&found(planets, ModeKind::Translational), &twice, "translational");
            let of_planets: Vec<f64> =
                [1808.2, 5963.8, 6981.7].iter().flat_map(|&f| vec![f; planets as usize - 3]).collect();
            near(&found(planets, ModeKind::Planet), &of_planets, "planet");
            assert_eq!(found(planets, ModeKind::Mixed).len(), 0);
        }
    }

    /// Planets that do not stand equally mix the kinds (Lin & Parker 2000); opposite pairs keep the
    /// turning apart from the sideways motion.
    #[test]
    fn literature_unequal_planets_mix_the_kinds() {
        let mut unequal = example(4);
        unequal.positions_rad = vec![0.0, 1.4, 3.3, 4.9];
        let modes = PlanetaryModel::new(&unequal).modes();
        assert!(modes.iter().filter(|mode| mode.kind == ModeKind::Mixed).count() > 3);
        let mut pairs = example(4);
        pairs.positions_rad = [0.0, 100.0, 180.0, 280.0].map(f64::to_radians).to_vec();
        let modes = PlanetaryModel::new(&pairs).modes();
        assert!(modes.iter().all(|mode| mode.kind != ModeKind::Mixed));
    }

    /// Mesh forces of harmonic l with the planets' phases `l z_s ψ_n`, at sun and ring, push modes
    /// of the kind that Parker's rule says and leave the others at rest (1e-9 of the largest), for
    /// every number of planets from 3 to 6 and every remainder.
    #[test]
    fn literature_parker_2000_phasing_rules() {
        for planets in 3..=6_u32 {
            let parameters = example(planets);
            let model = PlanetaryModel::new(&parameters);
            let modes = model.modes();
            for teeth in 24..24 + planets {
                for harmonic in 1..=5 {
                    let mut force: DVector<Complex<f64>> = DVector::zeros(model.mass.len());
                    for (i, psi) in parameters.positions_rad.iter().enumerate() {
                        let turn = Complex::from_polar(1.0, f64::from(harmonic * teeth) * psi);
                        // The ring mesh has a phase of its own, the same for all planets.
                        let at_ring = turn * Complex::from_polar(0.7, 1.1);
                        force += model.sun_meshes[i].map(|x| turn * x) + model.ring_meshes[i].map(|x| at_ring * x);
                    }
                    let pushed = |mode: &PlanetaryMode| {
                        mode.shape.iter().zip(force.iter()).map(|(x, f)| f * x).sum::<Complex<f64>>().norm()
                    };
                    let largest = modes.iter().map(pushed).fold(0.0, f64::max);
                    let rule = excited(teeth, planets, harmonic);
                    for mode in modes.iter().filter(|mode| mode.kind != rule) {
                        assert!(pushed(mode) < 1e-9 * largest, "{planets} {teeth} {harmonic} {:?}", mode.kind);
                    }
                }
            }
        }
    }

    /// The shipped planetary bench: sun of 28, four planets, all in phase: every harmonic excites
    /// rotational modes alone. A ring that cannot turn leaves no free member beside sun, planets
    /// and carrier: one free rotation.
    #[test]
    fn analytic_modes_of_the_shipped_planetary_stage() {
        let bench = crate::shipped::bench("planetary-parallel").unwrap();
        let parameters = PlanetaryModel::parameters(&bench, 0).unwrap();
        let modes = PlanetaryModel::new(&parameters).modes();
        assert_eq!(modes.len(), 21);
        assert!(modes[0].frequency_hz < 1e-2 && modes[1].frequency_hz > 10.0, "{}", modes[1].frequency_hz);
        assert!((1..=5).all(|l| excited(28, 4, l) == ModeKind::Rotational));
        assert!(modes.iter().all(|mode| mode.kind != ModeKind::Mixed));
        // By hand: ε of sun and planet 1.646, c' of 28/36 teeth 13.0 N/(mm µm), c_γ = 19.3.
        let per_mm = parameters.sun_mesh_n_per_m / 1e9 / (1e-3 * bench.stages[0].face_width_mm);
        assert!((per_mm - 19.3).abs() < 0.4, "{per_mm}");
        assert!(PlanetaryModel::parameters(&bench, 1).unwrap_err().to_string().contains("not planetary"));
    }
    /// Frequencies of the shipped stage with their counts make up all modes but the free rotation;
    /// with all planets in phase only rotational modes are met, at the speed at which harmonic ×
    /// mesh frequency is the mode's frequency; unequal planets forbid nothing.
    #[test]
    fn analytic_critical_speeds_of_the_shipped_planetary_stage() {
        let mut bench = crate::shipped::bench("planetary-parallel").unwrap();
        let found = StageModes::new(&bench, 0).unwrap();
        assert_eq!(found.modes.iter().map(|mode| mode.count).sum::<usize>(), 20);
        let critical = found.critical_speeds(5, 300.0);
        assert!(!critical.is_empty());
        // Mesh frequency of a sun of 28 within a ring of 100 that stands still: 28 × 100 / 128 of
        // the sun's speed.
        let mesh_order = 28.0 * 100.0 / 128.0;
        for c in &critical {
            let mode = found.modes[c.mode];
            assert_eq!(mode.kind, ModeKind::Rotational);
            let mesh_hz = f64::from(c.harmonic) * mesh_order * c.motor_hz;
            assert!((mesh_hz / mode.frequency_hz - 1.0).abs() < 1e-12, "{c:?}");
        }
        let set = bench.stages[0].gearing.planetary.as_mut().unwrap();
        set.positions_deg = vec![0.0, 87.1875, 180.0, 267.1875];
        let uneven = StageModes::new(&bench, 0).unwrap();
        assert_eq!(uneven.excited(1), None);
        assert!(uneven.critical_speeds(5, 300.0).len() > critical.len());
    }
}
