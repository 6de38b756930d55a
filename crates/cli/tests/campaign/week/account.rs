//! Every window once: in a verdict, in a gap record that names it, or among numbers that the log
//! itself says it has lost.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use gearwatch_log::{Cause, Gap, Group};

use gearwatch_testkit::log::read;

/// A gap record may come so many numbers behind the windows that it is about, at the usual speed.
const LATE: u64 = 10_000;

/// Windows of a place that are not there.
struct Hole {
    /// `<sensor>/<stage>`.
    place: String,
    /// First and last of them.
    windows: (u64, u64),
    /// Numbers of the verdicts before and after it.
    between: (u64, u64),
}

/// What the log holds so far; files are read once, when they have an end.
#[derive(Default)]
pub struct Account {
    /// So many numbers behind its windows a gap record may come.
    late: u64,
    read: BTreeSet<String>,
    highest: u64,
    /// Numbers that no file holds, first and last, and what the log says of such.
    missing: Vec<(u64, u64)>,
    lost: Vec<(u64, u64)>,
    /// Window and number of the newest verdict by place.
    newest: BTreeMap<String, (u64, u64)>,
    holes: Vec<Hole>,
    /// Gap records with their own numbers.
    gaps: Vec<(u64, Gap)>,
    pub verdicts: u64,
    pub clocks: u64,
    pub windows_missing: u64,
    pub counted: BTreeMap<Cause, u64>,
}

impl Account {
    /// Of a service that is so many times as fast as usual.
    pub fn at(times: u64) -> Self {
        Self { late: LATE * times, ..Self::default() }
    }

    /// Reads what is new in the folder; `done`: nobody writes to it any more.
    pub fn go_on(&mut self, folder: &Path, done: bool) {
        let listed = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let all: BTreeSet<String> = listed.filter(|name| name.ends_with(".mcap")).collect();
        let newest = all.last().cloned().filter(|_| !done);
        for name in all {
            if Some(&name) == newest.as_ref() || self.read.contains(&name) {
                continue;
            }
            let bytes = std::fs::read(folder.join(&name)).unwrap();
            if !mcap::Summary::read(&bytes).is_ok_and(|summary| summary.is_some()) {
                assert!(!done, "{name} has no end");
                // The disk failed, and the file is closed later; what comes behind it waits.
                break;
            }
            self.take(&name, &bytes);
            self.read.insert(name);
        }
        self.settle(done);
    }

    pub fn files(&self) -> usize {
        self.read.len()
    }

    fn take(&mut self, name: &str, bytes: &[u8]) {
        let mut seq = 0;
        for message in read(name, bytes) {
            match message.topic.as_str() {
                "/log/group" => {
                    let group: Group = serde_json::from_slice(&message.data).unwrap();
                    assert!(group.seq_first > self.highest, "{name}: number {} is given out twice", group.seq_first);
                    if group.seq_first > self.highest + 1 {
                        self.missing.push((self.highest + 1, group.seq_first - 1));
                    }
                    // An empty group ends before it begins.
                    self.highest = self.highest.max(group.seq_last);
                    seq = group.seq_first;
                    continue;
                }
                "/gap" => {
                    let gap: Gap = serde_json::from_slice(&message.data).unwrap();
                    *self.counted.entry(gap.cause).or_default() += gap.count;
                    match gap.channel == Gap::LOG {
                        true => self.lost.push((gap.first, gap.last)),
                        false => self.gaps.push((seq, gap)),
                    }
                }
                "/clock" => self.clocks += 1,
                "/log" | "/alarm" => {}
                topic if topic.starts_with("/gear/") => self.verdict(name, seq, &message.data),
                // Raw data and spectra have no numbers.
                _ => continue,
            }
            seq += 1;
        }
    }

    fn verdict(&mut self, name: &str, seq: u64, line: &[u8]) {
        let verdict: serde_json::Value = serde_json::from_slice(line).unwrap();
        let (channel, stage) = (verdict["channel"].as_str().unwrap(), verdict["stage"].as_str().unwrap());
        let (place, window) = (format!("{channel}/{stage}"), verdict["window"].as_u64().unwrap());
        self.verdicts += 1;
        let before = self.newest.insert(place.clone(), (window, seq));
        // Behind a reload they count from zero.
        let Some((last, at)) = before.filter(|(last, _)| *last <= window) else { return };
        assert!(last != window, "{name}: window {window} of {place} is there twice");
        if window > last + 1 {
            self.windows_missing += window - last - 1;
            self.holes.push(Hole { place, windows: (last + 1, window - 1), between: (at, seq) });
        }
    }

    /// Judges what nothing can be added to any more.
    fn settle(&mut self, done: bool) {
        let highest = self.highest;
        let (due, wait): (Vec<_>, Vec<_>) =
            std::mem::take(&mut self.holes).into_iter().partition(|hole| done || hole.between.1 + self.late < highest);
        self.holes = wait;
        for hole in due {
            self.explain(&hole);
        }
        let lost = &self.lost;
        let told = |(first, last): (u64, u64)| lost.iter().any(|lost| lost.0 <= first && last <= lost.1);
        let untold = self.missing.iter().find(|missing| (done || missing.1 + self.late < highest) && !told(**missing));
        assert_eq!(untold, None, "numbers that are nowhere; said to be lost are {lost:?}");
    }

    fn explain(&self, hole: &Hole) {
        let (first, last) = hole.windows;
        let sensor = hole.place.split('/').next().unwrap_or_default();
        let of_sensor = format!("{sensor} windows");
        let mut left: BTreeSet<u64> = (first..=last).collect();
        let near = |seq: u64| (hole.between.0..hole.between.1 + self.late).contains(&seq);
        for (_, gap) in self.gaps.iter().filter(|(seq, _)| near(*seq)) {
            if gap.channel == hole.place || gap.channel == of_sensor {
                left.retain(|window| !(gap.first..=gap.last).contains(window));
            }
        }
        let within = |range: &(u64, u64)| {
            let (from, to) = (range.0.max(hole.between.0 + 1), range.1.min(hole.between.1 - 1));
            (to + 1).saturating_sub(from)
        };
        let numbers: u64 = self.missing.iter().map(within).sum();
        assert!(
            left.len() as u64 <= numbers,
            "windows {first} to {last} of {}: no gap names {} of them ({:?}), and {numbers} numbers were lost between {:?}",
            hole.place,
            left.len(),
            left.first(),
            hole.between
        );
    }
}
