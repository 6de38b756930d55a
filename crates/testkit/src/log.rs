//! Records with known content, and a reader that is not the log's own.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use gearwatch_core::estimate::Estimate;
use gearwatch_core::verdict::{HarmonicVerdict, InstrumentState, MachineState, Rank, Verdict};
use gearwatch_log::{Context, Group, LogConfig, Now, Record};

/// A moment, milliseconds after a fixed start.
pub fn at(ms: u64) -> Now {
    Now { wall_ns: 1_795_228_800_000_000_000 + ms as i64 * 1_000_000, mono: Duration::from_millis(ms) }
}

/// The verdict of a window; every field that differs between windows follows from its number.
pub fn verdict(window: u64, level: Rank) -> Record {
    let estimate = Estimate { value: 1.0 + window as f64 / 1000.0, sigma: 0.001 };
    let harmonic = HarmonicVerdict {
        amplitude: estimate,
        floor: 0.01,
        baseline: 1.0,
        deviation_percent: estimate,
        rank: level,
        shared: false,
        rank_probability: 0.9,
    };
    let verdict = Verdict {
        stage: "stage1".into(),
        channel: "acc_1".into(),
        window,
        t0: at(window * 100).wall_ns,
        first_sample_index: window * 1638,
        samples: 16_384,
        unit: "m/s^2".into(),
        input_speed_hz: estimate,
        mesh_hz: 290.0,
        cell: "30 Hz 60 N m".into(),
        harmonics: [harmonic; 5],
        machine: MachineState::Normal,
        instrument: InstrumentState::Ok,
        resolvable: true,
        baseline_sessions: 2,
        ..Verdict::blank()
    };
    let line = serde_json::to_string(&verdict).unwrap().into();
    Record::Verdict { bench: None, verdict: Arc::new(verdict), line }
}

/// The line that stdout shows for the verdict of [`verdict`].
pub fn line(window: u64, level: Rank) -> Vec<u8> {
    let Record::Verdict { line, .. } = verdict(window, level) else { unreachable!("verdict() makes a verdict") };
    line.as_bytes().to_vec()
}

/// A log of small files.
pub fn small() -> LogConfig {
    LogConfig { group_ms: 10, group_bytes: 6000, rotate_bytes: 8 << 10, queue_records: 64, ..LogConfig::default() }
}

/// What each file of the log says of its service.
pub fn context() -> Arc<Context> {
    let data = b"[bench]\nname = \"two-stage bench\"\n".to_vec();
    let attachment =
        gearwatch_log::Attachment { name: "config.toml".into(), media_type: "application/toml".into(), data };
    Arc::new(Context { attachments: vec![attachment], facts: [("bench".into(), "two-stage".into())].into() })
}

/// A message as the `mcap` crate reads it.
pub struct Read {
    /// Topic of its channel.
    pub topic: String,
    /// Payload.
    pub data: Vec<u8>,
}

/// Reads a whole file with the `mcap` crate; an error names the file.
pub fn read(name: &str, bytes: &[u8]) -> Vec<Read> {
    let stream = mcap::MessageStream::new(bytes).unwrap_or_else(|error| panic!("{name}: {error}"));
    let message = |message: mcap::McapResult<mcap::Message<'_>>| {
        let message = message.unwrap_or_else(|error| panic!("{name}: {error}"));
        Read { topic: message.channel.topic.clone(), data: message.data.into_owned() }
    };
    stream.map(message).collect()
}

/// What a log holds, over all its files.
#[derive(Default)]
pub struct Content {
    /// Group records, in order.
    pub groups: Vec<Group>,
    /// Payload of every verdict, with the sequence number that its place in the group gives it.
    pub verdicts: BTreeMap<u64, Vec<u8>>,
    /// Gap records.
    pub gaps: Vec<gearwatch_log::Gap>,
    /// How many notes.
    pub notes: usize,
    /// Raw data.
    pub raw: Vec<Read>,
}

/// Reads all files of a log that is not being written, oldest first; panics on anything that is not
/// whole, double or out of order.
pub fn content(files: &BTreeMap<String, Vec<u8>>) -> Content {
    let mut content = Content::default();
    for (name, bytes) in files.iter().filter(|(name, _)| name.ends_with(".mcap")) {
        let summary = mcap::Summary::read(bytes).unwrap_or_else(|error| panic!("{name}: {error}"));
        let summary = summary.unwrap_or_else(|| panic!("{name} has no summary"));
        let messages = read(name, bytes);
        let count = summary.stats.as_ref().map(|stats| stats.message_count);
        assert_eq!(count, Some(messages.len() as u64), "{name}: the summary counts otherwise");
        let mut seq = 0;
        for message in messages {
            match message.topic.as_str() {
                "/log/group" => {
                    let group: Group = serde_json::from_slice(&message.data).unwrap();
                    if let Some(before) = content.groups.last() {
                        assert_eq!(group.group, before.group + 1, "{name}: groups follow each other without a hole");
                        assert!(group.seq_first > before.seq_last, "{name}: no number is given out twice");
                    }
                    seq = group.seq_first;
                    content.groups.push(group);
                    continue;
                }
                "/gap" => content.gaps.push(serde_json::from_slice(&message.data).unwrap()),
                "/log" => content.notes += 1,
                "/clock" | "/alarm" => {}
                topic if topic.starts_with("/gear/") => {
                    let twice = content.verdicts.insert(seq, message.data);
                    assert!(twice.is_none(), "{name}: result {seq} is there twice");
                }
                _ => {
                    content.raw.push(message);
                    continue;
                }
            }
            seq += 1;
        }
    }
    content
}
