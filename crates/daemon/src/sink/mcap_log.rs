//! The crash-safe MCAP log as a sink: verdicts on `/gear/<stage>/rank`, gaps, and raw data where wanted.

use std::sync::Arc;

use super::{Drain, Events, SinkConfig, SinkContext, SinkError, kind};
use crate::event::Event;
use crate::kinds::Kind;
use crate::log::{self, Disk, LogConfig, LogHandle, RawPolicy, Record};

pub(super) const KIND: Kind<dyn SinkConfig> = kind::<LogConfig>(
    "mcap_log",
    "MCAP files that survive kill -9, power cuts and full disks; the truth about what was seen",
    r#"
folder = "/var/lib/gearwatch"
rotate_secs = 3600
raw = { keep = "around_deviations", level = 3, before_secs = 10.0, after_secs = 10.0, buffer_bytes = 67108864 }
"#,
);

impl SinkConfig for LogConfig {
    fn problems(&self) -> Vec<String> {
        self.check().err().map(|e| e.to_string()).into_iter().collect()
    }

    fn wants_raw(&self) -> bool {
        self.raw != RawPolicy::Off
    }

    fn open(&self, context: &SinkContext) -> Result<Drain, SinkError> {
        let folder = context.folder.join(&self.folder);
        let place = folder.display().to_string();
        let failed = |e: std::io::Error| SinkError::Io { place: place.clone(), source: e };
        let disk = Disk::open(&folder).map_err(failed)?;
        let config = Self { folder, ..self.clone() };
        let handle = log::spawn(config, context.log_context.clone(), Box::new(disk))
            .map_err(|e| failed(std::io::Error::other(e)))?;
        let context = context.clone();
        Ok(Drain::Thread(Box::new(move |events| write(&events, &handle, &context, place))))
    }
}

fn write(events: &Events, handle: &LogHandle, context: &SinkContext, place: String) -> Result<(), SinkError> {
    let state = handle.state();
    while let Ok(event) = events.recv_blocking() {
        // Never waits; what the log has no room for it counts itself, and writes a gap record.
        handle.send(match &*event {
            Event::Verdict { verdict, .. } => Record::Verdict(Arc::clone(verdict)),
            Event::Gap(gap) => Record::Gap(gap.clone()),
            Event::Raw(packet) => Record::Raw(Arc::clone(packet)),
        });
        if events.is_empty() {
            context.say(serde_json::to_string(&*state.borrow()).unwrap_or_default());
        }
    }
    let durable = handle.stop();
    context.say(serde_json::to_string(&*state.borrow()).unwrap_or_default());
    if durable {
        return Ok(());
    }
    Err(SinkError::Io { place, source: std::io::Error::other("the end of the log is not durable") })
}
