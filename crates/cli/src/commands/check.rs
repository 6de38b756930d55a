//! `gearwatch check BENCH RECORDING…`: whether sheet, recordings and baseline belong together.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Args;
use gearwatch_check::{self as check, Checked, Look, Severity};
use gearwatch_core::baseline::Baseline;
use gearwatch_core::bench::Bench;
use serde_json::json;

use super::Run;
use crate::exit::Exit;
use crate::format::Format;
use crate::input::InputOptions;

/// Check a bench before its first verdict: rate, speed, teeth, tacho, band, sensors, torque
///
/// Each finding says what was found, what was expected and what to do. What is wrong for sure is
/// refused by `baseline learn`, `diagnose` and `run`; what is doubtful stands in every verdict
/// until it is mended, or cleared by its word in `[check] cleared` of the bench file.
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch check bench.toml                                        the sheet alone
  gearwatch check bench.toml monday-*.mcap
  gearwatch check bench.toml run.csv.gz --sample-rate 12800 --motor-speed 1785rpm --torque 40
  gearwatch check bench.toml today.mcap --baseline normal.json --format json

Exit codes: 0 all fits (notes may stand); 1 something is doubtful; 3 something is wrong, or a file cannot be read.")]
pub struct CheckBench {
    /// Bench file
    bench: PathBuf,
    /// Recordings of the bench
    #[arg(value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    #[command(flatten)]
    options: InputOptions,
    /// Baseline that is to judge the recordings
    #[arg(short = 'n', long, value_name = "FILE")]
    baseline: Option<PathBuf>,
    /// Text for people, or one JSON object
    #[arg(long, value_enum, default_value_t)]
    format: Format,
}

impl Run for CheckBench {
    const NAME: &'static str = "check";
    const COMPUTES: bool = true;

    fn run(self) -> anyhow::Result<Exit> {
        let bench = gearwatch_io::bench_file::read(&self.bench)?;
        let baseline = match &self.baseline {
            Some(path) => {
                let baseline = gearwatch_io::baseline_file::read(path)?;
                let window_s = baseline.window_s;
                gearwatch_io::baseline_file::check_use(&baseline, path, &bench, window_s)?;
                Some(baseline)
            }
            None => None,
        };
        let looks = looks(&self.recordings, &self.options)?;
        let checked = check::check(&bench, &looks, baseline.as_ref());
        let mut out = std::io::stdout().lock();
        match self.format {
            Format::Text => text(&mut out, &self.bench, &looks, &checked),
            Format::Json => {
                let names: Vec<&str> = looks.iter().map(Look::name).collect();
                let object = json!({
                    "format": "gearwatch-check/1", "bench": bench.name, "recordings": names,
                    "worst": checked.worst(), "findings": checked.findings,
                });
                writeln!(out, "{object}")
            }
        }
        .context("standard output")?;
        Ok(match checked.worst() {
            Some(Severity::Wrong) => Exit::Unknown,
            Some(Severity::Doubtful) => Exit::Warning,
            Some(Severity::Note) | None => Exit::Ok,
        })
    }
}

fn text(out: &mut impl std::io::Write, bench: &Path, looks: &[Look], checked: &Checked) -> std::io::Result<()> {
    writeln!(out, "{}, {} recordings", bench.display(), looks.len())?;
    for finding in &checked.findings {
        let word = match finding.severity {
            Severity::Wrong => "wrong",
            Severity::Doubtful => "doubtful",
            Severity::Note => "note",
        };
        writeln!(out, "  {word}: {finding}")?;
    }
    if checked.findings.is_empty() {
        writeln!(out, "  all that was asked fits")?;
    }
    Ok(())
}

/// Looks at each recording.
///
/// # Errors
/// When one cannot be read.
pub fn looks(recordings: &[PathBuf], options: &InputOptions) -> anyhow::Result<Vec<Look>> {
    let options = options.open_options();
    recordings.iter().map(|path| Ok(gearwatch_sources::look(path, &options)?)).collect()
}

/// The check inside other commands: refuses what is wrong, tells what is doubtful on standard
/// error, and hands all of it back. Recordings that cannot be read are told by whoever reads them.
///
/// # Errors
/// When something is wrong for sure.
pub fn before(
    command: &str,
    bench: &Bench,
    recordings: &[PathBuf],
    options: &InputOptions,
    baseline: Option<&Baseline>,
) -> anyhow::Result<Checked> {
    let open = options.open_options();
    let looks: Vec<Look> = recordings.iter().filter_map(|path| gearwatch_sources::look(path, &open).ok()).collect();
    let checked = check::check(bench, &looks, baseline);
    if let Some(refusal) = checked.refusal() {
        anyhow::bail!("{refusal}");
    }
    for finding in checked.of(Severity::Doubtful) {
        let _ = writeln!(std::io::stderr(), "gearwatch {command}: doubtful: {finding}");
    }
    Ok(checked)
}
