//! Twenty benches, one server that is killed and comes back, some benches cut off for a while: every verdict arrives once, in order per bench, and
//! a reader that was there all the time heals by itself.

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::process::Stdio;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use gearwatch_daemon::fleet::Heard;
use serde_json::Value;

use crate::fixture::{BENCH, Bench, gearwatch, text};
use crate::nats::{logged, own_part};
use crate::server::{Server, free_port};
use crate::service::{ended_within, rounds, said, signal, start, wait_for};

/// A cable that can be pulled out.
struct Cable {
    port: u16,
    cut: Arc<AtomicBool>,
    open: Arc<Mutex<Vec<TcpStream>>>,
}

impl Cable {
    fn to(server: u16) -> Self {
        let port = free_port();
        let listener = TcpListener::bind(("127.0.0.1", port)).unwrap();
        let cut = Arc::new(AtomicBool::new(false));
        let open = Arc::new(Mutex::new(Vec::new()));
        let (is_cut, streams) = (cut.clone(), open.clone());
        std::thread::spawn(move || {
            for client in listener.incoming().map_while(Result::ok) {
                if is_cut.load(Ordering::Relaxed) {
                    continue;
                }
                let Ok(server) = TcpStream::connect(("127.0.0.1", server)) else { continue };
                let ends = [client.try_clone().unwrap(), server.try_clone().unwrap()];
                streams.lock().unwrap().extend(ends);
                let back = (server.try_clone().unwrap(), client.try_clone().unwrap());
                for (from, to) in [(client, server), back] {
                    std::thread::spawn(move || pump(from, to));
                }
            }
        });
        Self { port, cut, open }
    }

    fn pull_out(&self) {
        self.cut.store(true, Ordering::Relaxed);
        self.open.lock().unwrap().drain(..).for_each(|stream| drop(stream.shutdown(Shutdown::Both)));
    }

    fn plug_in(&self) {
        self.cut.store(false, Ordering::Relaxed);
    }
}

fn pump(mut from: TcpStream, mut to: TcpStream) {
    let mut buffer = [0; 8192];
    while let Ok(count) = from.read(&mut buffer) {
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

/// Benches in so many processes.
const PROCESSES: usize = 4;
const BENCHES: usize = 20;

#[test]
fn conform_twenty_benches_through_a_killed_server_and_a_cut_cable() {
    let home = Bench::new();
    let Some(mut server) = Server::nats(&home.path("nats"), None) else { return };
    let cable = Cable::to(server.port);
    // A campaign cuts for a minute.
    let outage = Duration::from_secs(if rounds(0) > 0 { 60 } else { 5 });
    let mut services = Vec::new();
    for process in 0..PROCESSES {
        let port = if process == 0 { cable.port } else { server.port };
        let mut config = format!(
            "format = \"gearwatch-service/1\"\nservice = {{ workers = 1, self_test = false }}\n\
             [[sink]]\nkind = \"mcap_log\"\nfolder = \"log-{process}\"\n\
             [[sink]]\nkind = \"nats\"\nservers = [\"nats://127.0.0.1:{port}\"]\nspool = \"spool-{process}\"\n"
        );
        for bench in (process..BENCHES).step_by(PROCESSES) {
            home.write(&format!("bench-{bench}.toml"), &BENCH.replace("\"small\"", &format!("\"bench {bench:02}\"")));
            config += &format!(
                "[[bench]]\nfile = \"bench-{bench}.toml\"\n[[bench.source]]\nkind = \"test_signal\"\nspeed = 4.0\nseed = {bench}\n"
            );
        }
        let path = home.write(&format!("service-{process}.toml"), &config);
        services.push(start(&path));
    }
    let heard = home.path("heard.jsonl");
    let url = server.url();
    let mut reader = gearwatch(&["fleet", "--server", &url, "--format", "json"])
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
    std::thread::sleep(outage / 2);
    server.kill();
    std::thread::sleep(outage / 2);
    server.restart();
    let count = letters(&heard).len();
    let restarted = Instant::now();
    wait_for(limit, || (letters(&heard).len() > count + 100).then_some(())).expect("the reader heals by itself");
    let healed = restarted.elapsed();
    cable.plug_in();
    // The benches that were cut off catch up: nothing waits any more when their last letters are there.
    std::thread::sleep(Duration::from_secs(8));
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
        "{BENCHES} benches, {} letters, {} verdicts, {again} of them marked as resent; reader back {healed:.1?} after the server; file {}",
        letters.len(),
        verdicts.len(),
        text(&heard)
    );
    assert_eq!(verdicts.len(), truth.len());
    assert!(verdicts == truth, "what was heard is not what the logs hold");
}
