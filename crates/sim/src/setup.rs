//! What is simulated: the bench plus everything that effects and scenarios add to it.
//!
//! Effects change a [`SimSetup`]; the simulator is then built from it once. So an effect needs to
//! know nothing of the integrator, and composite effects go through one model instead of being
//! added up.

use gearwatch_core::bench::Bench;
use gearwatch_core::bench::term::{PathMode, ResolvedTerm};

use crate::faults::ToothModifications;
use crate::impact::Impact;
use crate::mesh::MeshOptions;
use crate::meshes::Between;
use crate::rotation::Profile;

/// How often something repeats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rate {
    /// Times per revolution of the shaft with this index.
    PerRevolution {
        /// Index of the shaft; `None` for the motor.
        shaft: Option<usize>,
        /// Multiple of its speed.
        order: f64,
    },
    /// At a fixed frequency (Hz).
    Hertz(f64),
}

/// The reference rotation is not even: `Ω(t) = Ω (1 + depth cos(rate))`, the same for all shafts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeedFluctuation {
    /// How often.
    pub rate: Rate,
    /// Amplitude / mean speed (1).
    pub depth: f64,
}

/// Where a torque ripple enters the train.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RippleAt {
    /// The motor's torque.
    Motor,
    /// The driven end of the first shaft.
    Coupling,
    /// The brake's torque.
    Brake,
}

/// A torque `T (1 + depth cos(order θ))` about its mean, with the angle of the part where it
/// enters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TorqueRipple {
    /// Where.
    pub at: RippleAt,
    /// Per revolution of that part.
    pub order: f64,
    /// Amplitude / mean torque there (1).
    pub depth: f64,
    /// What makes it is ahead of that part by this share of the speed at the bench's own torque
    /// (1), and in proportion to the torque at the start: the field in an induction motor.
    pub slip: f64,
}

/// Which coupling.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CouplingAt {
    /// Between drive and first shaft; behind the belt where there is one.
    Drive,
    /// Between last shaft and brake.
    Brake,
}

/// A coupling whose shafts are not in line; see [`crate::model::TrainModel`] for what it does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Misaligned {
    /// Where.
    pub at: CouplingAt,
    /// Angle between the axes (rad).
    pub angle_rad: f64,
    /// Distance of the axes (m).
    pub offset_m: f64,
    /// Between the two planes in which it flexes (m, > 0).
    pub length_m: f64,
    /// In bending of one of these planes, the mean over a turn (N m/rad).
    pub stiffness_nm_per_rad: f64,
    /// `(k₁ − k₂)/(k₁ + k₂)` of that stiffness about two axes that turn with it (1).
    pub unlike: f64,
}

/// A force on the bearings of a shaft that its rotation brings about, or another force on the train
/// that repeats with a shaft, a planet or the belt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ShaftForce {
    /// Twice a turn: a radial force on a shaft, and a torque, of a misaligned coupling.
    Coupling(Misaligned),
    /// The joint of the belt runs over both pulleys.
    BeltJoint {
        /// By which the pitch line of the joint lies farther out than that of the belt (m).
        raised_m: f64,
        /// Length of the joint (m).
        length_m: f64,
    },
    /// As [`Self::Impacts`], of the bearing between a planet and its pin.
    PlanetImpacts {
        /// Index of the stage.
        stage: usize,
        /// From 0.
        planet: usize,
        /// Passages per turn of the planet on its pin.
        order: f64,
        /// Peak force (N) in the middle of the load zone at the bench's own brake torque.
        force_n: f64,
        /// The defect is on the pin, which stands to the load; otherwise it turns with the planet.
        on_pin: bool,
    },
    /// `m e Ω²`, rotating with the shaft.
    Unbalance {
        /// Index of the shaft.
        shaft: usize,
        /// Mass × eccentricity (kg m).
        amount_kg_m: f64,
    },
    /// One short push per passage of a rolling element over a defect, along the radius of the
    /// defect and with the load there, with cage slip.
    Impacts {
        /// Index of the shaft.
        shaft: usize,
        /// Passages per revolution of the shaft.
        order: f64,
        /// Peak force (N) in the middle of the load zone at the bench's own brake torque.
        force_n: f64,
        /// The defect turns with the shaft through the load zone; otherwise it stands in the middle
        /// of it.
        inner_race: bool,
    },
    /// Radial play of the bearing in its seat: its spring and damper act beyond the gap only.
    LooseSeat {
        /// Index of the shaft.
        shaft: usize,
        /// Play to either side (m).
        gap_m: f64,
    },
}

/// A single resonance in the path to a sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resonance {
    /// Natural frequency (Hz).
    pub frequency_hz: f64,
    /// Fraction of critical.
    pub damping_ratio: f64,
    /// Its kind.
    pub kind: ResonanceKind,
}

/// How a resonance joins the path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ResonanceKind {
    /// A further structural mode beside the path:
    /// `H = 1 + gain · (f/f₀)² / (1 − (f/f₀)² + 2iζ f/f₀)`.
    Parallel {
        /// Share of the mode in the motion at the sensor.
        gain: f64,
    },
    /// The sensor on its mounting: `H = 1 / (1 − (f/f₀)² + 2iζ f/f₀)`.
    Mounting,
}

/// The path to a sensor as modes side by side:
/// `H = direct + Σ gain (f/f₀)² / (1 − (f/f₀)² + 2iζ f/f₀)`.
#[derive(Clone, Debug, PartialEq)]
pub struct ModalFilter {
    /// What goes past the modes.
    pub direct: f64,
    /// The modes.
    pub modes: Vec<PathMode>,
}

/// A tone that is added to a sensor's signal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tone {
    /// How often; above half the sampling rate it folds back, as in a converter without a filter.
    pub rate: Rate,
    /// Amplitude in the sensor's unit.
    pub amplitude: f64,
}

/// A sensor and its channel.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorSetup {
    /// Factor on the signal.
    pub gain: f64,
    /// In the order of application.
    pub resonances: Vec<Resonance>,
    /// Behind the resonances, one after the other.
    pub modal_filters: Vec<ModalFilter>,
    /// Added before the converter.
    pub tones: Vec<Tone>,
    /// Level at which the amplifier clips, in the sensor's unit.
    pub clip_level: Option<f64>,
    /// White noise of the machine ahead of the path, standard deviation per sample (m/s²).
    pub background_m_per_s2: f64,
    /// White noise of sensor and amplifier, standard deviation per sample in the sensor's unit.
    pub noise: f64,
    /// Full scale of the converter, in the sensor's unit.
    pub full_scale: f64,
    /// Bits of the converter.
    pub bits: u32,
    /// Corner of the first-order high-pass of the transducer supply (Hz).
    pub coupling_hz: f64,
}

impl SensorSetup {
    /// A common 100 mV/g transducer at a 24-bit converter: full scale 500 m/s², noise 2 mm/s² a
    /// sample, background of the machine 4 mm/s², 0.5 Hz coupling; the same figures through the
    /// unit for `g`, and as plain numbers for any other unit.
    pub fn typical(unit: &str) -> Self {
        let unit_per_metre = metres_per_second2_to(unit);
        Self {
            gain: 1.0,
            resonances: Vec::new(),
            modal_filters: Vec::new(),
            tones: Vec::new(),
            clip_level: None,
            background_m_per_s2: 4e-3,
            noise: 2e-3 * unit_per_metre,
            full_scale: 500.0 * unit_per_metre,
            bits: 24,
            coupling_hz: 0.5,
        }
    }
}

/// Factor from m/s² to a sensor's unit: `g` = 9.80665 m/s²; `V` stands for a 100 mV/g transducer; 1
/// otherwise.
pub fn metres_per_second2_to(unit: &str) -> f64 {
    match unit {
        "g" => 1.0 / 9.806_65,
        "V" => 0.1 / 9.806_65,
        _ => 1.0,
    }
}

/// Temperature of a bench of which nobody says one (°C).
pub const ROOM_C: f64 = 20.0;

/// Everything that is simulated.
#[derive(Clone, Debug, PartialEq)]
pub struct SimSetup {
    /// The bench; effects change its numbers, never its names.
    pub bench: Bench,
    /// Physics of the tooth contacts.
    pub mesh: MeshOptions,
    /// What is wrong with the teeth, one per stage of the bench, in its order.
    pub teeth: Vec<ToothModifications>,
    /// What is wrong with planets, carrier and idlers, one per stage of the bench, in its order.
    pub between: Vec<Between>,
    /// How sharply a sensor hears the planet that passes it: the κ of [`crate::linear::Passage`].
    pub planet_pass: f64,
    /// The contact law of multibody programs in place of elastic tooth pairs, for all meshes.
    pub impact: Option<Impact>,
    /// The same, with the usual parameters of each pair.
    pub usual_impact: bool,
    /// Creep of the belt at the bench's nominal torque (1); it grows with the torque.
    pub belt_creep: f64,
    /// Uneven reference rotation.
    pub speed_fluctuations: Vec<SpeedFluctuation>,
    /// Ripple of driving and braking torques.
    pub torque_ripples: Vec<TorqueRipple>,
    /// Forces on bearings.
    pub shaft_forces: Vec<ShaftForce>,
    /// One per sensor of the bench, in its order.
    pub sensors: Vec<SensorSetup>,
    /// The sample clock runs fast by this (1e-6); the recording still says the nominal rate.
    pub clock_ppm: f64,
    /// Standard deviation of a tacho edge (s).
    pub tacho_jitter_s: f64,
    /// Terms of the equations of motion that no effect has a name for, those of the paths left out:
    /// they are in `sensors`.
    pub terms: Vec<ResolvedTerm>,
    /// Temperature over time (°C), which terms may follow.
    pub temperature_c: Profile,
}

/// [`SimSetup::planet_pass`] of a bench of which nobody says one.
pub const PLANET_PASS: f64 = 1.0;

impl SimSetup {
    /// The bench as its file says, its own `[[effect]]` and `[[term]]` tables not yet applied.
    pub fn nominal(bench: &Bench) -> Self {
        let mut bench = bench.clone();
        bench.effects.clear();
        bench.terms.clear();
        Self {
            sensors: bench.sensors.iter().map(|sensor| SensorSetup::typical(&sensor.unit)).collect(),
            mesh: MeshOptions::default(),
            teeth: vec![ToothModifications::default(); bench.stages.len()],
            between: bench.stages.iter().map(Between::of_stage).collect(),
            planet_pass: PLANET_PASS,
            impact: None,
            usual_impact: false,
            bench,
            belt_creep: 0.0,
            speed_fluctuations: Vec::new(),
            torque_ripples: Vec::new(),
            shaft_forces: Vec::new(),
            clock_ppm: 0.0,
            tacho_jitter_s: 2e-6,
            terms: Vec::new(),
            temperature_c: Profile::constant(ROOM_C),
        }
    }
}
