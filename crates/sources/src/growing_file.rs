//! A file that another program is still writing: read to its end, then wait for more.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use gearwatch_runtime::kinds::Kind;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::framing::{Deframer, Framing};
use crate::pipe::pull_bytes;
use crate::{Feed, SourceConfig, SourceContext, SourceError, kind};

pub(crate) const KIND: Kind<dyn SourceConfig> = kind::<GrowingFile>(
    "growing_file",
    "text lines or interleaved binary numbers from a file that another program is still writing",
    r#"
path = "acquisition.csv"
framing = { encoding = "lines", channels = ["acc_1"], sample_rate_hz = 16384.0, unit = "g" }
end_after_idle_secs = 60.0          # leave out to wait for ever
"#,
);

/// Keys of a growing file.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct GrowingFile {
    /// The file.
    path: PathBuf,
    /// What the bytes mean.
    framing: Framing,
    /// The file is finished when it has not grown for so long (s, > 0); never where left out.
    #[serde(default)]
    end_after_idle_secs: Option<f64>,
}

/// How often the file is looked at.
const POLL: Duration = Duration::from_millis(50);

impl SourceConfig for GrowingFile {
    fn problems(&self) -> Vec<String> {
        let mut out = self.framing.problems();
        if let Some(secs) = self.end_after_idle_secs
            && !(secs.is_finite() && secs > 0.0)
        {
            out.push(format!("end_after_idle_secs is {secs}; expected a number above 0"));
        }
        out
    }

    /// The file keeps what is not read yet, so that nothing need be shed.
    fn is_live(&self) -> bool {
        false
    }

    fn open(&self, context: &SourceContext) -> Result<Feed, SourceError> {
        let path = context.resolve(&self.path);
        let fail = |source| SourceError::Io { path: path.clone(), source };
        let file = gearwatch_io::text::open_regular(&path).map_err(fail)?;
        let watched = file.try_clone().map_err(fail)?;
        let stop = context.stop.clone();
        let idle = self.end_after_idle_secs.map(|s| Duration::try_from_secs_f64(s).unwrap_or(Duration::MAX));
        let mut last = (0, Instant::now());
        let wait = move || {
            let length = watched.metadata().map_or(0, |m| m.len());
            if length != last.0 {
                last = (length, Instant::now());
            }
            idle.is_none_or(|idle| last.1.elapsed() < idle) && stop.sleep(POLL)
        };
        let deframer = Deframer::new(self.framing.clone(), &path);
        Ok(Feed::Pull(pull_bytes(Box::new(file), deframer, path, wait)))
    }
}
