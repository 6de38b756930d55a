//! `gearwatch report --weekly` on a log of four weeks whose numbers are known.

use std::collections::BTreeMap;
use std::io::BufWriter;
use std::path::Path;
use std::process::{Command, Output};

use mcap::records::MessageHeader;
use serde_json::{Value, json};

const DAY_NS: i64 = 86_400_000_000_000;
/// 2026-11-23T00:00:00Z, a Monday.
const TO_NS: i64 = 1_795_392_000 * 1_000_000_000;

fn output(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gearwatch")).args(args).current_dir(folder).env("NO_COLOR", "1").output().unwrap()
}

/// Ten windows a day of one row, half a second apart. 1x rises by 0.3 % a day through −2 % at the
/// end of the time, so that it meets 10 % after 40 days; all else only scatters. One alarm that
/// nobody has seen, one that ended, one reload.
fn write_log(path: &Path, days: i64) {
    let mut writer = mcap::Writer::new(BufWriter::new(std::fs::File::create(path).unwrap())).unwrap();
    let channel =
        |writer: &mut mcap::Writer<_>, topic: &str| writer.add_channel(0, topic, "json", &BTreeMap::new()).unwrap();
    let rank = channel(&mut writer, "/gear/stage1/rank");
    let alarm = channel(&mut writer, "/alarm");
    let gap = channel(&mut writer, "/gap");
    let mut sequence = 0;
    let mut put = |writer: &mut mcap::Writer<_>, channel_id: u16, t_ns: i64, value: &Value| {
        sequence += 1;
        let time = u64::try_from(t_ns).unwrap();
        let head = MessageHeader { channel_id, sequence, log_time: time, publish_time: time };
        writer.write_to_known_channel(&head, value.to_string().as_bytes()).unwrap();
    };
    for day in (0..days).rev() {
        let start = TO_NS - (day + 1) * DAY_NS;
        // Scatter of the days, without a trend of its own: + − − + in turn.
        let scatter = [0.2, -0.2, -0.2, 0.2][usize::try_from(day % 4).unwrap()];
        for window in 0..10_i64 {
            let mut line = json!({
                "bench": "b", "stage": "stage1", "channel": "acc", "unit": "g", "cell": "25 Hz, 40 N m", "t0_ns": start + window * DAY_NS / 172_800,
                "first_sample_index": window * 512, "samples": 1024, "machine": if day == 0 && window == 9 { "deviating" } else { "normal" },
                "instrument": if window == 0 { "overload" } else { "ok" }, "input_speed_hz": 25.0, "input_speed_sigma_hz": 0.001,
            });
            for h in 1..=5 {
                let rising = if h == 1 { -2.0 - 0.3 * (day as f64 + 0.5) } else { 0.0 };
                line[format!("dev_{h}x_percent")] = json!(rising + scatter);
                line[format!("dev_sigma_{h}x_percent")] = json!(0.1);
                line[format!("level_{h}x")] = json!(1);
            }
            put(&mut writer, rank, start + DAY_NS / 2, &line);
        }
    }
    let record = |id: &str, event: &str, over: bool, t_ns: i64| {
        json!({ "bench": "b", "id": id, "stage": "stage1", "channel": "acc", "severity": "warning", "since_ns": t_ns, "t_ns": t_ns, "active": !over,
                "acknowledged": over, "over": over, "event": event, "who": "", "why": "", "from": "", "acknowledged_ns": 0,
                "evidence": { "harmonic": 1, "amplitude": 0.5, "unit": "g", "deviation_percent": -2.1, "deviation_sigma_percent": 0.1,
                              "limit_percent": 1.0, "rank": "I", "window": 9, "input_speed_hz": 25.0 } })
    };
    let t = TO_NS - DAY_NS / 4;
    put(&mut writer, alarm, t, &record("stage1@acc", "raised", false, t));
    put(&mut writer, alarm, t, &record("stage2@acc", "raised", false, t));
    put(&mut writer, alarm, t + 1, &record("stage2@acc", "ended", true, t + 1));
    let reload =
        json!({ "channel": "reload", "first": 1, "last": 2501, "count": 2500, "cause": "configuration", "t_ns": t });
    put(&mut writer, gap, t, &reload);
    writer.finish().unwrap();
}

/// The text of a page without its tags and pictures, a space between.
fn words(page: &str) -> String {
    let mut out = String::new();
    let mut rest = page;
    while let Some((before, after)) = rest.split_once('<') {
        out.push_str(before);
        out.push(' ');
        rest = match after.strip_prefix("svg") {
            Some(svg) => svg.split_once("</svg>").map_or("", |(_, after)| after),
            None => after.split_once('>').map_or("", |(_, after)| after),
        };
    }
    out.push_str(rest);
    out.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[test]
fn analytic_a_week_with_a_known_trend_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_log(&folder.join("month.mcap"), 28);
    let config = "format = \"gearwatch-service/1\"\n[report]\ncustomer = \"A & B\"\nauthor = \"shift A\"\nbench = \"Bench 3\"\nserial = \"4711\"\n\
                  [[bench]]\n[[bench.source]]\nkind = \"test_signal\"\n[[sink]]\nkind = \"stdout\"\n";
    std::fs::write(folder.join("service.toml"), config).unwrap();
    let args =
        ["report", "--weekly", "month.mcap", "--to", "2026-11-23", "--config", "service.toml", "--out", "week.html"];
    let done = output(folder, &args);
    assert_eq!(done.status.code(), Some(0), "{}", String::from_utf8_lossy(&done.stderr));
    let page = std::fs::read_to_string(folder.join("week.html")).unwrap();
    let text = words(&page);
    for part in [
        "Week of Bench 3 from 2026-11-16 to 2026-11-22",
        "1 deviating or with a changed path; 1 alarm(s) open.",
        "Customer A &amp; B",
        "Serial number 4711",
        "Author shift A",
        // Only 1x moved: by 0.3 % a day, seven days from one week's middle to the other's.
        "(5 comparisons, confidence 95 % for all together). These changed:",
        // 70 windows, of which the first of each day is not ok: 63 of 70.
        "b: stage1 at acc 70 90.00 %",
        // Nine steps of half a second on each of seven days: 31.5 s.
        "25 Hz, 40 N m 0.01",
        "b: stage1@acc warning",
        "1x -2.1 % ± 0.1 %, rank I (limit 1 %), input shaft 25.00 Hz holds nobody",
        "reload the configuration was read again; nothing was watched for 2.5 s",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    assert!(!text.contains("stage2@acc warning"), "an alarm that is over is not open: {text}");
    // The line is 2.1 % a week within its interval; it met −10 % before the time, and rises towards
    // +10 %, in 40 days.
    let trend = text.split("percentage points a week time to the limit").nth(1).unwrap();
    let cells: Vec<&str> = trend.split_whitespace().collect();
    let at = cells.windows(2).position(|pair| pair[1] == "days").unwrap();
    let (days, first) =
        (cells[at].parse::<f64>().unwrap(), cells[at + 2].trim_start_matches('(').parse::<f64>().unwrap());
    let last: f64 = cells[at + 4].trim_end_matches(')').parse().unwrap();
    assert!((days - 40.0).abs() <= 1.0 && first < 40.0 && 40.0 < last, "{days} ({first} to {last})");
    assert_eq!(
        trend.split("Operating hours").next().unwrap().matches("no trend").count(),
        4,
        "2x to 5x only scatter: {trend}"
    );
    assert!(page.contains("@media print"), "it prints");
    assert_eq!(gearwatch_testkit::report::loads(&page), Vec::<String>::new());
}

#[test]
fn conform_bad_input_of_a_report_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_log(&folder.join("days.mcap"), 3);
    for (args, part) in [
        (&["--to", "2026-11-23T10:00"][..], "is no midnight"),
        (&["--to", "2026-10-01"], "no window from 2026-09-24T00:00:00Z"),
        (&["--to", "2026-11-23", "--config", "absent.toml"], "absent.toml"),
    ] {
        let done = output(folder, &[&["report", "--weekly", "days.mcap", "--out", "w.html"], args].concat());
        let said = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(done.status.code() == Some(3) && said.contains(part), "{args:?}: {said}");
    }
    // Three days are too few for a trend, and said to be.
    let done = output(folder, &["report", "--weekly", "days.mcap", "--to", "2026-11-23", "--out", "w.html"]);
    assert_eq!(done.status.code(), Some(0));
    let text = words(&std::fs::read_to_string(folder.join("w.html")).unwrap());
    assert!(text.contains("5 of 5 deviations have fewer than 5 days."), "{text}");
    assert!(text.contains("Nothing can be compared yet"), "{text}");
}
