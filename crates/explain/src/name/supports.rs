//! Whether what all sensors show as a function of frequency is the support of a shaft, or a mesh.
//!
//! A bearing or a mesh that is softer or damped otherwise changes each line by what it does at the
//! line's own frequency, as a mode of the housing does; but what it does follows from the sheet, to
//! all sensors and stages at once. The simulator predicts it for every shaft's bearings (stiffness,
//! damping, play in the seat) and every stage's meshes. Each prediction is held against a function
//! of frequency of any form, a Gaussian process, which also takes what the prediction leaves: the
//! odds are the ratio of the marginal likelihoods, on average over the sizes.

mod bearings;
mod by_load;
mod friction;
mod meshes;
mod passing;
mod seat;

use gearwatch_core::bench::EffectSpec;
use gearwatch_sim::effects;
use gearwatch_sim::setup::SimSetup;
use num_complex::Complex64;
use rayon::prelude::*;

pub use self::by_load::{by_load, is_of_load};
use self::passing::At;
use crate::change::frequency::{Free, Frequency, Points, log_mean_exp};
use crate::change::locate::Cell;
use crate::finding::Finding;
use crate::fit::refit;
use crate::judge::held_out;
use crate::name::path::{self, IN_SET, SUREST};
use crate::question::Question;
use crate::read::lines::Family;

/// What the bearing of the sheet may be off by (standard deviations), and how likely that is: a
/// normal number by three points (Gauss and Hermite).
const OFF: [(f64, f64); 3] = [(-1.732, 1.0 / 6.0), (0.0, 2.0 / 3.0), (1.732, 1.0 / 6.0)];

/// Modes that are tried: step (ln Hz), below the least half width of a mode, its damping ratio;
/// damping ratios; share in what a sensor reads beside all else, well above the mode.
const MODE_STEP: f64 = 0.008;
const MODE_DAMPING: [f64; 2] = [0.012, 0.022];
const MODE_SHARES: [f64; 11] = [-2.0, -0.6, -0.2, -0.06, -0.02, 0.0, 0.02, 0.06, 0.2, 0.6, 2.0];

/// Least deviation of a factor (ln): three of the factors that are tried.
const LEAST_SPREAD: f64 = 0.25;
/// Supports that the steps tell, and that may stand beside a path.
const SAID: usize = 3;

/// An effect of a shaft's supports or a stage's meshes, and how much likelier it is than a function
/// of frequency of any form.
struct Support {
    effect: &'static str,
    place: String,
    /// Log odds (nats).
    odds: f64,
    /// Geometric mean of the size by its evidence, and the standard deviation of its logarithm.
    size: (f64, f64),
}

/// Weighs a changed path that all sensors have in common against the supports of every shaft and
/// the meshes of every stage, and names the support where that is the likelier; where it is not,
/// those that come near stand beside the path. All names are as
/// likely before: a mode of the housing, another function of frequency, stiffness, damping and play
/// of each shaft's bearings, and each effect of a stage's meshes.
///
/// Returns true where the lines, as a whole, are likely to say what happened: the meshes together
/// are likelier than all else, or stiffness or damping of a support is where other changes go with
/// orders beside the function of frequency (`by_frequency`, where it was asked for), which are its
/// own then.
#[must_use]
pub fn weigh(
    q: &Question<'_>,
    cells: &[Cell],
    by_frequency: Option<&Frequency>,
    finding: &mut Finding,
    steps: &mut Vec<String>,
) -> bool {
    let (Some(free), Some(plain)) = (Free::of_meshes(cells, &Points::of(q)), refit::sheet::setup(q.bench)) else {
        return false;
    };
    let Some(mut supports) = bearings::bearings(q, &plain, &free) else { return false };
    let mut meshes = meshes::meshes(q, &plain, &free);
    let came_or_went = of_a_mode(&free);
    // A structure that is damped otherwise was held against modes that moved by the profiles.
    let damped = if finding.effect == "damping" { path::damping_nats(q, cells) } else { f64::NEG_INFINITY };
    let mode = came_or_went + damped.max(0.0) + (-damped.abs()).exp().ln_1p();
    supports.sort_by(|a, b| b.odds.total_cmp(&a.odds));
    meshes.sort_by(|a, b| b.odds.total_cmp(&a.odds));
    let words: Vec<String> = [&supports, &meshes]
        .into_iter()
        .flat_map(|all| all.iter().take(SAID))
        .map(|s| format!("{} at {} by {:.1} (size {:.2})", s.effect, s.place, s.odds, s.size.0))
        .collect();
    steps.push(format!(
        "beyond a function of frequency of any form, the mesh lines favour modes of the housing by {mode:.1} nats, {}",
        words.join(", ")
    ));
    let most = supports.iter().chain(&meshes).map(|s| s.odds).fold(mode.max(0.0), f64::max);
    let share = |odds: f64| (odds - most).exp();
    let of_meshes: f64 = meshes.iter().map(|s| share(s.odds)).sum();
    let sum = share(0.0) + share(mode) + of_meshes + supports.iter().map(|s| share(s.odds)).sum::<f64>();
    if of_meshes > 0.5 * sum {
        return true;
    }
    let [best, others @ ..] = &supports[..] else { return false };
    let probability = share(best.odds) / sum;
    if probability < 0.5 {
        let of_path = share(0.0) + share(mode);
        let mut near: Vec<&Support> = supports.iter().chain(&meshes).collect();
        near.retain(|s| share(s.odds) > IN_SET * of_path);
        near.sort_by(|a, b| b.odds.total_cmp(&a.odds));
        finding.alternatives.extend(near.into_iter().take(SAID).map(|s| (s.effect, s.place.clone())));
        finding.probability *= of_path / sum;
        return false;
    }
    let mut f = Finding::new(best.effect, best.place.clone(), SUREST * probability);
    // How wide a seat is depends on what drives the shaft across, which is not known.
    let fitted = refit::has_form(best.effect);
    if fitted {
        let (factor, spread) = best.size;
        f = f.with("factor", factor, spread.max(LEAST_SPREAD) * factor);
    }
    f.alternatives.push((finding.effect, finding.place.clone()));
    let near = others.iter().filter(|s| share(s.odds) > IN_SET * share(best.odds));
    f.alternatives.extend(near.map(|s| (s.effect, s.place.clone())));
    f.evidence = finding.evidence.clone();
    f.evidence.shape = format!(
        "what the sheet's bearings and masses make of it agrees with the mesh lines better than a mode of the housing, by {:.1} nats",
        best.odds - mode
    );
    // The odds leave a function of frequency beside the support: what its own model foresees is no
    // part of them. Where the lines go with orders, those that are held out tell of that.
    let mostly_orders = by_frequency.is_some_and(|f| f.alone < 0.0);
    if !mostly_orders && let Some(ahead) = held_out::ahead(q, &f, finding, steps) {
        let odds = ahead + best.odds - log_mean_exp(&[0.0, mode]) - 2f64.ln();
        let sure = (1.0 + (-odds).exp()).recip();
        if sure < 0.5 {
            finding.probability *= 1.0 - sure;
            return false;
        }
        f.probability *= sure;
    }
    *finding = f;
    by_frequency.is_some_and(Frequency::has_orders_beside) && fitted
}

/// What all lines of a comparison do by a finding of a shaft's bearings, as the recordings that are
/// not held out show it: mesh harmonics and sidebands alike. `None` of another finding, or without
/// a model.
pub fn foreseen(q: &Question<'_>, cells: &[Cell], finding: (&str, &str)) -> Option<Vec<f64>> {
    let comparison = q.comparison;
    let fitted: Vec<Cell> = cells.iter().filter(|c| !comparison.pairs[c.pair].held_out).copied().collect();
    let of_mesh = |f: Family| matches!(f, Family::Mesh { .. } | Family::Side { .. });
    let asked = comparison.lines.iter().enumerate().filter(|(_, l)| of_mesh(l.family));
    let (at, lines): (Vec<usize>, Vec<(usize, At)>) =
        asked.map(|(i, l)| (i, (l.channel, (l.pair, stage_of(l.family), l.frequency_hz)))).unzip();
    let mut out = vec![0.0; comparison.lines.len()];
    for (i, change) in at.into_iter().zip(bearings::foreseen(q, &fitted, finding, &lines)?) {
        out[i] = change;
    }
    Some(out)
}

/// Whether an effect is one of a bearing or a mesh that is weighed so.
pub fn weighs(effect: &str) -> bool {
    bearings::EFFECTS.iter().map(|e| e.0).chain(meshes::MESHES.iter().map(|e| e.0)).any(|own| own == effect)
}

/// Log odds (nats) over a function of frequency of any form that the sidebands alone give each
/// effect of a shaft's bearings and a stage's meshes, by effect and place; none where they are too
/// few. Sidebands may as well come of what the model of a sheet has not, which costs their say, so
/// that no effect is refuted by them.
pub fn by_sidebands(q: &Question<'_>, cells: &[Cell]) -> Vec<(&'static str, String, f64)> {
    let (Some(free), Some(plain)) = (Free::of_sidebands(cells, &Points::of(q)), refit::sheet::setup(q.bench)) else {
        return Vec::new();
    };
    let of_bearings = bearings::bearings(q, &plain, &free).unwrap_or_default();
    let all = of_bearings.into_iter().chain(meshes::meshes(q, &plain, &free));
    all.map(|s| (s.effect, s.place, log_mean_exp(&[0.0, s.odds]))).collect()
}

/// Log odds (nats) of an effect over all its sizes, from those of each; with the geometric mean of
/// the size by its evidence and the standard deviation of its logarithm. `None` without a size.
fn odds_of(all: &[(f64, f64)]) -> Option<(f64, (f64, f64))> {
    let most = all.iter().map(|a| a.1).reduce(f64::max)?;
    let sum = |of: &dyn Fn(f64) -> f64| all.iter().map(|a| of(a.0.ln()) * (a.1 - most).exp()).sum::<f64>();
    let weight = sum(&|_| 1.0);
    let mean = sum(&|x| x) / weight;
    let spread = (sum(&|x| (x - mean).powi(2)) / weight).sqrt();
    Some((most + weight.ln(), (mean.exp(), spread)))
}

/// Log odds (nats) of a housing mode that came or went over a function of frequency of any form, on
/// average over frequencies, damping ratios and its share in what each sensor reads.
fn of_a_mode(free: &Free) -> f64 {
    let any = free.log_evidence();
    let lines: Vec<f64> = free.lines().map(|l| l.3).collect();
    let (lowest, highest) = lines.iter().fold((f64::INFINITY, 0.0), |(a, b): (f64, f64), hz| (a.min(*hz), b.max(*hz)));
    let count = ((highest / lowest).ln() / MODE_STEP).ceil().max(1.0) as usize;
    let modes: Vec<(f64, f64)> = (0..=count)
        .map(|k| lowest * (MODE_STEP * k as f64).exp())
        .flat_map(|hz| MODE_DAMPING.map(|ratio| (hz, ratio)))
        .collect();
    let of = |&(hz, ratio): &(f64, f64)| {
        let response = |line: usize, share: f64| {
            let u = lines[line] / hz;
            let mode = Complex64::new(u * u, 0.0) / Complex64::new(1.0 - u * u, 2.0 * ratio * u);
            (Complex64::ONE + mode * share).norm().max(f64::MIN_POSITIVE).ln()
        };
        let came = |line: usize, form: usize| response(line, MODE_SHARES[form]);
        let went = |line: usize, form: usize| -response(line, MODE_SHARES[form]);
        let odds = |predicted: &dyn Fn(usize, usize) -> f64| free.log_evidence_of(MODE_SHARES.len(), predicted) - any;
        [odds(&came), odds(&went)]
    };
    log_mean_exp(&modes.par_iter().flat_map_iter(of).collect::<Vec<_>>())
}

/// A bench with an effect of one number.
fn with(setup: &SimSetup, effect: &str, place: &str, (name, size): (&str, f64)) -> Option<SimSetup> {
    let mut out = setup.clone();
    let parameters = std::iter::once((name.to_owned(), size)).collect();
    effects::apply(&EffectSpec { effect: effect.to_owned(), place: place.to_owned(), parameters }, &mut out).ok()?;
    Some(out)
}

/// Pair, stage and frequency (Hz) of each line.
fn at(free: &Free) -> Vec<At> {
    free.lines().map(|(pair, _, family, hz)| (pair, stage_of(family), hz)).collect()
}

fn stage_of(family: Family) -> usize {
    match family {
        Family::Mesh { stage, .. } | Family::Side { stage, .. } => stage,
        Family::Shaft { .. } | Family::Motor { .. } => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::change::locate;
    use crate::explain::Input;
    use crate::measure::{Measured, measure};
    use crate::prove;

    pub fn measured(case: &prove::Case) -> Measured {
        let input =
            Input { bench: &case.bench, recordings: &case.recordings, reference: &case.reference, without: &[] };
        measure(&input, &mut Vec::new(), &mut |_| {}).unwrap()
    }

    /// The lines of the first stage, none of which changed.
    pub fn still(q: &Question<'_>) -> Vec<Cell> {
        let of_stage = |c: &Cell| c.family.is_some_and(|f| stage_of(f) == 0);
        locate::cells(q.comparison).into_iter().filter(of_stage).map(|c| Cell { change: 0.0, ..c }).collect()
    }

    /// Puts changes in the place of those of the lines that are asked for, and leaves the others
    /// out.
    pub fn put(cells: &mut Vec<Cell>, lines: &[At], change: &dyn Fn(usize) -> f64) {
        cells.retain_mut(|c| {
            let same = |l: &At| l.0 == c.pair && (l.2 / c.frequency_hz - 1.0).abs() < 1e-9;
            lines.iter().position(same).map(|line| c.change = change(line)).is_some()
        });
    }
}
