//! A year of 64 channels in the log, and the page that shows it.

use std::collections::BTreeMap;
use std::io::BufWriter;
use std::path::Path;
use std::time::{Duration, Instant};

use gearwatch_history::indicator_names;
use mcap::records::MessageHeader;
use serde_json::{Value, json};

use super::{BENCH, Service, chromium::Chromium, free_port, now_secs};

const DAYS: i64 = 365;
const CHANNELS: usize = 64;
/// Windows of a day and row: one for each span of the hourly level. A service judges 172 800, which
/// the levels put together in the same number of spans.
const WINDOWS: i64 = 24;

/// A file a day: both stages of 64 channels; stage1 at acc_7 wears from day 300 on, an alarm on
/// day 330.
fn write_year(folder: &Path, to_s: i64) {
    for day in 0..DAYS {
        let start = to_s - (DAYS - day) * 86_400;
        let name = format!("gearwatch-{day:08}-{day:012}-{}.mcap", utc(start));
        let file = BufWriter::new(std::fs::File::create(folder.join(name)).expect("a file"));
        let mut writer = mcap::Writer::new(file).expect("a log");
        let channels = ["/gear/stage1/rank", "/gear/stage2/rank", "/spectrum/acc_1", "/alarm"]
            .map(|topic| writer.add_channel(0, topic, "json", &BTreeMap::new()).expect("a channel"));
        let mut sequence = 0;
        let mut put = |channel_id: u16, t_s: i64, text: &str| {
            sequence += 1;
            let time = u64::try_from(t_s).expect("after 1970") * 1_000_000_000;
            let head = MessageHeader { channel_id, sequence, log_time: time, publish_time: time };
            writer.write_to_known_channel(&head, text.as_bytes()).expect("written");
        };
        let wear = |stage, channel| if (stage, channel) == (0, 7) { (day - 300).max(0) as f64 * 0.3 } else { 0.0 };
        let rows = (0..2).flat_map(|stage| (1..=CHANNELS).map(move |channel| (stage, channel)));
        let lines: Vec<(u16, String)> =
            rows.map(|(stage, channel)| (channels[stage], line(stage, channel, wear(stage, channel)))).collect();
        for window in 0..WINDOWS {
            let t_s = start + window * 86_400 / WINDOWS;
            let when = format!("\"t0_ns\":{t_s}000000000,\"first_sample_index\":{},", window * 8192);
            for (topic, line) in &lines {
                put(*topic, t_s, &line.replacen('{', &format!("{{{when}"), 1));
            }
            put(channels[2], t_s, &spectrum(t_s).to_string());
        }
        if day == 330 {
            let record = json!({ "bench": "", "id": "stage1@acc_7", "stage": "stage1", "channel": "acc_7", "severity": "warning", "since_ns": start * 1_000_000_000,
                "t_ns": start * 1_000_000_000, "active": true, "acknowledged": false, "over": false, "event": "raised", "who": "", "why": "", "from": "", "acknowledged_ns": 0 });
            put(channels[3], start, &record.to_string());
        }
        writer.finish().expect("an end");
    }
}

/// A verdict with all that a service tells, but for its time.
fn line(stage: usize, channel: usize, wear: f64) -> String {
    let mut out = json!({ "stage": format!("stage{}", stage + 1), "channel": format!("acc_{channel}"), "unit": "m/s^2", "cell": "25 Hz, 40 N m",
        "samples": 16_384, "machine": if wear > 9.0 { "deviating" } else { "normal" }, "instrument": "ok",
        "input_speed_hz": 25.0, "input_speed_sigma_hz": 0.001, "brake_torque_nm": 40.0 });
    for h in 1..=5 {
        out[format!("dev_{h}x_percent")] = json!(wear / f64::from(h) + 0.1 * (channel % 5) as f64);
        out[format!("dev_sigma_{h}x_percent")] = json!(0.3);
        out[format!("amp_{h}x")] = json!(1.0 + 0.01 * wear);
        out[format!("sigma_{h}x")] = json!(0.01);
        out[format!("level_{h}x")] = json!(0);
    }
    for name in indicator_names() {
        out[name] = json!(3.0);
        out[format!("{name}_sigma")] = json!(0.1);
    }
    out.to_string()
}

fn spectrum(t_s: i64) -> Value {
    let order: Vec<f64> = (0..1500).map(|k| f64::from(k) * 0.15).collect();
    let amplitude: Vec<f64> =
        (0..1500).map(|k| if k % 193 == 0 { 1.0 } else { 1e-3 * (1.0 + f64::from(k % 7)) }).collect();
    json!({ "bench": "", "channel": "acc_1", "unit": "m/s^2", "t0_ns": t_s * 1_000_000_000, "order": order, "amplitude": amplitude })
}

/// `20261121T024942Z`, as `date -u` writes it.
fn utc(seconds: i64) -> String {
    let out = std::process::Command::new("date").args(["-u", "-d", &format!("@{seconds}"), "+%Y%m%dT%H%M%SZ"]).output();
    String::from_utf8_lossy(&out.expect("date").stdout).trim().to_owned()
}

/// Most memory of a process since it began, or what it has now (MiB).
fn memory_mib(pid: u32, field: &str) -> f64 {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix(field)).unwrap_or_default();
    line.split_whitespace().next().and_then(|kib| kib.parse::<f64>().ok()).unwrap_or(f64::NAN) / 1024.0
}

/// The year is there, in 365 steps, with the wear and the alarm, in under a second; the service
/// stays below 40 MiB. Prints how long it takes to put the year into the levels, how long the page
/// waits for it, when it is painted first and how long its tasks are.
#[test]
#[ignore = "takes some minutes: just campaign-year"]
fn conform_a_year_of_64_channels_is_in_view() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let Some(mut browser) = Chromium::start(folder) else {
        return eprintln!("skipped: there is no chromium on this machine");
    };
    let log = folder.join("log");
    std::fs::create_dir(&log).expect("a folder");
    let now = i64::try_from(now_secs()).expect("a time");
    write_year(&log, now / 86_400 * 86_400);
    let sensors: String =
        (3..=CHANNELS).map(|n| format!("\n[[sensor]]\nname = \"acc_{n}\"\nshaft = \"input\"\n")).collect();
    std::fs::write(folder.join("bench.toml"), format!("{BENCH}{sensors}")).expect("written");
    let port = free_port();
    let config = format!(
        "format = \"gearwatch-service/1\"\n[service]\npage = \"127.0.0.1:{port}\"\n[[bench]]\nfile = \"bench.toml\"\n\
         [[bench.source]]\nkind = \"test_signal\"\namplitudes = [1.0, 0.6, 0.4, 0.3, 0.2]\nnoise = 0.02\n\
         [[sink]]\nkind = \"stdout\"\n[[sink]]\nkind = \"mcap_log\"\nfolder = \"log\"\nkeep_bytes = 1099511627776\nkeep_secs = 31622400000\n"
    );
    std::fs::write(folder.join("service.toml"), config).expect("written");
    let began = Instant::now();
    let service = Service::start(folder);
    browser.before_each_page("window.tasks = []; new PerformanceObserver((l) => tasks.push(...l.getEntries().map((e) => e.duration))).observe({ type: 'longtask' })");
    let url = format!("http://127.0.0.1:{port}/");
    while browser.value("document.querySelectorAll('#rows .row').length === 128") != json!(true) {
        browser.open(&url);
        std::thread::sleep(Duration::from_millis(1500));
    }
    let behind = "fetch('/api/snapshot').then((r) => r.json()).then((s) => { window.behind = s.sinks.flatMap((k) => k.figures).find((f) => f[0] === 'files_behind_levels')?.[1] })";
    loop {
        browser.value(behind);
        std::thread::sleep(Duration::from_millis(500));
        if browser.value("window.behind === 0") == json!(true) {
            break;
        }
    }
    let taken = began.elapsed();
    let taking_mib = memory_mib(service.0.id(), "VmHWM:");
    browser.value("localStorage.clear(); 0");
    browser.open(&url);
    browser.wait("all rows", "document.querySelectorAll('#rows .row').length === 128");
    std::thread::sleep(Duration::from_secs(3));
    let painted = browser.value("performance.getEntriesByName('first-contentful-paint')[0].startTime");
    let opening = browser.value("tasks.splice(0).map(Math.round).join(' ')");
    let ask = |browser: &mut Chromium, channel: &str, days: i64| {
        let from = now - days * 86_400;
        let query = format!("bench=&stage=stage1&channel={channel}&from={from}000000000&to={now}000000000");
        browser.value(&format!(
            "window.asked = null; {{ const t = performance.now(); fetch('/api/history?{query}').then((r) => r.json()).then((a) => {{ window.asked = {{ ms: performance.now() - t, steps: a.t0_s.length, every: a.every_s, last: a.dev[0].at(-1), events: a.events.length }} }}) }} 0"
        ));
        browser.wait("an answer", "window.asked !== null");
        browser.value("window.asked")
    };
    let year = ask(&mut browser, "acc_7", DAYS);
    let month = ask(&mut browser, "acc_33", 30);
    assert!(
        year["steps"].as_u64().is_some_and(|n| (364..=367).contains(&n)) && year["every"] == json!(86_400),
        "{year}"
    );
    assert!(year["last"].as_f64().is_some_and(|d| (18.0..21.0).contains(&d)) && year["events"] == json!(1), "{year}");
    for answer in [&year, &month] {
        assert!(answer["ms"].as_f64().is_some_and(|ms| ms < 1000.0), "{answer}");
    }
    assert_eq!(month["every"], json!(3600), "{month}");
    browser.value("document.querySelector('#history').open = true; [...document.querySelectorAll('#history-span button')].at(-1).click(); 0");
    browser
        .wait("a year of steps", "/^3[67]\\d steps of 24 h/.test(document.querySelector('#history-state').innerText)");
    browser.value("document.querySelector('#then').open = true; 0");
    browser.wait("spectra of the year", "/^\\d+ spectra from/.test(document.querySelector('#then-state').innerText)");
    std::thread::sleep(Duration::from_secs(10));
    let watching = browser.value("tasks.splice(0).map(Math.round).join(' ')");
    let now_mib = memory_mib(service.0.id(), "VmRSS:");
    let size = |name: &str| std::fs::metadata(log.join(name)).map_or(0, |data| data.len());
    let files: u64 =
        std::fs::read_dir(&log).expect("a folder").flatten().map(|e| e.metadata().map_or(0, |m| m.len())).sum();
    eprintln!(
        "into the levels in {:.0} s; levels {:.1} MB beside {:.0} MB; a year of a row {} ms, a month {} ms; first paint after {painted} ms; tasks over 50 ms: opening [{opening}], watching with a year open [{watching}]; the service has {now_mib:.1} MiB, had at most {taking_mib:.1} MiB while it took the year in",
        taken.as_secs_f64(),
        size("gearwatch-levels.sqlite") as f64 / 1e6,
        files as f64 / 1e6,
        year["ms"],
        month["ms"],
    );
    assert!(now_mib.max(taking_mib) < 40.0, "{taking_mib} MiB, {now_mib} MiB");
    assert_eq!(browser.complaints, Vec::<String>::new());
}
