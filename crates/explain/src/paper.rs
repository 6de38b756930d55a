//! The paper's tables, recomputed: "The Absolute Deviation Rank Diagnostic Approach to Gear Tooth
//! Composite Fault".
//!
//! Tables 2 (simulated amplitudes) and 5 (measured amplitudes) are the data; tables 3 (deviations),
//! 4 and 6 (ranks) follow from them and are set beside what was printed.

use gearwatch_core::rank::RankConfig;
use gearwatch_core::verdict::Rank;
use serde::Serialize;

use crate::tables::{AmplitudeTable, Relation, TableError, relate};

/// A printed deviation may differ by this from the recomputed one (percentage points): one unit of
/// its last digit.
const PRINTED_TOLERANCE: f64 = 0.01;

/// The data and what was printed of it.
#[derive(Clone, Debug)]
pub struct Tables {
    /// Table 2.
    pub simulation: AmplitudeTable,
    /// Table 5.
    pub experiment: AmplitudeTable,
}

/// Tables 2 and 5 as printed.
///
/// # Errors
/// None that a user could cause: they are part of the program.
pub fn tables() -> Result<Tables, TableError> {
    Ok(Tables {
        simulation: AmplitudeTable::parse(include_str!("paper_tables/table2_simulation.csv"), "table 2")?,
        experiment: AmplitudeTable::parse(include_str!("paper_tables/table5_experiment.csv"), "table 5")?,
    })
}

/// A cell of a recomputed table beside its print.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Cell {
    /// As it follows from the amplitudes.
    pub recomputed: String,
    /// As printed.
    pub printed: String,
    /// They differ.
    pub differs: bool,
    /// Signed deviation behind it (percent).
    pub deviation_percent: f64,
}

/// A recomputed table.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Recomputed {
    /// Number in the paper.
    pub number: u8,
    /// What it shows.
    pub title: &'static str,
    /// States, the normal one first, with their cells of 1x to 5x.
    pub rows: Vec<(String, Vec<Cell>)>,
}

impl Recomputed {
    /// Cells that differ from the print: state, harmonic counted from 1, cell.
    pub fn misprints(&self) -> impl Iterator<Item = (&str, usize, &Cell)> {
        self.rows.iter().flat_map(|(state, cells)| {
            cells.iter().enumerate().filter(|(_, c)| c.differs).map(|(h, c)| (state.as_str(), h + 1, c))
        })
    }
}

/// Everything that the paper's tables say.
#[derive(Clone, Debug, Serialize)]
pub struct Paper {
    /// Tables 3, 4 and 6.
    pub recomputed: Vec<Recomputed>,
    /// Table 5 against table 2.
    pub relation: Relation,
}

/// Recomputes tables 3, 4 and 6 and relates table 5 to table 2.
///
/// # Errors
/// As [`tables`].
pub fn recompute() -> Result<Paper, TableError> {
    let Tables { simulation, experiment } = tables()?;
    let ranks = RankConfig::default();
    let deviation_text = |d: f64| format!("{:.2}", d.abs());
    let close = |d: f64, printed: &str| {
        printed.parse::<f64>().is_ok_and(|p| (p - d.abs()).abs() <= PRINTED_TOLERANCE * (1.0 + 1e-9))
    };
    let rank_text = |d: f64| ranks.rank_of(d).code().to_owned();
    let same_rank = |d: f64, printed: &str| ranks.rank_of(d).code() == printed;
    let recomputed = vec![
        beside_print(
            3,
            "absolute deviations of the simulation (%)",
            &simulation,
            include_str!("paper_tables/table3_deviation_percent_as_printed.csv"),
            &deviation_text,
            &close,
        )?,
        beside_print(
            4,
            "ranks of the simulation",
            &simulation,
            include_str!("paper_tables/table4_rank_as_printed.csv"),
            &rank_text,
            &same_rank,
        )?,
        beside_print(
            6,
            "ranks of the experiment",
            &experiment,
            include_str!("paper_tables/table6_rank_as_printed.csv"),
            &rank_text,
            &same_rank,
        )?,
    ];
    Ok(Paper { recomputed, relation: relate(&simulation, &experiment)? })
}

fn beside_print(
    number: u8,
    title: &'static str,
    table: &AmplitudeTable,
    printed: &str,
    text: &dyn Fn(f64) -> String,
    agrees: &dyn Fn(f64, &str) -> bool,
) -> Result<Recomputed, TableError> {
    let mut reader = csv::Reader::from_reader(printed.as_bytes());
    let mut rows = Vec::new();
    let normal = vec![0.0; table.harmonics.len()];
    let deviations = std::iter::once(normal).chain(table.deviations_percent());
    for ((state, deviations), record) in table.states.iter().zip(deviations).zip(reader.records()) {
        let record = record.map_err(|e| TableError::Syntax {
            table: format!("table {number}"),
            line: e.position().map_or(0, csv::Position::line),
            message: e.to_string(),
        })?;
        let cells = deviations.iter().zip(record.iter().skip(2)).map(|(&d, printed)| Cell {
            recomputed: text(d),
            printed: printed.to_owned(),
            differs: !agrees(d, printed),
            deviation_percent: d,
        });
        rows.push((state.clone(), cells.collect()));
    }
    Ok(Recomputed { number, title, rows })
}

/// Ranks that differ between simulation and experiment, both recomputed: state, harmonic counted
/// from 1, the two ranks.
pub fn rank_differences(relation: &Relation) -> Vec<(String, usize, Rank, Rank)> {
    let ranks = RankConfig::default();
    let mut out = Vec::new();
    let rows = relation.states[1..].iter().zip(relation.simulation_percent.iter().zip(&relation.experiment_percent));
    for (state, (simulation, experiment)) in rows {
        for (harmonic, (&s, &e)) in simulation.iter().zip(experiment).enumerate() {
            if ranks.rank_of(s) != ranks.rank_of(e) {
                out.push((state.clone(), harmonic + 1, ranks.rank_of(s), ranks.rank_of(e)));
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The misprints that are known: three in table 3, none in table 4, three in table 6.
    #[test]
    fn literature_misprints_of_tables_3_4_and_6() {
        let paper = recompute().expect("the embedded tables");
        let found = |i: usize| -> Vec<(String, usize, String, String)> {
            let cells = paper.recomputed[i].misprints();
            cells.map(|(s, h, c)| (s.to_owned(), h, c.recomputed.clone(), c.printed.clone())).collect()
        };
        let cell = |s: &str, h: usize, r: &str, p: &str| (s.to_owned(), h, r.to_owned(), p.to_owned());
        assert_eq!(
            found(0),
            [
                cell("broken_total", 3, "3.03", "+"),
                cell("broken_total", 5, "1.41", "1.43"),
                cell("compound_2", 5, "5.79", "6.14")
            ]
        );
        assert_eq!(found(1), []);
        assert_eq!(
            found(2),
            [cell("pitting_2", 2, "V", "IV"), cell("pitting_4", 1, "II", "I"), cell("compound_4", 4, "V", "IV")]
        );
        assert_eq!(rank_differences(&paper.relation).len(), 3);
        assert!(paper.recomputed.iter().all(|t| t.rows.len() == 14 && t.rows.iter().all(|(_, c)| c.len() == 5)));
    }
}
