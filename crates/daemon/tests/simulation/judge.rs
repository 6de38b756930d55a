//! Judges a world by what its disk holds in the end, read by the `mcap` crate.

use std::collections::BTreeMap;

use gearwatch_log::{AlarmRecord, Cause, Gap, Group, Sent};

use crate::trouble::Fault;
use crate::world::{What, World};

/// What a log holds.
#[derive(Default)]
struct Content {
    groups: Vec<Group>,
    /// Topic and payload by number.
    results: BTreeMap<u64, (String, Vec<u8>)>,
    gaps: Vec<Gap>,
    /// How each file is packed.
    packed: Vec<String>,
}

fn content(label: &str, files: &BTreeMap<String, Vec<u8>>) -> Content {
    let mut content = Content::default();
    for (name, bytes) in files.iter().filter(|(name, _)| name.ends_with(".mcap")) {
        let Ok(Some(summary)) = mcap::Summary::read(bytes) else { panic!("{label}: {name} is not closed") };
        content.packed.extend(summary.chunk_indexes.first().map(|chunk| chunk.compression.clone()));
        let mut seq = 0;
        for message in gearwatch_testkit::log::read(name, bytes) {
            if message.topic == "/log/group" {
                let group: Group = serde_json::from_slice(&message.data).unwrap();
                seq = group.seq_first;
                content.groups.push(group);
                continue;
            }
            if message.topic == "/gap" {
                content.gaps.push(serde_json::from_slice(&message.data).unwrap());
            }
            let twice = content.results.insert(seq, (message.topic, message.data));
            assert!(twice.is_none(), "{label}: {name}: result {seq} is there twice");
            seq += 1;
        }
    }
    content
}

/// Panics with the seed where something was lost, doubled or said wrongly; else the figures of the
/// world.
pub fn judge(seed: u64, world: &World) -> Vec<(&'static str, u64)> {
    let label = format!("seed {seed}");
    let content = content(&label, &world.disk().contents());
    let lost = |seq: u64, causes: &[Cause]| {
        content
            .gaps
            .iter()
            .any(|gap| gap.channel == Gap::LOG && causes.contains(&gap.cause) && (gap.first..=gap.last).contains(&seq))
    };
    let (mut logged, mut shed, mut tails) = (0, 0, 0);
    let mut stands: BTreeMap<String, AlarmRecord> = BTreeMap::new();
    world.at(|outside| {
        assert!(outside.lies.is_empty(), "{label}: {:?}", outside.lies.first());
        for offered in &outside.offered {
            let crashed = world.crashed.contains(&offered.start);
            // Who takes away the file and cuts the power before the service could say so leaves
            // nobody to tell, nor to know which numbers were used.
            let untellable = world.taken.contains(&offered.start) && world.powerless.contains(&offered.start);
            let kept = match offered.sent {
                Sent::Queued { seq } => match content.results.get(&seq) {
                    Some((_, data)) => {
                        let same = match &offered.what {
                            What::Window(_, line) => data == line,
                            _ => true,
                        };
                        assert!(same || untellable, "{label}: number {seq} is not what was said of it");
                        logged += u64::from(same);
                        same
                    }
                    None => {
                        let (tail, damage) = (lost(seq, &[Cause::UncleanEnd]), lost(seq, &[Cause::Damage]));
                        assert!(
                            tail || untellable || damage,
                            "{label}: number {seq} of start {} is lost, and no gap says so: {:?}",
                            offered.start,
                            content.gaps.iter().filter(|gap| gap.channel == Gap::LOG).collect::<Vec<_>>()
                        );
                        tails += 1;
                        // The file after one that was taken away begins with all alarms.
                        damage && !tail
                    }
                },
                Sent::Shed { .. } => {
                    if let What::Window(window, _) = &offered.what {
                        let told = content.gaps.iter().any(|gap| {
                            gap.cause == Cause::LogQueueFull
                                && gap.channel == "acc_1/stage1"
                                && (gap.first..=gap.last).contains(window)
                        });
                        let unclean = content.gaps.iter().any(|gap| gap.channel == Gap::LOG);
                        assert!(
                            told || (crashed && unclean) || taken(&content),
                            "{label}: window {window} was shed, and no gap says so"
                        );
                        shed += 1;
                    }
                    false
                }
                _ => false,
            };
            if let (What::Alarm(alarm), true) = (&offered.what, kept) {
                if alarm.alarm.over {
                    stands.remove(&alarm.alarm.id);
                } else {
                    stands.insert(alarm.alarm.id.clone(), (**alarm).clone());
                }
            }
        }
    });
    // Everything in the log was sent, once: windows that stand in it twice would have two numbers.
    let mut windows: Vec<&Vec<u8>> =
        content.results.values().filter(|(topic, _)| topic.starts_with("/gear/")).map(|(_, data)| data).collect();
    let all = windows.len();
    windows.sort();
    windows.dedup();
    assert_eq!(windows.len(), all, "{label}: a window is in the log twice");
    let restored: Vec<&AlarmRecord> = world.restored.iter().collect();
    assert_eq!(restored, stands.values().collect::<Vec<_>>(), "{label}: alarms that stand");
    witness(world, &content);
    let delivered = world.at(|outside| {
        assert!(outside.pages.lies.is_empty(), "{label}: {:?}", outside.pages.lies.first());
        let lines = outside.offered.iter().filter_map(|offered| match &offered.what {
            What::Window(number, line) => Some((*number, line.clone())),
            _ => None,
        });
        outside.post.judge(&label, &lines.collect())
    });
    // The last file was begun with the configuration that was read last.
    assert_eq!(content.packed.last().map(String::as_str), Some(world.compression()), "{label}: compression");
    let (looks, ok) = world.at(|outside| (outside.looks, outside.looks_ok));
    vec![
        ("results logged", logged),
        ("windows shed", shed),
        ("in gaps", tails),
        ("looks", looks),
        ("said ok", ok),
        ("letters", delivered.letters),
        ("letters resent", delivered.resent),
        ("letters told as lost", delivered.told_lost),
        ("letters missing", delivered.missing),
    ]
}

/// Counts the faults that the log shows.
fn witness(world: &World, content: &Content) {
    for (fault, cause) in [(Fault::Overload, Cause::Overload), (Fault::Worker, Cause::Failure)] {
        let gaps = content.gaps.iter().filter(|gap| gap.cause == cause).count();
        world.at(|outside| outside.witness(fault, gaps as u64));
    }
    // A clock that jumped stands in the groups: wall and monotonic time part.
    let jumps = content.groups.windows(2).filter(|pair| {
        let of = |group: &Group| group.wall_ns - group.mono_ns as i64;
        (of(&pair[0]) - of(&pair[1])).abs() > 500_000_000
    });
    let jumps = jumps.count() as u64;
    world.witness_of_lasting();
    world.at(|outside| outside.witness(Fault::Clock, jumps));
    let repacked = content.packed.windows(2).filter(|pair| pair[0] != pair[1]).count() as u64;
    world.at(|outside| outside.witness(Fault::Changed, repacked));
}

/// A file was taken away: gap records that stood in it are gone too.
fn taken(content: &Content) -> bool {
    content.gaps.iter().any(|gap| gap.cause == Cause::Damage)
}
