//! `gearwatch batch`: many recordings, or many cases, to one Parquet file a shard.

use std::io::Write;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use gearwatch_batch::explaining::Explaining;
use gearwatch_batch::judging::Judging;
use gearwatch_batch::part::{PartError, sha256_of};
use gearwatch_batch::run::{Job, Outcome, Summary, Work, run};
use gearwatch_batch::shard::Shard;
use gearwatch_batch::worklist::{self, Items};
use gearwatch_core::pipeline::PipelineConfig;
use gearwatch_io::{baseline_file, bench_file};

use super::Run;
use crate::exit::Exit;
use crate::input::{self, InputOptions};
use crate::memory;
use crate::output::OutputOptions;
use crate::progress::Progress;
use crate::terminal;

/// Judge many recordings, or explain many cases: one Parquet file a shard
///
/// Of recordings, one row a window, channel and stage, with ranks, signed deviations and their
/// sigmas, amplitudes, floors and states. Each is checked first as by `gearwatch check`: what is
/// wrong is passed over, what is doubtful stands in the column `doubts`. Of cases (folders with
/// bench.toml, recordings/ and perhaps reference/), one row a case, with the answer of
/// `gearwatch explain`. What was worked before with the same settings is known by its content and
/// skipped; a killed shard goes on where it was; files appear whole or not at all. A part of other
/// settings is replaced only with --force.
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch batch recordings/ --bench bench.toml --baseline normal.json --out ranks/
  gearwatch batch --manifest list.txt --bench bench.toml --baseline normal.json --out ranks/ --shard 3/10
  sbatch --array=1-10 --wrap 'gearwatch batch --manifest list.txt --bench bench.toml --out ranks/'
  gearwatch batch --cases cases/ --out answers/
  duckdb -c \"select channel, rank_1x, count(*) from 'ranks/*.parquet' group by all\"

Exit codes: 0 all done; 3 something was passed over (it is named on stderr), or bad input. On a full disk what was finished is kept, and the \
same command goes on with it.")]
pub struct Batch {
    /// Recordings, or folders that are searched for them
    #[arg(value_name = "PATH", required_unless_present = "manifest")]
    paths: Vec<PathBuf>,
    /// Text file with one recording (or case) a line, relative to its own folder
    #[arg(long, value_name = "FILE", conflicts_with = "paths")]
    manifest: Option<PathBuf>,
    /// The paths are cases, or folders of cases: explain each
    #[arg(long, conflicts_with_all = ["bench", "baseline", "signatures", "any_rate", "InputOptions"])]
    cases: bool,
    /// Bench file
    #[arg(short, long, value_name = "FILE", required_unless_present = "cases")]
    bench: Option<PathBuf>,
    /// Baseline file; without one every rank is `unknown`
    #[arg(short = 'n', long, value_name = "FILE")]
    baseline: Option<PathBuf>,
    /// Fault states of this bench (`gearwatch signatures --out`) to match verdicts with, in place
    /// of the paper's table
    #[arg(long, value_name = "FILE")]
    signatures: Option<PathBuf>,
    /// Also judge recordings whose sample rate is not that of the bench file
    #[arg(long)]
    any_rate: bool,
    /// Folder for the parts
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,
    /// Work every N-th recording, beginning with the I-th; in a Slurm array job the array's index
    /// by default
    #[arg(long, value_name = "I/N")]
    shard: Option<Shard>,
    /// Threads; one a core by default
    #[arg(short, long, value_name = "N")]
    jobs: Option<NonZeroUsize>,
    #[command(flatten)]
    input: InputOptions,
    #[command(flatten)]
    output: OutputOptions,
}

impl Run for Batch {
    const NAME: &'static str = "batch";
    const COMPUTES: bool = true;

    fn run(self) -> anyhow::Result<Exit> {
        let shard = match self.shard {
            Some(shard) => shard,
            None => Shard::from_slurm(|name| std::env::var(name).ok())?,
        };
        match &self.bench {
            Some(bench) => self.judge(bench, shard),
            None => self.explain(shard),
        }
    }
}

impl Batch {
    fn judge(&self, bench: &Path, shard: Shard) -> anyhow::Result<Exit> {
        let bench = bench_file::read(bench)?;
        let config = PipelineConfig::default();
        let baseline = match &self.baseline {
            Some(path) => Some(baseline_file::read_for(path, &bench, config.window.length_s)?),
            None => None,
        };
        let digest = |path: &Option<PathBuf>| path.as_deref().map(sha256_of).transpose().map(Option::unwrap_or_default);
        let (baseline_sha256, signatures_sha256) = (digest(&self.baseline)?, digest(&self.signatures)?);
        let options = self.input.open_options();
        // Whatever changes a row is in here, so that rows of other settings are never taken for
        // done.
        let settings = format!(
            "gearwatch {}\njudging, checked {}\n{baseline_sha256}\n{signatures_sha256}\n{}\n{options:?}\n{}",
            env!("CARGO_PKG_VERSION"),
            baseline_file::bench_sha256(&bench),
            serde_json::to_string(&config)?,
            self.any_rate,
        );
        let normal = baseline.clone();
        let pipeline = input::pipeline(&bench, baseline, self.signatures.as_deref())?;
        let recordings = match &self.manifest {
            Some(manifest) => worklist::from_manifest(manifest, Items::Recordings)?,
            None => worklist::from_folders(&self.paths, &endings())?,
        };
        let sample_rate_hz = Some(bench.acquisition.sample_rate_hz).filter(|_| !self.any_rate);
        let work = Judging {
            pipeline: &pipeline,
            baseline: normal.as_ref(),
            options: &options,
            baseline_sha256,
            sample_rate_hz,
        };
        self.work(&work, &recordings, shard, &settings, Items::Recordings)
    }

    fn explain(&self, shard: Shard) -> anyhow::Result<Exit> {
        let cases = match &self.manifest {
            Some(manifest) => worklist::from_manifest(manifest, Items::Cases)?,
            None => worklist::cases(&self.paths)?,
        };
        let settings = format!("gearwatch {}\nexplaining", env!("CARGO_PKG_VERSION"));
        self.work(&Explaining { endings: &endings() }, &cases, shard, &settings, Items::Cases)
    }

    fn work(
        &self,
        work: &impl Work,
        items: &[PathBuf],
        shard: Shard,
        settings: &str,
        kind: Items,
    ) -> anyhow::Result<Exit> {
        if items.is_empty() {
            bail!("there is nothing to work: the list of {} is empty", kind.name());
        }
        let cores = std::thread::available_parallelism().map_or(1, NonZeroUsize::get);
        let threads = self.jobs.map_or(cores, NonZeroUsize::get);
        let thread_begins = memory::keep_in_this_thread;
        let folder = &self.out;
        let job = Job { items, shard, folder, settings, threads, thread_begins, replace: self.output.force() };
        let mine = (0..items.len()).filter(|&position| shard.holds(position)).count();
        let progress = Progress::new(format!("shard {shard}"), mine as u64);
        let summary = run(&job, work, &|path, _| {
            progress.finished(&path.file_name().unwrap_or_default().to_string_lossy());
        });
        drop(progress);
        match summary {
            Ok(summary) => report(&summary, shard, kind),
            Err(error @ (PartError::Io { .. } | PartError::Parquet { .. })) => Err(error)
                .context("the work ended early; what was finished is kept, and the same command goes on with it"),
            Err(error) => Err(error.into()),
        }
    }
}

/// Endings of the names of recordings, of all formats that can be read.
fn endings() -> Vec<&'static str> {
    gearwatch_io::formats::FORMATS.iter().flat_map(|format| format.extensions().iter().copied()).collect()
}

fn report(summary: &Summary, shard: Shard, kind: Items) -> anyhow::Result<Exit> {
    let count = |is: fn(&Outcome) -> bool| summary.outcomes.iter().filter(|(_, outcome)| is(outcome)).count();
    let rows: usize = summary.outcomes.iter().map(|(_, o)| if let Outcome::Done(rows) = o { *rows } else { 0 }).sum();
    let damaged = summary.damaged().count();
    let mut out = terminal::out();
    writeln!(
        out,
        "shard {shard}: {} {} worked ({rows} rows), {} known from before, {damaged} passed over: {}",
        count(|o| matches!(o, Outcome::Done(_))),
        kind.name(),
        count(|o| matches!(o, Outcome::Known)),
        summary.part.display()
    )?;
    let mut talk = terminal::err();
    for (path, why) in summary.damaged() {
        let shown = path.display().to_string();
        let why = why.strip_prefix(&format!("{shown}: ")).unwrap_or(why);
        writeln!(talk, "passed over: {shown}: {why}")?;
    }
    for path in summary.empty() {
        writeln!(talk, "nothing to judge: {}: no window without a gap", path.display())?;
    }
    for (first, again) in &summary.twins {
        writeln!(talk, "same content: {} and {}: both are in the part", first.display(), again.display())?;
    }
    let complete = damaged == 0 && summary.empty().next().is_none();
    Ok(if complete { Exit::Ok } else { Exit::Unknown })
}
