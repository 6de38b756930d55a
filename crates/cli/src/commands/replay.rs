//! `gearwatch replay FILE`: a recording through the same engine as the service, one JSON object a
//! window.

use std::path::PathBuf;

use clap::Args;
use gearwatch_daemon::config::Config;
use gearwatch_sources::Speed;

use super::Run;
use crate::exit::Exit;
use crate::serve::serve;

/// Play a recording through the service: one JSON object a window on standard output
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch replay run-up.mcap --bench bench.toml --baseline normal.json
  gearwatch replay run-up.mcap --bench bench.toml --speed 1       as fast as it was recorded
  gearwatch replay run-up.mcap --bench bench.toml | head -1       the first verdict only

The lines are those of `gearwatch run` on the same data, byte for byte. Exit codes: 0 played to the end or stopped; 3 bad input.")]
pub struct Replay {
    /// Recording of any format that can be read (`gearwatch list`)
    file: PathBuf,
    /// Bench file
    #[arg(short, long, value_name = "FILE")]
    bench: PathBuf,
    /// Baseline file; without one every rank is `unknown`
    #[arg(short = 'n', long, value_name = "FILE")]
    baseline: Option<PathBuf>,
    /// Fault states of this bench (`gearwatch signatures --out`) to match verdicts with, in place
    /// of the paper's table
    #[arg(long, value_name = "FILE")]
    signatures: Option<PathBuf>,
    /// Seconds of recording per second, or `max`
    #[arg(short, long, default_value = "max")]
    speed: Speed,
    /// Threads for the spectra; 0: one a core. The lines do not depend on it
    #[arg(short, long, default_value_t = 0, value_name = "N")]
    workers: usize,
}

impl Run for Replay {
    const NAME: &'static str = "replay";

    fn run(self) -> anyhow::Result<Exit> {
        let config = Config::of_recording(
            &self.file,
            &self.bench,
            self.baseline.as_deref(),
            self.signatures.as_deref(),
            self.speed,
            self.workers,
        )?;
        serve(config, true, None)
    }
}
