//! From evidence to names: direct findings first (data, teeth, speeds), then sensor paths, then
//! masks of lines, then strange lines.

pub mod against;
pub mod alone;
pub mod bearing;
pub mod direct;
pub mod faint_family;
pub mod family;
pub mod first;
pub mod found;
pub mod friction;
pub mod gear;
pub mod gear_side;
pub mod ghost;
pub mod mates;
pub mod odds;
pub mod own_sensor;
pub mod parting;
pub mod path;
pub mod path_form;
pub mod shared;
pub mod strange;
pub mod subname;
pub mod supports;
pub mod unbalance;
pub mod without_paths;

use gearwatch_core::bench::Bench;

use self::family::Family;
use self::found::Found;
use crate::change::locate::{self, Cell};
use crate::finding::is_path;
use crate::fit::refit;
use crate::judge::free_term;
use crate::judge::held_out;
use crate::judge::latent;
use crate::judge::publish::publish;
use crate::judge::report::{Explanation, Status};
use crate::question::Question;
use crate::read::folded::FoldedLine;

/// Misfit per band of background above which it changed, and the least share of that, on the best
/// channel, which is the same function of frequency at all speeds: of 34 benches with noise of
/// another kind at least 46 %; two unchanged ones of 186 moved by 3.2 and 4.0 per band, of which 11
/// and 21 %.
const BACKGROUND: f64 = 2.5;
const BACKGROUND_SHARE: f64 = 0.33;
/// Half width of what a folded line covers (Hz): it wanders with the speed, and its neighbours'
/// noise is not theirs.
const FOLDED_HZ: f64 = 10.0;

/// Whether a folded line, or the same line at a speed at which it lies in the band, falls on a
/// cell.
fn folded_onto(q: &Question<'_>, l: &FoldedLine, c: &Cell) -> bool {
    let recording = &q.recordings[q.comparison.pairs[c.pair].recording];
    let hz = l.order * recording.input_hz;
    let seen_hz = if hz > 0.5 * recording.sample_rate_hz { recording.sample_rate_hz - hz } else { hz };
    c.family.is_some() && q.comparison.channels[c.channel] == l.channel && (c.frequency_hz - seen_hz).abs() < FOLDED_HZ
}

/// What is compared: all but the lines that are accounted for before.
fn cells(q: &Question<'_>, strange: &strange::Strange, family: Option<&Family>) -> Vec<Cell> {
    let mut cells = locate::cells(q.comparison);
    if let Some(family) = family {
        let falls_on = |c: &Cell| {
            let r = &q.recordings[q.comparison.pairs[c.pair].recording];
            family.falls_on(q.train, c.frequency_hz / r.input_hz, r.revolutions)
        };
        cells.retain(|c| c.family.is_none() || !falls_on(c));
    }
    if let Some(l) = &strange.folded {
        cells.retain(|c| !folded_onto(q, l, c));
    }
    if let Some(s) = &strange.swinging {
        // The angle follows its mean: what changes within a recording stays in these lines.
        cells.retain(|c| !locate::covers(locate::Place::ShaftOrder(s.shaft, s.multiple), c.family));
    }
    cells
}

/// An answer and the sheet as refitted beside the effects, where that was possible.
pub struct Named {
    /// What is published.
    pub explanation: Explanation,
    /// The sheet with the numbers of the joint refit.
    pub bench: Option<Bench>,
}

/// Whether the background changed and no line did.
fn background_alone(q: &Question<'_>, cells: &[Cell], speeds: &[f64], steps: &mut Vec<String>) -> bool {
    let misfit = locate::floor_misfit(cells, None).unwrap_or(0.0);
    let one_speed = speeds.iter().all(|s| (s / speeds[0] - 1.0).abs() < 0.1);
    let channels = 0..q.comparison.channels.len();
    let in_hz = channels.map(|c| locate::floor_account(cells, c, speeds).0).fold(f64::NEG_INFINITY, f64::max);
    let changed = misfit > BACKGROUND && (one_speed || in_hz > BACKGROUND_SHARE);
    if changed {
        steps.push(format!(
            "the background changed ({misfit:.1} per band, below 2 on an unchanged bench) and the lines did not"
        ));
    }
    changed
}

/// Answers.
pub fn answer(
    q: &Question<'_>,
    strange: strange::Strange,
    mut steps: Vec<String>,
    progress: &mut dyn FnMut(&str),
) -> Named {
    let mut findings = direct::findings(q, &mut steps);
    findings.extend(strange.fluctuation.iter().map(|l| strange::fluctuating(q, l)));
    findings.extend(strange.swinging.iter().map(|s| strange::swinging(q, s)));
    let mut unexplained = false;
    let mut nearest = Vec::new();
    let mut fit = None;
    let mut p = None;
    let mut free = None;
    let family = family::family(q, &strange.orders).or_else(|| faint_family::faint_family(q));
    let cells = cells(q, &strange, family.as_ref());
    let mut own = cells.clone();
    let speeds: Vec<f64> = q.comparison.pairs.iter().map(|p| p.speed_hz).collect();
    if let Some(e) = &strange.envelope {
        steps.push(format!("envelope: order {:.3} stands out by {:.1} standard scores", e.order, e.score));
    }
    if !q.comparison.pairs.is_empty() && direct::comparable(q, &findings) {
        progress("what changed against the reference");
        let direct = findings.len();
        findings.extend(ghost::ghost(q, strange.bearing(q).map(|e| e.order), &mut steps));
        let mut found = Found {
            findings: &mut findings,
            unexplained: &mut unexplained,
            nearest: &mut nearest,
            steps: &mut steps,
            cells: &mut own,
        };
        against::search(q, &cells, &speeds, &strange, &mut found);
        p = against::twins_of(q, &cells, &mut steps).map(|t| t.p_null);
        if findings.len() > direct || unexplained {
            progress("recordings that are held out");
            fit = held_out::judge(q, &mut findings, &mut steps);
            progress("laws that no effect has");
            free = free_term::find(q, &own, (&findings[direct..], fit.as_ref(), unexplained), &mut steps);
        }
        if let Some(shown) = &free {
            // A law that predicts what a name does not has taken its place.
            findings.truncate(direct);
            nearest.clear();
            unexplained = true;
            fit = Some(shown.fit.clone());
        }
    }
    if !q.comparison.pairs.is_empty() && direct::slips(&findings) {
        // Speeds that part by the slip move lines on the flanks of resonances; the phases of one
        // damaged tooth stay even.
        let faults = gear::local_faults(q, &cells, &mut steps);
        findings.extend(faults.into_iter().filter(|f| !f.of_shape).map(|f| f.finding));
    }
    if !q.comparison.pairs.is_empty() && findings.is_empty() && !unexplained {
        unexplained = background_alone(q, &cells, &speeds, &mut steps);
    }
    strange::add_strange(q, (&strange, family.as_ref()), &mut findings, &mut unexplained, &mut steps);
    if q.comparison.pairs.is_empty() && !unexplained && findings.iter().all(|f| strange::leaves_shafts(f.effect)) {
        direct::without_reference(q, &mut findings, &mut steps);
    }
    if findings.is_empty() && !unexplained {
        unexplained = strange::has_no_name(q, &strange, &mut steps);
    }
    if !unexplained && findings.iter().all(|f| strange::moves_no_mode(f.effect)) {
        findings.extend(strange::moved_mode(q, &strange, &mut steps));
    }
    if fit.is_none() {
        fit = direct::ratio_fit(q, &findings);
    }
    // With a second effect under it, a path's form is known far worse than its own fit says.
    if findings.len() > 1 {
        for f in findings.iter_mut().filter(|f| is_path(f.effect, &f.place)) {
            f.parameters.values_mut().for_each(|p| p.sigma *= 3.0);
        }
    }
    let known = findings.len();
    findings.retain(|f| !q.without.contains(&f.effect));
    unexplained |= findings.len() < known;
    progress("joint refit");
    let refitted = refit::refit(q, &own, &mut findings);
    if let Some(r) = &refitted {
        steps.extend(r.steps.iter().cloned());
    }
    let latent_force = if unexplained && findings.is_empty() && free.is_none() {
        latent::force(q, &strange, &mut steps)
    } else {
        None
    };
    let (term, bench) = free.map_or((None, refitted.map(|r| r.bench)), |shown| (Some(shown.term), Some(shown.bench)));
    let mut published = publish(q, (findings, nearest), unexplained, &cells, fit, steps);
    if let Some(term) = &term {
        let places = "look at what stands there: the law says how it gives way, not why";
        let points = "record further loads and speeds: they tell laws of one place apart";
        published.advice = vec![format!("{}: {places}", term.place), points.into()];
    }
    if let Some(displaced) = strange.displaced.filter(|_| published.status == Status::Unexplained) {
        let cable = format!("check cable, connector and mounting of {}: no bench moves so far", displaced.channel);
        published.advice.insert(0, cable);
    }
    Named { explanation: Explanation { p_null: p, latent_force, free_term: term, ..published }, bench }
}
