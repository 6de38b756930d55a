//! Models of how an experiment's amplitudes come from a simulation's, compared by Akaike's
//! criterion.

use serde::Serialize;

use super::AmplitudeTable;

/// How the experiment may come from the simulation. In formulas `a` is an amplitude, `h` a
/// harmonic, `D` the simulation's signed deviation from its normal state, and capitals with `h` are
/// free constants, one for each harmonic.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Model {
    /// `a_exp = N_h`: the state of the machine does not show.
    NoRelation,
    /// `a_exp = G_h a_sim`: any linear path from gear to sensor, any gain and unit.
    LinearPath,
    /// `a_exp = G_h a_sim^p_h`.
    PowerLaw,
    /// `a_exp = N_h (1 + |D|)`: the experiment knows the simulation's absolute deviation, and not
    /// its sign.
    Rectified,
    /// A linear path after single signs or rows of the simulation are changed ([`Correction`]).
    CorrectedPath,
}

/// How well a model fits the logarithms of the experiment's amplitudes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ModelFit {
    /// The model.
    pub model: Model,
    /// Free constants, the scatter counted as one.
    pub parameters: usize,
    /// Root mean square of what it misses (relative amplitude).
    pub scatter: f64,
    /// `n ln(scatter²) + 2 parameters`, and for corrections what searching for them costs.
    pub aic: f64,
}

/// A change of the simulation's table that makes a linear path fit. A flip turns a deviation `D`
/// into `−D`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Correction {
    /// Every sign.
    FlipAll,
    /// The signs of a harmonic, named by its column.
    FlipHarmonic(String),
    /// The signs of a state.
    FlipState(String),
    /// One sign.
    Flip {
        /// The state.
        state: String,
        /// The harmonic's column.
        harmonic: String,
    },
    /// Two states' rows change places.
    Swap(String, String),
}

/// Difference of Akaike's criterion from which the worse model has "essentially no support" (K. P.
/// Burnham, D. R. Anderson, Model Selection and Multimodel Inference, 2nd ed. 2002, section 2.6).
pub(super) const CLEAR: f64 = 10.0;

/// Printed figures have three to five digits: what is missed by less than 0.01 % is missed by
/// rounding.
const ROUNDING_VARIANCE: f64 = 1e-8;

/// Most corrections that are looked for: a table that needs more is not the same table.
const MOST_CORRECTIONS: usize = 8;

/// Fits all models; the corrections are those of [`Model::CorrectedPath`].
pub(super) fn fit_all(simulation: &AmplitudeTable, experiment: &AmplitudeTable) -> (Vec<ModelFit>, Vec<Correction>) {
    let logs = |table: &AmplitudeTable| -> Vec<Vec<f64>> {
        table.amplitudes.iter().map(|row| row.iter().map(|a| a.ln()).collect()).collect()
    };
    let (sim, exp) = (logs(simulation), logs(experiment));
    let harmonics = simulation.harmonics.len();
    let cells = (sim.len() * harmonics) as f64;
    let fit = |model, constants: usize, sum_of_squares: f64, search: f64| {
        let variance = sum_of_squares / cells;
        let parameters = constants + 1;
        let aic = cells * variance.max(ROUNDING_VARIANCE).ln() + 2.0 * parameters as f64 + search;
        ModelFit { model, parameters, scatter: variance.sqrt(), aic }
    };
    let flat = vec![vec![0.0; harmonics]; sim.len()];
    let rectified: Vec<Vec<f64>> = sim
        .iter()
        .map(|row| row.iter().zip(&sim[0]).map(|(a, n)| ((a - n).exp_m1().abs()).ln_1p()).collect())
        .collect();
    let mut fits = vec![
        fit(Model::NoRelation, harmonics, misfit(&flat, &exp), 0.0),
        fit(Model::LinearPath, harmonics, misfit(&sim, &exp), 0.0),
        fit(Model::PowerLaw, 2 * harmonics, power_misfit(&sim, &exp), 0.0),
        fit(Model::Rectified, harmonics, misfit(&rectified, &exp), 0.0),
    ];
    let mut changed = sim;
    let mut corrections = Vec::new();
    let candidates = Candidate::all(changed.len(), harmonics);
    // Each correction is one parameter, chosen among all candidates: that choice costs ln(number)
    // of likelihood. It must be clearly worth it.
    let price = 2.0 + 2.0 * (candidates.len() as f64).ln();
    while corrections.len() < MOST_CORRECTIONS {
        let now = misfit(&changed, &exp);
        let tried = candidates.iter().map(|candidate| (misfit(&candidate.apply(&changed), &exp), candidate));
        let Some((best, candidate)) = tried.min_by(|a, b| a.0.total_cmp(&b.0)) else { break };
        let variance = |sum: f64| (sum / cells).max(ROUNDING_VARIANCE);
        if cells * (variance(now) / variance(best)).ln() <= price + CLEAR {
            break;
        }
        changed = candidate.apply(&changed);
        corrections.push(candidate.named(simulation));
    }
    if !corrections.is_empty() {
        let search = corrections.len() as f64 * price;
        fits.push(fit(Model::CorrectedPath, harmonics, misfit(&changed, &exp), search));
    }
    (fits, corrections)
}

/// Sum of squares of `exp − sim` after the best constant of each harmonic.
fn misfit(sim: &[Vec<f64>], exp: &[Vec<f64>]) -> f64 {
    let rows = sim.len() as f64;
    let harmonics = sim.first().map_or(0, Vec::len);
    (0..harmonics)
        .map(|h| {
            let difference = || sim.iter().zip(exp).map(move |(s, e)| e[h] - s[h]);
            let mean = difference().sum::<f64>() / rows;
            difference().map(|d| (d - mean).powi(2)).sum::<f64>()
        })
        .sum()
}

/// Sum of squares after the best straight line of each harmonic on logarithmic scales.
fn power_misfit(sim: &[Vec<f64>], exp: &[Vec<f64>]) -> f64 {
    let harmonics = sim.first().map_or(0, Vec::len);
    (0..harmonics)
        .map(|h| {
            let pairs: Vec<(f64, f64)> = sim.iter().zip(exp).map(|(s, e)| (s[h], e[h])).collect();
            let (_, _, xx, yy, xy) = super::moments(&pairs);
            if xx > 0.0 { yy - xy * xy / xx } else { yy }
        })
        .sum()
}

/// A correction by index; states are counted from 1, 0 is the normal one.
#[derive(Clone, Copy)]
enum Candidate {
    All,
    Harmonic(usize),
    State(usize),
    Cell(usize, usize),
    Swap(usize, usize),
}

impl Candidate {
    fn all(states: usize, harmonics: usize) -> Vec<Self> {
        let mut out = vec![Self::All];
        out.extend((0..harmonics).map(Self::Harmonic));
        for state in 1..states {
            out.push(Self::State(state));
            out.extend((0..harmonics).map(|h| Self::Cell(state, h)));
            out.extend((1..state).map(|other| Self::Swap(other, state)));
        }
        out
    }

    fn apply(self, logs: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let mut out = logs.to_vec();
        if let Self::Swap(a, b) = self {
            out.swap(a, b);
            return out;
        }
        for state in 1..logs.len() {
            for harmonic in 0..logs[state].len() {
                let flips = match self {
                    Self::All => true,
                    Self::Harmonic(h) => h == harmonic,
                    Self::State(s) => s == state,
                    Self::Cell(s, h) => s == state && h == harmonic,
                    Self::Swap(..) => false,
                };
                if flips {
                    let deviation = (logs[state][harmonic] - logs[0][harmonic]).exp_m1();
                    // A line twice as strong as normal would be flipped to nothing: it cannot be.
                    let flipped = if deviation < 1.0 { (-deviation).ln_1p() } else { f64::INFINITY };
                    out[state][harmonic] = logs[0][harmonic] + flipped;
                }
            }
        }
        out
    }

    fn named(self, table: &AmplitudeTable) -> Correction {
        let (state, harmonic) = (|s: usize| table.states[s].clone(), |h: usize| table.harmonics[h].clone());
        match self {
            Self::All => Correction::FlipAll,
            Self::Harmonic(h) => Correction::FlipHarmonic(harmonic(h)),
            Self::State(s) => Correction::FlipState(state(s)),
            Self::Cell(s, h) => Correction::Flip { state: state(s), harmonic: harmonic(h) },
            Self::Swap(a, b) => Correction::Swap(state(a), state(b)),
        }
    }
}

impl std::fmt::Display for Correction {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::FlipAll => write!(f, "all deviations have the other sign"),
            Self::FlipHarmonic(harmonic) => write!(f, "all deviations of {harmonic} have the other sign"),
            Self::FlipState(state) => write!(f, "all deviations of state {state} have the other sign"),
            Self::Flip { state, harmonic } => {
                write!(f, "the deviation of state {state} at {harmonic} has the other sign")
            }
            Self::Swap(a, b) => write!(f, "the states {a} and {b} have changed places"),
        }
    }
}
