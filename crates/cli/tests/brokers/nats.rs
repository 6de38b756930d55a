//! NATS JetStream: the server is killed and comes back, the service is killed and comes back;
//! nothing is lost, nothing is counted twice.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use gearwatch_daemon::fleet::{Access, Fleet, From, Heard, Notice, Told, follow};
use serde_json::Value;

use crate::fixture::{Bench, output, stdout};
use crate::server::Server;
use crate::service::{configure, ended_within, figure, files, said, signal, start, status, wait_for};
use gearwatch_testkit::log::content;

/// All letters that the stream holds.
pub fn all_letters(url: &str) -> Vec<Heard> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let mut letters = Vec::new();
    runtime.block_on(async {
        let (sender, mut receiver) = tokio::sync::mpsc::unbounded_channel();
        let access = Access::default();
        let tell = move |notice| drop(sender.send(notice));
        tokio::select! {
            _ = follow(url, &access, "gearwatch", From::Beginning, tell) => {}
            () = async { while let Some(notice) = receiver.recv().await {
                match notice {
                    Notice::Letter(heard) => letters.push(*heard),
                    Notice::CaughtUp => break,
                    Notice::Connected => {}
                    Notice::Lost(error) => panic!("{error}"),
                }
            } } => {}
        }
    });
    letters
}

/// Verdicts by bench, channel and window, as the log has them; several logs of the same bench
/// follow each other.
pub fn logged(folder: &Path, bench: &str) -> BTreeMap<(String, String, u64), Value> {
    let objects =
        content(&files(folder)).verdicts.into_values().map(|data| serde_json::from_slice::<Value>(&data).unwrap());
    let key = |object: &Value| {
        let name = object["bench"].as_str().unwrap_or(bench).to_owned();
        (name, object["channel"].as_str().unwrap().to_owned(), object["window"].as_u64().unwrap())
    };
    objects.map(|object| (key(&object), object)).collect()
}

/// A letter's own part: what stands in the log too.
pub fn own_part(heard: &Heard) -> Value {
    let mut object = heard.object.clone();
    for key in ["resent", "kind", "bench", "run", "seq"] {
        object.shift_remove(key);
    }
    Value::Object(object)
}

/// Letters of each bench and run follow each other without a hole; gives the verdicts.
pub fn verdicts_in_order(letters: &[Heard]) -> BTreeMap<(String, String, u64), Value> {
    let mut fleet = Fleet::default();
    let mut verdicts = BTreeMap::new();
    for heard in letters {
        if fleet.take(heard) == Told::New && heard.text("kind") == "verdict" {
            let window = heard.object["window"].as_u64().unwrap();
            let key = (heard.text("bench").to_owned(), heard.text("channel").to_owned(), window);
            assert!(verdicts.insert(key.clone(), own_part(heard)).is_none(), "{key:?} twice");
        }
    }
    for (name, bench) in &fleet.benches {
        assert_eq!(bench.missing, 0, "{name}: holes in the numbers");
    }
    verdicts
}

fn sink(url: &str) -> String {
    format!("[[sink]]\nkind = \"nats\"\nservers = [\"{url}\"]\nspool = \"spool\"\nheartbeat_secs = 1.0\n")
}

fn nats_figure(bench: &Bench, what: &str) -> Option<u64> {
    figure(status(bench)?.sinks.iter().find(|sink| sink.name == "nats")?, what)
}

#[test]
fn conform_a_killed_server_costs_nothing() {
    let bench = Bench::new();
    let Some(mut server) = Server::nats(&bench.path("nats"), None) else { return };
    let folder = bench.path("log");
    let config = configure(&bench, &folder, "20.0", &sink(&server.url()));
    let mut child = start(&config);
    let limit = Duration::from_secs(30);
    let confirmed = |least: u64| nats_figure(&bench, "confirmed").filter(|&count| count >= least);
    wait_for(limit, || confirmed(50)).expect("letters go out");
    for _ in 0..2 {
        server.kill();
        wait_for(limit, || nats_figure(&bench, "waiting").filter(|&count| count > 100)).expect("letters wait");
        let before = nats_figure(&bench, "confirmed").unwrap();
        server.restart();
        wait_for(limit, || confirmed(before + 150)).expect("letters go out again");
    }
    signal(&child, "TERM");
    assert_eq!(
        ended_within(&mut child, Duration::from_secs(5)).and_then(|s| s.code()),
        Some(0),
        "{}",
        said(&mut child)
    );
    let letters = all_letters(&server.url());
    let verdicts = verdicts_in_order(&letters);
    let logged = logged(&folder, "small");
    let strip = |map: BTreeMap<(String, String, u64), Value>| map;
    assert_eq!(verdicts.len(), logged.len());
    assert!(strip(verdicts) == logged, "what the stream has is not what the log has");
    let last = letters.last().unwrap();
    assert_eq!((last.text("kind"), last.text("service")), ("state", "stopped"), "{last:?}");
    // What was under way when the server died was sent again: the server knew it, or it is marked.
    let mut ids = std::collections::BTreeSet::new();
    for heard in &letters {
        let fresh = ids.insert((heard.text("run").to_owned(), heard.object["seq"].as_u64()));
        assert!(fresh || heard.object["resent"] == true, "a repetition without a mark: {heard:?}");
    }
    let once = output(&["fleet", "--server", &server.url(), "--once"]);
    assert_eq!(once.status.code(), Some(3), "a stopped bench is not all right");
    assert!(stdout(&once).contains("small") && stdout(&once).contains("stopped"), "{}", stdout(&once));
}

/// The service is killed while the server is away: what was spooled goes out after the next start,
/// before what is new, and marked.
#[test]
fn conform_a_killed_service_keeps_its_letters() {
    let bench = Bench::new();
    let Some(mut server) = Server::nats(&bench.path("nats"), None) else { return };
    let config = configure(&bench, &bench.path("log"), "20.0", &sink(&server.url()));
    let limit = Duration::from_secs(30);
    let mut child = start(&config);
    wait_for(limit, || nats_figure(&bench, "confirmed").filter(|&count| count > 20)).expect("letters go out");
    server.kill();
    let waiting = || nats_figure(&bench, "waiting").filter(|&count| count > 150);
    let waited = wait_for(limit, waiting).expect("letters wait");
    child.kill().unwrap();
    child.wait().unwrap();
    let mut child = start(&config);
    wait_for(limit, || nats_figure(&bench, "waiting").filter(|&count| count > waited + 20)).expect("letters wait");
    server.restart();
    wait_for(limit, || nats_figure(&bench, "waiting").filter(|&count| count == 0)).expect("all go out");
    signal(&child, "TERM");
    assert_eq!(ended_within(&mut child, Duration::from_secs(5)).and_then(|s| s.code()), Some(0));
    let letters = all_letters(&server.url());
    let mut runs: BTreeMap<String, Vec<u64>> = BTreeMap::new();
    for heard in &letters {
        runs.entry(heard.text("run").to_owned()).or_default().push(heard.object["seq"].as_u64().unwrap());
    }
    assert_eq!(runs.len(), 2, "two runs of the service");
    for (run, numbers) in &runs {
        let expected: Vec<u64> = (1..=numbers.len() as u64).collect();
        assert_eq!(*numbers, expected, "run {run}: in order, once, without a hole");
    }
    let first = runs.values().next().unwrap().len() as u64;
    assert!(first >= waited, "{first} letters of the first run, {waited} waited");
    // In the stream the runs follow each other, and what the killed service had left is marked.
    let run = |heard: &Heard| heard.text("run").to_owned();
    assert!(letters.windows(2).filter(|pair| run(&pair[0]) != run(&pair[1])).count() == 1, "runs are mixed");
    let marked = letters.iter().filter(|heard| heard.object["resent"] == true).count() as u64;
    assert!(marked >= waited, "{marked} marked, {waited} waited");
}
