//! Is a log whole? For `gearwatch doctor DIR` and `gearwatch recover FILE`; nothing is changed in
//! the folder.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use gearwatch_io::output::{OutputError, Target};
use gearwatch_io::text::open_regular;

use crate::content::{Part, visit};
use crate::disk::is_locked;
use crate::examine::{Damage, Ending, examine};
use crate::message::{GAP_TOPIC, Group};
use crate::names::FileName;
use crate::record::{Cause, Gap};
use crate::salvage::{Missing, Salvaged, hole, salvage};
use crate::walk::Rules;

/// What `doctor` found in one file.
#[derive(Clone, Debug)]
pub struct FileHealth {
    /// File name.
    pub name: String,
    /// Length (bytes).
    pub bytes: u64,
    /// How it ends.
    pub ending: Ending,
    /// Messages by topic.
    pub messages: BTreeMap<String, u64>,
    /// Bytes that are not what was written.
    pub damage: Vec<Damage>,
    /// Half-written bytes at the end.
    pub torn_tail: Option<Damage>,
    /// Why it could not be read.
    pub unreadable: Option<String>,
}

/// What `doctor` found in a folder.
#[derive(Clone, Debug, Default)]
pub struct Health {
    /// The files, oldest first.
    pub files: Vec<FileHealth>,
    /// Groups that are in no file though later ones are. What retention removed at the beginning
    /// does not count.
    pub missing: Vec<Missing>,
    /// Groups that are in more than one place.
    pub repeated: Vec<u64>,
    /// Gaps that the service itself recorded, by cause: how many records, and what they count
    /// together.
    pub gaps: BTreeMap<String, (u64, u64)>,
    /// A service is writing to the folder, so that its newest file has no end yet.
    pub in_use: bool,
    /// First and last result in the log.
    pub seq: Option<(u64, u64)>,
}

impl Health {
    /// Nothing that was ever acknowledged is missing, and every file is closed but the one that is
    /// being written. What the service recorded as a gap was lost before it was acknowledged, and
    /// does not count here, but for damage that was found later.
    pub fn is_whole(&self) -> bool {
        let open_is_fine = |index: usize| self.in_use && index + 1 == self.files.len();
        let good = |(index, file): (usize, &FileHealth)| {
            let closed = file.ending == Ending::Closed || (file.ending == Ending::Open && open_is_fine(index));
            let tail = file.torn_tail.is_none() || open_is_fine(index);
            closed && tail && file.damage.is_empty() && file.unreadable.is_none()
        };
        let damaged = self.gaps.contains_key(&cause_name(Cause::Damage));
        self.missing.is_empty() && self.repeated.is_empty() && !damaged && self.files.iter().enumerate().all(good)
    }
}

/// Reads every file of a log.
///
/// # Errors
/// When the folder cannot be listed.
pub fn doctor(folder: &Path) -> io::Result<Health> {
    let place = |error: io::Error| io::Error::new(error.kind(), format!("{}: {error}", folder.display()));
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).map_err(place)? {
        if let Some(name) = entry.map_err(place)?.file_name().to_str().and_then(FileName::parse) {
            names.push(name);
        }
    }
    names.sort();
    let mut health = Health { in_use: is_locked(folder), ..Health::default() };
    let mut previous: Option<Group> = None;
    for name in names {
        let file = look(&folder.join(&name.name), name.name, &mut health, &mut previous);
        health.files.push(file);
    }
    Ok(health)
}

fn look(path: &Path, name: String, health: &mut Health, previous: &mut Option<Group>) -> FileHealth {
    let bytes = match read_regular(path) {
        Ok(bytes) => bytes,
        Err(error) => {
            return FileHealth {
                name,
                bytes: 0,
                ending: Ending::Wrong,
                messages: BTreeMap::new(),
                damage: Vec::new(),
                torn_tail: None,
                unreadable: Some(error.to_string()),
            };
        }
    };
    let all = examine(&bytes, Some(Rules::Own));
    for group in all.chunks.iter().filter_map(|chunk| chunk.group) {
        match previous.as_ref() {
            Some(before) if group.group <= before.group => health.repeated.push(group.group),
            Some(before) => health.missing.extend(hole(before, &group)),
            None => {}
        }
        if group.seq_first <= group.seq_last {
            let first = health.seq.map_or(group.seq_first, |(first, _)| first);
            health.seq = Some((first, group.seq_last));
        }
        *previous = Some(group);
    }
    let mut messages: BTreeMap<String, u64> = BTreeMap::new();
    let counted: Result<(), std::convert::Infallible> = visit(&bytes, Rules::Own, |part| {
        if let Part::Message { channel, message, .. } = part {
            *messages.entry(channel.topic.clone()).or_default() += 1;
            if channel.topic == GAP_TOPIC
                && let Ok(gap) = serde_json::from_slice::<Gap>(message.data)
            {
                let entry = health.gaps.entry(cause_name(gap.cause)).or_default();
                *entry = (entry.0 + 1, entry.1.saturating_add(gap.count));
            }
        }
        Ok(())
    });
    let Ok(()) = counted;
    let (ending, damage, torn_tail) = (all.ending, all.damage, all.torn_tail);
    FileHealth { name, bytes: bytes.len() as u64, ending, messages, damage, torn_tail, unreadable: None }
}

/// A pipe in place of a file would be waited for, and a device has no end.
fn read_regular(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open_regular(path)?.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// As it stands in the record.
fn cause_name(cause: Cause) -> String {
    serde_json::to_value(cause).ok().and_then(|value| value.as_str().map(str::to_owned)).unwrap_or_default()
}

/// Why a file cannot be recovered.
#[derive(Debug, thiserror::Error)]
pub enum RecoverError {
    /// The file cannot be read.
    #[error("{path}: {error}", path = path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// Why.
        error: io::Error,
    },
    /// The new one cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// There is nothing in it that could be recovered.
    #[error("{path}: no MCAP record could be found in it", path = path.display())]
    Nothing {
        /// Which.
        path: PathBuf,
    },
}

/// Writes what is good of a file to a new one, and makes that durable. The file itself is not
/// touched.
///
/// # Errors
/// When the file cannot be read, nothing is in it, or the output cannot be written.
pub fn recover_file(input: &Path, output: Target) -> Result<Salvaged, RecoverError> {
    let failed = |path: &Path| {
        let path = path.to_owned();
        move |error| RecoverError::File { path, error }
    };
    let bytes = read_regular(input).map_err(failed(input))?;
    let salvaged = salvage(&bytes).map_err(failed(input))?;
    if salvaged.messages == 0 && !salvaged.has_header {
        return Err(RecoverError::Nothing { path: input.to_owned() });
    }
    output.write(&salvaged.bytes)?;
    Ok(salvaged)
}
