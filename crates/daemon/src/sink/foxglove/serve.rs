//! The server, from the official SDK.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::Arc;

use foxglove::{ChannelBuilder, Context, FoxgloveError, PartialMetadata, RawChannel, Schema, WebSocketServer};
use gearwatch_log::{Message, encode};

use crate::sink::mcap_log::record;
use crate::sink::{Events, SinkError, Standing, Voice};
use gearwatch_runtime::clock::now_unix_ns;

/// Messages that a slow viewer may lag behind; it then misses some, and nobody waits for it.
const LAG: usize = 1024;

/// Shows what comes until there is no more.
pub(super) async fn serve(address: SocketAddr, events: Events, voice: Voice) -> Result<(), SinkError> {
    let failed =
        |e: FoxgloveError| SinkError::Io { place: address.to_string(), source: std::io::Error::other(e.to_string()) };
    let topics = Context::new();
    let server = WebSocketServer::new()
        .name("gearwatch")
        .context(&topics)
        .capabilities([])
        .message_backlog_size(LAG)
        .tokio_runtime(&tokio::runtime::Handle::current())
        .bind(address.ip().to_string(), address.port())
        .start()
        .await
        .map_err(failed)?;
    let server = Arc::new(server);
    let seen = Arc::downgrade(&server);
    voice.answer_with(move || {
        let viewers = seen.upgrade().map_or(0, |server| server.client_count());
        let detail = format!("{viewers} viewers at ws://{address}");
        Standing { detail, figures: vec![("viewers", viewers as f64)], ..Standing::default() }
    });
    let mut channels = BTreeMap::new();
    while let Ok(event) = events.recv().await {
        let Some(message) = record(&event).and_then(|record| encode(0, &record, now_unix_ns())) else { continue };
        let time = PartialMetadata { log_time: Some(message.log_time) };
        let Message { topic, data, schema, .. } = message;
        let channel: &mut Arc<RawChannel> = match channels.entry(topic) {
            std::collections::btree_map::Entry::Occupied(known) => known.into_mut(),
            std::collections::btree_map::Entry::Vacant(place) => {
                let channel = ChannelBuilder::new(place.key())
                    .context(&topics)
                    .message_encoding(schema.message_encoding())
                    .schema(Schema::new(&schema.name, schema.encoding, schema.data.clone()))
                    .build_raw()
                    .map_err(failed)?;
                place.insert(channel)
            }
        };
        channel.log_with_meta(&data, time);
    }
    if let Ok(server) = Arc::try_unwrap(server) {
        server.stop().wait().await;
    }
    Ok(())
}
