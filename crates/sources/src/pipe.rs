//! Numbers from stdin, a named pipe or a device file.

use std::io::Read;
use std::path::PathBuf;

use gearwatch_runtime::kinds::Kind;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::framing::{Deframer, Framing};
use crate::{Feed, SourceConfig, SourceContext, SourceError, kind};

pub(crate) const KIND: Kind<dyn SourceConfig> = kind::<Pipe>(
    "pipe",
    "text lines or interleaved binary numbers from stdin, a named pipe or a device file",
    r#"
path = "-"                          # "-" is stdin
framing = { encoding = "f32le", channels = ["acc_1", "acc_2"], sample_rate_hz = 16384.0, unit = "m/s^2" }
"#,
);

/// Keys of a pipe source.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Pipe {
    /// `-` for stdin, or a path.
    path: PathBuf,
    /// What the bytes mean.
    framing: Framing,
}

/// Bytes asked for at once: one typical pipe buffer.
const READ_BYTES: usize = 64 * 1024;

impl SourceConfig for Pipe {
    fn problems(&self) -> Vec<String> {
        self.framing.problems()
    }

    /// A pipe has back-pressure of its own, so that nothing need be shed.
    fn is_live(&self) -> bool {
        false
    }

    fn open(&self, context: &SourceContext) -> Result<Feed, SourceError> {
        let path = context.resolve(&self.path);
        let input: Box<dyn Read + Send> = if self.path.as_os_str() == "-" {
            Box::new(std::io::stdin())
        } else {
            let fail = |source| SourceError::Io { path: path.clone(), source };
            let file = std::fs::File::open(&path).map_err(fail)?;
            if file.metadata().map_err(fail)?.is_dir() {
                return Err(fail(std::io::ErrorKind::IsADirectory.into()));
            }
            Box::new(file)
        };
        let deframer = Deframer::new(self.framing.clone(), &path);
        Ok(Feed::Pull(pull_bytes(input, deframer, path, || false)))
    }
}

/// Pulls packets from a reader. At the end of the bytes `wait` says whether to try again (it has
/// waited then) or to end.
pub(crate) fn pull_bytes(
    mut input: Box<dyn Read + Send>,
    mut deframer: Deframer,
    path: PathBuf,
    mut wait: impl FnMut() -> bool + Send + 'static,
) -> crate::Pull {
    let mut ready = std::collections::VecDeque::new();
    let mut buffer = vec![0; READ_BYTES];
    let mut ended = false;
    Box::new(move || {
        loop {
            if let Some(packet) = ready.pop_front() {
                return Ok(Some(packet));
            }
            if ended {
                return Ok(None);
            }
            match input.read(&mut buffer) {
                Ok(0) if wait() => {}
                Ok(0) => {
                    ended = true;
                    deframer.finish(&mut |packet| ready.push_back(packet))?;
                }
                Ok(n) => deframer.push(buffer.get(..n).unwrap_or_default(), &mut |packet| ready.push_back(packet))?,
                Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
                Err(source) => return Err(SourceError::Io { path: path.clone(), source }),
            }
        }
    })
}
