//! Talk on stderr: log lines for people and for the journal, colours only where somebody can see
//! them.
//!
//! A thread of its own writes it. Whoever speaks never waits for whoever reads: lines that find no
//! room are left out, and counted. So are lines of one kind that come in masses, and what of a line
//! is longer than anybody reads: no peer can fill a disk by what it makes the service say.

use std::collections::HashMap;
use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use tracing::callsite::Identifier;
use tracing::{Event, Level, Metadata, Subscriber};
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::fmt::format::{Format, Full, Writer, format};
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields, MakeWriter};
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::registry::LookupSpan;
use tracing_subscriber::util::SubscriberInitExt;

use crate::terminal;

/// Lines that may wait for stderr.
const WAITING: usize = 4096;
/// The last lines get so long to be written at the end.
const FAREWELL: Duration = Duration::from_millis(300);

/// Writes what waits when it goes.
pub struct Talk {
    left: Arc<AtomicU64>,
}

impl Drop for Talk {
    fn drop(&mut self) {
        let end = Instant::now() + FAREWELL;
        while self.left.load(Ordering::Acquire) > 0 && Instant::now() < end {
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}

/// Sends log lines to stderr. `GEARWATCH_LOG` sets what is told (such as `debug` or
/// `gearwatch_daemon=trace`); `info` where it is not set.
pub fn start() -> Talk {
    let asked = std::env::var("GEARWATCH_LOG").unwrap_or_default();
    // What the client of OPC UA writes stands in the error of its source too.
    let usual = || Targets::new().with_default(LevelFilter::INFO).with_target("opcua", LevelFilter::OFF);
    let filter: Targets = if asked.is_empty() { usual() } else { asked.parse().unwrap_or_else(|_| usual()) };
    let to_terminal = std::io::stderr().is_terminal();
    let pen = Pen::start();
    let talk = Talk { left: pen.left.clone() };
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(pen)
        .with_target(false)
        .with_ansi(to_terminal && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty()));
    let filtered = tracing_subscriber::registry().with(filter);
    if is_read_by_journal() {
        let for_journal = ForJournal(format().without_time().with_level(false).with_target(false));
        let _ = filtered.with(lines.event_format(for_journal)).try_init();
    } else {
        let _ = filtered.with(lines).try_init();
    }
    talk
}

/// Stderr leads to the journal, which says so by device and inode of its end (systemd.exec(5),
/// `JOURNAL_STREAM`).
#[cfg(target_os = "linux")]
fn is_read_by_journal() -> bool {
    use std::os::unix::fs::MetadataExt;
    let told = std::env::var("JOURNAL_STREAM").unwrap_or_default();
    std::fs::metadata("/proc/self/fd/2").is_ok_and(|end| told == format!("{}:{}", end.dev(), end.ino()))
}

#[cfg(not(target_os = "linux"))]
fn is_read_by_journal() -> bool {
    false
}

/// Lines as the journal takes them from stderr: the priority in front, in place of time and level
/// (sd-daemon(3)). Its own socket would make whoever speaks wait for it.
struct ForJournal(Format<Full, ()>);

impl<S, N> FormatEvent<S, N> for ForJournal
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(&self, context: &FmtContext<'_, S, N>, mut out: Writer<'_>, event: &Event<'_>) -> std::fmt::Result {
        // As syslog(3) numbers them.
        let priority = match *event.metadata().level() {
            Level::ERROR => 3,
            Level::WARN => 4,
            Level::INFO => 6,
            Level::DEBUG | Level::TRACE => 7,
        };
        write!(out, "<{priority}>")?;
        self.0.format_event(context, out, event)
    }
}

/// Hands lines to the thread that writes.
#[derive(Clone)]
struct Pen {
    lines: SyncSender<Vec<u8>>,
    left: Arc<AtomicU64>,
    dropped: Arc<AtomicU64>,
    limits: Arc<Mutex<Limits>>,
    /// What kind of line is being written.
    kind: Option<Identifier>,
}

impl Pen {
    fn start() -> Self {
        let (lines, waiting) = sync_channel(WAITING);
        let pen = Self { lines, left: Arc::default(), dropped: Arc::default(), limits: Arc::default(), kind: None };
        let (left, dropped, limits) = (pen.left.clone(), pen.dropped.clone(), pen.limits.clone());
        // Without a thread nothing is told; the service itself does not need it.
        let _ = std::thread::Builder::new()
            .name("gw-talk".to_owned())
            .spawn(move || write(&waiting, (&left, &dropped), &limits));
        pen
    }
}

fn write(waiting: &Receiver<Vec<u8>>, (left, dropped): (&AtomicU64, &AtomicU64), limits: &Mutex<Limits>) {
    let mut out = terminal::log();
    loop {
        let line = waiting.recv_timeout(Duration::from_secs(1));
        for told in limits.lock().unwrap_or_else(PoisonError::into_inner).settle(Instant::now()) {
            let _ = writeln!(out, "{told}");
        }
        match line {
            Ok(line) => {
                let missing = dropped.swap(0, Ordering::Relaxed);
                if missing > 0 {
                    let _ = writeln!(out, "{missing} lines were left out here: stderr was too slow");
                }
                // A stderr that is gone is nobody's loss but its reader's.
                let _ = out.write_all(&line);
                left.fetch_sub(1, Ordering::Release);
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}

/// Lines of one kind within [`PERIOD`]; more are left out, and counted.
const MOST_ALIKE: u64 = 20;
const PERIOD: Duration = Duration::from_secs(10);
/// Longest line (bytes).
const LONGEST: usize = 4096;

/// How much is said of each kind: what one place in the program says is one kind.
#[derive(Default)]
struct Limits(HashMap<Identifier, Repetition>);

struct Repetition {
    since: Instant,
    said: u64,
    left_out: u64,
    /// The beginning of the last line that was left out.
    last: String,
}

impl Limits {
    /// Whether a line may be written now.
    fn admit(&mut self, kind: Identifier, line: &[u8], now: Instant) -> bool {
        let kind = self.0.entry(kind).or_insert(Repetition { since: now, said: 0, left_out: 0, last: String::new() });
        if kind.left_out == 0 && now.duration_since(kind.since) >= PERIOD {
            (kind.since, kind.said) = (now, 0);
        }
        kind.said += 1;
        if kind.said <= MOST_ALIKE {
            return true;
        }
        kind.left_out += 1;
        kind.last = String::from_utf8_lossy(&line[..line.len().min(200)]).trim_end().to_owned();
        false
    }

    /// What is to be said of lines that were left out, once their period is over.
    fn settle(&mut self, now: Instant) -> Vec<String> {
        let over = |kind: &Repetition| kind.left_out > 0 && now.duration_since(kind.since) >= PERIOD;
        let told = self.0.values().filter(|kind| over(kind));
        let told =
            told.map(|kind| format!("{} more lines like this were left out: {}", kind.left_out, kind.last)).collect();
        self.0.retain(|_, kind| !over(kind));
        told
    }
}

/// No longer than anybody reads.
fn cut(line: &[u8]) -> Vec<u8> {
    if line.len() <= LONGEST {
        return line.to_vec();
    }
    // Not within a character.
    let end = (0..=LONGEST).rev().find(|&end| line[end] & 0xc0 != 0x80).unwrap_or(LONGEST);
    let mut short = line[..end].to_vec();
    short.extend_from_slice(format!(" … ({} bytes more)\n", line.len() - end).as_bytes());
    short
}

/// One line on its way; tracing writes each with one call.
impl Write for Pen {
    fn write(&mut self, line: &[u8]) -> std::io::Result<usize> {
        if let Some(kind) = &self.kind
            && !self.limits.lock().unwrap_or_else(PoisonError::into_inner).admit(kind.clone(), line, Instant::now())
        {
            return Ok(line.len());
        }
        self.left.fetch_add(1, Ordering::Acquire);
        if self.lines.try_send(cut(line)).is_err() {
            self.left.fetch_sub(1, Ordering::Release);
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
        Ok(line.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl MakeWriter<'_> for Pen {
    type Writer = Self;

    fn make_writer(&self) -> Self {
        self.clone()
    }

    fn make_writer_for(&self, meta: &Metadata<'_>) -> Self {
        Self { kind: Some(meta.callsite()), ..self.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tracing::Callsite;

    struct Place;

    impl Callsite for Place {
        fn set_interest(&self, _: tracing::subscriber::Interest) {}

        fn metadata(&self) -> &Metadata<'_> {
            unreachable!("nobody asks for it")
        }
    }

    static PLACE: Place = Place;

    /// 7500 lines a second for twenty seconds, as an overloaded bench or a foreign sender made
    /// them: forty are written, and the others are counted.
    #[test]
    fn regress_lines_that_come_in_masses_are_limited_and_counted() {
        let (mut limits, begin) = (Limits::default(), Instant::now());
        let (mut written, mut told) = (0, Vec::new());
        for n in 0..150_000_u64 {
            let now = begin + Duration::from_nanos(n * 1_000_000_000 / 7500);
            told.extend(limits.settle(now));
            written += u64::from(limits.admit(Identifier(&PLACE), b"windows were shed\n", now));
        }
        told.extend(limits.settle(begin + Duration::from_secs(30)));
        let counts = told.iter().map(|line| line.split(' ').next().unwrap().parse::<u64>().unwrap());
        assert_eq!(written + counts.sum::<u64>(), 150_000);
        assert_eq!((written, told.len()), (40, 2), "{told:?}");
        assert!(told[0].ends_with("more lines like this were left out: windows were shed"), "{}", told[0]);
    }

    #[test]
    fn regress_no_line_is_longer_than_anybody_reads() {
        let line = cut("é".repeat(1 << 20).as_bytes());
        assert!(line.len() < LONGEST + 40 && line.ends_with(b"bytes more)\n"));
        assert!(String::from_utf8(line).is_ok());
        assert_eq!(cut(b"short\n"), b"short\n");
    }
}
