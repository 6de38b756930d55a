//! `gearwatch paper`: the tables of the rank paper, recomputed and set side by side.

use std::fmt::Write as _;
use std::io::Write as _;

use anyhow::Context;
use clap::Args;
use gearwatch_explain::paper::{self, Recomputed};
use gearwatch_explain::tables::{Finding, Model, Relation};
use serde_json::json;

use self::figures::Figures;
use super::Run;
use crate::exit::Exit;
use crate::format::{Format, wrapped};
use crate::output::OutputOptions;
use crate::terminal;

mod figures;

/// Recompute the tables of the rank paper, mark its misprints, and say what its experiment proves
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch paper
  gearwatch paper --format json | jq .relation.models
  gearwatch paper --plot figures.html

Tables 2 (simulation) and 5 (experiment) of \"The Absolute Deviation Rank Diagnostic Approach to Gear Tooth Composite \
Fault\" are part of the program; docs/paper.md explains the figures.")]
pub struct Paper {
    /// Text for people, or one JSON object
    #[arg(long, value_enum, default_value_t)]
    format: Format,
    /// Also simulate its composite faults on the bench paper-rig at its speeds and loads, and write
    /// figures 3 to 8 as .svg or .html
    #[arg(long, value_name = "FILE")]
    plot: Option<std::path::PathBuf>,
    #[command(flatten)]
    overwrite: OutputOptions,
}

impl Run for Paper {
    const NAME: &'static str = "paper";
    const COMPUTES: bool = true;

    fn run(self) -> anyhow::Result<Exit> {
        let form = self.plot.as_deref().map(super::simulate::form).transpose()?;
        let mut outputs = self.overwrite.reading::<&std::path::Path>([]);
        let plot = self.plot.as_deref().map(|path| outputs.target(path)).transpose()?;
        let paper = paper::recompute()?;
        let figures = plot.is_some().then(|| Figures::simulate(&paper)).transpose()?;
        let text = match self.format {
            Format::Text => text(&paper, figures.as_ref())?,
            Format::Json => {
                let finding = json!({ "code": paper.relation.finding.code(),
                    "sentence": paper.relation.finding.sentence() });
                let tables = json!({ "recomputed": paper.recomputed, "relation": paper.relation, "finding": finding,
                    "figures": figures.as_ref().map(Figures::object) });
                format!("{}\n", serde_json::to_string_pretty(&tables)?)
            }
        };
        terminal::out().write_all(text.as_bytes()).context("standard output")?;
        if let Some(((target, form), figures)) = plot.zip(form).zip(figures) {
            target.write(figures.picture(form)?)?;
        }
        Ok(Exit::Ok)
    }
}

fn text(paper: &paper::Paper, figures: Option<&Figures>) -> Result<String, std::fmt::Error> {
    let mut out = String::new();
    writeln!(out, "\"The Absolute Deviation Rank Diagnostic Approach to Gear Tooth Composite Fault\", recomputed\n")?;
    for table in &paper.recomputed {
        recomputed(&mut out, table)?;
    }
    out.push_str(&relation_text(&paper.relation)?);
    if let Some(figures) = figures {
        writeln!(out, "\nFigures 3 to 8 on the bench paper-rig")?;
        for sentence in figures.sentences() {
            writeln!(out, "  {}", wrapped(sentence, 110).join("\n  "))?;
        }
    }
    Ok(out)
}

/// Simulation and experiment side by side: ranks, signs, sizes, models and the finding.
pub fn relation_text(relation: &Relation) -> Result<String, std::fmt::Error> {
    let mut out = String::new();
    for (state, harmonic, simulation, experiment) in paper::rank_differences(relation) {
        writeln!(
            out,
            "  {state} at {harmonic}x: rank {} in the simulation, {} in the experiment",
            simulation.code(),
            experiment.code()
        )?;
    }
    writeln!(out, "  ranks agree in {} of {} cells\n", relation.same_rank, relation.cells)?;
    side_by_side(&mut out, relation)?;
    statistics(&mut out, relation)?;
    // Columns are filled with spaces up to the last one.
    Ok(out.lines().flat_map(|line| [line.trim_end(), "\n"]).collect())
}

fn recomputed(out: &mut String, table: &Recomputed) -> std::fmt::Result {
    let source = if table.number == 6 { 5 } else { 2 };
    writeln!(out, "Table {}: {}, from table {source}", table.number, table.title)?;
    writeln!(out, "  {:<14}{}", "state", header())?;
    for (state, cells) in &table.rows {
        write!(out, "  {state:<14}")?;
        for cell in cells {
            write!(out, "{:>8}{}", cell.recomputed, if cell.differs { '*' } else { ' ' })?;
        }
        out.push('\n');
    }
    let mut misprints = 0;
    for (state, harmonic, cell) in table.misprints() {
        misprints += 1;
        writeln!(
            out,
            "  * {state} at {harmonic}x: {} ({:+.2} %), printed {}",
            cell.recomputed, cell.deviation_percent, cell.printed
        )?;
    }
    if misprints == 0 {
        writeln!(out, "  every cell as printed")?;
    }
    out.push('\n');
    Ok(())
}

fn header() -> String {
    (1..=5).map(|h| format!("{:>9}", format!("{h}x "))).collect()
}

fn side_by_side(out: &mut String, relation: &Relation) -> std::fmt::Result {
    writeln!(out, "Signed deviations (%), simulation and experiment; ! where the signs differ")?;
    write!(out, "  {:<14}", "state")?;
    for harmonic in 1..=relation.normal_ratio.len() {
        write!(out, "{:>17}", format!("{harmonic}x  sim    exp "))?;
    }
    out.push('\n');
    let rows = relation.simulation_percent.iter().zip(&relation.experiment_percent);
    for (state, (simulation, experiment)) in relation.states[1..].iter().zip(rows) {
        write!(out, "  {state:<14}")?;
        for (s, e) in simulation.iter().zip(experiment) {
            write!(out, "{s:>+9.2}{e:>+7.2}{}", if (*s > 0.0) == (*e > 0.0) { ' ' } else { '!' })?;
        }
        out.push('\n');
    }
    out.push('\n');
    Ok(())
}

/// Ratios of the normal state that lie within this factor of each other are of one spectral shape:
/// the first step of the ranks.
const SAME_SHAPE: f64 = 1.01;

fn statistics(out: &mut String, r: &Relation) -> std::fmt::Result {
    writeln!(out, "Experiment against simulation, {} deviations", r.cells)?;
    writeln!(out, "  positive in the simulation  {}", r.simulation_positive)?;
    writeln!(
        out,
        "  positive in the experiment  {}   (by the toss of a coin: p = {:.0e})",
        r.experiment_positive, r.experiment_positive_p
    )?;
    writeln!(
        out,
        "  of the same sign            {}   of the other sign {} (p = {:.4})",
        r.same_sign,
        r.cells - r.same_sign,
        r.same_sign_p
    )?;
    writeln!(
        out,
        "  correlation                 {:+.3} signed, {:+.3} absolute; absolute values differ by {:.2} points on average",
        r.correlation_signed, r.correlation_absolute, r.absolute_gap
    )?;
    let line = r.against_absolute;
    writeln!(
        out,
        "  experiment = ({:.3} ± {:.3}) |simulation| + ({:.2} ± {:.2}) points, R² {:.3}, scatter {:.2} points",
        line.slope.value, line.slope.sigma, line.intercept.value, line.intercept.sigma, line.r_squared, line.scatter
    )?;
    write!(out, "  normal state, experiment / simulation, 1x to 5x:")?;
    for ratio in &r.normal_ratio {
        write!(out, " {ratio:.4}")?;
    }
    let (low, high) = r.normal_ratio.iter().fold((f64::INFINITY, 0.0f64), |(a, b), x| (a.min(*x), b.max(*x)));
    writeln!(out)?;
    if high > SAME_SHAPE * low {
        writeln!(
            out,
            "    the spectral shape differs; path, contact law, damping, profile error and tip relief each fit five"
        )?;
        writeln!(
            out,
            "    numbers, and no more can be told from one state. A run-up and several loads would tell them apart."
        )?;
    } else {
        writeln!(out, "    the spectral shape is the same, to one step of the ranks")?;
    }
    writeln!(out, "\nModels of the logarithmic amplitudes, {} cells", r.cells + r.normal_ratio.len())?;
    writeln!(out, "  {:<58}{:>10}{:>8}", "model", "scatter", "AIC")?;
    // Changes to single cells matter only where a linear path needs nothing else.
    let shown = |model: Model| model != Model::CorrectedPath || r.finding == Finding::Contradiction;
    let mut fits: Vec<_> = r.models.iter().filter(|fit| shown(fit.model)).collect();
    fits.sort_by(|a, b| a.aic.total_cmp(&b.aic));
    for fit in fits {
        writeln!(out, "  {:<58}{:>9.2}%{:>8.0}", model_name(fit.model), 100.0 * fit.scatter, fit.aic)?;
    }
    for correction in r.corrections.iter().filter(|_| shown(Model::CorrectedPath)) {
        writeln!(out, "    {correction}")?;
    }
    writeln!(out, "\nFinding\n  {}", wrapped(r.finding.sentence(), 110).join("\n  "))?;
    Ok(())
}

const fn model_name(model: Model) -> &'static str {
    match model {
        Model::NoRelation => "no relation: a constant for each harmonic",
        Model::LinearPath => "linear path: a gain for each harmonic",
        Model::PowerLaw => "power law for each harmonic",
        Model::Rectified => "rectified: normal amplitude × (1 + |simulated deviation|)",
        Model::CorrectedPath => "linear path after changes to single signs and rows",
    }
}
