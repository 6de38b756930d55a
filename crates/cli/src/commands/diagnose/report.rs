//! A diagnosis to be handed on: one HTML file.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use gearwatch_core::analysis::WindowAnalysis;
use gearwatch_core::order_spectrum::{OrderSpectrum, Orders};
use gearwatch_core::pipeline::Pipeline;
use gearwatch_core::train::StageKinematics;
use gearwatch_core::verdict::{HARMONICS, MachineState, Rank, Verdict};
use gearwatch_core::window::Window;
use gearwatch_history::time::iso;
use gearwatch_report::{Cell, Chart, Deviation, Deviations, Lines, Mark, Part, Report, Section, Series, Table, Tone};

use super::{Diagnosis, exit_of, severity, table};

const DAY_NS: i64 = 86_400_000_000_000;
/// Verdicts shown with table and picture; all are in the overview.
const MOST_DETAILS: usize = 24;
/// Windows that go into a mean spectrum or a trend before every second one is passed over.
const MANY: usize = 512;
/// Lines of a spectrum that a picture can show.
const SPECTRUM_POINTS: usize = 4000;

/// What a report shows beyond the verdicts, collected while a recording is read. Bounded, however
/// long it is.
#[derive(Default)]
pub(super) struct Pictures {
    spectrum: OrderSpectrum,
    orders: Orders,
    spectra: BTreeMap<Arc<str>, MeanSpectrum>,
    trends: BTreeMap<(String, String), Trend>,
}

/// Mean square over windows, on the orders of the first.
struct MeanSpectrum {
    unit: Arc<str>,
    step: f64,
    power: Vec<f64>,
    thinning: Thinning,
}

/// Every window at first, later every second, fourth …
struct Thinning {
    every: u64,
    taken: usize,
}

impl Default for Thinning {
    fn default() -> Self {
        Self { every: 1, taken: 0 }
    }
}

impl Thinning {
    fn takes(&mut self, window: u64) -> bool {
        if !window.is_multiple_of(self.every) {
            return false;
        }
        self.taken += 1;
        if self.taken.is_multiple_of(MANY) {
            self.every *= 2;
        }
        true
    }
}

#[derive(Default)]
struct Trend {
    thinning: Thinning,
    /// Time (ns), deviation of 1x to 5x (percent).
    points: Vec<(i64, [f64; HARMONICS])>,
}

impl Pictures {
    pub(super) fn window(&mut self, window: &Window, analysis: &WindowAnalysis) {
        let mean = self.spectra.entry(window.sensor.clone()).or_insert_with(|| MeanSpectrum {
            unit: window.unit.clone(),
            step: f64::NAN,
            power: Vec::new(),
            thinning: Thinning::default(),
        });
        if !analysis.input_speed_hz.is_known()
            || !mean.thinning.takes(window.number)
            || !self.spectrum.window(&window.samples, analysis, &mut self.orders)
        {
            return;
        }
        if mean.power.is_empty() {
            mean.step = self.orders.step;
            mean.power = vec![0.0; self.orders.amplitude.len()];
        }
        for (k, amplitude) in self.orders.amplitude.iter().enumerate() {
            let at = (k as f64 * self.orders.step / mean.step).round() as usize;
            if let Some(power) = mean.power.get_mut(at) {
                *power += amplitude * amplitude;
            }
        }
    }

    pub(super) fn verdict(&mut self, verdict: &Verdict) {
        let trend = self.trends.entry((verdict.stage.clone(), verdict.channel.clone())).or_default();
        if trend.thinning.takes(verdict.window) {
            trend.points.push((verdict.t0, verdict.harmonics.map(|h| h.deviation_percent.value)));
        }
    }
}

/// The report of all recordings.
pub(super) fn page(all: &[Diagnosis], pipeline: &Pipeline, files: &[(&'static str, &Path)]) -> anyhow::Result<String> {
    let worst = all.iter().map(Diagnosis::exit).max_by_key(|exit| severity(*exit));
    let verdicts: Vec<&Verdict> = all.iter().flat_map(|one| &one.verdicts).collect();
    let machine =
        verdicts.iter().max_by_key(|v| severity(exit_of(v.machine))).map_or(MachineState::Unknown, |v| v.machine);
    let mut report = Report {
        title: match all {
            [one] => format!("{}: {}", pipeline.bench().name, one.recording),
            _ => format!("{}: {} recordings", pipeline.bench().name, all.len()),
        },
        verdict: sentence(&verdicts, all),
        tone: if worst.is_some_and(|w| w == crate::exit::Exit::Unknown) { Tone::Unknown } else { tone(machine) },
        sections: vec![about(all, pipeline), overview(all)],
        appendix: Vec::new(),
        provenance: provenance(all, pipeline, files)?,
    };
    report.sections.extend(all.iter().map(|one| recording(one, pipeline)));
    report.appendix.extend(all.iter().map(|one| figures(one, pipeline)));
    report.sections.push(not_judged(all));
    Ok(gearwatch_report::render(&report))
}

fn sentence(verdicts: &[&Verdict], all: &[Diagnosis]) -> String {
    let of = |state: MachineState| verdicts.iter().filter(|v| v.machine == state).count();
    let named = |state: MachineState| {
        let mut places: Vec<String> =
            verdicts.iter().filter(|v| v.machine == state).map(|v| format!("{} at {}", v.stage, v.channel)).collect();
        places.dedup();
        places.truncate(4);
        places.join(", ")
    };
    let incomplete =
        if all.iter().any(|one| one.incomplete) { " Something is missing: see what was not judged." } else { "" };
    let counts = format!(
        "{} verdicts: {} normal, {} deviating, {} alarm, {} path changed, {} unknown.",
        verdicts.len(),
        of(MachineState::Normal),
        of(MachineState::Deviating),
        of(MachineState::Alarm),
        of(MachineState::PathChanged),
        of(MachineState::Unknown)
    );
    let first = if of(MachineState::Alarm) > 0 {
        format!("Alarm: {}.", named(MachineState::Alarm))
    } else if of(MachineState::Deviating) > 0 {
        format!("Deviating from the baseline: {}.", named(MachineState::Deviating))
    } else if of(MachineState::PathChanged) > 0 {
        format!("The path from gear to sensor changed: {}.", named(MachineState::PathChanged))
    } else if of(MachineState::Normal) == verdicts.len() && !verdicts.is_empty() {
        "Within limits.".to_owned()
    } else {
        "Not all could be judged.".to_owned()
    };
    format!("{first} {counts}{incomplete}")
}

fn tone(machine: MachineState) -> Tone {
    match machine {
        MachineState::Normal => Tone::Good,
        MachineState::Deviating | MachineState::PathChanged => Tone::Warning,
        MachineState::Alarm => Tone::Bad,
        MachineState::Unknown => Tone::Unknown,
    }
}

/// The rank that the verdict bears out, as on the live page: a naked V on a stage that is called
/// normal is no alarm. None where nothing is known.
fn borne_out(machine: MachineState, rank: Rank) -> Option<usize> {
    let level = usize::try_from(rank.level()).ok()?;
    match machine {
        MachineState::Unknown => None,
        MachineState::Normal => Some(0),
        MachineState::Deviating | MachineState::PathChanged => Some(level.min(3)),
        MachineState::Alarm => Some(level),
    }
}

fn rank_tone(machine: MachineState, rank: Rank) -> Tone {
    match borne_out(machine, rank) {
        None => Tone::Unknown,
        Some(0) if rank == Rank::Zero => Tone::Good,
        // It stands there, and is not borne out.
        Some(0) => Tone::Plain,
        Some(1..=3) => Tone::Warning,
        Some(_) => Tone::Bad,
    }
}

/// The machine, and when it was recorded.
fn about(all: &[Diagnosis], pipeline: &Pipeline) -> Section {
    let times = || all.iter().flat_map(|one| &one.verdicts).map(|v| v.t0);
    let mut rows = vec![vec![Cell::from("Bench"), pipeline.bench().name.as_str().into()]];
    if let (Some(first), Some(last)) = (times().min(), times().max()) {
        // A recording without a clock begins at 1970, which is no date.
        let recorded = match first {
            ..DAY_NS => "the recordings state no date".to_owned(),
            _ if first == last => iso(first),
            _ => format!("{} to {}", iso(first), iso(last)),
        };
        rows.push(vec!["Recorded (first windows, UTC)".into(), recorded.into()]);
    }
    rows.push(vec!["Date of the report (UTC)".into(), iso(now_ns()).into()]);
    let table = Table { caption: "Bench and dates".into(), head: ["what", "stated"].map(str::to_owned).to_vec(), rows };
    Section {
        heading: "About".into(),
        parts: vec![Part::Table(table), Part::Chart(crate::commands::sketch::chart(pipeline.bench()))],
    }
}

fn now_ns() -> i64 {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    now.map_or(0, |t| i64::try_from(t.as_nanos()).unwrap_or(0))
}

fn overview(all: &[Diagnosis]) -> Section {
    let mut rows = Vec::new();
    for one in all {
        for verdict in &one.verdicts {
            let mut row = vec![Cell::from(one.recording.as_str())];
            row.push(format!("{} at {}", verdict.stage, verdict.channel).into());
            row.push(table::operating_point(verdict).into());
            row.push(Cell::toned(verdict.machine.code().replace('_', " "), tone(verdict.machine)));
            row.extend(
                verdict.harmonics.iter().map(|h| Cell::toned(h.rank.code(), rank_tone(verdict.machine, h.rank))),
            );
            row.push(verdict.windows.to_string().into());
            rows.push(row);
        }
    }
    let head = ["recording", "place", "operating point", "machine", "1x", "2x", "3x", "4x", "5x", "windows"];
    Section {
        heading: "What was judged".into(),
        parts: vec![Part::Table(Table {
            caption: "Ranks of the averages: |deviation| at 1, 4, 7, 10, 13 % are I to V".into(),
            head: head.map(str::to_owned).to_vec(),
            rows,
        })],
    }
}

fn recording(one: &Diagnosis, pipeline: &Pipeline) -> Section {
    let mut parts = Vec::new();
    let mut ordered: Vec<&Verdict> = one.verdicts.iter().collect();
    // Stable: those of equal severity stay in their order.
    ordered.sort_by_key(|v| std::cmp::Reverse(severity(exit_of(v.machine))));
    if ordered.len() > MOST_DETAILS {
        let all = ordered.len();
        parts.push(Part::Text(format!("The {MOST_DETAILS} most severe of {all} verdicts; all are in the overview.")));
        ordered.truncate(MOST_DETAILS);
    }
    for verdict in ordered {
        let known = verdict.harmonics.iter().any(|h| h.deviation_percent.is_known());
        parts.push(if known { Part::Chart(bars(verdict, pipeline)) } else { Part::Text(heading(verdict)) });
    }
    if let Some(pictures) = &one.pictures {
        let marks = marks(pipeline);
        let seen = pictures.spectra.iter().filter(|(_, mean)| !mean.power.is_empty());
        parts.extend(seen.map(|(sensor, mean)| Part::Chart(spectrum(sensor, mean, &marks))));
        parts.extend(pictures.trends.iter().filter_map(|(place, t)| trend(place, t)).map(Part::Chart));
    }
    Section { heading: one.recording.clone(), parts }
}

/// The numbers behind the pictures of a recording.
fn figures(one: &Diagnosis, pipeline: &Pipeline) -> Section {
    let mut ordered: Vec<&Verdict> = one.verdicts.iter().collect();
    ordered.sort_by_key(|v| std::cmp::Reverse(severity(exit_of(v.machine))));
    let tables = ordered.into_iter().take(MOST_DETAILS).map(|verdict| Part::Table(harmonics(verdict, pipeline)));
    Section { heading: one.recording.clone(), parts: tables.collect() }
}

/// What is judged, in a sentence.
fn heading(verdict: &Verdict) -> String {
    let reason = match verdict.reason.code() {
        "" => String::new(),
        code => format!(" ({})", code.replace('_', " ")),
    };
    format!(
        "{} at {}: {}{reason}{}. {}, mean of {} windows.",
        verdict.stage,
        verdict.channel,
        verdict.machine.code().replace('_', " "),
        table::nearest(verdict),
        table::operating_point(verdict),
        verdict.windows
    )
}

/// The mesh harmonics, one row of names a stage.
fn marks(pipeline: &Pipeline) -> Vec<Mark> {
    let stages = pipeline.train().stages.iter().zip(0..);
    let of = |(stage, row): (&StageKinematics, u32)| {
        let mark = move |h: usize| Mark { x: stage.harmonic_order(h), label: format!("{} {h}x", stage.name), row };
        (1..=HARMONICS).map(mark).collect::<Vec<_>>()
    };
    stages.flat_map(of).collect()
}

fn harmonics(verdict: &Verdict, pipeline: &Pipeline) -> Table {
    let rows = verdict.harmonics.iter().enumerate().map(|(k, h)| {
        let estimate = |e: &gearwatch_core::estimate::Estimate, show: fn(f64) -> String| {
            if e.is_known() { format!("{} ± {}", show(e.value), show(e.sigma)) } else { "–".to_owned() }
        };
        let probability =
            if h.rank_probability.is_finite() { format!("{:.2}", h.rank_probability) } else { "–".to_owned() };
        vec![
            Cell::from(format!("{}x, {:.2} Hz", k + 1, table::line_hz(pipeline.train(), verdict, k + 1))),
            Cell::toned(h.rank.code(), rank_tone(verdict.machine, h.rank)),
            probability.into(),
            estimate(&h.deviation_percent, |x| format!("{x:.2}")).into(),
            estimate(&h.amplitude, table::figure).into(),
            table::figure(h.baseline).into(),
            table::figure(h.floor).into(),
        ]
    });
    Table {
        caption: format!("{} ± is one standard deviation.", heading(verdict)),
        head: [
            "harmonic".to_owned(),
            "rank".to_owned(),
            "probability".to_owned(),
            "deviation (%)".to_owned(),
            format!("amplitude ({})", verdict.unit),
            format!("normal ({})", verdict.unit),
            format!("floor ({})", verdict.unit),
        ]
        .to_vec(),
        rows: rows.collect(),
    }
}

fn bars(verdict: &Verdict, pipeline: &Pipeline) -> Chart {
    let bars = verdict.harmonics.iter().enumerate().map(|(k, h)| Deviation {
        name: format!("{}x", k + 1),
        percent: h.deviation_percent.value,
        sigma_percent: h.deviation_percent.sigma,
        rank: borne_out(verdict.machine, h.rank),
    });
    Chart::Deviations(Deviations {
        caption: format!(
            "{} Deviation from the baseline with one standard deviation, coloured by the rank that is proven.",
            heading(verdict)
        ),
        bars: bars.collect(),
        steps_percent: pipeline.config().rank.steps_percent.to_vec(),
    })
}

fn spectrum(sensor: &str, mean: &MeanSpectrum, marks: &[Mark]) -> Chart {
    let highest = 1.08 * marks.iter().map(|m| m.x).fold(0.0, f64::max);
    let windows = mean.thinning.taken as f64;
    let points: Vec<(f64, f64)> = mean
        .power
        .iter()
        .enumerate()
        .skip(1)
        .map(|(k, power)| (k as f64 * mean.step, (power / windows).sqrt()))
        .take_while(|point| point.0 <= highest)
        .collect();
    let group = points.len().div_ceil(SPECTRUM_POINTS).max(1);
    let largest = |points: &[(f64, f64)]| points.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or_default();
    Chart::Lines(Lines {
        caption: format!("{sensor}: order spectrum, root mean square of {} windows", mean.thinning.taken),
        x_label: "order of the input shaft".into(),
        y_label: format!("peak amplitude ({})", mean.unit),
        log_y: true,
        series: vec![Series { name: sensor.to_owned(), points: points.chunks(group).map(largest).collect() }],
        marks: marks.to_vec(),
    })
}

/// Deviation of the harmonics over time; nothing where there was no baseline.
fn trend((stage, channel): &(String, String), trend: &Trend) -> Option<Chart> {
    let first = trend.points.first()?.0;
    let series: Vec<Series> = (0..HARMONICS)
        .map(|h| Series {
            name: format!("{}x", h + 1),
            points: trend.points.iter().map(|(t, d)| ((t - first) as f64 * 1e-9, d[h])).collect(),
        })
        .collect();
    if !series.iter().flat_map(|s| &s.points).any(|p| p.1.is_finite()) || trend.points.len() < 2 {
        return None;
    }
    Some(Chart::Lines(Lines {
        caption: format!("{stage} at {channel}: deviation of single windows"),
        x_label: "time (s)".into(),
        y_label: "deviation (%)".into(),
        log_y: false,
        series,
        marks: Vec::new(),
    }))
}

fn not_judged(all: &[Diagnosis]) -> Section {
    let mut lines = Vec::new();
    for one in all {
        lines.extend(one.notes.iter().map(|note| format!("{}: {note}", one.recording)));
        let unknown = one.verdicts.iter().filter(|v| v.machine == MachineState::Unknown);
        lines.extend(unknown.map(|v| {
            let reason = v.reason.code().replace('_', " ");
            format!("{}: {} at {} is unknown: {reason}", one.recording, v.stage, v.channel)
        }));
    }
    let part = if lines.is_empty() { Part::Text("Nothing was left out.".into()) } else { Part::List(lines) };
    Section { heading: "What was not judged, and why".into(), parts: vec![part] }
}

fn provenance(
    all: &[Diagnosis],
    pipeline: &Pipeline,
    files: &[(&'static str, &Path)],
) -> anyhow::Result<Vec<(String, String)>> {
    let mut out = vec![("gearwatch".to_owned(), env!("CARGO_PKG_VERSION").to_owned())];
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    out.push(("command".into(), format!("gearwatch {}", arguments.join(" "))));
    let recordings = all.iter().map(|one| ("recording", Path::new(&one.recording)));
    for (what, path) in files.iter().copied().chain(recordings) {
        let sha256 = crate::input::sha256_of(path)?;
        out.push((what.to_owned(), format!("{}, SHA-256 {sha256}", path.display())));
    }
    let config = pipeline.config();
    out.push(("window".into(), format!("{} s, every {} s", config.window.length_s, config.window.hop_s)));
    out.push(("rank steps".into(), format!("{:?} %", config.rank.steps_percent)));
    Ok(out)
}
