//! OPC UA against a real server, `asyncua` of Python (skipped with a message where it is not
//! installed), and against what is no server.
#![allow(clippy::print_stderr, reason = "a test that is skipped says so")]

mod hostile;
mod server;

use std::time::{Duration, Instant};

use gearwatch_core::block::{OperatingPoint, Packet};
use gearwatch_runtime::clock::now_unix_ns;
use gearwatch_runtime::queue::{Inlet, WhenFull, bounded};
use gearwatch_sources::{Sender, SourceError};
use tokio::task::JoinHandle;
use tokio::time::timeout;

use super::support::{Opened, runtime, source};
use server::Server;

/// Long enough for the keys of a session in a build that is not optimised.
const DEADLINE: Duration = Duration::from_secs(2);
/// Nothing takes so long.
const LONGEST: Duration = Duration::from_secs(10);

/// A source that runs.
struct Listening {
    runtime: tokio::runtime::Runtime,
    packets: Inlet<Packet>,
    end: JoinHandle<Result<(), SourceError>>,
}

impl Listening {
    fn start(source: &Opened) -> Self {
        let runtime = runtime();
        let push = source.open_push().unwrap();
        let (outlet, packets) = bounded(64, WhenFull::DropOldest);
        let end = runtime.spawn(push(Sender::new(outlet, |_| ())));
        Self { runtime, packets, end }
    }

    fn next(&self) -> OperatingPoint {
        let next = self.runtime.block_on(async { timeout(LONGEST, self.packets.recv()).await });
        match next.expect("a packet comes").expect("the source runs") {
            Packet::OperatingPoint(point) => point,
            other => panic!("{other:?}"),
        }
    }

    /// The first point of which something holds.
    fn wait_for(&self, what: &str, so: impl Fn(&OperatingPoint) -> bool) -> OperatingPoint {
        let began = Instant::now();
        loop {
            let point = self.next();
            if so(&point) {
                return point;
            }
            assert!(began.elapsed() < LONGEST, "{what}: {point:?}");
        }
    }

    /// What it ends with, after a last point of which nothing is known.
    fn error(self) -> String {
        let end = self.runtime.block_on(async { timeout(LONGEST, self.end).await });
        let error = end.expect("it ends").expect("it does not panic").expect_err("it fails").to_string();
        let mut last = None;
        while let Ok(packet) = self.packets.try_recv() {
            last = Some(packet);
        }
        assert!(matches!(last, Some(Packet::OperatingPoint(p)) if p.brake_torque_nm.is_nan()), "{last:?}");
        error
    }
}

fn opened(keys: &str) -> Opened {
    let mut source = source(keys);
    source.context.data_deadline = DEADLINE;
    source
}

fn error_of(keys: &str) -> String {
    Listening::start(&opened(keys)).error()
}

const TORQUE: &str = "ns=2;s=Brake.Torque";

/// Speed in Hz from 1/min, torque in N m and temperature in °C from tenths of a degree, at the time
/// of this machine. What does not change stays known, and what changes comes.
#[test]
fn conform_opcua_values_arrive_with_unit_and_time() {
    let Some(server) = Server::start("plain") else { return };
    let keys = format!(
        "kind = \"opcua\"\nendpoint = \"opc.tcp://localhost:{}\"\npublish_secs = 0.1\nnodes = [\n\
         {{ quantity = \"motor_speed_hz\", node = \"ns=2;s=Drive.Speed\", scale = 0.016666666666666666 }},\n\
         {{ quantity = \"brake_torque_nm\", node = {TORQUE:?} }},\n\
         {{ quantity = \"temperature_c\", node = \"ns=2;s=Oil.Temperature\", scale = 0.1, offset = -5.0 }},\n]",
        server.port
    );
    let before = now_unix_ns();
    let listening = Listening::start(&opened(&keys));
    let point = listening.wait_for("all is known", |p| p.temperature_c.is_finite() && p.brake_torque_nm.is_finite());
    // 1500/min are 25 Hz; 650 tenths less 5 are 60 °C.
    assert!((point.motor_speed_hz - 25.0).abs() < 1e-12, "{point:?}");
    assert!((point.temperature_c - 60.0).abs() < 1e-12, "{point:?}");
    assert_eq!(point.brake_torque_nm, 10.0);
    assert!((before..=now_unix_ns()).contains(&point.t), "{point:?}");
    server.set("Brake.Torque 12.5");
    listening.wait_for("the new torque comes", |p| p.brake_torque_nm == 12.5);
    let began = Instant::now();
    while began.elapsed() < DEADLINE * 2 {
        let point = listening.next();
        assert_eq!((point.brake_torque_nm, point.motor_speed_hz.is_finite()), (12.5, true), "{point:?}");
    }
}

#[test]
fn conform_opcua_bad_values_are_unknown_and_uncertain_ones_are_used() {
    let Some(server) = Server::start("plain") else { return };
    let listening = Listening::start(&opened(&server.keys("brake_torque_nm", TORQUE)));
    listening.wait_for("it is known", |p| p.brake_torque_nm == 10.0);
    server.set("Brake.Torque 11 BadSensorFailure");
    listening.wait_for("bad is unknown", |p| p.brake_torque_nm.is_nan());
    server.set("Brake.Torque 12 UncertainLastUsableValue");
    listening.wait_for("uncertain is used", |p| p.brake_torque_nm == 12.0);
    server.set("Brake.Torque nan");
    listening.wait_for("not finite is unknown", |p| p.brake_torque_nm.is_nan());
    server.set("Brake.Torque 13");
    listening.wait_for("it is known again", |p| p.brake_torque_nm == 13.0);
}

/// A server that is gone is an error, and so is one that hangs; opened again, the source has the
/// new server's value.
#[test]
fn conform_opcua_a_server_that_starts_again_is_read_again() {
    let Some(server) = Server::start("plain") else { return };
    let source = opened(&server.keys("brake_torque_nm", TORQUE));
    let listening = Listening::start(&source);
    server.set("Brake.Torque 20");
    listening.wait_for("it is known", |p| p.brake_torque_nm == 20.0);
    server.kill();
    let error = listening.error();
    assert!(error.contains("the connection is lost") && error.contains(&server.port.to_string()), "{error}");
    server.restart();
    let listening = Listening::start(&source);
    listening.wait_for("it is known again", |p| p.brake_torque_nm == 10.0);
    server.signal("STOP");
    let error = listening.error();
    server.signal("CONT");
    assert!(error.contains("no answer from the subscription within 2.0 s") || error.contains("BadTimeout"), "{error}");
}

/// Controllers have few sessions. One that nothing reads any more is closed at once, and not kept
/// for its time limit.
#[test]
fn conform_opcua_the_session_is_closed_when_the_source_ends() {
    let Some(server) = Server::start("plain") else { return };
    let listening = Listening::start(&opened(&server.keys("brake_torque_nm", TORQUE)));
    listening.wait_for("it is known", |p| p.brake_torque_nm == 10.0);
    assert_eq!(server.sessions(), 1);
    let began = Instant::now();
    listening.end.abort();
    while server.sessions() > 0 {
        // Four data deadlines are the time limit of a session.
        assert!(began.elapsed() < DEADLINE * 2, "the session is still there");
    }
}

#[test]
fn conform_opcua_nodes_that_are_not_there_or_no_numbers_are_named() {
    let Some(server) = Server::start("plain") else { return };
    for (node, expected) in [
        (
            "ns=2;s=Brake.Tork",
            "node \"ns=2;s=Brake.Tork\": expected a variable that can be read, found BadNodeIdUnknown",
        ),
        ("ns=2;s=Bench", "found BadAttributeIdInvalid; it is no variable"),
        ("ns=2;s=Brake.Name", "node \"ns=2;s=Brake.Name\": expected a number, found the text \"brake\""),
        ("ns=2;s=Brake.On", "expected a number, found the Boolean true"),
        // The array of name spaces.
        ("i=2255", "expected a number, found an array of"),
    ] {
        let error = error_of(&server.keys("brake_torque_nm", node));
        assert!(error.starts_with(&format!("opc.tcp://127.0.0.1:{}/bench: ", server.port)), "{error}");
        assert!(error.contains(expected), "{expected}: {error}");
    }
}

#[test]
fn conform_opcua_logins_are_taken_or_refused_with_a_reason() {
    let Some(server) = Server::start("user") else { return };
    let keys = server.keys("brake_torque_nm", TORQUE);
    let error = error_of(&keys);
    assert!(error.contains("expected a login without a user, found only UserName"), "{error}");
    let with = |password: &str| {
        std::fs::write(server.path("password"), format!("{password}\n")).unwrap();
        format!("{keys}username = \"bench\"\npassword_file = {:?}", server.path("password"))
    };
    let error = error_of(&with("wrong"));
    assert!(error.contains("the login as \"bench\" failed: Bad"), "{error}");
    assert!(error.contains("check username and password_file") && !error.contains("wrong"), "{error}");
    Listening::start(&opened(&with("right"))).wait_for("it is known", |p| p.brake_torque_nm == 10.0);
    let nowhere = format!("{keys}username = \"bench\"\npassword_file = \"/nowhere/password\"");
    let error = opened(&nowhere).open_push().err().map(|e| e.to_string()).unwrap_or_default();
    assert!(error.contains("/nowhere/password: No such file"), "{error}");
}

/// Signed and encrypted, with the one certificate that is accepted on each side.
#[test]
fn conform_opcua_only_the_given_certificate_is_trusted() {
    let Some(server) = Server::start("secure") else { return };
    let keys = server.keys("brake_torque_nm", TORQUE);
    let with = |mode: &str, server_file: &str, own: &str, key: &str| {
        let path = |file| server.path(file);
        format!(
            "{keys}security = {mode:?}\nserver_certificate = {:?}\ncertificate = {:?}\nprivate_key = {:?}",
            path(server_file),
            path(own),
            path(key)
        )
    };
    for mode in ["sign", "sign_and_encrypt"] {
        let listening = Listening::start(&opened(&with(mode, "server.der", "client.der", "client.pem")));
        listening.wait_for("it is known", |p| p.brake_torque_nm == 10.0);
    }
    let error = error_of(&with("sign", "stranger.der", "client.der", "client.pem"));
    assert!(error.contains("expected the certificate of ") && error.contains("stranger.der (SHA-1 "), "{error}");
    let error = error_of(&with("sign", "server.der", "stranger.der", "stranger.pem"));
    assert!(error.contains("failed: Bad"), "{error}");
    let error = error_of(&keys);
    assert!(error.contains("expected an endpoint with security \"none\", found Basic256Sha256 \"sign\""), "{error}");
    for (keys, expected) in [
        (with("sign", "server.der", "server.der", "server.pem"), "URI:urn:gearwatch as its first alternative name"),
        (with("sign", "server.pem", "client.der", "client.pem"), "expected one X.509 certificate in DER or PEM"),
        (with("sign", "server.der", "client.der", "client.der"), "expected an RSA key in PEM"),
        (with("sign", "server.der", "client.der", "stranger.pem"), "found the key of another certificate"),
        (with("sign", "server.der", "client.der", "nowhere.pem"), "No such file"),
    ] {
        let error = opened(&keys).open_push().err().map(|e| e.to_string()).unwrap_or_default();
        assert!(error.contains(expected), "{expected}: {error}");
    }
}

fn keys_at(port: u16) -> String {
    format!(
        "kind = \"opcua\"\nendpoint = \"opc.tcp://127.0.0.1:{port}\"\nnodes = [{{ quantity = \"brake_torque_nm\", node = {TORQUE:?} }}]"
    )
}

#[test]
fn conform_opcua_what_is_no_server_is_named() {
    let nothing = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let error = error_of(&keys_at(nothing));
    assert!(error.contains(&format!("no connection to 127.0.0.1:{nothing}: Connection refused")), "{error}");
    assert!(error.contains("is the server running, and are host and port right?"), "{error}");
    let error = error_of(&keys_at(hostile::answers(b"HTTP/1.1 400 Bad Request\r\n\r\n").port()));
    assert!(error.contains("expected an OPC UA server"), "{error}");
    let error = error_of(&keys_at(hostile::answers(b"").port()));
    assert!(error.contains("no answer to the question for endpoints within 2.0 s (data_deadline_secs)"), "{error}");
}

/// The length of a message is believed up to what was asked for: the connection ends at once, and
/// not when four gigabytes have come.
#[test]
fn conform_opcua_a_message_without_end_is_not_collected() {
    let began = Instant::now();
    let error = error_of(&keys_at(hostile::answers(b"ACKF\xff\xff\xff\xff........").port()));
    assert!(error.contains("found 4294967295"), "{error}");
    assert!(began.elapsed() < DEADLINE, "{:?}", began.elapsed());
}

/// Whatever arrives: the source ends with an error or goes on, and never takes the program with it.
#[test]
fn conform_opcua_flipped_bits_end_in_an_error_at_worst() {
    let Some(server) = Server::start("plain") else { return };
    let runtime = runtime();
    let mut ends = Vec::new();
    for seed in 0..32 {
        let every = [60, 300, 1000, 4000][seed as usize % 4];
        let port = hostile::flipping(server.port, seed, every);
        let push = opened(&keys_at(port)).open_push().unwrap();
        let (outlet, packets) = bounded(64, WhenFull::DropOldest);
        ends.push(runtime.spawn(async move {
            let end = timeout(Duration::from_secs(3), push(Sender::new(outlet, |_| ()))).await;
            drop(packets);
            end.map(|end| end.is_err())
        }));
    }
    let ends = ends.into_iter().map(|end| runtime.block_on(end).expect("no panic leaves the source"));
    let failed = ends.filter(|end| matches!(end, Ok(true))).count();
    assert!(failed >= 8, "{failed} of 32 failed: too few bits were flipped");
}
