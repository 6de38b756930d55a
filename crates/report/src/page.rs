//! The page: HTML text around the parts.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::{Cell, Chart, Part, Report, Section, Table, Tone};

const STYLE: &str = include_str!("style.css");
const SCRIPT: &str = include_str!("report.js");
/// What the page may do: show and run what is in it, and load nothing from anywhere.
const POLICY: &str =
    "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; base-uri 'none'; form-action 'none'";
/// The same library that draws the live page.
const UPLOT: &str = include_str!("../../daemon/src/web/assets/uPlot.iife.min.js");
const UPLOT_STYLE: &str = include_str!("../../daemon/src/web/assets/uPlot.min.css");

impl Report {
    /// It has curves that a reader may zoom into.
    fn has_curves(&self) -> bool {
        let mut parts = self.sections.iter().chain(&self.appendix).flat_map(|section| &section.parts);
        parts.any(|part| matches!(part, Part::Chart(Chart::Lines(_))))
    }
}

/// The report as an HTML page.
pub fn render(report: &Report) -> String {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta http-equiv="Content-Security-Policy" content=(POLICY);
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (report.title) }
                style { (PreEscaped(STYLE)) }
                @if report.has_curves() { style { (PreEscaped(UPLOT_STYLE)) } }
            }
            body {
                header {
                    h1 { (report.title) }
                    p class={ "verdict " (class(report.tone)) } { (report.verdict) }
                }
                main {
                    @for section in &report.sections { (show_section(section)) }
                    @if !report.appendix.is_empty() {
                        section class="appendix" {
                            h2 { "Appendix: how it was found" }
                            @for section in &report.appendix {
                                h3 { (section.heading) }
                                @for part in &section.parts { (show_part(part)) }
                            }
                        }
                    }
                }
                footer {
                    h2 { "To make this report again" }
                    dl {
                        @for (name, value) in &report.provenance { div { dt { (name) } dd { (value) } } }
                    }
                }
                @if report.has_curves() {
                    script { (PreEscaped(UPLOT)) }
                    script { (PreEscaped(SCRIPT)) }
                }
            }
        }
    }
    .into_string()
}

fn class(tone: Tone) -> &'static str {
    match tone {
        Tone::Plain => "plain",
        Tone::Good => "good",
        Tone::Warning => "warning",
        Tone::Bad => "bad",
        Tone::Unknown => "unknown",
    }
}

fn show_section(section: &Section) -> Markup {
    html! {
        section {
            h2 { (section.heading) }
            @for part in &section.parts { (show_part(part)) }
        }
    }
}

fn show_part(part: &Part) -> Markup {
    match part {
        Part::Text(text) => html! { p { (text) } },
        Part::List(entries) => html! { ul { @for entry in entries { li { (entry) } } } },
        Part::Table(table) => show_table(table),
        Part::Chart(chart) => html! {
            figure data-curves=[curves(chart)] {
                @match chart.svg() {
                    // Whoever cannot see it hears what it shows.
                    Ok(svg) => { div class="picture" role="img" aria-label=(chart.caption()) { (PreEscaped(svg)) } }
                    Err(error) => { p class="unknown" { "This picture could not be drawn: " (error) } }
                }
                figcaption { (chart.caption()) }
            }
        },
    }
}

/// The points of curves as JSON, for the script that lets a reader zoom and read values; the
/// drawing is what is printed.
fn curves(chart: &Chart) -> Option<String> {
    let Chart::Lines(lines) = chart else { return None };
    let series: Vec<_> = lines
        .series
        .iter()
        .map(|s| {
            let points: Vec<_> = s.points.iter().filter(|p| p.0.is_finite() && p.1.is_finite()).collect();
            let column = |of: fn(&(f64, f64)) -> f64| points.iter().map(|p| short(of(p))).collect::<Vec<_>>();
            serde_json::json!({ "name": s.name, "x": column(|p| p.0), "y": column(|p| p.1) })
        })
        .collect();
    let curves = serde_json::json!({ "x": lines.x_label, "y": lines.y_label, "log": lines.log_y, "series": series });
    Some(curves.to_string())
}

/// Six digits are finer than a screen can show.
fn short(x: f64) -> f64 {
    format!("{x:.5e}").parse().unwrap_or(x)
}

fn show_table(table: &Table) -> Markup {
    html! {
        div class="scroll" {
            table {
                caption { (table.caption) }
                thead { tr { @for name in &table.head { th scope="col" { (name) } } } }
                tbody { @for row in &table.rows { (show_row(row)) } }
            }
        }
    }
}

fn show_row(row: &[Cell]) -> Markup {
    html! {
        tr {
            @for (i, cell) in row.iter().enumerate() {
                @if i == 0 { th scope="row" class=(class(cell.tone)) { (cell.text) } }
                @else { td class=(class(cell.tone)) { (cell.text) } }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Bars, Deviation, Deviations, Lines, Mark, Series};

    /// Names come from files: what looks like markup in them stays text.
    #[test]
    fn regress_text_is_escaped_everywhere() {
        let evil = "<script>alert(1)</script>";
        let report = Report {
            title: evil.into(),
            verdict: evil.into(),
            tone: Tone::Bad,
            sections: vec![Section {
                heading: evil.into(),
                parts: vec![
                    Part::Text(evil.into()),
                    Part::List(vec![evil.into()]),
                    Part::Table(Table { caption: evil.into(), head: vec![evil.into()], rows: vec![vec![evil.into()]] }),
                    Part::Chart(Chart::Lines(Lines {
                        caption: evil.into(),
                        x_label: evil.into(),
                        y_label: evil.into(),
                        log_y: false,
                        series: vec![Series { name: evil.into(), points: vec![(0.0, 1.0), (1.0, 2.0)] }],
                        marks: vec![Mark { x: 0.5, label: evil.into(), row: 0 }],
                    })),
                    Part::Chart(Chart::Bars(Bars {
                        caption: evil.into(),
                        y_label: evil.into(),
                        groups: vec![evil.into()],
                        series: vec![(evil.into(), vec![(1.0, 0.5)])],
                        limits: vec![1.0],
                    })),
                    Part::Chart(Chart::Deviations(Deviations {
                        caption: evil.into(),
                        bars: vec![Deviation { name: evil.into(), percent: 1.0, sigma_percent: 0.1, rank: None }],
                        steps_percent: vec![],
                    })),
                ],
            }],
            appendix: vec![Section { heading: evil.into(), parts: vec![Part::Text(evil.into())] }],
            provenance: vec![(evil.into(), evil.into())],
        };
        let page = render(&report);
        assert!(!page.contains("<script>alert"), "{page}");
        assert_eq!(page.matches("<script").count(), 2, "the library that draws, and what uses it");
        assert!(page.matches("&lt;script&gt;").count() >= 18);
    }
}
