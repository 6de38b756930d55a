//! Campaigns against an emulated instrument on a bad network. A few seeds here;
//! `just campaign-network` runs them all.
//!
//! The tests of this program run one after the other, since one of them counts descriptors.
#![allow(clippy::print_stdout, reason = "campaigns tell their figures")]

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use gearwatch_emulate::{Instrument, InstrumentConfig, TroubleConfig};

#[path = "../acquisition/support.rs"]
#[allow(dead_code, reason = "shared with the other tests of sources")]
mod support;

use support::{DEADLINE, Judge, Opened, instrument, runtime, source, wait_until};

fn one_at_a_time() -> MutexGuard<'static, ()> {
    static TURN: Mutex<()> = Mutex::new(());
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
}

fn lanxi(instrument: &Instrument) -> Opened {
    source(&format!(
        "kind = \"lanxi\"\naddress = \"{}\"\nsample_rate_hz = 16384.0\n\
         channels = [{{ input = 1, sensor = \"a\" }}, {{ input = 2, sensor = \"b\" }}]",
        instrument.address()
    ))
}

/// What a run came to.
#[derive(Debug, Default)]
struct Outcome {
    judge: Judge,
    connections: u64,
    flips: u64,
    errors: usize,
    /// From the last packet to the error that tells the silence (s).
    longest_silence_secs: f64,
}

/// One seed: forty seconds of signal at twenty times their speed, with everything that a network
/// does.
fn run(seed: u64) -> Outcome {
    let runtime = runtime();
    // Overload is no trouble of the network, and would cut the ramp.
    let trouble = TroubleConfig { clip_every_secs: None, ..TroubleConfig::of_network(seed) };
    let config = InstrumentConfig { trouble, ..InstrumentConfig::default() };
    let instrument = instrument(&runtime, 20.0, config);
    let source = lanxi(&instrument);
    let (mut out, began) = (Outcome::default(), Instant::now());
    // Two seconds, or on a busy machine until there is something to judge.
    let goes_on = |samples: u64| {
        let elapsed = began.elapsed().as_secs();
        elapsed < 2 || samples < 100_000 && elapsed < 60
    };
    let mut longest_silence_secs = 0.0_f64;
    while goes_on(out.judge.samples) {
        let mut heard = Instant::now();
        let end = source.open().and_then(|mut pull| {
            heard = Instant::now();
            while goes_on(out.judge.samples) {
                let packet = pull().inspect_err(|error| {
                    // Looked at here, before the connection is taken down.
                    if error.to_string().contains("no samples") {
                        longest_silence_secs = longest_silence_secs.max(heard.elapsed().as_secs_f64());
                    }
                })?;
                let Some(packet) = packet else { break };
                heard = Instant::now();
                out.judge.take(&packet);
            }
            Ok(())
        });
        out.errors += usize::from(end.is_err());
    }
    out.longest_silence_secs = longest_silence_secs;
    out.connections = instrument.stats().measurements.load(Ordering::Relaxed);
    out.flips = instrument.stats().flips.load(Ordering::Relaxed);
    out
}

/// Runs all seeds on some threads, and adds up.
fn campaign(seeds: std::ops::Range<u64>) {
    let (next, all) = (AtomicU64::new(seeds.start), Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                loop {
                    let seed = next.fetch_add(1, Ordering::Relaxed);
                    if seed >= seeds.end {
                        return;
                    }
                    let outcome = run(seed);
                    let judge = &outcome.judge;
                    assert_eq!(judge.desynchronised, 0, "seed {seed}: {outcome:?}");
                    // A flip in a sample changes that sample, which the protocol cannot tell; no
                    // flip may change more.
                    assert!(judge.wrong_alone <= outcome.flips, "seed {seed}: {outcome:?}");
                    // Each new connection after the first that delivered shows as a gap.
                    assert!(judge.samples > 0, "seed {seed}: nothing came: {outcome:?}");
                    assert!(
                        outcome.longest_silence_secs < 2.0 * DEADLINE.as_secs_f64(),
                        "seed {seed}: silence was told late: {outcome:?}"
                    );
                    all.lock().unwrap().push(outcome);
                }
            });
        }
    });
    let all = all.into_inner().unwrap();
    assert_eq!(all.len() as u64, seeds.end - seeds.start);
    let sum = |of: &dyn Fn(&Outcome) -> u64| all.iter().map(of).sum::<u64>();
    println!(
        "{} runs: {} samples, {} gaps, {} samples missing, {} connections, {} errors told, {} bits flipped, of these {} in samples, \
         0 samples out of place without a gap; silence told after {:.2} s at most (deadline {} s)",
        all.len(),
        sum(&|o| o.judge.samples),
        sum(&|o| o.judge.gaps),
        sum(&|o| o.judge.missing),
        sum(&|o| o.connections),
        sum(&|o| o.errors as u64),
        sum(&|o| o.flips),
        sum(&|o| o.judge.wrong_alone),
        all.iter().map(|o| o.longest_silence_secs).fold(0.0, f64::max),
        DEADLINE.as_secs_f64()
    );
    assert!(sum(&|o| o.flips) > 0 && sum(&|o| o.errors as u64) > 0 && sum(&|o| o.judge.gaps) > 0, "no trouble at all");
}

#[test]
fn conform_a_bad_network_never_puts_samples_out_of_place() {
    let _turn = one_at_a_time();
    campaign(1000..1008);
}

#[test]
#[ignore = "two minutes; just campaign-network"]
fn conform_a_bad_network_never_puts_samples_out_of_place_200() {
    let _turn = one_at_a_time();
    campaign(0..200);
}

fn descriptors() -> usize {
    std::fs::read_dir("/proc/self/fd").map_or(0, Iterator::count)
}

/// Connections that end at once, one after the other: as many descriptors and threads afterwards as
/// before.
fn reconnect(times: u64) {
    let runtime = runtime();
    let trouble = TroubleConfig { drop_every_secs: Some(1e-3), ..TroubleConfig::default() };
    let instrument = instrument(&runtime, 20.0, InstrumentConfig { trouble, ..InstrumentConfig::default() });
    let source = lanxi(&instrument);
    let once = || {
        let end = source.open().and_then(|mut pull| {
            while pull()?.is_some() {}
            Ok(())
        });
        assert!(end.is_err(), "it ends with an error");
    };
    let threads = || std::fs::read_dir("/proc/self/task").map_or(0, Iterator::count);
    once();
    // The thread that watched the instrument waits for the end of its last question.
    std::thread::sleep(Duration::from_secs(3));
    let (before, threads_before) = (descriptors(), threads());
    let began = Instant::now();
    (0..times).for_each(|_| once());
    let took = began.elapsed();
    wait_until("threads and descriptors are given back", || {
        descriptors().abs_diff(before) <= 2 && threads() <= threads_before + 1
    });
    println!(
        "{times} reconnects in {:.0} s: {before} descriptors before, {} after; {threads_before} threads before, {} after",
        took.as_secs_f64(),
        descriptors(),
        threads()
    );
    assert!(instrument.stats().measurements.load(Ordering::Relaxed) > times);
}

#[test]
fn conform_reconnects_leak_nothing() {
    if descriptors() == 0 {
        return println!("no /proc here: passed over");
    }
    let _turn = one_at_a_time();
    reconnect(20);
}

#[test]
#[ignore = "a minute; just campaign-network"]
fn conform_reconnects_leak_nothing_1000() {
    let _turn = one_at_a_time();
    reconnect(1000);
}
