//! MQTT: mosquitto is killed and comes back; the same letters reach MQTT clients of a NATS server.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use gearwatch_daemon::fleet::Heard;
use rumqttc::{Client, Event, Incoming, MqttOptions, QoS};
use serde_json::Value;

use crate::between::{Sent, listen};
use crate::fixture::Bench;
use crate::nats::{logged, own_part};
use crate::server::{Server, free_port};
use crate::service::{configure, ended_within, figure, said, signal, start, status, wait_for};

/// Subscribes to everything of gearwatch, again after each loss of the connection: (topic, sent by
/// the broker itself, letter). A session that the broker keeps: it sends what is retained at a new
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

/// The service is judged by what it publishes and what the broker confirms, letter by letter; the
/// watcher by what the broker confirmed. A broker that is killed loses what it has confirmed and
/// not yet saved (mosquitto saves each 20 changes): how much of that the watcher had got depends on
/// the load of the machine.
#[test]
fn conform_a_killed_mqtt_broker_costs_nothing() {
    let bench = Bench::new();
    let Some(mut server) = Server::mosquitto(&bench.path("mosquitto")) else { return };
    let heard = subscribe(server.port, "watcher");
    std::thread::sleep(Duration::from_millis(300));
    let folder = bench.path("log");
    let (port, between) = listen(server.port);
    let sink = format!("[[sink]]\nkind = \"mqtt\"\nport = {port}\nspool = \"spool\"\n");
    let config = configure(&bench, &folder, "20.0", &sink);
    let mut child = start(&config);
    let limit = Duration::from_secs(40);
    let confirmed = |least: u64| mqtt_figure(&bench, "confirmed").filter(|&count| count >= least);
    wait_for(limit, || confirmed(50)).expect("letters go out");
    let mut kills = Vec::new();
    for _ in 0..2 {
        server.kill();
        wait_for(limit, || mqtt_figure(&bench, "waiting").filter(|&count| count > 100)).expect("letters wait");
        let before = mqtt_figure(&bench, "confirmed").unwrap();
        // What was confirmed until now came from the broker that was killed.
        kills.push(Instant::now());
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
    let logged = logged(&folder, "small");
    let between = between.lock().unwrap();
    let confirmed = judge_service(&between, &logged);
    let arrived: BTreeSet<u64> =
        all.iter().filter_map(|(_, _, payload)| Heard::read(0, payload)).map(|l| seq(&l)).collect();
    let lost: Vec<_> = confirmed.iter().filter(|(seq, _)| !arrived.contains(seq)).collect();
    for (seq, when) in &lost {
        assert!(
            kills.iter().any(|kill| *when <= kill),
            "letter {seq} never came, and no broker was killed after it was confirmed"
        );
    }
    println!("{} letters confirmed, {} of them lost by the broker that was killed", confirmed.len(), lost.len());
    for letter in all.iter().filter_map(|(_, _, payload)| Heard::read(0, payload)) {
        if letter.text("kind") == "verdict" {
            let window = letter.object["window"].as_u64().unwrap();
            let key = (letter.text("bench").to_owned(), letter.text("channel").to_owned(), window);
            assert_eq!(logged.get(&key), Some(&own_part(&letter)), "the watcher has what the log has");
        }
    }
    let online = all.iter().filter(|(topic, ..)| topic.starts_with("gearwatch/_service/")).count();
    assert!(online >= 1, "the service says that it is there");
}

fn seq(letter: &Heard) -> u64 {
    letter.object["seq"].as_u64().unwrap()
}

/// Every letter was published in order without a hole, again only with a mark, and confirmed, but
/// for the newest ones, which may be left in the spool; every verdict of the log is among them.
/// Gives the numbers that were confirmed, and when.
fn judge_service(between: &[Sent], logged: &BTreeMap<(String, String, u64), Value>) -> BTreeMap<u64, Instant> {
    let (mut verdicts, mut published, mut confirmed) = (BTreeMap::new(), BTreeSet::new(), BTreeMap::new());
    for sent in between {
        let (letter, seq) = (&sent.letter, seq(&sent.letter));
        if published.insert(seq) {
            assert_eq!(seq, published.len() as u64, "letters go out in order without a hole");
        } else {
            assert!(letter.object["resent"] == true, "a repetition without a mark: {letter:?}");
        }
        confirmed.extend(sent.confirmed.map(|when| (seq, when)));
        if letter.text("kind") == "verdict" {
            let window = letter.object["window"].as_u64().unwrap();
            let key = (letter.text("bench").to_owned(), letter.text("channel").to_owned(), window);
            verdicts.insert(key, (seq, own_part(letter)));
        }
    }
    let last = confirmed.keys().next_back().copied().unwrap_or(0);
    assert_eq!(confirmed.len() as u64, last, "a letter was not confirmed, and a later one was");
    let mut left = 0;
    for (key, object) in logged {
        match verdicts.get(key) {
            Some((seq, letter)) => {
                assert_eq!(letter, object, "the letter is what the log has");
                left += usize::from(*seq > last);
            }
            None => left += 1,
        }
    }
    // At the end a connected broker gets a second; the rest waits on disk for the next start.
    assert!(left * 4 < logged.len(), "{left} of {} verdicts are left in the spool", logged.len());
    confirmed
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
