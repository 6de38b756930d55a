//! What speaks for a hypothesis beside the size of the changes: phases within a turn, the form of a path over frequency, the simulator's detailed prediction. All in nats.

use super::calibration::Calibration;
use super::changes::Change;
use super::paths;
use super::table::{Hypothesis, Moves};
use crate::change::comb;
use crate::change::locate::Cell;
use crate::change::pulse;
use crate::fit::shape::{self, Ranked};
use crate::name::Question;
use crate::name::path::{self, Form};
use crate::name::strange::Strange;

/// How far the change of each shaft's comb is one pulse a turn (nats; negative where it is none), and in words.
pub fn one_tooth(q: &Question<'_>, c: &Calibration) -> Vec<(f64, String)> {
    (0..q.train.shafts.len())
        .map(|j| {
            let pulse = pulse::pulse(&comb::changes_beyond_gain(q, j));
            let stage = j.min(q.train.stages.len() - 1);
            let change = comb::change(q, stage, j);
            let (middle, scale, most) = c.one_tooth;
            let score = ((pulse.score - PULSE_OF_NOISE) / (PULSE_CLEAR - PULSE_OF_NOISE)).clamp(0.0, 1.0);
            let summed = score * (pulse.share - middle) / scale;
            let lines = change.neighbours as f64 / (LINES * change.aligned.max(1)) as f64;
            let even = lines.min(1.0) * (change.coherence - COHERENT) / scale;
            let nats = summed.max(even).clamp(-most, most);
            let words = format!(
                "comb of {}: {:.2} of its change is one pulse a turn ({:.0} standard deviations of noise), phases of {} neighbouring lines advance evenly by {:.2} of 1: {nats:+.1} nats for one tooth",
                q.train.shafts[j].0, pulse.share, pulse.score, change.neighbours, change.coherence
            );
            (nats, words)
        })
        .collect()
}

/// Score of a pulse that noise comes to at most, and that from which its share counts in full; neighbouring lines of a recording from which their evenness does, and the evenness at which one tooth is as likely as all.
const PULSE_OF_NOISE: f64 = 8.0;
const PULSE_CLEAR: f64 = 12.0;
const LINES: usize = 16;
const COHERENT: f64 = 0.75;

/// What the form over frequency says of each effect on one channel's path.
pub fn path_forms(cells: &[Cell], channel: usize) -> Vec<Form> {
    path::forms(cells, channel)
}

/// Share of the change of all paths that goes one way: a damping that changed moves every resonance alike, a resonance that moved goes both ways.
pub fn one_way(all: &[Change], channels: &[usize], best: (f64, f64), c: &Calibration) -> f64 {
    let (mut sum, mut size) = (0.0, 0.0);
    for &channel in channels {
        for (_, change) in paths::by_band(all, channel, best.1, best.0, c) {
            sum += change * change.abs();
            size += change * change;
        }
    }
    if size > 0.0 { f64::abs(sum) / size } else { 0.0 }
}

/// Log share of each simulated effect in the simulator's detailed prediction; the rest share what is usual.
pub fn shape(q: &Question<'_>, cells: &[Cell]) -> Vec<Ranked> {
    shape::rank(q, cells)
}

/// Speeds that differ by less are one (relative), and lines that are a crowd.
const ONE_SPEED: f64 = 0.03;
const CROWD: usize = 12;
/// A line this near one that a sensor picked up is that one (Hz).
const SAME_HZ: f64 = 1.0;

/// What new lines at fixed frequencies say for something beside the machine (nats).
///
/// At one speed every line is at a fixed frequency, and a crowd of them is what the meshes make together.
pub fn fixed_lines(q: &Question<'_>, strange: &Strange, c: &Calibration) -> f64 {
    let pairs = &q.comparison.pairs;
    let one_speed = pairs.iter().all(|p| (p.speed_hz / pairs[0].speed_hz - 1.0).abs() < ONE_SPEED);
    if one_speed || strange.fixed.len() > CROWD {
        return 0.0;
    }
    let (least, each, most) = c.fixed_lines;
    let own = |hz: f64| strange.picked_up.iter().any(|p| (p.hz.0 - hz).abs() < SAME_HZ);
    let beside = strange.fixed.iter().filter(|l| !own(l.position));
    let sum: f64 = beside.map(|l| (l.excess - least).max(0.0)).sum();
    (each * sum).min(most)
}

/// Whether a hypothesis moves lines by the dynamics or the flanks of a stage, of which the simulator predicts each.
pub fn is_simulated(h: &Hypothesis) -> bool {
    matches!(h.moves, Moves::Machine { .. })
        && matches!(
            h.effect,
            "profile_error"
                | "tip_relief"
                | "tooth_wear"
                | "misalignment"
                | "mesh_stiffness"
                | "load_dependent_stiffness"
                | "damping"
                | "bearing_compliance"
                | "shaft_torsion"
                | "tooth_friction"
        )
}
