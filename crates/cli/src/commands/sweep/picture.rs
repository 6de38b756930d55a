//! A sweep as pictures: each quantity over speed (or torque), the cases side by side.

use std::collections::{BTreeMap, BTreeSet};

use gearwatch_batch::sweep::{Mean, Row};
use gearwatch_core::verdict::HARMONICS;
use gearwatch_report::{Chart, Lines, Part, Report, Section, Series, Tone, render};

/// The abscissa of all pictures.
#[derive(Clone, Copy, PartialEq)]
enum Over {
    Speed,
    Torque,
}

/// The page.
pub(super) fn page(bench: &str, rows: &[Row]) -> String {
    let distinct =
        |of: fn(&Row) -> f64| rows.iter().map(|row| (of(row) * 1e3).round() as i64).collect::<BTreeSet<_>>().len();
    let over = if distinct(|row| row.brake_torque_nm) > distinct(|row| row.input_speed_hz) {
        Over::Torque
    } else {
        Over::Speed
    };
    let cases: BTreeSet<&str> = rows.iter().map(|row| row.case.as_str()).collect();
    let mut sections = Vec::new();
    let channels: BTreeSet<&str> = rows.iter().map(|row| row.channel.as_str()).collect();
    for channel in channels {
        let here: Vec<&Row> = rows.iter().filter(|row| row.channel == channel).collect();
        let stages: BTreeSet<&str> = here.iter().map(|row| row.stage.as_str()).collect();
        // The signal as a whole is the same in the rows of all stages.
        let first: Vec<&Row> =
            here.iter().copied().filter(|row| Some(row.stage.as_str()) == stages.first().copied()).collect();
        let mut parts = vec![
            chart(over, "peak to peak", &first, |row| row.peak_to_peak),
            chart(over, "root mean square", &first, |row| row.rms),
        ];
        for stage in stages {
            let of: Vec<&Row> = here.iter().copied().filter(|row| row.stage == stage).collect();
            for h in 0..HARMONICS {
                parts.push(chart(over, &format!("{stage}, {}x", h + 1), &of, move |row| row.harmonics[h]));
            }
            parts.push(chart(over, &format!("{stage}, sidebands of the pinion's shaft about 1x"), &of, |row| {
                row.pinion_sidebands[0]
            }));
            parts.push(chart(over, &format!("{stage}, sidebands of the wheel's shaft about 1x"), &of, |row| {
                row.wheel_sidebands[0]
            }));
        }
        sections.push(Section {
            heading: channel.to_owned(),
            parts: parts.into_iter().flatten().map(Part::Chart).collect(),
        });
    }
    render(&Report {
        title: format!("{bench}: statistics over speed and load"),
        verdict: format!("{} rows; cases: {}.", rows.len(), cases.into_iter().collect::<Vec<_>>().join(", ")),
        tone: Tone::Plain,
        sections,
        appendix: Vec::new(),
        provenance: vec![
            ("gearwatch".into(), env!("CARGO_PKG_VERSION").into()),
            ("command".into(), std::env::args().collect::<Vec<_>>().join(" ")),
        ],
    })
}

/// A quantity over the abscissa, a curve a case and value of the other quantity; nothing where none
/// is known.
fn chart(over: Over, name: &str, rows: &[&Row], of: impl Fn(&Row) -> Mean) -> Option<Chart> {
    let mut curves: BTreeMap<(usize, i64), Series> = BTreeMap::new();
    let mut order: Vec<&str> = Vec::new();
    for row in rows {
        let (x, other, unit) = match over {
            Over::Speed => (row.input_speed_hz, row.brake_torque_nm, "N m"),
            Over::Torque => (row.brake_torque_nm, row.input_speed_hz, "Hz"),
        };
        let case = order.iter().position(|case| *case == row.case).unwrap_or_else(|| {
            order.push(&row.case);
            order.len() - 1
        });
        let value = of(row).value();
        if x.is_finite() && value.is_finite() {
            let label = if other.is_finite() { format!("{}, {other:.1} {unit}", row.case) } else { row.case.clone() };
            let curve = curves
                .entry((case, (other * 1e3) as i64))
                .or_insert_with(|| Series { name: label, points: Vec::new() });
            curve.points.push((x, value));
        }
    }
    if curves.is_empty() {
        return None;
    }
    let unit = rows.first().map_or("", |row| row.unit.as_str());
    let mut series: Vec<Series> = curves.into_values().collect();
    series.iter_mut().for_each(|s| s.points.sort_by(|a, b| a.0.total_cmp(&b.0)));
    Some(Chart::Lines(Lines {
        caption: name.to_owned(),
        x_label: if over == Over::Speed { "input shaft (Hz)" } else { "brake torque (N m)" }.into(),
        y_label: format!("amplitude ({unit})"),
        log_y: false,
        series,
        marks: Vec::new(),
    }))
}
