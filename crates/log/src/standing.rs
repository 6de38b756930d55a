//! What a start knows of those before it: alarms that stand, and losses that nobody was told of
//! yet. Every file begins with what stood then, and holds what happened since, so that the newest
//! file alone tells.

use std::collections::BTreeMap;
use std::convert::Infallible;

use crate::content::{Part, visit};
use crate::message::{ALARM_TOPIC, GAP_TOPIC};
use crate::record::{AlarmRecord, Gap};
use crate::recover::log_files;
use crate::storage::Storage;
use crate::walk::Rules;

/// Keys of the file's facts that hold the alarms and the losses.
const ALARMS: &str = "alarms";
const LOSSES: &str = "untold_gaps";

/// Alarms that stand, and losses that are known but in no record that is durable.
#[derive(Debug, Default)]
pub(crate) struct Standing {
    alarms: BTreeMap<(String, String), AlarmRecord>,
    /// With the number of the record that tells of it, once it has one.
    losses: Vec<(Option<u64>, Gap)>,
}

impl Standing {
    /// Reads them from the newest file that tells of them; none where no file can be read.
    pub fn read(storage: &mut dyn Storage) -> Self {
        let files = log_files(storage).unwrap_or_default();
        let of_file = |name: &str| storage.read(name).ok().and_then(|bytes| Self::of(&bytes));
        files.iter().rev().map(|file| file.name.as_str()).find_map(of_file).unwrap_or_default()
    }

    /// `None` where the head of the file is not there.
    fn of(bytes: &[u8]) -> Option<Self> {
        let mut standing = None;
        let done: Result<(), Infallible> = visit(bytes, Rules::Own, |part| {
            match part {
                Part::Metadata(_, facts) => {
                    let standing = standing.get_or_insert_with(Self::default);
                    let alarms = facts.get(ALARMS).and_then(|text| serde_json::from_str(text).ok());
                    alarms.into_iter().flat_map(|all: Vec<_>| all).for_each(|alarm| standing.take(alarm));
                    let losses = facts.get(LOSSES).and_then(|text| serde_json::from_str(text).ok());
                    losses.into_iter().flat_map(|all: Vec<_>| all).for_each(|gap| standing.lose(gap));
                }
                Part::Message { channel, message, .. } if channel.topic == ALARM_TOPIC => {
                    if let (Some(standing), Ok(alarm)) = (&mut standing, serde_json::from_slice(message.data)) {
                        standing.take(alarm);
                    }
                }
                Part::Message { channel, message, .. } if channel.topic == GAP_TOPIC => {
                    if let (Some(standing), Ok(gap)) = (&mut standing, serde_json::from_slice::<Gap>(message.data)) {
                        standing.losses.retain(|(_, lost)| *lost != gap);
                    }
                }
                _ => {}
            }
            Ok(())
        });
        let Ok(()) = done;
        standing
    }

    /// Something happened to an alarm.
    pub fn take(&mut self, alarm: AlarmRecord) {
        if alarm.alarm.over {
            self.alarms.remove(&alarm.key());
        } else {
            self.alarms.insert(alarm.key(), alarm);
        }
    }

    /// Something was lost, and a record that says so is on its way.
    pub fn lose(&mut self, gap: Gap) {
        self.losses.push((None, gap));
    }

    /// A gap record has got its number.
    pub fn told(&mut self, seq: u64, gap: &Gap) {
        self.losses.iter_mut().filter(|(_, lost)| lost == gap).for_each(|(number, _)| *number = Some(seq));
    }

    /// For the head of a file that begins when everything up to `durable` is.
    pub fn facts(&mut self, durable: u64) -> impl Iterator<Item = (String, String)> {
        self.losses.retain(|(number, _)| number.is_none_or(|seq| seq > durable));
        let alarms = (!self.alarms.is_empty()).then(|| (ALARMS, serde_json::to_string(&self.alarms())));
        let losses = (!self.losses.is_empty()).then(|| (LOSSES, serde_json::to_string(&self.losses())));
        [alarms, losses].into_iter().flatten().filter_map(|(key, text)| Some((key.to_owned(), text.ok()?)))
    }

    pub fn alarms(&self) -> Vec<AlarmRecord> {
        self.alarms.values().cloned().collect()
    }

    pub fn losses(&self) -> Vec<Gap> {
        self.losses.iter().map(|(_, gap)| gap.clone()).collect()
    }
}
