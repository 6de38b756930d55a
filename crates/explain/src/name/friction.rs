//! Tooth friction where the sensors see it: across the line of action.
//!
//! The friction force of a pair of teeth is its normal force times a coefficient that turns its
//! sign at the pitch point (PHYSICS 4: sliding friction). Errors of the teeth modulate the normal
//! force once and a few times a turn of *both* gears, and so friction raises the orders of both
//! shafts of its stage, across the line of action, where little else does; the mesh harmonics,
//! which lie along it, move no more than they do. What takes material off the flanks raises such
//! orders too, but moves the mesh harmonics far more; looseness raises the orders of one shaft.

use crate::change::locate::{Cell, Place};
use crate::change::masks;
use crate::finding::Finding;
use crate::question::Question;
use crate::read::lines::Family;

/// A change counts as clear from this many standard deviations.
const CLEAR: f64 = 2.0;
/// Least share of clear changes among the orders of each shaft, and of rises among these.
const SHARE: f64 = 0.3;
const RISES: f64 = 0.85;
/// Least number of orders of each shaft.
const ORDERS: usize = 8;
/// Least median change of the orders of either shaft, of that of the mesh harmonics: 0.7 to 20
/// times on 13 benches with more friction (once 0.2), 0.1 times where tips were relieved; no other
/// of 430 benches raised the orders of both shafts so clearly.
const OVER_MESH: f64 = 0.4;

/// Orders of a shaft in a comparison: how many, share of clear changes, share of rises among these.
fn orders(cells: &[Cell], shaft: usize) -> (usize, f64, f64) {
    let of_shaft = |c: &&Cell| matches!(c.family, Some(Family::Shaft { shaft: s, .. }) if s == shaft);
    let (mut all, mut clear, mut up) = (0usize, 0usize, 0usize);
    for c in cells.iter().filter(of_shaft) {
        all += 1;
        if c.score().abs() > CLEAR {
            clear += 1;
            up += usize::from(c.change > 0.0);
        }
    }
    (all, clear as f64 / all.max(1) as f64, up as f64 / clear.max(1) as f64)
}

/// The stage whose friction changed, where the orders of both its shafts rise and its mesh
/// harmonics move no more.
pub fn friction(q: &Question<'_>, cells: &[Cell]) -> Option<Finding> {
    let clear = |(all, share, up): (usize, f64, f64)| all >= ORDERS && share >= SHARE && up >= RISES;
    let quieter = |i: usize| {
        let of = |j: usize| masks::median_change(cells, Place::ShaftOrders(j));
        of(i).min(of(i + 1))
    };
    let mesh = |i: usize| masks::median_change(cells, Place::Mesh(i));
    let stage = (0..q.train.stages.len())
        .filter(|i| clear(orders(cells, *i)) && clear(orders(cells, i + 1)))
        // Without any mesh harmonic nothing tells friction from worn flanks.
        .filter(|i| mesh(*i) > 0.0 && quieter(*i) > OVER_MESH * mesh(*i))
        .max_by(|a, b| {
            let least = |i: usize| orders(cells, i).1.min(orders(cells, i + 1).1);
            least(*a).total_cmp(&least(*b))
        })?;
    let name = &q.train.stages[stage].name;
    let (first, second) = (orders(cells, stage), orders(cells, stage + 1));
    let mut f = Finding::new("tooth_friction", name.clone(), 0.85);
    f.evidence.support = format!(
        "friction follows the normal force, across the line of action: orders of both shafts of {name} rise ({:.0} and {:.0} % of them clearly), its mesh harmonics change by {:.1} standard deviations",
        100.0 * first.1,
        100.0 * second.1,
        mesh(stage)
    );
    Some(f)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::change::locate::LINE;

    fn cell(family: Family, change: f64) -> Cell {
        Cell { family: Some(family), change, ..LINE }
    }

    #[test]
    fn analytic_shares_of_clear_changes_and_of_rises() {
        let change = |k: u8| {
            if k <= 4 {
                1.0
            } else if k == 5 {
                -1.0
            } else {
                0.05
            }
        };
        let cells: Vec<Cell> = (1..=10).map(|k| cell(Family::Shaft { shaft: 1, multiple: k }, change(k))).collect();
        assert_eq!(orders(&cells, 1), (10, 0.5, 0.8));
        assert_eq!(orders(&cells, 0), (0, 0.0, 0.0));
    }
}
