//! Levels against the files that they are made from.

use gearwatch_runtime::stop::Stop;
use serde_json::{Value, json};

use super::*;
use crate::keep::{Keeping, take_closed};
use crate::sample::{START, windows, write};
use crate::{HistoryError, files};

fn alarm(t_ns: i64, event: &str) -> (String, i64, Value) {
    let record = json!({ "bench": "b", "id": "s@a", "stage": "s", "channel": "a", "severity": "warning", "since_ns": START, "t_ns": t_ns,
        "active": event != "ended", "acknowledged": event == "acknowledged", "over": event == "ended", "event": event, "who": "shift A", "why": "seen",
        "from": "", "acknowledged_ns": if event == "acknowledged" { t_ns } else { 0 } });
    ("/alarm".to_owned(), t_ns, record)
}

/// Three files of two hours and a half; the last is being written.
fn log(folder: &Path) {
    let mut first = windows(0, 100);
    first.push(alarm(START + 600 * SECOND, "raised"));
    write(folder, 1, &first);
    let mut second = windows(100, 97);
    second.push(alarm(START + 4000 * SECOND, "acknowledged"));
    let gap = json!({ "channel": "a", "first": 1, "last": 2, "count": 2, "cause": "overload", "t_ns": START + 5000 * SECOND });
    second.push(("/gap".to_owned(), START + 5000 * SECOND, gap));
    write(folder, 2, &second);
    write(folder, 3, &windows(197, 100));
    take_closed(folder, &Stop::default(), &Keeping::default()).expect("taken in");
}

fn plain(folder: &Path, every: i64, from: Option<i64>, to: Option<i64>) -> History {
    let mut history = History::new(every, from, to);
    for path in files(folder).expect("a folder") {
        history.read(&path).expect("a file");
    }
    history.finish();
    history
}

fn through_levels(folder: &Path, every: i64, from: Option<i64>, to: Option<i64>) -> (History, usize) {
    let mut history = History::new(every, from, to);
    let levels = Levels::read(folder).expect("readable").expect("levels");
    let known = levels.fill(&mut history, from, to).expect("filled");
    for path in files(folder).expect("a folder") {
        if !known.contains(&crate::keep::name(&path)) {
            history.read(&path).expect("a file");
        }
    }
    history.finish();
    (history, known.len())
}

/// Numbers in single precision: 6e-8 of each, and no more than some twenty of them are put together
/// here.
fn alike(a: f64, b: f64) -> bool {
    a.is_nan() && b.is_nan() || (a - b).abs() <= 2e-6 * a.abs().max(b.abs()).max(1e-3)
}

/// A history through the levels says what one says that reads every file: by 2 min, by hours, by
/// days, with and without limits.
#[test]
fn oracle_levels_say_what_the_files_say() {
    let folder = tempfile::tempdir().expect("a folder");
    log(folder.path());
    let hour = 3600 * SECOND;
    for (every, from, to) in [
        (120 * SECOND, None, None),
        (600 * SECOND, Some(START + 600 * SECOND), None),
        (hour, None, Some(START + hour)),
        (DAY * SECOND, None, None),
    ] {
        let (said, known) = through_levels(folder.path(), every, from, to);
        assert_eq!(known, 2, "the file that is being written is in no level");
        let files = plain(folder.path(), every, from, to);
        let (a, b): (Vec<_>, Vec<_>) = (said.rows().collect(), files.rows().collect());
        assert_eq!(a.len(), b.len(), "{every}");
        for ((key, at, x), (other, when, y)) in a.into_iter().zip(b) {
            assert_eq!((key, at), (other, when));
            assert_eq!((x.windows, x.states, x.not_ok, x.levels), (y.windows, y.states, y.not_ok, y.levels));
            assert_eq!(x.indicators.len(), y.indicators.len());
            for (x, y) in x.means().zip(y.means()) {
                assert_eq!(x.count(), y.count());
                let (x, y) = (x.estimate(0.5), y.estimate(0.5));
                assert!(alike(x.value, y.value) && alike(x.sigma, y.sigma), "{every} {at}: {x:?} {y:?}");
            }
        }
        assert_eq!(said.events, files.events);
        assert_eq!(said.alarms().collect::<Vec<_>>(), files.alarms().collect::<Vec<_>>());
        // Operating time lies in the levels by hours.
        if every % hour == 0 {
            let hours =
                |h: &History| h.operating().map(|(k, s)| (k.clone(), s.values().sum::<f64>())).collect::<Vec<_>>();
            assert_eq!(hours(&said), hours(&files));
        }
    }
}

#[test]
fn conform_a_file_counts_once_and_unaligned_times_are_left_to_the_files() {
    let folder = tempfile::tempdir().expect("a folder");
    log(folder.path());
    let count =
        || through_levels(folder.path(), DAY * SECOND, None, None).0.rows().map(|(_, _, s)| s.windows).sum::<u64>();
    let before = count();
    take_closed(folder.path(), &Stop::default(), &Keeping::default()).expect("nothing to take in");
    let mut levels = Levels::open(folder.path()).expect("levels");
    let path = files(folder.path()).expect("a folder").remove(0);
    let mut again = History::new(FINEST_NS, None, None);
    again.read(&path).expect("a file");
    levels.take(&crate::keep::name(&path), &again).expect("known already");
    assert_eq!((before, count()), (594, 594));
    assert_eq!(through_levels(folder.path(), DAY * SECOND, Some(START + 7), None).1, 0);
    assert_eq!(through_levels(folder.path(), 7 * SECOND, None, None).1, 0);
}

/// Spectra of the levels are the first of each 10 min, as they were logged to the step of the code.
#[test]
fn conform_spectra_and_alarms_of_any_time_are_found() {
    let folder = tempfile::tempdir().expect("a folder");
    log(folder.path());
    let levels = Levels::read(folder.path()).expect("readable").expect("levels");
    let spectra = levels.spectra("b", "a", START, START + 7200 * SECOND, 120).expect("spectra");
    let times: Vec<i64> = spectra.iter().map(|s| (s.t0_ns - START) / SECOND).collect();
    // The two closed files hold windows 0 to 196, one every 30 s, and a spectrum each minute.
    assert_eq!(times, [0, 600, 1200, 1800, 2400, 3000, 3600, 4200, 4800, 5400]);
    let [first, amplitude] = [spectra[1].first_order, f64::from(spectra[1].amplitude[49])];
    assert!(first == 0.0 && (amplitude / (0.05 * 21.0) - 1.0).abs() < 6e-4, "{first} {amplitude}");
    assert!(levels.spectra("b", "b", START, START + 7200 * SECOND, 120).expect("none").is_empty());
    let told: Vec<_> =
        levels.alarms(START, START + 7200 * SECOND, 10).expect("alarms").into_iter().map(|(_, a)| a.event).collect();
    assert_eq!(told, ["raised", "acknowledged"]);
    assert_eq!(levels.events(START, START + 7200 * SECOND, 1).expect("events").len(), 1, "the newest alone");
}

/// What is finer goes earlier, by spans and not by the clock: one window of a wrong clock takes the
/// place of one span.
#[test]
fn analytic_a_level_keeps_so_many_spans() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut levels = Levels::open(folder.path()).expect("levels");
    let kept = LEVELS[0].1 / LEVELS[0].0;
    let key = || (("b".to_owned(), "s".to_owned(), "a".to_owned()), "g");
    let fill = |from: i64, count: i64| -> Result<History> {
        let mut history = History::new(FINEST_NS, None, None);
        let mut span = Span::new();
        span.windows = 4;
        for i in from..from + count {
            history.put(key(), START + i * FINEST_NS, &span).expect("few rows");
        }
        Ok(history)
    };
    levels.take("1", &fill(0, kept + 100).expect("spans")).expect("taken in");
    levels.take("2", &fill(1_000_000, 1).expect("a wrong clock")).expect("taken in");
    let count = |level: i64| -> i64 {
        levels.db.query_row("SELECT count(*) FROM span WHERE level = ?1", [level], |row| row.get(0)).expect("a count")
    };
    assert_eq!(count(120), kept);
    assert_eq!(count(600), (kept + 100) / 5 + 1);
    let first: i64 =
        levels.db.query_row("SELECT min(at) FROM span WHERE level = 120", [], |row| row.get(0)).expect("a time");
    assert_eq!(first * SECOND, START + 101 * FINEST_NS);
    // A time that only coarser levels reach is shown by these.
    let hour = 3600 * SECOND;
    assert_eq!(levels.level_for(120 * SECOND, START + hour).expect("a level"), Some((600 * SECOND, 600 * SECOND)));
    assert_eq!(levels.level_for(120 * SECOND, START + 20 * hour).expect("a level"), Some((120 * SECOND, 120 * SECOND)));
    assert_eq!(levels.level_for(6 * hour, START).expect("a level"), Some((hour, 6 * hour)));
    assert_eq!(levels.level_for(5 * SECOND, START).expect("a level"), None);
}

/// A reader that has seen rows without a file is not told that the file is in them: it would be in
/// neither.
#[test]
fn regress_a_file_that_is_taken_in_meanwhile_is_not_lost() {
    let folder = tempfile::tempdir().expect("a folder");
    log(folder.path());
    let key = ("b".to_owned(), "s".to_owned(), "a".to_owned());
    let count = |levels: &Levels| -> u64 {
        let rows = levels.row(&key, DAY * SECOND, DAY * SECOND, START, START + DAY * SECOND).expect("a row");
        rows.values().map(|span| span.windows).sum()
    };
    let reader = Levels::read(folder.path()).expect("readable").expect("levels");
    assert_eq!(count(&reader), 197);
    write(folder.path(), 4, &windows(297, 1));
    let place = folder.path().to_owned();
    let taking = std::thread::spawn(move || take_closed(&place, &Stop::default(), &Keeping::default()));
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(reader.files().expect("names").len(), 2, "as when the rows were read");
    drop(reader);
    taking.join().expect("no panic").expect("taken in");
    let after = Levels::read(folder.path()).expect("readable").expect("levels");
    assert_eq!((count(&after), after.files().expect("names").len()), (297, 3));
}

#[test]
fn conform_what_is_no_database_is_said_to_be_damaged() {
    let folder = tempfile::tempdir().expect("a folder");
    assert!(Levels::read(folder.path()).expect("nothing").is_none());
    std::fs::write(folder.path().join(FILE_NAME), vec![7_u8; 9000]).expect("written");
    assert!(Levels::open(folder.path()).expect_err("no database").is_damage());
    assert!(Levels::read(folder.path()).expect_err("no database").is_damage());
    let error = HistoryError::from(Levels::read(folder.path()).expect_err("no database"));
    assert!(error.to_string().contains(FILE_NAME), "{error}");
}
