//! A client of the Foxglove WebSocket protocol sees the topics of the log while they come. Only in
//! builds with the cargo feature `foxglove`: `just campaign-live-view`.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::fixture::Bench;
use crate::server::free_port;
use crate::service::{configure, ended_within, files, signal, start, status, wait_for};

/// Fetches and reads frames (RFC 6455), without fragments, which the server does not send.
struct Viewer(TcpStream);

enum Frame {
    Text(Value),
    Binary(Vec<u8>),
    Other,
}

impl Viewer {
    fn connect(port: u16) -> Option<Self> {
        let mut stream = TcpStream::connect(("127.0.0.1", port)).ok()?;
        stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        write!(
            stream,
            "GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n\
             Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
        )
        .ok()?;
        let mut head = Vec::new();
        while !head.ends_with(b"\r\n\r\n") {
            let mut byte = [0];
            stream.read_exact(&mut byte).ok()?;
            head.push(byte[0]);
        }
        let head = String::from_utf8(head).unwrap();
        assert!(head.starts_with("HTTP/1.1 101"), "{head}");
        // The answer that RFC 6455, 1.3 computes for this key.
        assert!(head.contains("s3pPLMBiTxaQ9kYGzzhZRbK+xOo="), "{head}");
        Some(Self(stream))
    }

    fn exact<const N: usize>(&mut self) -> Option<[u8; N]> {
        let mut bytes = [0; N];
        self.0.read_exact(&mut bytes).ok()?;
        Some(bytes)
    }

    /// The next frame; `None` where none comes in time.
    fn frame(&mut self) -> Option<Frame> {
        let [kind, length] = self.exact()?;
        let length = match length {
            126 => u64::from(u16::from_be_bytes(self.exact()?)),
            127 => u64::from_be_bytes(self.exact()?),
            short => u64::from(short),
        };
        let mut payload = vec![0; usize::try_from(length).unwrap()];
        self.0.read_exact(&mut payload).ok()?;
        Some(match kind {
            0x81 => Frame::Text(serde_json::from_slice(&payload).unwrap()),
            0x82 => Frame::Binary(payload),
            _ => Frame::Other,
        })
    }

    /// A client masks what it sends; with zeros as the mask nothing changes.
    fn say(&mut self, what: &Value) {
        let text = what.to_string();
        let length = u16::try_from(text.len()).unwrap().to_be_bytes();
        let head = [0x81, 0x80 | 126, length[0], length[1], 0, 0, 0, 0];
        self.0.write_all(&[&head, text.as_bytes()].concat()).unwrap();
    }
}

#[test]
fn conform_a_viewer_sees_the_verdicts_of_the_log() {
    if !cfg!(feature = "foxglove") {
        eprintln!("skipped: this build has no live view for Foxglove (cargo feature `foxglove`)");
        return;
    }
    let bench = Bench::new();
    let port = free_port();
    let folder = bench.path("log");
    let sink = format!("[[sink]]\nkind = \"foxglove\"\naddress = \"127.0.0.1:{port}\"\nraw = true\n");
    let mut child = start(&configure(&bench, &folder, "20.0", &sink));
    let mut viewer = wait_for(Duration::from_secs(20), || Viewer::connect(port)).expect("the live view answers");
    let (mut topics, mut seen) = (Vec::new(), Vec::new());
    let begin = Instant::now();
    while seen.len() < 20 && begin.elapsed() < Duration::from_secs(30) {
        let Some(frame) = viewer.frame() else {
            // A channel that is made while a viewer connects may never be advertised to it by the
            // SDK (0.30): people connect again, too.
            println!("nothing came: connecting again");
            viewer = Viewer::connect(port).expect("the live view answers again");
            topics.clear();
            continue;
        };
        match frame {
            Frame::Text(said) if said["op"] == "advertise" => {
                for channel in said["channels"].as_array().unwrap() {
                    let topic = channel["topic"].as_str().unwrap().to_owned();
                    if topic.ends_with("/rank") {
                        let wanted = json!({"id": topics.len(), "channelId": channel["id"]});
                        viewer.say(&json!({"op": "subscribe", "subscriptions": [wanted]}));
                    }
                    topics.push(topic);
                }
            }
            // 1, number of the subscription, time, message
            Frame::Binary(bytes) if bytes[0] == 1 => seen.push(bytes[13..].to_vec()),
            _ => {}
        }
    }
    println!("topics {topics:?}; {} verdicts", seen.len());
    assert!(topics.iter().any(|topic| topic == "/gear/stage1/rank"), "{topics:?}");
    let snapshot = status(&bench).expect("the service answers");
    let sink = snapshot.sinks.iter().find(|sink| sink.name == "foxglove").expect("the sink is there");
    assert!(sink.ok && sink.figures.iter().any(|(name, value)| name == "viewers" && *value == 1.0), "{sink:?}");
    signal(&child, "TERM");
    assert_eq!(ended_within(&mut child, Duration::from_secs(5)).and_then(|s| s.code()), Some(0));
    // What the viewer saw is what the log keeps.
    let logged = gearwatch_testkit::log::content(&files(&folder)).verdicts;
    assert_eq!(seen.len(), 20);
    for message in &seen {
        let text = String::from_utf8_lossy(message);
        assert!(logged.values().any(|kept| kept == message), "the log has no {text}");
    }
}
