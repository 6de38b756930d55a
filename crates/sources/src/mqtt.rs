//! Speed, torque and temperature from the topics of an MQTT broker.

use std::path::PathBuf;

use gearwatch_runtime::kinds::{self, Kind};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::readings::{Linear, Quantity};
use crate::{Feed, SourceConfig, SourceContext, SourceError, kind};

#[cfg(feature = "brokers")]
mod listen;

pub(crate) const KIND: Kind<dyn SourceConfig> = kind::<Mqtt>(
    "mqtt",
    "the operating point (speed, torque, temperature) from topics of an MQTT broker",
    r#"
broker = "192.168.1.2:1883"
topics = [
  { quantity = "motor_speed_hz", topic = "bench3/drive/speed_rpm", scale = 0.0166667 },
  { quantity = "brake_torque_nm", topic = "bench3/brake", pointer = "/torque" },    # {"torque": 40.2}
]
"#,
);

/// Keys of an MQTT source.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Mqtt {
    /// Host and port of the broker.
    broker: String,
    /// Name under which the broker knows this client; made from the bench's name where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    client_id: Option<String>,
    /// The broker is spoken to over TLS, and must prove its name.
    #[serde(default)]
    tls: bool,
    /// Certificate of the authority that signed the broker's, where the system does not know it
    /// (PEM).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    ca_file: Option<PathBuf>,
    /// User at the broker.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    username: Option<String>,
    /// File that holds the user's password, and nothing else.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    password_file: Option<PathBuf>,
    /// A value is unknown when no newer one came for so long (s, > 0); the data deadline where left
    /// out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    stale_after_secs: Option<f64>,
    /// Values that the broker has kept, of unknown age, are used too.
    #[serde(default)]
    accept_retained: bool,
    /// What is read.
    topics: Vec<Topic>,
}

/// One quantity from one topic.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Topic {
    /// `motor_speed_hz`, `brake_torque_nm` or `temperature_c`.
    quantity: Quantity,
    /// Topic without wildcards; its messages are numbers as text, or JSON.
    topic: String,
    /// Where the number stands in a JSON object (RFC 6901), such as `/torque`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pointer: Option<String>,
    /// Hz, N m or °C per unit of the message (not 0).
    #[serde(default = "one")]
    scale: f64,
    /// Hz, N m or °C where the message is 0.
    #[serde(default)]
    offset: f64,
}

fn one() -> f64 {
    1.0
}

impl Topic {
    fn linear(&self) -> Linear {
        Linear { scale: self.scale, offset: self.offset }
    }
}

impl SourceConfig for Mqtt {
    fn problems(&self) -> Vec<String> {
        let mut out = Vec::new();
        out.extend(kinds::left_out("an MQTT client", "brokers", cfg!(feature = "brokers")));
        if split(&self.broker).is_none() {
            out.push(format!("broker is {:?}; expected host:port, as 192.168.1.2:1883", self.broker));
        }
        if self.topics.is_empty() {
            out.push("topics is empty; expected at least one".to_owned());
        }
        if let Some(secs) = self.stale_after_secs
            && !(secs > 0.0 && secs <= 86_400.0)
        {
            out.push(format!("stale_after_secs is {secs}; expected a number above 0 and up to a day"));
        }
        if self.password_file.is_some() && self.username.is_none() {
            out.push("password_file goes with username".to_owned());
        }
        if self.ca_file.is_some() && !self.tls {
            out.push("ca_file goes with tls = true".to_owned());
        }
        for (i, topic) in self.topics.iter().enumerate() {
            out.extend(topic.linear().problem().map(|p| format!("topic {:?}: {p}", topic.topic)));
            if topic.topic.is_empty() || topic.topic.contains(['#', '+']) {
                out.push(format!("topic is {:?}; expected one without wildcards", topic.topic));
            }
            if self.topics.iter().take(i).any(|other| other.quantity == topic.quantity) {
                out.push(format!("topic {:?}: its quantity stands above already", topic.topic));
            }
        }
        out
    }

    fn is_live(&self) -> bool {
        true
    }

    #[cfg(feature = "brokers")]
    fn open(&self, context: &SourceContext) -> Result<Feed, SourceError> {
        listen::open(self, context)
    }

    #[cfg(not(feature = "brokers"))]
    fn open(&self, _: &SourceContext) -> Result<Feed, SourceError> {
        Err(crate::not_in_this_build("mqtt", "brokers"))
    }
}

fn split(broker: &str) -> Option<(&str, u16)> {
    let (host, port) = broker.rsplit_once(':')?;
    Some((host, port.parse().ok()?)).filter(|(host, _)| !host.is_empty())
}
