//! `gearwatch completions SHELL`.

use clap::Args;
use clap_complete::Shell;

use super::{Run, command_line};
use crate::exit::Exit;
use crate::terminal;

/// Print a completion script for a shell
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch completions bash > /etc/bash_completion.d/gearwatch
  gearwatch completions zsh > ~/.zfunc/_gearwatch
  gearwatch completions fish > ~/.config/fish/completions/gearwatch.fish")]
pub struct Completions {
    /// The shell
    #[arg(value_enum)]
    shell: Shell,
}

impl Run for Completions {
    const NAME: &'static str = "completions";

    fn run(self) -> anyhow::Result<Exit> {
        // Into memory first: the generator would panic on a closed pipe.
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut command_line(), "gearwatch", &mut script);
        std::io::Write::write_all(&mut terminal::out(), &script)?;
        Ok(Exit::Ok)
    }
}
