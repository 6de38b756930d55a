//! A live view for Foxglove, and for whatever else speaks its WebSocket protocol: the topics of the
//! log while they come. Compiled in with the cargo feature `foxglove`.
//!
//! Viewers look and nothing else: the server offers no service, no parameter, and takes nothing
//! from them. It knows no token, and answers on loopback addresses only.

use std::net::SocketAddr;

use gearwatch_runtime::kinds::{self, Kind};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Drain, SinkConfig, SinkContext, SinkError, kind};

#[cfg(feature = "foxglove")]
mod serve;

pub(super) const KIND: Kind<dyn SinkConfig> = kind::<Foxglove>(
    "foxglove",
    "a live view of ranks, gaps and raw data for Foxglove (ws://, loopback only)",
    r#"
address = "127.0.0.1:8765"
raw = true                          # the samples too
"#,
);

/// Keys of the Foxglove sink.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct Foxglove {
    /// Where viewers connect: a loopback address.
    address: SocketAddr,
    /// Samples are shown too.
    raw: bool,
}

impl Default for Foxglove {
    fn default() -> Self {
        Self { address: SocketAddr::from(([127, 0, 0, 1], 8765)), raw: false }
    }
}

impl SinkConfig for Foxglove {
    fn problems(&self) -> Vec<String> {
        let mut out = Vec::new();
        out.extend(kinds::left_out("the Foxglove server", "foxglove", cfg!(feature = "foxglove")));
        if !self.address.ip().is_loopback() {
            out.push(format!(
                "address is {}, which other machines can reach; expected a loopback address such as 127.0.0.1:8765",
                self.address
            ));
        }
        out
    }

    fn wants_raw(&self) -> bool {
        self.raw
    }

    #[cfg(feature = "foxglove")]
    fn open(&self, context: &SinkContext) -> Result<Drain, SinkError> {
        let (address, voice) = (self.address, context.voice.clone());
        Ok(Drain::Task(Box::new(move |events| Box::pin(serve::serve(address, events, voice)))))
    }

    #[cfg(not(feature = "foxglove"))]
    fn open(&self, _: &SinkContext) -> Result<Drain, SinkError> {
        Err(super::not_in_this_build("foxglove", "foxglove"))
    }
}
