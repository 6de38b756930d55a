//! What changed against the reference: sensor paths first, then one tooth, then masks of lines, one
//! effect after the other.

use gearwatch_core::train::Train;

use crate::change::locate::{self, Cell, Place};
use crate::change::masks::{self, Mask, Once};
use crate::change::one_gear::OneGear;
use crate::finding::{Finding, is_path};
use crate::judge::controls;
use crate::judge::held_out;
use crate::judge::twins::{self, Twins};
use crate::name::alone;
use crate::name::found::{Found, MISFIT, SECOND_SURE};
use crate::name::gear;
use crate::name::ghost;
use crate::name::parting;
use crate::name::strange;
use crate::name::subname;
use crate::name::supports;
use crate::name::unbalance;
use crate::name::without_paths::{WithoutPaths, without_paths};
use crate::question::Question;

/// Chance that an unchanged bench gains as much, by the twins of the case, below which a mask is
/// believed.
const CHANCE: f64 = 1e-3;
/// A simpler mask is preferred to another that gains up to this much more, relatively or in nats.
const SIMPLER: f64 = 0.97;
const NEARLY: f64 = 2.0;
/// A second effect must gain this much, and change its lines this many times more than the others
/// change.
const SECOND_GAIN: f64 = 25.0;
const CONCENTRATED: f64 = 2.0;
/// Beside one damaged tooth, which alters many lines, a mask must gain this much.
const BESIDE_TOOTH: f64 = 60.0;
/// Beside another machine's lines only a change this plain counts as the bench's own.
const FOREIGN_GAIN: f64 = 60.0;
/// A mask is a rival of another from this share of its gain on; so many rivals are asked, and so
/// many names stand in a set; a name this probable has none.
const RIVAL: f64 = 0.85;
const RIVALS: usize = 2;
const LONGEST: usize = 5;
const RIVALLED: f64 = 0.91;
/// Nats by which the comb of one gear must lead its mate's and the mesh harmonics for the gear to
/// be the cause, however much else moves: of 22 drawn gears with pitch errors 16 lead by more, and
/// of 557 drawn benches nothing else but ripples, which have masks of their own, comes beyond 13;
/// another machine's chip came to 15.
const LEADS_MATE: f64 = 20.0;
const LEADS_MESH: f64 = 3.0;
/// Effects that masks may name, one after the other.
const MOST: usize = 2;

/// A mask for the steps.
fn in_words(q: &Question<'_>, m: &Mask) -> String {
    format!(
        "mask: {} gains {:.1} nats; {} lines, scale {:.2} inside, {:.2} outside (repetition: below 0.85)",
        subname::describe(q, m.place),
        m.gain,
        m.cells,
        m.inside,
        m.outside
    )
}

/// Masks of lines that every machine has.
pub fn wide(place: Place) -> bool {
    matches!(place, Place::Mesh(_) | Place::Stage(_) | Place::Dynamics | Place::LowSide(..))
}

/// Names what changed between recordings and reference.
pub fn search(q: &Question<'_>, cells: &[Cell], speeds: &[f64], strange: &strange::Strange, found: &mut Found<'_>) {
    if let Some(clearance) = parting::clearance(q, cells, found.steps) {
        found.findings.push(clearance);
        return;
    }
    let before = found.now();
    let given_up = under_load(q, (cells, speeds), true, strange, found);
    if given_up && !found.since(&before).iter().any(|f| supports::weighs(f.effect)) {
        found.go_back(before);
        found.steps.push("as a whole the lines name no bearing or mesh: the path stays".into());
        under_load(q, (cells, speeds), false, strange, found);
    }
}

/// Names gears of which one tooth changed, which shows in phases before it shows in amplitudes, and
/// takes their lines away; whether there is any.
fn single_teeth(q: &Question<'_>, remaining: &mut Vec<Cell>, found: &mut Found<'_>) -> bool {
    let has_lines = |c: &usize| remaining.iter().any(|x| x.channel == *c && x.family.is_some());
    let changed_paths: Vec<usize> = (0..q.comparison.channels.len()).filter(|c| !has_lines(c)).collect();
    let clear = Question { changed_paths: &changed_paths, ..*q };
    let faults = gear::local_faults(&clear, remaining, found.steps);
    if faults.is_empty() {
        return false;
    }
    // A damaged tooth lights lines everywhere, among them those of a ghost, and with the load.
    found.findings.retain(|f| f.effect != "ghost_component" && !supports::is_of_load(f.effect));
    for gear::OneTooth { stage, shaft, of_shape, finding } in faults {
        remaining.retain(|c| !(locate::covers(Place::Gear(stage, shaft), c.family) && c.family.is_some()));
        if of_shape {
            found.steps.push(format!("one tooth of {}: it has another shape and is as stiff as before", finding.place));
            found.leave_unexplained(vec![finding]);
        } else {
            found.findings.push(finding);
        }
    }
    true
}

/// Names what changed while teeth stay in contact: sensor paths, one tooth, then masks of lines.
/// Returns whether a path was given up for a bearing or a mesh, where it may be.
fn under_load(
    q: &Question<'_>,
    changes: (&[Cell], &[f64]),
    may_give_up: bool,
    strange: &strange::Strange,
    found: &mut Found<'_>,
) -> bool {
    let (places, gaps) = (places(q), gaps(q));
    let WithoutPaths { cells: mut remaining, under_path, given_up, for_machine } =
        without_paths(q, changes, may_give_up, found);
    found.cells.clone_from(&remaining);
    let tooth_found = single_teeth(q, &mut remaining, found);
    let ghost = found.findings.iter().find(|f| f.effect == "ghost_component");
    let ghost_found = ghost.is_some();
    if let Some(ghost) = ghost {
        let hz = |c: &Cell| q.recordings[q.comparison.pairs[c.pair].recording].input_hz;
        remaining.retain(|c| c.family.is_none() || !ghost::explains(q, ghost, c.frequency_hz / hz(c)));
    }
    // One order that leads its row tells a ripple where the sidebands in its mask tell nothing, or
    // pass for a gear's.
    let ripple = if tooth_found || ghost_found { None } else { alone::ripple(q, found.steps) };
    let ripple_place = ripple.as_ref().and_then(|f| subname::mask_of(q, f));
    let before = remaining.clone();
    // What is believed is held against a bench whose lines outside that very mask are as they are.
    let beyond_chance =
        |m: &Mask| twins::twins_beside(&before, &places, &gaps, m).is_some_and(|t| t.chance(m) < CHANCE);
    let mut named: Vec<Mask> = Vec::new();
    for round in 0..MOST {
        let later = round > 0 || under_path || tooth_found || ghost_found;
        let all = if later { masks::masks_beside } else { masks::masks };
        let mut ranked = all(&remaining, &places, &gaps);
        // What was named alters other lines of its shaft a little too.
        ranked.retain(|m| !found.findings.iter().any(|f| echoes(q, f, m.place)));
        ranked.retain(|m| !named.iter().any(|n| follows(q.train, &before, n.place, m.place)));
        let others = if round == 0 { Once::OfTrain } else { Once::OfShaft };
        let alone = masks::once_alone(&remaining, &ranked, &places, others).filter(|_| ripple.is_none());
        let is_believed = |m: &Mask| if later { believed_beside(m, tooth_found) } else { beyond_chance(m) };
        let Some((best, mut chosen, believed)) = leading(q, alone, &ranked, &remaining, &is_believed) else { break };
        let led = chosen.place != best.place;
        found.steps.extend(ranked.iter().take(3).map(|m| in_words(q, m)));
        if alone.is_none() && !believed {
            if round > 0 {
                found.steps.push("stop: no further mask gains enough beside what was named".into());
            }
            // Changes of a few lines each, all over the train: no mask gains by them, and
            // repetition does not make them.
            let whole = ranked.iter().find(|m| m.place == Place::Dynamics);
            match whole.filter(|_| !later && locate::line_misfit(&remaining, None) > MISFIT) {
                Some(whole) => chosen = *whole,
                None => break,
            }
        }
        if strange.foreign_machine() && chosen.gain < FOREIGN_GAIN {
            found
                .steps
                .push("lines of another machine are there; what changed in the gears' own lines is left to it".into());
            *found.unexplained = true;
            break;
        }
        // A strong ripple drags all lines of its shaft along; what gains as much as they do
        // together is then no rival of it.
        let within = if matches!(chosen.place, Place::Gear(..)) || wide(chosen.place) {
            masks::cause_within(&remaining, &chosen, &places)
        } else {
            None
        };
        let by_row = ripple_place.filter(|p| {
            let wider = matches!(chosen.place, Place::Gear(..) | Place::LowSide(..) | Place::ShaftOrders(_));
            chosen.place == *p || (wider && shaft_of(chosen.place) == shaft_of(*p))
        });
        let within = by_row.and_then(|p| ranked.iter().find(|m| m.place == p).copied()).or(within);
        let named_one = match &within {
            Some(cause) if Some(cause.place) == ripple_place => ripple.clone().ok_or_else(Vec::new),
            Some(cause) => subname::name(q, cause, &remaining, found.steps),
            // A comb that leads the train has no rival among the lines that follow it.
            None if led => subname::name(q, &chosen, &remaining, found.steps),
            None => subname::name(q, &chosen, &remaining, found.steps)
                .map(|f| with_rivals(q, f, &chosen, &ranked, &remaining)),
        };
        let chosen = within.unwrap_or(chosen);
        let finding = match named_one {
            Ok(finding) => finding,
            Err(nearest) => {
                found.leave_unexplained(nearest);
                break;
            }
        };
        if found.findings.iter().any(|f| f.effect == finding.effect && f.place == finding.place) {
            break;
        }
        controls::report(q, &remaining, &places, &gaps, &chosen, found.steps);
        let sure = if round > 0 { SECOND_SURE } else { 1.0 };
        found.findings.push(Finding { probability: sure * finding.probability, ..finding });
        named.push(chosen);
        remaining.retain(|c| !(locate::covers(chosen.place, c.family) && c.family.is_some()));
        if !remaining.iter().any(|c| c.family.is_some()) {
            break;
        }
    }
    if let [first, second] = named[..] {
        swap(q, &before, (&places, &gaps), &beyond_chance, (first, second), found);
    }
    beside_teeth(q, found);
    if let (Some(f), Some(place)) = (ripple, ripple_place)
        && !found.findings.iter().any(|x| echoes(q, x, place))
    {
        found.findings.push(f);
    }
    if found.findings.is_empty() && found.nearest.is_empty() && !*found.unexplained {
        // No order was found that they go with.
        let unproved = |f: Finding| Finding { probability: f.probability.min(held_out::UNPROVED), ..f };
        found.nearest.extend(given_up.into_iter().map(unproved));
    }
    for_machine
}

/// Unbalance of a shaft beside errors of the teeth of a gear on it, where none was named yet.
fn beside_teeth(q: &Question<'_>, found: &mut Found<'_>) {
    if found.findings.iter().any(|f| f.effect == "unbalance") {
        return;
    }
    let gear = |f: &Finding| match subname::mask_of(q, f) {
        Some(Place::Gear(stage, shaft)) => Some((stage, shaft)),
        _ => None,
    };
    let mut gears = found.findings.iter().filter_map(gear);
    let unbalance = gears.find_map(|gear| unbalance::beside_teeth(q, gear, found.steps));
    found.findings.extend(unbalance);
}

/// All masks of a bench.
fn places(q: &Question<'_>) -> Vec<Place> {
    locate::places(q.train.stages.len(), q.bench.belt.is_some())
}

/// By how much the speeds of each pair differ (ln).
fn gaps(q: &Question<'_>) -> Vec<f64> {
    q.comparison.pairs.iter().map(|p| p.speed_gap).collect()
}

/// What twins of the case say: how far an unchanged bench misfits its reference as much.
pub fn twins_of(q: &Question<'_>, cells: &[Cell], steps: &mut Vec<String>) -> Option<Twins> {
    let twins = twins::twins(cells, &places(q), &gaps(q))?;
    let [found, usual, most] = twins.standing;
    steps.push(format!(
        "twins: the mask that is furthest beyond chance gains {found:.1} times what it usually gains beyond its median; in drawn comparisons of an unchanged bench with these very lines {usual:.1} in the middle, {most:.1} at most (p {:.2}; by their tail {:.1e})",
        twins.p_null,
        twins.tail()
    ));
    Some(twins)
}

/// Masks that are asked whether chance makes them.
const ASKED: usize = 4;

/// The mask to name: best, chosen, whether it is believed. One that chance makes is passed over,
/// for a wide mask that gains most may say nothing where one line of it says all; where none is
/// believed, the first.
fn leading(
    q: &Question<'_>,
    alone: Option<Mask>,
    ranked: &[Mask],
    cells: &[Cell],
    believed: &dyn Fn(&Mask) -> bool,
) -> Option<(Mask, Mask, bool)> {
    let mut left = ranked.to_vec();
    let mut first = None;
    for _ in 0..ASKED {
        let Some(best) = alone.or_else(|| choose(&left)) else { break };
        let chosen = of_single_teeth(q.train, &best, &left, cells).unwrap_or(best);
        // What gains nothing needs no twins.
        if chosen.gain > 0.0 && believed(&chosen) {
            return Some((best, chosen, true));
        }
        first = first.or(Some((best, chosen, false)));
        left.retain(|m| m.place != best.place);
        if alone.is_some() {
            break;
        }
    }
    first
}

/// Among masks that gain nearly as much as the best, the simplest.
fn choose(ranked: &[Mask]) -> Option<Mask> {
    let best = ranked.first()?;
    let near = (SIMPLER * best.gain).min(best.gain - NEARLY);
    ranked
        .iter()
        .filter(|m| m.gain >= near)
        .min_by(|a, b| simplicity(a.place).cmp(&simplicity(b.place)).then(b.gain.total_cmp(&a.gain)))
        .copied()
}

/// The gear to which a wide mask comes down: large errors of single teeth move every line of the
/// train a little, and those of their own gear most. Either what the gear's mask gains and what
/// says that it is one gear together exceed what the wide mask gains, or the gear's comb plainly
/// leads the train.
fn of_single_teeth(train: &Train, wide_one: &Mask, ranked: &[Mask], cells: &[Cell]) -> Option<Mask> {
    let meshes = (0..train.stages.len()).map(Place::Mesh);
    let gears = (0..train.stages.len()).flat_map(|i| [Place::Gear(i, i), Place::Gear(i, i + 1)]);
    let most = meshes.chain(gears).map(|p| masks::median_change(cells, p)).fold(0.0, f64::max);
    let single = |m: &&Mask| match m.place {
        Place::Gear(stage, shaft) => {
            let one = OneGear::of(train, cells, stage, shaft);
            let leads = masks::median_change(cells, m.place) >= most;
            let plain = leads && one.gain() > LEADS_MATE && one.over_mesh > LEADS_MESH;
            one.gain() > 0.0 && (plain || m.gain + one.gain() > wide_one.gain)
        }
        _ => false,
    };
    if wide(wide_one.place) { ranked.iter().find(single).copied() } else { None }
}

/// Whether a mask is believed beside what was named.
fn believed_beside(m: &Mask, tooth_found: bool) -> bool {
    let enough = if tooth_found { BESIDE_TOOTH } else { SECOND_GAIN };
    m.gain > enough && !wide(m.place) && m.inside > CONCENTRATED * m.outside
}

/// Adds the names of masks that share lines with the chosen one and gain nearly as much: where the
/// lines alone do not say which.
fn with_rivals(q: &Question<'_>, mut f: Finding, chosen: &Mask, ranked: &[Mask], cells: &[Cell]) -> Finding {
    if f.probability > RIVALLED {
        return f;
    }
    let shared = |m: &Mask| {
        let both = |c: &&Cell| {
            c.family.is_some() && locate::covers(m.place, c.family) && locate::covers(chosen.place, c.family)
        };
        2 * cells.iter().filter(both).count() > m.cells.min(chosen.cells)
    };
    let rivals: Vec<&Mask> = ranked
        .iter()
        .filter(|m| m.place != chosen.place && m.gain > RIVAL * chosen.gain && shared(m))
        .take(RIVALS)
        .collect();
    for m in rivals {
        let Some(other) = subname::rival(q, m, cells) else { continue };
        let names = std::iter::once((other.effect, other.place)).chain(other.alternatives.into_iter().take(1));
        for (effect, place) in names {
            let known = (f.effect == effect && f.place == place)
                || f.alternatives.iter().any(|(e, p)| *e == effect && *p == place);
            if !known && f.alternatives.len() < LONGEST {
                f.alternatives.push((effect, place));
            }
        }
    }
    f
}

/// Asks again for the first effect once the second is known: taken one after the other, two effects
/// may pass for a third.
fn swap(
    q: &Question<'_>,
    cells: &[Cell],
    (places, gaps): (&[Place], &[f64]),
    believed: &dyn Fn(&Mask) -> bool,
    (first, second): (Mask, Mask),
    found: &mut Found<'_>,
) {
    let rest: Vec<Cell> =
        cells.iter().filter(|c| !(c.family.is_some() && locate::covers(second.place, c.family))).copied().collect();
    let ranked = masks::masks(&rest, places, gaps);
    let gain = ranked.iter().find(|m| m.place == first.place).map_or(f64::NEG_INFINITY, |m| m.gain);
    let at = found.findings.len() - 2;
    let own = &found.findings[at + 1];
    let other = choose(&ranked.into_iter().filter(|m| !echoes(q, own, m.place)).collect::<Vec<_>>());
    match other.filter(|m| m.place != first.place && m.gain > gain.max(0.0) + NEARLY && believed(m)) {
        Some(m) => {
            found.steps.push(format!(
                "swap: beside the second effect, {} gains {:.0} nats, {} {gain:.0}",
                subname::describe(q, m.place),
                m.gain,
                subname::describe(q, first.place)
            ));
            if let Ok(f) = subname::name(q, &m, &rest, found.steps) {
                found.findings[at] = f;
            }
        }
        None => found
            .steps
            .push(format!("swap: {} stays the best mask beside the second effect", subname::describe(q, first.place))),
    }
}

/// Places by what they would be called, simplest first.
fn simplicity(place: Place) -> u8 {
    match place {
        Place::ShaftLine(..) | Place::ShaftOrder(..) | Place::MotorOrder(_) => 0,
        Place::FirstSide(..) | Place::Mesh(_) => 1,
        Place::ShaftOrders(_) => 2,
        Place::LowSide(..) => 3,
        Place::Gear(..) => 4,
        Place::Stage(_) => 5,
        Place::Dynamics => 6,
    }
}

/// Whether a mask may only show what a finding does besides: other orders of the same shaft, or of
/// the shafts of a pair whose teeth changed, or another order of a ripple's train.
fn echoes(q: &Question<'_>, f: &Finding, place: Place) -> bool {
    let Some(found) = subname::mask_of(q, f).filter(|_| !is_path(f.effect, &f.place)) else { return false };
    let ripple = |p: Place| {
        matches!(p, Place::ShaftOrder(_, k) | Place::ShaftLine(_, k) if k > 1) || matches!(p, Place::MotorOrder(_))
    };
    match (found, shaft_of(found), shaft_of(place)) {
        (_, Some(a), Some(b)) => a == b || (ripple(found) && ripple(place)),
        (Place::Mesh(i) | Place::Stage(i), None, Some(b)) => b == i || b == i + 1,
        _ => false,
    }
}

/// Whether the sidebands of a gear may only follow the mesh harmonics, which the teeth of its mate
/// changed: they do not move further than these.
fn follows(train: &Train, cells: &[Cell], named: Place, place: Place) -> bool {
    match (named, place) {
        (Place::Gear(i, j), Place::Gear(k, mate) | Place::LowSide(k, mate)) if i == k && j != mate => {
            OneGear::of(train, cells, i, mate).over_mesh <= LEADS_MESH
        }
        _ => false,
    }
}

/// The shaft whose revolution a mask stands for.
fn shaft_of(place: Place) -> Option<usize> {
    match place {
        Place::FirstSide(_, j)
        | Place::LowSide(_, j)
        | Place::Gear(_, j)
        | Place::ShaftOrder(j, _)
        | Place::ShaftLine(j, _)
        | Place::ShaftOrders(j) => Some(j),
        // Orders of the motor are those of the first shaft where no belt is between them.
        Place::MotorOrder(_) => Some(0),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use gearwatch_core::train::StageKinematics;

    use super::*;
    use crate::read::lines::Family;

    /// A change (standard deviations of 0.1) as an addition makes it: about its rise of so many, by
    /// up to 4 more or less; of less than 10, either way.
    fn moved(size: f64, k: usize) -> f64 {
        let sign = if k.is_multiple_of(2) { 1.0 } else { -1.0 };
        0.1 * if size < 10.0 { size * sign } else { size + sign * 4.0 }
    }

    /// Mesh harmonics, and sidebands of input and output shaft about them, which change by so many
    /// standard deviations of 0.1.
    fn cells(mesh: f64, input: f64, output: f64) -> Vec<Cell> {
        let of = |family, z: f64, k: usize| Cell {
            pair: 0,
            channel: 0,
            family: Some(family),
            frequency_hz: 500.0,
            change: moved(z, k),
            turn: None,
            variance: 0.01,
            noise: 0.0,
            repetition: 0.01,
            differs: 1.0,
        };
        (1..=8)
            .flat_map(|harmonic| {
                let side = move |shaft, z| {
                    let offsets = [-2, -1, 1, 2].into_iter().enumerate();
                    offsets.map(move |(k, offset)| of(Family::Side { stage: 0, harmonic, shaft, offset }, z, k))
                };
                let mesh = of(Family::Mesh { stage: 0, harmonic }, mesh, usize::from(harmonic));
                std::iter::once(mesh).chain(side(0, input)).chain(side(1, output))
            })
            .collect()
    }

    fn train(pinion: u32, wheel: u32) -> Train {
        let stage = StageKinematics::pair("stage1", pinion, wheel, 1.0);
        let shafts = vec![("input".to_owned(), 1.0), ("output".to_owned(), stage.wheel_order)];
        Train { motor_order: 1.0, shafts, stages: vec![stage], nominal_input_hz: 20.0 }
    }

    /// A comb that moves six times as much as all else leads, also where its mask gains far less
    /// than the wide one, since the rest moves too; its mate's sidebands then follow the mesh
    /// harmonics, which move as much. Of 28 on 98 teeth every second sideband of the pinion is a
    /// multiple of the wheel's revolution, and counts as the wheel's.
    #[test]
    fn analytic_a_comb_that_leads_the_train_is_the_cause() {
        let stage = Mask { place: Place::Stage(0), gain: 1500.0, inside: 6.0, outside: 0.5, cells: 72 };
        let gear = Mask { place: Place::Gear(0, 1), gain: 900.0, inside: 8.0, outside: 0.8, cells: 40 };
        let down = |cells: &[Cell]| of_single_teeth(&train(33, 61), &stage, &[stage, gear], cells).map(|m| m.place);
        // Four operating points: a t distribution gives each line less than a nat.
        let points = |mesh, input, output| -> Vec<Cell> {
            (0..4).flat_map(|pair| cells(mesh, input, output).into_iter().map(move |c| Cell { pair, ..c })).collect()
        };
        let led = points(4.0, 4.0, 24.0);
        assert_eq!(down(&led), Some(Place::Gear(0, 1)));
        assert_eq!(down(&points(4.0, 24.0, 4.0)), None);
        assert!(follows(&train(33, 61), &led, Place::Gear(0, 1), Place::Gear(0, 0)));
        assert!(!follows(&train(33, 61), &led, Place::Gear(0, 0), Place::Gear(0, 1)));
        let shared = OneGear::of(&train(28, 98), &led, 0, 1);
        assert!(shared.over_mate < OneGear::of(&train(33, 61), &led, 0, 1).over_mate);
        let second = Family::Side { stage: 0, harmonic: 1, shaft: 0, offset: 2 };
        assert!(second.is_on_comb(&train(28, 98), 1) && !second.is_on_comb(&train(33, 61), 1));
    }

    /// The teeth of a gear differ from each other where all of its sidebands rise further than the
    /// mesh harmonics move; not where only the first two on either side do, as beside a gear out of
    /// square, nor where those of its mate merely move less than the mesh harmonics do.
    #[test]
    fn analytic_sidebands_near_the_mesh_say_nothing_of_single_teeth() {
        let line =
            |family, z: f64, k: usize| Cell { family: Some(family), change: moved(z, k), ..cells(1.0, 1.0, 1.0)[0] };
        let differ = |near: f64, far: f64, mate: f64| {
            let of = |harmonic| {
                let side = move |shaft: usize, k: i8| Family::Side { stage: 0, harmonic, shaft, offset: k };
                let size = move |shaft: usize, k: i8| match (shaft, k.abs()) {
                    (1, 1 | 2) => near,
                    (1, _) => far,
                    _ => mate,
                };
                let offsets = (-5..=5i8).filter(|k| *k != 0);
                let sides = offsets.flat_map(move |k| [0, 1].map(|shaft| (side(shaft, k), size(shaft, k))));
                std::iter::once((Family::Mesh { stage: 0, harmonic }, 4.0)).chain(sides)
            };
            let all: Vec<Cell> = (1..=8).flat_map(of).enumerate().map(|(k, (family, z))| line(family, z, k)).collect();
            OneGear::teeth_differ(&train(33, 61), &all, 0, 1)
        };
        assert!(differ(24.0, 24.0, 4.0) > 3.0);
        assert!(differ(24.0, 4.0, 4.0) <= 0.0);
        assert!(differ(4.0, 4.0, 0.5) <= 0.0);
    }

    /// Where the sidebands of one gear change and those of its mate do not, a stage's mask comes
    /// down to that gear, also where the mesh harmonics come along; not where both gears' sidebands
    /// follow mesh harmonics that change more, nor from a mask that is narrow.
    #[test]
    fn analytic_a_wide_mask_comes_down_to_the_gear_whose_sidebands_move() {
        let mask = |place| Mask { place, gain: 100.0, inside: 2.0, outside: 0.5, cells: 25 };
        let down = |wide_one: Mask, cells: &[Cell]| {
            let ranked = [wide_one, mask(Place::Gear(0, 1)), mask(Place::Gear(0, 0))];
            of_single_teeth(&train(33, 61), &wide_one, &ranked, cells).map(|m| m.place)
        };
        let stage = mask(Place::Stage(0));
        assert_eq!(down(stage, &cells(1.0, 12.0, 1.0)), Some(Place::Gear(0, 0)));
        assert_eq!(down(stage, &cells(12.0, 12.0, 1.0)), Some(Place::Gear(0, 0)));
        assert_eq!(down(stage, &cells(12.0, 3.0, 3.0)), None);
        assert_eq!(down(mask(Place::FirstSide(0, 0)), &cells(1.0, 12.0, 1.0)), None);
    }
}
