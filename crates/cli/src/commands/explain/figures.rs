//! Pictures of an answer: the plain spectrum, where the lines differ, before and after.

use gearwatch_core::recording::Recording;
use gearwatch_core::train::Train;
use gearwatch_explain::judge::report::Explanation;
use gearwatch_explain::read::dsp::Transforms;
use gearwatch_explain::read::plain;
use gearwatch_report::{Chart, Lines, Mark, Series};

use super::report;

/// Mesh harmonics that are marked and fit into the picture.
const MARKED: u8 = 5;
/// The picture ends so far above the last mark.
const BEYOND: f64 = 1.15;

/// The pictures of an answer: name of the file and its text.
pub fn draw(
    train: &Train,
    e: &Explanation,
    recordings: &[Recording],
    references: &[Recording],
) -> anyhow::Result<Vec<(&'static str, String)>> {
    let charts = [
        ("spectrum.svg", spectrum(train, e, recordings, references)),
        ("mismatch.svg", (!e.mismatch.is_empty()).then(|| report::mismatch_chart(&e.mismatch))),
        ("fit.svg", e.fit.as_ref().map(report::fit_chart)),
    ];
    let there = charts.into_iter().filter_map(|(name, chart)| Some((name, chart?)));
    there.map(|(name, chart)| Ok((name, titled(&chart)?))).collect()
}

/// A chart under the first clause of its caption.
pub(super) fn titled(chart: &Chart) -> anyhow::Result<String> {
    let svg = chart.svg()?;
    let title = chart.caption().split(';').next().unwrap_or_default();
    let title = title.replace('&', "&amp;").replace('<', "&lt;");
    Ok(format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"900\" height=\"342\"><rect width=\"900\" height=\"342\" fill=\"white\"/>\
         <text x=\"78\" y=\"16\" font-family=\"sans-serif\" font-size=\"13\">{title}</text>{}</svg>\n",
        svg.replacen("<svg ", "<svg y=\"22\" ", 1)
    ))
}

/// The recording that differs most (else the last) as any analyser shows it, over the reference at
/// the same setting.
fn spectrum(train: &Train, e: &Explanation, recordings: &[Recording], references: &[Recording]) -> Option<Chart> {
    let worst = e.mismatch.first();
    let recording = worst.and_then(|m| recordings.iter().find(|r| r.name == m.recording)).or(recordings.last())?;
    let channel = match worst {
        Some(m) => m.channel.clone(),
        None => recording.channels.keys().next()?.clone(),
    };
    let point = recording.operating_points.first();
    let same = |other: &&Recording| {
        point.zip(other.operating_points.first()).is_some_and(|(a, b)| {
            (a.motor_speed_hz / b.motor_speed_hz - 1.0).abs() < 0.03
                && (a.brake_torque_nm - b.brake_torque_nm).abs() <= 0.05 * a.brake_torque_nm.abs()
        })
    };
    let motor_hz = point.map(|p| p.motor_speed_hz).filter(|hz| hz.is_finite() && *hz > 0.0)?;
    let input_hz = motor_hz / train.motor_order;
    let marks: Vec<Mark> = train
        .stages
        .iter()
        .zip(0..)
        .flat_map(|(stage, row)| {
            (1..=MARKED).map(move |h| Mark {
                x: f64::from(h) * stage.mesh_order * input_hz,
                label: format!("{} {h}x", stage.name),
                row,
            })
        })
        .collect();
    let highest = BEYOND * marks.iter().map(|m| m.x).fold(0.0, f64::max);
    let mut transforms = Transforms::default();
    let series: Vec<Series> = [("reference", references.iter().find(same)), ("recording", Some(recording))]
        .into_iter()
        .filter_map(|(name, r)| {
            let found = plain::spectrum(&mut transforms, r?, &channel)?;
            let points = found.amplitudes.iter().enumerate().skip(2).map(|(k, a)| (k as f64 * found.hz_per_bin, *a));
            Some(Series { name: name.into(), points: points.take_while(|p| p.0 <= highest).collect() })
        })
        .collect();
    let unit = recording.channels.get(&channel)?.unit.replace("^2", "²");
    (!series.is_empty()).then(|| {
        Chart::Lines(Lines {
            caption: format!("Plain spectrum of {} at {channel}: Hann windows of 1 s, averaged", recording.name),
            x_label: "frequency (Hz)".into(),
            y_label: format!("amplitude, peak ({unit})"),
            log_y: true,
            series,
            marks,
        })
    })
}
