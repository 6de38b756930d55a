//! `gearwatch config check | show | schema | bench`.

use std::io::Write;
use std::path::PathBuf;

use anyhow::Context;
use clap::builder::{PossibleValue, PossibleValuesParser};
use clap::{Args, Subcommand};
use gearwatch_daemon::config::{self, Config};
use gearwatch_daemon::service::Service;
use gearwatch_runtime::stop::Stop;
use gearwatch_sim::shipped::BENCHES;

use super::Run;
use crate::exit::Exit;
use crate::terminal;

/// Check, show or describe the configuration of the service, and print a bench file to start from
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch config check bench-3.toml            0 if `gearwatch run` would accept it
  gearwatch config show                          the built-in configuration, all defaults written out
  gearwatch config show bench-3.toml             a file with all defaults filled in
  gearwatch config schema > gearwatch.schema.json    for editors that check TOML while one types
  gearwatch config bench single-pair > bench.toml    a bench file to start from (docs/bench.md)")]
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
    /// Print a bench file that comes with the program, to start one's own from
    #[command(after_help = "Examples:\n  gearwatch config bench single-pair > bench.toml")]
    Bench {
        /// Which of them
        #[arg(value_parser = shipped_names())]
        name: String,
    },
}

/// Names of the benches that come with the program.
fn shipped_names() -> PossibleValuesParser {
    PossibleValuesParser::new(BENCHES.iter().map(|shipped| PossibleValue::new(shipped.name).help(shipped.help)))
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
        let mut out = terminal::out();
        match self.action {
            Action::Check { file } => {
                let config = read(file.as_ref())?;
                let name = config.name.clone();
                let (benches, sinks) = (config.benches.len(), config.sinks.len());
                // Building reads what the configuration names and starts nothing; then folders,
                // secrets and addresses are tried.
                let service = Service::build(config, &Stop::default())?;
                // A service that runs with this configuration holds its address.
                service.try_out(service.page_address())?;
                writeln!(out, "{name}: good ({benches} bench(es), {sinks} sink(s))")?;
            }
            Action::Show { file } => out.write_all(read(file.as_ref())?.shown().as_bytes())?,
            Action::Schema => {
                serde_json::to_writer_pretty(&mut out, &config::schema())?;
                writeln!(out)?;
            }
            Action::Bench { name } => {
                let shipped = BENCHES.iter().find(|shipped| shipped.name == name).context("no such bench")?;
                out.write_all(shipped.text.as_bytes())?;
            }
        }
        Ok(Exit::Ok)
    }
}
