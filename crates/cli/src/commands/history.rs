//! `gearwatch history LOG…`: what the service's logs say over time.

use std::collections::BTreeSet;
use std::io::Write;
use std::path::PathBuf;

use anyhow::{Context, bail};
use clap::Args;
use gearwatch_history::{History, Levels, time};

use super::Run;
use crate::exit::Exit;
use crate::output::OutputOptions;
use crate::progress::Progress;
use crate::terminal;

mod picture;
mod tell;

/// Ranks, deviations, speed, torque and events over time, from the logs of the service
///
/// Windows are put together by the hour, or as --every says, for each bench, stage and channel. A
/// file that the service is still writing is read as far as it goes.
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch history /var/lib/gearwatch
  gearwatch history /var/lib/gearwatch --from 2026-11-01 --to 2026-11-22T12:00 --every 1d
  gearwatch history /var/lib/gearwatch --every 10m --csv > november.csv
  gearwatch history /var/lib/gearwatch --parquet history.parquet --plot history.html

Times are UTC. Exit codes: 0 done; 3 bad input, no window between --from and --to, or a file could not be read to its end.")]
pub struct HistoryCommand {
    /// Folders of logs, or log files
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,
    /// From this time on: 2026-11-22, 2026-11-22T14:30 or 2026-11-22T14:30:00Z
    #[arg(long, value_name = "TIME", value_parser = time::parse)]
    from: Option<i64>,
    /// Before this time
    #[arg(long, value_name = "TIME", value_parser = time::parse)]
    to: Option<i64>,
    /// How much is put together: 30s, 10m, 1h, 1d, 1w
    #[arg(long, value_name = "SPAN", default_value = "1h", value_parser = time::parse_span)]
    every: i64,
    /// Rows with a header line on standard output
    #[arg(long)]
    csv: bool,
    /// Rows as Parquet
    #[cfg(feature = "batch")]
    #[arg(long, value_name = "FILE.parquet")]
    parquet: Option<PathBuf>,
    /// Pictures: one HTML file for a browser
    #[arg(long, value_name = "FILE.html")]
    plot: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OutputOptions,
}

impl Run for HistoryCommand {
    const NAME: &'static str = "history";

    fn run(self) -> anyhow::Result<Exit> {
        if let (Some(from), Some(to)) = (self.from, self.to)
            && from >= to
        {
            bail!("--from {} is not before --to {}", time::iso(from), time::iso(to));
        }
        let logs = logs(&self.logs)?;
        let files = logs.files();
        let mut outputs = self.overwrite.reading(&files);
        let plot = self.plot.as_deref().map(|path| outputs.target(path)).transpose()?;
        #[cfg(feature = "batch")]
        let parquet = self.parquet.as_deref().map(|path| outputs.target(path)).transpose()?;
        let history = read_all::<Self>(History::new(self.every, self.from, self.to), &logs, self.from, self.to)?;
        if history.rows().next().is_none() {
            bail!(
                "no window between {} and {} in {} file(s); the logs {}",
                self.from.map_or_else(|| "the beginning".to_owned(), time::iso),
                self.to.map_or_else(|| "the end".to_owned(), time::iso),
                files.len(),
                history.span().map_or_else(
                    || "hold none".to_owned(),
                    |(first, last)| format!("reach from {} to {}", time::iso(first), time::iso(last))
                )
            );
        }
        let mut out = std::io::BufWriter::new(terminal::coloured());
        if self.csv {
            tell::csv(&mut out, &history)?;
        } else {
            tell::table(&mut out, &history)?;
        }
        out.flush()?;
        #[cfg(feature = "batch")]
        if let Some(target) = parquet {
            let mut file = target.create()?;
            let (texts, numbers) = tell::columns(&history);
            gearwatch_batch::part::write_columns(&mut file, texts, numbers)?;
            file.finish()?;
        }
        if let Some(target) = plot {
            target.write(picture::page(&history))?;
        }
        Ok(if history.troubles.is_empty() { Exit::Ok } else { Exit::Unknown })
    }
}

/// Reads all logs into a history, with progress; what could not be read to its end is said for the
/// command that asks.
pub(super) fn read_all<R: Run>(
    mut history: History,
    logs: &Logs,
    from: Option<i64>,
    to: Option<i64>,
) -> anyhow::Result<History> {
    let progress = Progress::new("files", logs.files().len() as u64);
    for log in &logs.0 {
        let known = match log.folder.as_deref().map(Levels::read).transpose() {
            Ok(Some(Some(levels))) => levels.fill(&mut history, from, to)?,
            Ok(_) => BTreeSet::new(),
            // The files say the same, slower.
            Err(e) => {
                writeln!(terminal::err(), "gearwatch {}: {}", R::NAME, terminal::plain(&e.to_string()))?;
                BTreeSet::new()
            }
        };
        for path in &log.files {
            if !path.file_name().is_some_and(|name| known.contains(&*name.to_string_lossy())) {
                history.read(path)?;
            }
            progress.finished(&path.display().to_string());
        }
    }
    drop(progress);
    history.finish();
    for trouble in &history.troubles {
        writeln!(terminal::err(), "gearwatch {}: {}", R::NAME, terminal::plain(trouble))?;
    }
    Ok(history)
}

/// What the arguments name.
pub(super) struct Logs(Vec<Log>);

struct Log {
    /// Where the levels of detail are, where a folder is named.
    folder: Option<PathBuf>,
    files: Vec<PathBuf>,
}

impl Logs {
    pub(super) fn files(&self) -> Vec<PathBuf> {
        self.0.iter().flat_map(|log| &log.files).cloned().collect()
    }
}

/// The files of all logs: those of a folder in the order of their names, which is that of their
/// numbers.
pub(super) fn logs(named: &[PathBuf]) -> anyhow::Result<Logs> {
    let mut out = Vec::new();
    for log in named {
        if !log.is_dir() {
            out.push(Log { folder: None, files: vec![log.clone()] });
            continue;
        }
        let files = gearwatch_history::files(log).with_context(|| format!("{} cannot be read", log.display()))?;
        if files.is_empty() {
            bail!("{} holds no log file; name the folder of an mcap_log sink", log.display());
        }
        out.push(Log { folder: Some(log.clone()), files });
    }
    Ok(Logs(out))
}
