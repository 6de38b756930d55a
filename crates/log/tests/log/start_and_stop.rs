//! What a log holds after a good end, and after the next start.

use std::sync::Arc;

use gearwatch_core::verdict::Rank;
use gearwatch_log::{Sent, Stepper};
use gearwatch_testkit::disk::Simulated;

use gearwatch_testkit::log::{at, content, context, line, small, verdict};

#[test]
fn conform_everything_sent_is_in_the_log_after_a_good_end() {
    let disk = Simulated::new(1);
    let mut next = 0;
    for run in 0..3 {
        let mut log = Stepper::start(small(), context(), Box::new(disk.clone()), at(run * 10_000)).unwrap();
        assert!(!log.recovery().unclean, "run {run} follows a good end");
        for step in 0..50 {
            let now = at(run * 10_000 + step * 7);
            let sent = log.send(verdict(next, Rank::Zero), now);
            assert_eq!(sent, Sent::Queued { seq: next + 1 });
            next += 1;
            log.step(now);
        }
        assert!(log.stop(at(run * 10_000 + 400)), "everything is durable");
    }
    let content = content(&disk.contents());
    let expected: Vec<Vec<u8>> = (0..next).map(|window| line(window, Rank::Zero)).collect();
    assert_eq!(content.verdicts.values().cloned().collect::<Vec<_>>(), expected);
    assert!(content.verdicts.keys().copied().eq(1..=next), "numbers without a hole");
    assert!(content.gaps.is_empty());
}

#[test]
fn conform_each_file_holds_configuration_and_facts() {
    let disk = Simulated::new(1);
    let mut log = Stepper::start(small(), context(), Box::new(disk.clone()), at(0)).unwrap();
    for window in 0..100 {
        log.send(verdict(window, Rank::Zero), at(window * 10));
        log.step(at(window * 10));
    }
    log.stop(at(2000));
    let files = disk.contents();
    assert!(files.len() > 3, "rotation made {} files", files.len());
    for (name, bytes) in files {
        let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
        let attachment = mcap::read::attachment(&bytes, &summary.attachment_indexes[0]).unwrap();
        assert_eq!((attachment.name.as_str(), &*attachment.data), ("config.toml", &*context().attachments[0].data));
        let metadata = mcap::read::metadata(&bytes, &summary.metadata_indexes[0]).unwrap();
        assert_eq!(metadata.metadata["bench"], "two-stage", "{name}");
        assert!(summary.attachment_indexes[0].offset < summary.chunk_indexes[0].chunk_start_offset);
    }
}

#[test]
fn conform_durable_seq_follows_within_the_group_time() {
    let disk = Simulated::new(1);
    let mut log = Stepper::start(small(), context(), Box::new(disk), at(0)).unwrap();
    let Sent::Queued { seq } = log.send(verdict(0, Rank::Zero), at(1)) else { panic!("there is room") };
    log.step(at(1));
    assert!(log.durable_seq() < seq, "not before it is written");
    log.step(at(10));
    assert!(log.durable_seq() < seq, "not before the group is due");
    log.step(at(11));
    assert_eq!(log.durable_seq(), seq);
}

#[test]
fn conform_a_new_context_begins_a_new_file() {
    let disk = Simulated::new(1);
    let mut log = Stepper::start(small(), Arc::default(), Box::new(disk.clone()), at(0)).unwrap();
    log.send(verdict(0, Rank::Zero), at(1));
    log.send(gearwatch_log::Record::Context(context()), at(1));
    log.send(verdict(1, Rank::Zero), at(1));
    log.step(at(1));
    log.stop(at(2));
    let files: Vec<Vec<u8>> = disk.contents().into_values().collect();
    let attachments = |bytes: &[u8]| mcap::Summary::read(bytes).unwrap().unwrap().attachment_indexes.len();
    assert_eq!(files.iter().map(|bytes| attachments(bytes)).collect::<Vec<_>>(), [0, 1]);
    assert_eq!(content(&disk.contents()).verdicts.len(), 2);
}
