//! What makes a stage another one than an external spur pair: helix, internal wheel, idlers, a
//! planetary set; and what cannot be built.
//!
//! Rules, with teeth `z`, normal module `m_n`, helix angle `β` (J. E. Shigley, J. J. Uicker, Theory
//! of Machines and Mechanisms; DIN 3960):
//!
//! ```text
//! one axis        z_ring = z_sun + 2 z_planet                         without profile shift
//! equal spacing   (z_sun + z_ring) / N whole
//! any spacing     ψ_i (z_sun + z_ring) / 360° whole                   for each planet, from the first
//! room            2 a sin(Δψ/2) > d_a = m_n (z_planet / cos β + 2)    a = m_n (z_sun + z_planet) / (2 cos β), neighbours Δψ apart
//! undercut        z ≥ 2 cos β / sin² α_t,  tan α_t = tan α_n / cos β  external gears without profile shift, addendum m_n
//! hands           external pair: opposite; internal pair: the same
//! ```

use serde::{Deserialize, Serialize};

use super::Bench;
use super::stage::{Gear, Stage, StageKind};

/// Most planets of a stage.
pub const MOST_PLANETS: u32 = 24;
/// Most idlers of a stage.
pub const MOST_IDLERS: usize = 8;
/// Teeth by which profile shift may part ring and sun + 2 planet; more would need a working
/// pressure angle that no gear has.
const MOST_SHIFTED_TEETH: u32 = 4;
/// How far, in steps of assembly, a stated position may lie from one in which the planet fits: two
/// decimals of a degree with 250 steps a turn.
const POSITION_REACH: f64 = 0.01;
/// Most meshes that the simulator takes.
pub const MOST_MESHES: usize = 16;
/// What is said of a pair with `profile_shifted = true` and without its coefficients.
const UNKNOWN_SHIFT: &str = "has profile shift that the file does not state (expected profile_shift of both gears, or of one and centre_distance_mm)";
/// Largest helix angle (degrees).
const LARGEST_HELIX_DEG: f64 = 45.0;

/// What makes a stage another one than an external spur pair; the default is one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gearing {
    /// Left out for straight teeth.
    pub helix: Option<Helix>,
    /// The wheel is an internal gear: both shafts turn in the same sense.
    pub internal: bool,
    /// Gears between pinion and wheel, in their order from the pinion.
    pub idlers: Vec<Gear>,
    /// Left out for pairs.
    pub planetary: Option<Planetary>,
    /// The gears have profile shift: undercut and the teeth of the ring are not asked about.
    /// Coefficients stand in the gears, where they are known.
    pub profile_shifted: bool,
    /// Working centre distance of pinion and wheel (mm); what follows from their profile shift
    /// where left out.
    pub centre_distance_mm: Option<f64>,
}

/// Helical teeth.
#[derive(Clone, Debug, PartialEq)]
pub struct Helix {
    /// On the reference cylinder (degrees, above 0 to 45).
    pub angle_deg: f64,
    /// Of pinion and wheel; what is left out follows from the other gear.
    pub hands: [Option<Hand>; 2],
}

/// Hand of a helix.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Hand {
    /// Teeth lean to the left, seen along the axis.
    Left,
    /// Teeth lean to the right.
    Right,
}

impl Hand {
    fn word(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
        }
    }

    fn other(self) -> Self {
        match self {
            Self::Left => Self::Right,
            Self::Right => Self::Left,
        }
    }
}

/// A coaxial member of a planetary stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Member {
    /// The external gear in the middle.
    Sun,
    /// What holds the planets.
    Carrier,
    /// The internal gear around.
    Ring,
}

impl Member {
    /// All members.
    pub const ALL: [Self; 3] = [Self::Sun, Self::Carrier, Self::Ring];

    /// As a file says it.
    pub fn word(self) -> &'static str {
        match self {
            Self::Sun => "sun",
            Self::Carrier => "carrier",
            Self::Ring => "ring",
        }
    }

    /// Which member is fixed, in and out. Usual where left out: the ring stands still, and of the
    /// others the sun or else the ring drives.
    pub(super) fn roles(
        fixed: Option<Self>,
        input: Option<Self>,
        output: Option<Self>,
    ) -> Result<(Self, Self, Self), RolesError> {
        let fixed = fixed.unwrap_or_else(|| {
            let free = |m: &Self| Some(*m) != input && Some(*m) != output;
            [Self::Ring, Self::Carrier, Self::Sun].into_iter().find(free).unwrap_or(Self::Ring)
        });
        let driving = [Self::Sun, Self::Ring, Self::Carrier];
        let input = input.or_else(|| driving.into_iter().find(|m| *m != fixed && Some(*m) != output));
        let output = output
            .or_else(|| [Self::Carrier, Self::Ring, Self::Sun].into_iter().find(|m| *m != fixed && Some(*m) != input));
        match (input, output) {
            (Some(input), Some(output)) if input != output && input != fixed && output != fixed => {
                Ok((fixed, input, output))
            }
            (input, output) => {
                Err(RolesError { fixed, input: input.unwrap_or(fixed), output: output.unwrap_or(fixed) })
            }
        }
    }
}

/// Two members of a planetary stage with one role, or one with none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "fixed = {:?}, in = {:?} and out = {:?}; expected each of \"sun\", \"carrier\" and \"ring\" once",
    fixed.word(),
    input.word(),
    output.word()
)]
pub(super) struct RolesError {
    fixed: Member,
    input: Member,
    output: Member,
}

/// Sun, planets on a carrier, ring. The teeth of sun and ring are those of [`Stage::pinion`] and
/// [`Stage::wheel`].
#[derive(Clone, Debug, PartialEq)]
pub struct Planetary {
    /// Number of planets (1 to [`MOST_PLANETS`]).
    pub planets: u32,
    /// One planet; all are alike.
    pub planet: Gear,
    /// Of each planet on the carrier (degrees, rising); empty for equal spacing.
    pub positions_deg: Vec<f64>,
    /// Stands still.
    pub fixed: Member,
    /// On shaft i.
    pub input: Member,
    /// On shaft i + 1.
    pub output: Member,
}

impl Planetary {
    /// Positions of the planets (turns of the carrier, from the first).
    pub fn positions_turns(&self) -> Vec<f64> {
        if self.positions_deg.is_empty() {
            return (0..self.planets).map(|i| f64::from(i) / f64::from(self.planets)).collect();
        }
        let first = self.positions_deg[0];
        self.positions_deg.iter().map(|position| (position - first) / 360.0).collect()
    }
}

impl Gearing {
    fn helix_rad(&self) -> f64 {
        self.helix.as_ref().map_or(0.0, |helix| helix.angle_deg.to_radians())
    }
}

/// Fewest teeth of an external gear without profile shift that are not undercut.
pub fn fewest_teeth(pressure_angle_deg: f64, helix_angle_deg: f64) -> f64 {
    let helix = helix_angle_deg.to_radians();
    let transverse = (pressure_angle_deg.to_radians().tan() / helix.cos()).atan();
    2.0 * helix.cos() / transverse.sin().powi(2)
}

/// What of a stage cannot be built, one sentence each.
pub fn problems(stage: &Stage) -> Vec<String> {
    let mut out = Vec::new();
    let mut tell = |sentence: String| out.push(format!("stage {:?}: {sentence}", stage.name));
    let gearing = &stage.gearing;
    for (name, gear) in stage.gears() {
        if gear.teeth < 5 {
            tell(format!("{name} has {} teeth; an involute gear has at least 5", gear.teeth));
        }
    }
    if let Some(helix) = &gearing.helix {
        if !(helix.angle_deg > 0.0 && helix.angle_deg <= LARGEST_HELIX_DEG) {
            tell(format!(
                "helix_angle_deg is {}; expected above 0 to {LARGEST_HELIX_DEG} degrees (its sense is the key hand, straight teeth are kind = \"spur\")",
                helix.angle_deg
            ));
            return out;
        }
        if let [Some(pinion), Some(wheel)] = helix.hands {
            // Each idler in between turns the hand once more.
            let opposite = gearing.internal == (gearing.idlers.len() % 2 == 1);
            let right = if opposite { pinion.other() } else { pinion };
            if wheel != right {
                let pair = match (gearing.internal, gearing.idlers.len()) {
                    (false, 0) => "an external helical pair has opposite hands".to_owned(),
                    (true, 0) => "an internal helical pair has the same hand".to_owned(),
                    (_, n) => format!("every external mesh turns the hand, and here are {n} idlers"),
                };
                tell(format!(
                    "hands do not match: pinion {:?}, wheel {:?}; {pair}: wheel.hand = {:?}",
                    pinion.word(),
                    wheel.word(),
                    right.word()
                ));
            }
        }
    }
    if gearing.idlers.len() > MOST_IDLERS {
        tell(format!("there are {} idlers; at most {MOST_IDLERS} are read", gearing.idlers.len()));
    }
    if gearing.internal && stage.wheel.teeth <= stage.pinion.teeth {
        tell(format!(
            "the internal wheel has {} teeth and the pinion {}; the wheel needs more, or the pinion has no room in it",
            stage.wheel.teeth, stage.pinion.teeth
        ));
    }
    if gearing.centre_distance_mm.is_some() && !gearing.idlers.is_empty() {
        tell("centre_distance_mm is that of pinion and wheel in mesh; with idlers between them leave it out".into());
    }
    if let Some(set) = &gearing.planetary {
        planetary(stage, set, &mut tell);
    }
    // Bench files of spur pairs never said whether their gears are shifted: watching asks for tooth
    // numbers alone.
    let usual_angle = (10.0..=35.0).contains(&stage.pressure_angle_deg);
    let sound = usual_angle && stage.module_mm > 0.0 && stage.gears().iter().all(|(_, gear)| gear.teeth >= 5);
    let shift = (sound && stage.is_external_pair()).then(|| stage.pair_shift());
    if let Some(Err(error)) = &shift {
        tell(error.to_string());
    }
    let standard = !stage.is_shifted() && gearing.centre_distance_mm.is_none();
    if stage.kind() != StageKind::Spur && standard && usual_angle {
        let fewest = fewest_teeth(stage.pressure_angle_deg, gearing.helix_rad().to_degrees());
        for (name, gear) in stage.gears() {
            let internal = name == "ring" || (name == "wheel" && gearing.internal);
            if !internal && f64::from(gear.teeth) < fewest.floor() && gear.teeth >= 5 {
                tell(format!(
                    "{name}.teeth is {}: below {fewest:.1} teeth the root is undercut; expected {} or more, or profile_shifted = true where the gears have profile shift",
                    gear.teeth,
                    fewest.floor()
                ));
            }
        }
    }
    out
}

fn planetary(stage: &Stage, set: &Planetary, tell: &mut dyn FnMut(String)) {
    let (sun, planet, ring, n) = (stage.pinion.teeth, set.planet.teeth, stage.wheel.teeth, set.planets);
    if !(1..=MOST_PLANETS).contains(&n) {
        return tell(format!("planet.count is {n}; expected 1 to {MOST_PLANETS}"));
    }
    if [sun, planet, ring].into_iter().any(|teeth| !(5..=super::MOST_TEETH).contains(&teeth)) {
        return;
    }
    let fitting = sun + 2 * planet;
    let apart = fitting.abs_diff(ring);
    if apart > 0 && !stage.is_shifted() {
        tell(format!(
            "ring.teeth is {ring}; sun {sun} and planet {planet} turn about one axis with a ring of {fitting} (sun + 2 planet); gears with profile shift may differ by up to {MOST_SHIFTED_TEETH}: then add profile_shifted = true"
        ));
    } else if apart > MOST_SHIFTED_TEETH {
        tell(format!(
            "ring.teeth is {ring}, {apart} teeth off sun + 2 planet = {fitting}; profile shift makes up for {MOST_SHIFTED_TEETH} at most"
        ));
    }
    let steps = sun + ring;
    if set.positions_deg.is_empty() {
        if !steps.is_multiple_of(n) {
            let fitting: Vec<String> = (2..=12).filter(|n| steps.is_multiple_of(*n)).map(|n| n.to_string()).collect();
            let counts = match fitting.as_slice() {
                [] => String::new(),
                counts => format!(" ({} planets would fit)", counts.join(", ")),
            };
            tell(format!(
                "planet.count is {n}: equally spaced they cannot be assembled, for (sun {sun} + ring {ring}) / {n} = {:.3} is not whole{counts}; or give planet.positions_deg, each a multiple of 360/{steps}",
                f64::from(steps) / f64::from(n)
            ));
        }
    } else {
        if set.positions_deg.len() != n as usize {
            return tell(format!(
                "planet.positions_deg has {} positions and planet.count is {n}; expected one for each planet",
                set.positions_deg.len()
            ));
        }
        let span = set.positions_deg[n as usize - 1] - set.positions_deg[0];
        let rising = set.positions_deg.windows(2).all(|pair| pair[0] < pair[1]);
        if !(rising && span < 360.0) {
            return tell(format!(
                "planet.positions_deg is {:?}; expected rising angles within one turn",
                set.positions_deg
            ));
        }
        for (position, turns) in set.positions_deg.iter().zip(set.positions_turns()) {
            let step = turns * f64::from(steps);
            if (step - step.round()).abs() > POSITION_REACH {
                let degrees = 360.0 / f64::from(steps);
                tell(format!(
                    "planet.positions_deg holds {position}: between the teeth, where the planet cannot be assembled; {:.4} would fit (multiples of 360/{steps} from the first)",
                    set.positions_deg[0] + step.round() * degrees
                ));
            }
        }
    }
    room(stage, set, tell);
}

/// Planets that touch each other.
fn room(stage: &Stage, set: &Planetary, tell: &mut dyn FnMut(String)) {
    if set.planets < 2 {
        return;
    }
    let turns = set.positions_turns();
    let around = turns.iter().skip(1).chain([&1.0]);
    let (nearest, first) =
        turns.iter().zip(around).map(|(a, b)| b - a).zip(1..).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((1.0, 1));
    let cosine = stage.gearing.helix_rad().cos();
    let (sun, planet) = (f64::from(stage.pinion.teeth), f64::from(set.planet.teeth));
    let centres_mm = stage.module_mm * (sun + planet) / cosine * (std::f64::consts::PI * nearest).sin();
    let tips_mm = stage.module_mm * (planet / cosine + 2.0);
    if centres_mm <= tips_mm {
        let fits = (2..=MOST_PLANETS)
            .take_while(|n| {
                stage.module_mm * (sun + planet) / cosine * (std::f64::consts::PI / f64::from(*n)).sin() > tips_mm
            })
            .last();
        let advice = match fits {
            Some(n) => format!("at most {n} equally spaced planets of {planet} teeth have room"),
            None => format!("planets of {planet} teeth have no room beside each other"),
        };
        tell(format!(
            "planets {first} and {} collide: their centres are {centres_mm:.1} mm apart and their tips {tips_mm:.1} mm across; {advice}",
            if first == set.planets { 1 } else { first + 1 }
        ));
    }
}

impl Bench {
    /// Why the simulator cannot serve the bench, if it cannot: it knows spur pairs with idlers and
    /// internal wheels, helical pairs, and planetary stages with straight teeth. It knows profile
    /// shift, centre distances and tip diameters of external pairs alone.
    pub fn beyond_simulator(&self) -> Option<String> {
        let what = |stage: &Stage| {
            let gearing = &stage.gearing;
            let alone = stage.is_external_pair();
            let with = match (&gearing.planetary, gearing.internal) {
                (Some(_), _) => "planets",
                (None, true) => "an internal wheel",
                (None, false) => "idlers",
            };
            if !alone && stage.is_shifted() {
                Some(format!("has profile shift with {with}"))
            } else if !alone && stage.has_own_teeth() {
                Some(format!("states a centre distance or tip diameters with {with}"))
            } else if stage.has_unknown_shift() {
                Some(UNKNOWN_SHIFT.to_owned())
            } else if gearing.helix.is_some() && !alone {
                Some(format!("is helical with {with}"))
            } else {
                None
            }
        };
        let of_stage = |stage: &Stage| what(stage).map(|what| (stage.name.clone(), what));
        if let Some((name, what)) = self.stages.iter().find_map(of_stage) {
            return Some(format!(
                "stage {name:?} {what}; the simulator, and with it simulate, sweep of simulations, signatures and explain, know external pairs with spur and helical teeth, with profile shift where the file states it, and with straight teeth and without profile shift internal wheels, idlers and planets. What such a bench has instead: info, check, run, replay, baseline, diagnose, batch, indicators"
            ));
        }
        let meshes = |stage: &Stage| match &stage.gearing.planetary {
            Some(set) => 2 * set.planets as usize,
            None => 1 + stage.gearing.idlers.len(),
        };
        let count: usize = self.stages.iter().map(meshes).sum();
        (count > MOST_MESHES).then(|| {
            format!(
                "the bench has {count} meshes, two for each planet and one for each idler and pair; the simulator knows {MOST_MESHES} at most"
            )
        })
    }

    /// Why explain and fault signatures cannot serve the bench, if they cannot: they know external
    /// spur and helical pairs, with profile shift where the file states it.
    pub fn beyond_pairs(&self) -> Option<String> {
        let stage = self.stages.iter().find(|stage| !stage.is_external_pair() || stage.has_unknown_shift())?;
        let gearing = &stage.gearing;
        let what = match stage.kind() {
            StageKind::Planetary => "is planetary",
            _ if gearing.internal => "has an internal wheel",
            _ if !gearing.idlers.is_empty() => "has idlers",
            _ => UNKNOWN_SHIFT,
        };
        Some(format!(
            "stage {:?} {what}; signatures and explain know external spur and helical pairs, with profile shift where the file states it. What such a bench has instead: info, check, run, replay, baseline, diagnose, batch, indicators and, where the shift is none or known, simulate, sweep and modes",
            stage.name
        ))
    }
}
