//! Publishes to an MQTT 3.1.1 broker with QoS 1: every letter is confirmed by the broker.
//!
//! The state of a bench is retained, so that who subscribes knows at once how it is; a last will
//! says when the service is gone.

use std::path::{Path, PathBuf};

use gearwatch_runtime::kinds::Kind;
use gearwatch_runtime::secret::{carries_secret, place};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Drain, SinkConfig, SinkContext, SinkError, broker, kind};
use crate::fleet;

#[cfg(feature = "brokers")]
mod carry;

pub(super) const KIND: Kind<dyn SinkConfig> = kind::<Mqtt>(
    "mqtt",
    "verdicts, alarms and states to an MQTT 3.1.1 broker (QoS 1), spooled on disk while it is away",
    r#"
host = "127.0.0.1"
port = 1883
prefix = "gearwatch"
spool = "/var/lib/gearwatch/spool-mqtt"
"#,
);

/// Keys of the MQTT sink.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct Mqtt {
    /// Name or address of the broker.
    host: String,
    /// Its port.
    port: u16,
    /// First part of all topics.
    prefix: String,
    /// Names this service to the broker, which keeps one connection a name; made up where left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    client_id: Option<String>,
    /// Folder of the letters that wait; one sink owns it.
    spool: PathBuf,
    /// Letters that wait take at most so much (bytes); beyond it the oldest go, and are counted.
    spool_bytes: u64,
    /// A bench says so often that it is there, also when nothing changes (s).
    heartbeat_secs: f64,
    /// The broker is gone when it does not answer for about twice as long (s, 5–600).
    keep_alive_secs: u16,
    /// The broker is spoken to over TLS, and must prove its name.
    tls: bool,
    /// Certificate of the authority that signed the broker's, where the system does not know it
    /// (PEM).
    #[serde(skip_serializing_if = "Option::is_none")]
    ca_file: Option<PathBuf>,
    /// User name; none where left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    user: Option<String>,
    /// File whose first line is the password.
    #[serde(skip_serializing_if = "Option::is_none")]
    secret_file: Option<PathBuf>,
}

impl Default for Mqtt {
    fn default() -> Self {
        Self {
            host: "127.0.0.1".to_owned(),
            port: 1883,
            prefix: fleet::PREFIX.to_owned(),
            client_id: None,
            spool: PathBuf::from(broker::SPOOL_FOLDER).join("mqtt"),
            spool_bytes: broker::SPOOL_BYTES,
            heartbeat_secs: fleet::HEARTBEAT.as_secs_f64(),
            keep_alive_secs: 10,
            tls: false,
            ca_file: None,
            user: None,
            secret_file: None,
        }
    }
}

impl Mqtt {
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

impl SinkConfig for Mqtt {
    fn problems(&self) -> Vec<String> {
        let mut out = self.common().problems("an MQTT client");
        if carries_secret(&self.host) {
            out.push(format!(
                "host is {} with a user or password; put them into `user` and a file that `secret_file` names",
                place(&self.host)
            ));
        }
        if self.host.is_empty() {
            out.push("host is empty".to_owned());
        }
        out.extend(fleet::name_problems("-", &self.prefix));
        if !(5..=600).contains(&self.keep_alive_secs) {
            out.push(format!("keep_alive_secs is {}; expected 5 to 600", self.keep_alive_secs));
        }
        if self.user.is_some() != self.secret_file.is_some() {
            out.push("user and secret_file belong together".to_owned());
        }
        if self.ca_file.is_some() && !self.tls {
            out.push("ca_file goes with tls = true".to_owned());
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
        Err(super::not_in_this_build("mqtt", "brokers"))
    }
}
