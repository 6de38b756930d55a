//! `kill -9` at random moments under load, again and again in the same folder.

use std::path::Path;
use std::time::{Duration, Instant};

use gearwatch_log::Cause;

use crate::fixture::Bench;
use crate::service::{
    Moments, configure, ended_within, figure, files, log_of, rounds, said, signal, start, status, wait_for,
};
use gearwatch_testkit::log::{Content, content};

/// Runs of one folder before it is read as a whole.
const CHAIN: u64 = 10;
/// The log must be open again, with what was left behind made readable, within this time.
const RECOVERY: Duration = Duration::from_secs(2);

/// What the outside knows of one run.
struct Run {
    begin_ns: i64,
    end_ns: i64,
    /// Highest number that was published as durable, 0 where none was.
    acknowledged: u64,
}

/// What a campaign saw.
#[derive(Default, Debug)]
pub struct Seen {
    pub kills: u64,
    pub kills_before_any_answer: u64,
    pub verdicts: u64,
    pub acknowledged: u64,
    pub tails: u64,
    pub longest_recovery: Duration,
}

fn now_ns() -> i64 {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap();
    i64::try_from(since.as_nanos()).unwrap()
}

/// Everything that was acknowledged is there once, what is missing is covered by gap records, and
/// none of those covers what was acknowledged.
pub fn judge(label: &str, content: &Content, acknowledged_before: impl Fn(i64) -> u64) -> (u64, u64) {
    let last = content.groups.last().map_or(0, |group| group.seq_last);
    let tails: Vec<_> = content.gaps.iter().filter(|gap| gap.cause == Cause::UncleanEnd).collect();
    for gap in &tails {
        let acknowledged = acknowledged_before(gap.t_ns);
        assert!(gap.first > acknowledged, "{label}: {acknowledged} was acknowledged, and {gap:?} says that it is lost");
    }
    let mut present = vec![false; usize::try_from(last).unwrap() + 1];
    for group in &content.groups {
        (group.seq_first..=group.seq_last).for_each(|seq| present[seq as usize] = true);
    }
    for seq in (1..=last).filter(|&seq| !present[seq as usize]) {
        let covered = tails.iter().any(|gap| gap.first <= seq && seq <= gap.last);
        let near = content.groups.windows(2).find(|pair| pair[0].seq_last < seq && seq < pair[1].seq_first);
        assert!(covered, "{label}: {seq} is missing and no gap record says so: {near:?}, {tails:?}");
    }
    // Verdicts are what was said: whole objects whose windows grow within a run, twice nowhere.
    let mut windows = std::collections::BTreeMap::new();
    for (seq, data) in &content.verdicts {
        let object: serde_json::Value = serde_json::from_slice(data).unwrap();
        let (channel, window) = (object["channel"].as_str().unwrap().to_owned(), object["window"].as_u64().unwrap());
        let before = windows.insert(channel.clone(), window);
        let restarted = window < 3 || tails.iter().any(|gap| gap.last < *seq && seq - gap.last < 200);
        assert!(
            before.is_none_or(|before| before < window) || restarted,
            "{label}: window {window} of {channel} again"
        );
    }
    (content.verdicts.len() as u64, tails.len() as u64)
}

/// One folder: killed again and again, then ended in order and read.
fn chain(bench: &Bench, folder: &Path, moments: &mut Moments, kills: u64, seen: &mut Seen) {
    let further = "group_ms = 50\ngroup_bytes = 16384\nrotate_bytes = 65536";
    let config = configure(bench, folder, "100.0", further);
    let mut runs: Vec<Run> = Vec::new();
    for kill in 0..=kills {
        let _ = std::fs::remove_file(bench.path("status.sock"));
        let begin_ns = now_ns();
        let begin = Instant::now();
        let mut child = start(&config);
        let mut acknowledged = 0;
        let last = kill == kills;
        let end = begin + moments.between(Duration::from_millis(20), Duration::from_millis(900));
        let mut answered = None;
        while Instant::now() < end || (last && acknowledged == 0 && begin.elapsed() < Duration::from_secs(10)) {
            if let Some(seq) = status(bench).as_ref().and_then(log_of).and_then(|log| figure(log, "durable_seq")) {
                answered.get_or_insert_with(|| begin.elapsed());
                acknowledged = acknowledged.max(seq);
            }
            std::thread::sleep(Duration::from_millis(3));
        }
        if let Some(answered) = answered.filter(|_| kill > 0) {
            seen.longest_recovery = seen.longest_recovery.max(answered);
        }
        if last {
            signal(&child, "TERM");
            let status = ended_within(&mut child, Duration::from_secs(10)).expect("it ends when it is told to");
            assert_eq!(status.code(), Some(0), "{}", said(&mut child));
        } else {
            child.kill().unwrap();
            child.wait().unwrap();
            seen.kills += 1;
            seen.kills_before_any_answer += u64::from(answered.is_none());
        }
        runs.push(Run { begin_ns, end_ns: now_ns(), acknowledged });
    }
    let content = content(&files(folder));
    let acknowledged_before = |t_ns: i64| {
        let earlier = runs.iter().take_while(|run| run.begin_ns <= t_ns && run.end_ns <= t_ns);
        earlier.map(|run| run.acknowledged).max().unwrap_or(0)
    };
    let (verdicts, tails) = judge("kill -9", &content, acknowledged_before);
    let last = content.groups.last().map_or(0, |group| group.seq_last);
    let acknowledged = runs.iter().map(|run| run.acknowledged).max().unwrap_or(0);
    assert!(last >= acknowledged, "{acknowledged} was acknowledged, and the log ends at {last}");
    seen.verdicts += verdicts;
    seen.tails += tails;
    seen.acknowledged += runs.iter().filter(|run| run.acknowledged > 0).count() as u64;
}

#[test]
fn conform_kills_lose_nothing_that_was_acknowledged() {
    let all = rounds(12);
    let bench = Bench::new();
    let mut moments = Moments::new(4);
    let mut seen = Seen::default();
    while seen.kills < all {
        let folder = bench.path(&format!("log-{}", seen.kills));
        chain(&bench, &folder, &mut moments, CHAIN.min(all - seen.kills), &mut seen);
        std::fs::remove_dir_all(&folder).unwrap();
    }
    println!("{seen:?}");
    assert!(seen.verdicts > 50 * seen.kills / 2, "too little was logged to mean anything: {seen:?}");
    // In the few rounds of a normal run the machine does much else besides.
    if all >= 100 {
        assert!(seen.longest_recovery <= RECOVERY, "{seen:?}");
    }
}

/// What `wait_for` is for here: a service that was killed leaves a socket behind, and the next one
/// takes its place.
#[test]
fn conform_a_socket_of_a_killed_service_is_taken_over() {
    let bench = Bench::new();
    let config = configure(&bench, &bench.path("log"), "50.0", "");
    for _ in 0..2 {
        let mut child = start(&config);
        assert!(wait_for(Duration::from_secs(10), || status(&bench)).is_some(), "no answer");
        child.kill().unwrap();
        child.wait().unwrap();
    }
}
