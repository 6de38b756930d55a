//! Known changes in real recordings of a two-stage box (`../shared/data/gfd_spectraquest` beside the checkout; skipped where it is missing).

#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "the table is shown with --nocapture, and what was skipped is told"
)]

use std::io::Read;
use std::path::PathBuf;

use flate2::read::GzDecoder;
use gearwatch_core::bench::{Bench, Sensor};
use gearwatch_core::block::{OperatingPoint, Quality};
use gearwatch_core::recording::{Channel, Recording, Segment};
use gearwatch_explain::drill::change::{Change, Kind};
use gearwatch_explain::drill::{Outcome, Question, drill, halves, table};
use gearwatch_explain::instrument;
use rayon::prelude::*;

/// Inferred from the lines in the recordings (README there).
const RATE_HZ: f64 = 12_800.0;
/// Where the drive display stands: the motor turns at 29.6 to 29.8 Hz.
const MOTOR_HZ: f64 = 29.7;

/// The shipped bench of that kind with the four sensors of the recordings, whose unit and places nobody stated.
fn bench() -> Bench {
    let shipped = gearwatch_sim::shipped::BENCHES.iter().find(|b| b.name == "spectraquest-like").unwrap().text;
    let mut bench: Bench = toml::from_str(shipped).unwrap();
    bench.sensors = [("a1", "input"), ("a2", "intermediate"), ("a3", "output"), ("a4", "output")]
        .map(|(name, shaft)| Sensor { name: name.into(), shaft: shaft.into(), direction_deg: 90.0, unit: "1".into() })
        .into();
    bench.housing_modes.clear();
    bench.effects.clear();
    bench.tacho = None;
    bench.acquisition.sample_rate_hz = RATE_HZ;
    bench
}

/// Recordings by state (`h`, `b`) and load (%); none where the data is missing.
fn recordings(states: &str, loads: &[u32]) -> Vec<Recording> {
    let usual = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/gfd_spectraquest");
    let folder = std::env::var_os("GEARWATCH_RECORDINGS").map_or_else(|| PathBuf::from(usual), PathBuf::from);
    if !folder.is_dir() {
        eprintln!("skipped: there is no {}", folder.display());
        return Vec::new();
    }
    let names = states.chars().flat_map(|s| loads.iter().map(move |l| (format!("{s}30hz{l}"), *l)));
    names
        .map(|(name, load)| {
            let mut text = String::new();
            let file = std::fs::File::open(folder.join(format!("{name}.csv.gz"))).unwrap();
            GzDecoder::new(file).read_to_string(&mut text).unwrap();
            let rows: Vec<Vec<f64>> =
                text.lines().skip(1).map(|l| l.split(',').map(|f| f.trim().parse().unwrap()).collect()).collect();
            let mut out = Recording { name, ..Recording::default() };
            for c in 0..4 {
                let samples = rows.iter().map(|r| r[c]).collect();
                let segment = Segment { t0: 0, first_sample_index: 0, samples, quality: Quality::GOOD };
                let channel = Channel { sample_rate_hz: RATE_HZ, unit: "1".into(), segments: vec![segment] };
                out.channels.insert(format!("a{}", c + 1), channel);
            }
            let brake_torque_nm = f64::from(load);
            let point = OperatingPoint { motor_speed_hz: MOTOR_HZ, brake_torque_nm, ..OperatingPoint::UNKNOWN };
            out.operating_points.push(point);
            out
        })
        .collect()
}

fn run(recordings: &[Recording], kinds: &[Kind]) -> Vec<Outcome> {
    let outcomes = drill(&Question { bench: &bench(), recordings, reference: &[], kinds }, &|_, _| {}).unwrap();
    for o in outcomes.iter().filter(|o| !o.is_right()) {
        println!("{} {:?} place {} size {}: {:?}", o.recording, o.change.kind, o.change.place, o.change.size, o.named);
    }
    for row in table(&outcomes) {
        println!("{row:?}");
    }
    outcomes
}

/// Kinds by name from `GEARWATCH_KINDS`, recordings from `GEARWATCH_LOADS` and `GEARWATCH_STATES`; all without.
#[test]
#[ignore = "minutes: GEARWATCH_KINDS=Swap,Lost cargo test -p gearwatch-explain --test drill -- --ignored --nocapture"]
fn campaign_changes_in_real_recordings() {
    let asked = |name: &str, usual: &str| std::env::var(name).unwrap_or_else(|_| usual.into());
    let kinds = asked("GEARWATCH_KINDS", "");
    let all = std::iter::once(Kind::Nothing).chain(Kind::INSTRUMENT).chain(Kind::MACHINE);
    let kinds: Vec<Kind> =
        all.filter(|k| kinds.is_empty() || kinds.split(',').any(|n| n == format!("{k:?}"))).collect();
    let loads: Vec<u32> = asked("GEARWATCH_LOADS", "0,10,30,50,70,90").split(',').map(|l| l.parse().unwrap()).collect();
    let recordings = recordings(&asked("GEARWATCH_STATES", "hb"), &loads);
    if !recordings.is_empty() {
        run(&recordings, &kinds);
    }
}

/// What the instrument's part alone names of one change in the second half of a recording: effects and places.
fn examined(recording: &Recording, change: Change) -> Vec<(String, String)> {
    let mut sheet = bench();
    let (mut changed, reference) = halves(recording).remove(0);
    change.make(&mut sheet, &mut changed, MOTOR_HZ, 1);
    let found = instrument::examine(&sheet, &[changed], &reference).faults;
    found.into_iter().map(|f| (f.effect.to_owned(), f.place)).collect()
}

/// Every instrument change but the clock, which takes a tacho, at every place and size, at the loads in `GEARWATCH_LOADS` (30 and 90 % by default), healthy and broken: at least 95 % named
/// right with nothing beside, from the least size on that is stated here; and halves that nobody changed get no name.
#[test]
#[ignore = "minutes: cargo test --release -p gearwatch-explain --test drill -- --ignored --nocapture literature"]
fn literature_instrument_changes_of_real_recordings_are_named() {
    let loads = std::env::var("GEARWATCH_LOADS").unwrap_or_else(|_| "30,90".into());
    let loads: Vec<u32> = loads.split(',').map(|l| l.parse().unwrap()).collect();
    let recordings = recordings(&std::env::var("GEARWATCH_STATES").unwrap_or_else(|_| "hb".into()), &loads);
    let sheet = bench();
    let asked = std::env::var("GEARWATCH_KINDS").unwrap_or_default();
    let kinds = std::iter::once(Kind::Nothing).chain(Kind::INSTRUMENT).filter(|k| *k != Kind::Clock);
    let mut tasks = Vec::new();
    for kind in kinds.filter(|k| asked.is_empty() || asked.split(',').any(|n| n == format!("{k:?}"))) {
        for (place, truth) in kind.places(&sheet).into_iter().enumerate() {
            for size in kind.sizes().0 {
                tasks.extend(recordings.iter().map(|r| (r, Change { kind, place, size: *size }, truth.clone())));
            }
        }
    }
    let wrong: Vec<String> = tasks
        .par_iter()
        .filter_map(|(recording, change, truth)| {
            let named = examined(recording, *change);
            let expected: Vec<(String, String)> =
                truth.iter().map(|t| (t.effect.to_owned(), t.place.clone())).collect();
            let same = named.len() == expected.len() && expected.iter().all(|t| named.contains(t));
            let Change { kind, place, size } = change;
            (!same).then(|| format!("{} {kind:?} place {place} size {size}: {named:?}", recording.name))
        })
        .collect();
    wrong.iter().for_each(|w| println!("{w}"));
    println!("{} of {} wrong", wrong.len(), tasks.len());
    assert!(wrong.len() as f64 <= 0.05 * tasks.len() as f64);
}
