//! Faults of sensors and wiring, one after another, in the middle of a healthy recording: each is flagged within three windows, and no clean window is.

use gearwatch_core::block::{Packet, Samples};

use crate::fixture::{Bench, output, stdout, text};
use crate::service::rounds;

/// Samples before the fault: 6 s at 2048 Hz.
const ONSET: u64 = 6 * 2048;
/// A window and the distance to the next one (samples).
const WINDOW: u64 = 2048;
const HOP: u64 = 1024;

/// What a fault makes of a sample, by its index.
type Spoil = fn(u64, f32) -> f32;

const FAULTS: &[(&str, Spoil)] = &[
    ("one NaN a second", |i, v| if i % 2048 == 17 { f32::NAN } else { v }),
    ("one infinity a second", |i, v| if i % 2048 == 17 { f32::INFINITY } else { v }),
    ("all zero", |_, _| 0.0),
    ("stuck at a value", |_, _| 0.7312),
    ("stuck at full scale", |_, _| 10.0),
    ("clipped by half", |_, v| v.clamp(-0.5, 0.5)),
    ("clipped at 1 %", |_, v| v.clamp(-1.9, 1.9)),
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

#[test]
fn conform_sensor_faults_are_flagged_within_three_windows() {
    let bench = Bench::new();
    bench.baseline();
    for (name, spoil) in FAULTS {
        let all = windows(&bench, "fault.mcap", "duration_secs = 12.0\nseed = 9", |packet| {
            if let Packet::Vibration(block) = packet
                && &*block.sensor == "acc_1"
                && let Samples::Physical(values) = &mut block.samples
            {
                for (i, value) in values.iter_mut().enumerate() {
                    let index = block.first_sample_index + i as u64;
                    if index >= ONSET {
                        *value = spoil(index, *value);
                    }
                }
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
}

/// Samples that are missing or come twice break the window and are told; the windows beside them are good.
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
