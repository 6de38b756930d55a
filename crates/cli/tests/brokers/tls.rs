//! Brokers and receivers of alarms over TLS: who proves its name is spoken to, who does not is told
//! nothing.

use std::io::{Read, Write};
use std::process::{Command, Stdio};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use rumqttc::{Client, MqttOptions, PublishOptions, QoS};

use crate::fixture::{Bench, text};
use crate::server::{Server, free_port};
use crate::service::{configure, ended_within, figure, said, signal, start, status, wait_for};

const LIMIT: Duration = Duration::from_secs(30);

/// The sink publishes and the source hears over TLS, at a broker whose certificate this machine's
/// own authority signed.
#[test]
fn conform_mqtt_goes_over_tls() {
    let bench = Bench::new();
    let Some((key, certificate)) = bench.certificate("broker") else { return };
    let Some((server, port)) = Server::mosquitto_with_tls(&bench.path("mosquitto"), &key, &certificate) else { return };
    // Readings are matched with samples by time.
    let now_ns = SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_nanos();
    let keys = format!(
        "first_sample_unix_ns = {now_ns}\n[[bench.source]]\nkind = \"mqtt\"\nbroker = \"localhost:{port}\"\ntls = true\nca_file = \"broker.pem\"\n\
         topics = [{{ quantity = \"brake_torque_nm\", topic = \"brake\" }}]\n[[sink]]\nkind = \"mqtt\"\nhost = \"127.0.0.1\"\n\
         port = {port}\ntls = true\nca_file = \"broker.pem\"\nspool = \"spool\"\n[[sink]]"
    );
    let config = configure(&bench, &bench.path("log"), "1.0", "");
    let service = std::fs::read_to_string(&config).unwrap().replacen("[[sink]]", &keys, 1);
    std::fs::write(&config, service).unwrap();
    let mut child = start(&config);
    let sink = |what: &str| figure(status(&bench)?.sinks.iter().find(|sink| sink.name == "mqtt")?, what);
    wait_for(LIMIT, || sink("confirmed").filter(|&count| count > 5)).expect("letters go out");
    let (client, mut connection) =
        Client::builder(MqttOptions::new("brake", ("127.0.0.1", server.port))).capacity(16).build();
    std::thread::spawn(move || connection.iter().all(|event| event.is_ok()));
    let torque = wait_for(LIMIT, || {
        client.try_publish("brake", "12.5", PublishOptions::new(QoS::AtMostOnce)).unwrap();
        std::thread::sleep(Duration::from_millis(100));
        status(&bench)?.benches[0].brake_torque_nm.filter(|torque| *torque == 12.5)
    });
    assert!(torque.is_some(), "the source hears the broker");
    signal(&child, "TERM");
    assert_eq!(
        ended_within(&mut child, Duration::from_secs(5)).and_then(|s| s.code()),
        Some(0),
        "{}",
        said(&mut child)
    );
}

/// NATS over TLS with a password; with a wrong authority or a wrong password it gets nothing, and
/// the sink says why.
#[test]
fn conform_nats_goes_over_tls() {
    let bench = Bench::new();
    let Some((key, certificate)) = bench.certificate("broker") else { return };
    bench.certificate("other").unwrap();
    let Some(server) = Server::nats_with_tls(&bench.path("nats"), &key, &certificate) else { return };
    bench.write("right", "hunter2\n");
    bench.write("wrong", "hunter3\n");
    for (ca, secret, wanted) in [
        ("other.pem", "right", "certificate"),
        ("broker.pem", "wrong", "Authorization Violation"),
        ("broker.pem", "right", ""),
    ] {
        let sink = format!(
            "[[sink]]\nkind = \"nats\"\nservers = [\"tls://localhost:{}\"]\nca_file = \"{ca}\"\nuser = \"bench\"\n\
             secret_file = \"{secret}\"\nspool = \"spool\"\n",
            server.port
        );
        let config = configure(&bench, &bench.path("log"), "10.0", &sink);
        let mut child = start(&config);
        let of_sink = || status(&bench)?.sinks.into_iter().find(|sink| sink.name == "nats");
        if wanted.is_empty() {
            wait_for(LIMIT, || of_sink().filter(|sink| figure(sink, "confirmed") > Some(50))).expect("letters go out");
        } else {
            let sink = wait_for(LIMIT, || of_sink().filter(|sink| sink.detail.contains(wanted)));
            let sink = sink.unwrap_or_else(|| panic!("{wanted} is not said: {:?}", of_sink()));
            assert_eq!(figure(&sink, "confirmed"), Some(0), "{sink:?}");
        }
        signal(&child, "TERM");
        assert_eq!(
            ended_within(&mut child, Duration::from_secs(5)).and_then(|s| s.code()),
            Some(0),
            "{}",
            said(&mut child)
        );
    }
}

/// A broker whose certificate another authority signed gets no letter, and the sink says why.
#[test]
fn conform_a_broker_that_cannot_prove_its_name_gets_nothing() {
    let bench = Bench::new();
    let Some((key, certificate)) = bench.certificate("broker") else { return };
    bench.certificate("other").unwrap();
    let Some((_server, port)) = Server::mosquitto_with_tls(&bench.path("mosquitto"), &key, &certificate) else {
        return;
    };
    let sink = format!(
        "[[sink]]\nkind = \"mqtt\"\nhost = \"localhost\"\nport = {port}\ntls = true\nca_file = \"other.pem\"\nspool = \"spool\"\n"
    );
    let config = configure(&bench, &bench.path("log"), "10.0", &sink);
    let mut child = start(&config);
    let of_sink = || status(&bench)?.sinks.into_iter().find(|sink| sink.name == "mqtt");
    let waiting = || of_sink().filter(|sink| figure(sink, "waiting") > Some(50));
    let sink = wait_for(LIMIT, waiting).expect("letters wait");
    assert_eq!(figure(&sink, "confirmed"), Some(0), "{sink:?}");
    assert!(sink.detail.contains("certificate"), "{}", sink.detail);
    signal(&child, "TERM");
    assert_eq!(
        ended_within(&mut child, Duration::from_secs(5)).and_then(|s| s.code()),
        Some(0),
        "{}",
        said(&mut child)
    );
}

#[test]
fn conform_alarms_go_over_tls() {
    let bench = Bench::new();
    let Some((key, certificate)) = bench.certificate("receiver") else { return };
    bench.baseline();
    let port = free_port();
    let mut receiver = Command::new("openssl")
        .args(["s_server", "-quiet", "-accept", &port.to_string(), "-key", text(&key), "-cert", text(&certificate)])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let url = format!("https://localhost:{port}/alarms");
    let further = format!("[[sink]]\nkind = \"webhook\"\nurl = \"{url}\"\nca_file = \"receiver.pem\"\n");
    let config = configure(&bench, &bench.path("log"), "20.0", &further);
    let service = std::fs::read_to_string(&config).unwrap();
    let service = service.replace("file = \"bench.toml\"\n", "file = \"bench.toml\"\nbaseline = \"baseline.json\"\n");
    let fault = "fault = { after_secs = 0.0, stage = \"stage1\", percent = [0.0, 0.0, 0.0, 0.0, 25.0] }\n[[sink]]";
    std::fs::write(&config, service.replacen("[[sink]]", fault, 1)).unwrap();
    let mut child = start(&config);
    let (mut stdout, mut heard) = (receiver.stdout.take().unwrap(), Vec::new());
    while !String::from_utf8_lossy(&heard).contains("\"text\"") {
        let mut piece = [0; 4096];
        let count = stdout.read(&mut piece).unwrap();
        assert!(count > 0, "the receiver has ended");
        heard.extend(&piece[..count]);
    }
    assert!(heard.starts_with(b"POST /alarms "), "{}", String::from_utf8_lossy(&heard));
    let answer = b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n";
    receiver.stdin.as_mut().unwrap().write_all(answer).unwrap();
    let posted = || figure(status(&bench)?.sinks.iter().find(|sink| sink.name == "webhook")?, "posted");
    assert!(wait_for(LIMIT, || posted().filter(|&count| count >= 1)).is_some(), "the alarm counts as taken");
    signal(&child, "TERM");
    assert_eq!(
        ended_within(&mut child, Duration::from_secs(5)).and_then(|s| s.code()),
        Some(0),
        "{}",
        said(&mut child)
    );
    receiver.kill().unwrap();
    receiver.wait().unwrap();
}
