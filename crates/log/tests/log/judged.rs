//! The log as its supervisor sees it: nobody says `ok` of results that do not become durable.

use std::time::{Duration, Instant};

use gearwatch_core::verdict::Rank;
use gearwatch_log::{Cause, Disk, LogConfig, Sent, Stepper, spawn};
use gearwatch_testkit::disk::{Fault, Plan, Simulated};

use gearwatch_testkit::log::{at, content, context, small, verdict};

fn secs(mono: u64) -> Duration {
    Duration::from_secs(mono)
}

/// Takes what waits, and writes it when its group is due.
fn write(log: &mut Stepper, ms: u64) {
    log.step(at(ms));
    log.step(at(ms + 10));
}

/// A call to the disk that does not come back: the log's thread says nothing more, and its last
/// word was good.
#[test]
fn regress_a_disk_that_hangs_is_told_after_two_seconds() {
    let disk = Simulated::new(1);
    let mut log = Stepper::start(small(), context(), Box::new(disk), at(0)).unwrap();
    let mut watch = log.watch();
    log.send(verdict(0, Rank::Zero), at(0));
    write(&mut log, 20);
    assert!(watch.look(secs(100)).ok, "all is durable, however long ago");
    // From 100 s on the thread hangs: results come in, and nobody takes a step.
    for window in 1..30 {
        log.send(verdict(window, Rank::Zero), at(100_000 + window * 100));
    }
    let judged = |watch: &mut gearwatch_log::Watch, ms| watch.look(Duration::from_millis(ms));
    assert!(judged(&mut watch, 102_000).ok);
    let hung = judged(&mut watch, 102_300);
    assert!(!hung.ok && hung.stalled && hung.waits > secs(2), "{hung:?}");
    assert!(hung.why.contains("nothing has become durable for 2.2 s"), "{}", hung.why);
    // It comes back.
    log.step(at(124_000));
    log.step(at(124_020));
    let back = judged(&mut watch, 124_030);
    assert!(back.ok && !back.stalled && back.waits.is_zero(), "{back:?}");
}

/// A disk that says what is wrong with it is not all right, but the log does not stand still: a new
/// start would not help.
#[test]
fn regress_a_disk_that_fails_is_told_and_counted() {
    for (fault, word) in [(Fault::Full, "full"), (Fault::Io, "fails")] {
        let disk = Simulated::new(2);
        let mut log = Stepper::start(small(), context(), Box::new(disk.clone()), at(0)).unwrap();
        let mut watch = log.watch();
        disk.plan(Some(Plan { call: 1, fault, for_good: true }));
        log.send(verdict(0, Rank::Zero), at(0));
        write(&mut log, 20);
        let judged = watch.look(secs(5));
        assert!(!judged.ok && !judged.stalled && judged.why.contains(word), "{judged:?}");
        assert!(judged.state.write_failures > 0, "{judged:?}");
        disk.plan(None);
        log.step(at(6_000));
        assert!(!watch.look(secs(6)).ok, "it is remembered for a while");
        assert!(watch.look(secs(17)).ok);
    }
}

/// What finds no room in the queue is lost for the log: while that goes on, and four seconds
/// longer, it is not all right.
#[test]
fn regress_results_that_are_not_logged_are_not_ok() {
    let disk = Simulated::new(3);
    let config = LogConfig { queue_records: 4, ..small() };
    let mut log = Stepper::start(config, context(), Box::new(disk), at(0)).unwrap();
    let mut watch = log.watch();
    let sent: Vec<Sent> = (0..6).map(|window| log.send(verdict(window, Rank::Zero), at(0))).collect();
    assert!(matches!(sent[5], Sent::Shed { total: 2 }));
    log.step(at(20));
    log.step(at(40));
    let judged = watch.look(secs(1));
    assert!(!judged.ok && judged.why.starts_with("2 records were not logged"), "{judged:?}");
    assert!(!watch.look(secs(4)).ok);
    assert!(watch.look(secs(5)).ok);
}

/// The file is removed, or cut, while it is written. That is noticed at the next write or look, the
/// log goes on in a new file, and a gap record says which acknowledged results are gone.
#[test]
fn regress_a_log_that_is_taken_away_is_noticed() {
    for (label, cut_to) in [("removed", None), ("cut to nothing", Some(0)), ("cut", Some(600))] {
        for idle in [false, true] {
            let disk = Simulated::new(4);
            let config = LogConfig { rotate_bytes: 1 << 20, ..small() };
            let mut log = Stepper::start(config.clone(), context(), Box::new(disk.clone()), at(0)).unwrap();
            let mut watch = log.watch();
            for window in 0..5 {
                log.send(verdict(window, Rank::Zero), at(window * 20));
                write(&mut log, window * 20 + 2);
            }
            let (acknowledged, file) = (log.durable_seq(), log.state().file);
            assert_eq!(acknowledged, 5);
            match cut_to {
                None => disk.take_away(&file),
                Some(length) => disk.cut(&file, length),
            }
            if !idle {
                log.send(verdict(5, Rank::Zero), at(200));
                write(&mut log, 202);
            }
            log.step(at(1_000));
            let judged = watch.look(secs(1));
            assert!(!judged.ok && judged.state.files_lost == 1, "{label}: {judged:?}");
            log.send(verdict(6, Rank::Zero), at(1_100));
            log.step(at(1_115));
            log.step(at(1_130));
            assert_ne!(log.state().file, file, "{label}");
            let durable = log.durable_seq();
            assert!(durable > acknowledged, "{label}");
            assert!(log.stop(at(1_200)), "{label}: what is in the log now is whole");
            let mut files = disk.contents();
            files.remove(&file);
            let content = content(&files);
            let gap = content.gaps.iter().find(|gap| gap.cause == Cause::Damage).expect("a gap record");
            assert_eq!((gap.channel.as_str(), gap.first, gap.last), ("log", 1, 5), "{label}");
            assert!(content.verdicts.len() > usize::from(!idle), "{label}");
        }
    }
}

/// The same on a real disk, with the folder itself removed: it is made anew and owned again.
#[test]
fn regress_a_removed_folder_is_made_anew() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("log");
    let config = LogConfig { folder: folder.clone(), group_ms: 10, ..LogConfig::default() };
    let log = spawn(config, context(), Box::new(Disk::open(&folder).unwrap())).unwrap();
    let (mut watch, clock) = log.watch();
    log.send(verdict(0, Rank::Zero));
    let wait_for = |wanted: &mut dyn FnMut() -> bool| {
        let end = Instant::now() + secs(10);
        while !wanted() {
            assert!(Instant::now() < end, "it took more than ten seconds");
            std::thread::sleep(Duration::from_millis(5));
        }
    };
    let durable = log.durable_seq();
    wait_for(&mut || *durable.borrow() == 1);
    std::fs::remove_dir_all(&folder).unwrap();
    wait_for(&mut || watch.look(clock()).state.files_lost == 1);
    assert!(!watch.look(clock()).ok);
    log.send(verdict(1, Rank::Zero));
    wait_for(&mut || folder.is_dir() && *durable.borrow() > 1);
    assert!(Disk::open(&folder).is_err(), "it is owned again");
    assert!(log.stop());
    let files = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path());
    let files = files.filter(|path| path.extension().is_some_and(|end| end == "mcap"));
    let read = files.map(|path| (path.file_name().unwrap().to_str().unwrap().to_owned(), std::fs::read(path).unwrap()));
    let content = content(&read.collect());
    assert!(content.gaps.iter().any(|gap| gap.cause == Cause::Damage && (gap.first, gap.last) == (1, 1)));
}

/// Somebody sets the clock 401 days ahead for some seconds, and files begin meanwhile: nothing is
/// removed. Nor by a clock that goes back. What the log has really lived through ages its files.
#[test]
fn regress_a_clock_that_jumps_removes_no_file() {
    const DAY_MS: u64 = 86_400_000;
    let disk = Simulated::new(5);
    let config = LogConfig { rotate_secs: 3600, keep_secs: 400 * 86_400, ..small() };
    let mut log = Stepper::start(config.clone(), context(), Box::new(disk.clone()), at(0)).unwrap();
    let (mut mono, mut window) = (0, 0);
    let mut go_on = |log: &mut Stepper, windows: u64, ahead_ms: u64| {
        for _ in 0..windows {
            mono += 20;
            let mut now = at(mono);
            now.wall_ns += ahead_ms as i64 * 1_000_000;
            log.send(verdict(window, Rank::Zero), now);
            log.step(now);
            window += 1;
        }
    };
    go_on(&mut log, 150, 0);
    let before = disk.contents().len();
    assert!(before >= 4, "only {before} files: nothing could have been removed");
    go_on(&mut log, 150, 401 * DAY_MS);
    go_on(&mut log, 150, 0);
    go_on(&mut log, 150, 3 * 401 * DAY_MS);
    assert_eq!(log.state().files_removed, 0);
    assert!(disk.contents().len() > before);
    assert!(log.stop(at(mono + 100)));
}

/// Retention by time still works, by the time in which the log was written; and never takes more
/// than a quarter at once.
#[test]
fn conform_old_files_go_some_at_a_time() {
    let disk = Simulated::new(6);
    let config = LogConfig { rotate_secs: 10, keep_secs: 100, ..small() };
    let mut log = Stepper::start(config.clone(), context(), Box::new(disk.clone()), at(0)).unwrap();
    for second in 0..400 {
        log.send(verdict(second, Rank::Zero), at(second * 1000));
        log.step(at(second * 1000 + 15));
    }
    let files = disk.contents().len();
    assert!((10..=12).contains(&files), "{files} files of ten seconds each, where 100 s are kept");
    // Much less is to be kept from now on: each rotation removes a quarter at most.
    assert!(log.stop(at(400_000)));
    let shorter = LogConfig { keep_bytes: 8 << 10, ..config };
    let mut log = Stepper::start(shorter, context(), Box::new(disk.clone()), at(401_000)).unwrap();
    let mut counts = vec![disk.contents().len()];
    for second in 402..520 {
        log.send(verdict(second, Rank::Zero), at(second * 1000));
        log.step(at(second * 1000 + 15));
        counts.push(disk.contents().len());
    }
    assert!(counts.last().is_some_and(|&last| last < files / 2), "{counts:?}");
    assert!(counts.windows(2).all(|pair| pair[0] <= pair[1] + pair[0].div_ceil(4)), "{counts:?}");
}

/// Somebody takes the file away, and the service is told to stop before it has looked: the end is
/// written elsewhere, and says what is gone. It was called a good end, and the next start knew of
/// nothing.
#[test]
fn regress_what_was_taken_away_just_before_the_end_is_told() {
    for cut_to in [None, Some(600)] {
        let disk = Simulated::new(8);
        let config = LogConfig { rotate_bytes: 1 << 20, ..small() };
        let mut log = Stepper::start(config, context(), Box::new(disk.clone()), at(0)).unwrap();
        for window in 0..5 {
            log.send(verdict(window, Rank::Zero), at(window * 20));
            write(&mut log, window * 20 + 2);
        }
        let file = log.state().file;
        match cut_to {
            None => disk.take_away(&file),
            Some(length) => disk.cut(&file, length),
        }
        assert_eq!(log.durable_seq(), 5);
        log.stop(at(120));
        let mut files = disk.contents();
        files.remove(&file);
        let told = content(&files).gaps;
        let gap = told.iter().find(|gap| gap.cause == Cause::Damage).expect("a gap record");
        assert_eq!((gap.channel.as_str(), gap.first, gap.last), ("log", 1, 5));
    }
}

/// The same, and then the service is killed: the next start finds by the numbers given out that
/// there was more than it finds, says so, and gives none of those numbers out again.
#[test]
fn regress_what_was_taken_away_before_a_kill_is_told_by_the_next_start() {
    for files_before in [0, 1] {
        let disk = Simulated::new(9);
        let config = LogConfig { rotate_bytes: 1 << 20, ..small() };
        let mut ms = 0;
        let mut last = 0;
        for _ in 0..files_before {
            let log = Stepper::start(config.clone(), context(), Box::new(disk.clone()), at(ms)).unwrap();
            log.send(verdict(0, Rank::Zero), at(ms));
            assert!(log.stop(at(ms + 20)));
            (ms, last) = (100, 1);
        }
        let mut log = Stepper::start(config.clone(), context(), Box::new(disk.clone()), at(ms)).unwrap();
        for window in 0..200 {
            log.send(verdict(window, Rank::Zero), at(ms + window * 20));
            write(&mut log, ms + window * 20 + 2);
        }
        let (acknowledged, file) = (log.durable_seq(), log.state().file);
        assert_eq!(acknowledged, last + 200);
        disk.take_away(&file);
        drop(log);
        disk.restart();
        let log = Stepper::start(config.clone(), context(), Box::new(disk.clone()), at(10_000)).unwrap();
        assert!(log.recovery().unclean, "{:?}", log.recovery());
        let Sent::Queued { seq } = log.send(verdict(900, Rank::Zero), at(10_001)) else { panic!("it is queued") };
        assert!(seq > acknowledged, "number {seq} is given out again");
        assert!(log.stop(at(10_020)));
        let gaps = content(&disk.contents()).gaps;
        let gap = gaps.iter().find(|gap| gap.channel == "log").expect("a gap record");
        assert!(gap.first == last + 1 && gap.last >= acknowledged && gap.last < seq, "{gap:?}");
    }
}

/// A sync fails, and the service is killed before it can cut the group off. What was not durable is
/// readable then, until the power goes. The next start counts the group as durable, so it must be.
#[test]
fn regress_a_group_whose_sync_failed_is_written_again_before_it_counts() {
    let mut counted = 0;
    for seed in 0..50 {
        let disk = Simulated::new(seed);
        let config = LogConfig { rotate_bytes: 1 << 20, ..small() };
        let mut log = Stepper::start(config.clone(), context(), Box::new(disk.clone()), at(0)).unwrap();
        log.send(verdict(0, Rank::Zero), at(0));
        write(&mut log, 20);
        // The group is appended; its sync and all that follows fail.
        disk.plan(Some(Plan { call: 3, fault: Fault::Io, for_good: true }));
        log.send(verdict(1, Rank::Zero), at(40));
        write(&mut log, 60);
        drop(log);
        disk.restart();
        let log = Stepper::start(config, context(), Box::new(disk.clone()), at(1000)).unwrap();
        let durable = log.recovery().last_seq;
        counted += u64::from(durable == 2);
        drop(log);
        disk.power_cut();
        let found = content_of_closed(&disk.contents());
        assert!(
            found >= durable,
            "seed {seed}: {durable} results counted as durable, {found} are there after the power cut"
        );
    }
    assert!(counted > 10, "the group was found again {counted} times only: nothing was tried");
}

/// Numbers of verdicts in files that have an end.
fn content_of_closed(files: &std::collections::BTreeMap<String, Vec<u8>>) -> u64 {
    let closed = |bytes: &Vec<u8>| mcap::Summary::read(bytes).is_ok_and(|summary| summary.is_some());
    content(&files.iter().filter(|(_, bytes)| closed(bytes)).map(|(n, b)| (n.clone(), b.clone())).collect())
        .verdicts
        .len() as u64
}

/// Whatever call fails while the log is closed: where the end is called a good one, every file has
/// its footer.
#[test]
fn regress_an_end_without_a_footer_is_no_good_end() {
    let (mut good, mut bad) = (0, 0);
    for call in 1..40 {
        for (fault, for_good) in [(Fault::Io, false), (Fault::Io, true), (Fault::Full, false), (Fault::Full, true)] {
            let disk = Simulated::new(call);
            let config = LogConfig { rotate_bytes: 1 << 20, ..small() };
            let mut log = Stepper::start(config, context(), Box::new(disk.clone()), at(0)).unwrap();
            for window in 0..5 {
                log.send(verdict(window, Rank::Zero), at(window * 20));
                write(&mut log, window * 20 + 2);
            }
            disk.plan(Some(Plan { call, fault, for_good }));
            log.send(verdict(5, Rank::Zero), at(200));
            let closed = log.stop(at(210));
            disk.plan(None);
            let open =
                disk.contents().values().filter(|bytes| !mcap::Summary::read(bytes).is_ok_and(|s| s.is_some())).count();
            assert!(
                !closed || open == 0,
                "call {call}, {fault:?}, for good {for_good}: a good end, and {open} files without one"
            );
            (good, bad) = (good + u64::from(closed), bad + u64::from(!closed));
        }
    }
    assert!(good > 0 && bad > 0, "{good} good ends, {bad} others: nothing was tried");
}
