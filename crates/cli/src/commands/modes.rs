//! `gearwatch modes BENCH`: eigenfrequencies, mode shapes and the speeds at which mesh and shaft
//! orders meet them.

mod planets;

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;

use anyhow::{Context, bail};
use clap::Args;
use gearwatch_report::{Bars, Cell, Chart, Lines, Part, Report, Section, Series, Table, Tone, render};
use gearwatch_sim::campbell::{Critical, HARMONICS, Mode, Train};
use serde_json::json;

use self::planets::PlanetaryStages;
use super::Run;
use super::simulate::read_bench;
use crate::exit::Exit;
use crate::format::Format;
use crate::output::OutputOptions;
use crate::terminal;

/// Share of the kinetic energy of a mode that is told, part by part.
const TOLD: f64 = 0.9;
/// Highest motor speed of the diagram, as a multiple of the bench's own.
const SPEEDS: f64 = 1.5;

/// Eigenfrequencies, mode shapes and critical speeds of a bench
///
/// Every mesh has its mean stiffness under the load; a Campbell diagram shows which mesh and shaft
/// orders meet which mode at which speed. Of a planetary stage the modes are those of the stage by
/// itself, by kind, with the harmonics that the phases of its planets let through.
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch modes paper-rig
  gearwatch modes planetary-parallel
  gearwatch modes bench.toml --torque 40 --highest 60 --plot modes.html
  gearwatch modes bench.toml --format json | jq '.critical[] | select(.line == \"stage1 1x\")'

Housing modes do not act back on the train and stand in the bench file; they are not among these.")]
pub struct Modes {
    /// Bench file, or the name of a bench that comes with the program
    bench: PathBuf,
    /// Brake torque (N m); the bench's own where left out
    #[arg(long, value_name = "NM")]
    torque: Option<f64>,
    /// Highest motor speed whose critical speeds are told (Hz); 1.5 times the bench's own where
    /// left out
    #[arg(long, value_name = "HZ")]
    highest: Option<f64>,
    /// Pictures to write: Campbell diagram and mode shapes, one .html file
    #[arg(long, value_name = "FILE.html")]
    plot: Option<PathBuf>,
    /// Text for people, or one JSON object
    #[arg(long, value_enum, default_value_t)]
    format: Format,
    #[command(flatten)]
    output: OutputOptions,
}

impl Run for Modes {
    const NAME: &'static str = "modes";

    fn run(self) -> anyhow::Result<Exit> {
        if let Some(path) = self.plot.as_deref().filter(|path| path.extension().is_none_or(|end| end != "html")) {
            bail!("{}: the name must end in .html", path.display());
        }
        let mut outputs = self.output.reading([&self.bench]);
        let plot = self.plot.as_deref().map(|path| outputs.target(path)).transpose()?;
        let bench = read_bench(&self.bench)?;
        let highest = self.highest.unwrap_or(SPEEDS * bench.motor.speed_hz);
        if !(highest.is_finite() && highest > 0.0) {
            bail!("--highest {highest}: expected a motor speed above 0 Hz");
        }
        if bench.stages.iter().any(|stage| stage.gearing.planetary.is_some()) {
            let found = PlanetaryStages::new(&bench, highest)
                .map_err(|error| gearwatch_sim::effects::EffectError::Beyond(error.to_string()))?;
            let text = match self.format {
                Format::Text => found.text()?,
                Format::Json => format!("{}\n", serde_json::to_string_pretty(&found.object())?),
            };
            terminal::out().write_all(text.as_bytes()).context("standard output")?;
            plot.map_or(Ok(()), |plot| plot.write(found.page().as_bytes()))?;
            return Ok(Exit::Ok);
        }
        let torque_nm = self.torque.unwrap_or(bench.brake.torque_nm);
        let setup = gearwatch_sim::effects::setup(&bench, &[])?;
        let train = Train::new(&setup, torque_nm).with_context(|| self.bench.display().to_string())?;
        let critical = train.critical_speeds(highest);
        let text = match self.format {
            Format::Text => text(&bench.name, torque_nm, &train, &critical, highest)?,
            Format::Json => format!("{}\n", serde_json::to_string_pretty(&object(torque_nm, &train, &critical))?),
        };
        terminal::out().write_all(text.as_bytes()).context("standard output")?;
        if let Some(plot) = plot {
            plot.write(page(&bench.name, torque_nm, &train, &critical, highest).as_bytes())?;
        }
        Ok(Exit::Ok)
    }
}

fn moving(train: &Train, mode: &Mode) -> String {
    let parts = train.movers(mode, TOLD);
    parts.iter().map(|(name, share)| format!("{name} {:.0} %", 100.0 * share)).collect::<Vec<_>>().join(", ")
}

fn meshes(mode: &Mode) -> String {
    mode.mesh_share.iter().map(|share| format!("{:.0}", 100.0 * share)).collect::<Vec<_>>().join("/")
}

fn text(
    bench: &str,
    torque_nm: f64,
    train: &Train,
    critical: &[Critical],
    highest: f64,
) -> Result<String, std::fmt::Error> {
    let mut out = String::new();
    let in_micrometres = |all: &[f64]| all.iter().map(|k| format!("{:.0}", 1e-6 * k)).collect::<Vec<_>>().join(", ");
    writeln!(
        out,
        "{bench} at {torque_nm} N m, mean mesh stiffness {} N/µm (ISO 6336-1 c_γ b: {} N/µm)\n",
        in_micrometres(&train.mesh_stiffness_n_per_m),
        in_micrometres(&train.iso_stiffness_n_per_m)
    )?;
    writeln!(
        out,
        "{:>4}{:>11}{:>9}  {:<12}moving parts (share of kinetic energy)",
        "mode", "Hz", "damping", "mesh (%)"
    )?;
    for (i, mode) in train.modes.iter().enumerate() {
        writeln!(
            out,
            "{:>4}{:>11.1}{:>9.3}  {:<12}{}",
            i + 1,
            mode.frequency_hz,
            mode.damping_ratio,
            meshes(mode),
            moving(train, mode)
        )?;
    }
    if !train.shafts.is_empty() {
        writeln!(
            out,
            "\nShafts that bend, each by itself on its supports with its gears: Hz at standstill, and of the whirl against and with the rotation"
        )?;
    }
    for shaft in &train.shafts {
        for (k, ((hz, backward), forward)) in
            shaft.standstill_hz.iter().zip(&shaft.backward_hz).zip(&shaft.forward_hz).enumerate()
        {
            writeln!(out, "  {:<16} {:>2} {hz:>10.1} {backward:>10.1} {forward:>10.1}", shaft.shaft, k + 1)?;
        }
    }
    writeln!(
        out,
        "\nCritical speeds up to {highest} Hz of the motor (1x to {HARMONICS}x of each mesh, 1x of each shaft)"
    )?;
    if critical.is_empty() {
        writeln!(out, "  none")?;
    }
    for c in critical {
        let hz = train.modes[c.mode].frequency_hz;
        writeln!(out, "{:>10.2} Hz   {:<16} meets mode {} ({hz:.1} Hz)", c.motor_hz, c.line, c.mode + 1)?;
    }
    Ok(out)
}

fn object(torque_nm: f64, train: &Train, critical: &[Critical]) -> serde_json::Value {
    let modes = train.modes.iter().map(|mode| {
        let shape: serde_json::Map<String, serde_json::Value> =
            train.coordinates.iter().cloned().zip(mode.shape.iter().map(|&x| json!(x))).collect();
        json!({ "frequency_hz": mode.frequency_hz, "damping_ratio": mode.damping_ratio, "shape": shape,
            "mesh_share": mode.mesh_share })
    });
    let critical = critical.iter().map(|c| {
        json!({ "motor_hz": c.motor_hz, "line": c.line, "order": c.order, "mode": c.mode + 1,
            "frequency_hz": train.modes[c.mode].frequency_hz })
    });
    let mut out = json!({ "brake_torque_nm": torque_nm, "mesh_stiffness_n_per_m": train.mesh_stiffness_n_per_m,
        "iso_6336_stiffness_n_per_m": train.iso_stiffness_n_per_m,
        "modes": modes.collect::<Vec<_>>(), "critical": critical.collect::<Vec<_>>() });
    let shafts = train.shafts.iter().map(|shaft| {
        json!({ "shaft": shaft.shaft, "standstill_hz": shaft.standstill_hz, "backward_hz": shaft.backward_hz,
            "forward_hz": shaft.forward_hz })
    });
    if !train.shafts.is_empty() {
        out["shafts"] = shafts.collect();
    }
    out
}

fn page(bench: &str, torque_nm: f64, train: &Train, critical: &[Critical], highest: f64) -> String {
    let table = Table {
        caption: "Modes; share of the potential energy in the meshes, of the kinetic energy in the moving parts".into(),
        head: ["mode", "Hz", "damping", "mesh (%)", "moving parts"].map(str::to_owned).to_vec(),
        rows: (train.modes.iter().enumerate())
            .map(|(i, mode)| {
                let numbers = [format!("{}", i + 1), format!("{:.1}", mode.frequency_hz)];
                let rest = [format!("{:.3}", mode.damping_ratio), meshes(mode), moving(train, mode)];
                numbers.into_iter().chain(rest).map(Cell::from).collect()
            })
            .collect(),
    };
    let crossings = Table {
        caption: format!("Critical speeds up to {highest} Hz of the motor"),
        head: ["motor (Hz)", "line", "mode", "Hz"].map(str::to_owned).to_vec(),
        rows: critical
            .iter()
            .map(|c| {
                let hz = train.modes[c.mode].frequency_hz;
                let cells =
                    [format!("{:.2}", c.motor_hz), c.line.clone(), (c.mode + 1).to_string(), format!("{hz:.1}")];
                cells.into_iter().map(Cell::from).collect()
            })
            .collect(),
    };
    let shapes = train.modes.iter().enumerate().map(|(i, mode)| {
        let largest = mode.kinetic_share.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        // The root of the energy with the sign of the motion: angles and displacements in one unit.
        let values =
            mode.kinetic_share.iter().zip(&mode.shape).map(|(share, x)| ((share / largest).sqrt() * x.signum(), 0.0));
        Part::Chart(Chart::Bars(Bars {
            caption: format!(
                "Mode {}, {:.1} Hz: motion times the root of its inertia, of the largest",
                i + 1,
                mode.frequency_hz
            ),
            y_label: "of the largest".into(),
            groups: train.coordinates.clone(),
            series: vec![("motion".into(), values.collect())],
            limits: Vec::new(),
        }))
    });
    render(&Report {
        title: format!("{bench}: modes and critical speeds at {torque_nm} N m"),
        verdict: format!("{} modes; {} crossings up to {highest} Hz of the motor.", train.modes.len(), critical.len()),
        tone: Tone::Plain,
        sections: vec![
            Section {
                heading: "Campbell diagram".into(),
                parts: vec![Part::Chart(campbell(train, highest)), Part::Table(crossings)],
            },
            Section { heading: "Modes".into(), parts: std::iter::once(Part::Table(table)).chain(shapes).collect() },
        ],
        appendix: Vec::new(),
        provenance: vec![
            ("gearwatch".into(), env!("CARGO_PKG_VERSION").into()),
            ("command".into(), std::env::args().collect::<Vec<_>>().join(" ")),
        ],
    })
}

/// Modes as level lines, the lines of the machine as rays from the origin.
fn campbell(train: &Train, highest: f64) -> Chart {
    let fastest = train.lines.iter().map(|(_, order)| order * highest / train.motor_order).fold(0.0, f64::max);
    let shown = train.modes.iter().filter(|mode| mode.frequency_hz <= fastest);
    let modes = shown.map(|mode| Series {
        name: format!("{:.0} Hz", mode.frequency_hz),
        points: vec![(0.0, mode.frequency_hz), (highest, mode.frequency_hz)],
    });
    let rays = train.lines.iter().map(|(name, order)| Series {
        name: name.clone(),
        points: vec![(0.0, 0.0), (highest, order * highest / train.motor_order)],
    });
    Chart::Lines(Lines {
        caption: "Eigenfrequencies (level) and the frequencies of mesh and shaft orders over the motor's speed".into(),
        x_label: "motor (Hz)".into(),
        y_label: "frequency (Hz)".into(),
        log_y: false,
        series: rays.chain(modes).collect(),
        marks: Vec::new(),
    })
}
