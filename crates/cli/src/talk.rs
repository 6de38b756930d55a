//! Talk on stderr: log lines for people and for the journal, colours only where somebody can see them.

use std::io::IsTerminal;

use tracing_subscriber::EnvFilter;

/// Sends log lines to stderr. `GEARWATCH_LOG` sets what is told (such as `debug` or `gearwatch_daemon=trace`); `info` where it is not set.
pub fn start() {
    let filter = EnvFilter::try_from_env("GEARWATCH_LOG").unwrap_or_else(|_| EnvFilter::new("info"));
    let to_terminal = std::io::stderr().is_terminal();
    let lines = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_target(false)
        .with_ansi(to_terminal && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty()));
    // The journal has a clock of its own.
    if std::env::var_os("JOURNAL_STREAM").is_some() {
        let _ = lines.without_time().try_init();
    } else {
        let _ = lines.try_init();
    }
}
