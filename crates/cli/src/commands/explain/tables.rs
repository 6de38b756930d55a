//! `gearwatch explain --tables`: two tables of amplitudes, and what they allow to say.

use std::io::Write as _;
use std::path::Path;

use anyhow::Context;
use gearwatch_explain::tables::{AmplitudeTable, relate};
use gearwatch_io::text::read_text;

use super::super::paper;
use crate::exit::Exit;
use crate::terminal;

fn read(path: &Path) -> anyhow::Result<AmplitudeTable> {
    let name = path.display().to_string();
    let text = read_text(path).with_context(|| format!("{name} cannot be read"))?;
    Ok(AmplitudeTable::parse(&text, &name)?)
}

/// Prints signs, sizes, models and the finding.
pub fn run(simulation: &Path, experiment: &Path) -> anyhow::Result<Exit> {
    let relation = relate(&read(simulation)?, &read(experiment)?)?;
    let text = paper::relation_text(&relation)?;
    terminal::out().write_all(text.as_bytes()).context("standard output")?;
    Ok(Exit::Ok)
}
