//! Faults of sensors and wiring, one after another, in the middle of a healthy recording: each is
//! flagged within three windows, and no clean window is.

use std::f32::consts::TAU;

use gearwatch_core::block::{Block, Packet, Samples};

use crate::fixture::{BENCH, Bench, output, stdout, text};
use crate::service::rounds;

const RATE: u64 = 2048;
/// Samples before the fault: 6 s.
const ONSET: u64 = 6 * RATE;
/// A window and the distance to the next one (samples).
const WINDOW: u64 = RATE;
const HOP: u64 = RATE / 2;

/// What a fault makes of a sample, by its index.
type Spoil = fn(u64, f32) -> f32;

/// What an open input picks up: the mains with its third and fifth, and the converter's own noise.
fn hum(mains_hz: f32, i: u64) -> f32 {
    let turns = mains_hz * (i % (RATE * 10)) as f32 / RATE as f32;
    // Steele, Lea, Flood: SplitMix64, as noise of 1 % of the first line.
    let mut z = i.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let noise = (z >> 40) as f32 / (1 << 24) as f32 - 0.5;
    2.0 * (TAU * turns).sin() + 0.3 * (TAU * 3.0 * turns).sin() + 0.2 * (TAU * 5.0 * turns).sin() + 0.02 * noise
}

const FAULTS: &[(&str, Spoil)] = &[
    ("one NaN a second", |i, v| if i % 2048 == 17 { f32::NAN } else { v }),
    ("one infinity a second", |i, v| if i % 2048 == 17 { f32::INFINITY } else { v }),
    ("all zero", |_, _| 0.0),
    ("stuck at a value", |_, _| 0.7312),
    ("stuck at full scale", |_, _| 10.0),
    ("clipped by half", |_, v| v.clamp(-0.5, 0.5)),
    ("clipped at 1 %", |_, v| v.clamp(-1.9, 1.9)),
    ("a bias of 15", |_, v| v + 15.0),
    ("a bias of -15", |_, v| v - 15.0),
    ("hum of 50 Hz", |i, _| hum(50.1, i)),
    ("hum of 60 Hz", |i, _| hum(59.9, i)),
    ("the machine a tenth of the hum", |i, v| 0.1 * v + hum(50.0, i)),
    ("stuck in every other second", |i, v| if i / 1024 % 2 == 0 { 0.1 } else { v }),
];

struct Window {
    first: u64,
    ok: bool,
    unknown: bool,
}

/// The windows of acc_1 of a recording.
fn windows(bench: &Bench, name: &str, keys: &str, change: impl FnMut(&mut Packet)) -> Vec<Window> {
    let (file, baseline) = (bench.path("bench.toml"), bench.path("baseline.json"));
    let recording = bench.record(name, keys, change);
    let all = ["diagnose", text(&recording), "--windows", "--bench", text(&file), "--baseline", text(&baseline)];
    let said = stdout(&output(&all));
    let objects = said.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    let of_one = objects.filter(|object| object["channel"] == "acc_1");
    of_one
        .map(|object| Window {
            first: object["first_sample_index"].as_u64().unwrap(),
            ok: object["instrument"] == "ok",
            unknown: object["machine"] == "unknown" && object["rank_1x"] == "unknown",
        })
        .collect()
}

/// A fault from the onset on: flagged in every window from the third on, without a rank, and in
/// none before.
fn flagged(bench: &Bench, name: &str, mut fault: impl FnMut(&mut Block)) {
    let all = windows(bench, "fault.mcap", "duration_secs = 12.0\nseed = 9", |packet| {
        if let Packet::Vibration(block) = packet
            && &*block.sensor == "acc_1"
        {
            fault(block);
        }
    });
    let (clean, faulty): (Vec<_>, Vec<_>) = all.iter().partition(|w| w.first + WINDOW <= ONSET);
    assert!(clean.len() >= 10 && clean.iter().all(|w| w.ok), "{name}: a clean window is flagged");
    // Three windows after the first that lies wholly in the fault, all of them must be flagged.
    let late: Vec<_> = faulty.iter().filter(|w| w.first >= ONSET + 2 * HOP).collect();
    let flagged = late.iter().filter(|w| !w.ok).count();
    println!("{name}: {flagged} of {} windows flagged", late.len());
    assert!(!late.is_empty() && flagged == late.len(), "{name}: {flagged} of {} windows flagged", late.len());
    assert!(faulty.iter().filter(|w| !w.ok).all(|w| w.unknown), "{name}: a rank in spite of the fault");
}

#[test]
fn conform_sensor_faults_are_flagged_within_three_windows() {
    let bench = Bench::new();
    bench.baseline();
    for (name, spoil) in FAULTS {
        flagged(&bench, name, |block| {
            let first = block.first_sample_index;
            let Samples::Physical(values) = &mut block.samples else { unreachable!() };
            for (index, value) in (first..).zip(values).filter(|(index, _)| *index >= ONSET) {
                *value = spoil(index, *value);
            }
        });
    }
}

/// The instrument samples at another rate than it says: its clock stamps the blocks, so that they
/// come too early or too late.
#[test]
fn conform_a_wrong_sample_rate_is_flagged_within_three_windows() {
    let bench = Bench::new();
    bench.baseline();
    for percent in [-50.0, -2.0, 2.0, 100.0] {
        flagged(&bench, &format!("rate {percent:+} %"), |block| {
            let late = block.first_sample_index.saturating_sub(ONSET) as f64 / RATE as f64;
            block.t0 += (late * (1.0 / (1.0 + percent / 100.0) - 1.0) * 1e9) as i64;
        });
    }
}

/// One sample in a thousand at the limits, at the rate that benches have: fewer than five at either
/// limit, in one window of a hundred, tell nothing.
#[test]
fn conform_clipping_of_one_sample_in_a_thousand_is_flagged() {
    let bench = Bench::new();
    bench.write("bench.toml", &BENCH.replace("2048.0", "16384.0"));
    bench.baseline();
    let keys = "duration_secs = 20.0\nseed = 9\nnoise = 0.5";
    let mut sorted = Vec::new();
    let of_acc_1 = |packet: &mut Packet, each: &mut dyn FnMut(&mut f32)| {
        if let Packet::Vibration(Block { sensor, samples: Samples::Physical(values), .. }) = packet
            && &**sensor == "acc_1"
        {
            values.iter_mut().for_each(each);
        }
    };
    let clean = windows(&bench, "whole.mcap", keys, |packet| of_acc_1(packet, &mut |value| sorted.push(value.abs())));
    sorted.sort_by(f32::total_cmp);
    let limit = sorted[sorted.len() - sorted.len() / 1000];
    let clipped = windows(&bench, "fault.mcap", keys, |packet| {
        of_acc_1(packet, &mut |value| *value = value.clamp(-limit, limit));
    });
    let flagged = clipped.iter().filter(|w| !w.ok).count();
    println!("clipped at 0.1 %: {flagged} of {} windows flagged", clipped.len());
    assert!(clean.iter().all(|w| w.ok));
    assert!(clipped.windows(3).all(|three| three.iter().any(|w| !w.ok)), "{flagged} of {} windows", clipped.len());
    assert!(clipped.iter().filter(|w| !w.ok).all(|w| w.unknown), "a rank in spite of the fault");
}

/// Samples that are missing or come twice break the window and are told; the windows beside them
/// are good.
#[test]
fn conform_missing_and_repeated_samples_make_no_window() {
    let bench = Bench::new();
    bench.baseline();
    let clean = windows(&bench, "clean.mcap", "duration_secs = 12.0\nseed = 9", |_| {}).len();
    let all = windows(&bench, "missing.mcap", "duration_secs = 12.0\nseed = 9", |packet| {
        if let Packet::Vibration(block) = packet
            && block.first_sample_index >= ONSET
        {
            // As if 300 samples had been lost before.
            block.first_sample_index += 300;
        }
    });
    assert!(all.len() < clean && all.iter().all(|w| w.ok), "{} of {clean} windows", all.len());
    assert!(all.iter().all(|w| w.first + WINDOW <= ONSET || w.first >= ONSET + 300), "a window over the gap");
}

/// Healthy signals of many seeds: no window is flagged. A campaign looks at 100 000.
#[test]
fn conform_no_clean_window_is_flagged() {
    let bench = Bench::new();
    bench.baseline();
    let wanted = if rounds(0) > 0 { 100_000 } else { 1000 };
    let (mut seen, mut flagged, mut seed) = (0, 0, 100);
    while seen < wanted {
        let secs = 500.min(wanted / 4 + 10);
        let all = windows(&bench, "clean.mcap", &format!("duration_secs = {secs}.0\nseed = {seed}"), |_| {});
        seen += all.len();
        flagged += all.iter().filter(|w| !w.ok).count();
        seed += 1;
    }
    println!("{flagged} of {seen} clean windows flagged");
    assert_eq!(flagged, 0);
}

/// The sensor faults of the simulator's own scenarios, in turn, on a simulated bench: from the
/// second window after each onset on the faulty channel has no rank, and no window is flagged
/// before it or on the other channel. A minute of each; the campaign does a day, 24 recordings of
/// an hour.
#[test]
fn conform_the_simulators_faults_give_no_rank() {
    let bench = Bench::new();
    let (file, baseline) = (bench.path("bench.toml"), bench.path("baseline.json"));
    let (secs, hours) = if rounds(0) > 0 { (3600, 24) } else { (60, 3) };
    let simulate = |name: &str, seed: u64, further: &[&str]| {
        let recording = bench.path(name);
        let seed = seed.to_string();
        let fixed = ["simulate", text(&file), "--seed", &seed, "--force", "-o", text(&recording)];
        let made = output(&[&fixed, further].concat());
        assert_eq!(made.status.code(), Some(0), "{}", crate::fixture::stderr(&made));
        recording
    };
    let healthy = simulate("healthy.mcap", 1, &["--duration", "40"]);
    let learned = output(&["baseline", "learn", text(&healthy), "-b", text(&file), "-o", text(&baseline)]);
    assert_eq!(learned.status.code(), Some(0), "{}", crate::fixture::stderr(&learned));
    let onset = secs / 3;
    let (mut all_ranks, mut all_late, mut all_clean, mut all_flagged) = (0, 0, 0, 0);
    for hour in 0..hours {
        let kind = ["flat", "clipped", "dropout"][hour as usize % 3];
        let scenario = format!(
            "format = \"gearwatch-scenario/1\"\nduration_s = {secs}.0\n[[sensor_fault]]\nsensor = \"acc_1\"\nkind = \"{kind}\"\nstart_s = {onset}.0\n"
        );
        let scenario = bench.write("scenario.toml", &scenario);
        let recording = simulate("day.mcap", 2 + hour, &["--scenario", text(&scenario)]);
        let all = ["diagnose", text(&recording), "--windows", "--bench", text(&file), "--baseline", text(&baseline)];
        let said = stdout(&output(&all));
        let (mut ranks, mut late, mut clean, mut flagged) = (0, 0, 0, 0);
        for line in said.lines() {
            let object: serde_json::Value = serde_json::from_str(line).unwrap();
            let first = object["first_sample_index"].as_u64().unwrap();
            let ranked = (1..=5).any(|k| object[format!("rank_{k}x")] != "unknown");
            if object["channel"] != "acc_1" || first + WINDOW <= onset * RATE {
                clean += 1;
                flagged += u64::from(object["instrument"] != "ok");
            } else if first >= onset * RATE + HOP {
                late += 1;
                ranks += u64::from(object["instrument"] == "ok" || ranked);
            }
        }
        println!(
            "{kind}, hour {hour}: {ranks} ranks in {late} windows of the faulty channel; {flagged} of {clean} sound windows flagged"
        );
        assert!(ranks == 0 && flagged == 0 && (late > 0 || kind == "dropout"), "{kind}: {ranks} of {late}, {flagged}");
        assert!(clean >= 2 * (secs - 2), "{clean} sound windows in {secs} s");
        (all_ranks, all_late) = (all_ranks + ranks, all_late + late);
        (all_clean, all_flagged) = (all_clean + clean, all_flagged + flagged);
    }
    println!("all: {all_ranks} ranks in {all_late} faulty windows, {all_flagged} of {all_clean} sound windows flagged");
}
