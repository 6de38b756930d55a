//! The LAN-XI source against the emulated instrument.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use gearwatch_core::block::{Packet, Quality};
use gearwatch_emulate::{Instrument, InstrumentConfig, TroubleConfig};

use super::support::{DEADLINE, Judge, Opened, instrument, runtime, source, wait_until};

const CHANNELS: &str =
    "channels = [{ input = 1, sensor = \"a\" }, { input = 2, sensor = \"b\" }]\nsample_rate_hz = 16384.0";

fn lanxi(instrument: &Instrument, keys: &str) -> Opened {
    source(&format!("kind = \"lanxi\"\naddress = \"{}\"\n{CHANNELS}\n{keys}", instrument.address()))
}

fn with_trouble(trouble: TroubleConfig) -> InstrumentConfig {
    InstrumentConfig { trouble, ..InstrumentConfig::default() }
}

/// Two seconds of signal in a tenth of a second: every sample, in order, with the transducer's
/// unit; then idle again, in the right order.
#[test]
fn conform_every_sample_arrives_and_the_end_is_in_order() {
    let runtime = runtime();
    let instrument = instrument(&runtime, 20.0, InstrumentConfig::default());
    let source = lanxi(&instrument, "");
    let mut judge = Judge::default();
    let mut pull = source.open().unwrap();
    while judge.samples < 2 * 32_768 {
        let packet = pull().unwrap().unwrap();
        if let Packet::Vibration(block) = &packet {
            assert_eq!((&*block.unit, block.sample_rate_hz), ("1", 16_384.0));
        }
        judge.take(&packet);
    }
    assert_eq!((judge.gaps, judge.desynchronised, judge.wrong_alone), (0, 0, 0));
    source.context.stop.now();
    // What was decoded already still comes.
    while pull().expect("it ends without an error when told").is_some() {}
    drop(pull);
    let stats = instrument.stats();
    assert_eq!(stats.closed_in_order.load(Ordering::Relaxed), 1);
    assert_eq!(stats.closed_in_wrong_order.load(Ordering::Relaxed), 0);
    assert_eq!(stats.refused.load(Ordering::Relaxed), 0);
}

/// One input of two, and a sensitivity of the configuration's own.
#[test]
fn conform_inputs_and_sensitivity_are_as_configured() {
    let runtime = runtime();
    let instrument = instrument(&runtime, 20.0, InstrumentConfig::default());
    let keys = "channels = [{ input = 2, sensor = \"only\", sensitivity_v_per_unit = 0.5, unit = \"g\" }]\nsample_rate_hz = 16384.0";
    let source = source(&format!("kind = \"lanxi\"\naddress = \"{}\"\n{keys}", instrument.address()));
    let mut pull = source.open().unwrap();
    for _ in 0..10 {
        let Some(Packet::Vibration(block)) = pull().unwrap() else { panic!("no block") };
        assert_eq!((&*block.sensor, &*block.unit), ("only", "g"));
        // Whatever the sensitivity, the physical value is that of the material; half a step of
        // 24 bit of a full scale of 24 g is 1.4e-6.
        let first = block.samples.iter().next().unwrap();
        assert!((first - block.first_sample_index as f64 * 11.885022274370185 / 8_388_608.0).abs() < 2e-6, "{first}");
    }
}

/// Overruns are told by the instrument, and their length by its time: each index jump is as long as
/// the ramp says.
#[test]
fn conform_overruns_become_gaps_of_the_right_length() {
    let runtime = runtime();
    let trouble = TroubleConfig { seed: 3, overrun_every_secs: Some(2.0), ..TroubleConfig::default() };
    let instrument = instrument(&runtime, 20.0, with_trouble(trouble));
    let mut judge = Judge::default();
    let errors = lanxi(&instrument, "").read_for(Duration::from_secs(1), &mut judge);
    assert_eq!(errors, [""; 0]);
    assert!(judge.gaps >= 4, "{judge:?}");
    assert_eq!((judge.desynchronised, judge.wrong_alone, judge.wrong_length), (0, 0, 0));
}

/// A clipped channel is flagged, by the stream's quality message and by the status beside it, and
/// not for ever.
#[test]
fn conform_overload_is_flagged_and_passes() {
    let runtime = runtime();
    let trouble = TroubleConfig { seed: 1, clip_every_secs: Some(4.0), ..TroubleConfig::default() };
    let instrument = instrument(&runtime, 20.0, with_trouble(trouble));
    let mut pull = lanxi(&instrument, "").open().unwrap();
    let mut seen = Vec::new();
    while seen.len() < 4000 && !(seen.contains(&Quality::OVERLOAD.0) && seen.ends_with(&[0; 64])) {
        if let Some(Packet::Vibration(block)) = pull().unwrap() {
            seen.push(block.quality.0);
        }
    }
    assert!(seen.contains(&Quality::OVERLOAD.0), "never overloaded");
    assert!(seen.ends_with(&[0; 64]), "overloaded for ever");
}

/// Silence: the source gives up after its data deadline, not after the two hours of TCP.
#[test]
fn conform_a_silent_instrument_is_an_error_after_the_deadline() {
    let runtime = runtime();
    let trouble = TroubleConfig { mute_after_secs: Some(1.0), ..TroubleConfig::default() };
    let instrument = instrument(&runtime, 10.0, with_trouble(trouble));
    let mut pull = lanxi(&instrument, "").open().unwrap();
    let mut heard = Instant::now();
    let error = loop {
        match pull() {
            Ok(_) => heard = Instant::now(),
            Err(e) => break e.to_string(),
        }
    };
    assert!(error.contains("no samples of a for 0.4 s"), "{error}");
    let silence = heard.elapsed();
    // The socket is looked at every 50 ms; a busy machine may add to that.
    assert!(silence >= DEADLINE.mul_f64(0.9) && silence < 2 * DEADLINE, "{silence:?}");
}

/// 403: told with its state and what to do; a measurement of somebody else is ended only where that
/// is asked for.
#[test]
fn conform_a_busy_instrument_is_left_alone_unless_told_otherwise() {
    let runtime = runtime();
    let instrument = instrument(&runtime, 20.0, InstrumentConfig::default());
    let mut somebody = lanxi(&instrument, "").open().unwrap();
    assert!(somebody().is_ok());
    let error = lanxi(&instrument, "").open().err().unwrap().to_string();
    assert!(error.contains("403") && error.contains("RecorderRecording") && error.contains("take_over"), "{error}");
    assert!(somebody().is_ok(), "it was disturbed");
    let mut other = lanxi(&instrument, "take_over = true").open().unwrap();
    assert!(other().is_ok());
    // The first one is told that its measurement was ended.
    let error = std::iter::repeat_with(&mut somebody).find_map(Result::err).unwrap().to_string();
    assert!(error.contains("closed the stream") || error.contains("does not measure"), "{error}");
}

/// Another instrument at the same address is refused, with both serial numbers.
#[test]
fn conform_another_instrument_is_refused() {
    let runtime = runtime();
    let first = instrument(&runtime, 20.0, InstrumentConfig::default());
    let address = first.address();
    let source = lanxi(&first, "");
    assert!(source.open().unwrap()().is_ok());
    drop(first);
    let again = |serial| InstrumentConfig { listen: address, serial, ..InstrumentConfig::default() };
    let mut second = None;
    wait_until("the port is free", || {
        second = std::panic::catch_unwind(|| instrument(&runtime, 20.0, again(7))).ok();
        second.is_some()
    });
    let error = source.open().err().unwrap().to_string();
    assert!(error.contains("no. 7") && error.contains("100001"), "{error}");
    let pinned = lanxi(second.as_ref().unwrap(), "serial = 8").open().err().unwrap().to_string();
    assert!(pinned.contains("no. 7") && pinned.contains("no. 8"), "{pinned}");
}

/// What is asked for and not there is named, and the instrument is left idle.
#[test]
fn conform_what_the_instrument_cannot_do_is_said() {
    let runtime = runtime();
    let instrument = instrument(&runtime, 20.0, InstrumentConfig::default());
    for (keys, why) in [
        ("channels = [{ input = 9, sensor = \"a\" }]\nsample_rate_hz = 16384.0", "it has no input 9; it has 2"),
        ("channels = [{ input = 1, sensor = \"a\" }]\nsample_rate_hz = 51200.0", "cannot sample at 51200"),
        ("channels = [{ input = 1, sensor = \"a\" }]\nsample_rate_hz = 8192.0", "400 (the material has 16384"),
    ] {
        let source = source(&format!("kind = \"lanxi\"\naddress = \"{}\"\n{keys}", instrument.address()));
        let error = source.open().err().unwrap().to_string();
        assert!(error.contains(why), "{why}: {error}");
    }
    let away = source(&format!("kind = \"lanxi\"\naddress = \"127.0.0.1:9\"\n{CHANNELS}"));
    let error = away.open().err().unwrap().to_string();
    assert!(error.starts_with("127.0.0.1:9: module/info: no answer"), "{error}");
    // Idle: it can be opened at once.
    assert!(lanxi(&instrument, "").open().is_ok());
}

/// Numbers go on over a reset, and the missing time between is a gap.
#[test]
fn conform_a_reset_is_a_gap_and_the_numbers_go_on() {
    let runtime = runtime();
    let trouble = TroubleConfig { seed: 2, drop_every_secs: Some(4.0), split: true, ..TroubleConfig::default() };
    let instrument = instrument(&runtime, 20.0, with_trouble(trouble));
    let mut judge = Judge::default();
    let errors = lanxi(&instrument, "").read_for(Duration::from_secs(2), &mut judge);
    assert!(errors.len() >= 2, "{errors:?}");
    assert!(errors.iter().all(|e| e.contains("stream")), "{errors:?}");
    assert!(judge.gaps as usize >= errors.len(), "{judge:?}");
    assert_eq!((judge.desynchronised, judge.wrong_alone), (0, 0));
}
