//! `gearwatch batch`: many recordings to one Parquet file a shard.

use std::io::Write;
use std::num::NonZeroUsize;
use std::path::PathBuf;

use anyhow::{Context, bail};
use clap::Args;
use gearwatch_batch::run::{Job, Outcome, Summary};
use gearwatch_batch::shard::Shard;
use gearwatch_batch::{run, worklist};
use gearwatch_core::pipeline::{Pipeline, PipelineConfig};
use gearwatch_io::{baseline_file, bench_file};
use indicatif::{ProgressBar, ProgressStyle};

use super::Run;
use crate::exit::Exit;
use crate::input::InputOptions;

/// Judge many recordings: one Parquet file a shard
///
/// One row a window, channel and stage, with ranks, signed deviations and their sigmas, amplitudes, floors and states. Recordings whose
/// content was worked before with the same settings are skipped; a killed shard goes on where it was; files appear whole or not at all.
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch batch recordings/ --bench bench.toml --baseline normal.json --out ranks/
  gearwatch batch --manifest list.txt --bench bench.toml --baseline normal.json --out ranks/ --shard 3/10
  sbatch --array=1-10 --wrap 'gearwatch batch --manifest list.txt --bench bench.toml --out ranks/'
  duckdb -c \"select channel, rank_1x, count(*) from 'ranks/*.parquet' group by all\"

Exit codes: 0 all recordings done; 3 damaged recordings were passed over, or bad input.")]
pub struct Batch {
    /// Recordings, or folders that are searched for them
    #[arg(value_name = "PATH", required_unless_present = "manifest")]
    paths: Vec<PathBuf>,
    /// Text file with one recording a line, relative to its own folder
    #[arg(long, value_name = "FILE", conflicts_with = "paths")]
    manifest: Option<PathBuf>,
    /// Bench file
    #[arg(short, long, value_name = "FILE")]
    bench: PathBuf,
    /// Baseline file; without one every rank is `unknown`
    #[arg(short = 'n', long, value_name = "FILE")]
    baseline: Option<PathBuf>,
    /// Folder for the parts
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,
    /// Work every N-th recording, beginning with the I-th; in a Slurm array job the array's index by default
    #[arg(long, value_name = "I/N")]
    shard: Option<Shard>,
    /// Threads; one a core by default
    #[arg(short, long, value_name = "N")]
    jobs: Option<NonZeroUsize>,
    #[command(flatten)]
    input: InputOptions,
}

impl Run for Batch {
    const NAME: &'static str = "batch";

    fn run(self) -> anyhow::Result<Exit> {
        let shard = match self.shard {
            Some(shard) => shard,
            None => Shard::from_slurm(|name| std::env::var(name).ok())?,
        };
        let bench = bench_file::read(&self.bench)?;
        let config = PipelineConfig::default();
        let baseline = match &self.baseline {
            Some(path) => Some(baseline_file::read_for(path, &bench, config.window.length_s)?),
            None => None,
        };
        let options = self.input.open_options();
        // Whatever changes a row is in here, so that rows of other settings are never taken for done.
        let baseline_text = self.baseline.as_ref().map(std::fs::read_to_string).transpose().context("baseline")?;
        let settings = format!(
            "gearwatch {}\n{}\n{baseline_text:?}\n{}\n{options:?}",
            env!("CARGO_PKG_VERSION"),
            baseline_file::bench_sha256(&bench),
            serde_json::to_string(&config)?,
        );
        let pipeline = Pipeline::new(&bench, &config, baseline)?;
        let recordings = match &self.manifest {
            Some(manifest) => worklist::from_manifest(manifest)?,
            None => worklist::from_folders(&self.paths, &endings())?,
        };
        if recordings.is_empty() {
            bail!("there is no recording to work");
        }
        let cores = std::thread::available_parallelism().map_or(1, NonZeroUsize::get);
        let job = Job {
            recordings: &recordings,
            shard,
            folder: &self.out,
            pipeline: &pipeline,
            options: &options,
            settings: &settings,
            threads: self.jobs.map_or(cores, NonZeroUsize::get),
        };
        let mine = (0..recordings.len()).filter(|&position| shard.holds(position)).count();
        let bar = ProgressBar::new(mine as u64);
        if let Ok(style) = ProgressStyle::with_template("shard {prefix} {wide_bar} {pos}/{len} {eta}  {msg}") {
            bar.set_style(style.clone());
        }
        bar.set_prefix(shard.to_string());
        let summary = run::run(&job, &|path, _| {
            bar.set_message(path.file_name().unwrap_or_default().to_string_lossy().into_owned());
            bar.inc(1);
        });
        bar.finish_and_clear();
        report(&summary?, shard)
    }
}

/// Endings of the names of recordings, of all formats that can be read.
fn endings() -> Vec<&'static str> {
    gearwatch_io::formats::FORMATS.iter().flat_map(|format| format.extensions().iter().copied()).collect()
}

fn report(summary: &Summary, shard: Shard) -> anyhow::Result<Exit> {
    let count = |is: fn(&Outcome) -> bool| summary.outcomes.iter().filter(|(_, outcome)| is(outcome)).count();
    let rows: usize = summary.outcomes.iter().map(|(_, o)| if let Outcome::Done(rows) = o { *rows } else { 0 }).sum();
    let damaged = summary.damaged().count();
    let mut out = std::io::stdout().lock();
    writeln!(
        out,
        "shard {shard}: {} recordings judged ({rows} rows), {} known from before, {damaged} damaged: {}",
        count(|o| matches!(o, Outcome::Done(_))),
        count(|o| matches!(o, Outcome::Known)),
        summary.part.display()
    )?;
    let mut talk = std::io::stderr().lock();
    for (path, why) in summary.damaged() {
        let shown = path.display().to_string();
        let why = why.strip_prefix(&format!("{shown}: ")).unwrap_or(why);
        writeln!(talk, "passed over: {shown}: {why}")?;
    }
    Ok(if damaged == 0 { Exit::Ok } else { Exit::Unknown })
}
