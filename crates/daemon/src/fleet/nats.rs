//! A connection to a NATS server, as much of the protocol as letters need
//! (<https://docs.nats.io/reference/reference-protocols/nats-protocol>).
//!
//! ```text
//! address.rs    where the server is
//! wire.rs       what it says, read within bounds
//! jetstream.rs  streams, confirmations and readers on top of it
//! error.rs      why there is no connection, or no more
//! ```
//!
//! The peer is not trusted: whatever it sends, and for how long, takes no more memory than one
//! message, the messages that wait for their reader ([`WAITING`]) and one answer for each request
//! under way. A connection is used once. It is not renewed, since that could send a later letter
//! before one that was lost; [`Connection::gone`] says why it ended.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use gearwatch_runtime::tls::Trust;
use tokio::io::{AsyncRead, AsyncWrite, AsyncWriteExt, ReadHalf, WriteHalf};
use tokio::net::TcpStream;
use tokio::sync::{mpsc, oneshot, watch};
use tokio::task::JoinSet;
use tokio_rustls::rustls::pki_types::ServerName;

use super::{Access, PATIENCE};

mod address;
mod error;
mod jetstream;
mod wire;

pub(crate) use address::Address;
pub use error::NatsError;
pub(crate) use jetstream::{Confirmation, JetStream, Start, Wanted};
use wire::{Message, Said, Wire};

/// Messages that wait for whoever reads a subscription; the connection is not read while there is
/// no room for more.
const WAITING: usize = 16;
/// Commands that wait to be sent; whoever sends waits while there is no room for more.
const COMMANDS: usize = 64;
/// Things the server may say between two pings of ours that nobody has asked for; each [`THING`] of
/// a message counts as one. A server that says more is left.
const MOST_UNASKED: usize = 1000;
/// Bytes.
const THING: usize = 4096;
/// Numbers of the subscriptions: answers to requests, and messages of a reader.
const ANSWERS: u64 = 1;
const MESSAGES: u64 = 2;

trait Stream: AsyncRead + AsyncWrite + Send + Sync + Unpin {}
impl<T: AsyncRead + AsyncWrite + Send + Sync + Unpin> Stream for T {}

/// Who waits for an answer, by the last part of its subject.
type Asked = Arc<Mutex<BTreeMap<u64, oneshot::Sender<Message>>>>;

/// A connection to a server. It ends when it is dropped.
pub(crate) struct Connection {
    commands: mpsc::Sender<Vec<u8>>,
    asked: Asked,
    next_question: std::sync::atomic::AtomicU64,
    /// First part of the subjects at which answers come.
    inbox: String,
    messages: Option<mpsc::Receiver<Message>>,
    gone: watch::Receiver<Option<NatsError>>,
    _tasks: JoinSet<()>,
}

impl Connection {
    /// Connects, proves who we are, and knows that the server has accepted it.
    ///
    /// # Errors
    /// When any of that fails or takes longer than the server has.
    pub(crate) async fn open(server: &str, access: &Access) -> Result<Self, NatsError> {
        let address = server.parse::<Address>()?;
        let opened = tokio::time::timeout(PATIENCE, Self::shake_hands(&address, access)).await;
        opened.map_err(|_| NatsError::Late(PATIENCE))?
    }

    async fn shake_hands(address: &Address, access: &Access) -> Result<Self, NatsError> {
        let socket = TcpStream::connect((address.host.as_str(), address.port)).await?;
        // Confirmations are small and waited for.
        socket.set_nodelay(true)?;
        let mut plain = Wire::new(socket);
        let Said::Info(info) = plain.next().await? else { return Err(NatsError::NotNats) };
        let secure = address.tls || access.ca_file.is_some() || info.tls_required;
        let stream: Box<dyn Stream> = if secure {
            if !info.speaks_tls() {
                return Err(NatsError::NoTls);
            }
            let trust = Trust::read(access.ca_file.as_deref())?;
            let name = ServerName::try_from(address.host.clone());
            let name = name.map_err(|_| NatsError::Host(address.host.clone()))?;
            Box::new(trust.connector()?.connect(name, plain.into_inner()?).await?)
        } else {
            Box::new(plain.into_inner()?)
        };
        let (read, mut write) = tokio::io::split(stream);
        let mut wire = Wire::new(read);
        let greeting = format!("CONNECT {}\r\nPING\r\n", introduction(access, secure));
        write.write_all(greeting.as_bytes()).await?;
        write.flush().await?;
        for _ in 0..MOST_UNASKED {
            match wire.next().await? {
                Said::Pong => return Self::start(wire, write).await,
                Said::Error(error) => return Err(NatsError::Server(error)),
                Said::Ping => write.write_all(b"PONG\r\n").await?,
                Said::Info(_) | Said::Ok | Said::Message(_) => {}
            }
        }
        Err(NatsError::Unanswered)
    }

    async fn start(
        wire: Wire<ReadHalf<Box<dyn Stream>>>,
        write: WriteHalf<Box<dyn Stream>>,
    ) -> Result<Self, NatsError> {
        let (commands, waiting) = mpsc::channel(COMMANDS);
        let (message, messages) = mpsc::channel(WAITING);
        let (ended, gone) = watch::channel(None);
        let asked = Asked::default();
        let inbox = format!("_INBOX.{}", unique());
        let mut tasks = JoinSet::new();
        let (told, tell) = (ended.clone(), ended);
        tasks.spawn(async move {
            let error = speak(write, waiting).await;
            told.send_if_modified(|reason| reason.replace(error).is_none());
        });
        let listener = Listener { wire, commands: commands.clone(), asked: asked.clone(), message };
        tasks.spawn(async move {
            let error = listener.listen().await;
            tell.send_if_modified(|reason| reason.replace(error).is_none());
        });
        let subscribe = format!("SUB {inbox}.a.* {ANSWERS}\r\nSUB {inbox}.m {MESSAGES}\r\n").into_bytes();
        commands.send(subscribe).await.map_err(|_| NatsError::Gone)?;
        Ok(Self {
            commands,
            asked,
            next_question: std::sync::atomic::AtomicU64::new(0),
            inbox,
            messages: Some(messages),
            gone,
            _tasks: tasks,
        })
    }

    /// For those who only ask: a message that nobody reads must not keep answers from coming.
    fn without_messages(mut self) -> Self {
        self.messages = None;
        self
    }

    /// Waits for the end of the connection, and says why.
    pub(crate) async fn gone(&self) -> NatsError {
        let mut gone = self.gone.clone();
        let reason = gone.wait_for(Option::is_some).await;
        reason.ok().and_then(|reason| reason.clone()).unwrap_or(NatsError::Gone)
    }

    /// Sends, and gives the end at which the answer comes.
    async fn ask(
        &self,
        subject: &str,
        headers: &[(&str, &str)],
        payload: &[u8],
    ) -> Result<oneshot::Receiver<Message>, NatsError> {
        let question = self.next_question.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let (answer, answered) = oneshot::channel();
        self.asked.lock().unwrap_or_else(PoisonError::into_inner).insert(question, answer);
        let reply = format!("{}.a.{question}", self.inbox);
        self.send(wire::publish(subject, &reply, headers, payload)).await?;
        Ok(answered)
    }

    /// Sends, and waits for the answer.
    async fn request(&self, subject: &str, payload: &[u8]) -> Result<Message, NatsError> {
        let answered = self.ask(subject, &[], payload).await?;
        tokio::select! {
            answer = answered => answer.map_err(|_| NatsError::Gone)?.or_nobody(subject),
            reason = self.gone() => Err(reason),
            () = tokio::time::sleep(PATIENCE) => Err(NatsError::Unheard(subject.to_owned())),
        }
    }

    async fn send(&self, command: Vec<u8>) -> Result<(), NatsError> {
        match tokio::time::timeout(PATIENCE, self.commands.send(command)).await {
            Ok(Ok(())) => Ok(()),
            Ok(Err(_)) => Err(self.gone().await),
            Err(_) => Err(NatsError::Blocked),
        }
    }
}

/// What a client says of itself.
fn introduction(access: &Access, secure: bool) -> serde_json::Value {
    let mut says = serde_json::json!({
        "verbose": false,
        "pedantic": false,
        "tls_required": secure,
        "name": "gearwatch",
        "lang": "rust",
        "version": env!("CARGO_PKG_VERSION"),
        "protocol": 1,
        "echo": false,
        "headers": true,
        "no_responders": true,
    });
    match (&access.user, &access.secret) {
        (Some(user), Some(secret)) => {
            says["user"] = user.as_str().into();
            says["pass"] = secret.expose().into();
        }
        (None, Some(token)) => says["auth_token"] = token.expose().into(),
        _ => {}
    }
    says
}

/// A name that no other client has at the moment: hashed with keys that the standard library draws
/// for each hasher.
fn unique() -> String {
    use std::hash::{BuildHasher, RandomState};
    format!("{:016x}{:016x}", RandomState::new().hash_one(0), RandomState::new().hash_one(1))
}

/// Sends what waits until nothing more can come; says why it ends.
async fn speak(mut write: WriteHalf<Box<dyn Stream>>, mut commands: mpsc::Receiver<Vec<u8>>) -> NatsError {
    while let Some(command) = commands.recv().await {
        let sent = async {
            write.write_all(&command).await?;
            if commands.is_empty() { write.flush().await } else { Ok(()) }
        };
        if let Err(error) = sent.await {
            return error.into();
        }
    }
    NatsError::Unneeded
}

/// The reading side.
struct Listener {
    wire: Wire<ReadHalf<Box<dyn Stream>>>,
    commands: mpsc::Sender<Vec<u8>>,
    asked: Asked,
    message: mpsc::Sender<Message>,
}

impl Listener {
    /// Reads until something is wrong; says what. The server is asked for a sign of life where it
    /// says nothing, and left where it gives none.
    async fn listen(mut self) -> NatsError {
        let (mut unasked, mut silent) = (0, 0);
        let mut tick = tokio::time::interval(PATIENCE);
        loop {
            let said = tokio::select! {
                said = self.wire.next() => said,
                _ = tick.tick() => {
                    unasked = 0;
                    silent += 1;
                    if silent > 2 {
                        return NatsError::Silent(2 * PATIENCE);
                    }
                    // A full queue is looked after by whoever sends.
                    let _ = self.commands.try_send(b"PING\r\n".to_vec());
                    continue;
                }
            };
            silent = 0;
            let things = match &said {
                Ok(Said::Message(message)) => 1 + message.payload.len() / THING,
                _ => 1,
            };
            let wanted = match said {
                Err(error) => return error.into(),
                Ok(Said::Error(error)) => return NatsError::Server(error),
                Ok(Said::Ping) => {
                    let _ = self.commands.try_send(b"PONG\r\n".to_vec());
                    false
                }
                Ok(Said::Pong | Said::Ok | Said::Info(_)) => false,
                Ok(Said::Message(message)) => self.hand_over(message).await,
            };
            if !wanted {
                unasked += things;
            }
            if unasked > MOST_UNASKED {
                return NatsError::Unasked { count: unasked, within: PATIENCE };
            }
        }
    }

    /// Says whether somebody was waiting for it.
    async fn hand_over(&self, message: Message) -> bool {
        match message.subscription {
            ANSWERS => {
                let question = message.subject.rsplit('.').next().and_then(|part| part.parse::<u64>().ok());
                let asked = |question| self.asked.lock().unwrap_or_else(PoisonError::into_inner).remove(&question);
                question.and_then(asked).is_some_and(|answer| answer.send(message).is_ok())
            }
            MESSAGES => self.message.send(message).await.is_ok(),
            _ => false,
        }
    }
}
