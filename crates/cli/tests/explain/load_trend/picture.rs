//! The picture of the documentation: errors by line, and two lines over the load.

use std::path::Path;

use gearwatch_report::{Bars, Chart, Lines, Series};

use super::measured::{CHANNELS, LINES, LOADS, Measured};
use super::modelled::Sheet;
use super::{DB, Judged, mean};

/// The line that is drawn over the load.
const DRAWN: usize = 0;

pub fn write(folder: &Path, m: &Measured, sheet: &Sheet, all: &[Judged]) {
    let shown = |j: &&Judged| !j.name.contains("a slope a channel");
    let bars = Chart::Bars(Bars {
        caption: "Error on loads that took no part in fitting, by mesh line (stage: harmonic)".into(),
        y_label: "rms error (dB)".into(),
        groups: LINES.iter().map(|l| l.2.to_owned()).collect(),
        series: all
            .iter()
            .filter(shown)
            .map(|j| (j.name.to_owned(), j.by_line.iter().map(|v| (*v, f64::NAN)).collect()))
            .collect(),
        limits: Vec::new(),
    });
    let over_load = |values: &[f64]| LOADS.iter().zip(values).map(|(l, v)| (f64::from(*l), DB * v)).collect();
    let mut series: Vec<Series> = CHANNELS
        .iter()
        .zip(&m.ln)
        .map(|(name, lines)| {
            let level = mean(lines[DRAWN].iter().copied());
            let moved: Vec<f64> = lines[DRAWN].iter().map(|v| v - level).collect();
            Series { name: (*name).into(), points: over_load(&moved) }
        })
        .collect();
    series.push(Series { name: "train, fitted".into(), points: over_load(&sheet.trend(m, DRAWN)) });
    let curves = Chart::Lines(Lines {
        caption: "1x of stage 1 over the load, each about its own mean".into(),
        x_label: "brake load (%)".into(),
        y_label: "amplitude (dB)".into(),
        log_y: false,
        series,
        marks: Vec::new(),
    });
    for (name, chart) in [("load-trend-errors.svg", bars), ("load-trend.svg", curves)] {
        std::fs::write(folder.join(name), chart.svg().expect("a picture")).expect("the picture is written");
    }
}
