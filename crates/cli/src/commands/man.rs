//! `gearwatch man`: manual pages.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::{Args, Command};
use clap_mangen::Man;

use super::{Run, command_line};
use crate::exit::Exit;
use crate::output::OutputOptions;
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
    #[command(flatten)]
    output: OutputOptions,
}

impl Run for Manual {
    const NAME: &'static str = "man";

    fn run(self) -> anyhow::Result<Exit> {
        let mut command = command_line();
        let Some(folder) = self.folder else {
            let mut page = Vec::new();
            Man::new(command).render(&mut page)?;
            terminal::out().write_all(&page)?;
            return Ok(Exit::Ok);
        };
        command = command.disable_help_subcommand(true);
        command.build();
        let mut pages = Vec::new();
        collect(&command, &mut pages)?;
        std::fs::create_dir_all(&folder).with_context(|| format!("{} cannot be made", folder.display()))?;
        // All names are checked before the first page is written.
        let mut outputs = self.output.reading::<&Path>([]);
        let targets: Vec<_> =
            pages.iter().map(|(name, _)| outputs.target(&folder.join(name))).collect::<Result<_, _>>()?;
        for (target, (_, page)) in targets.into_iter().zip(&pages) {
            target.write(page)?;
        }
        Ok(Exit::Ok)
    }
}

/// Name and content of the page of a command and of all commands below it.
fn collect(command: &Command, pages: &mut Vec<(String, Vec<u8>)>) -> anyhow::Result<()> {
    for below in command.get_subcommands().filter(|below| !below.is_hide_set()) {
        collect(below, pages)?;
    }
    let (man, mut page) = (Man::new(command.clone()), Vec::new());
    man.render(&mut page)?;
    pages.push((man.get_filename(), page));
    Ok(())
}
