//! What can be wrong with the bytes of a log.

/// Why bytes are no whole, good record.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Flaw {
    /// The first bytes are others.
    #[error("does not begin as an MCAP file")]
    Magic,
    /// A length leads beyond the end.
    #[error("a record is cut off, or its length is wrong")]
    Record,
    /// Of a record with this opcode.
    #[error("a record of kind {0} has impossible fields")]
    Fields(u8),
    /// A good record, where none of its kind is written.
    #[error("a record where this log writes none")]
    Misplaced,
    /// Shorter than its checksum.
    #[error("an attachment is cut off")]
    AttachmentEnd,
    /// The bytes are others than were written.
    #[error("the checksum of an attachment is wrong")]
    AttachmentChecksum,
    /// Lengths and texts do not fit.
    #[error("an attachment has impossible fields")]
    AttachmentFields,
    /// Lengths and texts do not fit.
    #[error("a chunk has impossible fields")]
    ChunkFields,
    /// More bytes than are unpacked.
    #[error("a chunk says that it unpacks to {size} bytes; at most {most} are accepted")]
    ChunkSize {
        /// As stated.
        size: u64,
        /// What is accepted.
        most: u64,
    },
    /// With the decompressor's reason.
    #[error("a chunk cannot be unpacked: {0}")]
    Unpacking(String),
    /// The bytes are others than were written.
    #[error("the checksum of a chunk is wrong")]
    ChunkChecksum,
    /// Within a chunk whose checksum is right or missing.
    #[error("a record in a chunk is cut off or has impossible fields")]
    Inner,
    /// Of a message with this channel.
    #[error("a message of channel {0}, which the chunk does not describe")]
    Channel(u16),
    /// The first message of a chunk of this log is its group record.
    #[error("a chunk without a group record")]
    NoGroup,
    /// Of a chunk with so many messages.
    #[error("a chunk of {0} messages without checksum, or whose group record says otherwise")]
    Group(u64),
    /// The chunk's head states others.
    #[error("a chunk's times are not those of its messages; the messages are good")]
    Times,
    /// Bytes behind the last record.
    #[error("an end that is cut off")]
    End,
}
