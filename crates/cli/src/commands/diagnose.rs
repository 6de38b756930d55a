//! `gearwatch diagnose FILE…`: what recordings say of the gears, once.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{Args, ValueEnum};
use gearwatch_check::{Checked, Severity};
use gearwatch_core::aggregate::Aggregate;
use gearwatch_core::assemble::Counters;
use gearwatch_core::baseline::{Baseline, BaselineConfig};
use gearwatch_core::block::Packet;
use gearwatch_core::pipeline::{Pipeline, PipelineConfig};
use gearwatch_core::source::Source;
use gearwatch_core::verdict::{MachineState, Verdict};
use gearwatch_daemon::engine::Told;
use gearwatch_daemon::oneshot;

use super::Run;
use crate::exit::Exit;
use crate::input::{self, Input};
use crate::output::{OutputOptions, with_sidecars};
use crate::terminal;

mod plain;
mod report;
mod table;

/// Say once what recordings tell of the gears: rank codes, averaged over each recording
///
/// All windows of a recording at one operating point are averaged, which resolves ranks that no
/// single window can. The verdict on one line of the table is that of one gear stage at one sensor.
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch diagnose today.mcap --bench bench.toml --baseline normal.json
  gearwatch diagnose *.csv.gz -b bench.toml -n normal.json --sample-rate 12800 --unit g -f csv
  gearwatch diagnose today.mcap -b bench.toml -n normal.json -f nagios             for Nagios or Icinga
  gearwatch diagnose today.mcap -b bench.toml -n normal.json --report today.html   a page to hand on
  gearwatch diagnose today.mcap -b bench.toml -n normal.json --windows             each window, as replay does

Exit codes: 0 within limits; 1 warning: a deviation of rank I to III, or the path from gear to sensor changed; 2 critical: rank IV \
or V; 3 unknown: nothing resolved, no baseline here, an instrument fault, a channel missing, bad input. Of several, 2 goes before 1, \
1 before 3, 3 before 0. With --windows every window counts by itself: one alone resolves less than the average of all, so that a \
healthy recording may end with 3. Colours appear on a terminal only, and never where NO_COLOR is set.")]
pub struct Diagnose {
    #[command(flatten)]
    input: Input,
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
    /// Form of the result
    #[arg(short, long, value_enum, default_value_t)]
    format: Format,
    /// Every window by itself, one JSON object a line, not the averages
    #[arg(long, conflicts_with = "format")]
    windows: bool,
    /// Also write a report: one HTML file with pictures, for a browser
    #[arg(long, value_name = "FILE.html", conflicts_with = "windows")]
    report: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OutputOptions,
    /// Threads for the spectra; 0: one a core. The result does not depend on it
    #[arg(short, long, default_value_t = 0, value_name = "N")]
    workers: usize,
}

#[derive(Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
enum Format {
    /// For people
    #[default]
    Table,
    /// One JSON object a line
    Json,
    /// With a header line
    Csv,
    /// One line with performance data, for Nagios, Icinga and the like
    Nagios,
}

/// What one recording says.
pub(super) struct Diagnosis {
    /// As given on the command line.
    recording: String,
    /// Verdicts on the averages, by channel and operating point, stages in order.
    verdicts: Vec<Verdict>,
    /// What the worst of the windows means, where windows were printed one by one.
    worst_window: Option<Exit>,
    /// What is incomplete or doubtful, one sentence each.
    notes: Vec<String>,
    /// Windows by sensor.
    windows: BTreeMap<String, u64>,
    /// Something is missing, so that no verdict can mean that all is well.
    incomplete: bool,
    /// For the report.
    pictures: Option<report::Pictures>,
}

/// What is collected while a recording is read.
struct Collected {
    aggregate: Aggregate,
    /// Windows are printed one by one, not averaged.
    lines: Option<plain::Lines>,
    by_sensor: BTreeMap<String, u64>,
    failed: u64,
    pictures: Option<report::Pictures>,
}

impl Run for Diagnose {
    const NAME: &'static str = "diagnose";
    const COMPUTES: bool = true;

    fn run(self) -> anyhow::Result<Exit> {
        let inputs = [Some(&self.bench), self.baseline.as_ref(), self.signatures.as_ref()].into_iter().flatten();
        let mut outputs = self.overwrite.reading(with_sidecars(&self.input.files)).reading(inputs);
        let report = self.report.as_deref().map(|path| outputs.target(path)).transpose()?;
        let bench = gearwatch_io::bench_file::read(&self.bench)?;
        let config = PipelineConfig::default();
        let baseline = match &self.baseline {
            Some(path) => Some(gearwatch_io::baseline_file::read_for(path, &bench, config.window.length_s)?),
            None => None,
        };
        let files = &self.input.files;
        let checked = super::check::before("diagnose", &bench, files, &self.input.options, baseline.as_ref())?;
        let expected = expected_channels(&bench, baseline.as_ref());
        let tolerances = baseline.as_ref().map_or_else(BaselineConfig::default, |baseline| baseline.config);
        let learned_from = baseline.clone();
        let pipeline = input::pipeline(&bench, baseline, self.signatures.as_deref())?;
        let mut all = Vec::new();
        let mut failed = None;
        for path in &self.input.files {
            let doubts = checked.doubts(&gearwatch_sources::name_of(path));
            let pipeline = Arc::new(pipeline.clone().with_doubts(&doubts));
            match self.diagnose(path, &pipeline, &expected, tolerances) {
                Ok(mut diagnosis) => {
                    diagnosis.note_findings(path, &checked);
                    diagnosis.note_the_baseline_itself(learned_from.as_ref());
                    diagnosis.note_what_is_short(learned_from.as_ref());
                    all.push(diagnosis);
                }
                // The other files are diagnosed all the same.
                Err(error) if self.input.files.len() > 1 => {
                    let _ = writeln!(terminal::err(), "gearwatch diagnose: {error:#}");
                    failed = Some(Exit::Unknown);
                }
                Err(error) => return Err(error),
            }
        }
        let exit = all.iter().map(Diagnosis::exit).chain(failed).max_by_key(|exit| severity(*exit));
        let exit = exit.unwrap_or(Exit::Unknown);
        self.print(&all, &pipeline, exit)?;
        if let Some(target) = report {
            let baseline = self.baseline.as_deref().map(|path| ("baseline", path));
            let files: Vec<_> = [("bench", self.bench.as_path())].into_iter().chain(baseline).collect();
            let path = target.path().to_owned();
            target.write(report::page(&all, &pipeline, &files)?)?;
            let _ = writeln!(terminal::err(), "gearwatch diagnose: the report is {}", path.display());
        }
        Ok(exit)
    }
}

impl Diagnose {
    fn diagnose(
        &self,
        path: &Path,
        pipeline: &Arc<Pipeline>,
        expected: &BTreeSet<String>,
        tolerances: BaselineConfig,
    ) -> anyhow::Result<Diagnosis> {
        let mut source = self.input.options.open(path)?;
        let mut heard = BTreeSet::new();
        let pull = || {
            let packet = source.next_packet()?;
            if let Some(Packet::Vibration(block)) = &packet
                && !heard.contains(&*block.sensor)
            {
                heard.insert(block.sensor.to_string());
            }
            Ok(packet)
        };
        let collected = Collected {
            aggregate: Aggregate::new(tolerances),
            lines: self.windows.then(|| plain::Lines::new(path, self.input.files.len() > 1)),
            by_sensor: BTreeMap::new(),
            failed: 0,
            pictures: self.report.is_some().then(report::Pictures::default),
        };
        let workers = match self.workers {
            0 => std::thread::available_parallelism().map_or(1, usize::from),
            count => count,
        };
        let (collected, samples) =
            oneshot::run::<gearwatch_io::ReadError, _>(pipeline, workers, pull, collected, Collected::take)?;
        let mut diagnosis = Diagnosis {
            recording: terminal::plain(&path.display().to_string()).into_owned(),
            verdicts: Vec::new(),
            worst_window: None,
            windows: collected.by_sensor.clone(),
            notes: source.opened().warnings().iter().map(|note| terminal::plain(note).into_owned()).collect(),
            incomplete: false,
            pictures: None,
        };
        diagnosis.note_losses(&collected, &samples, pipeline.config().window.length_s);
        for sensor in expected.difference(&heard) {
            diagnosis.incomplete = true;
            let there: Vec<_> = heard.iter().map(String::as_str).collect();
            diagnosis.notes.push(format!(
                "channel {sensor:?} is missing; the recording has {} (--channel {sensor}=COLUMN gives a column this name)",
                there.join(", ")
            ));
        }
        for sensor in heard.iter().filter(|sensor| !collected.by_sensor.contains_key(*sensor)) {
            diagnosis.incomplete = true;
            let length_s = pipeline.config().window.length_s;
            diagnosis
                .notes
                .push(format!("channel {sensor:?} has no {length_s} s without a gap: too short for a window"));
        }
        if let Some(lines) = collected.lines {
            diagnosis.worst_window = lines.finish()?;
            return Ok(diagnosis);
        }
        diagnosis.pictures = collected.pictures;
        let mut verdicts = Vec::new();
        for average in collected.aggregate.finish() {
            pipeline.judging().judge_average(&average, &mut verdicts);
            diagnosis.verdicts.append(&mut verdicts);
        }
        Ok(diagnosis)
    }

    fn print(&self, all: &[Diagnosis], pipeline: &Pipeline, exit: Exit) -> anyhow::Result<()> {
        // Colours are taken out where the output is no terminal or NO_COLOR is set.
        let mut out = std::io::BufWriter::new(terminal::coloured());
        // Windows were printed as they came.
        if !self.windows {
            match self.format {
                Format::Table => all.iter().try_for_each(|one| table::table(&mut out, one, pipeline.train()))?,
                Format::Json => plain::lines(&mut out, all)?,
                Format::Csv => plain::csv(&mut out, all)?,
                Format::Nagios => plain::nagios(&mut out, all, exit)?,
            }
        }
        out.flush()?;
        // The table has its notes beside the verdicts.
        if self.windows || self.format != Format::Table {
            for (one, note) in all.iter().flat_map(|one| one.notes.iter().map(move |note| (one, note))) {
                writeln!(terminal::err(), "{}: {note}", one.recording)?;
            }
        }
        Ok(())
    }
}

impl Collected {
    fn take(&mut self, told: Told<'_>) {
        match told {
            Told::Window(window, analysis) => {
                *self.by_sensor.entry(window.sensor.to_string()).or_default() += 1;
                if self.lines.is_none() {
                    self.aggregate.push(analysis);
                }
                if let Some(pictures) = &mut self.pictures {
                    pictures.window(window, analysis);
                }
            }
            Told::Verdict(verdict) => {
                if let Some(lines) = &mut self.lines {
                    lines.print(verdict);
                }
                if let Some(pictures) = &mut self.pictures {
                    pictures.verdict(verdict);
                }
            }
            Told::Failed { .. } => self.failed += 1,
            Told::Gap(_) | Told::Shed(_) => {}
        }
    }
}

impl Diagnosis {
    fn note_losses(&mut self, collected: &Collected, samples: &Counters, length_s: f64) {
        for ((sensor, why), &count) in collected.aggregate.refused() {
            let of = collected.by_sensor.get(&**sensor).copied().unwrap_or(count);
            self.incomplete |= count == of;
            self.notes.push(format!("channel {sensor:?}: {count} of {of} windows left out: {why}"));
        }
        for (sensor, stride, kept, of) in collected.aggregate.thinned() {
            self.notes.push(format!("channel {sensor:?}: every {stride}th window is averaged, {kept} of {of}"));
        }
        if samples.gaps > 0 {
            self.notes.push(format!(
                "{} gap(s), {} samples missing; {} samples lie between gaps closer than {length_s} s and were not used",
                samples.gaps, samples.samples_missing, samples.samples_discarded
            ));
        }
        if collected.failed > 0 {
            self.incomplete = true;
            self.notes.push(format!("{} windows could not be analysed: a fault of this program", collected.failed));
        }
    }

    /// What the check of the bench found doubtful, beside the verdicts.
    fn note_findings(&mut self, path: &Path, checked: &Checked) {
        let name = gearwatch_sources::name_of(path);
        let of_it = checked.of(Severity::Doubtful).filter(|f| f.recording.is_empty() || f.recording == name);
        self.notes.extend(of_it.map(|finding| format!("doubtful: {finding}")));
    }

    /// A channel that ends before the others, and a recording of half the length of those that the
    /// baseline knows: what is missing was not judged.
    fn note_what_is_short(&mut self, baseline: Option<&Baseline>) {
        let longest = self.windows.values().copied().max().unwrap_or(0);
        for (sensor, &windows) in &self.windows {
            if windows + 2 < longest && 10 * windows < 9 * longest {
                self.incomplete = true;
                self.notes.push(format!(
                    "channel {sensor:?} has {windows} windows where another has {longest}: what is missing of it was not judged"
                ));
            }
        }
        let runs = baseline.into_iter().flat_map(|baseline| &baseline.runs);
        let usual = runs.flat_map(|run| run.channels.values()).map(|channel| u64::from(channel.windows)).min();
        // What was found wrong in a part stands; only "normal" could be wrong for what is missing.
        let all_normal =
            !self.verdicts.is_empty() && self.verdicts.iter().all(|verdict| verdict.machine == MachineState::Normal);
        if let Some(usual) = usual.filter(|usual| all_normal && longest > 0 && 10 * longest < 6 * usual) {
            self.notes.push(format!(
                "it has {longest} windows, the shortest recording of the baseline {usual}: if it was cut short, its end was not judged"
            ));
        }
    }

    /// A recording that is judged by itself deviates by nothing, whatever its machine is like.
    fn note_the_baseline_itself(&mut self, baseline: Option<&Baseline>) {
        let runs = baseline.into_iter().flat_map(|baseline| &baseline.runs);
        let stages = baseline.map(|baseline| baseline.stages.as_slice()).unwrap_or_default();
        let same = |run: &&gearwatch_core::baseline::Run| {
            let known = self.verdicts.iter().filter_map(|verdict| {
                let stage = stages.iter().position(|name| *name == verdict.stage)?;
                let lines = run.channels.get(&verdict.channel)?.stages.get(stage)?;
                Some(verdict.harmonics.iter().zip(lines))
            });
            let mut equal = known.flatten().filter_map(|(now, then)| {
                let then = then.as_ref()?;
                now.amplitude.is_known().then(|| (now.amplitude.value / then.amplitude - 1.0).abs() < 1e-9)
            });
            // All its lines, to the last digit.
            equal.next() == Some(true) && equal.all(|same| same)
        };
        if let Some(run) = runs.into_iter().find(same) {
            self.notes.push(format!(
                "it is in the baseline itself ({}, session {:?}): it is judged by what was learned from it, and says nothing",
                run.recording, run.session
            ));
        }
    }

    fn exit(&self) -> Exit {
        let missing =
            (self.incomplete || (self.verdicts.is_empty() && self.worst_window.is_none())).then_some(Exit::Unknown);
        let verdicts = self.verdicts.iter().map(|verdict| exit_of(verdict.machine)).chain(self.worst_window);
        verdicts.chain(missing).max_by_key(|exit| severity(*exit)).unwrap_or(Exit::Unknown)
    }
}

/// Channels that a recording must have: those of the baseline, else those of the bench file.
fn expected_channels(bench: &gearwatch_core::bench::Bench, baseline: Option<&Baseline>) -> BTreeSet<String> {
    match baseline {
        Some(baseline) => baseline.runs.iter().flat_map(|run| run.channels.keys().cloned()).collect(),
        None => bench.sensors.iter().map(|sensor| sensor.name.clone()).collect(),
    }
}

fn exit_of(machine: MachineState) -> Exit {
    match machine {
        MachineState::Normal => Exit::Ok,
        MachineState::Deviating | MachineState::PathChanged => Exit::Warning,
        MachineState::Alarm => Exit::Critical,
        MachineState::Unknown => Exit::Unknown,
    }
}

/// Of several verdicts the most severe counts; unknown is worse than good, and never good.
fn severity(exit: Exit) -> u8 {
    match exit {
        Exit::Ok => 0,
        Exit::Unknown | Exit::Broken => 1,
        Exit::Warning => 2,
        Exit::Critical => 3,
    }
}
