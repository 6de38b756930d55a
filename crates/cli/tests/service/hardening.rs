//! What attacks and broken ends once did to the service: each must be told, and none may end the
//! watch.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use gearwatch_alarm::Severity;
use gearwatch_daemon::snapshot::Snapshot;
use gearwatch_log::Disk;

use super::fixture::{Bench, gearwatch, output, stderr, stdout, text};

const PATIENCE: Duration = Duration::from_secs(60);

/// A service that runs; ended when the value goes.
struct Running {
    child: Child,
    said: std::sync::Arc<std::sync::Mutex<String>>,
}

impl Running {
    fn start(mut command: Command) -> Self {
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let said = std::sync::Arc::<std::sync::Mutex<String>>::default();
        let (stderr, kept) = (child.stderr.take().unwrap(), said.clone());
        std::thread::spawn(move || {
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                kept.lock().unwrap().push_str(&format!("{line}\n"));
            }
        });
        Self { child, said }
    }

    fn said(&self) -> String {
        self.said.lock().unwrap().clone()
    }

    fn wait_for_words(&self, words: &str) -> String {
        wait_for(words, || self.said().lines().find(|line| line.contains(words)).map(str::to_owned))
    }

    fn signal(&self, name: &str) {
        let sent = Command::new("kill").args([&format!("-{name}"), &self.child.id().to_string()]).status();
        assert!(sent.unwrap().success());
    }

    fn end(&mut self, name: &str) -> Option<i32> {
        self.signal(name);
        wait_for("the end", || self.child.try_wait().unwrap()).code()
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn wait_for<T>(what: &str, mut wanted: impl FnMut() -> Option<T>) -> T {
    let end = Instant::now() + PATIENCE;
    loop {
        if let Some(found) = wanted() {
            return found;
        }
        assert!(Instant::now() < end, "no {what} after {PATIENCE:?}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn run(config: &Path) -> Running {
    let mut command = gearwatch(&["run", "--config", text(config)]);
    command.env("GEARWATCH_LOG", "info");
    Running::start(command)
}

/// A service file: the test signal at twenty times its speed, with these further keys.
fn service(bench: &Bench, name: &str, service: &str, fault: &str, further: &str) -> std::path::PathBuf {
    bench.write(
        name,
        &format!(
            "format = \"gearwatch-service/1\"\nservice = {{ workers = 2, status_socket = \"status.sock\", {service} }}\n\
             [[bench]]\nfile = \"bench.toml\"\nbaseline = \"baseline.json\"\n\
             [[bench.source]]\nkind = \"test_signal\"\nspeed = 20.0\n{fault}\n{further}"
        ),
    )
}

fn snapshot(bench: &Bench) -> Option<Snapshot> {
    let mut stream = std::os::unix::net::UnixStream::connect(bench.path("status.sock")).ok()?;
    stream.set_read_timeout(Some(Duration::from_secs(5))).ok()?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).ok()?;
    serde_json::from_str(&answer).ok()
}

fn free_port() -> u16 {
    std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

/// Status and body of a request.
fn ask(port: u16, method: &str, path: &str, body: &str) -> Option<(u16, String)> {
    let mut stream = TcpStream::connect(("127.0.0.1", port)).ok()?;
    stream.set_read_timeout(Some(Duration::from_secs(5))).ok()?;
    let length = body.len();
    let head = format!(
        "{method} {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\nContent-Type: application/json\r\nContent-Length: {length}\r\n\r\n"
    );
    stream.write_all(head.as_bytes()).and_then(|()| stream.write_all(body.as_bytes())).ok()?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).ok()?;
    let status = answer.split(' ').nth(1)?.parse().ok()?;
    Some((status, answer.split_once("\r\n\r\n").map(|(_, body)| body.to_owned()).unwrap_or_default()))
}

/// The new configuration names a log folder that cannot be made; then one that another process
/// owns, which only opening it shows. The old configuration goes on both times, and a good one
/// still takes over.
#[test]
fn regress_a_reload_whose_sink_cannot_open_does_not_end_the_watch() {
    let bench = Bench::new();
    bench.baseline();
    let log = |folder: &str| format!("[[sink]]\nkind = \"mcap_log\"\nfolder = \"{folder}\"\n");
    let path = service(&bench, "service.toml", "self_test = false", "", &log("log"));
    let mut running = run(&path);
    wait_for("answer", || snapshot(&bench).filter(|s| s.benches.iter().any(|b| b.windows_judged > 0)));

    service(&bench, "service.toml", "self_test = false", "", &log("bench.toml/log"));
    let checked = output(&["config", "check", text(&path)]);
    assert_ne!(checked.status.code(), Some(0), "{}", stdout(&checked));
    running.signal("HUP");
    running.wait_for_words("the new configuration is not used, the old one goes on");

    let foreign = Disk::open(&bench.path("foreign")).unwrap();
    service(&bench, "service.toml", "self_test = false", "", &log("foreign"));
    running.signal("HUP");
    running.wait_for_words("cannot start, the old one goes on");
    wait_for("ranks", || snapshot(&bench).filter(|s| s.ok && s.benches.iter().any(|b| b.windows_judged > 0)));
    drop(foreign);
    running.signal("HUP");
    wait_for("the other log", || {
        std::fs::read_dir(bench.path("foreign"))
            .unwrap()
            .flatten()
            .any(|e| e.path().extension().is_some())
            .then_some(())
    });
    assert_eq!(running.end("TERM"), Some(0), "{}", running.said());
}

/// What lies at the path of the status socket is somebody's file: it stays, `config check` says so,
/// and ranks go on without the socket.
#[test]
fn regress_a_file_in_place_of_the_status_socket_stays() {
    let bench = Bench::new();
    bench.baseline();
    bench.write("status.sock", "a baseline that took a day");
    let path = service(&bench, "service.toml", "self_test = false", "", "");
    let checked = output(&["config", "check", text(&path)]);
    assert!(checked.status.code() != Some(0) && stderr(&checked).contains("no socket"), "{}", stderr(&checked));
    let mut running = run(&path);
    running.wait_for_words("no status socket");
    running.end("TERM");
    assert_eq!(std::fs::read_to_string(bench.path("status.sock")).unwrap(), "a baseline that took a day");
}

#[test]
fn regress_two_benches_of_one_name_are_refused() {
    let bench = Bench::new();
    std::fs::copy(bench.path("bench.toml"), bench.path("copy.toml")).unwrap();
    let signal = "[[bench.source]]\nkind = \"test_signal\"\n";
    let path = bench.write(
        "service.toml",
        &format!("format = \"gearwatch-service/1\"\n[[bench]]\nfile = \"bench.toml\"\n{signal}[[bench]]\nfile = \"copy.toml\"\n{signal}"),
    );
    let checked = output(&["config", "check", text(&path)]);
    assert_eq!(checked.status.code(), Some(3), "{}", stdout(&checked));
    assert!(stderr(&checked).contains("two benches are called \"small\""), "{}", stderr(&checked));
}

/// A critical alarm is acknowledged by somebody with a reason; the other one waits. The service is
/// killed, and started again on a bench that is all right: the one that nobody saw still stands,
/// and the log says who saw the first, when and why.
#[test]
fn regress_alarms_and_who_saw_them_survive_a_kill() {
    let bench = Bench::new();
    bench.baseline();
    let port = free_port();
    let keys = format!("self_test = false, page = \"127.0.0.1:{port}\"");
    let fault = "fault = { after_secs = 0.0, stage = \"stage1\", percent = [0.0, 0.0, 0.0, 0.0, 25.0] }";
    let log = "[[sink]]\nkind = \"mcap_log\"\nfolder = \"log\"\n";
    let path = service(&bench, "service.toml", &keys, fault, log);
    let mut running = run(&path);
    let alarms = wait_for("two critical alarms", || {
        let alarms = snapshot(&bench)?.benches.first()?.alarms.clone();
        (alarms.iter().filter(|alarm| alarm.severity == Severity::Critical).count() == 2).then_some(alarms)
    });
    let (seen, other) = (&alarms[0], &alarms[1]);
    let address = format!("/api/alarms/{}/acknowledge", seen.id.replace('/', "%2F").replace('@', "%40"));
    assert_eq!(ask(port, "POST", &address, "{}").map(|(status, _)| status), Some(400), "nobody said who and why");
    let nameless = r#"{"who": " ", "why": "because"}"#;
    assert_eq!(ask(port, "POST", &address, nameless).map(|(status, _)| status), Some(400));
    let body = r#"{"who": "shift A", "why": "wheel is\nbeing changed"}"#;
    assert_eq!(ask(port, "POST", &address, body).map(|(status, _)| status), Some(204));
    running.wait_for_words("alarm acknowledged");
    // Two groups of the log later it is durable.
    std::thread::sleep(Duration::from_millis(1000));
    running.end("KILL");
    drop(running);

    let path = service(&bench, "service.toml", &keys, "", log);
    let mut again = run(&path);
    let stands = wait_for("the alarms of before", || {
        let alarms = snapshot(&bench)?.benches.first()?.alarms.clone();
        (!alarms.is_empty()).then_some(alarms)
    });
    let of = |id: &str| stands.iter().find(|alarm| alarm.id == id);
    let unseen = of(&other.id).expect("nobody has seen it, so it stands");
    assert_eq!((unseen.since_ns, unseen.severity, unseen.acknowledged), (other.since_ns, Severity::Critical, false));
    assert!(of(&seen.id).is_none_or(|alarm| alarm.acknowledged), "somebody has seen it");
    assert_eq!(again.end("TERM"), Some(0));

    let mut told = Vec::new();
    for entry in std::fs::read_dir(bench.path("log")).unwrap().flatten() {
        if entry.path().extension().is_none_or(|end| end != "mcap") {
            continue;
        }
        let bytes = std::fs::read(entry.path()).unwrap();
        for message in mcap::MessageStream::new(&bytes).unwrap().flatten() {
            if message.channel.topic == "/alarm" {
                told.push(serde_json::from_slice::<serde_json::Value>(&message.data).unwrap());
            }
        }
    }
    let record = told.iter().find(|record| record["event"] == "acknowledged").expect("the log says who has seen it");
    assert_eq!((&record["who"], &record["why"]), (&"shift A".into(), &"wheel is being changed".into()));
    assert!(record["from"].as_str().unwrap().starts_with("127.0.0.1:"), "{record}");
    assert!(record["acknowledged_ns"].as_i64().is_some_and(|t| t > 1_700_000_000_000_000_000), "{record}");
}

/// Standard output leads to a full disk: every window that is not there is counted, and the exit
/// code says so.
#[test]
fn regress_windows_that_standard_output_did_not_take_are_counted() {
    let Ok(full) = std::fs::OpenOptions::new().write(true).open("/dev/full") else { return };
    let bench = Bench::new();
    let recording = bench.healthy();
    let ended = gearwatch(&["replay", text(&recording), "--bench", text(&bench.path("bench.toml")), "--speed", "max"])
        .stdout(full)
        .stderr(Stdio::piped())
        .output()
        .unwrap();
    let said = stderr(&ended);
    assert_eq!(ended.status.code(), Some(3), "{said}");
    let lost = said.lines().find(|line| line.contains("lost=")).unwrap_or_else(|| panic!("{said}"));
    let lost: u64 = lost.split("lost=").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    let all = gearwatch(&["replay", text(&recording), "--bench", text(&bench.path("bench.toml")), "--speed", "max"]);
    let mut all = all;
    let windows = stdout(&all.stderr(Stdio::null()).output().unwrap()).lines().count() as u64;
    assert_eq!(lost, windows, "{said}");
}

/// Three hundred connections that say nothing, in a process that may hold a hundred: the log goes
/// on rotating, the status answers, and after the deadline of the idle ones so does the page.
#[test]
fn regress_idle_connections_do_not_take_the_log() {
    let bench = Bench::new();
    bench.baseline();
    let port = free_port();
    let keys = format!("self_test = false, page = \"127.0.0.1:{port}\"");
    let log = "[[sink]]\nkind = \"mcap_log\"\nfolder = \"log\"\nrotate_secs = 1\n";
    let path = service(&bench, "service.toml", &keys, "", log);
    let direct = gearwatch(&["run", "--config", text(&path)]);
    let mut limited = Command::new("sh");
    limited.args(["-c", "ulimit -n 100; exec \"$0\" \"$@\""]).arg(direct.get_program()).args(direct.get_args());
    let mut running = Running::start(limited);
    wait_for("page", || ask(port, "GET", "/metrics", ""));
    let idle: Vec<TcpStream> = (0..300).filter_map(|_| TcpStream::connect(("127.0.0.1", port)).ok()).collect();
    assert!(idle.len() > 60, "only {} connections: nothing was attacked", idle.len());
    let files = || std::fs::read_dir(bench.path("log")).unwrap().count();
    let before = files();
    wait_for("rotation", || (files() >= before + 3).then_some(()));
    // On a busy machine a sync may take its two seconds once: what counts is that the log comes to
    // be all right while the connections idle.
    wait_for("a log that is all right", || snapshot(&bench).filter(|s| s.sinks.iter().all(|sink| sink.ok)));
    wait_for("metrics beside the idle ones", || ask(port, "GET", "/metrics", "").filter(|(status, _)| *status == 200));
    drop(idle);
    assert!(running.said().contains("too many connections"));
    assert_eq!(running.end("TERM"), Some(0));
}

/// Passwords in addresses are refused with what to do, and repeated nowhere; an address that is
/// itself a secret stands in a file, and is shown nowhere.
#[test]
fn regress_secrets_are_shown_nowhere() {
    let bench = Bench::new();
    bench.baseline();
    let cases = [
        ("kind = \"nats\"\nservers = [\"nats://bench:hunter2x@127.0.0.1:4222\"]", "secret_file"),
        ("kind = \"webhook\"\nurl = \"https://bench:hunter2x@127.0.0.1/alarms\"", "url_file"),
        ("kind = \"webhook\"\nurl = \"https://127.0.0.1/alarms?key=hunter2x\"", "url_file"),
        ("kind = \"webhook\"\nurl = \"https://127.0.0.1/services/T0/hunter2xhunter2xhunter2x\"", "url_file"),
    ];
    for (sink, remedy) in cases {
        let path = service(&bench, "bad.toml", "self_test = false", "", &format!("[[sink]]\n{sink}\n"));
        for command in [&["config", "check"][..], &["config", "show"], &["run", "--config"]] {
            let ended = output(&[command, &[text(&path)]].concat());
            let said = format!("{}{}", stdout(&ended), stderr(&ended));
            assert!(ended.status.code() == Some(3) && said.contains(remedy), "{command:?}: {said}");
            assert!(!said.contains("hunter2x"), "{command:?}: {said}");
        }
    }
    let port = free_port();
    bench.write("hook", &format!("http://127.0.0.1:{}/services/hunter2xhunter2xhunter2x\n", free_port()));
    let fault = "fault = { after_secs = 0.0, stage = \"stage1\", percent = [0.0, 0.0, 0.0, 0.0, 25.0] }";
    let keys = format!("self_test = false, page = \"127.0.0.1:{port}\"");
    let hook = "[[sink]]\nkind = \"webhook\"\nurl_file = \"hook\"\n[[sink]]\nkind = \"mcap_log\"\nfolder = \"log\"\n";
    let path = service(&bench, "service.toml", &keys, fault, hook);
    let mut running = run(&path);
    running.wait_for_words("an alarm waits");
    let seen = [
        running.said(),
        stdout(&output(&["config", "show", text(&path)])),
        serde_json::to_string(&snapshot(&bench).unwrap()).unwrap(),
        ask(port, "GET", "/metrics", "").unwrap().1,
    ];
    for text in seen {
        assert!(!text.contains("hunter2x"), "{text}");
    }
    running.end("TERM");
    for entry in std::fs::read_dir(bench.path("log")).unwrap().flatten() {
        let bytes = std::fs::read(entry.path()).unwrap();
        for attachment in mcap::Summary::read(&bytes).ok().flatten().map(|s| s.attachment_indexes).unwrap_or_default() {
            let data = mcap::read::attachment(&bytes, &attachment).unwrap().data;
            assert!(!String::from_utf8_lossy(&data).contains("hunter2x"), "{}", attachment.name);
        }
    }
}
