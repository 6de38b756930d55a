//! `gearwatch simulate BENCH`: a simulated recording, with and without effects.

use std::ffi::OsStr;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::builder::{PossibleValue, StringValueParser, TypedValueParser};
use clap::{Arg, Args, Command};
use gearwatch_core::bench::{Bench, EffectSpec};
use gearwatch_core::recording::Recording;
use gearwatch_core::source::Source;
use gearwatch_io::mcap::{Compression, McapWriter, PublishTime};
use gearwatch_io::output::Target;
use gearwatch_io::text::read_text;
use gearwatch_sim::scenario::{ContactLaw, Course, Scenario};
use gearwatch_sim::source::{SimConfig, Simulator};

use super::Run;
use crate::exit::Exit;
use crate::output::OutputOptions;
use crate::terminal;

mod plot;

pub(super) use self::plot::{Form, form, stacked};

/// 2026-01-01T00:00:00Z: the same seed gives the same bytes, so the recording cannot carry today's
/// date.
pub(super) const START_NS: i64 = 1_767_225_600_000_000_000;
/// Without an end a scenario is cut here (s).
const DEFAULT_DURATION_S: f64 = 10.0;

/// Simulate a bench, with or without faults, into a recording
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch simulate paper-rig -o healthy.mcap --duration 30
  gearwatch simulate bench.toml --effect tooth_breakage@stage1.pinion:fraction=0.6 -o broken.mcap
  gearwatch simulate bench.toml --effect eccentricity@stage1.wheel:runout_um=30 --effect unbalance@input \\
      --speed 20 --torque 40 --seed 7 -o out.mcap --plot out.svg
  gearwatch simulate paper-rig --background 0.2 -o noisy.mcap
  gearwatch simulate single-pair --scenario run-up.toml -o run-up.mcap --plot run-up.html

Benches that come with the program: single-pair, paper-rig, spectraquest-like, helical-two-stage, planetary-parallel,
bending-shafts.
Bevel and worm gears cannot be simulated, and profile shift only of external pairs whose file states it
(profile_shift, centre_distance_mm); any other such bench is refused (exit 3).
`gearwatch list` shows the effects.")]
pub struct Simulate {
    /// Bench file, or the name of a bench that comes with the program
    bench: PathBuf,
    /// ID@PLACE:PARAMETER=VALUE,… ; a parameter that is left out takes its typical value. Also a
    /// state of the rank paper: compound_3@stage1.pinion
    #[arg(long, value_name = "EFFECT", value_parser = EffectText, hide_possible_values = true)]
    effect: Vec<String>,
    /// Motor speed, in Hz or as 1500rpm; the bench's nominal one where left out
    #[arg(long, value_name = "HZ|RPM", value_parser = gearwatch_core::speed::parse_speed_hz)]
    speed: Option<f64>,
    /// Brake torque (N m); the bench's nominal one where left out
    #[arg(long, value_name = "NM")]
    torque: Option<f64>,
    /// Length (s); the scenario's, or 10 s
    #[arg(long, value_name = "S")]
    duration: Option<f64>,
    /// White noise of the machine at every sensor (m/s², standard deviation a sample); the
    /// scenario's, or the 0.004 of a quiet one
    #[arg(long, value_name = "M_PER_S2")]
    background: Option<f64>,
    /// Law of the tooth contacts; the scenario's, or elastic. impact is that of the rank paper's
    /// simulation
    #[arg(long, value_enum)]
    contact: Option<Contact>,
    /// Draws where the train starts, noise and jitter; the same seed gives the same bytes
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Scenario file: profiles of speed and torque, faults that set in, sensors that fail
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// Recording to write (.mcap)
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Picture of waveform, order spectrum and mesh stiffness to write (.svg or .html)
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OutputOptions,
}

/// Any text, read later with its bench; a shell that completes it offers the ids of the effects.
#[derive(Clone)]
struct EffectText;

impl TypedValueParser for EffectText {
    type Value = String;

    fn parse_ref(&self, command: &Command, arg: Option<&Arg>, value: &OsStr) -> Result<String, clap::Error> {
        StringValueParser::new().parse_ref(command, arg, value)
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(gearwatch_sim::effects::every().map(|e| PossibleValue::new(e.id()).help(e.help()))))
    }
}

/// Law of the tooth contacts, as typed.
#[derive(Clone, Copy, Debug, Default, clap::ValueEnum)]
pub(super) enum Contact {
    /// Elastic tooth pairs
    #[default]
    Elastic,
    /// ADAMS' IMPACT with the usual parameters
    Impact,
}

impl Contact {
    pub(super) fn law(self) -> ContactLaw {
        match self {
            Self::Elastic => ContactLaw::Elastic,
            Self::Impact => ContactLaw::Impact,
        }
    }
}

impl Run for Simulate {
    const NAME: &'static str = "simulate";
    const COMPUTES: bool = true;

    fn run(self) -> anyhow::Result<Exit> {
        if self.output.is_none() && self.plot.is_none() {
            bail!("nothing to write: give -o FILE.mcap, --plot FILE.svg, or both");
        }
        // Names that cannot be right are refused before minutes of computing, not after.
        let form = self.plot.as_deref().map(plot::form).transpose()?;
        if let Some(path) = self.output.as_ref().filter(|path| path.extension().is_none_or(|end| end != "mcap")) {
            bail!("{}: the recording is written as MCAP; the name must end in .mcap", path.display());
        }
        let mut outputs = self.overwrite.reading([&self.bench]).reading(&self.scenario);
        let output = self.output.as_deref().map(|path| outputs.target(path)).transpose()?;
        let plot = self.plot.as_deref().map(|path| outputs.target(path)).transpose()?;
        let config = self.config()?;
        let mut simulator = Simulator::new(config.clone()).with_context(|| self.bench.display().to_string())?;
        let mut err = terminal::err();
        for warning in simulator.warnings() {
            writeln!(err, "gearwatch simulate: {}: {warning}", self.bench.display()).context("stderr")?;
        }
        let plotted = plot::PLOTTED_S;
        let mut recording = Recording { name: config.bench.name.clone(), ..Recording::default() };
        let mut keep = |packet: &gearwatch_core::block::Packet| {
            let held = recording.channels.values().map(gearwatch_core::recording::Channel::len).max().unwrap_or(0);
            if self.plot.is_some() && (held as f64) < plotted * config.bench.acquisition.sample_rate_hz {
                recording.push(packet.clone());
            }
        };
        match output {
            Some(target) => write(target, &mut simulator, &mut keep)?,
            None => {
                while let Some(packet) = simulator.next_packet()? {
                    keep(&packet);
                }
            }
        }
        if let Some((target, form)) = plot.zip(form) {
            target.write(plot::picture(form, &recording, &config, simulator.model())?)?;
        }
        Ok(Exit::Ok)
    }
}

impl Simulate {
    fn config(&self) -> anyhow::Result<SimConfig> {
        let bench = read_bench(&self.bench)?;
        let effects = self.effect.iter().map(|text| parse_effect(text)).collect::<anyhow::Result<Vec<_>>>()?;
        let mut scenario = match &self.scenario {
            Some(path) => {
                let text = read_text(path).with_context(|| format!("{}: cannot be read", path.display()))?;
                toml::from_str(&text)
                    .map_err(|e| anyhow::anyhow!("{}: {}", path.display(), e.to_string().trim_end()))?
            }
            None => Scenario::default(),
        };
        if let Some(hz) = self.speed {
            scenario.motor_speed_hz = Some(Course::Constant(hz));
        }
        if let Some(nm) = self.torque {
            scenario.brake_torque_nm = Some(Course::Constant(nm));
        }
        scenario.background_m_per_s2 = self.background.or(scenario.background_m_per_s2);
        if let Some(contact) = self.contact {
            scenario.contact_law = contact.law();
        }
        scenario.duration_s = Some(self.duration.or(scenario.duration_s).unwrap_or(DEFAULT_DURATION_S));
        Ok(SimConfig { bench, effects, scenario, seed: self.seed, t0: START_NS })
    }
}

/// A bench file, or a bench that comes with the program where there is no such file.
pub(super) fn read_bench(path: &Path) -> anyhow::Result<Bench> {
    if !path.exists() {
        if let Some(bench) = path.to_str().and_then(gearwatch_sim::shipped::bench) {
            return Ok(bench);
        }
        let names: Vec<_> = gearwatch_sim::shipped::BENCHES.iter().map(|shipped| shipped.name).collect();
        bail!("{}: no such file, and no bench that comes with the program ({})", path.display(), names.join(", "));
    }
    Ok(gearwatch_io::bench_file::read(path)?)
}

/// `id@place:parameter=value,parameter=value`.
pub(super) fn parse_effect(text: &str) -> anyhow::Result<EffectSpec> {
    let form = "expected ID@PLACE or ID@PLACE:PARAMETER=VALUE,PARAMETER=VALUE";
    let (effect, rest) = text.split_once('@').with_context(|| format!("--effect {text:?}: {form}"))?;
    let (place, parameters) = rest.split_once(':').unwrap_or((rest, ""));
    let parameters = parameters
        .split(',')
        .filter(|part| !part.is_empty())
        .map(|part| {
            let (name, value) = part.split_once('=').with_context(|| format!("--effect {text:?}: {form}"))?;
            let number =
                value.trim().parse().map_err(|_| anyhow::anyhow!("--effect {text:?}: {value:?} is not a number"))?;
            Ok((name.trim().to_owned(), number))
        })
        .collect::<anyhow::Result<_>>()?;
    Ok(EffectSpec { effect: effect.trim().to_owned(), place: place.trim().to_owned(), parameters })
}

fn write(
    target: Target,
    simulator: &mut Simulator,
    keep: &mut dyn FnMut(&gearwatch_core::block::Packet),
) -> anyhow::Result<()> {
    let mut writer = McapWriter::new(target.create()?, Compression::Zstd, PublishTime::LogTime)?;
    while let Some(packet) = simulator.next_packet()? {
        keep(&packet);
        writer.write(&packet)?;
    }
    Ok(writer.finish()?.finish()?)
}
