//! `gearwatch fleet`: all benches that publish to one NATS server.

mod screen;

use std::io::{IsTerminal, Write};
use std::net::{SocketAddr, TcpListener};
use std::path::PathBuf;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use anyhow::{Context, bail};
use clap::{Args, ValueEnum};
use gearwatch_alarm::Severity;
use gearwatch_core::verdict::MachineState;
use gearwatch_daemon::fleet::{self, Access, Fleet as View, From, Notice, Told};
use gearwatch_daemon::states::BenchCondition;
use gearwatch_runtime::secret::{Secret, carries_secret, place};

use super::Run;
use crate::exit::Exit;
use crate::terminal;
use screen::Screen;

/// Watch all benches that publish to one NATS server
///
/// The benches publish with a sink of kind "nats". What they said is read from the stream from the
/// beginning, or from some time ago, and then as it comes; after an outage reading goes on where it
/// ended. Every letter is shown once, however often it was sent.
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch fleet                                          a table, live
  gearwatch fleet --server nats://broker:4222 --since 8h
  gearwatch fleet --page                                   and a page at http://127.0.0.1:8090
  gearwatch fleet --once                                   how all benches are now, as a table
  gearwatch fleet --format json | jq -c 'select(.kind == \"alarm\")'

Exit codes with --once: 0 all benches are normal; 1 a warning; 2 critical; 3 unknown, silent, or no answer. Otherwise it runs until it is \
stopped.")]
pub struct Fleet {
    /// The server: nats://host:4222, or tls://host:4222
    #[arg(short, long, value_name = "URL", default_value = "nats://127.0.0.1:4222")]
    server: String,
    /// The stream that the benches publish to
    #[arg(long, default_value = fleet::STREAM)]
    stream: String,
    /// Read from so long ago on, such as 90s, 15m, 8h or 2d; all that the stream has where left out
    #[arg(long, value_name = "TIME", value_parser = duration)]
    since: Option<Duration>,
    /// End when all that is in the stream has been read
    #[arg(long)]
    once: bool,
    /// Also show a page to browsers on this machine
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, require_equals = true, default_missing_value = "127.0.0.1:8090", conflicts_with = "once")]
    page: Option<SocketAddr>,
    /// What to print; a live table on a terminal, lines elsewhere, a table with --once where left
    /// out
    #[arg(short, long)]
    format: Option<Form>,
    /// Give up after so long without an answer (only with --once)
    #[arg(long, value_name = "TIME", value_parser = duration, default_value = "10s")]
    patience: Duration,
    /// User name
    #[arg(long)]
    user: Option<String>,
    /// File whose first line is the password, or without a user the token
    #[arg(long, value_name = "FILE")]
    secret_file: Option<PathBuf>,
    /// Certificate of the authority that signed the server's (PEM)
    #[arg(long, value_name = "FILE")]
    ca_file: Option<PathBuf>,
}

/// What is printed.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Form {
    /// One line a bench
    Table,
    /// One line in words for what is new and matters: states, alarms, gaps
    Lines,
    /// One JSON object a letter as it was published; with --once one object for all benches
    Json,
}

/// How often a live table is drawn.
const TICK: Duration = Duration::from_millis(200);

fn duration(text: &str) -> Result<Duration, String> {
    let split = text.find(|c: char| c.is_ascii_alphabetic()).unwrap_or(text.len());
    let (number, unit) = text.split_at(split);
    let seconds = match unit {
        "s" | "" => 1.0,
        "m" => 60.0,
        "h" => 3600.0,
        "d" => 86_400.0,
        _ => return Err(format!("the unit is {unit:?}; expected s, m, h or d")),
    };
    let number: f64 = number.parse().map_err(|_| format!("{text:?} is no time such as 90s, 15m, 8h or 2d"))?;
    Duration::try_from_secs_f64(number * seconds).map_err(|e| e.to_string())
}

impl Run for Fleet {
    const NAME: &'static str = "fleet";

    fn run(self) -> anyhow::Result<Exit> {
        if carries_secret(&self.server) {
            bail!(
                "{} is given with a user or password, which every process can read; use --user and --secret-file",
                place(&self.server)
            );
        }
        let read = |file: &PathBuf| Secret::read(file).with_context(|| format!("{}: cannot be read", file.display()));
        let secret = self.secret_file.as_ref().map(read).transpose()?;
        let access = Access { user: self.user.clone(), secret, ca_file: self.ca_file.clone() };
        let from = self.since.map_or(From::Beginning, From::Ago);
        if let Some(address) = self.page {
            show_page(address, self.server.clone(), self.stream.clone(), access.clone(), from)?;
        }
        let notices = start(self.server.clone(), self.stream.clone(), access, from)?;
        let terminal = std::io::stdout().is_terminal();
        match self.format {
            _ if self.once => self.once(&notices),
            Some(Form::Table) | None if terminal => Screen::new(self.server).run(&notices),
            form => live(&notices, form.unwrap_or(Form::Lines)),
        }
    }
}

/// Follows the stream on a thread of its own. The channel is bounded: who reads slowly makes the
/// stream wait.
fn start(server: String, stream: String, access: Access, from: From) -> anyhow::Result<Receiver<Notice>> {
    let (sender, receiver) = mpsc::sync_channel(4096);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    std::thread::Builder::new().name("gw-fleet".to_owned()).spawn(move || {
        let tell = |notice| {
            if sender.send(notice).is_err() {
                // Nobody reads any more: the command is over.
                std::process::exit(0);
            }
        };
        runtime.block_on(fleet::follow(&server, &access, &stream, from, tell))
    })?;
    Ok(receiver)
}

/// Serves the page on a thread of its own, which follows the stream by itself.
fn show_page(address: SocketAddr, server: String, stream: String, access: Access, from: From) -> anyhow::Result<()> {
    if !address.ip().is_loopback() {
        anyhow::bail!(
            "--page={address}: the page is for browsers on this machine; expected a loopback address such as 127.0.0.1:8090"
        );
    }
    let listener = TcpListener::bind(address).with_context(|| format!("--page={address}"))?;
    talk(&format!("page at http://{}", listener.local_addr()?));
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    std::thread::Builder::new().name("gw-fleet-page".to_owned()).spawn(move || {
        let served = runtime.block_on(fleet::page(listener, &server, &access, &stream, from));
        if let Err(error) = served {
            talk(&format!("the page has ended: {error}"));
        }
    })?;
    Ok(())
}

fn talk(words: &str) {
    // Whoever has closed stderr does not want to hear it.
    let _ = writeln!(terminal::err(), "gearwatch fleet: {words}");
}

fn now_ns() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_nanos()).unwrap_or(i64::MAX)
}

impl Fleet {
    fn once(&self, notices: &Receiver<Notice>) -> anyhow::Result<Exit> {
        let mut view = View::default();
        loop {
            match notices.recv_timeout(self.patience) {
                Ok(Notice::Letter(heard)) => drop(view.take(&heard)),
                Ok(Notice::CaughtUp) => break,
                Ok(Notice::Connected) => {}
                // The patience is for the whole answer, and a server that refuses will refuse
                // again.
                Ok(Notice::Lost(error)) => anyhow::bail!("{}: {error}", self.server),
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => {
                    anyhow::bail!("{}: no answer within {:.0?}", self.server, self.patience)
                }
            }
        }
        let mut out = terminal::out();
        match self.format {
            Some(Form::Json) => writeln!(out, "{}", serde_json::to_string(&view)?)?,
            _ => table(&mut out, &view)?,
        }
        Ok(exit(&view))
    }
}

fn exit(view: &View) -> Exit {
    let now = now_ns();
    let conditions: Vec<_> = view.benches.values().map(|bench| bench.condition(now)).collect();
    let alarm =
        |severity: Severity| view.benches.values().flat_map(|b| b.alarms.values()).any(|s| s == severity.code());
    let any = |state: MachineState| conditions.contains(&BenchCondition::Machine(state));
    if any(MachineState::Alarm) || alarm(Severity::Critical) {
        Exit::Critical
    } else if any(MachineState::Deviating) || any(MachineState::PathChanged) || alarm(Severity::Warning) {
        Exit::Warning
    } else if conditions.is_empty()
        || conditions.iter().any(|condition| *condition != BenchCondition::Machine(MachineState::Normal))
    {
        Exit::Unknown
    } else {
        Exit::Ok
    }
}

/// One row a bench: what the columns hold, as text.
fn row(name: &str, bench: &fleet::Bench, now: i64) -> [String; 8] {
    let known = |value: Option<f64>, digits: usize| value.map_or("–".to_owned(), |value| format!("{value:.digits$}"));
    let age = now.saturating_sub(bench.heard_ns) / 1_000_000_000;
    let alarms: Vec<_> = bench.alarms.iter().map(|(id, severity)| format!("{id} {severity}")).collect();
    [
        name.to_owned(),
        bench.condition(now).code().to_owned(),
        bench.instrument.code().to_owned(),
        known(bench.motor_speed_hz, 2),
        known(bench.brake_torque_nm, 1),
        bench.verdicts.to_string(),
        format!("{age} s"),
        alarms.join(", "),
    ]
}

const COLUMNS: [&str; 8] =
    ["bench", "condition", "instrument", "speed Hz", "torque N m", "verdicts", "heard", "alarms"];

fn table(out: &mut impl Write, view: &View) -> std::io::Result<()> {
    let now = now_ns();
    let mut rows: Vec<[String; 8]> = vec![COLUMNS.map(str::to_owned)];
    rows.extend(view.benches.iter().map(|(name, bench)| row(name, bench, now).map(|text| terminal::cell(&text))));
    let widths: Vec<usize> = (0..8).map(|i| rows.iter().map(|row| row[i].chars().count()).max().unwrap_or(0)).collect();
    for row in rows {
        let cells = row.iter().zip(&widths).map(|(cell, &width)| format!("{cell:width$}"));
        let line: Vec<String> = cells.collect();
        writeln!(out, "{}", line.join("  ").trim_end())?;
    }
    Ok(())
}

/// Prints what is new until nobody reads any more.
fn live(notices: &Receiver<Notice>, form: Form) -> anyhow::Result<Exit> {
    let mut view = View::default();
    let mut out = terminal::out();
    while let Ok(notice) = notices.recv() {
        match notice {
            Notice::Letter(heard) => {
                if view.take(&heard) == Told::Again {
                    continue;
                }
                match form {
                    Form::Json => writeln!(out, "{}", serde_json::to_string(&heard.object)?)?,
                    Form::Lines => {
                        if let Some(words) = words(&heard) {
                            writeln!(out, "{words}")?;
                        }
                    }
                    Form::Table => {}
                }
            }
            Notice::Lost(error) => talk(&format!("the server is away: {error}")),
            Notice::Connected => {}
            Notice::CaughtUp if form == Form::Table => table(&mut out, &view)?,
            Notice::CaughtUp => out.flush()?,
        }
    }
    Ok(Exit::Ok)
}

/// A letter in words; none for a verdict, of which there are too many to read.
fn words(heard: &fleet::Heard) -> Option<String> {
    let bench = heard.text("bench");
    match heard.text("kind") {
        "state" => Some(format!(
            "{bench}: {}, machine {}, instrument {}",
            heard.text("service"),
            heard.text("machine"),
            heard.text("instrument")
        )),
        "alarm" => {
            let how = if heard.object.get("active") == Some(&true.into()) { "alarm" } else { "alarm over" };
            Some(format!("{bench}: {how} {}, {}", heard.text("id"), heard.text("severity")))
        }
        "gap" => {
            let count = heard.object.get("count").cloned().unwrap_or_default();
            Some(format!("{bench}: {count} missing at {}: {}", heard.text("channel"), heard.text("cause")))
        }
        _ => None,
    }
}
