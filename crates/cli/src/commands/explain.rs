//! `gearwatch explain BENCH RECORDINGS…`: where simulation and recordings differ, and what was left out.

use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use gearwatch_core::recording::Recording;
use gearwatch_core::train::Train;
use gearwatch_explain::explain::{Input, explain};
use gearwatch_explain::judge::latent::LatentForce;
use gearwatch_explain::judge::report::Status;
use gearwatch_io::open::{OpenOptions, read_recording};

use super::Run;
use crate::exit::Exit;
use crate::input::InputOptions;

mod blind;
mod drill;
mod figures;
mod report;
pub(super) mod summary;
mod tables;

/// Say where the simulation of a bench and its recordings differ, and which physics was left out
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch explain bench.toml recordings/
  gearwatch explain bench.toml recordings/ --reference before/ --out answer/
  gearwatch explain bench.toml recordings/ --reference before/ --report report.html
  gearwatch explain bench.toml 20hz-40nm.mcap 30hz-40nm.mcap 30hz-80nm.mcap
  gearwatch explain --blind-spots bench.toml
  gearwatch explain --drill bench.toml recordings/ --out drill/
  gearwatch explain --tables simulation.csv experiment.csv

Folders stand for all recordings in them. A reference is the same bench, sensors and mounting before. With --out, explanation.json, a new \
bench.toml with the effects in it and pictures (SVG) are written there, and latent_force.csv where what is left is a force that nothing in \
the library makes; without, the JSON goes to stdout after the summary on stderr.
Exit: 0 consistent, 1 something is left out (named or not), 3 nothing could be judged.")]
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
    /// Instead of an explanation: puts known changes into these recordings and says from which size on they are named; against the
    /// reference, without one in the second half of each recording against its first. With --out also drill.md, drill.csv and drill.svg
    #[arg(long, value_name = "CHANGES", num_args = 0..=1, require_equals = true, default_missing_value = "all",
        conflicts_with_all = ["blind_spots", "tables", "report"])]
    drill: Option<drill::Changes>,
    /// Instead of an explanation: what two tables of amplitudes allow to say. A line a state, the normal one first; a name, then a column a
    /// mesh harmonic
    #[arg(long, num_args = 2, value_names = ["SIMULATION.csv", "EXPERIMENT.csv"], conflicts_with_all = ["bench", "recordings", "blind_spots"])]
    tables: Vec<PathBuf>,
    /// Recordings of the same bench before, or folders of them
    #[arg(long, num_args = 1..)]
    reference: Vec<PathBuf>,
    /// Folder for explanation.json, bench.toml and pictures
    #[arg(long)]
    out: Option<PathBuf>,
    /// Print every step that led to the answer; explanation.json has them in any case
    #[arg(long)]
    steps: bool,
    /// Also write a report: one HTML file with pictures, for a browser
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    #[command(flatten)]
    input: InputOptions,
}

impl Run for Explain {
    const NAME: &'static str = "explain";

    fn run(self) -> anyhow::Result<Exit> {
        if let [simulation, experiment] = &self.tables[..] {
            return tables::run(simulation, experiment);
        }
        let Some(bench_file) = &self.bench else { bail!("no bench file is given") };
        let bench = gearwatch_io::bench_file::read(bench_file)?;
        for spec in &bench.effects {
            gearwatch_sim::effects::resolve(spec, &bench).with_context(|| bench_file.display().to_string())?;
        }
        let (mut recording_files, reference_files) = (files_of(&self.recordings)?, files_of(&self.reference)?);
        // Which recording is held out must not depend on the order in which they are named.
        recording_files.sort();
        apart(&recording_files, &reference_files)?;
        if let Some(out) = self.out.as_ref().filter(|out| out.exists() && !out.is_dir()) {
            bail!("{}: expected a folder for the answer, found a file", out.display());
        }
        let options = self.input.open_options();
        let recordings = load(&recording_files, &options)?;
        if self.blind_spots {
            return blind::run(&bench, &recordings);
        }
        let reference = load(&reference_files, &options)?;
        if let Some(changes) = self.drill {
            return drill::run(&bench, &recordings, &reference, changes, self.out.as_deref());
        }
        let talk = std::io::stderr().is_terminal();
        let mut progress = |step: &str| {
            if talk {
                // Progress is a courtesy; a closed terminal is not an error.
                let _ = writeln!(std::io::stderr(), "  {step} …");
            }
        };
        let answer = explain(
            &Input { bench: &bench, recordings: &recordings, reference: &reference, without: &[] },
            &mut progress,
        )?;
        let e = &answer.explanation;
        let mut json = serde_json::to_string_pretty(e)?;
        json.push('\n');
        let mut written = Vec::new();
        if let Some(out) = &self.out {
            std::fs::create_dir_all(out).with_context(|| format!("{} cannot be made", out.display()))?;
            let (explanation, model) = (out.join("explanation.json"), out.join("bench.toml"));
            write(&explanation, &json)?;
            write(&model, &gearwatch_io::bench_file::to_toml(&answer.bench)?)?;
            written.extend([explanation, model]);
            if let Some(force) = &e.latent_force {
                let path = out.join("latent_force.csv");
                write(&path, &table_of(force))?;
                written.push(path);
            }
            written.extend(figures::write(out, &Train::new(&answer.bench), e, &recordings, &reference)?);
        }
        if let Some(path) = &self.report {
            let mut files = vec![("bench".to_owned(), bench_file.clone())];
            for (what, paths) in [("recording", &recording_files), ("reference", &reference_files)] {
                files.extend(paths.iter().map(|file| (what.to_owned(), file.clone())));
            }
            write(path, &report::page(&bench.name, e, &files)?)?;
            written.push(path.clone());
        }
        let mut summary = Vec::new();
        summary::print(&mut summary, &bench.name, e, self.steps)?;
        if !written.is_empty() {
            let written: Vec<String> = written.iter().map(|path| path.display().to_string()).collect();
            writeln!(summary, "\n  written   {}", written.join("\n            "))?;
        }
        if self.out.is_some() {
            std::io::stdout().lock().write_all(&summary).context("stdout")?;
        } else {
            std::io::stderr().lock().write_all(&summary).context("stderr")?;
            std::io::stdout().lock().write_all(json.as_bytes()).context("stdout")?;
        }
        Ok(match e.status {
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

fn load(files: &[PathBuf], options: &OpenOptions) -> anyhow::Result<Vec<Recording>> {
    files.iter().map(|file| read_recording(file, options).map_err(anyhow::Error::from)).collect()
}

/// A file cannot be the recording and what it is compared with.
fn apart(recordings: &[PathBuf], references: &[PathBuf]) -> anyhow::Result<()> {
    for file in references.iter().filter(|file| file.exists()) {
        let whole = file.canonicalize().with_context(|| format!("{} cannot be read", file.display()))?;
        if recordings.iter().any(|other| other.canonicalize().is_ok_and(|other| other == whole)) {
            bail!(
                "{} is given as a recording and as its own reference; a reference is another recording, made before",
                file.display()
            );
        }
    }
    Ok(())
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
