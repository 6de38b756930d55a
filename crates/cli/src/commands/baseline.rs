//! `gearwatch baseline learn | show | check | merge`: what is normal on a bench.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::{Context, bail};
use clap::{Args, Subcommand};
use gearwatch_core::baseline::{Baseline, BaselineConfig, Learner, Origin, Surface};
use gearwatch_core::bench::Bench;
use gearwatch_core::one_shot::{Passage, each_window};
use gearwatch_core::pipeline::{Pipeline, PipelineConfig};
use gearwatch_core::verdict::HARMONICS;
use gearwatch_io::output::Outputs;
use gearwatch_io::{baseline_file, bench_file};
use serde_json::json;

use super::Run;
use crate::exit::Exit;
use crate::format::Format;
use crate::input::Input;
use crate::output::{OutputOptions, with_sidecars};
use crate::terminal;

/// Learn, show, check and merge what is normal on a bench
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch baseline learn monday-*.mcap --bench bench.toml -o monday.json --session monday
  gearwatch baseline learn run.csv.gz --bench bench.toml -o run.json --sample-rate 12800 --torque 60
  gearwatch baseline merge monday.json tuesday.json -o normal.json
  gearwatch baseline show normal.json
  gearwatch baseline check normal.json --bench bench.toml
  gearwatch baseline rebind normal.json --bench bench.toml --reason 'acc_2 was always at 90 degrees'

One session understates how much a healthy machine scatters, because temperature, oil and mounting stay as they are \
within it: learn several, each under its own name. docs/baseline.md explains what is kept.")]
pub struct BaselineCommand {
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand)]
enum Action {
    /// Learn from recordings of the normal state
    Learn(Box<Learn>),
    /// Show cells, sessions and scatter
    Show(Show),
    /// Check a file by itself, and against a bench
    Check(Check),
    /// Join baselines of one bench
    Merge(Merge),
    /// Tie a baseline to a changed bench file that it still holds for, with a reason that stays in
    /// it
    ///
    /// A baseline rests on teeth, ratios, sensors, their units and the tacho. Where other teeth,
    /// ratios or units make other lines of them it is refused.
    Rebind(Rebind),
}

#[derive(Args)]
struct Learn {
    #[command(flatten)]
    input: Input,
    /// Bench file
    #[arg(short, long, value_name = "FILE")]
    bench: PathBuf,
    /// The baseline to write
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Name of the session: what was recorded without a longer stop
    #[arg(long, default_value = "1")]
    session: String,
    /// Name of the mounting: since when neither sensors nor gears were taken off
    #[arg(long, default_value = "1")]
    mounting: String,
    /// Length of a window in seconds
    #[arg(long, value_name = "S")]
    window: Option<f64>,
    /// Seconds from the start of one window to the start of the next
    #[arg(long, value_name = "S")]
    hop: Option<f64>,
    #[command(flatten)]
    overwrite: OutputOptions,
}

#[derive(Args)]
struct Show {
    /// Baseline file
    file: PathBuf,
    /// Text for people, or JSON
    #[arg(long, value_enum, default_value_t)]
    format: Format,
}

#[derive(Args)]
struct Check {
    /// Baseline file
    file: PathBuf,
    /// Bench file that it must belong to
    #[arg(short, long, value_name = "FILE")]
    bench: Option<PathBuf>,
    /// Window length that it must have, in seconds
    #[arg(long, value_name = "S")]
    window: Option<f64>,
}

#[derive(Args)]
struct Merge {
    /// Baseline files
    #[arg(required = true, num_args = 2.., value_name = "FILE")]
    files: Vec<PathBuf>,
    /// The baseline to write
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    overwrite: OutputOptions,
}

#[derive(Args)]
struct Rebind {
    /// Baseline file; it is written anew
    file: PathBuf,
    /// Bench file that it holds for
    #[arg(short, long, value_name = "FILE")]
    bench: PathBuf,
    /// Why it still holds, for whoever reads it later
    #[arg(short, long, value_name = "TEXT")]
    reason: String,
}

impl Run for BaselineCommand {
    const NAME: &'static str = "baseline";
    const COMPUTES: bool = true;

    fn run(self) -> anyhow::Result<Exit> {
        match self.action {
            Action::Learn(learn) => learn.run(),
            Action::Show(show) => show.run(),
            Action::Check(check) => check.run(),
            Action::Merge(merge) => merge.run(),
            Action::Rebind(rebind) => rebind.run(),
        }
    }
}

impl Learn {
    fn run(self) -> anyhow::Result<Exit> {
        let inputs = with_sidecars(&self.input.files);
        let mut outputs = self.overwrite.reading(inputs).reading([&self.bench]);
        let target = outputs.target(&self.output)?;
        let bench = bench_file::read(&self.bench)?;
        // Learning has time: indicators of gears in every window.
        let mut config = PipelineConfig { gear_indicators_every: 1, ..PipelineConfig::default() };
        config.window.length_s = self.window.unwrap_or(config.window.length_s);
        config.window.hop_s = self.hop.unwrap_or(config.window.hop_s);
        let pipeline = Pipeline::new(&bench, &config, None).with_context(|| self.bench.display().to_string())?;
        let cells = BaselineConfig::default();
        let sha256 = baseline_file::bench_sha256(&bench);
        let mut baseline = Baseline::new(&bench, sha256, config.window.length_s, cells);
        baseline.rank_steps_percent = config.rank.steps_percent;
        super::check::before("baseline learn", &bench, &self.input.files, &self.input.options, None)?;
        for path in &self.input.files {
            self.learn_one(path, &pipeline, &mut baseline)?;
        }
        let Some(problem) = baseline.problems().into_iter().next() else {
            for cell in baseline.mixed_cells() {
                talk(&format!(
                    "the {} runs at {:.2} Hz{} differ by {:.0} %, {:.1} times what their own scatter explains: {}",
                    cell.runs,
                    cell.input_speed_hz,
                    cell.brake_torque_nm.map_or(", torque unstated,".to_owned(), |t| format!(", {t:.1} N m,")),
                    cell.between_percent,
                    cell.times,
                    if cell.brake_torque_nm.is_none() { "state the torque of each" } else { "something else differed" }
                ));
            }
            target.write(baseline_file::to_text(&baseline, &self.output)?)?;
            say(&format!("{}\n{}", self.output.display(), summary(&baseline)?))?;
            return Ok(Exit::Ok);
        };
        bail!("{problem}")
    }

    fn learn_one(&self, path: &Path, pipeline: &Pipeline, baseline: &mut Baseline) -> anyhow::Result<()> {
        let recording = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let mut source = self.input.options.open(path)?;
        let mut learner = Learner::new(baseline.config);
        let Passage { gaps, .. } =
            each_window::<_, gearwatch_io::ReadError>(pipeline, &mut source, &mut |_, analysis| {
                learner.push(analysis);
                Ok(())
            })?;
        for gap in gaps {
            talk(&format!(
                "{}: {}: {:?} at sample {}, {} samples in no window",
                path.display(),
                gap.sensor,
                gap.reason,
                gap.found_index,
                gap.discarded
            ));
        }
        for (reason, windows) in learner.refused() {
            talk(&format!("{}: {windows} windows left out: {reason}", path.display()));
        }
        let origin = Origin { session: self.session.clone(), mounting: self.mounting.clone(), recording };
        baseline.add(learner.finish(&origin)?).with_context(|| path.display().to_string())
    }
}

impl Show {
    fn run(self) -> anyhow::Result<Exit> {
        let baseline = baseline_file::read(&self.file)?;
        match self.format {
            Format::Text => say(&format!("{}\n{}{}", self.file.display(), summary(&baseline)?, table(&baseline)?))?,
            Format::Json => say(&format!("{}\n", serde_json::to_string_pretty(&lines(&baseline))?))?,
        }
        Ok(Exit::Ok)
    }
}

impl Check {
    fn run(self) -> anyhow::Result<Exit> {
        let baseline = baseline_file::read(&self.file)?;
        let bench: Option<Bench> = self.bench.as_deref().map(bench_file::read).transpose()?;
        if let Some(bench) = &bench {
            let window_s = self.window.unwrap_or(baseline.window_s);
            baseline_file::check_use(&baseline, &self.file, bench, window_s)?;
        } else if let Some(window_s) = self.window.filter(|w| (w - baseline.window_s).abs() > 1e-3 * w) {
            bail!("{}: windows are {} s long, not {window_s} s", self.file.display(), baseline.window_s);
        }
        say(&format!("{}: good\n{}", self.file.display(), summary(&baseline)?))?;
        Ok(Exit::Ok)
    }
}

impl Merge {
    fn run(self) -> anyhow::Result<Exit> {
        let target = self.overwrite.reading(&self.files).target(&self.output)?;
        let mut merged: Option<Baseline> = None;
        for path in &self.files {
            let next = baseline_file::read(path)?;
            merged = Some(match merged {
                Some(before) => before.merged(&next).with_context(|| path.display().to_string())?,
                None => next,
            });
        }
        let Some(merged) = merged else { bail!("there is no file to merge") };
        target.write(baseline_file::to_text(&merged, &self.output)?)?;
        say(&format!("{}\n{}", self.output.display(), summary(&merged)?))?;
        Ok(Exit::Ok)
    }
}

impl Rebind {
    fn run(self) -> anyhow::Result<Exit> {
        if self.reason.trim().is_empty() {
            bail!("--reason is empty; say why the baseline still holds");
        }
        let mut baseline = baseline_file::read(&self.file)?;
        let bench = bench_file::read(&self.bench)?;
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let t_ns = i64::try_from(now.as_nanos()).unwrap_or(i64::MAX);
        let changes = baseline_file::rebind(&mut baseline, &self.file, &bench, self.reason.trim(), t_ns)?;
        let text = baseline_file::to_text(&baseline, &self.file)?;
        Outputs::new(true).target(&self.file)?.write(text)?;
        let mut text = format!("{}: tied to {}\n", self.file.display(), self.bench.display());
        for change in &changes {
            writeln!(text, "  {}", change.sentence)?;
        }
        say(&text)?;
        Ok(Exit::Ok)
    }
}

fn say(text: &str) -> anyhow::Result<()> {
    terminal::out().write_all(text.as_bytes()).context("standard output")
}

fn talk(text: &str) {
    // A closed stderr is not worth stopping for.
    let _ = writeln!(terminal::err(), "gearwatch baseline: {text}");
}

/// What it was made from, and what it therefore does not know.
fn summary(baseline: &Baseline) -> Result<String, std::fmt::Error> {
    let mut out = String::new();
    let surface = Surface::new(baseline);
    writeln!(out, "  bench {:?}, stages {}", baseline.bench, baseline.stages.join(", "))?;
    match &baseline.machine {
        Some(machine) => {
            let teeth = machine.stages.iter().map(|s| {
                let planets = s.planets.as_ref().map_or(String::new(), |planets| format!(" (planets: {planets})"));
                format!("{} {}/{}{planets}", s.name, s.pinion, s.wheel)
            });
            let sensors = machine.sensors.iter().map(|s| format!("{} ({})", s.name, s.unit));
            writeln!(out, "  rests on teeth {}", teeth.collect::<Vec<_>>().join(", "))?;
            writeln!(out, "  belt ratio {}, sensors {}", machine.belt_ratio, sensors.collect::<Vec<_>>().join(", "))?;
        }
        None => writeln!(out, "  rests on the bench file with hash {}", baseline.bench_sha256)?,
    }
    for entry in &baseline.history {
        let changes = if entry.changes.is_empty() { String::new() } else { format!(" ({})", entry.changes.join("; ")) };
        writeln!(out, "  rebound: {}{changes}", entry.reason)?;
    }
    writeln!(
        out,
        "  windows of {} s, {} runs, {} cells",
        baseline.window_s,
        baseline.runs.len(),
        surface.cells().len()
    )?;
    let motor_order = baseline.machine.as_ref().map_or(1.0, |machine| machine.belt_ratio);
    if let Some(slip) = baseline.slip(motor_order).filter(|slip| slip.runs.iter().any(|run| run.1.abs() > 1e-3)) {
        let law = if slip.per_nm == 0.0 {
            format!("{:.2} %", 100.0 * slip.at_no_load)
        } else {
            format!("{:.2} % at no load, {:+.4} % for each N m", 100.0 * slip.at_no_load, 100.0 * slip.per_nm)
        };
        writeln!(out, "  the input shaft lags behind the stated motor speed: {law}, ± {:.2} %", 100.0 * slip.scatter)?;
    }
    for (session, mountings) in baseline.sessions() {
        writeln!(out, "  session {session:?}, mounting {}", mountings.join(", "))?;
    }
    let (mut unknown, mut too_small) = (0, 0);
    for line in each_line(baseline, &surface) {
        match line.reference {
            Some(reference) => unknown += usize::from(reference.between_variance.is_none()),
            None => too_small += 1,
        }
    }
    if unknown > 0 {
        writeln!(
            out,
            "  note: {unknown} lines are known from one session only: the spread between sessions is unknown there, and sigmas\n        \
             leave it out. Learn further sessions (other days, after mounting the sensors anew) and merge them."
        )?;
    }
    if too_small > 0 {
        writeln!(
            out,
            "  note: {too_small} lines are known from fewer than {} independent windows and judge nothing.",
            baseline.config.least_windows
        )?;
    }
    Ok(out)
}

/// A line in a cell.
struct CellLine<'a> {
    channel: &'a str,
    unit: &'a str,
    stage: &'a str,
    harmonic: usize,
    cell: String,
    reference: Option<gearwatch_core::baseline::Reference>,
}

fn each_line<'a>(baseline: &'a Baseline, surface: &'a Surface) -> Vec<CellLine<'a>> {
    let mut channels: Vec<&str> = baseline.runs.iter().flat_map(|r| r.channels.keys().map(String::as_str)).collect();
    channels.sort_unstable();
    channels.dedup();
    let mut out = Vec::new();
    for cell in surface.cells() {
        let Some(place) = surface.locate(cell.input_speed_hz, cell.brake_torque_nm) else { continue };
        let mut name = String::new();
        surface.write_name(&place, &mut name);
        for channel in &channels {
            for (stage, stage_name) in baseline.stages.iter().enumerate() {
                for harmonic in 0..HARMONICS {
                    out.push(CellLine {
                        channel,
                        unit: surface.unit(channel).unwrap_or_default(),
                        stage: stage_name,
                        harmonic: harmonic + 1,
                        cell: name.clone(),
                        reference: surface.line(&place, channel, stage, harmonic),
                    });
                }
            }
        }
    }
    out
}

fn table(baseline: &Baseline) -> Result<String, std::fmt::Error> {
    let surface = Surface::new(baseline);
    let mut out = String::new();
    let mut cell = String::new();
    for line in each_line(baseline, &surface) {
        if line.cell != cell {
            cell.clone_from(&line.cell);
            writeln!(
                out,
                "{cell}\n  {:<12}{:<12}{:>4}{:>14}{:<7}{:>10}{:>10}{:>10}",
                "channel", "stage", "", "amplitude ", "", "scatter", "mean ±", "sessions ±"
            )?;
        }
        write!(out, "  {:<12}{:<12}{:>3}x", line.channel, line.stage, line.harmonic)?;
        let percent = |variance: f64| format!("{:.2}%", 100.0 * variance.sqrt());
        match line.reference {
            Some(r) => writeln!(
                out,
                "{:>14.6} {:<6}{:>10}{:>10}{:>10}",
                r.ln.exp(),
                line.unit,
                percent(r.scatter_variance),
                percent(r.mean_variance),
                r.between_variance.map_or("unknown".to_owned(), percent)
            )?,
            None => writeln!(out, "{:>14}", "too few windows")?,
        }
    }
    Ok(out)
}

fn lines(baseline: &Baseline) -> serde_json::Value {
    let surface = Surface::new(baseline);
    let lines = each_line(baseline, &surface).into_iter().map(|line| {
        let r = line.reference;
        json!({
            "cell": line.cell, "channel": line.channel, "unit": line.unit, "stage": line.stage, "harmonic": line.harmonic,
            "amplitude": r.map(|r| r.ln.exp()), "scatter_percent": r.map(|r| 100.0 * r.scatter_variance.sqrt()),
            "mean_sigma_percent": r.map(|r| 100.0 * r.mean_variance.sqrt()),
            "between_sessions_percent": r.and_then(|r| r.between_variance).map(|v| 100.0 * v.sqrt()),
            "sessions": r.map(|r| r.sessions),
        })
    });
    json!({
        "format": baseline.format, "bench": baseline.bench, "bench_sha256": baseline.bench_sha256,
        "window_s": baseline.window_s, "sessions": baseline.sessions(), "runs": baseline.runs.len(),
        "lines": lines.collect::<Vec<_>>(),
    })
}
