//! Speed, torque and temperature from the nodes of an OPC UA server: a controller, a drive, a
//! bench's automation.

use std::path::PathBuf;

use gearwatch_runtime::kinds::{self, Kind};
use gearwatch_runtime::secret::place;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::readings::{Linear, Quantity};
use crate::{Feed, SourceConfig, SourceContext, SourceError, kind};

#[cfg(feature = "opcua")]
mod capped;
#[cfg(feature = "opcua")]
mod connect;
#[cfg(feature = "opcua")]
mod error;
#[cfg(feature = "opcua")]
mod listen;
#[cfg(feature = "opcua")]
mod trust;
#[cfg(feature = "opcua")]
mod value;

pub(crate) const KIND: Kind<dyn SourceConfig> = kind::<OpcUa>(
    "opcua",
    "the operating point (speed, torque, temperature) from nodes of an OPC UA server, by subscription",
    r#"
endpoint = "opc.tcp://192.168.1.10:4840"
nodes = [
  { quantity = "motor_speed_hz", node = "ns=2;s=Drive.Speed", scale = 0.0166667 },   # 1/min
  { quantity = "brake_torque_nm", node = "ns=2;s=Brake.Torque" },
]
"#,
);

/// The port of OPC UA where an endpoint names none.
const USUAL_PORT: u16 = 4840;

/// Keys of an OPC UA source.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct OpcUa {
    /// Address of the server: `opc.tcp://host:port/path`; the usual port is 4840.
    endpoint: String,
    /// `none`, `sign` or `sign_and_encrypt`: what is done to messages. The last two need the three
    /// files below.
    #[serde(default)]
    security: Security,
    /// Certificate of the server (DER or PEM). No other is accepted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    server_certificate: Option<PathBuf>,
    /// Certificate of this client (DER or PEM), which the server must trust.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    certificate: Option<PathBuf>,
    /// RSA key of this client's certificate (PEM, PKCS#8, without a password).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    private_key: Option<PathBuf>,
    /// Name of this client at the server; the first alternative name of its certificate.
    #[serde(default = "application_uri")]
    application_uri: String,
    /// User at the server; the login is anonymous where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    username: Option<String>,
    /// File that holds the user's password, and nothing else.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    password_file: Option<PathBuf>,
    /// How often the server samples the nodes and sends what has changed, or that nothing has
    /// (s, > 0); at most a third of the data deadline.
    #[serde(default = "publish_secs")]
    publish_secs: f64,
    /// What is read.
    nodes: Vec<Node>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Security {
    #[default]
    None,
    Sign,
    SignAndEncrypt,
}

/// One quantity from one node.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Node {
    /// `motor_speed_hz`, `brake_torque_nm` or `temperature_c`.
    quantity: Quantity,
    /// Its id: `ns=2;s=Brake.Torque`, `ns=3;i=1001`, or with `g=` or `b=`.
    node: String,
    /// Hz, N m or °C per unit of the value (not 0).
    #[serde(default = "one")]
    scale: f64,
    /// Hz, N m or °C where the value is 0.
    #[serde(default)]
    offset: f64,
}

fn application_uri() -> String {
    "urn:gearwatch".to_owned()
}

fn publish_secs() -> f64 {
    0.5
}

fn one() -> f64 {
    1.0
}

impl Node {
    fn linear(&self) -> Linear {
        Linear { scale: self.scale, offset: self.offset }
    }
}

impl OpcUa {
    /// What is wrong with the files of keys.
    fn problems_of_trust(&self, out: &mut Vec<String>) {
        let files = [
            ("server_certificate", &self.server_certificate),
            ("certificate", &self.certificate),
            ("private_key", &self.private_key),
        ];
        for (name, file) in files {
            match (self.security, file) {
                (Security::None, Some(_)) => {
                    out.push(format!("{name} goes with security = \"sign_and_encrypt\" or \"sign\""));
                }
                (Security::Sign | Security::SignAndEncrypt, None) => {
                    out.push(format!("{name} is missing; security other than \"none\" needs it"));
                }
                _ => {}
            }
        }
        if self.password_file.is_some() && self.username.is_none() {
            out.push("password_file goes with username".to_owned());
        }
    }
}

impl SourceConfig for OpcUa {
    fn problems(&self) -> Vec<String> {
        let mut out = Vec::new();
        out.extend(kinds::left_out("an OPC UA client", "opcua", cfg!(feature = "opcua")));
        if self.endpoint.contains('@') {
            let shown = place(&self.endpoint);
            out.push(format!("endpoint {shown} holds a user; expected it in username and password_file"));
        } else if address(&self.endpoint).is_none() {
            out.push(format!(
                "endpoint is {:?}; expected opc.tcp://host:port, as opc.tcp://192.168.1.10:4840",
                self.endpoint
            ));
        }
        if !(self.publish_secs > 0.0 && self.publish_secs <= 3600.0) {
            out.push(format!("publish_secs is {}; expected a number above 0 and up to 3600", self.publish_secs));
        }
        self.problems_of_trust(&mut out);
        if self.nodes.is_empty() {
            out.push("nodes is empty; expected at least one".to_owned());
        }
        for (i, node) in self.nodes.iter().enumerate() {
            out.extend(node.linear().problem().map(|p| format!("node {:?}: {p}", node.node)));
            if !is_node_id(&node.node) {
                out.push(format!("node is {:?}; expected an id as ns=2;s=Brake.Torque or ns=3;i=1001", node.node));
            }
            if self.nodes.iter().take(i).any(|other| other.quantity == node.quantity) {
                out.push(format!("node {:?}: its quantity stands above already", node.node));
            }
        }
        out
    }

    fn is_live(&self) -> bool {
        true
    }

    #[cfg(feature = "opcua")]
    fn open(&self, context: &SourceContext) -> Result<Feed, SourceError> {
        listen::open(self, context)
    }

    #[cfg(not(feature = "opcua"))]
    fn open(&self, _: &SourceContext) -> Result<Feed, SourceError> {
        Err(crate::not_in_this_build("opcua", "opcua"))
    }
}

/// Host and port of an endpoint, as a socket is opened to them.
fn address(endpoint: &str) -> Option<String> {
    let authority = endpoint.strip_prefix("opc.tcp://")?.split('/').next()?;
    // An IPv6 address stands in brackets, and has colons of its own.
    let end = authority.rfind(']').map_or_else(|| authority.find(':').unwrap_or(authority.len()), |at| at + 1);
    let (host, port) = authority.split_at_checked(end)?;
    let port = match port {
        "" => USUAL_PORT,
        port => port.strip_prefix(':')?.parse().ok()?,
    };
    let usable = !host.is_empty() && !host.contains(|c: char| c.is_whitespace() || c.is_control() || "@?#".contains(c));
    usable.then(|| format!("{host}:{port}"))
}

/// `ns=2;s=Name`, `ns=3;i=7`, `i=2258`: the parts are there, whatever the server makes of them
/// (OPC 10000-6, 5.3.1.10).
fn is_node_id(text: &str) -> bool {
    let id = match text.strip_prefix("ns=").map(|rest| rest.split_once(';')) {
        Some(Some((space, id))) if space.parse::<u16>().is_ok() => id,
        Some(_) => return false,
        None => text,
    };
    match id.split_once('=') {
        Some(("i", number)) => number.parse::<u32>().is_ok(),
        Some(("s", name)) => !name.is_empty() && !name.contains(char::is_control),
        Some(("g", guid)) => is_guid(guid),
        Some(("b", opaque)) => is_base64(opaque),
        _ => false,
    }
}

/// `09087e75-8e5e-499b-954f-f2a9603db28a`.
fn is_guid(text: &str) -> bool {
    let digits = |part: &str| part.bytes().all(|b| b.is_ascii_hexdigit()).then_some(part.len());
    text.split('-').map(digits).eq([8, 4, 4, 4, 12].map(Some))
}

/// Fours of letters, at the end filled up with `=`.
fn is_base64(text: &str) -> bool {
    let letters = text.trim_end_matches('=');
    let filled = text.len() - letters.len();
    !letters.is_empty()
        && text.len().is_multiple_of(4)
        && filled <= 2
        && letters.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'+' || b == b'/')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conform_node_ids_have_a_name_space_and_a_name() {
        for right in [
            "ns=2;s=Brake.Torque",
            "ns=3;i=1001",
            "i=2258",
            "s=a;b=c",
            "ns=1;g=09087e75-8e5e-499b-954f-f2a9603db28a",
            "ns=1;b=M/RbKBsRVkePCePcx24oRA==",
        ] {
            assert!(is_node_id(right), "{right}");
            #[cfg(feature = "opcua")]
            assert!(right.parse::<opcua_types::NodeId>().is_ok(), "{right}");
        }
        for wrong in [
            "Brake.Torque",
            "ns=x;i=1",
            "ns=2;i=one",
            "ns=2",
            "ns=2;s=",
            "ns=70000;i=1",
            "",
            "ns=1;s=a\nb",
            "g=09087e75-8e5e-499b-954f",
            "g=09087e75-8e5e-499b-954f-f2a9603db28g",
            "b=M/RbK",
            "b====",
        ] {
            assert!(!is_node_id(wrong), "{wrong}");
        }
    }

    #[test]
    fn conform_an_endpoint_has_a_host_and_perhaps_a_port() {
        for (endpoint, expected) in [
            ("opc.tcp://192.168.1.10:4841/bench", Some("192.168.1.10:4841")),
            ("opc.tcp://plc", Some("plc:4840")),
            ("opc.tcp://[fe80::1]/a:b", Some("[fe80::1]:4840")),
            ("opc.tcp://[::1]:1", Some("[::1]:1")),
            ("opc.tcp://plc:port", None),
            ("opc.tcp://:4840", None),
            ("opc.tcp://plc:99999", None),
            ("http://plc:4840", None),
            ("plc:4840", None),
        ] {
            assert_eq!(address(endpoint).as_deref(), expected, "{endpoint}");
        }
    }
}
