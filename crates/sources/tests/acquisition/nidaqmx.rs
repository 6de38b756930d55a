//! NI-DAQmx against a library of the same interface, which the test compiles. Skipped with a
//! message where there is no C compiler.
#![allow(clippy::print_stderr, reason = "a test that is skipped says so")]

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use gearwatch_core::block::{Block, Quality};

use super::support::{Opened, block, source, values};

/// Volts from one sample of the library's ramp to the next, and samples of the ramp.
const STEP_V: f64 = 4e-6;
const PERIOD: i64 = 1 << 20;

/// The library in a folder of its own: `None`, with a message, where nothing compiles it.
fn library() -> Option<tempfile::TempDir> {
    let folder = tempfile::tempdir().unwrap();
    let code = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/acquisition/nidaqmx/stub.c");
    let target = folder.path().join("libnidaqmx.so.1");
    match Command::new("cc").args(["-shared", "-fPIC", "-O1", "-Wall", "-o"]).arg(target).arg(code).status() {
        Ok(status) => assert!(status.success(), "the library does not compile"),
        Err(e) => {
            eprintln!("skipped: there is no C compiler (cc: {e})");
            return None;
        }
    }
    Some(folder)
}

fn opened(folder: &Path, rate_hz: f64, channels: &str) -> Opened {
    let library = folder.join("libnidaqmx.so.1");
    let library = library.to_str().unwrap();
    source(&format!("kind = \"nidaqmx\"\nsample_rate_hz = {rate_hz:?}\nlibrary = {library:?}\nchannels = [{channels}]"))
}

/// Number of the first sample of a block by its value, whose following ones it checks. `per_unit`
/// is V per unit.
fn number(block: &Block, per_unit: f64) -> i64 {
    // A ramp that is more than 2^20 steps of 4 µV high has 4.2 V; single precision is exact to
    // 0.06 of a step there.
    let steps: Vec<i64> = values(block).iter().map(|&v| (f64::from(v) * per_unit / STEP_V).round() as i64).collect();
    for pair in steps.windows(2) {
        assert_eq!((pair[0] + 1) % PERIOD, pair[1], "{}", block.sensor);
    }
    steps[0]
}

const TWO: &str = "{ input = \"Dev1/ai0\", sensor = \"a\" }, { input = \"Dev1/ai1\", sensor = \"b\" }";

fn error_of(result: Result<impl Sized, impl std::fmt::Display>) -> String {
    result.err().map(|e| e.to_string()).unwrap_or_default()
}

/// Accelerations in both units, with and without current, and voltages with and without a
/// sensitivity: all of them show the same volts.
#[test]
fn conform_values_are_in_the_unit_that_is_asked_for() {
    let Some(folder) = library() else { return };
    let channels =
        "{ input = \"Dev1/ai0\", sensor = \"g\", sensitivity_v_per_unit = 0.1, unit = \"g\", iepe_current_ma = 2.1 },
        { input = \"Dev1/ai1\", sensor = \"m\", sensitivity_v_per_unit = 0.01, unit = \"m/s^2\", range_v = 2.5 },
        { input = \"Dev1/ai2\", sensor = \"p\", sensitivity_v_per_unit = 0.02, unit = \"mm/s\" },
        { input = \"Dev1/ai3\", sensor = \"v\" }";
    let mut pull = opened(folder.path(), 25_600.0, channels).open().unwrap();
    for _ in 0..10 {
        let blocks: Vec<Block> = (0..4).map(|_| block(&mut pull)).collect();
        let units: Vec<&str> = blocks.iter().map(|block| &*block.unit).collect();
        assert_eq!(units, ["g", "m/s^2", "mm/s", "V"]);
        // Odd inputs are negative.
        let numbers =
            [0.1, -0.01, 0.02, -1.0].into_iter().zip(&blocks).map(|(per_unit, block)| number(block, per_unit));
        let numbers: Vec<i64> = numbers.collect();
        assert!(numbers.iter().all(|&n| n == numbers[0]), "{numbers:?}");
    }
}

/// Samples follow each other through all readings; what the library has lost is a gap, as long as
/// the clock says; an overload marks its own input only.
#[test]
fn conform_lost_samples_are_a_gap_and_overloads_are_marked() {
    let Some(folder) = library() else { return };
    let source = opened(folder.path(), 12_800.0, TWO);
    let mut pull = source.open().unwrap();
    let first = block(&mut pull);
    assert_eq!((first.first_sample_index, first.sample_rate_hz), (0, 12_800.0));
    // Index and number keep their distance.
    let distance = number(&first, 1.0);
    for _ in 0..20 {
        let (b, a) = (block(&mut pull), block(&mut pull));
        assert_eq!(a.first_sample_index as i64 + distance, number(&a, 1.0));
        assert_eq!((b.quality, a.quality), (Quality::GOOD, Quality::GOOD));
    }
    std::fs::write(folder.path().join("overload"), "").unwrap();
    // What was read before is handed out first.
    let (mut b, mut a) = (block(&mut pull), block(&mut pull));
    for _ in 0..3 {
        (b, a) = (block(&mut pull), block(&mut pull));
    }
    assert_eq!((&*b.sensor, b.quality, a.quality), ("b", Quality::OVERLOAD, Quality::GOOD));
    let last = a.first_sample_index as i64;

    std::fs::write(folder.path().join("lost"), "").unwrap();
    let error = loop {
        if let Err(error) = pull() {
            break error.to_string();
        }
    };
    assert_eq!(error, "NI-DAQmx: DAQmxReadAnalogF64: error -200279: As the test wants it. Status Code: -200279");
    drop(pull);
    std::thread::sleep(Duration::from_millis(500));
    let mut pull = source.open().unwrap();
    let after = block(&mut pull);
    assert!(after.quality.contains(Quality::GAP_BEFORE));
    let lost = number(&after, 1.0) - distance - last;
    let jump = after.first_sample_index as i64 - last;
    assert!(lost > 6000, "{lost}");
    // Of this clock and the device's, the length differs by what this thread waited for the
    // processor.
    assert!((jump - lost).abs() < 12_800 / 2, "{jump} for {lost}");
}

/// An unplugged device is an error until it is back; another one in its place is refused.
#[test]
fn conform_a_device_that_goes_is_told_and_another_one_is_refused() {
    let Some(folder) = library() else { return };
    let source = opened(folder.path(), 12_800.0, TWO);
    let mut pull = source.open().unwrap();
    block(&mut pull);
    std::fs::write(folder.path().join("gone"), "").unwrap();
    let error = loop {
        if let Err(error) = pull() {
            break error.to_string();
        }
    };
    assert!(error.contains("DAQmxReadAnalogF64: error -201003"), "{error}");
    drop(pull);
    let error = error_of(source.open());
    assert!(error.contains("DAQmxCreateAIVoltageChan: error -200220: Device identifier is invalid."), "{error}");
    std::fs::remove_file(folder.path().join("gone")).unwrap();
    assert!(block(&mut source.open().unwrap()).quality.contains(Quality::GAP_BEFORE));
    std::fs::write(folder.path().join("other"), "").unwrap();
    assert_eq!(
        error_of(source.open()),
        "NI-DAQmx: the device is \"Dev1 no. 1BAD\"; the one before was \"Dev1 no. 1DEA\""
    );
}

#[test]
fn conform_what_the_device_cannot_do_is_said_with_what_it_can() {
    let Some(folder) = library() else { return };
    assert_eq!(
        error_of(opened(folder.path(), 20_000.0, TWO).open()),
        "NI-DAQmx: the device samples at 25600 Hz instead of 20000; write sample_rate_hz = 25600.0"
    );
    let error = error_of(opened(folder.path(), 12_800.0, "{ input = \"Dev1/ai7\", sensor = \"a\" }").open());
    assert!(error.contains("error -200220"), "{error}");
    let error =
        error_of(opened(folder.path(), 12_800.0, "{ input = \"Dev1/ai0\", sensor = \"a\", range_v = 10.0 }").open());
    assert!(error.contains("error -200077"), "{error}");
    let error = error_of(opened(&folder.path().join("nowhere"), 12_800.0, TWO).open());
    assert!(error.starts_with("NI-DAQmx: NI-DAQmx cannot be used: "), "{error}");
    assert!(error.ends_with("install NI-DAQmx from ni.com, or give the library's path"), "{error}");
}
