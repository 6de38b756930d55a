//! Alarms that stand: what a start knows of those before it. Every file begins with the alarms that stood then, and holds what happened to alarms
//! since, so that the newest file alone tells.

use std::collections::BTreeMap;
use std::convert::Infallible;

use super::content::{Part, visit};
use super::examine::Rules;
use super::message::ALARM_TOPIC;
use super::record::AlarmRecord;
use super::recover::log_files;
use super::storage::Storage;

/// Key of the file's facts that holds the alarms.
const FACT: &str = "alarms";

/// Alarms that stand.
#[derive(Debug, Default)]
pub(super) struct Standing(BTreeMap<(String, String), AlarmRecord>);

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
                    let begin: Vec<AlarmRecord> =
                        facts.get(FACT).and_then(|text| serde_json::from_str(text).ok()).unwrap_or_default();
                    let standing = standing.get_or_insert_with(Self::default);
                    begin.into_iter().for_each(|alarm| standing.take(alarm));
                }
                Part::Message { channel, message, .. } if channel.topic == ALARM_TOPIC => {
                    if let (Some(standing), Ok(alarm)) = (&mut standing, serde_json::from_slice(message.data)) {
                        standing.take(alarm);
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
            self.0.remove(&alarm.key());
        } else {
            self.0.insert(alarm.key(), alarm);
        }
    }

    /// For the head of a file; `None` where none stands.
    pub fn fact(&self) -> Option<(String, String)> {
        let text = serde_json::to_string(&self.alarms()).ok()?;
        (!self.0.is_empty()).then(|| (FACT.to_owned(), text))
    }

    pub fn alarms(&self) -> Vec<AlarmRecord> {
        self.0.values().cloned().collect()
    }
}
