//! What an effect declares of itself.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

/// A line of the spectrum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Line {
    /// Moves with speed: a multiple of the first shaft's speed.
    Order(f64),
    /// Stays where it is (Hz).
    Hertz(f64),
}

impl Line {
    /// Where the line stands in a recording (Hz): above half the sampling rate it folds back.
    pub fn recorded_hz(self, first_shaft_hz: f64, sample_rate_hz: f64) -> f64 {
        let true_hz = match self {
            Self::Order(order) => order * first_shaft_hz,
            Self::Hertz(hz) => hz,
        };
        (true_hz - sample_rate_hz * (true_hz / sample_rate_hz).round()).abs()
    }
}

/// How the *change* that an effect makes on its lines follows the brake torque at one speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Law {
    /// The same at any torque, as geometric errors are.
    Independent,
    /// `∝ T^p`; p = 1 for changes of stiffness.
    Power(f64),
    /// The same at any torque on the orders of the shaft. Beside the mesh lines the load decides by
    /// how many pairs a tooth's error is shared, and when: each sideband goes its own way.
    ShaftOrders,
    /// No single law: both parts, an optimum or a threshold.
    Mixed,
}

impl std::fmt::Display for Law {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Independent => write!(f, "the same at any torque"),
            Self::Power(p) if *p == 1.0 => write!(f, "in proportion to the torque"),
            Self::Power(p) => write!(f, "as torque^{p}"),
            Self::ShaftOrders => write!(f, "shaft orders the same at any torque, each sideband in its own way"),
            Self::Mixed => write!(f, "no single law of torque"),
        }
    }
}

/// How the change follows speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SpeedLaw {
    /// The same at any speed, as for what enters behind the sensor.
    Independent,
    /// `∝ Ω^p` ahead of all resonances.
    Power(f64),
    /// By the resonances that the lines meet: no law of its own.
    Resonances,
}

impl std::fmt::Display for SpeedLaw {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Independent => write!(f, "the same at any speed"),
            Self::Power(p) if *p == 1.0 => write!(f, "in proportion to the speed"),
            Self::Power(p) => write!(f, "as speed^{p}"),
            Self::Resonances => write!(f, "with speed as the resonances have it"),
        }
    }
}

/// Whether lines come up or are altered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// Lines rise that are weak or absent without the effect.
    Rises,
    /// Lines that are there anyway change amplitude or phase, up or down.
    Alters,
    /// The whole spectrum, noise and all, is altered by one function of frequency.
    Path,
    /// All orders shift in frequency by one factor.
    Shifts,
}

impl std::fmt::Display for Change {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Rises => "lines rise",
            Self::Alters => "lines change",
            Self::Path => "the whole spectrum changes by one function of frequency",
            Self::Shifts => "all orders shift by one factor",
        })
    }
}

/// Which lines an effect moves and by which laws.
#[derive(Clone, Debug, PartialEq)]
pub struct Signature {
    /// The declared lines, strongest families first. Lines elsewhere stay.
    pub lines: Vec<Line>,
    /// What happens to them.
    pub change: Change,
    /// Change against torque.
    pub load: Law,
    /// Change against speed.
    pub speed: SpeedLaw,
}

/// Number of mesh harmonics that declarations count.
pub const HARMONICS: u32 = 5;

/// Mesh harmonics 1 to [`HARMONICS`] of a stage.
pub fn mesh_lines(train: &Train, stage: usize) -> Vec<Line> {
    (1..=HARMONICS).map(|h| Line::Order(f64::from(h) * train.stages[stage].mesh_order)).collect()
}

/// Mesh harmonics of all stages.
pub fn all_mesh_lines(train: &Train) -> Vec<Line> {
    (0..train.stages.len()).flat_map(|stage| mesh_lines(train, stage)).collect()
}

/// Harmonics 1 to `harmonics` of a shaft.
pub fn shaft_lines(train: &Train, shaft: usize, harmonics: u32) -> Vec<Line> {
    (1..=harmonics).map(|k| Line::Order(f64::from(k) * train.shafts[shaft].1)).collect()
}

/// Sidebands ±1…±`sidebands` times `spacing` (order of the first shaft) about the mesh harmonics of
/// a stage.
pub fn sidebands(train: &Train, stage: usize, spacing: f64, sidebands: u32) -> Vec<Line> {
    let mesh = train.stages[stage].mesh_order;
    (1..=HARMONICS)
        .flat_map(|h| (1..=sidebands).flat_map(move |k| [-1.0, 1.0].map(|sign| (f64::from(h), sign * f64::from(k)))))
        .map(|(h, k)| Line::Order(h * mesh + k * spacing))
        .collect()
}

/// What planets that are not alike raise: the lines of their passing.
pub fn passing(bench: &Bench, stage: usize) -> Signature {
    passing_up_to(bench, stage, 0)
}

/// As [`passing`], where something happens up to `most` times a turn of the carrier.
pub fn passing_up_to(bench: &Bench, stage: usize, most: u32) -> Signature {
    Signature {
        lines: passing_lines(bench, stage, most),
        change: Change::Rises,
        load: Law::Mixed,
        speed: SpeedLaw::Resonances,
    }
}

/// Harmonics of a planetary stage's mesh, and lines at multiples of its carrier's speed beside them
/// up to the next passing of planets, or to `most`.
fn passing_lines(bench: &Bench, stage: usize, most: u32) -> Vec<Line> {
    let train = Train::new(bench);
    let Some(set) = &train.stages[stage].planetary else { return Vec::new() };
    let mut out = sidebands(&train, stage, set.carrier_order.abs(), set.planets.max(most));
    out.extend(mesh_lines(&train, stage));
    out.extend((1..=2 * set.planets.max(most)).map(|k| Line::Order(f64::from(k) * set.carrier_order.abs())));
    out
}

/// The line of a repetition rate; the motor's speed is `motor_order` times that of the first shaft.
pub fn rate_line(train: &Train, rate: crate::setup::Rate) -> Line {
    match rate {
        crate::setup::Rate::Hertz(hz) => Line::Hertz(hz),
        crate::setup::Rate::PerRevolution { shaft, order } => {
            Line::Order(order * shaft.map_or(train.motor_order, |i| train.shafts[i].1))
        }
    }
}

impl Signature {
    /// Declares nothing: for a place where the effect cannot sit.
    pub fn nothing() -> Self {
        Self { lines: Vec::new(), change: Change::Alters, load: Law::Mixed, speed: SpeedLaw::Resonances }
    }
}
