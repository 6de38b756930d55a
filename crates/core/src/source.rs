//! Where packets come from, as seen by the hosts of the pipeline.

use crate::block::Packet;

/// A source of packets that is pulled: a file, the simulator, a test signal.
///
/// Sources that need sockets or devices live in `gearwatch-sources` and push into a bounded channel
/// instead; what they push is the same [`Packet`].
pub trait Source: Send {
    /// Error with file, place, what was expected and what was found in its message.
    type Error: std::error::Error + Send + Sync + 'static;

    /// The next packet in time order, or `None` at the end.
    ///
    /// # Errors
    /// When the source cannot go on. Packets handed over before stay valid.
    fn next_packet(&mut self) -> Result<Option<Packet>, Self::Error>;
}
