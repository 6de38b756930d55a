//! The library of physics that a nominal model leaves out: one table, one file an effect.
//!
//! An effect says how it changes the simulator, its parameters with range and unit, which lines of
//! the spectrum it moves and how they follow load and speed, and what it is confused with. The
//! simulator switches it on, the mismatch finder takes it as a hypothesis, and a conformance test
//! measures it against its own declaration. To add one: write a file, add a line to [`ALL`],
//! [`PLANETARY`] or [`FURTHER`].

use gearwatch_core::bench::{Bench, EffectSpec};

use crate::setup::SimSetup;
use crate::states::{self, State};

mod entry;
mod place;
pub(crate) mod problem;
pub mod signature;
mod values;

pub use entry::EntryPoint;
pub use place::{Place, PlaceKind};
pub use problem::EffectError;
pub use signature::{Change, Law, Line, Signature, SpeedLaw};
pub use values::{Parameter, Values};

mod aliasing;
mod backlash;
mod bearing_compliance;
mod bearing_defect;
mod belt_joint;
mod belt_slip;
mod body_coupling;
mod carrier_eccentricity;
mod clipping;
mod clock_offset;
mod coupling_misalignment;
mod damping;
mod eccentricity;
mod electrical_pickup;
mod gear;
mod ghost_component;
mod lead_error;
mod load_dependent_stiffness;
mod looseness;
mod mesh_stiffness;
mod micropitting;
mod misalignment;
mod motor_ripple;
mod pitch_error;
mod pitting;
mod planet_bearing;
mod planet_position;
mod profile_error;
mod ring_deformation;
mod root_crack;
mod scaling;
mod scuffing;
mod sensor_mounting;
mod shaft_torsion;
mod speed_fluctuation;
mod structural_resonance;
mod thermal_centre_distance;
mod tip_relief;
mod tooth_breakage;
mod tooth_friction;
mod tooth_wear;
mod torque_ripple;
mod unbalance;
mod wrong_tooth_count;

/// A piece of physics that can be switched on.
pub trait Effect: Sync {
    /// Id of the explanation contract.
    fn id(&self) -> &'static str;
    /// What it does and why benches have it, in one or two sentences.
    fn help(&self) -> &'static str;
    /// The kinds of places where it may sit.
    fn places(&self) -> &'static [PlaceKind];
    /// Where it enters the equations.
    fn entry_point(&self) -> EntryPoint;
    /// Its parameters; one that is left out takes its typical value, except where alternatives
    /// exist.
    fn parameters(&self) -> &'static [Parameter];
    /// Changes the setup.
    ///
    /// # Errors
    /// When the values, each within its range, cannot be together or do not suit this bench.
    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError>;
    /// Which lines it moves on this bench, and how they follow load and speed.
    fn signature(&self, values: &Values, bench: &Bench) -> Signature;
    /// Ids of effects that some recordings cannot tell from it.
    fn confused_with(&self) -> &'static [&'static str];
}

/// All effects, in the order of the contract.
pub const ALL: &[&dyn Effect] = &[
    &profile_error::ProfileError,
    &tip_relief::TipRelief,
    &eccentricity::Eccentricity,
    &pitch_error::PitchError,
    &backlash::Backlash,
    &tooth_friction::ToothFriction,
    &bearing_compliance::BearingCompliance,
    &bearing_defect::BearingDefect,
    &shaft_torsion::ShaftTorsion,
    &structural_resonance::StructuralResonance,
    &sensor_mounting::SensorMounting,
    &belt_slip::BeltSlip,
    &speed_fluctuation::SpeedFluctuation,
    &torque_ripple::TorqueRipple,
    &misalignment::Misalignment,
    &load_dependent_stiffness::LoadDependentStiffness,
    &damping::Damping,
    &mesh_stiffness::MeshStiffness,
    &tooth_wear::ToothWear,
    &looseness::Looseness,
    &electrical_pickup::ElectricalPickup,
    &clock_offset::ClockOffset,
    &clipping::Clipping,
    &aliasing::Aliasing,
    &ghost_component::GhostComponent,
    &tooth_breakage::ToothBreakage,
    &pitting::Pitting,
    &root_crack::RootCrack,
    &unbalance::Unbalance,
    &body_coupling::BodyCoupling,
    &wrong_tooth_count::WrongToothCount,
    &scaling::Scaling,
];

/// Effects of planetary stages, beyond the contract: pairs have no place for them.
pub const PLANETARY: &[&dyn Effect] = &[
    &planet_position::PlanetPosition,
    &carrier_eccentricity::CarrierEccentricity,
    &planet_bearing::PlanetBearing,
    &ring_deformation::RingDeformation,
];

/// Effects beyond the contract of explanations: the simulator has them, and no explanation names
/// them.
pub const FURTHER: &[&dyn Effect] = &[
    &coupling_misalignment::CouplingMisalignment,
    &belt_joint::BeltJoint,
    &motor_ripple::MotorRipple,
    &lead_error::LeadError,
    &thermal_centre_distance::ThermalCentreDistance,
    &scuffing::Scuffing,
    &micropitting::Micropitting,
];

/// All effects that the simulator can switch on.
pub fn every() -> impl Iterator<Item = &'static dyn Effect> + Clone {
    ALL.iter().chain(PLANETARY).chain(FURTHER).copied()
}

/// The effect with an id.
///
/// # Errors
/// When there is none; the message names the nearest id.
pub fn find(id: &str) -> Result<&'static dyn Effect, EffectError> {
    every().find(|effect| effect.id() == id).ok_or_else(|| EffectError::UnknownEffect {
        found: id.to_owned(),
        nearest: values::nearest(id, every().map(|effect| effect.id())).to_owned(),
    })
}

/// Checks a specification against the table and a bench: effect, place, parameters and their
/// ranges.
///
/// # Errors
/// A sentence that says what is wrong and what would be right.
pub fn resolve(spec: &EffectSpec, bench: &Bench) -> Result<(&'static dyn Effect, Values), EffectError> {
    let effect = find(&spec.effect)?;
    let place = Place::parse(&spec.place, effect, bench)?;
    Ok((effect, Values::new(effect, place, &spec.parameters)?))
}

/// Switches an effect on, or one of the rank paper's states by its name ([`states::STATES`]).
///
/// # Errors
/// As [`resolve`], and where the effect does not suit the bench.
pub fn apply(spec: &EffectSpec, setup: &mut SimSetup) -> Result<(), EffectError> {
    if let Some(state) = states::state(&spec.effect) {
        return apply_state(state, spec, setup);
    }
    let (effect, values) = resolve(spec, &setup.bench)?;
    effect.apply(&values, setup)
}

/// Puts one of the rank paper's states on a gear: breakage and pits of one tooth together.
fn apply_state(state: State, spec: &EffectSpec, setup: &mut SimSetup) -> Result<(), EffectError> {
    let gears = Place::all(PlaceKind::Gear, &setup.bench);
    let problem = |problem: String| EffectError::Unsuitable { effect: state.name, problem };
    let Some(&(_, Place::Gear { stage, wheel })) = gears.iter().find(|(name, _)| *name == spec.place) else {
        let known: Vec<&str> = gears.iter().map(|(name, _)| name.as_str()).collect();
        return Err(problem(format!("{:?} is no gear; it sits on one of {}", spec.place, known.join(", "))));
    };
    if let Some(name) = spec.parameters.keys().next() {
        return Err(problem(format!("a state of the rank paper has no parameter {name:?}; its sizes are the paper's")));
    }
    states::damage(setup, stage, wheel, state).map_err(|error| problem(error.to_string()))
}

/// Whether the simulator knows the gears of a bench.
///
/// # Errors
/// A sentence that names the stage and says what is supported.
pub fn supported(bench: &Bench) -> Result<(), EffectError> {
    bench.beyond_simulator().map_or(Ok(()), |why| Err(EffectError::Beyond(why)))
}

/// Whether all stages of a bench are pairs, as signatures and explain need them.
///
/// # Errors
/// A sentence that names the stage and says what is supported.
pub fn pairs_alone(bench: &Bench) -> Result<(), EffectError> {
    bench.beyond_pairs().map_or(Ok(()), |why| Err(EffectError::Beyond(why)))
}

/// The nominal setup of a bench with its own `[[effect]]` tables and further ones applied, in
/// order, then its `[[term]]` tables.
///
/// # Errors
/// As [`apply`].
pub fn setup(bench: &Bench, further: &[EffectSpec]) -> Result<SimSetup, EffectError> {
    supported(bench)?;
    let mut setup = SimSetup::nominal(bench);
    for spec in bench.effects.iter().chain(further) {
        apply(spec, &mut setup)?;
    }
    for term in &bench.terms {
        crate::terms::apply(term, &mut setup)?;
    }
    Ok(setup)
}
