//! What a server says, read within bounds, and how a message is sent.

use std::io;
use std::sync::Arc;

use serde::Deserialize;
use tokio::io::{AsyncBufReadExt, AsyncRead, AsyncReadExt, BufReader};

use super::NatsError;

/// Longest line (bytes). The longest one of a server is what it says of itself, which names the
/// servers of its cluster.
const LONGEST_LINE: usize = 64 << 10;
/// Longest message with its headers (bytes): what a server takes unless it is told otherwise
/// (`max_payload`, 1 MiB), and room for headers.
const LONGEST_MESSAGE: usize = (1 << 20) + (64 << 10);

/// What a server says that no server says.
#[derive(Clone, Debug, thiserror::Error)]
pub enum WireError {
    /// The socket failed.
    #[error(transparent)]
    Io(Arc<io::Error>),
    /// There is nothing more to read.
    #[error("the server closed the connection")]
    Closed,
    /// Bytes came before the handshake.
    #[error("the server talks before it was greeted")]
    Early,
    /// A line is not UTF-8.
    #[error("a line is no text")]
    NoText,
    /// A line ends otherwise than with CR and LF.
    #[error("a line has no end")]
    NoEnd,
    /// Longer than `LONGEST_LINE`.
    #[error("a line is longer than {LONGEST_LINE} bytes")]
    LongLine,
    /// The greeting is no JSON.
    #[error("what it says of itself: {0}")]
    Info(String),
    /// The line begins with something else.
    #[error("{0:?} is no word of the protocol")]
    Word(String),
    /// Subject, subscription and lengths are not there.
    #[error("{0:?} is no head of a message")]
    Head(String),
    /// Longer than `LONGEST_MESSAGE`.
    #[error("a message of {0} bytes is longer than {LONGEST_MESSAGE}")]
    LongMessage(usize),
    /// Content was asked for without a head.
    #[error("no message was begun")]
    NotBegun,
    /// Behind the content there is no line end.
    #[error("a message does not end where it says")]
    MessageEnd,
}

impl From<io::Error> for WireError {
    fn from(error: io::Error) -> Self {
        Self::Io(Arc::new(error))
    }
}

/// What a server says of itself.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Info {
    pub tls_required: bool,
    tls_available: bool,
    tls_verify: bool,
}

impl Info {
    pub fn speaks_tls(&self) -> bool {
        self.tls_required || self.tls_available || self.tls_verify
    }
}

/// A message to one of our subscriptions.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Message {
    pub subject: String,
    pub subscription: u64,
    /// Where an answer would go; empty where none is wanted.
    pub reply: String,
    /// In place of content: what became of a request.
    pub status: Option<u16>,
    pub description: String,
    pub payload: Vec<u8>,
}

impl Message {
    /// An error where the server says that nobody answers there.
    pub fn or_nobody(self, subject: &str) -> Result<Self, NatsError> {
        match self.status {
            Some(503) => Err(NatsError::Nobody(subject.to_owned())),
            _ => Ok(self),
        }
    }
}

/// One thing that a server said.
#[derive(Debug)]
pub(super) enum Said {
    Info(Info),
    Ping,
    Pong,
    Ok,
    Error(String),
    Message(Message),
}

/// Reads a server. What [`Wire::next`] has begun survives that nobody waits for it any more.
pub(super) struct Wire<R> {
    from: BufReader<R>,
    line: Vec<u8>,
    body: Vec<u8>,
    /// The message whose content is being read, the length of its headers, and that of all.
    begun: Option<(Message, usize, usize)>,
}

impl<R: AsyncRead + Unpin> Wire<R> {
    pub fn new(from: R) -> Self {
        Self { from: BufReader::with_capacity(LONGEST_LINE, from), line: Vec::new(), body: Vec::new(), begun: None }
    }

    /// The stream itself, where nothing was read ahead: what somebody slipped in before a handshake
    /// must not count as said after it.
    pub fn into_inner(self) -> Result<R, WireError> {
        if self.from.buffer().is_empty() && self.line.is_empty() {
            Ok(self.from.into_inner())
        } else {
            Err(WireError::Early)
        }
    }

    /// The next thing.
    ///
    /// # Errors
    /// Where the connection ends, or the server says what no server says.
    pub async fn next(&mut self) -> Result<Said, WireError> {
        loop {
            if self.begun.is_some() {
                return self.content().await.map(Said::Message);
            }
            self.read_line().await?;
            let line = std::mem::take(&mut self.line);
            let line = std::str::from_utf8(&line).map_err(|_| WireError::NoText)?;
            let line = line.strip_suffix("\r\n").ok_or(WireError::NoEnd)?;
            let (word, rest) = line.split_once([' ', '\t']).unwrap_or((line, ""));
            match word.to_ascii_uppercase().as_str() {
                "PING" => return Ok(Said::Ping),
                "PONG" => return Ok(Said::Pong),
                "+OK" => return Ok(Said::Ok),
                "-ERR" => return Ok(Said::Error(format!("the server says: {}", short(rest.trim_matches('\''))))),
                "INFO" => {
                    return serde_json::from_str(rest).map(Said::Info).map_err(|e| WireError::Info(e.to_string()));
                }
                "MSG" => self.begun = Some(head(rest, false)?),
                "HMSG" => self.begun = Some(head(rest, true)?),
                _ => return Err(WireError::Word(short(word))),
            }
        }
    }

    async fn read_line(&mut self) -> Result<(), WireError> {
        loop {
            let some = self.from.fill_buf().await?;
            if some.is_empty() {
                return Err(WireError::Closed);
            }
            let end = some.iter().position(|&byte| byte == b'\n').map(|at| at + 1);
            let taken = end.unwrap_or(some.len());
            if self.line.len() + taken > LONGEST_LINE {
                return Err(WireError::LongLine);
            }
            self.line.extend_from_slice(&some[..taken]);
            self.from.consume(taken);
            if end.is_some() {
                return Ok(());
            }
        }
    }

    async fn content(&mut self) -> Result<Message, WireError> {
        let Some((_, headers, length)) = self.begun else { return Err(WireError::NotBegun) };
        // With the line end behind it.
        while self.body.len() < length + 2 {
            let missing = (length + 2 - self.body.len()) as u64;
            let read = (&mut self.from).take(missing).read_buf(&mut self.body).await?;
            if read == 0 {
                return Err(WireError::Closed);
            }
        }
        let mut body = std::mem::take(&mut self.body);
        if !body.ends_with(b"\r\n") {
            return Err(WireError::MessageEnd);
        }
        body.truncate(length);
        let (mut message, _, _) = self.begun.take().unwrap_or_default();
        if headers > 0 {
            (message.status, message.description) = status(&body[..headers]);
            body.drain(..headers);
        }
        message.payload = body;
        Ok(message)
    }
}

/// What fits into a message of ours.
fn short(text: &str) -> String {
    text.chars().take(200).collect()
}

/// `<subject> <subscription> [reply] [length of the headers] <length of all>`
fn head(rest: &str, with_headers: bool) -> Result<(Message, usize, usize), WireError> {
    let bad = || WireError::Head(short(rest));
    let mut parts: Vec<&str> = rest.split_ascii_whitespace().collect();
    let number = |parts: &mut Vec<&str>| parts.pop().and_then(|part| part.parse::<usize>().ok()).ok_or_else(bad);
    let length = number(&mut parts)?;
    let headers = if with_headers { number(&mut parts)? } else { 0 };
    if length > LONGEST_MESSAGE {
        return Err(WireError::LongMessage(length));
    }
    let (subject, subscription, reply) = match parts[..] {
        [subject, subscription] => (subject, subscription, ""),
        [subject, subscription, reply] => (subject, subscription, reply),
        _ => return Err(bad()),
    };
    if headers > length {
        return Err(bad());
    }
    let subscription = subscription.parse().map_err(|_| bad())?;
    let message = Message { subject: subject.to_owned(), subscription, reply: reply.to_owned(), ..Message::default() };
    Ok((message, headers, length))
}

/// What the first line of the headers says, such as `NATS/1.0 503`.
fn status(headers: &[u8]) -> (Option<u16>, String) {
    let headers = String::from_utf8_lossy(headers);
    let line = headers.lines().next().and_then(|line| line.strip_prefix("NATS/1.0")).unwrap_or_default().trim();
    let (code, description) = line.split_once(' ').unwrap_or((line, ""));
    (code.parse().ok(), description.trim().to_owned())
}

/// The command that sends a message.
pub(super) fn publish(subject: &str, reply: &str, headers: &[(&str, &str)], payload: &[u8]) -> Vec<u8> {
    let mut command = if headers.is_empty() {
        format!("PUB {subject} {reply} {}\r\n", payload.len()).into_bytes()
    } else {
        let mut lines = "NATS/1.0\r\n".to_owned();
        headers.iter().for_each(|(name, value)| lines.push_str(&format!("{name}: {value}\r\n")));
        lines.push_str("\r\n");
        let (begin, all) = (lines.len(), lines.len() + payload.len());
        format!("HPUB {subject} {reply} {begin} {all}\r\n{lines}").into_bytes()
    };
    command.extend_from_slice(payload);
    command.extend_from_slice(b"\r\n");
    command
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all_of(bytes: &[u8], at_once: usize) -> (Vec<Said>, String) {
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        runtime.block_on(async {
            let (mut theirs, ours) = tokio::io::duplex(at_once);
            let bytes = bytes.to_vec();
            let (mut wire, mut said) = (Wire::new(ours), Vec::new());
            let send = async move {
                // The reader leaves at the first error.
                let _ = tokio::io::AsyncWriteExt::write_all(&mut theirs, &bytes).await;
            };
            let read = async move {
                loop {
                    match wire.next().await {
                        Ok(thing) => said.push(thing),
                        Err(error) => break (said, error.to_string()),
                    }
                }
            };
            tokio::join!(send, read).1
        })
    }

    /// The examples of the protocol's description, however the bytes are cut.
    #[test]
    fn literature_what_a_server_says_is_read() {
        let bytes = b"INFO {\"server_id\":\"x\",\"tls_required\":true,\"port\":4222}\r\nPING\r\n+OK\r\n\
            MSG FOO.BAR 9 11\r\nHello World\r\nMSG FOO.BAR 9 GREETING.34 0\r\n\r\n\
            HMSG FOO.BAR 1 34 45\r\nNATS/1.0\r\nFoodGroup: vegetable\r\n\r\nHello World\r\n\
            HMSG _INBOX.a 1 16 16\r\nNATS/1.0 503\r\n\r\n\r\n-ERR 'Authorization Violation'\r\nPONG\r\n";
        for at_once in [1, 7, 4096] {
            let (said, end) = all_of(bytes, at_once);
            assert_eq!(end, "the server closed the connection");
            let [
                Said::Info(info),
                Said::Ping,
                Said::Ok,
                Said::Message(a),
                Said::Message(b),
                Said::Message(c),
                Said::Message(d),
                Said::Error(error),
                Said::Pong,
            ] = &said[..]
            else {
                panic!("{said:?}")
            };
            assert!(info.speaks_tls());
            assert_eq!((a.subject.as_str(), a.subscription, a.payload.as_slice()), ("FOO.BAR", 9, &b"Hello World"[..]));
            assert_eq!((b.reply.as_str(), b.payload.len()), ("GREETING.34", 0));
            assert_eq!((c.status, c.payload.as_slice()), (None, &b"Hello World"[..]));
            assert_eq!(d.status, Some(503));
            assert_eq!(error, "the server says: Authorization Violation");
        }
    }

    /// Lines and messages without end, lengths beyond all bounds, and what is no protocol at all.
    #[test]
    fn regress_what_no_server_says_ends_the_connection() {
        let endless = [b"INFO {\"server_id\":\"".to_vec(), vec![b'x'; 4 << 20]].concat();
        for (bytes, wanted) in [
            (endless.as_slice(), "a line is longer than 65536 bytes"),
            (b"MSG a 1 18446744073709551615\r\n", "is longer than 1114112"),
            (b"MSG a 1 99999999999999999999\r\n", "is no head"),
            (b"HMSG a 1 12 11\r\n", "is no head"),
            (b"MSG a 1 -1\r\n", "is no head"),
            (b"MSG a x 1\r\n", "is no head"),
            (b"MSG 1\r\n", "is no head"),
            (b"MSG a 1 2\r\nabc\r\n", "does not end where it says"),
            (b"HTTP/1.1 400 Bad Request\r\n", "is no word of the protocol"),
            (b"\r\n", "is no word of the protocol"),
            (b"\xff\xff\r\n", "is no text"),
            (b"INFO {\r\n", "what it says of itself"),
        ] {
            let (said, end) = all_of(bytes, 4096);
            assert!(said.is_empty() && end.contains(wanted), "{wanted}: {end}, {said:?}");
        }
    }

    #[test]
    fn literature_messages_are_sent_as_the_protocol_says() {
        assert_eq!(publish("FOO", "BAR", &[], b"Hello"), b"PUB FOO BAR 5\r\nHello\r\n");
        let with = publish("MORNING.MENU", "r", &[("BREAKFAST", "donut")], b"Yum!");
        assert_eq!(with, b"HPUB MORNING.MENU r 30 34\r\nNATS/1.0\r\nBREAKFAST: donut\r\n\r\nYum!\r\n");
    }
}
