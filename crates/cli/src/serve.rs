//! Runs a configuration as a service: what `run` and `replay` share.

use std::path::PathBuf;

use gearwatch_daemon::config::Config;
use gearwatch_daemon::service::{Reload, ReloadError, Service, Summary};
use gearwatch_runtime::stop::Stop;

use crate::exit::Exit;
use crate::{signals, talk};

/// Builds and runs a configuration until its sources end or a signal comes, and says how it ended.
/// With `ends_with_sinks` a closed pipe ends it too. At SIGHUP the configuration in `reread` takes
/// over, if it is good.
///
/// # Errors
/// When it cannot be built or started.
pub fn serve(config: Config, ends_with_sinks: bool, reread: Option<PathBuf>) -> anyhow::Result<Exit> {
    let _talk = talk::start();
    let stop = Stop::default();
    let reload = Reload::default();
    signals::listen(&stop, &reload)?;
    let mut service = Service::build(config, &stop)?;
    if ends_with_sinks {
        service = service.ending_with_sinks();
    }
    let told = stop.clone();
    let again = move || {
        let path = reread.as_ref().ok_or(ReloadError::NoFile)?;
        Ok(Service::build(Config::read(path)?, &told)?)
    };
    let summary = service.run_reloading(&stop, &reload, again)?;
    say(&summary);
    Ok(if !summary.died.is_empty() {
        Exit::Broken
    } else if !summary.unfinished.is_empty() {
        Exit::Unknown
    } else if summary.failed.is_empty() && summary.windows_lost == 0 && summary.events_lost.is_empty() {
        Exit::Ok
    } else if summary.stopped && summary.failed.is_empty() {
        // Stopped as asked; what a slow sink missed in its life was counted and told.
        Exit::Ok
    } else {
        Exit::Unknown
    })
}

fn say(summary: &Summary) {
    for failure in &summary.died {
        tracing::error!("{failure}: the engine cannot go on");
    }
    for (sink, lost) in &summary.events_lost {
        tracing::warn!(sink, lost, "it was too slow for some of its events");
    }
    for sink in &summary.unfinished {
        tracing::error!(sink, "it could not write all it had and close it before the time to stop was over");
    }
    let how = if summary.stopped { "stopped" } else { "all sources have ended" };
    tracing::info!(windows = summary.judged, windows_lost = summary.windows_lost, "{how}");
}
