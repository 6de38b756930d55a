//! The linear part of a gear train: mass, damping and stiffness matrices of everything but the
//! tooth contacts.
//!
//! Degrees of freedom (PHYSICS of the 15-DOF two-stage bench with a belt, generalised to n stages):
//!
//! ```text
//! motor ──belt── in₀ ══torsion══ out₀          angles, each positive in its shaft's driving sense, as deviations
//!                              pinion₁         from the reference rotation Ω_i(t) that the kinematics prescribe
//!                              wheel₁ in₁ ═══ out₁ pinion₂
//!                                                wheel₂ in₂ ═══ out₂ ── brake
//! every gear: x, y against its bearing; an idler its angle, too
//! every shaft that bends: its modes in x and y, which move its gears (linear/beams.rs)
//! planets and what they mesh with: in the frame of their carrier (linear/planetary.rs)
//! every shaft of helical gears: z along its axis
//! every housing mode and sensor direction: one modal coordinate
//! ```
//!
//! A shaft's own inertia sits half at each end. Without a belt the motor is rigidly one with the
//! first shaft's driven end. Housing modes are driven by the bearing forces and do not act back
//! (housing mass ≫ gear mass), so their rows make `K` and `C` unsymmetric; the structural part
//! alone is symmetric.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;
use nalgebra::{DMatrix, DVector};

use crate::meshes::MeshPlace;

mod beams;
mod parts;
mod passage;
mod planetary;

pub use beams::BeamPlace;
pub(crate) use beams::Hold;
pub use parts::gear_mass_and_inertia;
pub(crate) use parts::ring_mass_and_inertia;
pub use passage::{Heard, Passage, Passed};
pub use planetary::Pin;

/// Mass that a bearing force moves at its sensor where the bench file knows no housing mode (kg): a
/// laboratory gearbox.
pub const DIRECT_PATH_MASS_KG: f64 = 25.0;

/// How a sensor's acceleration follows from the coordinates:
/// `a = position·q + velocity·q̇ + acceleration·q̈`.
#[derive(Clone, Debug, PartialEq)]
pub struct OutputRow {
    /// Factors of `q` (1/s²).
    pub position: DVector<f64>,
    /// Factors of `q̇` (1/s).
    pub velocity: DVector<f64>,
    /// Factors of `q̈` (1).
    pub acceleration: DVector<f64>,
}

/// Where a gear sits among the coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GearPlace {
    /// Its angle; `None` where it cannot turn.
    pub angle: Option<usize>,
    /// Its lateral x; y is the next one. Of a planet the distance from the carrier's axis, then the
    /// way along its circle. Of a gear with a seat the first coordinate of its shaft: where the
    /// gear is says [`LinearTrain::lateral`].
    pub x: usize,
    /// Which of the gears it is on a shaft that bends.
    pub seat: Option<usize>,
    /// Its shaft; of a planet that of its carrier, of an idler that of the pinion, of a fixed
    /// member the stage's first.
    pub shaft: usize,
    /// x and y turn with the carrier of this stage.
    pub carried: Option<usize>,
}

/// Geometry of a mesh as the dynamics see it.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshGeometry {
    /// Which of the bench's.
    pub place: MeshPlace,
    /// Base radius of the driving gear (m).
    pub pinion_base_m: f64,
    /// Base radius of the driven gear (m).
    pub wheel_base_m: f64,
    /// Direction of the line of action: that of the tooth force on the wheel (x, y; unit vector),
    /// in the pinion's coordinates.
    pub normal: [f64; 2],
    /// 1 where the pinion turns counter-clockwise seen from the motor, else −1; against its carrier
    /// where it has one.
    pub sense: f64,
    /// Factors on the angles of pinion and wheel that make each positive in its gear's sense of
    /// rotation.
    pub turning: [f64; 2],
    /// Operating pressure angle of the transverse section (rad).
    pub pressure_angle_rad: f64,
    /// Coordinates along the axes of pinion and wheel of a helical pair.
    pub axial: Option<[usize; 2]>,
    /// Force on the pinion along its axis per mesh force: `tan β_b`, positive towards the motor; 0
    /// for straight teeth.
    pub thrust: f64,
    /// Where the pinion sits.
    pub pinion: GearPlace,
    /// Where the wheel sits.
    pub wheel: GearPlace,
    /// `1 / (r_b1² / J_1 + r_b2² / J_2)` of the two gears (kg).
    pub effective_mass_kg: f64,
    /// Angle of the pinion against what carries it, in its sense of rotation: coordinates and
    /// factors.
    pub angle: Vec<(usize, f64)>,
    /// Mesh cycles per turn of that angle.
    pub cycles_per_turn: f64,
    /// Mesh cycles per turn of the first shaft.
    pub order: f64,
    /// Static mesh force per torque on the last shaft (1/m).
    pub force_per_torque: f64,
}

/// Generalised forces of unit forces at the bearings of a shaft's gears, which share them equally;
/// of those gears that move in one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct BearingFrame {
    /// Force along x of the frame.
    pub x: DVector<f64>,
    /// Along y.
    pub y: DVector<f64>,
    /// Counter-clockwise turns of the frame per revolution of the first shaft; 0 in space.
    pub order: f64,
    /// 1 where the shaft turns counter-clockwise seen from the motor, else −1.
    pub sense: f64,
}

/// Mass, damping and stiffness matrices, input vectors and output rows of a bench without its tooth
/// contacts.
///
/// # Formula
/// `M q̈ + C q̇ + K q = motor T_m − brake T_b − Σ_j mesh_j F_j + …`, with the approach of stage j
/// along its line of action `δ_j = mesh_j · q` (m, compression positive) and its tooth force `F_j`
/// (N). `K` has one zero eigenvalue: the train turns freely.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearTrain {
    /// What each coordinate is, such as `input.out` (rad), `stage1.pinion.x` (m), `housing_1@90`
    /// (m).
    pub names: Vec<String>,
    /// Mass matrix (kg, kg m²), diagonal.
    pub mass: DMatrix<f64>,
    /// Damping matrix (N s/m, N m s/rad).
    pub damping: DMatrix<f64>,
    /// Stiffness matrix (N/m, N m/rad).
    pub stiffness: DMatrix<f64>,
    /// Per mesh: `δ_j = mesh_j · q`, and the tooth force `F_j` acts as `−mesh_j F_j`.
    pub mesh: Vec<DVector<f64>>,
    /// Generalised force of a unit driving torque of the motor.
    pub motor: DVector<f64>,
    /// Generalised force of a unit torque on the driven end of the first shaft.
    pub coupling: DVector<f64>,
    /// Generalised force of a unit braking torque (its sign is that of a load).
    pub brake: DVector<f64>,
    /// Per shaft: what a force at its gears' bearings acts on, by the frames in which its gears
    /// move; of a shaft that bends, a force that its supports share equally.
    pub bearings: Vec<Vec<BearingFrame>>,
    /// Per shaft: what a force acts on that its gears share equally.
    pub at_gears: Vec<Vec<BearingFrame>>,
    /// Per shaft: where and how it bends.
    pub beams: Vec<Option<BeamPlace>>,
    /// `-J_i n_i` of all inertias but the motor's, per rad/s² of the first shaft's reference
    /// acceleration.
    pub reference_acceleration: DVector<f64>,
    /// Per sensor of the bench, in its order.
    pub sensors: Vec<OutputRow>,
    /// Per mesh.
    pub meshes: Vec<MeshGeometry>,
    /// Speed of each shaft / speed of the first shaft.
    pub shaft_orders: Vec<f64>,
    /// Coordinate of the motor's angle.
    pub motor_angle: usize,
    /// Coordinates of each shaft's driven and driving end angle.
    pub shaft_angles: Vec<(usize, usize)>,
    /// Coordinate of each shaft along its axis; `None` for shafts without helical gears.
    pub axial: Vec<Option<usize>>,
    /// Gears and carriers on each shaft.
    pub on_shaft: Vec<Vec<GearPlace>>,
    /// Idlers.
    pub idlers: Vec<GearPlace>,
    /// Planets on their pins.
    pub pins: Vec<Pin>,
    /// Coordinates that follow the reference rotation though they are no shaft's, with their speed
    /// (or way per angle) / the first shaft's.
    pub turning: Vec<(usize, f64)>,
    /// What planetary stages pass on to housing and sensors.
    pub passage: Passage,
    /// Number of coordinates before the housing modes.
    pub structural: usize,
}

impl LinearTrain {
    /// The linear part of a bench.
    ///
    /// The pinion of the first stage turns counter-clockwise seen from the motor, the next shaft
    /// clockwise, and so on. The tooth force on a wheel points along the tangential driving
    /// direction turned by the pressure angle away from the pinion.
    pub fn new(bench: &Bench) -> Self {
        let mut names = Vec::new();
        let mut dof = |name: String| {
            names.push(name);
            names.len() - 1
        };
        let motor_angle = dof("motor".into());
        let mut shaft_angles = Vec::with_capacity(bench.shafts.len());
        for (i, shaft) in bench.shafts.iter().enumerate() {
            let driven = if i == 0 && bench.belt.is_none() { motor_angle } else { dof(format!("{}.in", shaft.name)) };
            shaft_angles.push((driven, dof(format!("{}.out", shaft.name))));
        }
        let beams = beams::places(bench, beams::reduced(bench), &mut dof);
        let mut places: Vec<StagePlaces> = Vec::with_capacity(bench.stages.len());
        for (i, stage) in bench.stages.iter().enumerate() {
            if let Some(set) = &stage.gearing.planetary {
                places.push(StagePlaces::Planetary(planetary::Places::new(stage, set, i, &shaft_angles, &mut dof)));
                continue;
            }
            let mut place = |which: &str, angle, shaft: usize| {
                // Of two gears on a shaft that bends the wheel is the first.
                let seat = if which == "pinion" { usize::from(i > 0) } else { 0 };
                let on_beam = beams[shaft].as_ref().filter(|_| matches!(which, "pinion" | "wheel"));
                let (x, seat) = match on_beam {
                    Some(beam) => (beam.first, Some(seat)),
                    None => (dof(format!("{}.{which}.x", stage.name)), None),
                };
                if seat.is_none() {
                    dof(format!("{}.{which}.y", stage.name));
                }
                GearPlace { angle, x, seat, shaft, carried: None }
            };
            let mut chain = vec![place("pinion", Some(shaft_angles[i].1), i)];
            for idler in 1..=stage.gearing.idlers.len() {
                chain.push(place(&format!("idler_{idler}"), None, i));
            }
            chain.push(place("wheel", Some(shaft_angles[i + 1].0), i + 1));
            let inner = 1..chain.len() - 1;
            for (at, idler) in chain[inner].iter_mut().zip(1..) {
                at.angle = Some(dof(format!("{}.idler_{idler}.angle", stage.name)));
            }
            places.push(StagePlaces::Chain(chain));
        }
        let helical = |stage: usize| bench.stages.get(stage).is_some_and(|stage| stage.gearing.helix.is_some());
        let axial = (bench.shafts.iter().enumerate())
            .map(|(i, shaft)| {
                (helical(i) || i > 0 && helical(i - 1)).then(|| {
                    names.push(format!("{}.z", shaft.name));
                    names.len() - 1
                })
            })
            .collect();
        let structural = names.len();
        let directions = distinct_directions(bench);
        for (r, _) in bench.housing_modes.iter().enumerate() {
            for direction in &directions {
                names.push(format!("housing_{}@{direction}", r + 1));
            }
        }

        let n = names.len();
        let zero = || DVector::<f64>::zeros(n);
        let mut train = Self {
            mass: DMatrix::zeros(n, n),
            damping: DMatrix::zeros(n, n),
            stiffness: DMatrix::zeros(n, n),
            mesh: Vec::new(),
            motor: zero(),
            coupling: zero(),
            brake: zero(),
            bearings: Vec::new(),
            at_gears: Vec::new(),
            beams,
            reference_acceleration: zero(),
            sensors: Vec::new(),
            meshes: Vec::new(),
            on_shaft: vec![Vec::new(); bench.shafts.len()],
            idlers: Vec::new(),
            pins: Vec::new(),
            turning: Vec::new(),
            passage: Passage::default(),
            shaft_orders: Train::new(bench).shafts.into_iter().map(|(_, order)| order).collect(),
            motor_angle,
            shaft_angles,
            axial,
            structural,
            names,
        };
        train.add_rotation(bench);
        train.add_beams(bench);
        train.add_stages(bench, &places);
        train.add_housing(bench, &directions);
        train.add_passage(bench, &places, &directions);
        train
    }

    /// Adds `½ k (row·q)²` to the potential energy and `½ c (row·q̇)²` to the dissipation.
    pub fn add_spring(&mut self, row: &DVector<f64>, stiffness: f64, damping: f64) {
        self.stiffness.ger(stiffness, row, row, 1.0);
        self.damping.ger(damping, row, row, 1.0);
    }

    /// The gears on a shaft, and the carrier where it has one.
    pub fn gears_on(&self, shaft: usize) -> Vec<GearPlace> {
        self.on_shaft[shaft].clone()
    }

    /// The gears whose bearings a sensor at a shaft hears, as far as their coordinates stand in
    /// space: idlers run on pins beside the pinion.
    fn heard_at(&self, shaft: usize) -> Vec<GearPlace> {
        let all = self.on_shaft[shaft].iter().chain(&self.idlers).copied();
        all.filter(|gear| gear.shaft == shaft && gear.carried.is_none()).collect()
    }

    /// The reference rotation: speed of every coordinate / that of the first shaft, `motor_order`
    /// being the motor's.
    pub fn rotation(&self, motor_order: f64) -> DVector<f64> {
        let mut out = DVector::zeros(self.names.len());
        out[self.motor_angle] = motor_order;
        for (&(a, b), &order) in self.shaft_angles.iter().zip(&self.shaft_orders) {
            (out[a], out[b]) = (order, order);
        }
        for &(at, order) in &self.turning {
            out[at] = order;
        }
        out
    }

    /// Housing coordinates with the generalised force on each per unit force (x, y) that a shaft's
    /// bearing passes on.
    pub(crate) fn bearing_to_housing(&self, bench: &Bench, shaft: usize) -> Vec<(usize, [f64; 2])> {
        let directions = distinct_directions(bench);
        let name = &bench.shafts[shaft].name;
        let of_mode = |(r, mode): (usize, &gearwatch_core::bench::HousingMode)| {
            let shape = mode.shape.get(name).copied().unwrap_or(0.0);
            let first = self.structural + r * directions.len();
            let along = directions.iter().enumerate().map(move |(d, direction)| {
                let (sin, cos) = direction.to_radians().sin_cos();
                (first + d, [shape * cos, shape * sin])
            });
            along.collect::<Vec<_>>()
        };
        bench.housing_modes.iter().enumerate().flat_map(of_mode).collect()
    }

    /// The train with a linear spring and damper in each mesh, for eigenfrequencies and for the
    /// exactly stepped part.
    pub fn with_meshes(&self, stiffness_n_per_m: &[f64], damping_n_s_per_m: &[f64]) -> Self {
        let mut out = self.clone();
        for ((row, &k), &c) in self.mesh.iter().zip(stiffness_n_per_m).zip(damping_n_s_per_m) {
            out.add_spring(row, k, c);
        }
        out
    }

    /// First-order form `ẋ = A x + …` with `x = (q, q̇)`.
    pub fn state_matrix(&self) -> DMatrix<f64> {
        let n = self.names.len();
        let mut a = DMatrix::zeros(2 * n, 2 * n);
        for i in 0..n {
            a[(i, n + i)] = 1.0;
            let m = self.mass[(i, i)];
            for j in 0..n {
                a[(n + i, j)] = -self.stiffness[(i, j)] / m;
                a[(n + i, n + j)] = -self.damping[(i, j)] / m;
            }
        }
        a
    }

    /// Undamped natural frequencies of the structure (Hz, ascending), housing modes left out.
    pub fn natural_frequencies_hz(&self) -> Vec<f64> {
        let n = self.structural;
        let mut scaled = DMatrix::zeros(n, n);
        for i in 0..n {
            for j in 0..n {
                scaled[(i, j)] = self.stiffness[(i, j)] / (self.mass[(i, i)] * self.mass[(j, j)]).sqrt();
            }
        }
        let mut out: Vec<f64> = nalgebra::SymmetricEigen::new(scaled)
            .eigenvalues
            .iter()
            .map(|&square| square.max(0.0).sqrt() / std::f64::consts::TAU)
            .collect();
        out.sort_by(f64::total_cmp);
        out
    }
}

/// Where the gears of a stage sit.
enum StagePlaces {
    /// Pinion, idlers, wheel.
    Chain(Vec<GearPlace>),
    Planetary(planetary::Places),
}

fn distinct_directions(bench: &Bench) -> Vec<f64> {
    let mut out: Vec<f64> = Vec::new();
    for sensor in &bench.sensors {
        if !out.contains(&sensor.direction_deg) {
            out.push(sensor.direction_deg);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_bench;

    /// The train turns freely: exactly one natural frequency is zero (1e-3 Hz against the lowest
    /// torsional mode of tens of Hz).
    #[test]
    fn analytic_the_train_turns_freely() {
        let bench = test_bench::two_stages();
        let train = LinearTrain::new(&bench);
        let meshed = train.with_meshes(&[3e8, 3e8], &[0.0, 0.0]);
        let frequencies = meshed.natural_frequencies_hz();
        assert_eq!(frequencies.len(), 15, "motor, 2 × 3 shaft ends, 2 × 4 lateral");
        assert!(frequencies[0] < 1e-3 && frequencies[1] > 10.0, "{frequencies:?}");
        // The reference rotation itself: K · n = 0.
        let rigid = train.rotation(bench.belt.as_ref().map_or(1.0, |belt| belt.ratio));
        assert!((&meshed.stiffness * rigid).amax() < 1e-6 * meshed.stiffness.amax() * f64::EPSILON.sqrt());
    }

    /// Two gears on stiff, undamped bearings, shafts soft in torsion: the mesh mode is
    /// `√(k / m_e) / 2π`.
    #[test]
    fn analytic_mesh_mode_of_two_gears() {
        let mut bench = test_bench::single_stage();
        for shaft in &mut bench.shafts {
            shaft.inertia_kg_m2 = 1e-9;
            shaft.torsion_nm_per_rad = 1e-3;
            shaft.bearing_n_per_m = 1e16;
        }
        let train = LinearTrain::new(&bench);
        let k = 3e8;
        let expected = (k / train.meshes[0].effective_mass_kg).sqrt() / std::f64::consts::TAU;
        let meshed = train.with_meshes(&[k], &[0.0]);
        let nearest = meshed
            .natural_frequencies_hz()
            .into_iter()
            .min_by(|a, b| (a - expected).abs().total_cmp(&(b - expected).abs()))
            .unwrap();
        // Shaft inertia is 1e-6 of the gears', bearings 3e7 times stiffer than the mesh.
        assert!((nearest / expected - 1.0).abs() < 1e-5, "{nearest} {expected}");
    }
}
