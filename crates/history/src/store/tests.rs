//! What the page is told of files that are being written, and how long times are shown.

use super::*;
use crate::sample::{START, begin, put, windows, write};

#[test]
fn analytic_thinning_keeps_the_last_and_never_more_than_asked_for() {
    for count in [0, 1, 119, 120, 121, 1000] {
        let mut all: Vec<usize> = (0..count).collect();
        thin(&mut all, 120);
        assert_eq!(all.len(), count.min(120));
        assert_eq!(all.last().copied(), count.checked_sub(1));
    }
}

/// A minute is shown in steps of 5 s, a year in steps of a day; never more points than a screen
/// has.
#[test]
fn analytic_the_longer_the_time_the_longer_the_spans() {
    let asked = |secs: i64| Asked { row: Key::default(), from: 0, to: secs * SECOND, indicator: String::new() };
    let of = |secs: i64| asked(secs).every() / SECOND;
    assert_eq!([60, 3600, 86_400, 7 * 86_400, 31 * 86_400, 365 * 86_400].map(of), [5, 5, 120, 600, 3600, 86_400]);
    for secs in (1..4000).map(|i| i * 10_007) {
        assert!(secs / of(secs) <= MOST_POINTS, "{secs}");
    }
}

/// Windows of a row and spectra of its channel, once nothing is left to be read.
fn told(store: &Store) -> (u64, usize) {
    let (from, to) = (START, START + 12 * 3600 * SECOND);
    let row = ("b".to_owned(), "s".to_owned(), "a".to_owned());
    let asked = Asked { row, from, to, indicator: String::new() };
    let patience = Instant::now() + Duration::from_secs(20);
    loop {
        let answer = store.ask(&asked).expect("a folder");
        if answer["to_read"] == 0 {
            let count = answer["windows"].as_array().into_iter().flatten().filter_map(Value::as_u64).sum();
            return (count, store.sight("b", "a", from, to).expect("a folder").spectra.len());
        }
        assert!(Instant::now() < patience, "{answer}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// What a file has got since it was read is read too: once in a while as long as the file is open,
/// at once when it is closed.
#[test]
fn regress_a_file_that_grows_leaves_no_hole() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let of = |again: Duration| Store { again, ..Store::new(folder.to_owned()) };
    let (eager, patient) = (of(Duration::ZERO), of(Duration::from_secs(3600)));
    let mut log = begin(folder, 1);
    put(&mut log, &windows(0, 10));
    assert_eq!([told(&eager), told(&patient)], [(10, 5); 2]);
    put(&mut log, &windows(10, 10));
    assert_eq!([told(&eager), told(&patient)], [(20, 10), (10, 5)]);
    put(&mut log, &windows(20, 10));
    log.finish().expect("an end");
    write(folder, 2, &windows(30, 4));
    assert_eq!([told(&eager), told(&patient)], [(34, 17); 2]);
}

/// Two files of 25 spans of two rows each, and room for 60: the row that is asked for stays whole,
/// and each file is read once.
#[test]
fn regress_files_of_one_question_do_not_drive_each_other_out() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), 1, &windows(0, 25));
    write(folder.path(), 2, &windows(25, 25));
    let row = ("b".to_owned(), "s".to_owned(), "a".to_owned());
    let other = ("b".to_owned(), "s".to_owned(), "b".to_owned());
    let mut digests = BTreeMap::new();
    for path in crate::files(folder.path()).expect("a folder") {
        let of: Of = (path, 30 * SECOND, indicator_names().position(|name| name == "rms"));
        let digest = Digest::read(&of, 7);
        digests.insert(of, digest);
        make_room(&mut digests, 60, 7, &row);
    }
    let cells = |row: &Key| digests.values().map(|digest| digest.row(row).count()).sum::<usize>();
    assert_eq!((digests.len(), cells(&row), cells(&other)), (2, 50, 0));
    assert!(digests.values().all(|digest| digest.knows(&row) && !digest.knows(&other)));
    // One window in a span: its own indicator, 3 and 4 in turn.
    let rms: Vec<f32> =
        digests.values().flat_map(|digest| digest.row(&row)).map(|(_, cell)| cell.indicator.value).collect();
    assert!(rms.iter().enumerate().all(|(i, &rms)| rms == 3.0 + (i % 2) as f32), "{rms:?}");
    // What an older question wanted goes first.
    make_room(&mut digests, 40, 8, &row);
    assert_eq!(digests.len(), 1);
}
