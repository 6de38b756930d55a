//! Two tables of amplitudes, simulation and experiment: what relates them, and whether anything may
//! be concluded from it.
//!
//! A table has one row for each state of the machine, the first of them the normal one, and one
//! column for each mesh harmonic. Without phases, noise or a second operating point no physics can
//! be named from such tables. What can be told is whether the experiment is the simulation through
//! a linear path, whether some signs or rows contradict that, and whether the experiment is
//! independent of the simulation at all.

use serde::Serialize;
use statrs::distribution::{Binomial, DiscreteCDF};

use gearwatch_core::estimate::Estimate;
use gearwatch_core::rank::RankConfig;

mod finding;
mod models;

pub use finding::Finding;
pub use models::{Correction, Model, ModelFit};

/// Amplitudes by state and harmonic, in one unit. The first state is the normal one.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AmplitudeTable {
    /// Names of the states; the first is the normal state.
    pub states: Vec<String>,
    /// Names of the harmonics' columns.
    pub harmonics: Vec<String>,
    /// By state, then harmonic; above 0.
    pub amplitudes: Vec<Vec<f64>>,
}

/// Why tables cannot be read or compared.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TableError {
    /// Not comma-separated values.
    #[error("{table}: line {line}: {message}")]
    Syntax {
        /// Name of the table.
        table: String,
        /// Counted from 1.
        line: u64,
        /// What was expected and found.
        message: String,
    },
    /// Too small to say anything.
    #[error(
        "{table}: {states} states and {harmonics} harmonics; a comparison needs the normal state, at least three others, \
         and a harmonic"
    )]
    TooSmall {
        /// Name of the table.
        table: String,
        /// Rows found.
        states: usize,
        /// Columns of amplitudes found.
        harmonics: usize,
    },
    /// The two tables are not of the same states and harmonics.
    #[error("the simulation has {what} {simulation}, the experiment {experiment}; both tables need the same ones")]
    Mismatch {
        /// What differs.
        what: &'static str,
        /// In the first table.
        simulation: String,
        /// In the second.
        experiment: String,
    },
}

/// Fewest states with which models can be told apart: a normal one and three others.
const LEAST_STATES: usize = 4;

impl AmplitudeTable {
    /// Reads comma-separated values: a header, then one line per state, the normal state first. A
    /// column named `number` is left out, the column `state` holds the name, all others are
    /// amplitudes. `table` is named in errors.
    ///
    /// # Errors
    /// When a line has another number of columns, an amplitude is not a number above 0, or there
    /// are too few rows.
    pub fn parse(text: &str, table: &str) -> Result<Self, TableError> {
        let syntax = |line: u64, message: String| TableError::Syntax { table: table.to_owned(), line, message };
        let csv_error = |e: csv::Error| syntax(e.position().map_or(1, csv::Position::line), e.to_string());
        let mut reader =
            csv::ReaderBuilder::new().trim(csv::Trim::All).comment(Some(b'#')).from_reader(text.as_bytes());
        let header = reader.headers().map_err(csv_error)?.clone();
        let name = header.iter().position(|h| h.eq_ignore_ascii_case("state"));
        let Some(name) = name else {
            let found: Vec<&str> = header.iter().collect();
            return Err(syntax(1, format!("expected a column \"state\", found {found:?}")));
        };
        let columns: Vec<usize> =
            (0..header.len()).filter(|&c| c != name && !header[c].eq_ignore_ascii_case("number")).collect();
        let mut out = Self {
            states: Vec::new(),
            harmonics: columns.iter().map(|&c| header[c].to_owned()).collect(),
            amplitudes: Vec::new(),
        };
        for record in reader.records() {
            let record = record.map_err(csv_error)?;
            let line = record.position().map_or(0, csv::Position::line);
            let mut row = Vec::with_capacity(columns.len());
            for &column in &columns {
                let value = record[column].parse::<f64>().ok().filter(|v| v.is_finite() && *v > 0.0);
                row.push(value.ok_or_else(|| {
                    let column = &header[column];
                    syntax(line, format!("column {column:?}: expected an amplitude above 0, found {:?}", &record))
                })?);
            }
            if out.states.iter().any(|known| *known == record[name]) {
                return Err(syntax(line, format!("the state {:?} is there twice", &record[name])));
            }
            out.states.push(record[name].to_owned());
            out.amplitudes.push(row);
        }
        if out.states.len() < LEAST_STATES || out.harmonics.is_empty() {
            let (states, harmonics) = (out.states.len(), out.harmonics.len());
            return Err(TableError::TooSmall { table: table.to_owned(), states, harmonics });
        }
        Ok(out)
    }

    /// Signed deviations of all states but the normal one from it (percent): `100 (a − a_n) / a_n`.
    pub fn deviations_percent(&self) -> Vec<Vec<f64>> {
        let Some((normal, others)) = self.amplitudes.split_first() else { return Vec::new() };
        let deviations = |row: &Vec<f64>| row.iter().zip(normal).map(|(a, n)| 100.0 * (a - n) / n).collect();
        others.iter().map(deviations).collect()
    }

    /// The other table's rows in the order of this one's states.
    fn aligned(&self, other: &Self) -> Result<Self, TableError> {
        let mismatch = |what, a: &dyn std::fmt::Debug, b: &dyn std::fmt::Debug| TableError::Mismatch {
            what,
            simulation: format!("{a:?}"),
            experiment: format!("{b:?}"),
        };
        if self.harmonics.len() != other.harmonics.len() {
            return Err(mismatch("the harmonics", &self.harmonics, &other.harmonics));
        }
        let row = |state: &String| other.states.iter().position(|s| s == state).map(|i| other.amplitudes[i].clone());
        let rows: Option<Vec<_>> = self.states.iter().map(row).collect();
        match rows {
            Some(amplitudes) if other.states.len() == self.states.len() && self.states[0] == other.states[0] => {
                Ok(Self { states: self.states.clone(), harmonics: other.harmonics.clone(), amplitudes })
            }
            _ => Err(mismatch("the states (the normal one first)", &self.states, &other.states)),
        }
    }
}

/// A straight line fitted by least squares, with standard errors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct StraightLine {
    /// Ordinate per abscissa.
    pub slope: Estimate,
    /// Ordinate at abscissa 0 (percentage points).
    pub intercept: Estimate,
    /// Share of the ordinate's variance that the line accounts for (0–1).
    pub r_squared: f64,
    /// Standard deviation about the line (percentage points).
    pub scatter: f64,
}

/// What relates the deviations of two tables.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Relation {
    /// Names of the states, the normal one first.
    pub states: Vec<String>,
    /// Signed deviations of the simulation (percent), by state without the normal one, and
    /// harmonic.
    pub simulation_percent: Vec<Vec<f64>>,
    /// Signed deviations of the experiment.
    pub experiment_percent: Vec<Vec<f64>>,
    /// Experiment / simulation in the normal state, by harmonic.
    pub normal_ratio: Vec<f64>,
    /// Deviations compared.
    pub cells: usize,
    /// Deviations above 0 in the simulation.
    pub simulation_positive: usize,
    /// Deviations above 0 in the experiment.
    pub experiment_positive: usize,
    /// Deviations of the same sign in both.
    pub same_sign: usize,
    /// Two-sided probability of that many or that few equal signs by the toss of a coin.
    pub same_sign_p: f64,
    /// Two-sided probability of that many or that few positive signs in the experiment by the toss
    /// of a coin.
    pub experiment_positive_p: f64,
    /// Cells with the same rank by the paper's steps.
    pub same_rank: usize,
    /// Pearson's correlation of the signed deviations.
    pub correlation_signed: f64,
    /// Pearson's correlation of the absolute deviations.
    pub correlation_absolute: f64,
    /// Mean distance of the absolute deviations (percentage points).
    pub absolute_gap: f64,
    /// Experiment's deviation against the simulation's absolute one.
    pub against_absolute: StraightLine,
    /// Experiment's deviation against the simulation's signed one.
    pub against_signed: StraightLine,
    /// The models tried, in the order of [`Model`].
    pub models: Vec<ModelFit>,
    /// What a linear path needs put right before it fits, if anything.
    pub corrections: Vec<Correction>,
    /// What follows.
    pub finding: Finding,
}

/// Relates an experiment to a simulation of the same states and harmonics.
///
/// # Errors
/// When the tables are not of the same states and harmonics, or too small.
pub fn relate(simulation: &AmplitudeTable, experiment: &AmplitudeTable) -> Result<Relation, TableError> {
    for (table, name) in [(simulation, "simulation"), (experiment, "experiment")] {
        if table.states.len() < LEAST_STATES || table.harmonics.is_empty() {
            let (states, harmonics) = (table.states.len(), table.harmonics.len());
            return Err(TableError::TooSmall { table: name.to_owned(), states, harmonics });
        }
    }
    let experiment = simulation.aligned(experiment)?;
    let (sim, exp) = (simulation.deviations_percent(), experiment.deviations_percent());
    let pairs: Vec<(f64, f64)> = sim.iter().flatten().copied().zip(exp.iter().flatten().copied()).collect();
    let absolute: Vec<(f64, f64)> = pairs.iter().map(|(s, e)| (s.abs(), e.abs())).collect();
    let rectified: Vec<(f64, f64)> = pairs.iter().map(|&(s, e)| (s.abs(), e)).collect();
    let count = |test: &dyn Fn(f64, f64) -> bool| pairs.iter().filter(|(s, e)| test(*s, *e)).count();
    let ranks = RankConfig::default();
    let cells = pairs.len();
    let same_sign = count(&|s, e| (s > 0.0) == (e > 0.0));
    let experiment_positive = count(&|_, e| e > 0.0);
    let (fits, corrections) = models::fit_all(simulation, &experiment);
    let finding = Finding::from_models(&fits, &corrections, &pairs);
    Ok(Relation {
        states: simulation.states.clone(),
        normal_ratio: experiment.amplitudes[0].iter().zip(&simulation.amplitudes[0]).map(|(e, s)| e / s).collect(),
        cells,
        simulation_positive: count(&|s, _| s > 0.0),
        experiment_positive,
        same_sign,
        same_sign_p: coin(same_sign, cells),
        experiment_positive_p: coin(experiment_positive, cells),
        same_rank: count(&|s, e| ranks.rank_of(s) == ranks.rank_of(e)),
        correlation_signed: correlation(&pairs),
        correlation_absolute: correlation(&absolute),
        absolute_gap: absolute.iter().map(|(s, e)| (s - e).abs()).sum::<f64>() / cells as f64,
        against_absolute: straight_line(&rectified),
        against_signed: straight_line(&pairs),
        models: fits,
        corrections,
        finding,
        simulation_percent: sim,
        experiment_percent: exp,
    })
}

/// Two-sided binomial probability of a count at least this far from half.
fn coin(heads: usize, tosses: usize) -> f64 {
    let fewer = heads.min(tosses - heads) as u64;
    Binomial::new(0.5, tosses as u64).map_or(f64::NAN, |b| (2.0 * b.cdf(fewer)).min(1.0))
}

fn moments(pairs: &[(f64, f64)]) -> (f64, f64, f64, f64, f64) {
    let n = pairs.len() as f64;
    let (mean_x, mean_y) = (pairs.iter().map(|p| p.0).sum::<f64>() / n, pairs.iter().map(|p| p.1).sum::<f64>() / n);
    let sum = |f: &dyn Fn(f64, f64) -> f64| pairs.iter().map(|p| f(p.0 - mean_x, p.1 - mean_y)).sum::<f64>();
    (mean_x, mean_y, sum(&|x, _| x * x), sum(&|_, y| y * y), sum(&|x, y| x * y))
}

fn correlation(pairs: &[(f64, f64)]) -> f64 {
    let (_, _, xx, yy, xy) = moments(pairs);
    xy / (xx * yy).sqrt()
}

/// Ordinary least squares with the usual standard errors (residual variance with n − 2).
fn straight_line(pairs: &[(f64, f64)]) -> StraightLine {
    let n = pairs.len() as f64;
    let (mean_x, mean_y, xx, yy, xy) = moments(pairs);
    let slope = xy / xx;
    let intercept = mean_y - slope * mean_x;
    let residual: f64 = pairs.iter().map(|(x, y)| (y - intercept - slope * x).powi(2)).sum();
    let variance = residual / (n - 2.0);
    StraightLine {
        slope: Estimate::new(slope, (variance / xx).sqrt()),
        intercept: Estimate::new(intercept, (variance * (1.0 / n + mean_x * mean_x / xx)).sqrt()),
        r_squared: 1.0 - residual / yy,
        scatter: variance.sqrt(),
    }
}

#[cfg(test)]
mod tests;
