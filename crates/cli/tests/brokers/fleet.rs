//! Twenty benches, one server that is killed and comes back, some benches cut off for a while by a
//! cable that is out, some by a line that is up and lets nothing through: every verdict arrives
//! once, in order per bench, and a reader and a page that were there all the time heal by
//! themselves.

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::os::unix::net::UnixStream;
use std::process::Stdio;
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use gearwatch_daemon::fleet::Heard;
use gearwatch_daemon::snapshot::Snapshot;
use serde_json::Value;

use crate::fixture::{BENCH, Bench, gearwatch, text};
use crate::nats::{logged, own_part};
use crate::server::{Server, free_port};
use crate::service::{ended_within, figure, rounds, said, signal, start, wait_for};

/// A cable that can be pulled out, or hold back what is sent.
struct Cable {
    port: u16,
    state: Arc<AtomicU8>,
    open: Arc<Mutex<Vec<TcpStream>>>,
}

const WHOLE: u8 = 0;
const OUT: u8 = 1;
const HOLDING: u8 = 2;

impl Cable {
    fn to(server: u16) -> Self {
        let port = free_port();
        let listener = TcpListener::bind(("127.0.0.1", port)).unwrap();
        let state = Arc::new(AtomicU8::new(WHOLE));
        let open = Arc::new(Mutex::new(Vec::new()));
        let (now, streams) = (state.clone(), open.clone());
        std::thread::spawn(move || {
            for client in listener.incoming().map_while(Result::ok) {
                if now.load(Ordering::Relaxed) == OUT {
                    continue;
                }
                let Ok(server) = TcpStream::connect(("127.0.0.1", server)) else { continue };
                let ends = [client.try_clone().unwrap(), server.try_clone().unwrap()];
                streams.lock().unwrap().extend(ends);
                let back = (server.try_clone().unwrap(), client.try_clone().unwrap());
                for (from, to) in [(client, server), back] {
                    let now = now.clone();
                    std::thread::spawn(move || pump(from, to, &now));
                }
            }
        });
        Self { port, state, open }
    }

    fn pull_out(&self) {
        self.state.store(OUT, Ordering::Relaxed);
        self.open.lock().unwrap().drain(..).for_each(|stream| drop(stream.shutdown(Shutdown::Both)));
    }

    fn hold(&self) {
        self.state.store(HOLDING, Ordering::Relaxed);
    }

    fn mend(&self) {
        self.state.store(WHOLE, Ordering::Relaxed);
    }
}

fn pump(mut from: TcpStream, mut to: TcpStream, state: &AtomicU8) {
    let mut buffer = [0; 8192];
    while let Ok(count) = from.read(&mut buffer) {
        while state.load(Ordering::Relaxed) == HOLDING {
            std::thread::sleep(Duration::from_millis(20));
        }
        if count == 0 || to.write_all(&buffer[..count]).is_err() {
            break;
        }
    }
    let _ = to.shutdown(Shutdown::Both);
}

/// The letters in a reader's output so far.
fn letters(path: &std::path::Path) -> Vec<Heard> {
    let text = std::fs::read_to_string(path).unwrap_or_default();
    let whole = text.rfind('\n').map_or("", |end| &text[..end]);
    whole.lines().map(|line| Heard::read(0, line.as_bytes()).unwrap_or_else(|| panic!("no letter: {line}"))).collect()
}

/// What the page says of all benches.
fn page(port: u16) -> Option<Value> {
    let mut stream = TcpStream::connect(("127.0.0.1", port)).ok()?;
    write!(stream, "GET /api/fleet HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\n\r\n").ok()?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).ok()?;
    serde_json::from_str(answer.split_once("\r\n\r\n")?.1).ok()
}

/// Letters of a service that wait in its spool; `None` while it does not say.
fn waiting(home: &Bench, process: usize) -> Option<u64> {
    let mut answer = String::new();
    let mut stream = UnixStream::connect(home.path(&format!("status-{process}.sock"))).ok()?;
    stream.read_to_string(&mut answer).ok()?;
    let snapshot: Snapshot = serde_json::from_str(&answer).ok()?;
    figure(snapshot.sinks.iter().find(|sink| sink.name == "nats")?, "waiting")
}

/// The configuration of one process, with its share of the benches and a NATS server at a port.
fn written(home: &Bench, process: usize, port: u16) -> std::path::PathBuf {
    let mut config = format!(
        "format = \"gearwatch-service/1\"\nservice = {{ workers = 1, self_test = false, status_socket = \"status-{process}.sock\" }}\n\
         [[sink]]\nkind = \"mcap_log\"\nfolder = \"log-{process}\"\n\
         [[sink]]\nkind = \"nats\"\nservers = [\"nats://127.0.0.1:{port}\"]\nspool = \"spool-{process}\"\n"
    );
    for bench in (process..BENCHES).step_by(PROCESSES) {
        home.write(&format!("bench-{bench}.toml"), &BENCH.replace("\"small\"", &format!("\"bench {bench:02}\"")));
        config += &format!(
            "[[bench]]\nfile = \"bench-{bench}.toml\"\n[[bench.source]]\nkind = \"test_signal\"\nspeed = 4.0\nseed = {bench}\n"
        );
    }
    home.write(&format!("service-{process}.toml"), &config)
}

/// Benches in so many processes.
const PROCESSES: usize = 4;
const BENCHES: usize = 20;

#[test]
fn conform_twenty_benches_through_a_killed_server_and_a_cut_cable() {
    let home = Bench::new();
    let Some(mut server) = Server::nats(&home.path("nats"), None) else { return };
    let (cable, line) = (Cable::to(server.port), Cable::to(server.port));
    // A campaign cuts for a minute.
    let outage = Duration::from_secs(if rounds(0) > 0 { 60 } else { 5 });
    let mut services = Vec::new();
    for process in 0..PROCESSES {
        let port = [cable.port, line.port].get(process).copied().unwrap_or(server.port);
        services.push(start(&written(&home, process, port)));
    }
    let heard = home.path("heard.jsonl");
    let url = server.url();
    let page_port = free_port();
    let page_at = format!("--page=127.0.0.1:{page_port}");
    let mut reader = gearwatch(&["fleet", "--server", &url, "--format", "json", &page_at])
        .stdout(Stdio::from(std::fs::File::create(&heard).unwrap()))
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let limit = Duration::from_secs(60);
    let all_heard = || {
        let letters = letters(&heard);
        let benches: std::collections::BTreeSet<_> = letters.iter().map(|l| l.text("bench").to_owned()).collect();
        (benches.len() == BENCHES && letters.len() > 200).then_some(letters.len())
    };
    wait_for(limit, all_heard).expect("all benches are heard");
    cable.pull_out();
    line.hold();
    std::thread::sleep(outage / 2);
    server.kill();
    std::thread::sleep(outage / 2);
    server.restart();
    let count = letters(&heard).len();
    let restarted = Instant::now();
    wait_for(limit, || (letters(&heard).len() > count + 100).then_some(())).expect("the reader heals by itself");
    let healed = restarted.elapsed();
    cable.mend();
    line.mend();
    // The benches that were cut off catch up, after the half minute at most that a service waits
    // between two tries and the ten seconds that a line which lets nothing through costs it.
    let mended = Instant::now();
    let nothing_waits = || (0..PROCESSES).all(|process| waiting(&home, process) == Some(0)).then_some(());
    wait_for(Duration::from_secs(120), nothing_waits).expect("what waited goes out");
    let caught_up = mended.elapsed();
    for child in &services {
        signal(child, "TERM");
    }
    for child in &mut services {
        let status = ended_within(child, Duration::from_secs(10));
        assert_eq!(status.and_then(|status| status.code()), Some(0), "{}", said(child));
    }
    let stopped = || {
        let last = letters(&heard);
        let stopped = last.iter().filter(|l| l.text("kind") == "state" && l.text("service") == "stopped").count();
        (stopped == BENCHES).then_some(())
    };
    wait_for(limit, stopped).expect("the last letter of every bench is heard");
    std::thread::sleep(Duration::from_secs(2));
    let page = page(page_port).expect("the page answers");
    signal(&reader, "TERM");
    reader.wait().unwrap();

    let mut truth: BTreeMap<(String, String, u64), Value> = BTreeMap::new();
    for process in 0..PROCESSES {
        truth.extend(logged(&home.path(&format!("log-{process}")), ""));
    }
    truth.values_mut().for_each(|object| drop(object.as_object_mut().unwrap().shift_remove("bench")));
    let mut next: BTreeMap<(String, String), u64> = BTreeMap::new();
    let mut verdicts: BTreeMap<(String, String, u64), Value> = BTreeMap::new();
    let letters = letters(&heard);
    for heard in &letters {
        let seq = heard.object["seq"].as_u64().unwrap();
        let expected = next.entry((heard.text("bench").to_owned(), heard.text("run").to_owned())).or_insert(1);
        assert_eq!(seq, *expected, "{}: in order, once, without a hole", heard.text("bench"));
        *expected += 1;
        if heard.text("kind") == "verdict" {
            let window = heard.object["window"].as_u64().unwrap();
            let key = (heard.text("bench").to_owned(), heard.text("channel").to_owned(), window);
            assert!(verdicts.insert(key, own_part(heard)).is_none());
        }
    }
    let again = letters.iter().filter(|l| l.object["resent"] == true).count();
    println!(
        "{BENCHES} benches, {} letters, {} verdicts, {again} of them marked as resent; reader back {healed:.1?} after the server, all \
         benches caught up {caught_up:.1?} after the lines; file {}",
        letters.len(),
        verdicts.len(),
        text(&heard)
    );
    assert_eq!(verdicts.len(), truth.len());
    assert!(verdicts == truth, "what was heard is not what the logs hold");
    let benches = page["benches"].as_object().unwrap();
    assert_eq!((benches.len(), &page["link"]), (BENCHES, &Value::from("live")));
    for (name, bench) in benches {
        let own = truth.keys().filter(|(of, ..)| of == name).count();
        assert_eq!((&bench["verdicts"], &bench["missing"]), (&own.into(), &0.into()), "{name} on the page");
        assert!(!bench["past"].as_object().unwrap().is_empty(), "{name} has a past");
    }
}
