//! Speed, torque and temperature from an OPC UA server: a controller, a drive, a bench's automation.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::readings::{Linear, Quantity};
use super::{Feed, SourceConfig, SourceContext, SourceError, kind};
use crate::kinds::{self, Kind};

#[cfg(feature = "opcua")]
mod subscribe;

pub(super) const KIND: Kind<dyn SourceConfig> = kind::<OpcUa>(
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

/// Keys of an OPC UA source.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct OpcUa {
    /// Address of the server: `opc.tcp://host:port/path`.
    endpoint: String,
    /// User at the server; nobody in particular where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    username: Option<String>,
    /// File that holds the user's password, and nothing else.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    password_file: Option<PathBuf>,
    /// How often the server tells what has changed, or that nothing has (s, > 0); less than a third of the data deadline.
    #[serde(default = "publish_secs")]
    publish_secs: f64,
    /// What is read.
    nodes: Vec<Node>,
}

/// One quantity from one node.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Node {
    /// `motor_speed_hz`, `brake_torque_nm` or `temperature_c`.
    quantity: Quantity,
    /// Its id: `ns=2;s=Brake.Torque`, `ns=3;i=1001`.
    node: String,
    /// Hz, N m or °C per unit of the value (not 0).
    #[serde(default = "one")]
    scale: f64,
    /// Hz, N m or °C where the value is 0.
    #[serde(default)]
    offset: f64,
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

/// `ns=2;s=Name`, `ns=3;i=7`, `i=2258`: the parts are there, whatever the server makes of them.
fn is_node_id(text: &str) -> bool {
    let id = match text.strip_prefix("ns=").and_then(|rest| rest.split_once(';')) {
        Some((space, id)) if space.parse::<u16>().is_ok() => id,
        Some(_) => return false,
        None => text,
    };
    match id.split_once('=') {
        Some(("i", number)) => number.parse::<u32>().is_ok(),
        Some(("s" | "g" | "b", name)) => !name.is_empty(),
        _ => false,
    }
}

impl SourceConfig for OpcUa {
    fn problems(&self) -> Vec<String> {
        let mut out = Vec::new();
        out.extend(kinds::left_out("an OPC UA client", "opcua", cfg!(feature = "opcua")));
        if self.endpoint.strip_prefix("opc.tcp://").is_none_or(str::is_empty) {
            out.push(format!("endpoint is {:?}; expected opc.tcp://host:port", self.endpoint));
        }
        if !(self.publish_secs > 0.0 && self.publish_secs <= 3600.0) {
            out.push(format!("publish_secs is {}; expected a number above 0 and up to 3600", self.publish_secs));
        }
        if self.password_file.is_some() && self.username.is_none() {
            out.push("password_file goes with username".to_owned());
        }
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
        subscribe::open(self, context)
    }

    #[cfg(not(feature = "opcua"))]
    fn open(&self, _: &SourceContext) -> Result<Feed, SourceError> {
        Err(super::not_in_this_build("opcua", "opcua"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conform_node_ids_have_a_name_space_and_a_name() {
        for right in
            ["ns=2;s=Brake.Torque", "ns=3;i=1001", "i=2258", "s=a;b=c", "ns=1;g=09087e75-8e5e-499b-954f-f2a9603db28a"]
        {
            assert!(is_node_id(right), "{right}");
        }
        for wrong in ["Brake.Torque", "ns=x;i=1", "ns=2;i=one", "ns=2", "ns=2;s=", "ns=70000;i=1", ""] {
            assert!(!is_node_id(wrong), "{wrong}");
        }
    }
}
