//! An hour of the simulated bench at full speed through the whole service: a tooth breaks after
//! forty minutes. Memory stays flat, the ranks are what they should be, and the fault is found as
//! early as windows and alarm logic allow.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use crate::fixture::{Bench, gearwatch, text};
use crate::soak::{Sample, sample, slope};

const DURATION_S: f64 = 3600.0;
const FAULT_S: f64 = 2400.0;
const WINDOW_S: f64 = 1.0;
const HOP_S: f64 = 0.5;
/// Windows that must deviate before an alarm is raised, as the service has it where the
/// configuration says nothing.
const NEEDED: f64 = 3.0;
/// Largest growth of the resident set over the hour, its first tenth left out (KiB).
const FLAT_KIB: f64 = 1024.0;

#[test]
#[ignore = "minutes; `just campaign-hour`"]
fn conform_an_hour_of_the_simulated_bench() {
    let bench = Bench::new();
    let shipped = gearwatch_sim::shipped::BENCHES.iter().find(|shipped| shipped.name == "paper-rig").unwrap();
    let file = bench.write("rig.toml", shipped.text);
    let (normal, baseline) = (bench.path("normal.mcap"), bench.path("baseline.json"));
    for args in [
        &["simulate", text(&file), "--duration", "120", "--seed", "11", "-o", text(&normal)][..],
        &["baseline", "learn", text(&normal), "--bench", text(&file), "-o", text(&baseline)],
    ] {
        assert!(gearwatch(args).output().unwrap().status.success(), "{args:?}");
    }
    let config = bench.write(
        "service.toml",
        &format!(
            "format = \"gearwatch-service/1\"\nservice = {{ self_test = false }}\n\
             [[bench]]\nfile = \"rig.toml\"\nbaseline = \"baseline.json\"\n\
             [[bench.source]]\nkind = \"simulator\"\nspeed = \"max\"\nseed = 2\n\
             [bench.source.scenario]\nformat = \"gearwatch-scenario/1\"\nduration_s = {DURATION_S:?}\n\
             [[bench.source.scenario.event]]\neffect = \"tooth_breakage\"\nwhere = \"stage1.pinion\"\n\
             parameters = {{ fraction = 0.8 }}\nstart_s = {FAULT_S:?}\n\
             [[sink]]\nkind = \"stdout\"\n"
        ),
    );
    let (lines, talk) = (bench.path("lines.jsonl"), bench.path("talk"));
    let mut child = gearwatch(&["run", "--config", text(&config)])
        .env("GEARWATCH_LOG", "info")
        .stdout(std::fs::File::create(&lines).unwrap())
        .stderr(std::fs::File::create(&talk).unwrap())
        .spawn()
        .unwrap();
    let begin = Instant::now();
    let mut samples: Vec<Sample> = Vec::new();
    let ended = loop {
        if let Some(ended) = child.try_wait().unwrap() {
            break ended;
        }
        samples.extend(sample(child.id(), begin));
        std::thread::sleep(Duration::from_millis(500));
    };
    let wall_s = begin.elapsed().as_secs_f64();
    let talk = std::fs::read_to_string(&talk).unwrap();
    assert!(ended.success(), "{talk}");
    assert!(talk.contains("windows_lost=0"), "{talk}");

    let settled = &samples[samples.len() / 10..];
    let grown_kib = slope(settled) * 0.9 * wall_s;
    let mut by_place: BTreeMap<(String, String), Vec<serde_json::Value>> = BTreeMap::new();
    for line in std::fs::read_to_string(&lines).unwrap().lines() {
        let verdict: serde_json::Value = serde_json::from_str(line).unwrap();
        let of = |key: &str| verdict[key].as_str().unwrap().to_owned();
        by_place.entry((of("stage"), of("channel"))).or_default().push(verdict);
    }
    println!(
        "{DURATION_S} s in {wall_s:.0} s, x{:.0}; RSS {:.0} MiB at the end, {grown_kib:+.0} KiB over the hour",
        DURATION_S / wall_s,
        samples.last().unwrap().rss_kib / 1024.0
    );
    for ((stage, channel), verdicts) in &by_place {
        let end_s = |v: &serde_json::Value| v["t0_ns"].as_f64().unwrap() * 1e-9 + WINDOW_S;
        let deviates = |v: &&serde_json::Value| ["deviating", "alarm"].contains(&v["machine"].as_str().unwrap());
        let (before, after): (Vec<_>, Vec<_>) = verdicts.iter().partition(|v| end_s(v) <= FAULT_S);
        let false_ones = before.iter().filter(|v| deviates(v)).count();
        let found = after.iter().find(|v| deviates(v)).map(|v| end_s(v) - FAULT_S);
        println!(
            "{stage} at {channel}: {} windows before, {false_ones} of them deviate; {} after, the first that deviates ends {found:?} s after the break",
            before.len(),
            after.len()
        );
        assert_eq!(verdicts.len(), (2.0 * DURATION_S) as usize - 1, "windows are missing");
        // At 1 % of false alarms a window, half overlapping: three sigma.
        let allowed = 0.01 * before.len() as f64 + 3.0 * (2.0 * 0.01 * before.len() as f64).sqrt();
        assert!((false_ones as f64) < allowed, "{false_ones} false ones");
        if stage == "stage1" {
            // 1x to 5x change by 1.3 to 4.4 % then, with a sigma of a window of 0.04 to 0.27 %: the
            // first whole window shows it.
            assert!(found.is_some_and(|delay| delay <= WINDOW_S + HOP_S), "{stage} at {channel}: {found:?}");
            let missed = after.iter().filter(|v| end_s(v) > FAULT_S + WINDOW_S && !deviates(v)).count();
            assert_eq!(missed, 0, "{stage} at {channel}");
        }
    }
    // The alarm: the third of three whole windows.
    let window = |line: &str| line.split("window=").nth(1)?.split_whitespace().next()?.parse::<f64>().ok();
    let alarms = talk.lines().filter(|line| line.contains("alarm=\"stage1@acc_1\"")).filter_map(window);
    let delays: Vec<f64> = alarms.map(|number| number * HOP_S + WINDOW_S - FAULT_S).collect();
    println!("alarm of stage1 at acc_1 after {delays:?} s");
    assert!(delays.first().is_some_and(|&d| d > 0.0 && d <= WINDOW_S + NEEDED * HOP_S), "{delays:?}");
    assert!(grown_kib < FLAT_KIB, "{grown_kib} KiB");
}
