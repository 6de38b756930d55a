//! A receiver that is away, refuses, or answers nonsense for a while gets every alarm in the end,
//! once and in order.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpListener;
use std::sync::mpsc::channel;
use std::time::Duration;

use crate::fixture::Bench;
use crate::service::{configure, ended_within, signal, start};

#[test]
fn conform_alarms_are_posted_until_they_are_taken() {
    let bench = Bench::new();
    bench.baseline();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let (sender, posted) = channel();
    std::thread::spawn(move || {
        for (number, stream) in listener.incoming().enumerate() {
            let mut stream = stream.unwrap();
            let mut reader = BufReader::new(stream.try_clone().unwrap());
            let (mut line, mut length, mut authorization) = (String::new(), 0, String::new());
            // Followed, a redirect would be a GET, or go elsewhere.
            reader.read_line(&mut line).unwrap();
            assert!(line.starts_with("POST /alarms "), "{line}");
            line.clear();
            while reader.read_line(&mut line).is_ok_and(|n| n > 2) {
                let lower = line.to_ascii_lowercase();
                if let Some(value) = lower.strip_prefix("content-length:") {
                    length = value.trim().parse().unwrap();
                }
                if lower.starts_with("authorization:") {
                    authorization = line.trim().to_owned();
                }
                line.clear();
            }
            let mut body = vec![0; length];
            reader.read_exact(&mut body).unwrap();
            let elsewhere = |status: &str| {
                format!(
                    "HTTP/1.1 {status}\r\nLocation: http://{address}/elsewhere\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
                )
            };
            // First it is busy, then it hangs up, then it points elsewhere, then it takes what
            // comes.
            match number {
                0 => drop(stream.write_all(b"HTTP/1.1 503 Busy\r\nContent-Length: 0\r\nConnection: close\r\n\r\n")),
                1 => {}
                2 => drop(stream.write_all(elsewhere("302 Found").as_bytes())),
                3 => drop(stream.write_all(elsewhere("303 See Other").as_bytes())),
                _ => {
                    let answer = b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\nConnection: close\r\n\r\n";
                    drop(stream.write_all(answer));
                    sender.send((authorization, body)).unwrap();
                }
            }
        }
    });
    bench.write("token", "s3cret\n");
    let further = format!(
        "[[sink]]\nkind = \"webhook\"\nurl = \"http://{address}/alarms\"\ntoken_file = \"token\"\ntimeout_secs = 2.0\n"
    );
    let config = configure(&bench, &bench.path("log"), "1.0", &further);
    let text = std::fs::read_to_string(&config).unwrap();
    let text = text.replace("file = \"bench.toml\"\n", "file = \"bench.toml\"\nbaseline = \"baseline.json\"\n");
    let fault = "fault = { after_secs = 0.0, stage = \"stage1\", percent = [0.0, 0.0, 0.0, 0.0, 25.0] }\n[[sink]]";
    std::fs::write(&config, text.replacen("[[sink]]", fault, 1)).unwrap();
    let mut child = start(&config);
    let (authorization, body) = posted.recv_timeout(Duration::from_secs(30)).expect("an alarm is posted");
    assert!(authorization.ends_with("Bearer s3cret"), "{authorization}");
    let alarm = serde_json::from_slice::<serde_json::Value>(&body).unwrap();
    // Windows of both channels go on: the same fault at the other channel is no news.
    assert!(posted.recv_timeout(Duration::from_secs(3)).is_err(), "one fault, one alarm");
    signal(&child, "TERM");
    assert_eq!(ended_within(&mut child, Duration::from_secs(5)).and_then(|s| s.code()), Some(0));
    assert!(posted.try_recv().is_err(), "each alarm once");
    let raised = std::fs::read_dir(bench.path("log")).unwrap().flatten().map(|entry| entry.path());
    let logged = raised.filter(|path| path.extension().is_some_and(|e| e == "mcap")).flat_map(|path| {
        let bytes = std::fs::read(path).unwrap();
        let messages = mcap::MessageStream::new(&bytes).unwrap().map(|m| m.unwrap());
        let records =
            messages.filter(|m| m.channel.topic == "/alarm").map(|m| serde_json::from_slice(&m.data).unwrap());
        records.collect::<Vec<serde_json::Value>>()
    });
    let mut channels: Vec<String> = logged.map(|alarm| alarm["channel"].as_str().unwrap().to_owned()).collect();
    channels.sort_unstable();
    channels.dedup();
    assert_eq!(channels, ["acc_1", "acc_2"], "the log has both");
    assert_eq!((&alarm["group"]["news"], alarm["group"]["channels"].as_array().map(Vec::len)), (&true.into(), Some(1)));
    // The signal's fifth harmonic is 25 % too high: it is named, with its sign, limit and operating
    // point.
    let text = alarm["text"].as_str().unwrap();
    let begin =
        format!("gearwatch: alarm at bench small: stage1 at {}, critical: 5x +2", alarm["channel"].as_str().unwrap());
    assert!(text.starts_with(&begin) && text.contains("rank V (limit 10 %), input shaft "), "{text}");
    assert_eq!((&alarm["kind"], &alarm["active"], &alarm["bench"]), (&"alarm".into(), &true.into(), &"small".into()));
}
