//! `gearwatch man`: manual pages.

use std::io::Write;
use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use clap_mangen::Man;

use super::{Run, command_line};
use crate::exit::Exit;
use crate::terminal;

/// Print the manual page, or write the pages of all commands to a folder
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch man | man -l -                       read it
  gearwatch man --folder /usr/share/man/man1     install all pages")]
pub struct Manual {
    /// Write gearwatch.1, gearwatch-run.1 and so on here; the folder is made where there is none
    #[arg(long, value_name = "FOLDER")]
    folder: Option<PathBuf>,
}

impl Run for Manual {
    const NAME: &'static str = "man";

    fn run(self) -> anyhow::Result<Exit> {
        let command = command_line();
        let Some(folder) = self.folder else {
            let mut page = Vec::new();
            Man::new(command).render(&mut page)?;
            terminal::out().write_all(&page)?;
            return Ok(Exit::Ok);
        };
        std::fs::create_dir_all(&folder).with_context(|| format!("{} cannot be made", folder.display()))?;
        clap_mangen::generate_to(command, &folder)
            .with_context(|| format!("{}: the pages cannot be written", folder.display()))?;
        Ok(Exit::Ok)
    }
}
