//! A file cut off at every byte, and with every bit flipped.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use gearwatch_core::verdict::Rank;
use gearwatch_log::{Compression, LogConfig, Stepper, salvage};
use gearwatch_testkit::disk::Simulated;

use gearwatch_testkit::log::{Content, at, content, context, line, read, small, verdict};

const WINDOWS: u64 = 5;

/// One file with five windows in a few groups, closed or as a crash leaves it.
fn one_file(compression: Compression, closed: bool) -> (String, Vec<u8>) {
    let disk = Simulated::new(1);
    let config = LogConfig { rotate_bytes: 1 << 20, compression, ..small() };
    let mut log = Stepper::start(config, context(), Box::new(disk.clone()), at(0)).unwrap();
    for window in 0..WINDOWS {
        log.send(verdict(window, Rank::Zero), at(window * 6));
        log.step(at(window * 6));
    }
    log.step(at(1000));
    if closed {
        log.stop(at(1000));
    }
    disk.contents().into_iter().next().unwrap()
}

/// What was sent, in order.
static LINES: LazyLock<Vec<Vec<u8>>> = LazyLock::new(|| (0..WINDOWS).map(|window| line(window, Rank::Zero)).collect());

/// The recovered verdicts, after checks on what was recovered: in order, each as it was sent.
fn verdicts(label: &str, bytes: &[u8]) -> Vec<u64> {
    let mut windows = Vec::new();
    for message in read(label, bytes) {
        if message.topic.starts_with("/gear/") {
            let window = LINES.iter().position(|line| *line == message.data);
            windows.push(window.unwrap_or_else(|| panic!("{label}: a verdict that nobody sent")) as u64);
        }
    }
    assert!(windows.windows(2).all(|pair| pair[0] < pair[1]), "{label}: {windows:?}");
    windows
}

#[test]
fn conform_a_file_cut_at_any_byte_gives_every_whole_group_before_the_cut() {
    for (compression, closed) in [(Compression::Zstd, true), (Compression::None, false)] {
        let (_, bytes) = one_file(compression, closed);
        let mut best = 0;
        for length in 8..=bytes.len() {
            let salvaged = salvage(&bytes[..length]).unwrap();
            let found = verdicts(&format!("cut at {length}"), &salvaged.bytes);
            assert!(found.iter().copied().eq(0..found.len() as u64), "cut at {length}: a beginning without a hole");
            assert!(found.len() >= best, "cut at {length}: fewer than before");
            best = found.len();
        }
        assert_eq!(best as u64, WINDOWS);
    }
}

#[test]
fn conform_the_next_start_closes_a_file_cut_at_any_byte() {
    let (name, bytes) = one_file(Compression::Zstd, true);
    let mut best = 0;
    for length in 0..=bytes.len() {
        let disk = Simulated::new(1);
        gearwatch_log::Storage::create(&mut disk.clone(), &name).unwrap();
        disk.overwrite(&name, bytes[..length].to_vec());
        let log = Stepper::start(small(), context(), Box::new(disk.clone()), at(5000)).unwrap();
        let unclean = log.recovery().unclean;
        log.stop(at(5000));
        let Content { verdicts, .. } = content(&disk.contents());
        assert!(
            unclean || length == 0 || verdicts.len() as u64 == WINDOWS,
            "cut at {length}: a loss, and nobody noticed"
        );
        assert!(verdicts.len() >= best, "cut at {length}: {} verdicts, {best} before", verdicts.len());
        best = verdicts.len();
    }
    assert_eq!(best as u64, WINDOWS);
}

/// The sums are over whole chunks, so a flip may cost the windows of one group, never more, and
/// none is ever wrong.
#[test]
fn conform_any_flipped_bit_costs_at_most_one_group_and_is_noticed() {
    // Every bit of the usual file; of the other one, which is three times as long, one bit of every
    // byte.
    for (compression, closed, every) in [(Compression::Zstd, true, 1), (Compression::None, false, 9)] {
        let (name, mut bytes) = one_file(compression, closed);
        let whole = salvage(&bytes).unwrap();
        let groups = read(&name, &whole.bytes).iter().filter(|m| m.topic == "/log/group").count();
        let most = 3;
        assert!(groups >= 3);
        let mut unnoticed = 0;
        for bit in (0..bytes.len() * 8).step_by(every) {
            bytes[bit / 8] ^= 1 << (bit % 8);
            let label = format!("bit {} of byte {}", bit % 8, bit / 8);
            let salvaged = salvage(&bytes).unwrap();
            if bit / 8 >= 8 {
                let found = verdicts(&label, &salvaged.bytes).len();
                assert!(found + most >= WINDOWS as usize, "{label}: only {found} windows are left");
                let lossless = salvaged.is_lossless() && salvaged.ending == whole.ending;
                let lost = found < WINDOWS as usize;
                assert!(!(lost && lossless), "{label}: {found} windows, and nobody noticed");
                unnoticed += usize::from(lossless);
            }
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
        // A closed file has a sum over everything. An open one has none over header, metadata and
        // the times of messages in the index.
        let free = if closed { 0 } else { 8 * 260 / every };
        assert!(unnoticed <= free, "{unnoticed} flips were not noticed");
    }
}

/// Damage in the middle of an open file: the good part is written anew, the hole becomes a gap
/// record, the damaged file stays beside it.
#[test]
fn conform_the_next_start_writes_a_file_anew_that_is_damaged_in_the_middle() {
    let (name, mut bytes) = one_file(Compression::None, false);
    let needle = b"\"window\":2,";
    let place = bytes.windows(needle.len()).position(|part| part == needle).unwrap();
    bytes[place] ^= 1;
    let disk = Simulated::new(1);
    gearwatch_log::Storage::create(&mut disk.clone(), &name).unwrap();
    disk.overwrite(&name, bytes.clone());
    let log = Stepper::start(small(), context(), Box::new(disk.clone()), at(5000)).unwrap();
    assert_eq!(log.recovery().rewritten, [name.as_str()]);
    log.stop(at(5000));
    let files = disk.contents();
    assert_eq!(files[&format!("{name}.damaged")], bytes);
    let messages = read(&name, &files[&name]);
    let gaps: Vec<gearwatch_log::Gap> =
        messages.iter().filter(|m| m.topic == "/gap").map(|m| serde_json::from_slice(&m.data).unwrap()).collect();
    let found = verdicts(&name, &files[&name]);
    let missing: Vec<u64> = (0..WINDOWS).filter(|window| !found.contains(window)).collect();
    assert!(missing.contains(&2) && missing.len() <= 3, "{missing:?}");
    assert_eq!((gaps[0].first, gaps[0].last), (missing[0] + 1, missing[missing.len() - 1] + 1));
    assert_eq!(gaps[0].cause, gearwatch_log::Cause::Damage);
}

/// Bytes that were never a log.
#[test]
fn conform_noise_gives_nothing_and_no_panic() {
    let mut random = 1_u64;
    for length in (0..4000).step_by(37) {
        let mut noise = vec![0x89, b'M', b'C', b'A', b'P', b'0', b'\r', b'\n'];
        noise.extend((0..length).map(|_| {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            // Small numbers, so that opcodes and lengths come up.
            ((random >> 33) & 0x0f) as u8
        }));
        assert_eq!(salvage(&noise).unwrap().messages, 0);
    }
    let empty: BTreeMap<String, Vec<u8>> = BTreeMap::new();
    assert!(content(&empty).verdicts.is_empty());
}
