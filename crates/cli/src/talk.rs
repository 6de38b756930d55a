//! Talk on stderr: log lines for people and for the journal, colours only where somebody can see them.
//!
//! A thread of its own writes it. Whoever speaks never waits for whoever reads: lines that find no room are left out, and counted.

use std::io::{IsTerminal, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use tracing::{Event, Level, Subscriber};
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::fmt::format::{Format, Full, Writer, format};
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields, MakeWriter};
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::registry::LookupSpan;
use tracing_subscriber::util::SubscriberInitExt;

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

/// Sends log lines to stderr. `GEARWATCH_LOG` sets what is told (such as `debug` or `gearwatch_daemon=trace`); `info` where it is not set.
pub fn start() -> Talk {
    let asked = std::env::var("GEARWATCH_LOG").unwrap_or_default();
    let usual = || Targets::new().with_default(LevelFilter::INFO);
    let filter: Targets = if asked.is_empty() { usual() } else { asked.parse().unwrap_or_else(|_| usual()) };
    // What the client of a broker says of each try, the sink says in better words.
    let filter = if asked.contains("async_nats") { filter } else { filter.with_target("async_nats", LevelFilter::OFF) };
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

/// Stderr leads to the journal, which says so by device and inode of its end (systemd.exec(5), `JOURNAL_STREAM`).
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

/// Lines as the journal takes them from stderr: the priority in front, in place of time and level (sd-daemon(3)). Its own socket would make
/// whoever speaks wait for it.
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
}

impl Pen {
    fn start() -> Self {
        let (lines, waiting) = sync_channel(WAITING);
        let pen = Self { lines, left: Arc::default(), dropped: Arc::default() };
        let (left, dropped) = (pen.left.clone(), pen.dropped.clone());
        // Without a thread nothing is told; the service itself does not need it.
        let _ = std::thread::Builder::new().name("gw-talk".to_owned()).spawn(move || write(&waiting, &left, &dropped));
        pen
    }
}

fn write(waiting: &Receiver<Vec<u8>>, left: &AtomicU64, dropped: &AtomicU64) {
    while let Ok(line) = waiting.recv() {
        let missing = dropped.swap(0, Ordering::Relaxed);
        let mut out = std::io::stderr();
        if missing > 0 {
            let _ = writeln!(out, "{missing} lines were left out here: stderr was too slow");
        }
        // A stderr that is gone is nobody's loss but its reader's.
        let _ = out.write_all(&line);
        left.fetch_sub(1, Ordering::Release);
    }
}

/// One line on its way; tracing writes each with one call.
impl Write for Pen {
    fn write(&mut self, line: &[u8]) -> std::io::Result<usize> {
        self.left.fetch_add(1, Ordering::Acquire);
        if self.lines.try_send(line.to_vec()).is_err() {
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
}
