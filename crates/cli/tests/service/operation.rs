//! A service in operation: status, metrics, the log, reload.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::os::unix::fs::MetadataExt;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use super::fixture::{Bench, gearwatch, output, stderr, stdout, text};

fn signal(child: &Child, name: &str) {
    let sent = Command::new("kill").args([&format!("-{name}"), &child.id().to_string()]).status();
    assert!(sent.unwrap().success());
}

/// Lines of the service's talk, as they come.
fn talk(child: &mut Child) -> impl FnMut(&str) -> String + use<> {
    let (sender, lines) = std::sync::mpsc::channel();
    let stderr = child.stderr.take().unwrap();
    std::thread::spawn(move || {
        BufReader::new(stderr).lines().map_while(Result::ok).for_each(|line| drop(sender.send(line)))
    });
    move |part| {
        let end = Instant::now() + Duration::from_secs(20);
        while let Ok(line) = lines.recv_timeout(end.saturating_duration_since(Instant::now())) {
            if line.contains(part) {
                return line;
            }
        }
        panic!("{part:?} was not said")
    }
}

fn request(address: &str, host: &str, path: &str) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer
}

/// A service that is started: the process, and what it says.
fn spawned(config: &std::path::Path) -> (Child, impl FnMut(&str) -> String + use<>) {
    let mut child = gearwatch(&["run", "--config", text(config)])
        .env("GEARWATCH_LOG", "info")
        .stderr(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let said = talk(&mut child);
    (child, said)
}

/// A service with a page: the process, what it says, and the page's address.
fn started(bench: &Bench, config: &str) -> (Child, impl FnMut(&str) -> String + use<>, String) {
    let (child, mut said) = spawned(&bench.write("service.toml", config));
    let page = said("metrics at http://");
    let address = page.rsplit("http://").next().unwrap().trim_end_matches("/metrics").to_owned();
    (child, said, address)
}

/// One service at fifty times the speed, with a fault from the beginning: alarm in status and
/// metrics, a foreign host refused, a bad reload refused, a good one taken over, the log whole at
/// the end.
#[test]
fn conform_a_service_can_be_watched_reloaded_and_read_afterwards() {
    let bench = Bench::new();
    bench.baseline();
    let config = |seed: u32, further: &str| {
        format!(
            "format = \"gearwatch-service/1\"\n\
             service = {{ workers = 2, page = \"127.0.0.1:0\", status_socket = \"status.sock\" }}\n\
             [[bench]]\nfile = \"bench.toml\"\nbaseline = \"baseline.json\"\n\
             [[bench.source]]\nkind = \"test_signal\"\nspeed = 50.0\nseed = {seed}\n\
             fault = {{ after_secs = 0.0, stage = \"stage1\", percent = [0.0, 5.5, 0.0, 0.0, 20.0] }}\n\
             [[sink]]\nkind = \"mcap_log\"\nfolder = \"log\"\n{further}"
        )
    };
    let (mut child, mut said, address) = started(&bench, &config(1, ""));
    said("alarm=\"stage1@acc_1\"");
    // The first snapshot comes within a second.
    let socket = bench.path("status.sock");
    let end = Instant::now() + Duration::from_secs(10);
    let status = loop {
        let status = output(&["status", "--socket", text(&socket)]);
        if stdout(&status).contains("self test right") || Instant::now() > end {
            break status;
        }
        std::thread::sleep(Duration::from_millis(100));
    };
    assert_eq!(status.status.code(), Some(2), "{}{}", stdout(&status), stderr(&status));
    for part in
        ["all goes on", "self test right", "instrument ok", "ranks 0 II 0 0 V", "alarm small/stage1@acc_1: critical"]
    {
        assert!(stdout(&status).contains(part), "{part}: {}", stdout(&status));
    }
    let metrics = request(&address, &address, "/metrics");
    for part in [
        "HTTP/1.1 200",
        "gearwatch_ok 1",
        "gearwatch_rank{bench=\"small\",stage=\"stage1\",channel=\"acc_1\",harmonic=\"5\"} 5",
        // How many depends on what else the machine does: a live source sheds windows rather than
        // fall behind.
        "gearwatch_windows_shed_total{bench=\"small\"} ",
    ] {
        assert!(metrics.contains(part), "{part}: {metrics}");
    }
    assert!(request(&address, "evil.example", "/metrics").starts_with("HTTP/1.1 403"));
    // A bad configuration is refused and the old one goes on; a good one takes over.
    bench.write("service.toml", &config(2, "no_such_key = 1"));
    signal(&child, "HUP");
    assert!(said("the old one goes on").contains("no_such_key"));
    assert!(output(&["status", "--socket", text(&socket)]).status.code() == Some(2));
    bench.write("service.toml", &config(3, ""));
    signal(&child, "HUP");
    said("takes over");
    said("metrics at http://");
    signal(&child, "TERM");
    assert_eq!(child.wait().unwrap().code(), Some(0));
    // Every file of the log is whole, and holds verdicts with the configuration beside them.
    let files: Vec<_> = std::fs::read_dir(bench.path("log")).unwrap().map(|e| e.unwrap().path()).collect();
    let (mut verdicts, mut reloads) = (0, Vec::new());
    for file in files.iter().filter(|f| f.extension().is_some_and(|e| e == "mcap")) {
        let bytes = std::fs::read(file).unwrap();
        let summary = mcap::Summary::read(&bytes).unwrap().expect("footer and index are there");
        assert!(summary.attachment_indexes.iter().any(|a| a.name == "service.toml"), "{}", file.display());
        for message in mcap::MessageStream::new(&bytes).unwrap() {
            let message = message.unwrap();
            let object = || serde_json::from_slice::<serde_json::Value>(&message.data).unwrap();
            if message.channel.topic == "/gear/stage1/rank" {
                assert_eq!(object()["rank_5x"], "V");
                verdicts += 1;
            } else if message.channel.topic == "/gap" && object()["cause"] == "configuration" {
                reloads.push(object());
            }
        }
    }
    assert!(verdicts > 20, "{verdicts} verdicts in {files:?}");
    // The one reload that took over says for how long nothing was watched; the refused one changed
    // nothing.
    let [reload] = &reloads[..] else { panic!("{reloads:?}") };
    let number = |key: &str| reload[key].as_i64().unwrap();
    let now_ms = i64::try_from(SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_millis()).unwrap();
    assert_eq!((reload["channel"].as_str(), number("count")), (Some("reload"), number("last") - number("first")));
    assert!((0..60_000).contains(&number("count")) && (0..120_000).contains(&(now_ms - number("last"))), "{reload}");
    assert_eq!(number("t_ns") / 1_000_000, number("last"));
    let history = output(&["history", text(&bench.path("log"))]);
    assert!(
        stdout(&history).contains("the configuration was read again; nothing was watched for"),
        "{}",
        stdout(&history)
    );
}

/// What the page is told of a past time is what `gearwatch history` says of it: windows,
/// deviations, an indicator, the alarm among the events.
#[test]
fn oracle_the_page_reads_the_log_as_the_command_does() {
    let bench = Bench::new();
    bench.baseline();
    let start_s = i64::try_from(SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_secs()).unwrap() / 5 * 5;
    let config = format!(
        "format = \"gearwatch-service/1\"\nservice = {{ workers = 2, page = \"127.0.0.1:0\" }}\n\
         [[bench]]\nfile = \"bench.toml\"\nbaseline = \"baseline.json\"\n\
         [[bench.source]]\nkind = \"test_signal\"\nspeed = 20.0\nseed = 4\nfirst_sample_unix_ns = {start_s}000000000\n\
         fault = {{ after_secs = 4.0, stage = \"stage1\", percent = [0.0, 5.5, 0.0, 0.0, 20.0] }}\n\
         [[sink]]\nkind = \"mcap_log\"\nfolder = \"log\"\n"
    );
    let (mut child, mut said, address) = started(&bench, &config);
    said("alarm=\"stage1@acc_1\"");
    // Twenty seconds of the data's time, which pass in one; until they are in the log, they are
    // asked for again.
    let from = start_s;
    let query = format!(
        "/api/history?bench=small&stage=stage1&channel=acc_1&from={from}000000000&to={}000000000&indicator=rms",
        from + 20
    );
    let end = Instant::now() + Duration::from_secs(60);
    let answer = loop {
        let text = request(&address, &address, &query);
        let body = text.split_once("\r\n\r\n").map_or("", |(_, body)| body);
        let answer: serde_json::Value = serde_json::from_str(body).unwrap_or_else(|e| panic!("{e}: {text}"));
        let last = answer["t0_s"].as_array().and_then(|all| all.last()).and_then(serde_json::Value::as_i64);
        if answer["to_read"] == 0 && last == Some(from + 15) {
            break answer;
        }
        assert!(Instant::now() < end, "{answer}");
        std::thread::sleep(Duration::from_millis(500));
    };
    assert!(request(&address, &address, "/api/history?bench=small&stage=a&channel=b&from=2&to=1").contains(" 400 "));
    signal(&child, "TERM");
    assert_eq!(child.wait().unwrap().code(), Some(0));
    let to = gearwatch_history::time::iso((from + 15) * 1_000_000_000);
    let told = output(&["history", text(&bench.path("log")), "--csv", "--every", "5s", "--to", &to]);
    let told = stdout(&told);
    let mut lines = told.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let head = lines.next().unwrap();
    let place = |name: &str| head.iter().position(|n| *n == name).unwrap_or_else(|| panic!("{name}: {head:?}"));
    let rows: Vec<_> = lines.filter(|line| line[place("channel")] == "acc_1").collect();
    assert_eq!(rows.len(), 3, "{told}");
    for (i, row) in rows.iter().enumerate() {
        let same = |name: &str, told: &serde_json::Value| {
            let (a, b): (f64, f64) = (row[place(name)].parse().unwrap(), told.as_f64().unwrap());
            // Six digits are sent.
            assert!((a - b).abs() <= 1e-5 * a.abs(), "{name}: {a} and {b}");
        };
        same("windows", &answer["windows"][i]);
        same("dev_5x_percent", &answer["dev"][4][i]);
        same("amp_2x", &answer["amp"][1][i]);
        same("rms", &answer["indicator"][i]);
        assert_eq!(row[place("level_5x")], answer["level"][4][i].to_string());
        assert_eq!(row[place("machine")], answer["machine"][i].as_str().unwrap());
    }
    let kinds: Vec<_> = answer["events"].as_array().unwrap().iter().filter_map(|e| e["kind"].as_str()).collect();
    assert!(kinds.contains(&"alarm"), "{answer}");
}

#[test]
fn conform_a_page_that_others_can_reach_is_refused() {
    let bench = Bench::new();
    let config = "format = \"gearwatch-service/1\"\nservice = { page = \"0.0.0.0:8650\" }\n[[bench]]\nfile = \"bench.toml\"\n\
                  [[bench.source]]\nkind = \"test_signal\"\n";
    let path = bench.write("service.toml", config);
    let refused = output(&["run", "--config", text(&path)]);
    assert_eq!(refused.status.code(), Some(3));
    assert!(stderr(&refused).contains("loopback"), "{}", stderr(&refused));
}

/// With a certificate and a token the page may be reached by others, and by nobody without the
/// token.
#[test]
fn conform_a_page_with_tls_asks_for_the_token() {
    let bench = Bench::new();
    let Some((_, certificate)) = bench.certificate("page") else { return };
    if Command::new("curl").arg("--version").output().is_err() {
        eprintln!("skipped: curl is not installed");
        return;
    }
    bench.write("token", "a token of some length\n");
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let service = |page: &str| {
        format!(
            "format = \"gearwatch-service/1\"\n[service]\nself_test = false\npage = \"0.0.0.0:{port}\"\n{page}\n\
             [[bench]]\nfile = \"bench.toml\"\n[[bench.source]]\nkind = \"test_signal\"\n"
        )
    };
    let tls = "page_tls = { certificate = \"page.pem\", key = \"page.key.pem\" }";
    let token = "page_token_file = \"token\"";
    // One of them alone is not enough, and files that cannot be right are found before anything
    // runs.
    for (page, says) in [
        (tls.to_owned(), "page_token_file"),
        (token.to_owned(), "page_tls"),
        (format!("{tls}\npage_token_file = \"no-token\""), "no-token"),
        (format!("{token}\npage_tls = {{ certificate = \"token\", key = \"page.key.pem\" }}"), "token"),
    ] {
        let refused = output(&["run", "--config", text(&bench.write("refused.toml", &service(&page)))]);
        assert_eq!(refused.status.code(), Some(3), "{page}");
        assert!(stderr(&refused).contains(says), "{says}: {}", stderr(&refused));
    }
    let page = format!("{tls}\n{token}\npage_hosts = [\"localhost:{port}\"]");
    let path = bench.write("service.toml", &service(&page));
    let (mut child, mut said) = spawned(&path);
    said("metrics at https://");
    let url = format!("https://localhost:{port}/metrics");
    let ask = |further: &[&str]| {
        let fixed = ["-s", "-o", "/dev/null", "-w", "%{http_code}", "--noproxy", "*", "--cacert", text(&certificate)];
        stdout(&Command::new("curl").args(fixed).args(further).output().unwrap())
    };
    let bearer = ["-H", "Authorization: Bearer a token of some length"];
    assert_eq!(ask(&[&url]), "401");
    assert_eq!(ask(&["-H", "Authorization: Bearer another token", &url]), "401");
    assert_eq!(ask(&[bearer[0], bearer[1], &url]), "200");
    assert_eq!(ask(&["-u", "operator:a token of some length", &url]), "200");
    assert_eq!(ask(&[bearer[0], bearer[1], "-H", "Host: evil.example", &url]), "403");
    assert_eq!(ask(&[bearer[0], bearer[1], &url.replace("https", "http")]), "000", "no answer without TLS");
    // The command asks the same page.
    let (home, ca, token) = (format!("https://localhost:{port}"), text(&certificate), bench.path("token"));
    let status = output(&["status", "--url", &home, "--ca-file", ca, "--token-file", text(&token)]);
    assert_eq!(status.status.code(), Some(3), "without a baseline the state is unknown: {}", stderr(&status));
    assert!(stdout(&status).contains("small: machine unknown"), "{}{}", stdout(&status), stderr(&status));
    let stranger = output(&["status", "--url", &home, "--ca-file", ca]);
    assert!(stderr(&stranger).contains("401") && stdout(&stranger).is_empty(), "{}", stderr(&stranger));
    let other = bench.certificate("other").unwrap().1;
    let fooled = output(&["status", "--url", &home, "--ca-file", text(&other), "--token-file", text(&token)]);
    assert!(stderr(&fooled).contains("certificate") && stdout(&fooled).is_empty(), "{}", stderr(&fooled));
    signal(&child, "TERM");
    assert_eq!(child.wait().unwrap().code(), Some(0));
}

/// The journal reads priorities in front of lines, and has a clock of its own; whoever else reads
/// gets neither.
#[test]
fn conform_the_journal_is_told_priorities() {
    let bench = Bench::new();
    bench.write(
        "service.toml",
        "format = \"gearwatch-service/1\"\nservice = { self_test = false }\n[[bench]]\nfile = \"bench.toml\"\n\
         [[bench.source]]\nkind = \"test_signal\"\nspeed = \"max\"\nduration_secs = 3.0\n[[bench.source]]\nkind = \"file\"\n\
         path = \"none.mcap\"\n",
    );
    let said = |named: fn(&std::fs::Metadata) -> String| {
        let journal = bench.path("journal");
        let end = std::fs::File::create(&journal).unwrap();
        let stream = named(&end.metadata().unwrap());
        let run = gearwatch(&["run", "--config", text(&bench.path("service.toml"))])
            .env("JOURNAL_STREAM", stream)
            .env("GEARWATCH_LOG", "info")
            .stdout(Stdio::null())
            .stderr(end)
            .status();
        assert_eq!(run.unwrap().code(), Some(3), "a recording is missing");
        std::fs::read_to_string(journal).unwrap()
    };
    let journal = said(|end| format!("{}:{}", end.dev(), end.ino()));
    assert!(journal.lines().any(|line| line.starts_with("<3>") && line.contains("none.mcap")), "{journal}");
    assert!(journal.lines().all(|line| !line.contains("ERROR")), "{journal}");
    let other = said(|_| "1:1".to_owned());
    assert!(other.lines().any(|line| line.contains("ERROR") && !line.starts_with('<')), "{other}");
}
