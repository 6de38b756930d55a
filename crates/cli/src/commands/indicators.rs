//! `gearwatch indicators BENCH FILE…`: condition indicators beside the mesh harmonics.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use gearwatch_core::indicators::table::{self, IndicatorTable};
use gearwatch_core::pipeline::{Pipeline, PipelineConfig};

use super::Run;
use crate::exit::Exit;
use crate::input::Input;
use crate::terminal;

mod band;
mod rows;

/// Condition indicators of recordings: RMS, kurtosis, FM0, FM4, NA4, NB4, M6A, M8A, sidebands,
/// envelope
///
/// Means over the windows of each recording and channel, with their standard errors. Windows with
/// an instrument fault are left out. With --healthy each number is compared with the same one of
/// recordings that are called normal, and NA4* and NB4* are known. What each indicator is:
/// docs/indicators.md.
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch indicators bench.toml today.mcap
  gearwatch indicators bench.toml today.mcap --healthy january.mcap february.mcap
  gearwatch indicators bench.toml today.mcap --window 10        more turns of slow shafts in each average
  gearwatch indicators bench.toml *.mcap --csv > indicators.csv
  gearwatch indicators bench.toml today.mcap --kurtogram        which band rings

Exit codes: 0 done; 3 unknown: bad input, or no window of a recording could be used.")]
pub struct Indicators {
    /// Bench file
    #[arg(value_name = "BENCH")]
    bench: PathBuf,
    #[command(flatten)]
    input: Input,
    /// Recordings of the healthy machine, at the same speed and load
    #[arg(long, value_name = "FILE", num_args = 1..)]
    healthy: Vec<PathBuf>,
    /// Length of a window in seconds; windows overlap by half
    #[arg(long, value_name = "S", default_value_t = 1.0)]
    window: f64,
    /// Band of the envelope in Hz, in place of that of the bench file
    #[arg(long, value_name = "LOW:HIGH", value_parser = band::parse)]
    envelope: Option<[f64; 2]>,
    /// Also say in which bands the signal rings most
    #[arg(long)]
    kurtogram: bool,
    /// One JSON object a line
    #[arg(long, conflicts_with = "csv")]
    json: bool,
    /// With a header line
    #[arg(long)]
    csv: bool,
}

impl Run for Indicators {
    const NAME: &'static str = "indicators";
    const COMPUTES: bool = true;

    fn run(self) -> anyhow::Result<Exit> {
        let mut bench = gearwatch_io::bench_file::read(&self.bench)?;
        super::check::before("indicators", &bench, &self.input.files, &self.input.options, None)?;
        if !(self.window.is_finite() && self.window > 0.0) {
            bail!("--window is {}; expected a length above 0 s", self.window);
        }
        if self.envelope.is_some() {
            bench.indicators.envelope_hz = self.envelope;
        }
        if !bench.bearings.is_empty() && bench.indicators.envelope_hz.is_none() {
            let first = self.input.files.first().context("no recording")?;
            let bands = band::of(first, &self.input.options, &self.config())?;
            let best = bands.first().context("the recording is too short for a kurtogram")?;
            bench.indicators.envelope_hz = Some([best.low_hz, best.high_hz]);
            writeln!(
                terminal::err(),
                "gearwatch indicators: the bench file has no indicators.envelope_hz; the kurtogram of {} proposes {:.0} to {:.0} Hz",
                first.display(),
                best.low_hz,
                best.high_hz
            )?;
        }
        let pipeline = Pipeline::new(&bench, &self.config(), None)?;
        let mut table = IndicatorTable::new(&pipeline);
        // The healthy recordings come first: NA4* is normalised by them.
        for path in &self.healthy {
            let windows = table.healthy(&mut self.input.options.open(path)?)?;
            self.refuse_short(path, windows)?;
        }
        let (mut rows, mut refused) = (Vec::new(), Vec::new());
        let mut exit = Exit::Ok;
        for path in &self.input.files {
            let found = table.recording(&gearwatch_sources::name_of(path), &mut self.input.options.open(path)?)?;
            self.refuse_short(path, found.windows)?;
            if !found.usable {
                exit = Exit::Unknown;
            }
            rows.extend(found.rows);
            refused.extend(found.refused.into_iter().map(|one| (path, one)));
        }
        let mut out = std::io::BufWriter::new(terminal::coloured());
        match (self.json, self.csv) {
            (true, _) => rows::json(&mut out, &rows)?,
            (_, true) => rows::csv(&mut out, &rows)?,
            _ => rows::table(&mut out, &rows, &bench.indicators)?,
        }
        if self.kurtogram {
            for path in &self.input.files {
                band::print(&mut out, path, &band::of(path, &self.input.options, &self.config())?)?;
            }
        }
        out.flush()?;
        for (path, (channel, why, count, of)) in refused {
            writeln!(
                terminal::err(),
                "{}: channel {channel:?}: {count} of {of} windows left out: {why}",
                terminal::plain(&path.display().to_string())
            )?;
        }
        Ok(exit)
    }
}

impl Indicators {
    fn config(&self) -> PipelineConfig {
        table::settings(self.window)
    }

    fn refuse_short(&self, path: &Path, windows: u64) -> anyhow::Result<()> {
        if windows == 0 {
            bail!(
                "{}: no channel has {} s without a gap; expected at least one window (--window takes a shorter one)",
                path.display(),
                self.window
            );
        }
        Ok(())
    }
}
