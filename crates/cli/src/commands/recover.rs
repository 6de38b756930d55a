//! `gearwatch recover FILE`: what is good of a damaged or unfinished MCAP file.

use std::io::Write;
use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use gearwatch_log::{Damage, Ending, recover_file};

use super::Run;
use crate::exit::Exit;
use crate::output::OutputOptions;
use crate::terminal;

/// Write what is good of a damaged or unfinished MCAP file to a new one
#[derive(Args)]
#[command(
    after_help = "The file itself is not touched. Exit code: 0 nothing was lost, 3 something was lost, 1 nothing could be done.

Examples:
  gearwatch recover run.mcap
  gearwatch recover run.mcap -o whole.mcap"
)]
pub struct Recover {
    /// The file
    file: PathBuf,
    /// The new file [default: FILE with .recovered.mcap in place of .mcap]
    #[arg(short, long)]
    output: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OutputOptions,
}

impl Run for Recover {
    const NAME: &'static str = "recover";

    fn run(self) -> anyhow::Result<Exit> {
        match self.recover() {
            Ok(exit) => Ok(exit),
            Err(error) => {
                writeln!(terminal::err(), "gearwatch recover: {error:#}").context("stderr")?;
                Ok(Exit::Warning)
            }
        }
    }
}

impl Recover {
    fn recover(self) -> anyhow::Result<Exit> {
        let output = self.output.unwrap_or_else(|| self.file.with_extension("recovered.mcap"));
        let target = self.overwrite.reading([&self.file]).target(&output)?;
        let salvaged = recover_file(&self.file, target)?;
        let mut out = terminal::out();
        writeln!(out, "{}: {} messages", output.display(), salvaged.messages)?;
        for Damage { offset, length, what } in salvaged.damage.iter().chain(&salvaged.torn_tail) {
            writeln!(out, "  byte {offset}: {what}; {length} bytes left out")?;
        }
        if salvaged.orphans > 0 {
            writeln!(out, "  {} messages whose channel no record describes", salvaged.orphans)?;
        }
        for hole in &salvaged.missing {
            let (after, before) = (hole.after_group, hole.before_group);
            write!(out, "  groups {} to {} are missing", after + 1, before.saturating_sub(1))?;
            if hole.first_seq <= hole.last_seq {
                write!(out, ", with the results {} to {}", hole.first_seq, hole.last_seq)?;
            }
            writeln!(out)?;
        }
        let lossless = salvaged.is_lossless();
        let end = match salvaged.ending {
            Ending::Closed => "the file was closed",
            Ending::Open => "the file had no end",
            Ending::Wrong => "the end of the file was damaged",
        };
        writeln!(out, "  {end}; {}", if lossless { "nothing was lost" } else { "something was lost" })?;
        Ok(if lossless { Exit::Ok } else { Exit::Unknown })
    }
}
