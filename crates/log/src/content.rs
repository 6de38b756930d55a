//! The messages of a log file, for readers inside this program.

use std::collections::BTreeMap;

use crate::format::{Channel, FileSchema};
use crate::walk::{AttachmentView, Found, Inner, MessageView, Rules, Walk};

/// What is handed over, in the order of the file.
pub(crate) enum Part<'a> {
    Attachment(AttachmentView<'a>),
    Metadata(String, BTreeMap<String, String>),
    Message {
        channel: &'a Channel,
        schema: Option<&'a FileSchema>,
        message: MessageView<'a>,
    },
    /// A message of a channel that no good record describes.
    Orphan,
    /// Begins a chunk.
    Chunk,
}

/// Hands over every part of the file that is good.
pub(crate) fn visit<E>(bytes: &[u8], rules: Rules, mut sink: impl FnMut(Part<'_>) -> Result<(), E>) -> Result<(), E> {
    let mut schemas: BTreeMap<u16, FileSchema> = BTreeMap::new();
    let mut channels: BTreeMap<u16, Channel> = BTreeMap::new();
    for (_, found) in Walk::new(bytes, rules) {
        match found {
            Found::Schema(schema) => drop(schemas.insert(schema.id, schema)),
            Found::Channel(channel) => drop(channels.insert(channel.id, channel)),
            Found::Attachment(view) => sink(Part::Attachment(view))?,
            Found::Metadata { name, map } => sink(Part::Metadata(name, map))?,
            Found::Message(message) => sink(part(&channels, &schemas, message))?,
            Found::Chunk(chunk) => {
                sink(Part::Chunk)?;
                for inner in chunk.inner() {
                    match inner {
                        Inner::Schema(schema) => drop(schemas.insert(schema.id, schema)),
                        Inner::Channel(channel) => drop(channels.insert(channel.id, channel)),
                        Inner::Message(_, message) => sink(part(&channels, &schemas, message))?,
                    }
                }
            }
            Found::Header { .. } | Found::MessageIndex | Found::DataEnd(_) | Found::Other | Found::Damage(_) => {}
        }
    }
    Ok(())
}

fn part<'a>(
    channels: &'a BTreeMap<u16, Channel>,
    schemas: &'a BTreeMap<u16, FileSchema>,
    message: MessageView<'a>,
) -> Part<'a> {
    match channels.get(&message.channel) {
        Some(channel) => Part::Message { channel, schema: schemas.get(&channel.schema_id), message },
        None => Part::Orphan,
    }
}
