//! Modes of planetary stages, each by itself.

use std::fmt::Write as _;

use gearwatch_core::bench::Bench;
use gearwatch_report::{Cell, Chart, Lines, Part, Report, Section, Series, Table, Tone, render};
use gearwatch_sim::campbell::HARMONICS;
use gearwatch_sim::planetary::{PlanetaryCritical, PlanetaryError, StageModes};
use serde_json::json;

/// The modes of all planetary stages of a bench, and the names of the stages that are not
/// planetary.
pub(super) struct PlanetaryStages {
    stages: Vec<StageModes>,
    others: Vec<String>,
    highest_motor_hz: f64,
    bench: String,
}

impl PlanetaryStages {
    /// Of a bench with at least one.
    ///
    /// # Errors
    /// For a stage whose modes are not known, in a sentence.
    pub(super) fn new(bench: &Bench, highest_motor_hz: f64) -> Result<Self, PlanetaryError> {
        let (planetary, others): (Vec<usize>, Vec<usize>) =
            (0..bench.stages.len()).partition(|&i| bench.stages[i].gearing.planetary.is_some());
        Ok(Self {
            stages: planetary.into_iter().map(|i| StageModes::new(bench, i)).collect::<Result<_, _>>()?,
            others: others.into_iter().map(|i| bench.stages[i].name.clone()).collect(),
            highest_motor_hz,
            bench: bench.name.clone(),
        })
    }

    fn left_out(&self) -> Option<String> {
        (!self.others.is_empty()).then(|| {
            format!(
                "The modes are those of each planetary stage on its own bearings; {} and the shafts between are not in them.",
                self.others.join(", ")
            )
        })
    }

    fn critical(&self, stage: &StageModes) -> Vec<PlanetaryCritical> {
        stage.critical_speeds(HARMONICS, self.highest_motor_hz)
    }

    /// For people.
    pub(super) fn text(&self) -> Result<String, std::fmt::Error> {
        let mut out = String::new();
        for stage in &self.stages {
            writeln!(
                out,
                "{}, stage {}: mean mesh stiffness {:.0} N/µm at the sun, {:.0} N/µm at the ring (ISO 6336-1 c_γ b)",
                self.bench,
                stage.name,
                1e-6 * stage.sun_mesh_n_per_m,
                1e-6 * stage.ring_mesh_n_per_m
            )?;
            writeln!(out, "{}\n", phasing(stage))?;
            writeln!(out, "{:>4}{:>11}  {:<14}times", "mode", "Hz", "kind")?;
            for (i, mode) in stage.modes.iter().enumerate() {
                let (hz, kind) = (mode.frequency_hz, mode.kind.word());
                writeln!(out, "{:>4}{hz:>11.1}  {kind:<14}{}", i + 1, mode.count)?;
            }
            writeln!(out, "\nCritical speeds up to {} Hz of the motor", self.highest_motor_hz)?;
            let critical = self.critical(stage);
            if critical.is_empty() {
                writeln!(out, "  none")?;
            }
            for c in &critical {
                let mode = &stage.modes[c.mode];
                let name = format!("{} {}x", stage.name, c.harmonic);
                let (number, kind, hz) = (c.mode + 1, mode.kind.word(), mode.frequency_hz);
                writeln!(out, "{:>10.2} Hz   {name:<16} meets mode {number} ({kind}, {hz:.1} Hz)", c.motor_hz)?;
            }
            writeln!(out)?;
        }
        self.left_out().map_or(Ok(()), |text| writeln!(out, "{text}"))?;
        Ok(out)
    }

    /// For programs.
    pub(super) fn object(&self) -> serde_json::Value {
        let of_stage = |stage: &StageModes| {
            let mode = |m: &gearwatch_sim::planetary::StageMode| json!({ "frequency_hz": m.frequency_hz, "kind": m.kind.word(), "count": m.count });
            let critical = |c: &PlanetaryCritical| {
                json!({ "motor_hz": c.motor_hz, "line": format!("{} {}x", stage.name, c.harmonic), "mode": c.mode + 1,
                    "frequency_hz": stage.modes[c.mode].frequency_hz })
            };
            let excited: Vec<&str> =
                (1..=HARMONICS).map(|h| stage.excited(h).map_or("any", |kind| kind.word())).collect();
            json!({ "stage": stage.name, "sun_mesh_n_per_m": stage.sun_mesh_n_per_m,
                "ring_mesh_n_per_m": stage.ring_mesh_n_per_m,
                "modes": stage.modes.iter().map(mode).collect::<Vec<_>>(), "excited_by_harmonic": excited,
                "critical": self.critical(stage).iter().map(critical).collect::<Vec<_>>() })
        };
        json!({ "planetary_stages": self.stages.iter().map(of_stage).collect::<Vec<_>>() })
    }

    /// Campbell diagram and tables.
    pub(super) fn page(&self) -> String {
        let sections = self.stages.iter().map(|stage| {
            let modes = Table {
                caption: "Modes of the stage; how many of them have the same frequency".into(),
                head: ["mode", "Hz", "kind", "times"].map(str::to_owned).to_vec(),
                rows: (stage.modes.iter().enumerate())
                    .map(|(i, m)| {
                        let hz = format!("{:.1}", m.frequency_hz);
                        [(i + 1).to_string(), hz, m.kind.word().into(), m.count.to_string()].map(Cell::from).to_vec()
                    })
                    .collect(),
            };
            let critical = Table {
                caption: format!("Critical speeds up to {} Hz of the motor. {}", self.highest_motor_hz, phasing(stage)),
                head: ["motor (Hz)", "line", "mode", "Hz"].map(str::to_owned).to_vec(),
                rows: (self.critical(stage).iter())
                    .map(|c| {
                        let hz = format!("{:.1}", stage.modes[c.mode].frequency_hz);
                        let line = format!("{} {}x", stage.name, c.harmonic);
                        [format!("{:.2}", c.motor_hz), line, (c.mode + 1).to_string(), hz].map(Cell::from).to_vec()
                    })
                    .collect(),
            };
            Section {
                heading: format!("Stage {}", stage.name),
                parts: vec![Part::Chart(self.campbell(stage)), Part::Table(critical), Part::Table(modes)],
            }
        });
        let crossings: usize = self.stages.iter().map(|stage| self.critical(stage).len()).sum();
        render(&Report {
            title: format!("{}: modes of the planetary stages", self.bench),
            verdict: format!(
                "{crossings} crossings up to {} Hz of the motor. {}",
                self.highest_motor_hz,
                self.left_out().unwrap_or_default()
            ),
            tone: Tone::Plain,
            sections: sections.collect(),
            appendix: Vec::new(),
            provenance: vec![
                ("gearwatch".into(), env!("CARGO_PKG_VERSION").into()),
                ("command".into(), std::env::args().collect::<Vec<_>>().join(" ")),
            ],
        })
    }

    /// Modes as level lines, mesh harmonics as rays from the origin.
    fn campbell(&self, stage: &StageModes) -> Chart {
        let highest = self.highest_motor_hz;
        let hz = |harmonic: u32| f64::from(harmonic) * stage.mesh_order * highest / stage.motor_order;
        let rays = (1..=HARMONICS).map(|h| {
            let excited = stage.excited(h).map_or("any", |kind| kind.word());
            Series { name: format!("{h}x ({excited})"), points: vec![(0.0, 0.0), (highest, hz(h))] }
        });
        let shown = stage.modes.iter().filter(|mode| mode.frequency_hz <= hz(HARMONICS));
        let modes = shown.map(|mode| Series {
            name: format!("{:.0} Hz {}", mode.frequency_hz, mode.kind.word()),
            points: vec![(0.0, mode.frequency_hz), (highest, mode.frequency_hz)],
        });
        Chart::Lines(Lines {
            caption: "Eigenfrequencies (level) and mesh harmonics with the kind of modes that each excites".into(),
            x_label: "motor (Hz)".into(),
            y_label: "frequency (Hz)".into(),
            log_y: false,
            series: rays.chain(modes).collect(),
            marks: Vec::new(),
        })
    }
}

/// Which kind of modes each harmonic excites.
fn phasing(stage: &StageModes) -> String {
    if stage.excited(1).is_none() {
        return "Planets at unequal spacing: every harmonic may excite every mode".into();
    }
    let of = |h| stage.excited(h).map_or("any", |kind| kind.word());
    let kinds: Vec<String> = (1..=HARMONICS).map(|h| format!("{h}x {}", of(h))).collect();
    format!("Mesh harmonics and the modes that they excite (Parker 2000): {}", kinds.join(", "))
}
