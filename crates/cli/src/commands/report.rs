//! `gearwatch report --weekly LOG…`: a week of the service's logs on a few pages, to be read and
//! handed on.

use std::path::PathBuf;
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::bail;
use clap::Args;
use gearwatch_daemon::config::{Config, ReportConfig};
use gearwatch_history::{History, time};

use super::{Run, history};
use crate::exit::Exit;
use crate::output::OutputOptions;

mod trend;
mod week;

use week::{DAY_NS, TREND_DAYS, Week};

/// A week of the service's logs as one HTML file: what changed, trends, hours, alarms, events
///
/// The week is that of the seven UTC days before --to. It is compared with the week before; trends
/// are sought in the last four weeks.
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch report --weekly /var/lib/gearwatch --out week.html
  gearwatch report --weekly /var/lib/gearwatch --to 2026-11-23 --config service.toml --out week-47.html

--config names the service's configuration; its [report] table says customer, author, bench and serial number.
Exit codes: 0 done; 3 bad input, no window in the week, or a file could not be read to its end.")]
pub struct ReportCommand {
    /// Folders of logs, or log files
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,
    /// The last seven days
    #[arg(long, required = true)]
    weekly: bool,
    /// Ends before this UTC midnight, such as 2026-11-23; the next one where left out
    #[arg(long, value_name = "DATE", value_parser = time::parse)]
    to: Option<i64>,
    /// The page, an HTML file that needs nothing else
    #[arg(long, value_name = "FILE.html")]
    out: PathBuf,
    /// The service's configuration, for its [report] table
    #[arg(long, value_name = "FILE.toml")]
    config: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OutputOptions,
}

impl Run for ReportCommand {
    const NAME: &'static str = "report";

    fn run(self) -> anyhow::Result<Exit> {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |t| i64::try_from(t.as_nanos()).unwrap_or(0));
        let to = self.to.unwrap_or((now.div_euclid(DAY_NS) + 1) * DAY_NS);
        if to.rem_euclid(DAY_NS) != 0 {
            bail!("--to {} is no midnight; expected a date such as 2026-11-23", time::iso(to));
        }
        let (who, benches) = match &self.config {
            Some(path) => {
                let config = Config::read(path)?;
                let files = config.benches.iter().filter_map(|bench| bench.file.as_ref());
                let benches = files.map(|file| gearwatch_io::bench_file::read(&config.folder.join(file)));
                let benches = benches.collect::<Result<Vec<_>, _>>()?;
                (config.report, benches)
            }
            None => (ReportConfig::default(), Vec::new()),
        };
        let logs = history::logs(&self.logs)?;
        let files = logs.files();
        let mut outputs = self.overwrite.reading(&files);
        let target = outputs.target(&self.out)?;
        let from = to - TREND_DAYS * DAY_NS;
        let read = history::read_all::<Self>(History::new(DAY_NS, Some(from), Some(to)), &logs, Some(from), Some(to))?;
        let week = Week { history: &read, to, now, who: &who, benches: &benches };
        if week.windows() == 0 {
            let span = read.span().map_or_else(
                || "hold none".to_owned(),
                |(first, last)| format!("reach from {} to {}", time::iso(first), time::iso(last)),
            );
            let from = time::iso(to - 7 * DAY_NS);
            bail!("no window from {from} to {} in {} file(s); the logs {span}", time::iso(to), files.len());
        }
        target.write(week.page())?;
        Ok(if read.troubles.is_empty() { Exit::Ok } else { Exit::Unknown })
    }
}
