//! Reports that can be handed on: one HTML file, pictures inside, nothing loaded from elsewhere.
//!
//! A [`Report`] says first what the verdict is, then what it rests on, then what was not judged and
//! why, and last how to make it again. It knows nothing of gears: commands fill it, [`render`]
//! writes it, the same input giving the same bytes.
//!
//! ```text
//! Report ─┬─ verdict, tone
//!         ├─ Section ─► Part: text, list, Table of Cells, Chart (SVG)  ─► render ─► one HTML file
//!         ├─ appendix: more Sections
//!         └─ provenance
//! ```
//!
//! ```
//! use gearwatch_report::{Cell, Part, Report, Section, Table, Tone, render};
//!
//! let row = vec![Cell::from("stage1"), Cell::toned("rank V", Tone::Bad)];
//! let table = Table { caption: "Ranks".into(), head: vec!["Stage".into(), "1x".into()], rows: vec![row] };
//! let sections = vec![Section { heading: "What was found".into(), parts: vec![Part::Table(table)] }];
//! let report = Report { title: "Bench 3".into(), tone: Tone::Bad, sections, ..Report::default() };
//! let page = render(&report);
//! assert!(page.starts_with("<!DOCTYPE html>") && page.contains("rank V"));
//! ```

mod chart;
mod page;

pub use chart::*;
pub use page::render;

/// How a headline, a table cell or a list entry is coloured. The words beside it say the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tone {
    /// No colour.
    #[default]
    Plain,
    /// Within limits.
    Good,
    /// To be looked at.
    Warning,
    /// Not within limits.
    Bad,
    /// Not judged.
    Unknown,
}

/// A whole report.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// What was judged: the page's title.
    pub title: String,
    /// The verdict in one sentence.
    pub verdict: String,
    /// Its colour.
    pub tone: Tone,
    /// In order.
    pub sections: Vec<Section>,
    /// For whoever wants to know how it was found: words of the trade, which the reader of the rest
    /// does not need.
    pub appendix: Vec<Section>,
    /// What it takes to make the report again: versions, files with their hashes, settings.
    pub provenance: Vec<(String, String)>,
}

/// A part of a report under a heading.
#[derive(Clone, Debug, Default)]
pub struct Section {
    /// The heading.
    pub heading: String,
    /// In order.
    pub parts: Vec<Part>,
}

/// What a section is made of.
#[derive(Clone, Debug)]
pub enum Part {
    /// A paragraph of plain text.
    Text(String),
    /// A list.
    List(Vec<String>),
    /// A table.
    Table(Table),
    /// A picture.
    Chart(Chart),
}

/// A table; the first column names the rows.
#[derive(Clone, Debug, Default)]
pub struct Table {
    /// What it shows.
    pub caption: String,
    /// Names of the columns.
    pub head: Vec<String>,
    /// As many cells a row as there are names.
    pub rows: Vec<Vec<Cell>>,
}

/// A cell of a table.
#[derive(Clone, Debug, Default)]
pub struct Cell {
    /// What it says.
    pub text: String,
    /// Its colour.
    pub tone: Tone,
}

impl<T: Into<String>> From<T> for Cell {
    fn from(text: T) -> Self {
        Self { text: text.into(), tone: Tone::Plain }
    }
}

impl Cell {
    /// A coloured cell.
    pub fn toned(text: impl Into<String>, tone: Tone) -> Self {
        Self { text: text.into(), tone }
    }
}
