//! Several benches and sources in one service: what dies takes nothing else with it.
#![allow(clippy::print_stdout, reason = "campaigns tell their figures")]

use std::time::{Duration, Instant};

use gearwatch_core::verdict::MachineState;
use gearwatch_daemon::states::{BenchInstrument, SourceCondition};
use gearwatch_emulate::{InstrumentConfig, TroubleConfig};

use super::support::{Running, bench_file, instrument, runtime, wait_until};

/// Two benches, one fed by an instrument whose plug is pulled: it is NOT OK within two deadlines,
/// comes back when the instrument does, and the other bench misses no window and no sample.
#[test]
fn conform_a_dead_instrument_leaves_the_other_bench_alone() {
    const DEADLINE_SECS: f64 = 1.0;
    let runtime = runtime();
    let first = instrument(&runtime, InstrumentConfig::default());
    let address = first.address();
    let folder = tempfile::tempdir().unwrap();
    bench_file(folder.path(), "one.toml", "one");
    bench_file(folder.path(), "two.toml", "two");
    let text = format!(
        "format = \"gearwatch-service/1\"\n[service]\nstatus_socket = \"s.sock\"\nself_test = false\n\
         [[bench]]\nfile = \"one.toml\"\n[[bench.source]]\nkind = \"lanxi\"\naddress = \"{address}\"\nsample_rate_hz = 16384.0\n\
         data_deadline_secs = {DEADLINE_SECS:?}\nchannels = [{{ input = 1, sensor = \"acc_1\" }}]\n\
         [[bench]]\nfile = \"two.toml\"\n[[bench.source]]\nkind = \"test_signal\"\n"
    );
    let running = Running::start(folder, &text);
    wait_until("both deliver", || running.bench("one").windows_judged > 0 && running.bench("two").windows_judged > 0);
    drop(first);
    let pulled = Instant::now();
    wait_until("the first is not all right", || running.bench("one").instrument == BenchInstrument::Silent);
    let told = pulled.elapsed().as_secs_f64();
    // The state is published once a second.
    assert!(told < 2.0 * DEADLINE_SECS + 1.0, "{told}");
    assert_eq!(running.bench("one").machine, MachineState::Unknown);
    let before = running.bench("two").windows_judged;
    wait_until("the second goes on", || running.bench("two").windows_judged > before + 1);
    let config = InstrumentConfig { listen: address, ..InstrumentConfig::default() };
    let mut second = None;
    wait_until("the port is free", || {
        let config = config.clone();
        second = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| instrument(&runtime, config))).ok();
        second.is_some()
    });
    wait_until("the first is back", || running.bench("one").sources[0].state == SourceCondition::Running);
    wait_until("the outage is a gap", || running.bench("one").gaps == 1);
    let one = running.bench("one");
    assert!(one.samples_missing > 0 && one.sources[0].opened >= 2, "{one:?}");
    let two = running.bench("two");
    assert_eq!((two.gaps, two.samples_missing, two.windows_shed, two.sources[0].dropped), (0, 0, 0, 0));
    assert_eq!(two.sources[0].state, SourceCondition::Running);
    let stopping = Instant::now();
    let summary = running.stop();
    assert!(summary.stopped && summary.failed.is_empty(), "{summary:?}");
    assert!(stopping.elapsed() < Duration::from_secs(3));
    let stats = second.unwrap();
    assert_eq!(stats.stats().closed_in_order.load(std::sync::atomic::Ordering::Relaxed), 1, "left idle");
}

/// A bench on a bad network beside one on a good one: the good one misses nothing, the bad one is
/// never called normal while nothing comes.
#[test]
#[ignore = "forty seconds; just campaign-network"]
fn conform_the_neighbour_of_a_bad_network_misses_nothing() {
    const SECS: f64 = 40.0;
    let runtime = runtime();
    let trouble = TroubleConfig {
        stall_every_secs: Some(5.0),
        stall_secs: 1.5,
        drop_every_secs: Some(6.0),
        ..TroubleConfig::of_network(11)
    };
    let bad = instrument(&runtime, InstrumentConfig { trouble, ..InstrumentConfig::default() });
    let folder = tempfile::tempdir().unwrap();
    bench_file(folder.path(), "bad.toml", "bad");
    bench_file(folder.path(), "good.toml", "good");
    let text = format!(
        "format = \"gearwatch-service/1\"\n[service]\nstatus_socket = \"s.sock\"\nself_test = false\n\
         [[bench]]\nfile = \"bad.toml\"\n[[bench.source]]\nkind = \"lanxi\"\naddress = \"{}\"\nsample_rate_hz = 16384.0\n\
         data_deadline_secs = 1.0\nchannels = [{{ input = 1, sensor = \"acc_1\" }}]\n\
         [[bench]]\nfile = \"good.toml\"\n[[bench.source]]\nkind = \"test_signal\"\n",
        bad.address()
    );
    let running = Running::start(folder, &text);
    let began = Instant::now();
    while began.elapsed().as_secs_f64() < SECS {
        let bench = running.bench("bad");
        if bench.sources[0].state != SourceCondition::Running {
            assert_ne!(bench.machine, MachineState::Normal);
            assert_ne!(bench.instrument, BenchInstrument::OK);
        }
        std::thread::sleep(Duration::from_millis(200));
    }
    let (bad, good) = (running.bench("bad"), running.bench("good"));
    running.stop();
    println!(
        "bad: {} windows, {} gaps, opened {} times; good: {} windows, {} gaps, {} shed",
        bad.windows_judged, bad.gaps, bad.sources[0].opened, good.windows_judged, good.gaps, good.windows_shed
    );
    assert!(bad.gaps > 0 && bad.sources[0].opened > 1, "{bad:?}");
    assert_eq!((good.gaps, good.samples_missing, good.windows_shed, good.windows_failed), (0, 0, 0, 0));
    assert_eq!(good.sources[0].dropped, 0);
    // All that was due: 2048 samples a second since the start, to within two windows that are under
    // way.
    let due = (began.elapsed().as_secs_f64() - 2.0) * 2048.0;
    assert!(good.samples_in as f64 > due, "{} of {due}", good.samples_in);
}
