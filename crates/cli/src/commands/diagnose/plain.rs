//! Diagnoses for programs: JSON lines, CSV, Nagios.

use std::io::{BufWriter, Stdout, Write};
use std::path::Path;

use gearwatch_core::verdict::{HARMONICS, Verdict};
use serde_json::{Map, Value};

use super::{Diagnosis, exit_of, severity};
use crate::exit::Exit;

/// The verdict's flat object with the recording in front.
fn object(recording: &str, verdict: &Verdict) -> anyhow::Result<Map<String, Value>> {
    let mut out = Map::new();
    out.insert("recording".to_owned(), recording.into());
    if let Value::Object(fields) = serde_json::to_value(verdict)? {
        out.extend(fields);
    }
    Ok(out)
}

/// One JSON object a line.
pub(super) fn lines(out: &mut impl Write, all: &[Diagnosis]) -> anyhow::Result<()> {
    for one in all {
        for verdict in &one.verdicts {
            serde_json::to_writer(&mut *out, &object(&one.recording, verdict)?)?;
            writeln!(out)?;
        }
    }
    Ok(())
}

/// Windows, printed as they come: one JSON object a line, none of which is kept.
pub(super) struct Lines {
    out: BufWriter<Stdout>,
    /// Said in each line where there are several recordings; without it the lines are those of
    /// `gearwatch replay`, byte for byte.
    recording: Option<String>,
    worst: Option<Exit>,
    failed: Option<anyhow::Error>,
}

impl Lines {
    pub(super) fn new(recording: &Path, labelled: bool) -> Self {
        let recording = labelled.then(|| recording.display().to_string());
        Self { out: BufWriter::new(std::io::stdout()), recording, worst: None, failed: None }
    }

    /// After a failure, which [`Self::finish`] tells, nothing more is written.
    pub(super) fn print(&mut self, verdict: &Verdict) {
        self.worst = self.worst.into_iter().chain([exit_of(verdict.machine)]).max_by_key(|exit| severity(*exit));
        if self.failed.is_none() {
            self.failed = self.write(verdict).err();
        }
    }

    fn write(&mut self, verdict: &Verdict) -> anyhow::Result<()> {
        match &self.recording {
            Some(recording) => serde_json::to_writer(&mut self.out, &object(recording, verdict)?)?,
            None => serde_json::to_writer(&mut self.out, verdict)?,
        }
        Ok(writeln!(self.out)?)
    }

    /// What the worst window means; `None` where there was none.
    pub(super) fn finish(mut self) -> anyhow::Result<Option<Exit>> {
        match self.failed.take() {
            Some(error) => Err(error),
            None => Ok(self.out.flush().map(|()| self.worst)?),
        }
    }
}

/// A header line and one line a verdict. Unknown numbers are empty fields.
pub(super) fn csv(out: &mut impl Write, all: &[Diagnosis]) -> anyhow::Result<()> {
    let mut rows = Vec::new();
    for one in all {
        for verdict in &one.verdicts {
            rows.push(object(&one.recording, verdict)?);
        }
    }
    // Some verdicts name no states: the longest has all columns, in order.
    let Some(header) = rows.iter().max_by_key(|row| row.len()) else { return Ok(()) };
    let mut writer = csv::Writer::from_writer(out);
    writer.write_record(header.keys())?;
    for row in &rows {
        writer.write_record(header.keys().map(|name| match row.get(name) {
            None | Some(Value::Null) => String::new(),
            Some(Value::String(text)) => text.clone(),
            Some(other) => other.to_string(),
        }))?;
    }
    writer.flush()?;
    Ok(())
}

/// `GEARWATCH CRITICAL - …|performance data`, and one line more for each note (plugin development
/// guidelines, section 2.5).
pub(super) fn nagios(out: &mut impl Write, all: &[Diagnosis], exit: Exit) -> anyhow::Result<()> {
    let word = match exit {
        Exit::Ok => "OK",
        Exit::Warning => "WARNING",
        Exit::Critical => "CRITICAL",
        Exit::Unknown | Exit::Broken => "UNKNOWN",
    };
    let verdicts = || all.iter().flat_map(|one| one.verdicts.iter());
    let worst = verdicts().max_by_key(|verdict| severity(exit_of(verdict.machine)));
    let what = match worst {
        None => "no window could be judged".to_owned(),
        Some(verdict) if exit == Exit::Ok => {
            format!("{} verdicts, {}", verdicts().count(), verdict.machine.code())
        }
        Some(verdict) => {
            let reason = match verdict.reason.code() {
                "" => String::new(),
                code => format!(" ({code})"),
            };
            format!("{} {}: {}{reason}{}", verdict.stage, verdict.channel, verdict.machine.code(), largest(verdict))
        }
    };
    write!(out, "GEARWATCH {word} - {what}")?;
    let mut lead = "|";
    for verdict in verdicts() {
        for (k, harmonic) in verdict.harmonics.iter().enumerate() {
            // U is the plugin's word for a value that is not known.
            let value = harmonic.deviation_percent.value;
            let value = if value.is_finite() { format!("{value:.2}%") } else { "U".to_owned() };
            let name = format!("{}/{} {}x", verdict.channel, verdict.stage, k + 1).replace(['\'', '='], "_");
            write!(out, "{lead}'{name}'={value};-1:1;-10:10")?;
            lead = " ";
        }
    }
    writeln!(out)?;
    for one in all {
        for note in &one.notes {
            // A bar would begin performance data.
            writeln!(out, "{}: {}", one.recording, note.replace('|', "/"))?;
        }
    }
    Ok(())
}

/// The harmonic with the largest known deviation, in words.
fn largest(verdict: &Verdict) -> String {
    let known = (0..HARMONICS).filter(|&k| verdict.harmonics[k].deviation_percent.value.is_finite());
    let size = |k: usize| verdict.harmonics[k].deviation_percent.value.abs();
    known.max_by(|&a, &b| size(a).total_cmp(&size(b))).map_or_else(String::new, |k| {
        let harmonic = &verdict.harmonics[k];
        format!(", {}x {:+.1} % (rank {})", k + 1, harmonic.deviation_percent.value, harmonic.rank.code())
    })
}
