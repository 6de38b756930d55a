//! NATS servers that talk without end. Each must be left after a bounded number of bytes; the one
//! seen first had filled 1.4 GB.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};

use gearwatch_daemon::fleet::{Access, From, Notice, follow};

/// Bytes that a peer may get rid of before it is left: what the sockets of both ends hold (Linux
/// lets a receiver's grow to 6 MiB and a sender's to 4 MiB), one message, and those that wait.
const MOST_BYTES: u64 = 40 << 20;
/// Long enough for a busy machine, and shorter than what the peers would talk.
const PATIENCE: Duration = Duration::from_secs(60);

const INFO: &[u8] =
    b"INFO {\"server_id\":\"x\",\"version\":\"2.10.0\",\"port\":4222,\"headers\":true,\"max_payload\":1048576}\r\n";

/// Talks to whoever connects: `begin` once, then `talk` until the other end has gone. Gives the
/// bytes that it got rid of.
fn peer(begin: Vec<u8>, answer_ping: bool, talk: Vec<u8>) -> (String, mpsc::Receiver<u64>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("nats://{}", listener.local_addr().unwrap());
    let (tell, told) = mpsc::channel();
    std::thread::spawn(move || {
        while let Ok((mut stream, _)) = listener.accept() {
            let (begin, talk, tell) = (begin.clone(), talk.clone(), tell.clone());
            std::thread::spawn(move || {
                // Only the first one is waited for.
                let _ = tell.send(attack(&mut stream, &begin, answer_ping, &talk));
            });
        }
    });
    (address, told)
}

fn attack(stream: &mut TcpStream, begin: &[u8], answer_ping: bool, talk: &[u8]) -> u64 {
    if stream.write_all(begin).is_err() {
        return 0;
    }
    if answer_ping {
        // The greeting ends with a ping.
        let (mut heard, mut some) = (Vec::new(), [0; 4096]);
        while !heard.ends_with(b"PING\r\n") {
            match stream.read(&mut some) {
                Ok(0) | Err(_) => return 0,
                Ok(n) => heard.extend_from_slice(&some[..n]),
            }
        }
        if stream.write_all(b"PONG\r\n").is_err() {
            return 0;
        }
    }
    // Whoever does not read what is answered must not be waited for.
    let (mut reader, heard) = (stream.try_clone().unwrap(), Arc::new(AtomicU64::new(0)));
    let count = heard.clone();
    std::thread::spawn(move || {
        let mut some = [0; 65_536];
        while let Ok(n @ 1..) = reader.read(&mut some) {
            count.fetch_add(n as u64, Ordering::Relaxed);
        }
    });
    let (mut sent, end) = (0, Instant::now() + PATIENCE);
    while Instant::now() < end {
        match stream.write(talk) {
            Ok(n) => sent += n as u64,
            Err(_) => return sent,
        }
        if sent > 4 * MOST_BYTES {
            break;
        }
    }
    sent.max(MOST_BYTES + 1)
}

/// Follows the stream of a peer until it was left once; gives the bytes that the peer got rid of,
/// and the reason.
fn left_after(begin: &[u8], answer_ping: bool, talk: &[u8]) -> (u64, String) {
    let (address, told) = peer(begin.to_vec(), answer_ping, talk.to_vec());
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    let (lost, reason) = mpsc::channel();
    let task = runtime.spawn(async move {
        let access = Access::default();
        let tell = move |notice| {
            if let Notice::Lost(error) = notice {
                drop(lost.send(error.to_string()));
            }
        };
        follow(&address, &access, "gearwatch", From::Beginning, tell).await
    });
    let reason = reason.recv_timeout(PATIENCE).expect("the peer is left");
    let bytes = told.recv_timeout(PATIENCE).expect("the peer notices it");
    task.abort();
    (bytes, reason)
}

/// The most memory that this process had (MiB); 0 where the system does not say.
fn peak_mib() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.and_then(|line| line.trim().split(' ').next()?.parse::<u64>().ok()).unwrap_or(0) >> 10
}

#[test]
fn regress_a_nats_server_that_talks_without_end_is_left() {
    let endless = vec![b'x'; 1 << 16];
    let message = [b"MSG _INBOX.a 1 1000000\r\n".to_vec(), vec![b'y'; 1_000_000], b"\r\n".to_vec()].concat();
    for (label, begin, answer_ping, talk, wanted) in [
        ("before any greeting", &b"INFO {\"server_id\":\""[..], false, &endless[..], "a line is longer"),
        ("no word of the protocol", &b""[..], false, &endless[..], "a line is longer"),
        ("after its greeting", INFO, false, &endless[..], ""),
        ("in place of an answer", INFO, true, &endless[..], "a line is longer"),
        ("a message without end", INFO, true, b"MSG a 1 18446744073709551615\r\n", "is longer than"),
        ("pings", INFO, true, b"PING\r\n", "that nobody asked for"),
        ("what it is", INFO, true, INFO, "that nobody asked for"),
        ("assent", INFO, false, b"+OK\r\n", ""),
        ("messages that nobody wants", INFO, true, &message[..], "that nobody asked for"),
    ] {
        let (bytes, reason) = left_after(begin, answer_ping, talk);
        println!("{label}: left after {bytes} bytes: {reason}");
        // Behind a greeting the first bytes decide whether they came too early or are a line
        // without end.
        assert!(reason.contains(wanted), "{label}: {reason}");
        assert!(bytes <= MOST_BYTES, "{label}: {bytes} bytes were taken from it");
    }
    let peak = peak_mib();
    println!("peak memory of this process: {peak} MiB");
    assert!(peak < 128, "{peak} MiB");
}
