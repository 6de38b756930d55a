//! Ghost components: an undulation of the flanks with a wave number that is no tooth number.
//!
//! `n` waves a turn make a line at order `n` of the gear's shaft; the mesh, which repeats `z` times a turn, mixes it to `n + h z` and `h z − n`. So new lines on a
//! shaft's comb that all leave the remainder `±n` by `z` are one ghost, and `z` says of which gear. Errors of the teeth leave all remainders.
//!
//! Without a reference nothing is new, but errors of the teeth fill the comb of a shaft evenly between two harmonics of the mesh, like Rayleigh amplitudes through a path
//! that neighbours share, and the ghost's own order stands alone above its neighbours.

use crate::name::direct::gears_on;
use crate::name::strange::Strange;
use crate::name::{Finding, Question};
use crate::read::dsp::{mean, median};
use crate::read::scan::StrangeLine;

/// Least excess over the reference (nats) of a new line, on the mean and in every recording; the latter of a line that stands alone.
const NEW: f64 = 3.0;
const EVERYWHERE: f64 = 1.5;
const ALONE: f64 = 4.0;
/// New lines beyond this number are no single ghost's.
const MOST: usize = 40;
/// Share of the new lines that must leave the remainder.
const CONGRUENT: f64 = 0.8;
/// Distance from a multiple of the shaft (orders of the input shaft).
const ON: f64 = 0.02;
/// Sidebands up to this offset belong to usual errors of a gear, which change in themselves.
const LOW: u32 = 6;

/// Neighbours on each side that a multiple is compared with without a reference, and how many must be there.
const BESIDE: usize = 10;
const LEAST_BESIDE: usize = 6;
/// Sidebands about a mesh harmonic that are not compared with.
const FIRST_SIDES: u32 = 3;
/// Waves a turn that are looked for: above what shafts and their low harmonics make, below so many times the number of teeth.
const FEWEST: usize = 13;
const MOST_BY_TEETH: f64 = 2.5;
/// ln amplitude by which the own order must lead all multiples of other remainders, those of its own, and noise at least. Of some 130 benches without a ghost one leads by 2.1, the
/// others by 1.8 at most: a component of the pitch error that stands out does so about every mesh harmonic, a ghost at its own order.
const LEAD: f64 = 2.2;
const LEAD_OF_MIXED: f64 = 1.0;
const CLEAR: f64 = 2.0;
/// Lines nearer than this (bins) to one that another shaft or a mesh makes are left out.
const OWN_BINS: f64 = 3.0;

/// The multiple of a shaft that a line is, if it is one.
fn multiple(line: &StrangeLine, order: f64) -> Option<u32> {
    let n = (line.position / order).round();
    (n >= 1.0 && (n * order - line.position).abs() < ON).then_some(n as u32)
}

/// Remainder by the tooth number, by the nearer side.
fn remainder(n: u32, teeth: u32) -> u32 {
    (n % teeth).min(teeth - n % teeth)
}

/// The ghost that accounts for the new lines, where they are one's.
pub fn ghost(q: &Question<'_>, strange: &Strange) -> Option<Finding> {
    if !strange.against_reference {
        return None;
    }
    let new: Vec<&StrangeLine> = strange.orders.iter().filter(|l| l.excess > NEW && l.least > EVERYWHERE).collect();
    if new.is_empty() || new.len() > MOST {
        return None;
    }
    // The ghost's own line is stronger than what the mesh makes of it.
    let own = new.iter().max_by(|a, b| a.least.total_cmp(&b.least))?;
    let mut fitting: Vec<(String, u32, usize)> = Vec::new();
    for (j, (_, order)) in q.train.shafts.iter().enumerate() {
        let Some(n) = multiple(own, *order) else { continue };
        for gear in gears_on(q, j) {
            let Some(teeth) = teeth_of(q, &gear) else { continue };
            let k = remainder(n, teeth);
            let congruent =
                new.iter().filter(|l| multiple(l, *order).is_some_and(|m| remainder(m, teeth) == k)).count();
            if k >= LOW && congruent as f64 >= CONGRUENT * new.len() as f64 {
                fitting.push((gear, n, congruent));
            }
        }
    }
    // Of two gears whose tooth numbers both fit, the one that accounts for more.
    fitting.sort_by_key(|f| std::cmp::Reverse(f.2));
    let (gear, n, congruent) = fitting.first()?.clone();
    if congruent == 1 && own.least < ALONE {
        return None;
    }
    let rivals: Vec<&(String, u32, usize)> = fitting.iter().skip(1).filter(|f| f.2 == congruent).collect();
    let probability = match (congruent, rivals.len()) {
        (2.., 0) => 0.93,
        (1, 0) => 0.75,
        _ => 0.5,
    };
    let mut f = Finding::new("ghost_component", gear, probability).with("order", f64::from(n), 0.2);
    f.alternatives.extend(rivals.iter().map(|r| ("ghost_component", r.0.clone())));
    f.evidence.place = format!("a new line at order {n} of its shaft, no mesh harmonic and no low sideband");
    f.evidence.support =
        format!("{congruent} of {} new lines leave the same remainder by the number of its teeth", new.len());
    Some(f)
}

/// A multiple of a shaft above its neighbours.
struct Height {
    multiple: usize,
    /// Mean ln amplitude over the middle of its neighbours.
    over: f64,
    /// Least ln amplitude over noise.
    clear: f64,
}

/// Whether a mesh, its low sidebands or any multiple of another shaft lies at a multiple of a shaft.
fn of_train(q: &Question<'_>, shaft: usize, multiple: usize) -> bool {
    let order = multiple as f64 * q.train.shafts[shaft].1;
    q.recordings.iter().any(|r| {
        let reach = OWN_BINS / r.revolutions;
        let on = |other: f64| ((order / other).round() * other - order).abs() < reach;
        if q.train.shafts.iter().enumerate().any(|(j, (_, other))| j != shaft && on(*other)) {
            return true;
        }
        let first = r.lines.partition_point(|l| l.order < order - reach);
        r.lines.get(first).is_some_and(|l| l.order < order + reach)
    })
}

/// Heights of the multiples of a shaft that no listed line falls on, up to the highest that all recordings and sensors show.
fn heights(q: &Question<'_>, shaft: usize, most: usize) -> Vec<Height> {
    let combs = || q.recordings.iter().flat_map(|r| &r.channels).map(|c| &c.combs[shaft]);
    let shown = combs().map(Vec::len).min().unwrap_or(0);
    let turns = q.train.shafts[shaft].1;
    // What stands about a mesh harmonic falls off to both sides of it; its first sidebands are no measure of the lines between.
    let low_side = |m: usize| {
        let order = m as f64 * turns;
        q.train.stages.iter().any(|s| {
            ((order / s.mesh_order).round() * s.mesh_order - order).abs() < (f64::from(FIRST_SIDES) + 0.5) * turns
        })
    };
    let compared: Vec<bool> = (0..=shown).map(|m| m > 1 && !low_side(m)).collect();
    let one = |m: usize| {
        let mut over = Vec::new();
        let mut clear = f64::INFINITY;
        for comb in combs() {
            let level = |m: usize| 0.5 * comb[m - 1].amplitude.norm_sqr().max(comb[m - 1].noise).ln();
            let beside = m.saturating_sub(BESIDE)..=(m + BESIDE).min(shown);
            let mut others: Vec<f64> = beside.filter(|k| *k != m && compared[*k]).map(level).collect();
            if others.len() < LEAST_BESIDE {
                return None;
            }
            over.push(level(m) - median(&mut others));
            clear = clear.min(0.5 * comb[m - 1].ratio().max(f64::MIN_POSITIVE).ln());
        }
        (!over.is_empty()).then(|| Height { multiple: m, over: mean(&over), clear })
    };
    (FEWEST..=most.min(shown)).filter(|m| !of_train(q, shaft, *m)).filter_map(one).collect()
}

/// The multiple of one shaft that leads all others of its comb, where one does.
pub fn lone_ghost(q: &Question<'_>, steps: &mut Vec<String>) -> Option<Finding> {
    let mut best: Option<(f64, Height, Vec<String>)> = None;
    for j in 0..q.train.shafts.len() {
        let gears: Vec<(String, u32)> =
            gears_on(q, j).into_iter().filter_map(|g| teeth_of(q, &g).map(|z| (g, z))).collect();
        let far = |m: usize, z: u32| remainder(m as u32, z) >= LOW;
        let most = gears.iter().map(|g| MOST_BY_TEETH * f64::from(g.1)).fold(0.0, f64::max) as usize;
        let mut all = heights(q, j, most);
        all.retain(|h| gears.iter().all(|g| far(h.multiple, g.1)));
        all.sort_by(|a, b| b.over.total_cmp(&a.over));
        if all.len() <= LEAST_BESIDE {
            continue;
        }
        let own = all.remove(0);
        // What the mesh mixes it to is no other line.
        let rival = |z: u32| {
            let other = |h: &&Height| remainder(h.multiple as u32, z) != remainder(own.multiple as u32, z);
            all.iter().find(other).map_or(f64::NEG_INFINITY, |h| h.over)
        };
        let leads: Vec<(f64, String)> = gears.iter().map(|(g, z)| (own.over - rival(*z), g.clone())).collect();
        let lead = leads.iter().map(|l| l.0).fold(f64::NEG_INFINITY, f64::max);
        let mixed = all.first().map_or(f64::INFINITY, |h| own.over - h.over);
        if own.clear > CLEAR && mixed > LEAD_OF_MIXED && best.as_ref().is_none_or(|b| lead > b.0) {
            best = Some((lead, own, leads.into_iter().filter(|l| l.0 > LEAD).map(|l| l.1).collect()));
        }
    }
    let (lead, own, gears) = best?;
    steps.push(format!(
        "multiple of a shaft between its mesh harmonics that leads most: {}, by {lead:.1} nats, {:.1} above its neighbours",
        own.multiple, own.over
    ));
    let gear = gears.first()?;
    let mut f = Finding::new("ghost_component", gear.clone(), 0.85 / gears.len() as f64).with(
        "order",
        own.multiple as f64,
        0.2,
    );
    f.alternatives.extend(gears[1..].iter().map(|g| ("ghost_component", g.clone())));
    f.evidence.place = format!("a line at order {} of its shaft, no mesh harmonic and no low sideband", own.multiple);
    f.evidence.support = format!(
        "{lead:.1} nats above every other multiple of this shaft between the mesh harmonics, {:.1} above its neighbours",
        own.over
    );
    Some(f)
}

/// Teeth of a gear by its place.
fn teeth_of(q: &Question<'_>, gear: &str) -> Option<u32> {
    let (stage, which) = gear.split_once('.')?;
    let stage = q.bench.stages.iter().find(|s| s.name == stage)?;
    Some(if which == "pinion" { stage.pinion.teeth } else { stage.wheel.teeth })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 34 teeth, 43 waves: 43, 43 + 34 h and 34 h − 43 leave 9 from either side.
    #[test]
    fn analytic_mixed_lines_leave_one_remainder() {
        for n in [43, 77, 111, 145, 59, 25, 229] {
            assert_eq!(remainder(n, 34), 9, "{n}");
        }
        assert_ne!(remainder(44, 34), 9);
    }
}
