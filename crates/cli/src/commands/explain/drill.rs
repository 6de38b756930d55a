//! `gearwatch explain --drill`: known changes in the user's own recordings, and from which size on
//! they are shown.

use std::io::{IsTerminal, Write};

use anyhow::Context;
use clap::ValueEnum;
use gearwatch_core::bench::Bench;
use gearwatch_core::recording::Recording;
use gearwatch_explain::drill::change::Kind;
use gearwatch_explain::drill::{Outcome, Question, Row, drill, shown_from, table};
use gearwatch_report::{Bars, Chart};

use super::AnswerFiles;
use crate::exit::Exit;
use crate::terminal;

/// Which changes are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Changes {
    /// Those of the instrument and those of the machine
    All,
    /// Of sensors, cables, converters and clocks
    Instrument,
    /// Of the machine and its sheet
    Machine,
}

impl Changes {
    fn kinds(self) -> Vec<Kind> {
        let mut out = vec![Kind::Nothing];
        if self != Self::Machine {
            out.extend(Kind::INSTRUMENT);
        }
        if self != Self::Instrument {
            out.extend(Kind::MACHINE);
        }
        out
    }
}

/// Files of a drill.
pub(super) const FILES: [&str; 3] = ["drill.md", "drill.csv", "drill.svg"];

/// Prints the table; with a folder, writes it there too (`drill.md`), every run (`drill.csv`) and a
/// picture (`drill.svg`).
pub fn run(
    bench: &Bench,
    recordings: &[Recording],
    reference: &[Recording],
    changes: Changes,
    files: Option<AnswerFiles>,
) -> anyhow::Result<Exit> {
    let kinds = changes.kinds();
    let talk = std::io::stderr().is_terminal();
    let done = |through: usize, all: usize| {
        if talk || (10 * through / all) > (10 * (through - 1) / all) {
            // Progress is a courtesy; a closed terminal is not an error.
            let _ = write!(
                std::io::stderr(),
                "{}  {through} of {all} runs{}",
                if talk { "\r" } else { "" },
                if talk { "" } else { "\n" }
            );
        }
    };
    let outcomes = drill(&Question { bench, recordings, reference, kinds: &kinds }, &done)?;
    if talk {
        let _ = writeln!(std::io::stderr());
    }
    let rows = table(&outcomes);
    let text = page(bench, recordings.len(), reference.len(), &kinds, &rows);
    terminal::out().write_all(text.as_bytes()).context("standard output")?;
    if let Some(files) = files {
        let drawn = super::figures::titled(&picture(&rows))?;
        files.write(vec![("drill.md", text), ("drill.csv", every_run(&outcomes)), ("drill.svg", drawn)])?;
    }
    Ok(Exit::Ok)
}

fn of_size(row: &Row) -> String {
    match row.kind.sizes() {
        (_, "") => String::new(),
        (_, "bits") => format!("{:.0} bits", -row.size),
        (_, unit) => format!("{} {unit}", row.size),
    }
}

/// The table as Markdown, which reads well on a terminal too.
fn page(bench: &Bench, recordings: usize, references: usize, kinds: &[Kind], rows: &[Row]) -> String {
    let against = match references {
        0 => "the second half of each against its first".to_owned(),
        n => format!("against {n} reference recordings"),
    };
    let mut text = format!("Drill on {}: {recordings} recordings, {against}.\n\n", bench.name);
    text.push_str("| change | size | runs | named right | any name | of the machine | what else was named |\n|---|---|---|---|---|---|---|\n");
    for row in rows {
        let others: Vec<String> = row.others.iter().take(4).map(|(name, n)| format!("{name} {n}")).collect();
        text.push_str(&format!(
            "| {} | {} | {} | {:.0} % | {} | {} | {} |\n",
            row.kind.words(),
            of_size(row),
            row.runs,
            100.0 * row.right as f64 / row.runs.max(1) as f64,
            row.seen,
            row.physics,
            others.join(", ")
        ));
    }
    text.push_str("\nShown on this bench (95 % named right from this size on):\n\n");
    for kind in kinds.iter().filter(|k| **k != Kind::Nothing) {
        let from = match (shown_from(rows, *kind), kind.sizes()) {
            (Some(_), (_, "")) => "yes".to_owned(),
            (Some(size), (_, "bits")) => format!("from {:.0} bits down", -size),
            (Some(size), (_, unit)) => format!("from {size} {unit}"),
            (None, (sizes, unit)) => match sizes.last() {
                Some(last) if !unit.is_empty() => format!("not up to {} {unit}", last.abs()),
                _ => "no".to_owned(),
            },
        };
        text.push_str(&format!("- {}: {from}\n", kind.words()));
    }
    text
}

fn every_run(outcomes: &[Outcome]) -> String {
    let mut text = String::from("recording,change,size,unit,truth,right,named\n");
    for o in outcomes {
        let truth: Vec<String> = o.truth.iter().map(|t| format!("{}@{}", t.effect, t.place)).collect();
        let named = match &o.named {
            Ok(named) => named.iter().map(|(e, p)| format!("{e}@{p}")).collect::<Vec<_>>().join(" "),
            Err(why) => format!("not judged: {}", why.replace(['"', '\n'], " ")),
        };
        text.push_str(&format!(
            "\"{}\",{},{},{},\"{}\",{},\"{named}\"\n",
            o.recording,
            o.change.kind.words().replace(',', ""),
            o.change.size.abs(),
            o.change.kind.sizes().1,
            truth.join(" "),
            o.is_right()
        ));
    }
    text
}

/// Share of right names by change, a bar a size.
fn picture(rows: &[Row]) -> Chart {
    let mut kinds: Vec<Kind> = rows.iter().map(|r| r.kind).filter(|k| *k != Kind::Nothing).collect();
    kinds.dedup();
    let most = kinds.iter().map(|k| k.sizes().0.len()).max().unwrap_or(0);
    let series = (0..most)
        .map(|k| {
            let bars = kinds.iter().map(|kind| {
                let size = kind.sizes().0.get(k);
                let row = rows.iter().find(|r| r.kind == *kind && Some(&r.size) == size);
                row.map_or((f64::NAN, f64::NAN), |r| {
                    let (p, n) = (r.right as f64 / r.runs as f64, r.runs as f64);
                    (100.0 * p, 100.0 * (p * (1.0 - p) / n).sqrt())
                })
            });
            (format!("size {}", k + 1), bars.collect())
        })
        .collect();
    let groups = kinds.iter().map(|k| k.words().split([' ', ',']).next().unwrap_or_default().to_owned()).collect();
    Chart::Bars(Bars {
        caption: "Drill: changes named right by size, the smallest first; the sizes stand in the table".into(),
        y_label: "named right (%)".into(),
        groups,
        series,
        limits: Vec::new(),
    })
}
