//! `gearwatch run`: the service.

use std::path::PathBuf;

use clap::Args;
use gearwatch_daemon::config::Config;

use super::Run;
use crate::exit::Exit;
use crate::serve::serve;

/// Watch benches: sources to ranks to sinks, until stopped
///
/// Without a configuration it watches a simulated demonstration bench in real time, in which a
/// fault sets in after half a minute. Standard output carries one JSON object a window, channel and
/// stage; talk goes to standard error.
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch run                                  watch the demonstration bench; Ctrl-C stops
  gearwatch run --config bench-3.toml            watch what the file describes
  gearwatch run | jq -c '[.window, .stage, .rank_1x, .rank_2x]'
  gearwatch config show > my.toml                write the built-in configuration down, to start from

SIGINT and SIGTERM stop in order; a second one ends at once. SIGHUP reads the configuration again: where it is good it takes \
over, otherwise the old one goes on. Exit codes: 0 stopped or all sources at their end; 3 a source or \
the configuration failed, or something was lost; 70 the service must be started anew.")]
pub struct RunService {
    /// Configuration file (see `gearwatch config`); the built-in demonstration where left out
    #[arg(short, long, value_name = "FILE")]
    config: Option<PathBuf>,
}

impl Run for RunService {
    const NAME: &'static str = "run";

    fn run(self) -> anyhow::Result<Exit> {
        let config = match &self.config {
            Some(path) => Config::read(path)?,
            None => Config::built_in()?,
        };
        serve(config, false, self.config)
    }
}
