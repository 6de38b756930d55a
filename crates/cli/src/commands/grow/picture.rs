//! Growth as pictures.

use gearwatch_report::{Bars, Cell, Chart, Lines, Mark, Part, Report, Section, Series, Table, Tone, render};
use gearwatch_sim::growth::{Growing, LineGroup};

use super::super::simulate::{Form, stacked};
use super::table::{Of, hours};

/// Worn profiles that are drawn.
const PROFILES: usize = 5;
/// Indicators whose warning times are drawn.
const BEST: usize = 8;

/// The text of the file.
pub(super) fn picture(form: Form, of: &Of<'_>) -> anyhow::Result<String> {
    let charts = charts(of);
    match form {
        Form::Svg => stacked(&charts),
        Form::Html => Ok(page(of, charts)),
    }
}

fn charts(of: &Of<'_>) -> Vec<Chart> {
    let steps = &of.growth.steps;
    let (name, unit) = steps[0].growing.unit();
    let told = of.growth.indicators[of.harmonics()[0]];
    let place = format!("{} at {}", of.stage(&told), of.sensor(&told));
    let size = Series { name: name.into(), points: steps.iter().map(|step| (step.hours, step.size)).collect() };
    let mut out = vec![lines(of, format!("Size: {name}"), format!("{name} ({unit})"), vec![size])];
    for (kind, words) in [
        (LineGroup::Mesh, "Mesh harmonics"),
        (LineGroup::PinionSidebands, "Sidebands of the pinion's shaft about them"),
        (LineGroup::WheelSidebands, "Sidebands of the wheel's shaft about them"),
    ] {
        let series: Vec<Series> = of
            .of(told.sensor, told.stage, kind)
            .into_iter()
            .map(|i| {
                let points = steps.iter().map(|s| s.hours).zip(of.growth.deviations_percent(i));
                Series { name: format!("{}x", of.growth.indicators[i].harmonic), points: points.collect() }
            })
            .filter(|series| series.points.iter().any(|point| point.1.is_finite()))
            .collect();
        if !series.is_empty() {
            out.push(lines(of, format!("{words}, {place}"), "deviation (%)".into(), series));
        }
    }
    out.extend(profiles(of));
    out.extend(warnings(of));
    out
}

fn lines(of: &Of<'_>, caption: String, y_label: String, series: Vec<Series>) -> Chart {
    let limit = of.growth.limit.iter().map(|(at, _)| Mark { x: *at, label: "limit".into(), row: 0 });
    Chart::Lines(Lines {
        caption,
        x_label: "running time (h)".into(),
        y_label,
        log_y: false,
        series,
        marks: limit.collect(),
    })
}

/// Worn depth along the path of contact at some steps.
fn profiles(of: &Of<'_>) -> Option<Chart> {
    let steps = &of.growth.steps;
    let every = steps.len().saturating_sub(1).div_ceil(PROFILES).max(1);
    let series = steps.iter().enumerate().filter(|(k, _)| *k > 0 && (k % every == 0 || k + 1 == steps.len()));
    let series: Vec<Series> = series
        .filter_map(|(_, step)| {
            let Growing::Wear(wear) = &step.growing else { return None };
            let [pinion, wheel] = wear.worn_m();
            let last = (pinion.len() - 1) as f64;
            let depth = pinion.iter().zip(wheel).enumerate().map(|(i, (p, w))| (i as f64 / last, 1e6 * (p + w)));
            Some(Series { name: format!("{:.0} h", step.hours), points: depth.collect() })
        })
        .collect();
    (!series.is_empty()).then(|| {
        Chart::Lines(Lines {
            caption: "Worn depth of both flanks together along the path of contact".into(),
            x_label: "way from entry to exit (1)".into(),
            y_label: "depth (µm)".into(),
            log_y: false,
            series,
            marks: Vec::new(),
        })
    })
}

fn warnings(of: &Of<'_>) -> Option<Chart> {
    let best: Vec<(String, f64)> = of
        .by_time()
        .into_iter()
        .filter_map(|i| {
            let (indicator, merit) = (&of.growth.indicators[i], &of.growth.merits[i]);
            let (_, what) =
                indicator.name().rsplit_once('_').map_or((String::new(), indicator.name()), |(kind, line)| {
                    (
                        String::new(),
                        format!("{} {line}", if kind.starts_with("pinion") { "pinion ±" } else { "wheel ±" }),
                    )
                });
            merit.warning_hours.map(|left| (format!("{what} {}", of.sensor(indicator)), left))
        })
        .take(BEST)
        .collect();
    (!best.is_empty()).then(|| {
        let (groups, values): (Vec<String>, Vec<(f64, f64)>) =
            best.into_iter().map(|(name, left)| (name, (left, f64::NAN))).unzip();
        Chart::Bars(Bars {
            caption: "Warning time of the earliest indicators: from first significance to the limit".into(),
            y_label: "warning time (h)".into(),
            groups,
            series: vec![("warning time".into(), values)],
            limits: Vec::new(),
        })
    })
}

fn page(of: &Of<'_>, charts: Vec<Chart>) -> String {
    let unit = of.growth.steps[0].growing.unit().1;
    let rows = of.by_time().into_iter().map(|i| {
        let (indicator, merit) = (&of.growth.indicators[i], &of.growth.merits[i]);
        let size = merit.first_size.map_or_else(|| "-".into(), |size| format!("{size:.3}"));
        let cells = [indicator.name(), of.stage(indicator).to_owned(), of.sensor(indicator).to_owned()];
        let times = [hours(merit.first_hours), size, hours(merit.rank_v_hours), hours(merit.warning_hours)];
        cells.into_iter().chain(times).map(Cell::from).collect()
    });
    let merits = Table {
        caption: "First significance: rank I and three standard deviations of a window, in three of five windows"
            .into(),
        head: ["indicator", "stage", "sensor", "first (h)"]
            .map(str::to_owned)
            .into_iter()
            .chain([format!("at ({unit})"), "rank V (h)".into(), "warning (h)".into()])
            .collect(),
        rows: rows.collect(),
    };
    let law = Table {
        caption: "Constants of the law".into(),
        head: ["name", "value", "unit", "what it is"].map(str::to_owned).to_vec(),
        rows: super::constants(of.plan)
            .map(|(constant, value)| {
                let cells =
                    [constant.name.to_owned(), format!("{value:?}"), constant.unit.into(), constant.help.into()];
                cells.into_iter().map(Cell::from).collect()
            })
            .collect(),
    };
    render(&Report {
        title: of.title(),
        verdict: of.outcome().join(" "),
        tone: Tone::Plain,
        sections: vec![
            Section { heading: "Over time".into(), parts: charts.into_iter().map(Part::Chart).collect() },
            Section { heading: "Indicators".into(), parts: vec![Part::Table(merits)] },
            Section { heading: "Law".into(), parts: vec![Part::Table(law)] },
        ],
        appendix: Vec::new(),
        provenance: vec![
            ("gearwatch".into(), env!("CARGO_PKG_VERSION").into()),
            ("command".into(), std::env::args().collect::<Vec<_>>().join(" ")),
            ("seed".into(), of.plan.seed.to_string()),
        ],
    })
}
