//! The page: HTML text around the parts.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::{Cell, Part, Report, Section, Table, Tone};

const STYLE: &str = include_str!("style.css");

/// The report as an HTML page.
pub fn render(report: &Report) -> String {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (report.title) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                header {
                    h1 { (report.title) }
                    p class={ "verdict " (class(report.tone)) } { (report.verdict) }
                }
                main {
                    @for section in &report.sections { (show_section(section)) }
                }
                footer {
                    h2 { "To make this report again" }
                    dl {
                        @for (name, value) in &report.provenance { div { dt { (name) } dd { (value) } } }
                    }
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
            figure {
                @match chart.svg() {
                    Ok(svg) => { (PreEscaped(svg)) }
                    Err(error) => { p class="unknown" { "This picture could not be drawn: " (error) } }
                }
                figcaption { (chart.caption()) }
            }
        },
    }
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
    use crate::{Bars, Chart, Lines, Mark, Series};

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
                ],
            }],
            provenance: vec![(evil.into(), evil.into())],
        };
        let page = render(&report);
        assert!(!page.contains("<script"), "{page}");
        assert!(page.matches("&lt;script&gt;").count() >= 14);
    }
}
