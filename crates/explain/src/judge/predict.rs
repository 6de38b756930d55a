//! What a model of the bench says that the lines of a recording do, at an operating point that took
//! no part in its fit.
//!
//! The model is the simulator's, with the bench's own numbers and the effects as fitted; its steady
//! state is solved with and without the effects. A line that the bench has without them changes as
//! the two amplitudes do: the path of the sensor cancels. To a line that the effects add, such as a
//! sideband beside perfect teeth, comes what the reference shows: [`super::added`] reads from the
//! recordings that were fitted what the path makes of it. A changed path is no machine: it is a
//! function of frequency, the same at every load and speed, and is read from the lines and the
//! background of the recordings that were fitted.

use gearwatch_core::bench::EffectSpec;
use gearwatch_sim::effects;
use gearwatch_sim::setup::SimSetup;
use gearwatch_sim::steady::{SteadyOptions, SteadySolver};
use num_complex::Complex64;
use rayon::prelude::*;

use crate::change::compare::{Comparison, LineChange};
use crate::change::locate::{self, Cell};
use crate::finding::HOUSING;
use crate::finding::is_path;
use crate::fit::refit::{self, Base, Foreseen};
use crate::judge::added::{Added, Gains};
use crate::question::Question;
use crate::read::features::RecordingFeatures;
use crate::read::lines::Family;

/// Width over which a path is alike (standard deviation of ln Hz): half the bandwidth of a mode of
/// 2 % damping. Where no line lies so near, as wide as a background is smooth.
const PATH_WIDTH: f64 = 0.02;
const PATH_WIDE: f64 = 0.15;
/// Least weight of neighbours, in lines, from which the narrow width is taken.
const LEAST_WEIGHT: f64 = 1.0;
/// Added amplitude over that of the reference, in the model, below which a line is not one that the
/// effect adds.
const NOTHING: f64 = 1e-9;

/// An effect at a place, with what is known of its sizes.
#[derive(Clone, Debug, PartialEq)]
pub struct Named {
    /// Effect, place, sizes.
    pub spec: EffectSpec,
}

impl Named {
    /// The same effect with the usual sizes, at the orders where its lines stand.
    pub fn usual(&self) -> Self {
        let mut spec = self.spec.clone();
        spec.parameters.retain(|name, _| name == "order");
        Self { spec }
    }
}

/// What is predicted of a line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Prediction {
    /// ln of the amplitude ratio.
    pub change: f64,
    /// Its variance, where the phase of what an effect adds and the path leave it open.
    pub variance: f64,
}

impl Prediction {
    /// Of a model that leaves nothing open.
    pub fn certain(change: f64) -> Self {
        Self { change, variance: 0.0 }
    }
}

/// What models are fitted to, and the bench as it was without an effect.
pub struct Grounds<'a> {
    q: &'a Question<'a>,
    /// Of all pairs, the recordings of some held out.
    known: Comparison,
    /// Of `known`.
    pub cells: Vec<Cell>,
    /// The bench as the references alone have it, where anything of the machine is asked for.
    base: Option<Base>,
}

impl<'a> Grounds<'a> {
    /// Those of a question, the recordings of some pairs held out, to be asked for some effects.
    pub fn new(q: &'a Question<'a>, held: &[usize], asked: &[Named]) -> Self {
        let known = q.comparison.holding_out(held);
        let cells = locate::cells(&known);
        let mut out = Self { q, known, cells, base: None };
        if asked.iter().any(|n| !is_path(&n.spec.effect, &n.spec.place)) {
            out.base = refit::base(&out.question(), &out.cells);
        }
        out
    }

    /// The question with what is held out marked.
    pub fn question(&self) -> Question<'_> {
        Question { comparison: &self.known, ..*self.q }
    }

    fn is_held_out(&self, pair: usize) -> bool {
        self.known.pairs[pair].held_out
    }
}

/// The bench without and with what was named, as the fitted recordings have it.
struct Machine {
    setups: [SimSetup; 2],
    /// What effects of all teeth do to the mesh lines, over all that their fit leaves open.
    mesh: Vec<Foreseen>,
}

/// Predicts the line changes of a comparison from the bench without and with something, as the
/// pairs that are not held out have it. `None` where there is no steady state.
pub fn of_setups(q: &Question<'_>, setups: [SimSetup; 2]) -> Option<Vec<Prediction>> {
    let states = Machine { setups, mesh: Vec::new() }.states(q)?;
    let law = Law::read(q.comparison, &states);
    Some((0..q.comparison.lines.len()).map(|i| law.change(q.comparison, &states, i)).collect())
}

/// Predicts all line changes, in their order, from the recordings that are not held out. `None`
/// where nothing that is named has a model.
pub fn predict(grounds: &Grounds<'_>, named: &[Named]) -> Option<Vec<Prediction>> {
    let all = &grounds.known;
    let of_path = |channel: usize| {
        let here = |n: &&Named| {
            is_path(&n.spec.effect, &n.spec.place) && [HOUSING, &all.channels[channel]].contains(&&*n.spec.place)
        };
        // A mode of one pedestal reaches the sensors of the others too.
        named.iter().find(here).or_else(|| named.iter().find(|n| n.spec.effect == "structural_resonance"))
    };
    let q = &grounds.question();
    let machine = Machine::fitted(grounds, named);
    let paths = (0..all.channels.len()).any(|c| of_path(c).is_some());
    if machine.is_none() && !paths {
        return None;
    }
    let mut out = vec![Prediction::default(); all.lines.len()];
    if let Some(machine) = machine {
        let usual = || Machine::usual(grounds, named)?.states(q);
        let of_sheet = || Machine::of_sheet(q, named)?.states(q);
        let states = machine.states(q).or_else(usual).or_else(of_sheet)?;
        let law = Law::read(all, &states);
        out.iter_mut().enumerate().for_each(|(i, o)| *o = law.change(all, &states, i));
        for f in &machine.mesh {
            let family = Family::Mesh { stage: f.stage, harmonic: f.harmonic };
            let name = &q.bench.sensors[f.sensor].name;
            let own = |l: &LineChange| l.pair == f.pair && l.family == family && all.channels[l.channel] == *name;
            if let Some(at) = all.lines.iter().position(own) {
                out[at] = Prediction::certain(f.change);
            }
        }
    }
    let of_machine: Vec<f64> = out.iter().map(|p| p.change).collect();
    for (o, line) in out.iter_mut().zip(&all.lines) {
        if let Some(path) = of_path(line.channel) {
            let about_hz = (path.spec.effect != "scaling").then_some(line.frequency_hz);
            o.change += path_change(grounds, &of_machine, line.channel, about_hz);
        }
    }
    Some(out)
}

/// What a path does about a frequency, or to all, beside what the machine does to each line, as the
/// cells of its channel tell.
fn path_change(grounds: &Grounds<'_>, of_machine: &[f64], channel: usize, about_hz: Option<f64>) -> f64 {
    // Lines stand before the background, which has no part of the machine's.
    let of_machine = of_machine.iter().copied().chain(std::iter::repeat(0.0));
    let near = |width: f64| {
        let of = |(c, machine): (&Cell, f64)| {
            let distance = about_hz.map_or(0.0, |hz| (c.frequency_hz / hz).ln() / width);
            let weight = (-0.5 * distance * distance).exp() / (c.variance / locate::REPEAT_SIGMA.powi(2)).max(0.1);
            (weight, weight * (c.change - machine))
        };
        let all = grounds.cells.iter().zip(of_machine.clone());
        let own = all.filter(|(c, _)| c.channel == channel && !grounds.is_held_out(c.pair));
        own.map(of).fold((0.0, 0.0), |s, x| (s.0 + x.0, s.1 + x.1))
    };
    let (weight, sum) = match near(PATH_WIDTH) {
        enough if enough.0 >= LEAST_WEIGHT => enough,
        _ => near(PATH_WIDE),
    };
    if weight > 0.0 { sum / weight } else { 0.0 }
}

/// Amplitudes of each line of a comparison without and with the effects; `None` for sensors that
/// the bench has not.
type States = Vec<Option<[Complex64; 2]>>;

impl Machine {
    fn fitted(grounds: &Grounds<'_>, named: &[Named]) -> Option<Self> {
        let modelled: Vec<&Named> = named.iter().filter(|n| !is_path(&n.spec.effect, &n.spec.place)).collect();
        if modelled.is_empty() {
            return None;
        }
        let (refitted, applied): (Vec<&Named>, Vec<&Named>) =
            modelled.into_iter().partition(|n| refit::has_form(&n.spec.effect));
        let members: Vec<(&str, &str)> = refitted.iter().map(|n| (&*n.spec.effect, &*n.spec.place)).collect();
        let of_base = |base: &Base| refit::model(&grounds.question(), &grounds.cells, base, &members);
        let (mut setups, mesh) = match grounds.base.as_ref().and_then(of_base) {
            Some(model) => (model.setups, model.lines),
            None if members.is_empty() => {
                let plain = refit::sheet::setup(grounds.q.bench)?;
                ([plain.clone(), plain], Vec::new())
            }
            None => return None,
        };
        let mut any = !members.is_empty();
        for n in applied {
            any |= apply(&n.spec, &mut setups[1]);
        }
        any.then_some(Self { setups, mesh })
    }

    /// The same with the usual sizes of effects that add lines, where those of a large one part the
    /// teeth: their pattern is the same, and their size is read from the lines.
    fn usual(grounds: &Grounds<'_>, named: &[Named]) -> Option<Self> {
        let of = |n: &Named| match refit::has_form(&n.spec.effect) {
            true => n.clone(),
            false => n.usual(),
        };
        Self::fitted(grounds, &named.iter().map(of).collect::<Vec<_>>())
    }

    /// Effects that add lines on the bench of the sheet, where the fitted bench has no steady state
    /// with them.
    fn of_sheet(q: &Question<'_>, named: &[Named]) -> Option<Self> {
        if named.iter().any(|n| refit::has_form(&n.spec.effect)) {
            return None;
        }
        let plain = refit::sheet::setup(q.bench)?;
        let mut with = plain.clone();
        let mut any = false;
        for n in named.iter().filter(|n| !is_path(&n.spec.effect, &n.spec.place)) {
            any |= apply(&n.usual().spec, &mut with);
        }
        any.then_some(Self { setups: [plain, with], mesh: Vec::new() })
    }

    /// The states at the points of a comparison; `None` where there is none at one of them.
    fn states(&self, q: &Question<'_>) -> Option<States> {
        let comparison = q.comparison;
        let options = SteadyOptions { samples_per_cycle: 128, tolerance: 1e-4, together: false, parting: true };
        let of_pair = |p: usize| -> Option<Vec<(usize, [Complex64; 2])>> {
            let pair = comparison.pairs[p];
            let lines: Vec<(usize, &LineChange)> =
                comparison.lines.iter().enumerate().filter(|(_, l)| l.pair == p).collect();
            let orders: Vec<f64> = lines.iter().map(|(_, l)| l.order).collect();
            let motor = |r: &RecordingFeatures| r.input_hz * q.train.motor_order;
            let speeds = [motor(&q.references[pair.reference]), motor(&q.recordings[pair.recording])];
            let mut states = Vec::with_capacity(2);
            let mut solver = SteadySolver::new(options);
            for (setup, hz) in self.setups.iter().zip(speeds) {
                states.push(solver.solve(setup, hz, pair.torque_nm, 1, &orders).ok()?.sensors);
            }
            let sensor = |l: &LineChange| q.bench.sensors.iter().position(|s| s.name == comparison.channels[l.channel]);
            let of = |(k, (i, l)): (usize, &(usize, &LineChange))| {
                let s = sensor(l)?;
                Some((*i, [states[0][s][k], states[1][s][k]]))
            };
            Some(lines.iter().enumerate().filter_map(of).collect())
        };
        let solved: Option<Vec<_>> = (0..comparison.pairs.len()).into_par_iter().map(of_pair).collect();
        let mut out: States = vec![None; comparison.lines.len()];
        for (i, state) in solved?.into_iter().flatten() {
            out[i] = Some(state);
        }
        Some(out)
    }
}

/// Puts an effect with its sizes, as far as the library allows them, into a setup; whether that was
/// possible.
fn apply(spec: &EffectSpec, setup: &mut SimSetup) -> bool {
    let Ok(effect) = effects::find(&spec.effect) else { return false };
    let mut spec = spec.clone();
    let range = |name: &str| effect.parameters().iter().find(|p| p.name == name);
    spec.parameters = spec
        .parameters
        .into_iter()
        .filter_map(|(name, value)| range(&name).map(|p| (name.clone(), value.clamp(p.min, p.max))))
        .collect();
    effects::apply(&spec, setup).is_ok()
}

/// Power of the effect's own lines over that of the reference in the model, of a line that the
/// bench would not have; `None` of one that it has.
fn added(line: &LineChange, state: &[Complex64; 2]) -> Option<f64> {
    let own = state[0].norm_sqr();
    let new = (state[1] - state[0]).norm_sqr();
    let adds = !matches!(line.family, Family::Mesh { .. }) && new > own && new > NOTHING * NOTHING;
    adds.then(|| new / line.reference_power.max(line.noise).max(f64::MIN_POSITIVE))
}

/// What the fitted recordings say of the way from the model to the lines.
struct Law {
    /// By channel the gains of the path for lines that the effects add to.
    added: Vec<Option<Gains>>,
    /// Share of the change of its mesh harmonic that a sideband follows.
    follows: f64,
}

impl Law {
    fn read(comparison: &Comparison, states: &States) -> Self {
        let mut lines: Vec<Vec<Added>> = vec![Vec::new(); comparison.channels.len()];
        let (mut product, mut square) = (0.0, 0.0);
        for (i, line) in comparison.lines.iter().enumerate() {
            let Some(state) = states[i].as_ref().filter(|_| !comparison.pairs[line.pair].held_out) else { continue };
            let variance = line.variance + locate::repetition(comparison.pairs[line.pair].speed_gap);
            if let Some(x) = added(line, state) {
                let ln_hz = line.frequency_hz.ln();
                lines[line.channel].push(Added { ln_hz, x, change: line.log_ratio, variance });
            } else if let Some(carrier) = carrier(comparison, line, states) {
                product += carrier * line.log_ratio / variance;
                square += carrier * carrier / variance;
            }
        }
        let follows = if square > 0.0 { (product / square).clamp(0.0, 1.0) } else { 0.0 };
        Self { added: lines.into_iter().map(Gains::read).collect(), follows }
    }

    /// What a line of a comparison does.
    fn change(&self, comparison: &Comparison, states: &States, i: usize) -> Prediction {
        let line = &comparison.lines[i];
        let Some(state) = &states[i] else { return Prediction::default() };
        if let Some(x) = added(line, state) {
            let gains = self.added[line.channel].as_ref();
            return gains.map_or(Prediction::default(), |gains| gains.change(line.frequency_hz.ln(), x, PATH_WIDTH));
        }
        Prediction::certain(match line.family {
            // The model has no errors of teeth for what is above.
            Family::Mesh { harmonic, .. } if harmonic > refit::HARMONICS => 0.0,
            Family::Mesh { .. } => ratio(state),
            _ => self.follows * carrier(comparison, line, states).unwrap_or(0.0),
        })
    }
}

/// ln of the amplitude ratio of two states; 0 where the first has no line.
fn ratio(state: &[Complex64; 2]) -> f64 {
    let [a, b] = state.map(|z| z.norm());
    if a > NOTHING && b > NOTHING { (b / a).ln() } else { 0.0 }
}

/// What the model says of the mesh harmonic that a sideband stands beside.
fn carrier(comparison: &Comparison, line: &LineChange, states: &States) -> Option<f64> {
    let Family::Side { stage, harmonic, .. } = line.family else { return None };
    let own = Family::Mesh { stage, harmonic };
    let at =
        comparison.lines.iter().position(|l| l.pair == line.pair && l.channel == line.channel && l.family == own)?;
    states[at].as_ref().map(ratio)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::explain::Input;
    use crate::judge::left_out::left_out;
    use crate::measure::measure;
    use crate::prove;

    /// Whatever the recording that is held out does, what is predicted of it is the same: of relief
    /// and of a changed path alike. What a recording does that is fitted is not.
    #[test]
    fn analytic_what_is_held_out_has_no_part_in_its_prediction() {
        let case = (0..6).find_map(|k| prove::case(2_026_113_001, k, Some("tip_relief"))).unwrap();
        let (recordings, reference) = (&case.recordings, &case.reference);
        let input = Input { bench: &case.bench, recordings, reference, without: &[] };
        let measured = measure(&input, &mut Vec::new(), &mut |_| {}).unwrap();
        let held = left_out(&measured.comparison);
        let other = (0..measured.comparison.pairs.len()).find(|pair| !held.contains(pair)).unwrap();
        let named =
            [("tip_relief", &*case.bench.stages[0].name), ("sensor_mounting", &*measured.comparison.channels[0])];
        for (effect, place) in named {
            let spec = EffectSpec { effect: effect.into(), place: place.into(), parameters: Default::default() };
            // Amplitudes and phases of the lines, and the background, of some pairs moved.
            let predicted = |moved: &[usize]| {
                let mut comparison = measured.comparison.clone();
                let all = comparison.lines.iter_mut().filter(|l| moved.contains(&l.pair));
                all.for_each(|l| (l.log_ratio, l.turn) = (l.log_ratio + 0.5, l.turn + 1.0));
                let floors = comparison.floors.iter_mut().filter(|f| moved.contains(&f.pair));
                floors.for_each(|f| f.log_ratio += 0.5);
                let q = Question { comparison: &comparison, ..measured.question() };
                let named = [Named { spec: spec.clone() }];
                predict(&Grounds::new(&q, &held, &named), &named).unwrap()
            };
            let plain = predicted(&[]);
            assert!(plain.iter().any(|p| p.change != 0.0), "{effect}");
            assert_eq!(predicted(&held), plain, "{effect}");
            assert_ne!(predicted(&[other]), plain, "{effect}");
        }
    }
}
