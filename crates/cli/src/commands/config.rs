//! `gearwatch config check | show | schema`.

use std::io::Write;
use std::path::PathBuf;

use clap::{Args, Subcommand};
use gearwatch_daemon::config::{self, Config};
use gearwatch_daemon::service::Service;
use gearwatch_daemon::stop::Stop;

use super::Run;
use crate::exit::Exit;

/// Check, show or describe the configuration of the service
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch config check bench-3.toml            0 if `gearwatch run` would accept it
  gearwatch config show                          the built-in configuration, all defaults written out
  gearwatch config show bench-3.toml             a file with all defaults filled in
  gearwatch config schema > gearwatch.schema.json    for editors that check TOML while one types")]
pub struct ConfigCommand {
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand)]
enum Action {
    /// Read a configuration with its bench files and baselines, and say what is wrong
    #[command(after_help = "Examples:\n  gearwatch config check bench-3.toml && systemctl reload gearwatch")]
    Check {
        /// Configuration file; the built-in one where left out
        file: Option<PathBuf>,
    },
    /// Print a configuration with all defaults filled in
    #[command(after_help = "Examples:\n  gearwatch config show > my.toml")]
    Show {
        /// Configuration file; the built-in one where left out
        file: Option<PathBuf>,
    },
    /// Print the JSON schema of the configuration
    #[command(after_help = "Examples:\n  gearwatch config schema > gearwatch.schema.json")]
    Schema,
}

fn read(file: Option<&PathBuf>) -> anyhow::Result<Config> {
    Ok(match file {
        Some(path) => Config::read(path)?,
        None => Config::built_in()?,
    })
}

impl Run for ConfigCommand {
    const NAME: &'static str = "config";

    fn run(self) -> anyhow::Result<Exit> {
        let mut out = std::io::stdout().lock();
        match self.action {
            Action::Check { file } => {
                let config = read(file.as_ref())?;
                let name = config.name.clone();
                let (benches, sinks) = (config.benches.len(), config.sinks.len());
                // Building opens what the configuration names and starts nothing.
                Service::build(config, &Stop::default())?;
                writeln!(out, "{name}: good ({benches} bench(es), {sinks} sink(s))")?;
            }
            Action::Show { file } => out.write_all(read(file.as_ref())?.shown().as_bytes())?,
            Action::Schema => {
                serde_json::to_writer_pretty(&mut out, &config::schema())?;
                writeln!(out)?;
            }
        }
        Ok(Exit::Ok)
    }
}
