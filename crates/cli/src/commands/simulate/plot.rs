//! The picture of a simulated recording: waveform, order spectrum, mesh stiffness.

use std::path::Path;

use anyhow::bail;
use gearwatch_core::recording::Recording;
use gearwatch_core::train::Train;
use gearwatch_report::{Chart, Lines, Mark, Part, Report, Section, Series};
use gearwatch_sim::lines::order_spectrum;
use gearwatch_sim::meshes::MeshKind;
use gearwatch_sim::model::TrainModel;
use gearwatch_sim::source::{SimConfig, Simulator};

/// Length of the recording that the picture is made from (s).
pub const PLOTTED_S: f64 = 2.0;
/// Length of the waveform that is shown, in revolutions of the first shaft.
const WAVEFORM_REVOLUTIONS: f64 = 1.0;
/// Lines per revolution of the first shaft in the order spectrum.
const LINES_PER_ORDER: f64 = 10.0;
/// Mesh cycles shown of the stiffness.
const CYCLES: f64 = 3.0;

/// What a picture is written as.
#[derive(Clone, Copy)]
pub enum Form {
    /// The three charts below each other.
    Svg,
    /// A page by itself.
    Html,
}

/// The form that the end of a file's name says.
pub fn form(path: &Path) -> anyhow::Result<Form> {
    match path.extension().and_then(|end| end.to_str()) {
        Some("svg") => Ok(Form::Svg),
        Some("html") => Ok(Form::Html),
        _ => bail!("{}: the name must end in .svg or .html, which says the form", path.display()),
    }
}

/// The text of the file.
pub fn picture(form: Form, recording: &Recording, config: &SimConfig, model: &TrainModel) -> anyhow::Result<String> {
    let charts = [waveform(recording, model), spectrum(recording, config, model), stiffness(config, model)];
    match form {
        Form::Svg => stacked(&charts),
        Form::Html => Ok(gearwatch_report::render(&Report {
            title: format!("Simulated: {}", config.bench.name),
            verdict: describe(config, model),
            sections: vec![Section {
                heading: "Pictures".into(),
                parts: charts.into_iter().map(Part::Chart).collect(),
            }],
            appendix: Vec::new(),
            provenance: provenance(config),
            ..Report::default()
        })),
    }
}

/// Charts below each other, each under its caption.
pub fn stacked(charts: &[Chart]) -> anyhow::Result<String> {
    let height = 340 * charts.len();
    let mut text = format!(r#"<svg xmlns="http://www.w3.org/2000/svg" width="900" height="{height}">"#);
    for (i, chart) in charts.iter().enumerate() {
        let svg = chart.svg()?;
        let top = 340 * i;
        let style = "font-family=\"sans-serif\" font-size=\"13\"";
        let caption = gearwatch_report::escaped(chart.caption());
        text.push_str(&format!("<text x=\"78\" y=\"{}\" {style}>{caption}</text>", top + 16));
        text.push_str(&svg.replacen("<svg ", &format!("<svg y=\"{}\" ", top + 20), 1));
    }
    text.push_str("</svg>\n");
    Ok(text)
}

fn describe(config: &SimConfig, model: &TrainModel) -> String {
    let effects: Vec<_> =
        config.bench.effects.iter().chain(&config.effects).map(|e| format!("{} at {}", e.effect, e.place)).collect();
    let start = Simulator::offset_s(config.bench.acquisition.sample_rate_hz);
    let (speed, torque) = (model.rotation.motor_hz(start), model.brake_torque_nm(start));
    let effects = if effects.is_empty() {
        "no effect beyond the nominal model".into()
    } else {
        format!("with {}", effects.join(", "))
    };
    format!("Motor at {speed} Hz, brake at {torque} N m at the start; {effects}.")
}

/// What it takes to make the picture again.
fn provenance(config: &SimConfig) -> Vec<(String, String)> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    vec![
        ("gearwatch".into(), env!("CARGO_PKG_VERSION").into()),
        ("command".into(), format!("gearwatch {}", arguments.join(" "))),
        (
            "content of the bench".into(),
            format!("SHA-256 {}", gearwatch_io::baseline_file::bench_sha256(&config.bench)),
        ),
        ("seed".into(), config.seed.to_string()),
    ]
}

/// What a unit measures.
fn quantity(unit: &str) -> &'static str {
    if unit == "mm/s" { "velocity" } else { "acceleration" }
}

/// A unit as it is printed.
fn printed(unit: &str) -> String {
    unit.replace("^2", "²")
}

/// A channel from the start of the recording.
struct Trace {
    name: String,
    unit: String,
    rate: f64,
    samples: Vec<f64>,
    /// The first shaft's angle at each sample (rad).
    angles: Vec<f64>,
}

fn traces(recording: &Recording, model: &TrainModel) -> Vec<Trace> {
    let channels = recording.channels.iter().filter_map(|(name, channel)| {
        let segment = channel.segments.first()?;
        let rate = channel.sample_rate_hz;
        let offset = Simulator::offset_s(rate);
        let angles = (0..segment.samples.len()).map(|n| model.rotation.at(n as f64 / rate + offset).0).collect();
        Some(Trace {
            name: name.clone(),
            unit: channel.unit.to_string(),
            rate,
            samples: segment.samples.clone(),
            angles,
        })
    });
    channels.collect()
}

fn waveform(recording: &Recording, model: &TrainModel) -> Chart {
    let all = traces(recording, model);
    let unit = all.first().map_or(String::new(), |trace| trace.unit.clone());
    let series = all
        .into_iter()
        .map(|Trace { name, rate, samples, angles, .. }| {
            let start = angles.first().copied().unwrap_or(0.0);
            let shown = angles.partition_point(|a| a - start < std::f64::consts::TAU * WAVEFORM_REVOLUTIONS);
            let points = samples[..shown].iter().enumerate().map(|(n, &v)| (n as f64 / rate, v)).collect();
            Series { name, points }
        })
        .collect();
    Chart::Lines(Lines {
        caption: "Waveform over one revolution of the first shaft".into(),
        x_label: "time (s)".into(),
        y_label: format!("{} ({})", quantity(&unit), printed(&unit)),
        log_y: false,
        series,
        marks: Vec::new(),
    })
}

fn spectrum(recording: &Recording, config: &SimConfig, model: &TrainModel) -> Chart {
    let train = Train::new(&config.bench);
    let highest = train.stages.iter().map(|stage| 5.2 * stage.mesh_order).fold(0.0, f64::max);
    let all = traces(recording, model);
    let unit = all.first().map_or(String::new(), |trace| trace.unit.clone());
    let series = all
        .into_iter()
        .map(|Trace { name, rate, samples, angles, .. }| {
            // Nothing above the converter's filter.
            let speed = model.rotation.at(Simulator::offset_s(rate)).1 / std::f64::consts::TAU;
            let count = (LINES_PER_ORDER * highest.min(0.39 * rate / speed)) as usize;
            let spectrum = order_spectrum(&samples, &angles, 1.0 / LINES_PER_ORDER, count);
            // The lowest orders are what a window of this length cannot tell from the mean.
            let points = spectrum.into_iter().enumerate().skip(8);
            Series { name, points: points.map(|(i, a)| (i as f64 / LINES_PER_ORDER, a)).collect() }
        })
        .collect();
    let marks = train.stages.iter().zip(0..).flat_map(|(stage, row)| {
        (1..=5).map(move |h| Mark { x: f64::from(h) * stage.mesh_order, label: format!("{} {h}x", stage.name), row })
    });
    Chart::Lines(Lines {
        caption: format!("Order spectrum of {PLOTTED_S} s (Hann window); mesh harmonics marked"),
        x_label: format!("order (per revolution of shaft {})", train.shafts.first().map_or("1", |(name, _)| name)),
        y_label: format!("amplitude, peak ({})", printed(&unit)),
        log_y: true,
        series,
        marks: marks.collect(),
    })
}

fn stiffness(config: &SimConfig, model: &TrainModel) -> Chart {
    let torque = model.brake_torque_nm(0.0);
    // All planets are alike but for errors: the first one stands for them.
    let first = |kind: MeshKind| !matches!(kind, MeshKind::Sun { planet: 1.. } | MeshKind::Ring { planet: 1.. });
    let series = (model.linear.meshes.iter().zip(&model.contacts).zip(&model.force_per_torque))
        .filter(|((mesh, _), _)| first(mesh.place.kind))
        .map(|((mesh, contact), force)| Series {
            name: mesh.place.name(&config.bench),
            points: (0..=600)
                .map(|i| CYCLES * f64::from(i) / 600.0)
                .map(|phase| (phase, contact.static_stiffness(phase, force * torque) * 1e-6))
                .collect(),
        })
        .collect();
    Chart::Lines(Lines {
        caption: format!("Mesh stiffness k(t) under the static load of {torque} N m at the brake"),
        x_label: "mesh cycles since a pair of teeth came in".into(),
        y_label: "stiffness (N/µm)".into(),
        log_y: false,
        series,
        marks: Vec::new(),
    })
}
