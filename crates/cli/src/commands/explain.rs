//! `gearwatch explain BENCH RECORDINGS…`: where simulation and recordings differ, and what was left out.

use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use gearwatch_core::recording::Recording;
use gearwatch_explain::explain::{Input, explain};
use gearwatch_explain::latent::LatentForce;
use gearwatch_explain::report::{Explanation, Status};
use gearwatch_io::open::{OpenOptions, read_recording};

use super::Run;
use crate::exit::Exit;

mod blind;
mod report;
mod tables;

/// Say where the simulation of a bench and its recordings differ, and which physics was left out
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch explain bench.toml recordings/
  gearwatch explain bench.toml recordings/ --reference before/ --out answer/
  gearwatch explain bench.toml recordings/ --reference before/ --out answer/ --report answer/report.html
  gearwatch explain bench.toml 20hz-40nm.mcap 30hz-40nm.mcap 30hz-80nm.mcap
  gearwatch explain --blind-spots bench.toml
  gearwatch explain --tables simulation.csv experiment.csv

Folders stand for all recordings in them. A reference is the same bench, sensors and mounting before. With --out, explanation.json and a
new bench.toml with the effects in it are written there (and latent_force.csv, where what is left is a force that nothing in the library makes); without, the JSON goes to stdout after the summary on stderr.")]
pub struct Explain {
    /// The bench file
    #[arg(required_unless_present = "tables")]
    bench: Option<PathBuf>,
    /// Recordings, or folders of them
    #[arg(required_unless_present_any = ["tables", "blind_spots"])]
    recordings: Vec<PathBuf>,
    /// Instead of an explanation: the smallest size of every effect that these sensors and operating points show; without recordings, two
    /// speeds and two loads
    #[arg(long)]
    blind_spots: bool,
    /// Instead of an explanation: what two tables of amplitudes, by state and mesh harmonic, allow to say
    #[arg(long, num_args = 2, value_names = ["SIMULATION.csv", "EXPERIMENT.csv"], conflicts_with_all = ["bench", "recordings", "blind_spots"])]
    tables: Vec<PathBuf>,
    /// Recordings of the same bench before, or folders of them
    #[arg(long, num_args = 1..)]
    reference: Vec<PathBuf>,
    /// Folder for explanation.json and bench.toml
    #[arg(long)]
    out: Option<PathBuf>,
    /// Also write a report: one HTML file with pictures, for a browser
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
}

impl Run for Explain {
    const NAME: &'static str = "explain";

    fn run(self) -> anyhow::Result<Exit> {
        if let [simulation, experiment] = &self.tables[..] {
            return tables::run(simulation, experiment);
        }
        let Some(bench_file) = &self.bench else { bail!("no bench file is given") };
        let bench = gearwatch_io::bench_file::read(bench_file)?;
        let recordings = load(&self.recordings)?;
        if self.blind_spots {
            return blind::run(&bench, &recordings);
        }
        let reference = load(&self.reference)?;
        let talk = std::io::stderr().is_terminal();
        let mut progress = |step: &str| {
            if talk {
                // Progress is a courtesy; a closed terminal is not an error.
                let _ = writeln!(std::io::stderr(), "  {step}");
            }
        };
        let answer = explain(
            &Input { bench: &bench, recordings: &recordings, reference: &reference, without: &[] },
            &mut progress,
        )?;
        let mut json = serde_json::to_string_pretty(&answer.explanation)?;
        json.push('\n');
        if let Some(out) = &self.out {
            std::fs::create_dir_all(out).with_context(|| format!("{} cannot be made", out.display()))?;
            write(&out.join("explanation.json"), &json)?;
            write(&out.join("bench.toml"), &toml::to_string(&answer.bench)?)?;
            if let Some(force) = &answer.explanation.latent_force {
                write(&out.join("latent_force.csv"), &table_of(force))?;
            }
            let mut stdout = std::io::stdout().lock();
            summary(&mut stdout, &answer.explanation).context("stdout")?;
            writeln!(stdout, "written: {}", out.join("explanation.json").display()).context("stdout")?;
        } else {
            summary(&mut std::io::stderr().lock(), &answer.explanation).context("stderr")?;
            std::io::stdout().lock().write_all(json.as_bytes()).context("stdout")?;
        }
        if let Some(path) = &self.report {
            let mut files = vec![("bench".to_owned(), bench_file.clone())];
            for (what, paths) in [("recording", &self.recordings), ("reference", &self.reference)] {
                files.extend(files_of(paths)?.into_iter().map(|file| (what.to_owned(), file)));
            }
            write(path, &report::page(&bench.name, &answer.explanation, &files)?)?;
        }
        Ok(match answer.explanation.status {
            Status::Consistent => Exit::Ok,
            Status::Explained | Status::Ambiguous | Status::Unexplained => Exit::Warning,
        })
    }
}

fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    std::fs::write(path, text).with_context(|| format!("{} cannot be written", path.display()))
}

/// The force that nobody named, a line a step of its turn.
fn table_of(f: &LatentForce) -> String {
    let unit = f.unit.to_lowercase().replace('/', "_per_").replace('^', "");
    let mut text = format!("turn,force_{unit},sigma_{unit}\n");
    for ((turn, force), sigma) in f.turn.iter().zip(&f.force).zip(&f.sigma) {
        text.push_str(&format!("{turn:.6},{force:.6e},{sigma:.6e}\n"));
    }
    text
}

fn load(paths: &[PathBuf]) -> anyhow::Result<Vec<Recording>> {
    let files = files_of(paths)?;
    files.iter().map(|file| read_recording(file, &OpenOptions::default()).map_err(anyhow::Error::from)).collect()
}

/// All files of recordings behind paths; folders are taken in the order of their file names.
fn files_of(paths: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for path in paths {
        if !path.is_dir() {
            files.push(path.clone());
            continue;
        }
        let entries = std::fs::read_dir(path).with_context(|| format!("{} cannot be read", path.display()))?;
        let mut inside = Vec::new();
        for entry in entries {
            let file = entry.with_context(|| format!("{} cannot be read", path.display()))?.path();
            let sidecar = file.extension().is_some_and(|e| e == "toml" || e == "md" || e == "txt");
            if file.is_file() && !sidecar {
                inside.push(file);
            }
        }
        if inside.is_empty() {
            bail!("{} holds no recording; name MCAP files or a folder that holds some", path.display());
        }
        inside.sort();
        files.extend(inside);
    }
    Ok(files)
}

/// What, where, how sure, how much better, what to record next.
fn summary(out: &mut dyn Write, e: &Explanation) -> std::io::Result<()> {
    match e.status {
        Status::Consistent => writeln!(out, "consistent: nothing beyond noise, repetition and the usual tolerances")?,
        Status::Unexplained => {
            writeln!(out, "unexplained: there is a mismatch, and nothing in the library accounts for it")?;
        }
        Status::Explained | Status::Ambiguous => writeln!(out, "{}:", e.status.code())?,
    }
    for effect in &e.effects {
        writeln!(out, "  {} at {}, probability {:.0} %", effect.effect, effect.place, 100.0 * effect.probability)?;
        for (name, p) in &effect.parameters {
            writeln!(out, "      {name} = {:.4} ± {:.2}", p.value(), p.sigma())?;
        }
        for (kind, text) in [
            ("where", &effect.evidence.place),
            ("law", &effect.evidence.law),
            ("support", &effect.evidence.support),
            ("shape", &effect.evidence.shape),
        ] {
            if !text.is_empty() {
                writeln!(out, "      {kind}: {text}")?;
            }
        }
        for other in &effect.indistinguishable_from {
            writeln!(out, "      not told apart from {} at {}", other.effect, other.place)?;
        }
    }
    if let Some(f) = &e.latent_force {
        let largest = f.force.iter().map(|v| v.abs()).fold(0.0, f64::max);
        writeln!(
            out,
            "  a force of up to {largest:.3} ± {:.2} {} that repeats every {:.4} revolutions of the input shaft accounts for it ({})",
            f.sigma.first().copied().unwrap_or(f64::NAN),
            f.unit,
            f.period_rev,
            f.recording
        )?;
        for (what, exponent) in [("torque", f.load_exponent), ("speed", f.speed_exponent)] {
            if let Some(p) = exponent {
                writeln!(out, "      amplitude ∝ {what}^{p:.2}")?;
            }
        }
        writeln!(out, "      with this period: {}", f.period_of.join("; "))?;
    }
    if let Some(fit) = &e.fit {
        writeln!(
            out,
            "fit, held out {}: {:.2} before, {:.2} after ({:.2} is repetition)",
            fit.held_out.join(", "),
            fit.held_out_before,
            fit.held_out_after,
            fit.noise_floor
        )?;
    }
    for m in e.mismatch.iter().take(5) {
        writeln!(
            out,
            "  {} {}: {} at {:.1} Hz, {:.4} where {:.4} was, {:+.1} sigma",
            m.recording, m.channel, m.what, m.frequency_hz, m.measured, m.modelled, m.z
        )?;
    }
    for step in &e.steps {
        writeln!(out, "  - {step}")?;
    }
    for text in &e.advice {
        writeln!(out, "next: {text}")?;
    }
    Ok(())
}
