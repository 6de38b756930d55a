//! MQTT: mosquitto is killed and comes back; the same letters reach MQTT clients of a NATS server.

use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use gearwatch_daemon::fleet::Heard;
use rumqttc::{Client, Event, Incoming, MqttOptions, QoS};

use crate::fixture::Bench;
use crate::nats::{logged, verdicts_in_order};
use crate::server::{Server, free_port};
use crate::service::{configure, ended_within, figure, said, signal, start, status, wait_for};

/// Subscribes to everything of gearwatch, again after each loss of the connection: (topic, sent by the broker itself, letter). A session that the broker keeps: it sends what is retained at a new
/// subscription, and what was not confirmed again, which MQTT marks.
fn subscribe(port: u16, id: &str) -> Receiver<(String, bool, Vec<u8>)> {
    let mut options = MqttOptions::new(id, ("127.0.0.1", port));
    options.set_clean_session(false);
    options.set_keep_alive(5);
    let (client, mut connection) = Client::builder(options).capacity(16).build();
    let (sender, receiver) = channel();
    std::thread::spawn(move || {
        for event in connection.iter() {
            match event {
                Ok(Event::Incoming(Incoming::ConnAck(_))) => {
                    client.try_subscribe("gearwatch/#", QoS::AtLeastOnce).unwrap();
                }
                Ok(Event::Incoming(Incoming::Publish(publish))) => {
                    let topic = String::from_utf8(publish.topic.to_vec()).unwrap();
                    if sender.send((topic, publish.retain || publish.dup, publish.payload.to_vec())).is_err() {
                        return;
                    }
                }
                Ok(_) => {}
                Err(_) => std::thread::sleep(Duration::from_millis(20)),
            }
        }
    });
    receiver
}

fn mqtt_figure(bench: &Bench, what: &str) -> Option<u64> {
    figure(status(bench)?.sinks.iter().find(|sink| sink.name == "mqtt")?, what)
}

#[test]
fn conform_a_killed_mqtt_broker_costs_nothing() {
    let bench = Bench::new();
    let Some(mut server) = Server::mosquitto(&bench.path("mosquitto")) else { return };
    let heard = subscribe(server.port, "watcher");
    std::thread::sleep(Duration::from_millis(300));
    let folder = bench.path("log");
    let sink = format!("[[sink]]\nkind = \"mqtt\"\nport = {}\nspool = \"spool\"\n", server.port);
    let config = configure(&bench, &folder, "20.0", &sink);
    let mut child = start(&config);
    let limit = Duration::from_secs(40);
    let confirmed = |least: u64| mqtt_figure(&bench, "confirmed").filter(|&count| count >= least);
    wait_for(limit, || confirmed(50)).expect("letters go out");
    for _ in 0..2 {
        server.kill();
        wait_for(limit, || mqtt_figure(&bench, "waiting").filter(|&count| count > 100)).expect("letters wait");
        let before = mqtt_figure(&bench, "confirmed").unwrap();
        server.restart();
        // The watcher is there first, as a watcher that never left.
        wait_for(limit, || confirmed(before + 150)).expect("letters go out again");
    }
    signal(&child, "TERM");
    assert_eq!(
        ended_within(&mut child, Duration::from_secs(5)).and_then(|s| s.code()),
        Some(0),
        "{}",
        said(&mut child)
    );
    let mut all = Vec::new();
    while let Ok(message) = heard.recv_timeout(Duration::from_secs(2)) {
        all.push(message);
    }
    let letters: Vec<Heard> = all.iter().filter_map(|(_, _, payload)| Heard::read(0, payload)).collect();
    // Once without a mark, and marked from then on.
    let mut first: BTreeMap<(String, u64), bool> = BTreeMap::new();
    for ((_, broker, _), letter) in all.iter().filter(|m| Heard::read(0, &m.2).is_some()).zip(&letters) {
        let id = (letter.text("run").to_owned(), letter.object["seq"].as_u64().unwrap());
        let marked = letter.object["resent"] == true;
        let fresh = first.insert(id, marked).is_none();
        assert!(
            fresh || marked || *broker || letter.text("kind") == "state",
            "a repetition without a mark: {letter:?}"
        );
    }
    let verdicts = verdicts_in_order(&letters);
    let logged = logged(&folder, "small");
    let missing: Vec<_> = logged.keys().filter(|key| !verdicts.contains_key(*key)).collect();
    assert!(missing.is_empty(), "missing at the watcher: {missing:?}");
    assert!(verdicts == logged);
    let online = all.iter().filter(|(topic, ..)| topic.starts_with("gearwatch/_service/")).count();
    assert!(online >= 1, "the service says that it is there");
}

/// One NATS server serves both: the sink publishes to JetStream, MQTT clients subscribe.
#[test]
fn conform_mqtt_clients_of_a_nats_server_see_the_same() {
    let bench = Bench::new();
    let port = free_port();
    let Some(server) = Server::nats(&bench.path("nats"), Some(port)) else { return };
    let heard = subscribe(port, "watcher");
    std::thread::sleep(Duration::from_millis(500));
    let folder = bench.path("log");
    let sink = format!("[[sink]]\nkind = \"nats\"\nservers = [\"{}\"]\nspool = \"spool\"\n", server.url());
    let config = configure(&bench, &folder, "20.0", &sink);
    let mut child = start(&config);
    std::thread::sleep(Duration::from_secs(3));
    signal(&child, "TERM");
    assert_eq!(ended_within(&mut child, Duration::from_secs(5)).and_then(|s| s.code()), Some(0));
    let mut letters = Vec::new();
    while let Ok((topic, _, payload)) = heard.recv_timeout(Duration::from_secs(2)) {
        if topic.starts_with("gearwatch/small/verdict/stage1/acc_") {
            letters.push(Heard::read(0, &payload).unwrap());
        }
    }
    let seen = letters.len();
    let logged = logged(&folder, "small");
    assert!(seen > 50, "{seen} letters");
    let mut windows: Vec<_> =
        letters.iter().map(|l| (l.text("channel").to_owned(), l.object["window"].as_u64())).collect();
    windows.sort();
    windows.dedup();
    assert_eq!(windows.len(), logged.len(), "each verdict reaches the MQTT client");
}
