//! Schemas and channels of an MCAP file.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::bytes::Body;
use super::fields::op;
use super::walk::Limits;
use crate::problem::Problem;

/// A schema record.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Schema {
    /// Name of the message type.
    pub name: String,
    /// Encoding of `data`.
    pub encoding: String,
    /// Definition of the message type.
    pub data: Vec<u8>,
}

/// A channel record with its schema.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    /// Number in the file.
    pub id: u16,
    /// Topic.
    pub topic: String,
    /// Encoding of the messages.
    pub encoding: String,
    /// Absent for schemaless encodings.
    pub schema: Option<Arc<Schema>>,
}

/// Schemas and channels, which may come again, but only unchanged.
#[derive(Default)]
pub(super) struct Definitions {
    pub(super) schemas: BTreeMap<u16, Arc<Schema>>,
    pub(super) channels: BTreeMap<u16, Arc<Channel>>,
    pub(super) bytes: usize,
}

impl Definitions {
    pub(super) fn read(&mut self, opcode: u8, body: &mut Body<'_>, limits: &Limits) -> Result<(), Problem> {
        let size = body.left();
        let offset = body.offset;
        let (kind, id, changed) = if opcode == op::SCHEMA {
            let id = body.u16()?;
            let schema = Schema { name: body.string()?, encoding: body.string()?, data: body.bytes()?.to_vec() };
            if id == 0 {
                return Err(Problem::damaged(format_args!("byte {offset}"), "a schema number above 0", 0));
            }
            match self.schemas.get(&id) {
                None => {
                    self.bytes = self.bytes.saturating_add(size);
                    self.schemas.insert(id, Arc::new(schema));
                    ("schema", id, false)
                }
                Some(before) => ("schema", id, **before != schema),
            }
        } else {
            let id = body.u16()?;
            let schema_id = body.u16()?;
            let (topic, encoding) = (body.string()?, body.string()?);
            let schema = match schema_id {
                0 => None,
                _ => Some(self.schemas.get(&schema_id).cloned().ok_or_else(|| {
                    Problem::damaged(
                        format_args!("channel {id} at byte {offset}"),
                        "a schema that was announced before",
                        schema_id,
                    )
                })?),
            };
            let channel = Channel { id, topic, encoding, schema };
            match self.channels.get(&id) {
                None => {
                    self.bytes = self.bytes.saturating_add(size);
                    self.channels.insert(id, Arc::new(channel));
                    ("channel", id, false)
                }
                Some(before) => ("channel", id, **before != channel),
            }
        };
        if changed {
            return Err(Problem::damaged(
                format_args!("byte {offset}"),
                format_args!("{kind} {id} as it was announced before"),
                "another definition",
            ));
        }
        if self.bytes > limits.definition_bytes {
            return Err(Problem::limit(
                format_args!("byte {offset}"),
                "the size of all schemas and channels",
                format_args!("{} bytes", limits.definition_bytes),
            ));
        }
        Ok(())
    }
}
