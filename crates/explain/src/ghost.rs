//! Ghost components: an undulation of the flanks with a wave number that is no tooth number.
//!
//! `n` waves a turn make a line at order `n` of the gear's shaft; the mesh, which repeats `z` times a turn, mixes it to `n + h z` and `h z − n`. So new lines on a
//! shaft's comb that all leave the remainder `±n` by `z` are one ghost, and `z` says of which gear. Errors of the teeth leave all remainders.

use crate::direct::gears_on;
use crate::name::{Finding, Question};
use crate::scan::StrangeLine;
use crate::strange::Strange;

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
