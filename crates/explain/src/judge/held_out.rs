//! Whether what was named predicts a recording that took no part in naming it.

use crate::change::locate::{self, Cell, Place};
use crate::judge::report::Fit;
use crate::name::subname;
use crate::name::{Finding, Question};

/// Leave-one-out figures of the comparison: each pair's line changes predicted from the other pairs by the law of what was named.
pub fn held_out(q: &Question<'_>, cells: &[Cell], speeds: &[f64], findings: &[Finding]) -> Option<Fit> {
    if speeds.len() < 2 {
        return None;
    }
    let held = speeds.len() - 1;
    let path = findings.iter().any(|f| subname::is_path(f.effect));
    let machine = findings.iter().any(|f| !subname::is_path(f.effect));
    let masks: Vec<Place> = findings.iter().filter_map(|f| subname::mask_of(q, f)).collect();
    let mut sums = [0.0f64; 4];
    let mut counts = [0usize; 2];
    for cell in cells.iter().filter(|c| c.family.is_some()) {
        let side = usize::from(cell.pair == held);
        let others: Vec<Cell> = cells.iter().filter(|c| c.pair != held && c.pair != cell.pair).copied().collect();
        let same: Vec<&Cell> = others.iter().filter(|c| c.channel == cell.channel && c.family == cell.family).collect();
        let mut predicted = 0.0;
        if machine && masks.iter().any(|m| locate::covers(*m, cell.family)) && !same.is_empty() {
            // Shrunk by how far the other pairs agree.
            let mean = same.iter().map(|c| c.change).sum::<f64>() / same.len() as f64;
            let square = same.iter().map(|c| c.change * c.change).sum::<f64>() / same.len() as f64;
            let noise = same.iter().map(|c| c.variance).sum::<f64>() / same.len() as f64;
            predicted = mean * (mean * mean / square.max(1e-12)) * (square / (square + noise));
        } else if path && let Some((p, v)) = locate::path_prediction(cell, &others, speeds) {
            predicted = p * p * p / (p * p + v).max(1e-12);
            predicted = if predicted.is_finite() { predicted } else { 0.0 };
        }
        sums[side] += (cell.change * cell.change / cell.variance).min(100.0);
        sums[2 + side] += ((cell.change - predicted).powi(2) / cell.variance).min(100.0);
        counts[side] += 1;
    }
    let rms = |sum: f64, n: usize| (sum / n.max(1) as f64).sqrt();
    Some(Fit {
        metric: "root mean square of ln(amplitude in recording / in model) over its standard deviation, all lines; the model before is \
                 the reference, after it is the reference changed as the other recordings tell; 1 or less is repetition"
            .into(),
        train_before: rms(sums[0], counts[0]),
        train_after: rms(sums[2], counts[0]),
        held_out_before: rms(sums[1], counts[1]),
        held_out_after: rms(sums[3], counts[1]),
        noise_floor: 1.0,
        held_out: vec![q.recordings[q.comparison.pairs[held].recording].name.clone()],
    })
}
