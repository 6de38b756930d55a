//! `gearwatch indicators BENCH FILE…`: condition indicators beside the mesh harmonics.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use gearwatch_core::bench::Bench;
use gearwatch_core::estimate::Estimate;
use gearwatch_core::indicators::columns::{Column, Mean, columns};
use gearwatch_core::indicators::running::{Reading, Running};
use gearwatch_core::one_shot::each_window;
use gearwatch_core::pipeline::{Pipeline, PipelineConfig};
use gearwatch_core::verdict::InstrumentState;
use gearwatch_daemon::checking;
use gearwatch_io::ReadError;

use super::Run;
use crate::exit::Exit;
use crate::input::{Input, InputOptions};
use crate::terminal;

mod band;
mod moments;
mod rows;

use moments::{Moments, NAMES};
use rows::Row;

/// Condition indicators of recordings: RMS, kurtosis, FM0, FM4, NA4, NB4, M6A, M8A, sidebands, envelope
///
/// Means over the windows of each recording and channel, with their standard errors. Windows with an instrument fault are left out. With --healthy each number is
/// compared with the same one of recordings that are called normal, and NA4* and NB4* are known. What each indicator is: docs/indicators.md.
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

/// What is collected of one channel of one recording.
struct Channel {
    name: String,
    unit: String,
    means: Vec<Mean>,
    moments: Vec<Moments>,
    speed: Mean,
    windows: u64,
    refused: BTreeMap<&'static str, u64>,
}

/// NA4, NB4, NA4*, NB4* of a reading of residual signal and envelope, by channel and gear.
type Normalise<'a> = &'a mut dyn FnMut(&str, usize, [Reading; 2]) -> [Estimate; 4];

/// By channel and gear: variances of residual and envelope over readings.
type History = BTreeMap<(String, usize), [Running; 2]>;

impl Run for Indicators {
    const NAME: &'static str = "indicators";

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
        let columns = columns(&bench);

        // The healthy recordings come first: NA4* is normalised by them.
        let mut reference = History::new();
        let mut healthy = Vec::new();
        for path in &self.healthy {
            healthy.extend(self.channels(path, &pipeline, columns.len(), &mut |channel, gear, reading| {
                let running = reference.entry((channel.to_owned(), gear)).or_default();
                running.iter_mut().zip(reading).for_each(|(running, reading)| {
                    running.push(&reading);
                });
                [Estimate::UNKNOWN; 4]
            })?);
        }
        let mut history = History::new();
        let mut all = Vec::new();
        let mut exit = Exit::Ok;
        for path in &self.input.files {
            let channels = self.channels(path, &pipeline, columns.len(), &mut |channel, gear, reading| {
                let key = (channel.to_owned(), gear);
                let star = reference.get(&key);
                let running = history.entry(key).or_default();
                let [na4, nb4] = [0, 1].map(|i| running[i].push(&reading[i]));
                let [na4_star, nb4_star] =
                    [0, 1].map(|i| star.map_or(Estimate::UNKNOWN, |star| star[i].star(&reading[i])));
                [na4, nb4, na4_star, nb4_star]
            })?;
            for channel in channels {
                if channel.speed.count() == 0 {
                    exit = Exit::Unknown;
                }
                all.push((path.clone(), channel));
            }
        }
        let rows = self.rows(&bench, &columns, &all, &healthy);
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
        for (path, channel) in &all {
            for (why, count) in &channel.refused {
                writeln!(
                    terminal::err(),
                    "{}: channel {:?}: {count} of {} windows left out: {why}",
                    terminal::plain(&path.display().to_string()),
                    channel.name,
                    channel.windows
                )?;
            }
        }
        Ok(exit)
    }
}

impl Indicators {
    fn config(&self) -> PipelineConfig {
        let mut config = PipelineConfig::default();
        config.window.length_s = self.window;
        config.window.hop_s = 0.5 * self.window;
        config.indicators = true;
        config.gear_indicators_every = 1;
        config
    }

    /// All windows of a recording, a channel each. `normalise` is asked for NA4, NB4, NA4*, NB4* of each reading of a gear, in order.
    fn channels(
        &self,
        path: &Path,
        pipeline: &Pipeline,
        columns: usize,
        normalise: Normalise<'_>,
    ) -> anyhow::Result<Vec<Channel>> {
        let options: &InputOptions = &self.input.options;
        let mut source = options.open(path)?;
        let gears = 2 * pipeline.train().stages.len();
        let mut out: Vec<Channel> = Vec::new();
        each_window::<_, ReadError>(pipeline, &mut source, &mut |window, analysis| {
            let at = out.iter().position(|c| *c.name == *window.sensor).unwrap_or_else(|| {
                out.push(Channel::new(&window.sensor, &window.unit, columns, gears));
                out.len() - 1
            });
            let channel = &mut out[at];
            channel.windows += 1;
            if analysis.instrument != InstrumentState::Ok {
                *channel.refused.entry(analysis.instrument.code()).or_default() += 1;
                return Ok(());
            }
            channel.speed.push(analysis.input_speed_hz);
            channel.means.iter_mut().zip(analysis.indicators.row()).for_each(|(mean, x)| mean.push(x));
            for (gear, indicators) in analysis.indicators.gears.iter().flatten().enumerate() {
                let values = normalise(&window.sensor, gear, Moments::readings(indicators));
                channel.moments[gear].push(values, indicators.revolutions);
            }
            Ok(())
        })?;
        if out.is_empty() {
            bail!(
                "{}: no channel has {} s without a gap; expected at least one window (--window takes a shorter one)",
                path.display(),
                self.window
            );
        }
        Ok(out)
    }

    fn rows(&self, bench: &Bench, columns: &[Column], all: &[(PathBuf, Channel)], healthy: &[Channel]) -> Vec<Row> {
        let mut out = Vec::new();
        for (path, channel) in all {
            let normal: Vec<&Channel> = healthy.iter().filter(|h| h.name == channel.name).collect();
            let base = |place: &str, name: &str, unit: &str, mean: Mean, revolutions: u32| Row {
                recording: checking::name_of(path),
                channel: channel.name.clone(),
                place: place.to_owned(),
                indicator: name.to_owned(),
                unit: unit.to_owned(),
                value: mean.estimate(0.5),
                windows: mean.count(),
                revolutions,
                speed_hz: channel.speed.estimate(0.5),
                normal: Estimate::UNKNOWN,
            };
            for (i, column) in columns.iter().enumerate() {
                let gear = i.checked_sub(gearwatch_core::indicators::CHANNEL_INDICATORS);
                let gear = gear.map(|i| i / gearwatch_core::indicators::GEAR_INDICATORS);
                let revolutions = gear.and_then(|g| channel.moments.get(g)).map_or(0, |m| m.revolutions);
                let unit = column.unit.text(&channel.unit);
                let mut row = base(&column.place, column.name, unit, channel.means[i], revolutions);
                row.normal = rows::normal(normal.iter().map(|h| h.means[i]));
                out.push(row);
                // The four that need a history stand behind the last of their gear.
                let last = column.name == gearwatch_core::indicators::GearIndicator::SidebandRatio.name();
                if let (true, Some(gear)) = (last, gear) {
                    let moments = &channel.moments[gear];
                    for (name, mean) in NAMES.iter().zip(moments.means) {
                        out.push(base(&column.place, name, "1", mean, revolutions));
                    }
                }
            }
        }
        debug_assert!(bench.stages.len() * 2 <= columns.len());
        out
    }
}

impl Channel {
    fn new(name: &str, unit: &str, columns: usize, gears: usize) -> Self {
        Self {
            name: name.to_owned(),
            unit: unit.to_owned(),
            means: vec![Mean::default(); columns],
            moments: vec![Moments::default(); gears],
            speed: Mean::default(),
            windows: 0,
            refused: BTreeMap::new(),
        }
    }
}
