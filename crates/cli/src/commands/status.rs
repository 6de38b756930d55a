//! `gearwatch status`: how the running service is.

use std::io::Write;
use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context, bail};
use clap::Args;
use gearwatch_alarm::Severity;
use gearwatch_core::verdict::MachineState;
use gearwatch_daemon::snapshot::Snapshot;
use gearwatch_daemon::states::BenchInstrument;

use super::Run;
use crate::exit::Exit;
use crate::page::PageAccess;
use crate::terminal;

mod find;

use find::Endpoint;

/// Say how the running service is
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch status
  gearwatch status --socket ./status.sock --json | jq .benches[0].channels
  gearwatch status --url https://bench-3:8650 --ca-file ca.pem --token-file page.token

The service answers where its configuration has service.status_socket, and at its page. Without --socket and --url the usual socket is asked, then what the \
configurations of the services that run on this machine name. Exit codes: 0 all that must go on goes on and nothing is wrong \
with the gears; 1 warning; 2 critical; 3 not all right, unknown, or no answer.")]
pub struct Status {
    /// The service's socket; where neither it nor --url is given, the running service is looked for
    #[arg(short, long, value_name = "PATH")]
    socket: Option<PathBuf>,
    /// Ask the service's page instead, also that of another machine
    #[arg(long, value_name = "URL", conflicts_with = "socket")]
    url: Option<String>,
    #[command(flatten)]
    access: PageAccess,
    /// The whole state as JSON
    #[arg(long)]
    json: bool,
}

/// A service that does not answer within this time is not all right.
const PATIENCE: Duration = Duration::from_secs(2);

impl Run for Status {
    const NAME: &'static str = "status";

    fn run(self) -> anyhow::Result<Exit> {
        let text = match (&self.url, &self.socket) {
            (Some(url), _) => self.ask_page(url).with_context(|| format!("{url}: no answer"))?,
            (None, Some(socket)) => gearwatch_daemon::status::ask(socket, PATIENCE).with_context(|| {
                format!("{}: no answer; is the service running with this service.status_socket?", socket.display())
            })?,
            (None, None) => self.ask_around()?,
        };
        let snapshot: Snapshot = serde_json::from_str(&text).context("the answer is not that of a service")?;
        let mut out = terminal::out();
        if self.json {
            writeln!(out, "{text}")?;
        } else {
            print(&mut out, &snapshot)?;
        }
        Ok(exit(&snapshot))
    }
}

impl Status {
    /// Asks where a service may answer, until one does.
    fn ask_around(&self) -> anyhow::Result<String> {
        let mut tried = Vec::new();
        for place in find::places() {
            let answer = match &place {
                Endpoint::Socket(path) => gearwatch_daemon::status::ask(path, PATIENCE).map_err(anyhow::Error::from),
                Endpoint::Page(url) => self.ask_page(url),
            };
            match answer {
                Ok(text) => return Ok(text),
                Err(e) => tried.push(format!("{place}: {e:#}")),
            }
        }
        bail!(
            "no service answers ({}); name its service.status_socket with --socket, or its page with --url",
            tried.join("; ")
        )
    }

    fn ask_page(&self, url: &str) -> anyhow::Result<String> {
        Ok(self.access.page(url, PATIENCE)?.get("/api/snapshot")?.body_mut().read_to_string()?)
    }
}

fn exit(snapshot: &Snapshot) -> Exit {
    let worst = |state: MachineState| snapshot.benches.iter().any(|bench| bench.machine == state);
    let alarm = |severity: Severity| snapshot.benches.iter().flat_map(|b| &b.alarms).any(|a| a.severity == severity);
    let instruments_ok = snapshot.benches.iter().all(|bench| bench.instrument == BenchInstrument::OK);
    if worst(MachineState::Alarm) || alarm(Severity::Critical) {
        Exit::Critical
    } else if worst(MachineState::Deviating) || worst(MachineState::PathChanged) || alarm(Severity::Warning) {
        Exit::Warning
    } else if !snapshot.ok || worst(MachineState::Unknown) || !instruments_ok {
        Exit::Unknown
    } else {
        Exit::Ok
    }
}

fn print(out: &mut impl Write, snapshot: &Snapshot) -> std::io::Result<()> {
    let ok = if snapshot.ok { "all goes on" } else { "NOT ALL RIGHT" };
    writeln!(
        out,
        "gearwatch {}: {ok}; up {:.0} s, load {:.0} %, self test {}",
        snapshot.version,
        snapshot.uptime_secs,
        100.0 * snapshot.load,
        snapshot.self_test.code()
    )?;
    for bench in &snapshot.benches {
        writeln!(out, "{}: machine {}, instrument {}", bench.name, bench.machine.code(), bench.instrument.code())?;
        writeln!(
            out,
            "  windows: {} judged, {} shed, {} failed; {} gap(s), {} samples missing",
            bench.windows_judged, bench.windows_shed, bench.windows_failed, bench.gaps, bench.samples_missing
        )?;
        for source in &bench.sources {
            let trouble = if source.error.is_empty() { String::new() } else { format!("; {}", source.error) };
            writeln!(out, "  source {}: {}, {} packets{trouble}", source.name, source.state.code(), source.packets)?;
        }
        for (channel, state) in &bench.channels {
            writeln!(out, "  channel {channel}: {state}")?;
        }
        for place in &bench.places {
            let rank = |&level: &i8| match level {
                0 => "0",
                1 => "I",
                2 => "II",
                3 => "III",
                4 => "IV",
                5 => "V",
                _ => "unknown",
            };
            let ranks: Vec<_> = place.levels.iter().map(rank).collect();
            let why = if place.reason.is_empty() { String::new() } else { format!(" ({})", place.reason) };
            writeln!(
                out,
                "  {} at {}: {}{why}, ranks {}",
                place.stage,
                place.channel,
                place.machine.code(),
                ranks.join(" ")
            )?;
        }
        for alarm in &bench.alarms {
            let active = if alarm.active { "active" } else { "over, latched" };
            let seen = if alarm.acknowledged { "acknowledged" } else { "not acknowledged" };
            writeln!(out, "  alarm {}: {}, {active}, {seen}", alarm.id, alarm.severity.code())?;
        }
    }
    for sink in &snapshot.sinks {
        writeln!(
            out,
            "sink {}: {}, {} events, {} missed{}",
            sink.name,
            sink.state.code(),
            sink.offered,
            sink.dropped,
            if sink.detail.is_empty() { String::new() } else { format!("; {}", sink.detail) }
        )?;
    }
    Ok(())
}
