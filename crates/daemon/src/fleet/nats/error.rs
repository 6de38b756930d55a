//! Why a NATS server cannot be used, or a connection to it has ended.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use gearwatch_runtime::tls::TrustError;

use super::address::AddressError;
use super::wire::WireError;

/// Why there is no connection, or why it has ended. All that use a connection get the same error,
/// so that it can be cloned.
#[derive(Clone, Debug, thiserror::Error)]
pub enum NatsError {
    /// The address cannot be read.
    #[error(transparent)]
    Address(#[from] AddressError),
    /// The socket or its encryption failed.
    #[error(transparent)]
    Io(Arc<io::Error>),
    /// No certificate can be checked.
    #[error(transparent)]
    Trust(Arc<TrustError>),
    /// The server does not keep to the protocol.
    #[error(transparent)]
    Wire(#[from] WireError),
    /// The server's own word, with what it is.
    #[error("{0}")]
    Server(String),
    /// Nothing came at the start.
    #[error("the server did not answer within {0:?}")]
    Late(Duration),
    /// The first line is another one.
    #[error("it is no NATS server")]
    NotNats,
    /// Encryption was asked for.
    #[error("the server does not speak TLS")]
    NoTls,
    /// The host cannot stand in a certificate.
    #[error("{0:?} is no name that a certificate could be for")]
    Host(String),
    /// Messages come, and no answer to the greeting.
    #[error("the server talks, and does not answer")]
    Unanswered,
    /// The other half has ended.
    #[error("the connection is gone")]
    Gone,
    /// All that used it are gone.
    #[error("it is not needed any more")]
    Unneeded,
    /// Nothing came for this time.
    #[error("the server has said nothing for {0:?}")]
    Silent(Duration),
    /// More came than is kept.
    #[error("the server said {count} things that nobody asked for within {within:?}")]
    Unasked {
        /// How many.
        count: usize,
        /// In what time.
        within: Duration,
    },
    /// A request is lost.
    #[error("no answer about {0}")]
    Unheard(String),
    /// Nothing can be sent.
    #[error("the connection takes nothing")]
    Blocked,
    /// The subject has no subscriber.
    #[error("nobody answers at {0}: is JetStream switched on?")]
    Nobody(String),
    /// JetStream refuses a request.
    #[error("stream {stream:?}: {why}")]
    Refused {
        /// Its name.
        stream: String,
        /// The server's reason.
        why: String,
    },
    /// JetStream refuses a message.
    #[error("not stored: {0}")]
    NotStored(String),
    /// A message was not confirmed in time.
    #[error("no confirmation")]
    Unconfirmed,
    /// A confirmation lacks what it is for.
    #[error("a confirmation without a number")]
    Unnumbered,
    /// Nothing can be asked for.
    #[error("the server made a reader without a name")]
    Nameless,
    /// There is one reader a connection.
    #[error("messages are read already")]
    Read,
    /// Neither messages nor heartbeats come.
    #[error("the stream says nothing")]
    StreamSilent,
    /// A status that ends the reading.
    #[error("the stream says {code} {description}")]
    Status {
        /// As of HTTP.
        code: u16,
        /// In words.
        description: String,
    },
    /// The subject for the acknowledgement has another form.
    #[error("a message does not say where it stands in the stream")]
    NoPlace,
    /// A message is missing or comes again.
    #[error("message {found} came where {expected} was to come")]
    Order {
        /// Its number.
        found: u64,
        /// The one that follows.
        expected: u64,
    },
}

impl From<io::Error> for NatsError {
    fn from(error: io::Error) -> Self {
        Self::Io(Arc::new(error))
    }
}

impl From<TrustError> for NatsError {
    fn from(error: TrustError) -> Self {
        Self::Trust(Arc::new(error))
    }
}
