//! One JSON object a line on standard output, and nothing else there.

use std::io::{BufWriter, ErrorKind, Write};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Drain, Events, SinkConfig, SinkContext, SinkError, kind};
use crate::event::Event;
use crate::kinds::Kind;

pub(super) const KIND: Kind<dyn SinkConfig> =
    kind::<Stdout>("stdout", "one JSON object a window, channel and stage on standard output", "");

/// Keys of the stdout sink: it has none of its own.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Stdout {}

impl SinkConfig for Stdout {
    fn open(&self, _: &SinkContext) -> Result<Drain, SinkError> {
        // Not `stdout().lock()`: its line buffer would turn a burst of lines into one write each.
        Ok(Drain::Thread(Box::new(|events| write_lines(&events, BufWriter::new(std::io::stdout())))))
    }
}

/// Writes until there are no more events; flushes whenever none is waiting.
fn write_lines(events: &Events, mut out: impl Write) -> Result<(), SinkError> {
    while let Ok(event) = events.recv_blocking() {
        crate::fail::point("sink-stdout");
        let Event::Verdict { line, .. } = &*event else { continue };
        let mut written = out.write_all(line.as_bytes()).and_then(|()| out.write_all(b"\n"));
        if events.is_empty() {
            written = written.and_then(|()| out.flush());
        }
        written.map_err(failed)?;
    }
    out.flush().map_err(failed)
}

fn failed(source: std::io::Error) -> SinkError {
    match source.kind() {
        ErrorKind::BrokenPipe => SinkError::ReaderGone,
        _ => SinkError::Io { place: "stdout".to_owned(), source },
    }
}
