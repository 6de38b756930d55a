//! Recordings of any format that can be read, at full speed or as they were recorded.

use std::path::{Path, PathBuf};

use gearwatch_core::source::Source as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use gearwatch_check::Look;
use gearwatch_runtime::kinds::Kind;

use crate::pace::{Pacer, Speed};
use crate::{Feed, SourceConfig, SourceContext, SourceError, kind};

pub(crate) const KIND: Kind<dyn SourceConfig> = kind::<File>(
    "file",
    "a recording of any format that can be read (`gearwatch list`), at full speed or as it was recorded",
    r#"
path = "run-up.mcap"
speed = 1.0                         # seconds of recording per second, or "max"
"#,
);

/// Keys of a file source.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct File {
    /// The recording.
    path: PathBuf,
    /// `"max"`, or seconds of recording per second.
    #[serde(default)]
    speed: Speed,
}

impl SourceConfig for File {
    fn problems(&self) -> Vec<String> {
        self.speed.problem().into_iter().collect()
    }

    /// A file waits, also when it is replayed at a given speed.
    fn is_live(&self) -> bool {
        false
    }

    fn look(&self, folder: &Path) -> Option<Look> {
        // What cannot be read is told by whoever reads it.
        crate::look(&folder.join(&self.path), &gearwatch_io::OpenOptions::default()).ok()
    }

    fn open(&self, context: &SourceContext) -> Result<Feed, SourceError> {
        let path = context.resolve(&self.path);
        let reader = |e| SourceError::Reader(Box::new(e));
        let mut opened = gearwatch_io::open(&path, &gearwatch_io::OpenOptions::default()).map_err(reader)?;
        let mut pacer = Pacer::new(self.speed, context.stop.clone());
        Ok(Feed::Pull(Box::new(move || {
            let Some(packet) = opened.next_packet().map_err(reader)? else {
                for warning in opened.warnings() {
                    tracing::warn!(file = %path.display(), "{warning}");
                }
                return Ok(None);
            };
            Ok(pacer.wait_for(&packet).then_some(packet))
        })))
    }
}
