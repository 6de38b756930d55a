//! One JSON object a line on standard output, and nothing else there.

use std::fs::File;
use std::io::{ErrorKind, Write};
use std::sync::Arc;

use gearwatch_runtime::kinds::Kind;
use gearwatch_runtime::queue::QueueCounters;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Drain, Events, SinkConfig, SinkContext, SinkError, kind};
use crate::event::Event;

pub(super) const KIND: Kind<dyn SinkConfig> =
    kind::<Stdout>("stdout", "one JSON object a window, channel and stage on standard output", "");

/// Keys of the stdout sink: it has none of its own.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Stdout {}

/// Bytes that are collected for one write while more lines wait.
const MOST_AT_ONCE: usize = 64 << 10;

impl SinkConfig for Stdout {
    fn open(&self, context: &SinkContext) -> Result<Drain, SinkError> {
        let mut lines =
            Lines { out: standard_output().map_err(failed)?, waiting: Vec::new(), counters: context.counters.clone() };
        Ok(Drain::Thread(Box::new(move |events| lines.write_all(&events))))
    }
}

/// The end itself: the buffer of `std::io::stdout` keeps what could not be written, and nobody
/// learns of it.
#[cfg(unix)]
fn standard_output() -> std::io::Result<File> {
    use std::os::fd::AsFd;
    Ok(std::io::stdout().as_fd().try_clone_to_owned()?.into())
}

#[cfg(windows)]
fn standard_output() -> std::io::Result<File> {
    use std::os::windows::io::AsHandle;
    Ok(std::io::stdout().as_handle().try_clone_to_owned()?.into())
}

/// Lines on their way out.
struct Lines<W> {
    out: W,
    waiting: Vec<u8>,
    counters: Arc<QueueCounters>,
}

impl<W: Write> Lines<W> {
    /// Writes until there are no more events; waits for more lines only where some are there
    /// already.
    fn write_all(&mut self, events: &Events) -> Result<(), SinkError> {
        while let Ok(event) = events.recv_blocking() {
            gearwatch_runtime::fail::point("sink-stdout");
            let Event::Verdict { line, .. } = &*event else { continue };
            self.waiting.extend_from_slice(line.as_bytes());
            self.waiting.push(b'\n');
            if events.is_empty() || self.waiting.len() >= MOST_AT_ONCE {
                self.flush().map_err(failed)?;
            }
        }
        self.flush().map_err(failed)
    }

    /// Writes what waits. What a failure leaves unwritten is counted as lost; a line that is torn
    /// is ended, so that the next one is whole.
    fn flush(&mut self) -> std::io::Result<()> {
        let mut written = 0;
        let error = loop {
            match self.out.write(&self.waiting[written..]) {
                _ if written == self.waiting.len() => {
                    self.waiting.clear();
                    return Ok(());
                }
                Ok(0) => break ErrorKind::WriteZero.into(),
                Ok(more) => written += more,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => break error,
            }
        };
        let lost = self.waiting[written..].iter().filter(|&&byte| byte == b'\n').count();
        (0..lost).for_each(|_| self.counters.count_dropped());
        let torn = written > 0 && self.waiting[written - 1] != b'\n';
        self.waiting.clear();
        if torn {
            // Where this finds no room either, whoever reads finds one line that is no JSON.
            let _ = self.out.write_all(b"\n");
        }
        Err(error)
    }
}

fn failed(source: std::io::Error) -> SinkError {
    match source.kind() {
        ErrorKind::BrokenPipe => SinkError::ReaderGone,
        _ => SinkError::Io { place: "stdout".to_owned(), source },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Takes so many bytes, then says that the disk is full.
    struct Small(Vec<u8>, usize);

    impl Write for Small {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            let room = bytes.len().min(self.1 - self.0.len());
            self.0.extend_from_slice(&bytes[..room]);
            if room == 0 && !bytes.is_empty() { Err(ErrorKind::StorageFull.into()) } else { Ok(room) }
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    /// Five lines of four bytes into room for ten: two are whole, one is torn, and three are
    /// counted as lost.
    #[test]
    fn regress_lines_that_a_full_disk_does_not_take_are_counted() {
        let counters = Arc::new(QueueCounters::default());
        let waiting = b"{1}\n{2}\n{3}\n{4}\n{5}\n".to_vec();
        let mut lines = Lines { out: Small(Vec::new(), 10), waiting, counters: counters.clone() };
        assert_eq!(lines.flush().unwrap_err().kind(), ErrorKind::StorageFull);
        assert_eq!((counters.dropped(), lines.out.0.as_slice()), (3, &b"{1}\n{2}\n{3"[..]));
        // There is room again: the torn line was to be ended, and could not be.
        lines.out.1 = 100;
        lines.waiting = b"{6}\n".to_vec();
        assert!(lines.flush().is_ok());
        assert_eq!(counters.dropped(), 3);
    }
}
