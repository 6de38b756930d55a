//! Several benches and sources in one service: what dies takes nothing else with it.

use std::time::{Duration, Instant};

use gearwatch_emulate::InstrumentConfig;

use super::support::{Running, bench_file, instrument, runtime, wait_until};

/// Two benches, one fed by an instrument whose plug is pulled: it is NOT OK within two deadlines, comes back when the instrument does, and
/// the other bench misses no window and no sample.
#[test]
fn conform_a_dead_instrument_leaves_the_other_bench_alone() {
    const DEADLINE_SECS: f64 = 1.0;
    let runtime = runtime();
    let first = instrument(&runtime, 1.0, InstrumentConfig::default());
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
    wait_until("the first is not all right", || running.bench("one").instrument == "silent");
    let told = pulled.elapsed().as_secs_f64();
    // The state is published once a second.
    assert!(told < 2.0 * DEADLINE_SECS + 1.0, "{told}");
    assert_eq!(running.bench("one").machine, "unknown");
    let before = running.bench("two").windows_judged;
    wait_until("the second goes on", || running.bench("two").windows_judged > before + 1);
    let config = InstrumentConfig { listen: address, ..InstrumentConfig::default() };
    let mut second = None;
    wait_until("the port is free", || {
        let config = config.clone();
        second = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| instrument(&runtime, 1.0, config))).ok();
        second.is_some()
    });
    wait_until("the first is back", || running.bench("one").sources[0].state == "running");
    wait_until("the outage is a gap", || running.bench("one").gaps == 1);
    let one = running.bench("one");
    assert!(one.samples_missing > 0 && one.sources[0].opened >= 2, "{one:?}");
    let two = running.bench("two");
    assert_eq!((two.gaps, two.samples_missing, two.windows_shed, two.sources[0].dropped), (0, 0, 0, 0));
    assert_eq!(two.sources[0].state, "running");
    let stopping = Instant::now();
    let summary = running.stop();
    assert!(summary.stopped && summary.failed.is_empty(), "{summary:?}");
    assert!(stopping.elapsed() < Duration::from_secs(3));
    let stats = second.unwrap();
    assert_eq!(stats.stats().closed_in_order.load(std::sync::atomic::Ordering::Relaxed), 1, "left idle");
}
