//! Signatures to be handed on: one HTML file.

use std::f64::consts::TAU;
use std::path::Path;

use gearwatch_core::bench::Bench;
use gearwatch_core::rank::RankConfig;
use gearwatch_core::signature::Expected;
use gearwatch_core::train::Train;
use gearwatch_core::verdict::Rank;
use gearwatch_report::{Bars, Cell, Chart, Lines, Mark, Part, Report, Section, Series, Table, Tone};
use gearwatch_sim::lines::order_spectrum;
use gearwatch_sim::model::TrainModel;
use gearwatch_sim::rotation::Profile;
use gearwatch_sim::signatures::{self, Conditions, STATES, Signatures, Simulated};

use super::Comparison;

/// States in the pictures, by number: normal, 3/5 broken, four pits, the fourth composite.
const PICTURED: [usize; 4] = [0, 3, 9, 13];
/// Mesh cycles of the stiffness that are shown, about the damaged tooth.
const CYCLES: f64 = 4.0;
/// Length of the record that spectra are made from, and what is left out before it (s).
const RECORD_S: f64 = 2.0;
const SETTLE_S: f64 = 1.0;
/// Lines per revolution of the first shaft in the spectra.
const LINES_PER_ORDER: f64 = 10.0;
/// Draws where the trains of the spectra start.
const SEED: u64 = 0;

/// The page of all operating points.
pub(super) fn page(path: &Path, bench: &Bench, all: &[Signatures]) -> anyhow::Result<String> {
    let ranks = RankConfig::default();
    let mut sections = Vec::new();
    for found in all {
        sections.push(table(bench, found, &ranks));
        sections.push(paper(bench, found, &ranks));
        sections.push(pictures(bench, found)?);
    }
    sections.push(method(all));
    Ok(gearwatch_report::render(&Report {
        title: format!("{}: what faults do to its mesh harmonics", bench.name),
        verdict: sentence(bench, all, &ranks),
        tone: Tone::Plain,
        sections,
        appendix: Vec::new(),
        provenance: provenance(path, bench, &ranks)?,
    }))
}

/// What a fault changes at most, and from which state on it can be ranked.
fn sentence(bench: &Bench, all: &[Signatures], ranks: &RankConfig) -> String {
    let Some(found) = all.first() else { return "Nothing was simulated.".into() };
    let largest = |state: &Simulated| {
        state.deviations_percent.iter().flatten().fold(0.0_f64, |most, deviation| most.max(deviation.abs()))
    };
    let shown: Vec<&str> = (found.states.iter().skip(1))
        .filter(|state| ranks.rank_of(largest(state)) != Rank::Zero)
        .map(|state| state.state.name)
        .collect();
    let Conditions { stage, motor_hz, torque_nm, .. } = found.conditions;
    let most = found.states.iter().map(largest).fold(0.0, f64::max);
    let place = format!("{} {} at {motor_hz} Hz and {torque_nm} N m", bench.stages[stage].name, gear(found));
    if shown.is_empty() {
        format!("No state of the {place} reaches rank I: 1x to 5x change by {most:.2} % at most.")
    } else {
        format!(
            "Of the {place}, {} of 13 states reach rank I or more: {}. The largest change is {most:.1} %.",
            shown.len(),
            shown.join(", ")
        )
    }
}

fn gear(found: &Signatures) -> &'static str {
    if found.conditions.wheel { "wheel" } else { "pinion" }
}

fn heading(bench: &Bench, found: &Signatures, what: &str) -> String {
    let Conditions { stage, motor_hz, torque_nm, .. } = found.conditions;
    format!("{what}: {} {}, {motor_hz} Hz, {torque_nm} N m", bench.stages[stage].name, gear(found))
}

fn tone(rank: Rank) -> Tone {
    match rank {
        Rank::Unknown => Tone::Unknown,
        Rank::Zero => Tone::Plain,
        Rank::I | Rank::II | Rank::III => Tone::Warning,
        Rank::IV | Rank::V => Tone::Bad,
    }
}

fn head(first: &str) -> Vec<String> {
    std::iter::once(first.to_owned()).chain((1..=5).map(|h| format!("{h}x"))).collect()
}

/// Faults against harmonics, a table a sensor.
fn table(bench: &Bench, found: &Signatures, ranks: &RankConfig) -> Section {
    let tables = bench.sensors.iter().enumerate().map(|(s, sensor)| {
        let rows = found.states.iter().enumerate().map(|(i, state)| {
            let name =
                if state.stepped { format!("{} (stepped)", state.state.name) } else { state.state.name.to_owned() };
            let cells = state.deviations_percent[s].iter().zip(state.amplitudes[s]).map(|(&deviation, amplitude)| {
                if i == 0 {
                    return Cell::from(format!("{amplitude:.3e} m/s²"));
                }
                let rank = ranks.rank_of(deviation);
                let sigma = signatures::sigma_percent(deviation);
                Cell::toned(format!("{deviation:+.2} ± {sigma:.2} % · {}", rank.code()), tone(rank))
            });
            std::iter::once(Cell::from(name)).chain(cells).collect()
        });
        Part::Table(Table {
            caption: format!(
                "{}: amplitude of the normal state; signed deviations from it ± 1 sigma, rank",
                sensor.name
            ),
            head: head("state"),
            rows: rows.collect(),
        })
    });
    let bars = bench.sensors.iter().enumerate().map(|(s, sensor)| {
        let series = PICTURED.iter().skip(1).map(|&i| {
            let state = &found.states[i];
            let values = state.deviations_percent[s].map(|d| (d, signatures::sigma_percent(d)));
            (state.state.name.to_owned(), values.to_vec())
        });
        Part::Chart(Chart::Bars(Bars {
            caption: format!("{}: deviation of 1x to 5x with 1 sigma; lines at the limits of the ranks", sensor.name),
            y_label: "deviation (%)".into(),
            groups: (1..=5).map(|h| format!("{h}x")).collect(),
            series: series.collect(),
            limits: ranks.steps_percent.to_vec(),
        }))
    });
    Section { heading: heading(bench, found, "Harmonics by state"), parts: tables.chain(bars).collect() }
}

/// Own ranks beside the paper's.
fn paper(bench: &Bench, found: &Signatures, ranks: &RankConfig) -> Section {
    let mut parts = Vec::new();
    for (s, sensor) in bench.sensors.iter().enumerate() {
        let comparison = Comparison::new(found, s, ranks);
        let rows = found.states.iter().skip(1).zip(&comparison.paper).map(|(state, paper)| {
            let cells = state.deviations_percent[s].iter().zip(paper).map(|(&deviation, expected)| match expected {
                Expected::Rank(rank) => {
                    let own = ranks.rank_of(deviation);
                    let same = if own == *rank { Tone::Good } else { Tone::Plain };
                    Cell::toned(format!("{} · {}", own.code(), rank.code()), same)
                }
                Expected::Signed(_) => Cell::from("–"),
            });
            std::iter::once(Cell::from(state.state.name)).chain(cells).collect()
        });
        let (same, cells) = (comparison.same, comparison.cells);
        parts.push(Part::Table(Table {
            caption: format!("{}: own rank · the paper's; {same} of {cells} cells agree", sensor.name),
            head: head("state"),
            rows: rows.collect(),
        }));
        parts.push(Part::Text(comparison.reasons(found)));
    }
    Section { heading: heading(bench, found, "Beside table 4 of the rank paper"), parts }
}

/// Mesh stiffness about the damaged tooth, and order spectra.
fn pictures(bench: &Bench, found: &Signatures) -> anyhow::Result<Section> {
    let Conditions { stage, motor_hz, torque_nm, .. } = found.conditions;
    let train = Train::new(bench);
    let mesh = train.stages[stage].mesh_order;
    let mut stiffness = Vec::new();
    let mut spectra: Vec<Vec<Series>> = vec![Vec::new(); bench.sensors.len()];
    for i in PICTURED {
        let setup = signatures::in_state(bench, found.conditions, STATES[i])?;
        let model = TrainModel::new(&setup, Profile::constant(motor_hz), Profile::constant(torque_nm), SEED)?;
        let force = torque_nm * model.force_per_torque[stage];
        // Tooth 0 enters at phase 0.
        let points = (0..=800).map(|k| (f64::from(k) / 800.0 - 0.25) * CYCLES);
        stiffness.push(Series {
            name: STATES[i].name.into(),
            points: points.map(|u| (u, 1e-6 * model.contacts[stage].static_stiffness(u, force))).collect(),
        });
        let run = gearwatch_sim::render::steady(&setup, motor_hz, torque_nm, SEED, SETTLE_S, RECORD_S)?;
        let first_hz = model.rotation.at(0.0).1 / TAU;
        let highest = (5.4 * mesh).min(0.39 * run.sample_rate_hz / first_hz);
        for (samples, spectra) in run.samples.iter().zip(&mut spectra) {
            let lines =
                order_spectrum(samples, &run.angles_rad, 1.0 / LINES_PER_ORDER, (LINES_PER_ORDER * highest) as usize);
            // The lowest orders are what a window of this length cannot tell from the mean.
            let points = lines.into_iter().enumerate().skip(8).map(|(k, a)| (k as f64 / LINES_PER_ORDER, a));
            spectra.push(Series { name: STATES[i].name.into(), points: points.collect() });
        }
    }
    let marks = (1..=5).map(|h| Mark { x: f64::from(h) * mesh, label: format!("{h}x"), row: 0 });
    let marks: Vec<Mark> = marks.collect();
    let mut parts = vec![Part::Chart(Chart::Lines(Lines {
        caption: "Mesh stiffness k under the static load; the damaged tooth enters at 0".into(),
        x_label: format!("mesh cycles of {}", bench.stages[stage].name),
        y_label: "stiffness (N/µm)".into(),
        log_y: false,
        series: stiffness,
        marks: vec![Mark { x: 0.0, label: String::new(), row: 0 }],
    }))];
    for (sensor, series) in bench.sensors.iter().zip(spectra) {
        parts.push(Part::Chart(Chart::Lines(Lines {
            caption: format!(
                "{}: order spectrum (Hann, amplitude), without noise: local faults show between the mesh lines",
                sensor.name
            ),
            x_label: format!("order (per revolution of shaft {})", train.shafts.first().map_or("1", |(name, _)| name)),
            y_label: format!("amplitude, peak ({})", sensor.unit.replace("^2", "²")),
            log_y: true,
            series,
            marks: marks.clone(),
        })));
    }
    Ok(Section { heading: heading(bench, found, "Pictures"), parts })
}

fn method(all: &[Signatures]) -> Section {
    let mut limits = vec![
        "Amplitudes are peak values of the periodic steady state, ahead of noise; states in which teeth part are stepped through time and marked (stepped).".to_owned(),
        "Sigma: 40 % of a deviation, which is what the harmonics of a mesh stiffness are worth without a model of the real blank, and 0.1 %.".into(),
        "Breakage takes a fraction of the face width; a composite is evaluated as one tooth, not added up.".into(),
    ];
    for found in all.iter().filter(|found| found.pit_scale < 1.0) {
        limits.push(format!(
            "The paper's pits do not fit on the flanks of the {}: all are scaled by {:.3}.",
            gear(found),
            found.pit_scale
        ));
    }
    Section { heading: "How it was made, and what it is worth".into(), parts: vec![Part::List(limits)] }
}

fn provenance(path: &Path, bench: &Bench, ranks: &RankConfig) -> anyhow::Result<Vec<(String, String)>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let file = if path.exists() {
        format!("{}, SHA-256 {}", path.display(), crate::input::sha256_of(path)?)
    } else {
        format!("{}, which comes with the program", path.display())
    };
    Ok(vec![
        ("gearwatch".into(), env!("CARGO_PKG_VERSION").into()),
        ("command".into(), format!("gearwatch {}", arguments.join(" "))),
        ("bench".into(), file),
        ("content of the bench".into(), format!("SHA-256 {}", gearwatch_io::baseline_file::bench_sha256(bench))),
        ("rank steps".into(), format!("{:?} %", ranks.steps_percent)),
        ("seed of the spectra".into(), SEED.to_string()),
    ])
}
