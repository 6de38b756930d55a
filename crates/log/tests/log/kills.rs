//! The machine stops at every storage call there is, and the power goes at thousands of random
//! ones.

use std::collections::BTreeSet;

use gearwatch_core::verdict::Rank;
use gearwatch_log::{Cause, LogConfig, Sent, Stepper};
use gearwatch_testkit::disk::{Fault, Plan, Simulated};

use gearwatch_testkit::log::{Content, at, content, context, line, small, verdict};

/// What the outside knows of a run that ended somehow.
#[derive(Default)]
struct Outside {
    /// Numbers that were acknowledged by the run that gave them out.
    acknowledged: BTreeSet<u64>,
    /// (sequence number, window) of every verdict that was accepted.
    accepted: Vec<(u64, u64)>,
    next_window: u64,
}

/// Starts the log, sends some windows, acknowledges what is acknowledged, stops; or gets as far as
/// the disk lets it.
fn run(disk: &Simulated, config: &LogConfig, outside: &mut Outside, start_ms: u64, windows: u64) {
    let Ok(mut log) = Stepper::start(config.clone(), context(), Box::new(disk.clone()), at(start_ms)) else { return };
    let before = outside.accepted.len();
    for step in 0..windows {
        let now = at(start_ms + step * 4);
        if let Sent::Queued { seq } = log.send(verdict(outside.next_window, Rank::Zero), now) {
            outside.accepted.push((seq, outside.next_window));
        }
        outside.next_window += 1;
        log.step(now);
        // A machine that has stopped tells nobody anything.
        if disk.crashed() {
            return;
        }
        let durable = log.durable_seq();
        outside
            .acknowledged
            .extend(outside.accepted[before..].iter().map(|&(seq, _)| seq).filter(|seq| *seq <= durable));
    }
    if log.stop(at(start_ms + windows * 4)) && !disk.crashed() {
        outside.acknowledged.extend(outside.accepted[before..].iter().map(|&(seq, _)| seq));
    }
}

/// Everything that was acknowledged is there, once, as it was sent; nothing is there that was not
/// sent; and what is missing is covered by a gap record.
fn judge(label: &str, content: &Content, outside: &Outside) {
    for &(seq, window) in &outside.accepted {
        match content.verdicts.get(&seq) {
            Some(data) => assert_eq!(*data, line(window, Rank::Zero), "{label}: result {seq} is not what was sent"),
            None => {
                assert!(!outside.acknowledged.contains(&seq), "{label}: result {seq} was acknowledged and is lost");
                let covered = |gap: &&gearwatch_log::Gap| gap.first <= seq && seq <= gap.last;
                let gap = content.gaps.iter().find(covered);
                let gap = gap.unwrap_or_else(|| panic!("{label}: no gap record covers the lost result {seq}"));
                assert_eq!(gap.cause, Cause::UncleanEnd, "{label}");
            }
        }
    }
    let sent = |seq: &u64| outside.accepted.iter().any(|(accepted, _)| accepted == seq);
    assert!(content.verdicts.keys().all(sent), "{label}: a result that nobody sent");
    let mut accepted: Vec<u64> = outside.accepted.iter().map(|&(seq, _)| seq).collect();
    accepted.sort_unstable();
    assert!(accepted.windows(2).all(|pair| pair[0] < pair[1]), "{label}: a number was given out twice");
}

const WINDOWS: u64 = 60;

/// Runs until the n-th call fails, then comes back and goes on; true when the run came to its end
/// before the n-th call.
fn one(label: &str, seed: u64, plan: Plan, power: bool) -> bool {
    let disk = Simulated::new(seed);
    let mut outside = Outside::default();
    // Two starts before the fault, so that a recovery and a clean start are among the calls.
    let config = LogConfig { keep_bytes: 24 << 10, ..small() };
    disk.plan(Some(plan));
    run(&disk, &config, &mut outside, 0, WINDOWS);
    run(&disk, &config, &mut outside, 10_000, WINDOWS);
    let through = disk.calls() < plan.call;
    if power {
        disk.power_cut()
    } else {
        disk.restart()
    }
    let keeps_all = LogConfig { keep_bytes: 1 << 30, ..config };
    run(&disk, &keeps_all, &mut outside, 20_000, 3);
    let mut content = content(&disk.contents());
    // What retention removed was durable once.
    if let Some(first) = content.groups.first().map(|group| group.seq_first) {
        outside.accepted.retain(|&(seq, _)| seq >= first);
        content.verdicts.retain(|&seq, _| seq >= first);
    }
    judge(label, &content, &outside);
    let windows = outside.accepted.iter().rev().take(3);
    assert!(windows.clone().all(|(seq, _)| content.verdicts.contains_key(seq)), "{label}: the log goes on");
    through
}

#[test]
fn conform_a_stop_at_any_storage_call_loses_nothing_that_was_acknowledged() {
    at_each_call(&[Fault::CrashBefore, Fault::CrashDuring, Fault::CrashAfter]);
}

#[test]
fn conform_an_error_at_any_storage_call_loses_nothing_that_was_acknowledged() {
    at_each_call(&[Fault::Io, Fault::Full]);
}

/// Each fault once at every storage call of a run, with and without a power cut after it.
fn at_each_call(faults: &[Fault]) {
    for &fault in faults {
        for power in [false, true] {
            let mut call = 1;
            while !one(
                &format!("{fault:?} at call {call}, power {power}"),
                call,
                Plan { call, fault, for_good: false },
                power,
            ) {
                call += 1;
            }
            assert!(call > 60, "only {call} calls were tried: the run is too short to mean anything");
        }
    }
}

/// From some call on the disk is broken, until somebody exchanges it after a power cut.
#[test]
fn conform_a_disk_that_breaks_for_good_keeps_what_was_acknowledged() {
    for fault in [Fault::Io, Fault::Full] {
        for call in 1..120 {
            one(&format!("{fault:?} from call {call} on"), call, Plan { call, fault, for_good: true }, true);
        }
    }
}

/// Crash at a random call, crash again at a random call of the recovery or after it, and so on,
/// five times; then all must be there.
#[test]
fn conform_ten_thousand_random_crashes_lose_nothing_that_was_acknowledged() {
    let mut tail_losses = 0;
    for seed in 0..2_000_u64 {
        let disk = Simulated::new(seed);
        let mut outside = Outside::default();
        let config = LogConfig { keep_bytes: 1 << 30, ..small() };
        for crash in 0..5_u64 {
            let random = (seed * 5 + crash).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32;
            let fault = [Fault::CrashBefore, Fault::CrashDuring, Fault::CrashAfter][random as usize % 3];
            disk.plan(Some(Plan { call: 1 + random / 3 % 60, fault, for_good: false }));
            run(&disk, &config, &mut outside, crash * 10_000, 8);
            if random & 0x400 == 0 { disk.restart() } else { disk.power_cut() }
        }
        run(&disk, &config, &mut outside, 60_000, 2);
        let content = content(&disk.contents());
        judge(&format!("seed {seed}"), &content, &outside);
        tail_losses += outside.accepted.len() - content.verdicts.len();
    }
    assert!(
        tail_losses > 1000,
        "only {tail_losses} unacknowledged results were lost: the cuts came too late to test anything"
    );
}

/// A sync that fails drops the group from the disk, as Linux does; later syncs succeed and bring
/// nothing back.
#[test]
fn conform_a_file_whose_sync_failed_is_never_acknowledged_again() {
    let mut seen = 0;
    for call in 1..60 {
        let disk = Simulated::new(call);
        let mut log = Stepper::start(small(), context(), Box::new(disk.clone()), at(0)).unwrap();
        disk.plan(Some(Plan { call, fault: Fault::Io, for_good: false }));
        let mut next = 0;
        let mut before = log.state().file;
        let mut changed = false;
        while disk.calls() < call && next < 60 {
            before = log.state().file;
            log.send(verdict(next, Rank::Zero), at(next * 12));
            log.step(at(next * 12));
            next += 1;
            changed = log.state().file != before;
        }
        let acknowledged = log.durable_seq();
        disk.plan(None);
        for window in next..next + 3 {
            log.send(verdict(window, Rank::Zero), at(window * 12));
            log.step(at(window * 12));
        }
        let after = log.state().file;
        if changed || after != before {
            seen += 1;
        }
        let last = log.durable_seq();
        assert!(last >= acknowledged);
        drop(log);
        disk.power_cut();
        Stepper::start(small(), context(), Box::new(disk.clone()), at(9_000)).unwrap().stop(at(9_001));
        let content = content(&disk.contents());
        for window in 0..next + 3 {
            if window < last {
                assert_eq!(
                    content.verdicts.get(&(window + 1)),
                    Some(&line(window, Rank::Zero)),
                    "call {call}, window {window}"
                );
            }
        }
    }
    assert!(seen > 20, "only {seen} failures led to a new file");
}

/// Killed with five results that are not durable: the gap record speaks of those, and of what is
/// marked ahead, not of all that a queue could hold. After a power cut nobody knows so much.
#[test]
fn regress_a_kill_does_not_claim_that_a_whole_queue_was_lost() {
    for (power, most) in [(false, 5 + 64), (true, 2 * (64 + 1))] {
        let disk = Simulated::new(11);
        let mut log = Stepper::start(small(), context(), Box::new(disk.clone()), at(0)).unwrap();
        for window in 0..200 {
            log.send(verdict(window, Rank::Zero), at(window * 20));
            log.step(at(window * 20 + 15));
        }
        let durable = log.durable_seq();
        for window in 200..205 {
            log.send(verdict(window, Rank::Zero), at(4000));
        }
        drop(log);
        if power {
            disk.power_cut()
        } else {
            disk.restart()
        }
        let log = Stepper::start(small(), context(), Box::new(disk.clone()), at(9_000)).unwrap();
        let recovery = log.recovery();
        assert_eq!(recovery.last_seq, durable);
        assert!((5..=most).contains(&recovery.lost_max), "power {power}: {}", recovery.lost_max);
    }
}

/// The machine stops, starts, and stops again before the second group of that start is written:
/// what the first stop took must not be a hole that no gap record explains. The first group says
/// it.
#[test]
fn regress_a_start_that_is_killed_at_once_explains_what_was_lost_before_it() {
    let disk = Simulated::new(7);
    let mut outside = Outside::default();
    let log = Stepper::start(small(), context(), Box::new(disk.clone()), at(0)).unwrap();
    for window in 0..20 {
        if let Sent::Queued { seq } = log.send(verdict(window, Rank::Zero), at(window)) {
            outside.accepted.push((seq, window));
        }
    }
    drop(log);
    disk.power_cut();
    for start in 1..4 {
        drop(Stepper::start(small(), context(), Box::new(disk.clone()), at(start * 10_000)).unwrap());
        disk.power_cut();
    }
    Stepper::start(small(), context(), Box::new(disk.clone()), at(50_000)).unwrap().stop(at(50_001));
    let content = content(&disk.contents());
    assert!(content.verdicts.is_empty(), "nothing was written: the test tests something else");
    judge("killed starts", &content, &outside);
}
