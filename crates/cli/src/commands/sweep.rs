//! `gearwatch sweep`: statistics over speed and load, of simulations or of recordings.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use gearwatch_batch::sweep::{Collector, Row, write_parquet};
use gearwatch_core::baseline::BaselineConfig;
use gearwatch_core::bench::{Bench, EffectSpec};
use gearwatch_core::pipeline::{Pipeline, PipelineConfig};
use gearwatch_sim::scenario::{Course, Scenario};
use gearwatch_sim::source::{SimConfig, Simulator};
use rayon::prelude::*;

use super::Run;
use super::simulate::{Contact, START_NS, parse_effect, read_bench};
use crate::exit::Exit;
use crate::input::InputOptions;
use crate::output::{OutputOptions, with_sidecars};
use crate::progress::Progress;
use crate::terminal;

mod picture;
mod table;

/// Speeds and torques that a sweep may have, together: more is a slip of the pen.
const MOST_POINTS: usize = 10_000;

/// Statistics over speed and load: peak to peak, RMS, 1x to 5x and sidebands
///
/// Of simulations of a bench, healthy and with faults side by side; or of recordings, those of one
/// folder being one case.
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch sweep paper-rig --speeds 10:40:5 --plot sweep.html
  gearwatch sweep bench.toml --speeds 20,30 --torques 50:200:50 --out sweep.parquet \\
      --case 'broken 2/5=tooth_breakage@stage1.pinion:fraction=0.4' \\
      --case 'broken 4/5=tooth_breakage@stage1.pinion:fraction=0.8'
  gearwatch sweep bench.toml recordings/normal/*.mcap recordings/pitted/*.mcap --plot compared.html
  duckdb -c \"select \\\"case\\\", input_speed_hz, amp_1x from 'sweep.parquet' where stage = 'stage1'\"

Exit codes: 0 done; 3 a recording could not be read, windows gave nothing, or bad input.")]
pub struct Sweep {
    /// Bench file, or the name of a bench that comes with the program
    bench: PathBuf,
    /// Recordings; without any the bench is simulated
    #[arg(value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// Motor speeds in Hz: 20,30 or FROM:TO:STEP; the bench's own where left out
    #[arg(long, value_name = "HZ", value_parser = values, conflicts_with = "recordings")]
    speeds: Option<Values>,
    /// Brake torques in N m, in the same form, 0 among them; the bench's own where left out
    #[arg(long, value_name = "NM", value_parser = loads, conflicts_with = "recordings")]
    torques: Option<Values>,
    /// A case beside the healthy one: its name and its effects, joined by +; also a state of the
    /// rank paper, as compound_3@stage1.pinion
    #[arg(long = "case", value_name = "NAME=EFFECT[+EFFECT]", conflicts_with = "recordings")]
    cases: Vec<String>,
    /// Law of the tooth contacts; impact is that of the rank paper's simulation
    #[arg(long, value_enum, default_value_t, conflicts_with = "recordings")]
    contact: Contact,
    /// Length of each simulation (s)
    #[arg(long, value_name = "S", default_value_t = 5.0, conflicts_with = "recordings")]
    duration: f64,
    /// Draws noise and jitter of the simulations
    #[arg(long, default_value_t = 1, conflicts_with = "recordings")]
    seed: u64,
    /// Table to write: .parquet or .csv
    #[arg(short, long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Pictures to write: one .html file
    #[arg(long, value_name = "FILE.html")]
    plot: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OutputOptions,
    /// Threads; one a core by default
    #[arg(short, long, value_name = "N")]
    jobs: Option<std::num::NonZeroUsize>,
    #[command(flatten)]
    input: InputOptions,
}

/// Values of an operating quantity.
#[derive(Clone, Debug)]
struct Values(Vec<f64>);

/// Rows of one task, and how many windows gave nothing.
type Measured = anyhow::Result<(Vec<Row>, u32)>;

/// One case at one place of the sweep.
enum Task<'a> {
    Simulate { case: &'a str, effects: &'a [EffectSpec], speed_hz: f64, torque_nm: f64 },
    Read { case: String, path: &'a Path },
}

impl Run for Sweep {
    const NAME: &'static str = "sweep";
    const COMPUTES: bool = true;

    fn run(self) -> anyhow::Result<Exit> {
        self.check_names()?;
        let mut outputs = self.overwrite.reading(with_sidecars(&self.recordings)).reading([&self.bench]);
        let out = self.out.as_deref().map(|path| outputs.target(path)).transpose()?;
        let plot = self.plot.as_deref().map(|path| outputs.target(path)).transpose()?;
        let bench = read_bench(&self.bench)?;
        let pipeline = Pipeline::new(&bench, &PipelineConfig::default(), None)?;
        let cases = self.cases()?;
        let tasks = self.tasks(&bench, &cases)?;
        let (rows, troubles) = self.work(&bench, &pipeline, &tasks)?;
        for trouble in &troubles {
            writeln!(terminal::err(), "gearwatch sweep: {trouble}").context("stderr")?;
        }
        if rows.is_empty() {
            bail!("no window could be measured");
        }
        table::print(&rows)?;
        if let Some(target) = out {
            let text = target.path().extension().is_some_and(|end| end == "csv");
            let mut file = target.create()?;
            if text {
                table::write_csv(&mut file, &rows)?
            } else {
                write_parquet(&mut file, &rows)?
            }
            file.finish()?;
        }
        if let Some(target) = plot {
            target.write(picture::page(&bench.name, &rows))?;
        }
        Ok(if troubles.is_empty() { Exit::Ok } else { Exit::Unknown })
    }
}

impl Sweep {
    /// Wrong endings are told before the work, not after it.
    fn check_names(&self) -> anyhow::Result<()> {
        let end = |path: &Path| path.extension().and_then(|end| end.to_str()).map(str::to_owned);
        if let Some(path) = self.out.as_deref().filter(|p| !matches!(end(p).as_deref(), Some("parquet" | "csv"))) {
            bail!("{}: the name must end in .parquet or .csv, which says the form", path.display());
        }
        if let Some(path) = self.plot.as_deref().filter(|path| end(path).as_deref() != Some("html")) {
            bail!("{}: the name must end in .html", path.display());
        }
        Ok(())
    }

    fn cases(&self) -> anyhow::Result<Vec<(String, Vec<EffectSpec>)>> {
        let mut out = vec![("normal".to_owned(), Vec::new())];
        for text in &self.cases {
            let (name, effects) =
                text.split_once('=').with_context(|| format!("--case {text:?}: expected NAME=EFFECT"))?;
            let effects =
                effects.split('+').map(|effect| parse_effect(effect.trim())).collect::<anyhow::Result<_>>()?;
            if out.iter().any(|(known, _)| known == name) {
                bail!("--case {name:?} is there twice");
            }
            out.push((name.to_owned(), effects));
        }
        Ok(out)
    }

    fn tasks<'a>(&'a self, bench: &Bench, cases: &'a [(String, Vec<EffectSpec>)]) -> anyhow::Result<Vec<Task<'a>>> {
        if !self.recordings.is_empty() {
            let folder = |path: &Path| {
                let folder = path.parent().and_then(Path::file_name);
                folder.map_or_else(|| "recordings".to_owned(), |name| name.to_string_lossy().into_owned())
            };
            return Ok(self.recordings.iter().map(|path| Task::Read { case: folder(path), path }).collect());
        }
        let own =
            |given: &Option<Values>, own: f64| given.as_ref().map_or_else(|| vec![own], |values| values.0.clone());
        let (speeds, torques) = (own(&self.speeds, bench.motor.speed_hz), own(&self.torques, bench.brake.torque_nm));
        let count = speeds.len() * torques.len() * cases.len();
        if count > MOST_POINTS {
            bail!("{count} simulations; at most {MOST_POINTS} are done in one sweep");
        }
        let mut out = Vec::with_capacity(count);
        for (case, effects) in cases {
            for &torque_nm in &torques {
                for &speed_hz in &speeds {
                    out.push(Task::Simulate { case, effects, speed_hz, torque_nm });
                }
            }
        }
        Ok(out)
    }

    /// All tasks on all cores; rows in the order of the tasks, whatever the number of threads.
    fn work(&self, bench: &Bench, pipeline: &Pipeline, tasks: &[Task<'_>]) -> anyhow::Result<(Vec<Row>, Vec<String>)> {
        let progress = Progress::new("points", tasks.len() as u64);
        let one = |task: &Task<'_>| {
            let result = self.one(bench, pipeline, task);
            progress.finished(task.case());
            result
        };
        // 0 threads are as many as there are cores.
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(self.jobs.map_or(0, usize::from))
            .start_handler(|_| crate::memory::keep_in_this_thread())
            .build()?;
        let results: Vec<Measured> = pool.install(|| tasks.par_iter().map(one).collect());
        drop(progress);
        let order = |case: &str| tasks.iter().position(|task| task.case() == case);
        let (mut rows, mut troubles) = (Vec::new(), Vec::new());
        for (task, result) in tasks.iter().zip(results) {
            match result {
                Ok((more, refused)) => {
                    rows.extend(more);
                    if refused > 0 {
                        troubles.push(format!(
                            "{}: {refused} windows gave nothing: no speed, or instrument trouble",
                            task.name()
                        ));
                    }
                }
                // An error of a file names it.
                Err(error) if matches!(task, Task::Read { .. }) => troubles.push(format!("{error:#}")),
                Err(error) => troubles.push(format!("{}: {error:#}", task.name())),
            }
        }
        // Stable: torque and speed stay in their order.
        rows.sort_by_cached_key(|row: &Row| (order(&row.case), row.channel.clone(), row.stage.clone()));
        Ok((rows, troubles))
    }

    fn one(&self, bench: &Bench, pipeline: &Pipeline, task: &Task<'_>) -> Measured {
        let (case, recording) = match task {
            Task::Simulate { case, .. } => ((*case).to_owned(), String::new()),
            Task::Read { case, path } => (case.clone(), path.display().to_string()),
        };
        let mut collector = Collector::new(pipeline, BaselineConfig::default(), case, recording);
        match task {
            Task::Simulate { effects, speed_hz, torque_nm, .. } => {
                let scenario = Scenario {
                    motor_speed_hz: Some(Course::Constant(*speed_hz)),
                    brake_torque_nm: Some(Course::Constant(*torque_nm)),
                    duration_s: Some(self.duration),
                    contact_law: self.contact.law(),
                    ..Scenario::default()
                };
                let effects = effects.to_vec();
                let config = SimConfig { bench: bench.clone(), effects, scenario, seed: self.seed, t0: START_NS };
                collector.take(&mut Simulator::new(config)?)?;
            }
            Task::Read { path, .. } => collector.take(&mut gearwatch_io::open(path, &self.input.open_options())?)?,
        }
        let refused = collector.refused;
        Ok((collector.finish(), refused))
    }
}

impl Task<'_> {
    fn case(&self) -> &str {
        match self {
            Self::Simulate { case, .. } => case,
            Self::Read { case, .. } => case,
        }
    }

    fn name(&self) -> String {
        match self {
            Self::Simulate { case, speed_hz, torque_nm, .. } => format!("{case} at {speed_hz} Hz, {torque_nm} N m"),
            Self::Read { path, .. } => path.display().to_string(),
        }
    }
}

/// `20,30,40` or `20:40:10`.
fn values(text: &str) -> Result<Values, String> {
    list(text, |value| if value > 0.0 { Ok(value) } else { Err(format!("{value} must be above 0")) })
}

/// As [`values`], 0 allowed: a brake may stand open.
fn loads(text: &str) -> Result<Values, String> {
    list(text, |value| if value >= 0.0 { Ok(value) } else { Err(format!("{value} must be 0 or above")) })
}

fn list(text: &str, check: fn(f64) -> Result<f64, String>) -> Result<Values, String> {
    let number = |text: &str| {
        let value: f64 = text.trim().parse().map_err(|_| format!("{text:?} is not a number"))?;
        if value.is_finite() { check(value) } else { Err(format!("{value} is not finite")) }
    };
    let parts: Vec<&str> = text.split(':').collect();
    let values = match parts[..] {
        [list] => list.split(',').map(number).collect::<Result<_, _>>()?,
        [from, to, step] => {
            let (from, to, step) = (number(from)?, number(to)?, number(step)?);
            let count = if step > 0.0 { (to - from) / step } else { f64::NAN };
            if !(0.0..=MOST_POINTS as f64).contains(&count) {
                return Err(format!(
                    "{text}: from {from} to {to} in steps of {step} is no reasonable number of values"
                ));
            }
            // Half a thousandth of a step: the end belongs to it in spite of rounding.
            (0..=(count + 5e-4) as usize).map(|k| from + k as f64 * step).collect()
        }
        _ => return Err(format!("{text}: expected a list such as 20,30 or FROM:TO:STEP")),
    };
    Ok(Values(values))
}

#[cfg(test)]
mod tests {
    use super::{loads, values};

    #[test]
    fn analytic_a_brake_may_stand_open() {
        assert_eq!(loads("0,110,202").expect("a list").0, [0.0, 110.0, 202.0]);
        assert_eq!(loads("0:20:10").expect("a range").0, [0.0, 10.0, 20.0]);
        for wrong in ["-1", "0:10:0", "nan"] {
            assert!(loads(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn analytic_ranges_include_their_ends() {
        assert_eq!(values("0.1:0.3:0.1").expect("a range").0.len(), 3);
        assert_eq!(values("10:40:15").expect("a range").0, [10.0, 25.0, 40.0]);
        assert_eq!(values("20, 30").expect("a list").0, [20.0, 30.0]);
        for wrong in ["", "x", "-5", "10:40", "40:10:5", "1:2:0", "1:1e9:1e-9", "nan"] {
            assert!(values(wrong).is_err(), "{wrong}");
        }
    }
}
