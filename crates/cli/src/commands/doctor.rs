//! `gearwatch doctor DIR`: whether a log is whole.

use std::io::Write;
use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use gearwatch_log::{Ending, FileHealth, doctor};

use super::Run;
use crate::exit::Exit;
use crate::terminal;

/// Say whether the log in a folder is whole
#[derive(Args)]
#[command(after_help = "Reads every file, changes nothing, and may run beside the service.
Exit code: 0 everything that was ever acknowledged is there, 3 something is damaged, missing or not closed, 1 the folder cannot be read.

Example:
  gearwatch doctor /var/lib/gearwatch/log")]
pub struct Doctor {
    /// Folder of the log
    folder: PathBuf,
}

impl Run for Doctor {
    const NAME: &'static str = "doctor";

    fn run(self) -> anyhow::Result<Exit> {
        let health = match doctor(&self.folder) {
            Ok(health) => health,
            Err(error) => {
                writeln!(terminal::err(), "gearwatch doctor: {error}").context("stderr")?;
                return Ok(Exit::Warning);
            }
        };
        if health.files.is_empty() {
            // Nothing was looked at, which must not read as whole.
            let folder = self.folder.display();
            writeln!(
                terminal::err(),
                "gearwatch doctor: {folder} holds no log file; name the folder of an mcap_log sink"
            )
            .context("stderr")?;
            return Ok(Exit::Warning);
        }
        let mut out = terminal::out();
        for file in &health.files {
            tell(&mut out, file)?;
        }
        for hole in &health.missing {
            let (first, last) = (hole.after_group + 1, hole.before_group.saturating_sub(1));
            writeln!(
                out,
                "groups {first} to {last} are missing, with {} results",
                (hole.last_seq + 1).saturating_sub(hole.first_seq)
            )?;
        }
        for group in &health.repeated {
            writeln!(out, "group {group} is there more than once, or in the wrong place")?;
        }
        for (cause, (records, count)) in &health.gaps {
            writeln!(out, "{records} recorded gaps, {cause}: at most {count} missing in all")?;
        }
        if let Some((first, last)) = health.seq {
            writeln!(out, "results {first} to {last}")?;
        }
        if health.in_use {
            writeln!(out, "a service is writing to it")?;
        }
        let whole = health.is_whole();
        writeln!(out, "{} files, {}", health.files.len(), if whole { "whole" } else { "not whole" })?;
        Ok(if whole { Exit::Ok } else { Exit::Unknown })
    }
}

fn tell(out: &mut impl Write, file: &FileHealth) -> std::io::Result<()> {
    let end = match (&file.unreadable, file.ending) {
        (Some(_), _) => "unreadable",
        (None, Ending::Closed) => "closed",
        (None, Ending::Open) => "no end",
        (None, Ending::Wrong) => "wrong end",
    };
    let messages: u64 = file.messages.values().sum();
    writeln!(out, "{}: {} bytes, {messages} messages, {end}", file.name, file.bytes)?;
    if let Some(why) = &file.unreadable {
        writeln!(out, "  {why}")?;
    }
    for damage in file.damage.iter().chain(&file.torn_tail) {
        writeln!(out, "  byte {}: {} ({} bytes)", damage.offset, damage.what, damage.length)?;
    }
    Ok(())
}
