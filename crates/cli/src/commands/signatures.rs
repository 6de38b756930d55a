//! `gearwatch signatures`: the fault states of the rank paper, simulated on this bench.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;

use anyhow::{Context, bail};
use clap::{Args, ValueEnum};
use gearwatch_core::bench::Bench;
use gearwatch_core::rank::RankConfig;
use gearwatch_core::signature::{Expected, SignatureTable};
use gearwatch_io::signature_file::{Lines, Point, SignatureFile, State};
use gearwatch_sim::signatures::{self, Conditions, Signatures};

use super::Run;
use crate::exit::Exit;
use crate::output::OutputOptions;
use crate::terminal;

mod report;

/// Simulate the rank paper's fault states on a bench: amplitudes, deviations and ranks of 1x to 5x
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch signatures bench.toml
  gearwatch signatures bench.toml --stage stage2 --gear wheel --speed 15 --speed 30 --torque 60
  gearwatch signatures bench.toml --out signatures.json --report signatures.html
  gearwatch signatures paper-rig --pits all

The faults sit on one tooth: broken by 1/5 … 5/5 of its width, pits of 4, 5, 6, 7 mm one after the other, and both.
With --pits all every tooth of the gear has the pits.
docs/physics-mesh.md says how they are modelled.")]
pub struct SignaturesCommand {
    /// Bench file, or the name of a bench that comes with the program
    bench: PathBuf,
    /// Stage with the fault; the first where left out
    #[arg(long, value_name = "NAME")]
    stage: Option<String>,
    /// Gear with the fault
    #[arg(long, value_enum, default_value_t)]
    gear: WhichGear,
    /// Teeth that the pits sit on
    #[arg(long, value_enum, default_value_t)]
    pits: WhichTeeth,
    /// Motor speed, in Hz or as 1500rpm, may be repeated; the bench's own where left out
    #[arg(long = "speed", value_name = "HZ|RPM", value_parser = gearwatch_core::speed::parse_speed_hz)]
    speeds: Vec<f64>,
    /// Brake torque in N m, may be repeated; the bench's own where left out
    #[arg(long = "torque", value_name = "NM")]
    torques: Vec<f64>,
    /// Also write the signatures with their sigma to this JSON file, which diagnose, replay and run
    /// match verdicts with
    #[arg(long, short, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Also write a report for people to this HTML file: the table, its uncertainty, the paper
    /// beside it, pictures
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OutputOptions,
}

#[derive(Clone, Copy, Default, PartialEq, ValueEnum)]
enum WhichTeeth {
    /// The same tooth as the breakage
    #[default]
    One,
    /// All of the gear
    All,
}

#[derive(Clone, Copy, Default, PartialEq, ValueEnum)]
enum WhichGear {
    /// The driving gear
    #[default]
    Pinion,
    /// The driven gear
    Wheel,
}

impl Run for SignaturesCommand {
    const NAME: &'static str = "signatures";
    const COMPUTES: bool = true;

    fn run(self) -> anyhow::Result<Exit> {
        if let Some(path) = self.report.as_ref().filter(|path| path.extension().is_none_or(|end| end != "html")) {
            bail!("{}: the report is written as HTML; the name must end in .html", path.display());
        }
        let mut outputs = self.overwrite.reading([&self.bench]);
        let out = self.out.as_deref().map(|path| outputs.target(path)).transpose()?;
        let report = self.report.as_deref().map(|path| outputs.target(path)).transpose()?;
        let bench = super::simulate::read_bench(&self.bench)?;
        let stage = match &self.stage {
            None => 0,
            Some(name) => {
                let known: Vec<&str> = bench.stages.iter().map(|stage| stage.name.as_str()).collect();
                match known.iter().position(|known| known == name) {
                    Some(stage) => stage,
                    None => bail!("--stage {name:?}: the bench has {}", known.join(", ")),
                }
            }
        };
        if bench.sensors.is_empty() {
            bail!("{}: the bench has no [[sensor]]; amplitudes need one", self.bench.display());
        }
        let or = |given: &[f64], own: f64| if given.is_empty() { vec![own] } else { given.to_vec() };
        let mut all = Vec::new();
        let mut text = String::new();
        for &motor_hz in &or(&self.speeds, bench.motor.speed_hz) {
            for &torque_nm in &or(&self.torques, bench.brake.torque_nm) {
                if torque_nm <= 0.0 {
                    bail!("a brake torque of {torque_nm} N m leaves the teeth apart; give one above 0 with --torque");
                }
                let conditions = Conditions {
                    stage,
                    wheel: self.gear == WhichGear::Wheel,
                    pits_on_all: self.pits == WhichTeeth::All,
                    motor_hz,
                    torque_nm,
                };
                let found = signatures::simulate(&bench, conditions)?;
                describe(&mut text, &bench, &found)?;
                all.push(found);
            }
        }
        terminal::out().write_all(text.as_bytes()).context("standard output")?;
        if let Some(target) = out {
            let file = SignatureFile::new(&bench, all.iter().map(|found| point(&bench, found)).collect());
            let text = file.to_text(target.path())?;
            target.write(text)?;
        }
        if let Some(target) = report {
            target.write(report::page(&self.bench, &bench, &all)?)?;
        }
        Ok(Exit::Ok)
    }
}

fn describe(out: &mut String, bench: &Bench, found: &Signatures) -> std::fmt::Result {
    let Conditions { stage, wheel, motor_hz, torque_nm, .. } = found.conditions;
    let gear = if wheel { "wheel" } else { "pinion" };
    let ranks = RankConfig::default();
    writeln!(out, "{}: {} {gear}, motor {motor_hz} Hz, brake {torque_nm} N m", bench.name, bench.stages[stage].name)?;
    if found.pit_scale < 1.0 {
        writeln!(
            out,
            "  the paper's pits do not fit on these flanks; all are scaled by {:.3} (7 mm becomes {:.2} mm)",
            found.pit_scale,
            7.0 * found.pit_scale
        )?;
    }
    let stepped: Vec<&str> = found.states.iter().filter(|s| s.stepped).map(|s| s.state.name).collect();
    if !stepped.is_empty() {
        writeln!(out, "  teeth part in {}: stepped through time", stepped.join(", "))?;
    }
    for (s, sensor) in bench.sensors.iter().enumerate() {
        writeln!(out, "\n  {}", sensor.name)?;
        amplitudes_and_deviations(out, found, s)?;
        compare(out, found, s, &ranks)?;
    }
    writeln!(out)
}

/// Heads of a table's columns: 1x to 5x, each `width` wide.
fn heads(width: usize) -> String {
    (1..=signatures::HARMONICS).map(|h| format!("{:>width$}", format!("{h}x"))).collect()
}

/// A number to four digits, as people write it where it is of usual size.
fn four_digits(value: f64) -> String {
    if !(1e-4..1e5).contains(&value) {
        return format!("{value:.3e}");
    }
    let decimals = (3.0 - value.log10().floor()).max(0.0) as usize;
    format!("{value:.decimals$}")
}

/// The paper's tables 2 and 3 for this bench, side by side.
fn amplitudes_and_deviations(out: &mut String, found: &Signatures, sensor: usize) -> std::fmt::Result {
    writeln!(out, "  {:14}{:50}  change from normal (%; table 3)", "", "   amplitude (m/s², peak; table 2)")?;
    writeln!(out, "  {:14}{}{}", "state", heads(10), heads(8))?;
    for state in &found.states {
        write!(out, "  {:14}", state.state.name)?;
        for amplitude in state.amplitudes[sensor] {
            write!(out, "{:>10}", four_digits(amplitude))?;
        }
        for deviation in state.deviations_percent[sensor] {
            write!(out, "{deviation:+8.2}")?;
        }
        writeln!(out)?;
    }
    Ok(())
}

/// How the states of one sensor compare with the paper's table 4.
struct Comparison {
    /// Cells with the same rank, and all cells.
    same: usize,
    cells: usize,
    /// Largest deviation of states with pits only, and of those with a broken tooth (percent).
    pits_percent: f64,
    broken_percent: f64,
    /// Rank of the paper by state, the normal one left out, and harmonic.
    paper: Vec<Vec<Expected>>,
}

impl Comparison {
    fn new(found: &Signatures, sensor: usize, ranks: &RankConfig) -> Self {
        let paper = SignatureTable::paper();
        let mut out = Self { same: 0, cells: 0, pits_percent: 0.0, broken_percent: 0.0, paper: Vec::new() };
        for (state, signature) in found.states.iter().zip(&paper.signatures).skip(1) {
            for (deviation, expected) in state.deviations_percent[sensor].iter().zip(&signature.harmonics) {
                out.cells += 1;
                if let Expected::Rank(rank) = expected {
                    out.same += usize::from(ranks.rank_of(*deviation) == *rank);
                }
                let largest = if state.state.broken == 0.0 { &mut out.pits_percent } else { &mut out.broken_percent };
                *largest = largest.max(deviation.abs());
            }
            out.paper.push(signature.harmonics.to_vec());
        }
        out
    }

    /// Why the ranks are not the paper's.
    fn reasons(&self, found: &Signatures) -> String {
        let (pits, broken) = (self.pits_percent, self.broken_percent);
        if found.conditions.pits_on_all {
            format!(
                "Pits on all teeth change these lines by up to {pits:.1} % (the paper: 19 %), a tooth broken in part or whole, among them, by {broken:.1} %. \
                 Which cells agree depends on modes of the bench that the paper does not give."
            )
        } else {
            format!(
                "Pits of one tooth change these lines by {pits:.2} % at most, a tooth broken in part or whole by {broken:.1} %: one tooth of many has \
                 that share of a mesh line, the rest goes into sidebands. The paper's 5 to 19 % for pits would need pits on all teeth (--pits all), a \
                 window shorter than a revolution, or the contact noise of its multibody model."
            )
        }
    }
}

/// How the ranks compare with the paper's table 4, and why they differ.
fn compare(out: &mut String, found: &Signatures, sensor: usize, ranks: &RankConfig) -> std::fmt::Result {
    let comparison = Comparison::new(found, sensor, ranks);
    writeln!(out, "\n  {:14}   rank, and the paper's where it is another (table 4)", "")?;
    writeln!(out, "  {:14}{}", "state", heads(10))?;
    for (state, paper) in found.states.iter().skip(1).zip(&comparison.paper) {
        write!(out, "  {:14}", state.state.name)?;
        for (deviation, expected) in state.deviations_percent[sensor].iter().zip(paper) {
            let own = ranks.rank_of(*deviation);
            let cell = match expected {
                Expected::Rank(rank) if *rank != own => format!("{} ({})", own.code(), rank.code()),
                _ => own.code().to_owned(),
            };
            write!(out, "{cell:>10}")?;
        }
        writeln!(out)?;
    }
    writeln!(out, "\n  {} of {} cells have the rank of the paper's table 4.", comparison.same, comparison.cells)?;
    writeln!(out, "  {}", comparison.reasons(found))
}

fn point(bench: &Bench, found: &Signatures) -> Point {
    let Conditions { stage, wheel, motor_hz, torque_nm, .. } = found.conditions;
    let states = found.states.iter().map(|state| {
        let lines = |s: usize| Lines {
            amplitude_m_s2: state.amplitudes[s],
            deviation_percent: state.deviations_percent[s],
            sigma_percent: state.deviations_percent[s].map(signatures::sigma_percent),
        };
        let sensors = bench.sensors.iter().enumerate().map(|(s, sensor)| (sensor.name.clone(), lines(s)));
        State { state: state.state.name.to_owned(), stepped: state.stepped, sensors: sensors.collect() }
    });
    Point {
        stage: bench.stages[stage].name.clone(),
        gear: if wheel { "wheel" } else { "pinion" }.to_owned(),
        motor_speed_hz: motor_hz,
        brake_torque_nm: torque_nm,
        pit_scale: found.pit_scale,
        states: states.collect(),
    }
}
