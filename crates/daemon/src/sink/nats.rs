//! Publishes to NATS JetStream: every letter is confirmed by the stream, and a repetition is
//! recognised there by its `Nats-Msg-Id`.

use std::path::{Path, PathBuf};

use gearwatch_runtime::kinds::Kind;
use gearwatch_runtime::secret::{carries_secret, place};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Drain, SinkConfig, SinkContext, SinkError, broker, kind};
use crate::fleet;

#[cfg(feature = "brokers")]
mod carry;

pub(super) const KIND: Kind<dyn SinkConfig> = kind::<Nats>(
    "nats",
    "verdicts, alarms and states to NATS JetStream, spooled on disk while the server is away",
    r#"
servers = ["nats://127.0.0.1:4222"]
stream = "gearwatch"
prefix = "gearwatch"
spool = "/var/lib/gearwatch/spool-nats"
"#,
);

/// Keys of the NATS sink.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct Nats {
    /// Addresses, tried in turn: `nats://host:4222`, or `tls://host:4222`.
    servers: Vec<String>,
    /// Stream that keeps the letters; made if there is none.
    stream: String,
    /// First part of all subjects.
    prefix: String,
    /// Age at which a stream that is made here forgets letters (h).
    keep_hours: f64,
    /// Folder of the letters that wait; one sink owns it.
    spool: PathBuf,
    /// Letters that wait take at most so much (bytes); beyond it the oldest go, and are counted.
    spool_bytes: u64,
    /// A bench says so often that it is there, also when nothing changes (s).
    heartbeat_secs: f64,
    /// User name; none where left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    user: Option<String>,
    /// File whose first line is the password, or without a user the token.
    #[serde(skip_serializing_if = "Option::is_none")]
    secret_file: Option<PathBuf>,
    /// Certificate of the authority that signed the server's, where the system does not know it
    /// (PEM).
    #[serde(skip_serializing_if = "Option::is_none")]
    ca_file: Option<PathBuf>,
}

impl Default for Nats {
    fn default() -> Self {
        Self {
            servers: vec!["nats://127.0.0.1:4222".to_owned()],
            stream: fleet::STREAM.to_owned(),
            prefix: fleet::PREFIX.to_owned(),
            keep_hours: 720.0,
            spool: PathBuf::from(broker::SPOOL_FOLDER).join("nats"),
            spool_bytes: broker::SPOOL_BYTES,
            heartbeat_secs: fleet::HEARTBEAT.as_secs_f64(),
            user: None,
            secret_file: None,
            ca_file: None,
        }
    }
}

impl Nats {
    fn common(&self) -> broker::Common<'_> {
        broker::Common {
            spool: &self.spool,
            spool_bytes: self.spool_bytes,
            heartbeat_secs: self.heartbeat_secs,
            secret_file: self.secret_file.as_deref(),
            ca_file: self.ca_file.as_deref(),
        }
    }
}

impl SinkConfig for Nats {
    fn problems(&self) -> Vec<String> {
        let mut out = self.common().problems("a NATS client");
        if self.servers.is_empty() {
            out.push("servers is empty; expected at least one address".to_owned());
        }
        for server in self.servers.iter().filter(|server| carries_secret(server)) {
            out.push(format!(
                "servers: {} is given with a user or password; put the user into `user` and the password into a file that `secret_file` names",
                place(server)
            ));
        }
        #[cfg(feature = "brokers")]
        out.extend(
            self.servers
                .iter()
                .filter(|server| !carries_secret(server))
                .filter_map(|server| carry::address_problem(server)),
        );
        out.extend(fleet::name_problems(&self.stream, &self.prefix));
        if !(0.1..=1e6).contains(&self.keep_hours) {
            out.push(format!("keep_hours is {}; expected 0.1 to 1000000", self.keep_hours));
        }
        if self.user.is_some() && self.secret_file.is_none() {
            out.push("user is given without secret_file".to_owned());
        }
        out
    }

    fn wants_states(&self) -> bool {
        true
    }

    fn try_out(&self, folder: &Path) -> Result<(), SinkError> {
        self.common().try_out(folder)
    }

    #[cfg(feature = "brokers")]
    fn open(&self, context: &SinkContext) -> Result<Drain, SinkError> {
        carry::open(self, context)
    }

    #[cfg(not(feature = "brokers"))]
    fn open(&self, _: &SinkContext) -> Result<Drain, SinkError> {
        Err(super::not_in_this_build("nats", "brokers"))
    }
}
