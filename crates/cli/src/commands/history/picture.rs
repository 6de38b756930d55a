//! A history as pictures: deviations, an indicator of the signal, speed and torque over time, with
//! events marked.

use std::collections::BTreeMap;

use gearwatch_core::indicators::columns::Mean;
use gearwatch_core::verdict::HARMONICS;
use gearwatch_history::time::iso;
use gearwatch_history::{Event, History, STATES, Span, indicator_names};
use gearwatch_report::{Cell, Chart, Lines, Mark, Part, Report, Section, Series, Table, Tone, render};

const HOUR_NS: f64 = 3.6e12;

/// Indicators that have a picture, where the log holds them.
const DRAWN: [&str; 4] = ["rms", "kurtosis", "pinion_fm4", "wheel_fm4"];

/// Events marked in a picture: more would hide the curves.
const MOST_MARKS: usize = 24;

/// Events in the table.
const MOST_EVENTS: usize = 1000;

/// The page.
pub(super) fn page(history: &History) -> String {
    let (first, last) = history.rows().fold((i64::MAX, i64::MIN), |(a, b), (_, at, _)| (a.min(at), b.max(at)));
    let last = last.saturating_add(history.every());
    let hours = |t: i64| (t - first) as f64 / HOUR_NS;
    let marked: Vec<_> =
        history.events.iter().filter(|e| matches!(e.kind, "alarm" | "acknowledged" | "reload")).collect();
    let marks: Vec<Mark> = marked
        .iter()
        .rev()
        .take(MOST_MARKS)
        .map(|e| Mark { x: hours(e.t_ns), label: e.kind.to_owned(), row: u32::from(e.kind != "alarm") })
        .collect();
    let mut sections = Vec::new();
    for ((bench, stage, channel), spans) in history.groups() {
        let curve = |name: String, of: &dyn Fn(&Span) -> Mean| Series {
            name,
            points: spans
                .iter()
                // In the middle of what was put together.
                .map(|(&at, span)| (hours(at + history.every() / 2), of(span).estimate(0.5).value))
                .filter(|point| point.1.is_finite())
                .collect(),
        };
        let chart = |caption: &str, y_label: &str, series: Vec<Series>| {
            let series: Vec<Series> = series.into_iter().filter(|s| !s.points.is_empty()).collect();
            (!series.is_empty()).then(|| {
                Part::Chart(Chart::Lines(Lines {
                    caption: caption.to_owned(),
                    x_label: format!("hours since {}", iso(first)),
                    y_label: y_label.to_owned(),
                    log_y: false,
                    series,
                    marks: marks.clone(),
                }))
            })
        };
        let harmonics = (0..HARMONICS).map(|h| curve(format!("{}x", h + 1), &move |span: &Span| span.deviations[h]));
        let mut parts = vec![chart("Deviation from the baseline", "percent", harmonics.collect())];
        for (i, name) in indicator_names().enumerate().filter(|(_, name)| DRAWN.contains(name)) {
            let of = move |span: &Span| span.indicators.get(i).copied().unwrap_or_default();
            parts.push(chart(name, name, vec![curve(name.to_owned(), &of)]));
        }
        parts.push(chart("Speed of the input shaft", "Hz", vec![curve("speed".into(), &|span: &Span| span.speed)]));
        parts.push(chart("Torque at the brake", "N m", vec![curve("torque".into(), &|span: &Span| span.torque)]));
        let bench = if bench.is_empty() { String::new() } else { format!("{bench}: ") };
        sections.push(Section {
            heading: format!("{bench}{stage} at {channel}"),
            parts: parts.into_iter().flatten().collect(),
        });
    }
    let hidden = history.events.len().saturating_sub(MOST_EVENTS);
    let cells = |e: &Event| -> Vec<Cell> { vec![iso(e.t_ns).into(), e.kind.into(), e.text.as_str().into()] };
    let table = Table {
        caption: if hidden > 0 { format!("the last {MOST_EVENTS}; {hidden} before") } else { "all".to_owned() },
        head: ["time (UTC)", "what", "more"].map(str::to_owned).into(),
        rows: history.events[hidden..].iter().map(cells).collect(),
    };
    if !table.rows.is_empty() {
        sections.push(Section { heading: "Events".into(), parts: vec![Part::Table(table)] });
    }
    let mut states: BTreeMap<&str, u64> = BTreeMap::new();
    for (_, _, span) in history.rows() {
        for (name, count) in STATES.iter().zip(span.states) {
            *states.entry(name).or_default() += count;
        }
    }
    let states: Vec<String> =
        states.iter().filter(|s| *s.1 > 0).map(|(name, count)| format!("{count} {name}")).collect();
    render(&Report {
        title: format!("History from {} to {}", iso(first), iso(last)),
        verdict: format!("Windows: {}.", states.join(", ")),
        tone: Tone::Plain,
        sections,
        appendix: Vec::new(),
        provenance: vec![
            ("gearwatch".into(), env!("CARGO_PKG_VERSION").into()),
            ("command".into(), std::env::args().collect::<Vec<_>>().join(" ")),
        ],
    })
}
