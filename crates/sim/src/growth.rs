//! Growth in time: wear, a crack or pits from the first passage to the limit, and what sensors see
//! of it on the way.
//!
//! ```text
//! duties (speed, load, share of the hours) ─► law of growth ─► size after so many hours ─► steady state ─► lines, deviations, ranks
//!        ▲                                        │                                                          │
//!        └── load of the pairs, pressure, stress ◄┘            time from first significance to the limit ◄───┘
//! ```
//!
//! What is wrong with the teeth is followed through its own slow equation, with the load that the
//! damaged teeth take. Vibration follows its slow size at once, so that each step is one steady
//! state ([`crate::steady`]): weeks take as long as there are steps. The load is the static one;
//! dynamic loads are left out of the growth, as they are small below the resonance of the mesh.
//!
//! Known for pairs of external gears: wear and pits of spur and helical teeth, cracks of spur
//! teeth. Planets, idlers and internal gears are refused.

mod contact;
mod crack;
mod law;
mod merit;
mod pits;
mod run;
mod scatter;
mod wear;

use std::collections::BTreeMap;

use gearwatch_core::bench::{Bench, EffectSpec};
use gearwatch_core::train::Train;

pub use self::contact::{FaceLoads, FlankPoint, PLACES, RootSection, contact_modulus_pa};
pub use self::crack::{RootCrackGrowth, bending_factor, grown, tension_factor};
pub use self::law::{Constant, Constants};
pub use self::merit::{Merit, crossing};
pub use self::pits::PitGrowth;
pub use self::run::{Growth, Indicator, LineGroup, Plan, Step, run};
pub use self::scatter::baseline_scatter;
pub use self::wear::Wear;
use crate::effects::{self, EffectError, Place};
use crate::faults::Crack;
use crate::mesh::MeshError;
use crate::meshes;
use crate::setup::SimSetup;
use crate::source::SimError;
use crate::steady::SteadyError;

/// The effects that grow, with the constants of their laws.
pub const GROWING: &[(&str, &[Constant])] =
    &[("tooth_wear", law::WEAR), ("root_crack", law::CRACK), ("pitting", law::PITS)];

/// Depth of a first crack where none is said (m): the radius of a fillet of 3 mm module, below
/// which the notch rules.
const FIRST_CRACK_M: f64 = 1e-3;
/// Inclination of the crack, that of the effect `root_crack` (rad).
const CRACK_ANGLE_RAD: f64 = std::f64::consts::FRAC_PI_3;

/// Why growth cannot be followed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GrowthError {
    /// The effect or its place.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// The gear pair.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// There is no steady state.
    #[error(transparent)]
    Steady(#[from] SteadyError),
    /// The recording that the scatter is taken from.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// An effect without a law of growth.
    #[error("{0} has no law of growth; tooth_wear, root_crack and pitting have one")]
    NoLaw(String),
    /// An unknown constant.
    #[error("the law has no constant {found:?}; it has {known}")]
    UnknownConstant {
        /// As typed.
        found: String,
        /// All of them.
        known: String,
    },
    /// A constant that makes no sense.
    #[error("{} is {found}; expected {} to {} {} ({} is usual)", constant.name, constant.min, constant.max, constant.unit, constant.usual)]
    ConstantOutOfRange {
        /// Which.
        constant: Constant,
        /// As typed.
        found: f64,
    },
    /// Gears, duties or a plan that do not suit.
    #[error("{0}")]
    Unsuitable(String),
}

/// Speed and load for a share of the hours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Duty {
    /// Motor speed (Hz).
    pub motor_hz: f64,
    /// Brake torque (N m).
    pub torque_nm: f64,
    /// Share of the running hours; those of a schedule are 1 together.
    pub share: f64,
}

impl Duty {
    /// Revolutions an hour of pinion and wheel of a stage.
    pub fn passages_per_hour(&self, bench: &Bench, stage: usize) -> [f64; 2] {
        let first = self.motor_hz / bench.belt.as_ref().map_or(1.0, |belt| belt.ratio);
        let train = Train::new(bench);
        [stage, stage + 1].map(|shaft| 3600.0 * first * train.shafts.get(shaft).map_or(f64::NAN, |s| s.1))
    }

    /// Static mesh force of a stage (N).
    pub fn mesh_force_n(&self, bench: &Bench, stage: usize) -> f64 {
        self.torque_nm * meshes::force_per_torque(bench, &Train::new(bench), stage)
    }
}

/// Why something grows no further.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// The tooth broke off: the stress intensity reached the toughness.
    Fracture,
    /// The crack took so much of the root that the model of the tooth ends.
    Deepest,
}

impl End {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Fracture => "the tooth breaks off: the stress intensity reaches the toughness",
            Self::Deepest => "the crack has taken four fifths of the root, and the tooth breaks off",
        }
    }
}

/// What grows.
#[derive(Clone, Debug)]
pub enum Growing {
    /// Wear of all flanks of a stage.
    Wear(Box<Wear>),
    /// A crack at the root of a tooth.
    Crack(Box<RootCrackGrowth>),
    /// Pits on the flanks of a gear.
    Pits(Box<PitGrowth>),
}

impl Growing {
    /// The effect of a specification at its beginning: wear begins at what the setup has, a crack
    /// at the given `depth_mm` or a millimetre, pits at none.
    ///
    /// # Errors
    /// For an effect without a law, a place or constant that does not exist, or gears other than a
    /// pair of external ones.
    pub fn new(
        setup: &SimSetup,
        spec: &EffectSpec,
        given: &BTreeMap<String, f64>,
        seed: u64,
    ) -> Result<Self, GrowthError> {
        let Some(&(_, table)) = GROWING.iter().find(|(id, _)| *id == spec.effect) else {
            effects::find(&spec.effect)?;
            return Err(GrowthError::NoLaw(spec.effect.clone()));
        };
        let (_, values) = effects::resolve(spec, &setup.bench)?;
        let law = Constants::new(table, given)?;
        let (stage, wheel) = match values.place() {
            Place::Stage(stage) => (stage, false),
            Place::Gear { stage, wheel } => (stage, wheel),
            _ => return Err(GrowthError::Unsuitable(format!("{}: growth is known for pairs of gears", spec.place))),
        };
        let gears = &setup.bench.stages[stage];
        let gearing = &gears.gearing;
        if gearing.planetary.is_some() || gearing.internal || !gearing.idlers.is_empty() {
            return Err(GrowthError::Unsuitable(format!(
                "{}: growth is known for pairs of external gears, and not for planets, idlers or internal gears",
                gears.name
            )));
        }
        if gearing.helix.is_some() && spec.effect == "root_crack" {
            return Err(GrowthError::Unsuitable(format!(
                "{}: growth of a crack is known for spur teeth alone: at the root of a helical tooth it begins at one end and its front runs \
                 obliquely, and the model has one depth for all of the width; the effect root_crack simulates a given depth",
                gears.name
            )));
        }
        Ok(match spec.effect.as_str() {
            "tooth_wear" => Self::Wear(Box::new(Wear::new(setup, stage, &law)?)),
            "root_crack" => {
                let tooth = values.get("tooth");
                let teeth = if wheel { gears.wheel.teeth } else { gears.pinion.teeth };
                if tooth.fract() != 0.0 || tooth >= f64::from(teeth) {
                    return Err(values
                        .unsuitable(format!("there is no tooth {tooth}; the gear has 0 to {}", teeth - 1))
                        .into());
                }
                let depth_m = values.given("depth_mm").map_or(FIRST_CRACK_M, |mm| 1e-3 * mm);
                let crack = Crack { depth_m, angle_rad: CRACK_ANGLE_RAD };
                Self::Crack(Box::new(RootCrackGrowth::new(setup, (stage, wheel), (tooth as u32, crack), law)?))
            }
            _ => {
                if values.given("area_fraction").or(values.given("teeth")).is_some() {
                    return Err(values
                        .unsuitable("pits are counted from none; leave area_fraction and teeth out")
                        .into());
                }
                Self::Pits(Box::new(PitGrowth::new(setup, (stage, wheel), 1e-3 * values.get("depth_mm"), law, seed)?))
            }
        })
    }

    /// Goes on for so many hours; how many were left when it came to its end.
    ///
    /// # Errors
    /// For a gear pair that cannot be.
    pub fn advance(&mut self, setup: &SimSetup, duties: &[Duty], hours: f64) -> Result<f64, GrowthError> {
        match self {
            Self::Wear(wear) => wear.advance(&setup.bench, duties, hours),
            Self::Crack(crack) => return crack.advance(setup, duties, hours),
            Self::Pits(pits) => pits.advance(setup, duties, hours),
        }
        Ok(0.0)
    }

    /// Puts it into a setup as it is now.
    pub fn apply(&self, setup: &mut SimSetup) {
        match self {
            Self::Wear(wear) => wear.apply(setup),
            Self::Crack(crack) => crack.apply(setup),
            Self::Pits(pits) => pits.apply(setup),
        }
    }

    /// How large it is, in [`Self::unit`].
    pub fn size(&self) -> f64 {
        match self {
            Self::Wear(wear) => 1e6 * wear.size_m(),
            Self::Crack(crack) => 1e3 * crack.size_m(),
            Self::Pits(pits) => 100.0 * pits.size().0,
        }
    }

    /// What the size is: name of the column, and unit.
    pub fn unit(&self) -> (&'static str, &'static str) {
        match self {
            Self::Wear(_) => ("worn depth", "µm"),
            Self::Crack(_) => ("crack", "mm"),
            Self::Pits(_) => ("pitted", "%"),
        }
    }

    /// Why it grows no further.
    pub fn ended(&self) -> Option<End> {
        match self {
            Self::Crack(crack) => crack.ended(),
            Self::Wear(_) | Self::Pits(_) => None,
        }
    }
}
