//! `gearwatch explain BENCH RECORDINGS…`: where simulation and recordings differ, and what was left
//! out.

use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use gearwatch_core::recording::Recording;
use gearwatch_core::train::Train;
use gearwatch_explain::error::ExplainError;
use gearwatch_explain::explain::{Input, explain};
use gearwatch_explain::judge::report::LatentForce;
use gearwatch_explain::judge::report::{FORMAT, Status};
use gearwatch_io::open::{OpenOptions, read_recording};
use gearwatch_io::output::{Outputs, Target};

use super::Run;
use crate::exit::Exit;
use crate::input::InputOptions;
use crate::output::{OutputOptions, with_sidecars};
use crate::terminal;

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
    /// Instead of an explanation: the smallest size of every effect that these sensors and
    /// operating points show; without recordings, two speeds and two loads
    #[arg(long)]
    blind_spots: bool,
    /// Instead of an explanation: puts known changes into these recordings and says from which size
    /// on they are named; against the reference, without one in the second half of each recording
    /// against its first. With --out also drill.md, drill.csv and drill.svg
    #[arg(long, value_name = "CHANGES", num_args = 0..=1, require_equals = true, default_missing_value = "all",
        conflicts_with_all = ["blind_spots", "tables", "report"])]
    drill: Option<drill::Changes>,
    /// Instead of an explanation: what two tables of amplitudes allow to say. A line a state, the
    /// normal one first; a name, then a column a mesh harmonic
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
    overwrite: OutputOptions,
    #[command(flatten)]
    input: InputOptions,
}

impl Run for Explain {
    const NAME: &'static str = "explain";
    const COMPUTES: bool = true;

    fn run(self) -> anyhow::Result<Exit> {
        if let [simulation, experiment] = &self.tables[..] {
            return tables::run(simulation, experiment);
        }
        let Some(bench_file) = &self.bench else { bail!("no bench file is given") };
        let bench = gearwatch_io::bench_file::read(bench_file)?;
        gearwatch_sim::effects::pairs_alone(&bench).with_context(|| bench_file.display().to_string())?;
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
        // Names are judged before minutes of computing, not after.
        let read = with_sidecars(recording_files.iter().chain(&reference_files));
        let mut outputs = self.overwrite.reading(read).reading([bench_file]);
        let report = self.report.as_deref().map(|path| outputs.target(path)).transpose()?;
        let names: &[&'static str] = if self.drill.is_some() { &drill::FILES } else { &ANSWER_FILES };
        let answer_files = self.out.as_deref().map(|out| AnswerFiles::of(out, names, &mut outputs)).transpose()?;
        let options = self.input.open_options();
        let recordings = load(&recording_files, &options)?;
        if self.blind_spots {
            return blind::run(&bench, &recordings);
        }
        let reference = load(&reference_files, &options)?;
        if let Some(changes) = self.drill {
            return drill::run(&bench, &recordings, &reference, changes, answer_files);
        }
        let talk = std::io::stderr().is_terminal();
        let mut progress = |step: &str| {
            if talk {
                // Progress is a courtesy; a closed terminal is not an error.
                let _ = writeln!(terminal::err(), "  {step} …");
            }
        };
        let asked = Input { bench: &bench, recordings: &recordings, reference: &reference, without: &[] };
        let answer = match explain(&asked, &mut progress) {
            Ok(answer) => answer,
            Err(error) if error.is_not_judged() => return not_judged(&error, answer_files),
            Err(error) => return Err(error.into()),
        };
        let e = &answer.explanation;
        let mut json = serde_json::to_string_pretty(e)?;
        json.push('\n');
        let mut written = Vec::new();
        if let Some(files) = answer_files {
            let mut texts = vec![
                ("explanation.json", json.clone()),
                ("bench.toml", gearwatch_io::bench_file::to_toml(&answer.bench)?),
            ];
            texts.extend(e.latent_force.as_ref().map(|force| ("latent_force.csv", table_of(force))));
            texts.extend(figures::draw(&Train::new(&answer.bench), e, &recordings, &reference)?);
            written.extend(files.write(texts)?);
        }
        if let Some(target) = report {
            let mut files = vec![("bench".to_owned(), bench_file.clone())];
            for (what, paths) in [("recording", &recording_files), ("reference", &reference_files)] {
                files.extend(paths.iter().map(|file| (what.to_owned(), file.clone())));
            }
            written.push(target.path().to_owned());
            target.write(report::page(&bench.name, e, &files)?)?;
        }
        let mut summary = Vec::new();
        summary::print(&mut summary, &bench.name, e, self.steps)?;
        if !written.is_empty() {
            let written: Vec<String> = written.iter().map(|path| path.display().to_string()).collect();
            writeln!(summary, "\n  written   {}", written.join("\n            "))?;
        }
        if self.out.is_some() {
            terminal::out().write_all(&summary).context("stdout")?;
        } else {
            terminal::err().write_all(&summary).context("stderr")?;
            terminal::out().write_all(json.as_bytes()).context("stdout")?;
        }
        Ok(match e.status {
            Status::Consistent => Exit::Ok,
            Status::Explained | Status::Ambiguous | Status::Unexplained => Exit::Warning,
        })
    }
}

/// An answer without an answer, for those who read the file: nothing was judged, and why.
fn not_judged(error: &ExplainError, files: Option<AnswerFiles>) -> anyhow::Result<Exit> {
    let why = error.to_string();
    let nothing: [&str; 0] = [];
    let json = serde_json::json!({
        "format": FORMAT, "status": "not_judged", "effects": nothing, "mismatch": nothing, "advice": nothing,
        "limits": [&why], "steps": nothing,
    });
    let text = format!("{json:#}\n");
    match files {
        Some(files) => drop(files.write(vec![("explanation.json", text)])?),
        None => terminal::out().write_all(text.as_bytes()).context("stdout")?,
    }
    writeln!(terminal::err(), "gearwatch explain: not judged: {why}").context("stderr")?;
    Ok(Exit::Unknown)
}

/// All files that an answer may have.
const ANSWER_FILES: [&str; 6] =
    ["explanation.json", "bench.toml", "latent_force.csv", "spectrum.svg", "mismatch.svg", "fit.svg"];

/// The files of an answer in their folder.
struct AnswerFiles {
    folder: PathBuf,
    targets: Vec<(&'static str, Target)>,
}

impl AnswerFiles {
    /// Checks all names, also those that this answer may not need: a file that stays would belong
    /// to another answer.
    fn of(folder: &Path, names: &[&'static str], outputs: &mut Outputs) -> anyhow::Result<Self> {
        let target = |&name: &&'static str| Ok((name, outputs.target_in_new_folder(&folder.join(name))?));
        let targets = names.iter().map(target).collect::<anyhow::Result<_>>()?;
        Ok(Self { folder: folder.to_owned(), targets })
    }

    /// Writes the files and removes what is there of an earlier answer and not in this one.
    fn write(self, mut texts: Vec<(&'static str, String)>) -> anyhow::Result<Vec<PathBuf>> {
        let Self { folder, targets } = self;
        std::fs::create_dir_all(&folder).with_context(|| format!("{} cannot be made", folder.display()))?;
        let mut written = Vec::new();
        for (name, target) in targets {
            let path = target.path().to_owned();
            match texts.iter().position(|(of, _)| *of == name) {
                Some(at) => {
                    target.write(texts.swap_remove(at).1)?;
                    written.push(path);
                }
                None if path.exists() => {
                    std::fs::remove_file(&path).with_context(|| format!("{} cannot be removed", path.display()))?;
                }
                None => {}
            }
        }
        Ok(written)
    }
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
