//! What some changes say of all hypotheses: one sum each, one softmax over all of them.

use super::calibration::Calibration;
use super::changes::{Change, Tables, log_sum_exp};
use super::paths;
use super::table::{Hypothesis, Moves};

/// Sizes over which a hypothesis is integrated (ln of the largest change), even in their logarithm.
const SMALLEST: f64 = 0.03;
const LARGEST: f64 = 4.0;
const SIZES: usize = 14;
/// The same of a path.
const PATH_SIZES: usize = 6;

/// A hypothesis with what speaks for it.
#[derive(Clone, Debug)]
pub struct Scored {
    /// Position in the table.
    pub at: usize,
    /// Log likelihood (nats).
    pub log_likelihood: f64,
    /// Probability among all.
    pub probability: f64,
    /// Size and repetition of the largest term.
    pub best: (f64, f64),
}

fn sizes(count: usize) -> impl Iterator<Item = f64> {
    (0..count).map(move |k| SMALLEST * (LARGEST / SMALLEST).powf(k as f64 / (count - 1) as f64))
}

/// Log likelihood of one hypothesis, integrated over its size and over how the bench repeats.
fn one(all: &[Change], tables: &Tables, h: &Hypothesis, c: &Calibration) -> (f64, (f64, f64)) {
    let mut terms: Vec<(f64, f64, f64)> = Vec::new();
    for (r, rho) in c.repetition.iter().enumerate() {
        match &h.moves {
            Moves::Nothing => {
                terms.push((tables.log_likelihood(r, 0.0, &vec![0.0; tables.classes.len()], false), 0.0, *rho));
            }
            Moves::Something => terms.push((tables.something(r, c.takes_part), 0.0, *rho)),
            Moves::Machine { spread, rises } => {
                terms.extend(sizes(SIZES).map(|s| (tables.log_likelihood(r, s, spread, *rises), s, *rho)));
            }
            Moves::Paths(channels) => {
                let changed = |k: usize| channels.contains(&k);
                let at = |s: f64| (paths::log_likelihood(all, (&changed, false), *rho, s, c), s, *rho);
                terms.extend(sizes(PATH_SIZES).map(at));
            }
            Moves::Factor(channel) => {
                let changed = |k: usize| k == *channel;
                let at = |s: f64| (paths::log_likelihood(all, (&changed, true), *rho, s, c), s, *rho);
                terms.extend(sizes(PATH_SIZES).map(at));
            }
        }
    }
    let logs: Vec<f64> = terms.iter().map(|t| t.0).collect();
    let best = terms.iter().fold((f64::NEG_INFINITY, 0.0, 0.0), |a, b| if b.0 > a.0 { *b } else { a });
    (log_sum_exp(&logs) - (logs.len() as f64).ln(), (best.1, best.2))
}

/// Scores all hypotheses on some changes; `nats` is what other evidence adds to each. The most probable comes first.
pub fn score(all: &[Change], tables: &Tables, hypotheses: &[Hypothesis], nats: &[f64], c: &Calibration) -> Vec<Scored> {
    // Effects that move the same lines by the same law share their sum.
    let mut known: Vec<(usize, f64, (f64, f64))> = Vec::new();
    let mut out = Vec::with_capacity(hypotheses.len());
    for (at, h) in hypotheses.iter().enumerate() {
        let same = known.iter().find(|k| hypotheses[k.0].moves == h.moves);
        let (log_likelihood, best) = match same {
            Some(k) => (k.1, k.2),
            None => {
                let (l, best) = one(all, tables, h, c);
                known.push((at, l, best));
                (l, best)
            }
        };
        out.push(Scored { at, log_likelihood: log_likelihood + nats[at], probability: 0.0, best });
    }
    normalise(&mut out, hypotheses);
    out
}

/// Probabilities from log likelihoods and priors, the most probable first.
pub fn normalise(all: &mut [Scored], hypotheses: &[Hypothesis]) {
    let logs: Vec<f64> = all.iter().map(|s| s.log_likelihood + hypotheses[s.at].prior).collect();
    let sum = log_sum_exp(&logs);
    all.iter_mut().zip(&logs).for_each(|(s, l)| s.probability = (l - sum).exp());
    all.sort_by(|a, b| b.probability.total_cmp(&a.probability));
}

/// Changes with an effect explained away: its variance is added, a path's change is taken off.
pub fn explained(all: &[Change], tables: &Tables, h: &Hypothesis, best: (f64, f64), c: &Calibration) -> Vec<Change> {
    let (size, rho) = best;
    let mut out = all.to_vec();
    match &h.moves {
        Moves::Nothing | Moves::Something => {}
        Moves::Machine { spread, .. } => {
            for x in &mut out {
                let class = Tables::class(x);
                if let Ok(at) = tables.classes.binary_search(&class) {
                    // The background stays a witness of paths.
                    if x.family.is_some() {
                        x.extra += (size * spread[at].max(c.leak)).powi(2);
                    }
                }
            }
        }
        Moves::Paths(_) | Moves::Factor(_) => {
            let channels = match &h.moves {
                Moves::Paths(all) => all.clone(),
                Moves::Factor(one) => vec![*one],
                _ => Vec::new(),
            };
            for channel in channels {
                let bands = paths::by_band(all, channel, rho, size, c);
                for x in out.iter_mut().filter(|x| x.channel == channel) {
                    let nearest = bands
                        .iter()
                        .min_by(|a, b| (a.0 / x.frequency_hz).ln().abs().total_cmp(&(b.0 / x.frequency_hz).ln().abs()));
                    if let Some((_, change)) = nearest {
                        x.change -= change;
                        x.extra += (c.path_error * change).powi(2);
                    }
                }
            }
        }
    }
    out
}
