//! A source or a sink: the keys that all kinds have, and those of its own kind.

use gearwatch_runtime::kinds::{self, Kind, KindError};
use gearwatch_runtime::queue::WhenFull;
use gearwatch_sources::{DATA_DEADLINE_SECS, KINDS, SourceConfig};
use serde::Deserialize;
use toml::Table;

use crate::sink::{self, SinkConfig};

/// Some minutes of verdicts of a small bench.
pub(super) const SINK_QUEUE: usize = 4096;

/// A source with the keys that all sources have.
#[derive(Debug)]
pub struct SourceEntry {
    /// Unique within its bench; the kind where the file names none.
    pub name: String,
    /// Its kind.
    pub kind: &'static str,
    /// Without a packet for so long a live source counts as silent (s).
    pub data_deadline_secs: f64,
    /// Its own keys.
    pub config: Box<dyn SourceConfig>,
    /// All keys, defaults filled in.
    pub(super) keys: Table,
}

/// A sink with the keys that all sinks have.
#[derive(Debug)]
pub struct SinkEntry {
    /// Unique; the kind where the file names none.
    pub name: String,
    /// Its kind.
    pub kind: &'static str,
    /// Events that may wait for it.
    pub queue: usize,
    /// What happens when more do; where left out, see
    /// [`Config::when_full`](super::Config::when_full).
    pub when_full: Option<WhenFull>,
    /// Its own keys.
    pub config: Box<dyn SinkConfig>,
    /// All keys, defaults filled in.
    pub(super) keys: Table,
}

/// Why a table is no source or sink.
#[derive(Debug, thiserror::Error)]
pub enum EntryError {
    /// A key that all kinds have is wrong.
    #[error("{key}: {}", kinds::one_line(source))]
    Key {
        /// Its name.
        key: &'static str,
        /// What was expected and found.
        source: Box<toml::de::Error>,
    },
    /// The table does not name its kind.
    #[error("the key \"kind\" is missing; it is one of {}", .0.join(", "))]
    NoKind(Vec<&'static str>),
    /// No kind has the name.
    #[error(transparent)]
    Kind(KindError),
    /// A key of the kind itself is wrong.
    #[error("{kind}: {source}")]
    Own {
        /// The kind's name.
        kind: &'static str,
        /// What is wrong.
        source: KindError,
    },
    /// What was read cannot be written as TOML.
    #[error(transparent)]
    Shown(#[from] toml::ser::Error),
}

/// Takes a key that all kinds have out of a table.
fn take<T: for<'de> Deserialize<'de>>(keys: &mut Table, key: &'static str) -> Result<Option<T>, EntryError> {
    let value = keys.remove(key).map(toml::Value::try_into).transpose();
    value.map_err(|source| EntryError::Key { key, source: Box::new(source) })
}

/// The kind's name, and the kind.
fn kind_of<C: ?Sized>(keys: &mut Table, all: &'static [Kind<C>], what: &str) -> Result<&'static Kind<C>, EntryError> {
    let name: Option<String> = take(keys, "kind")?;
    let name = name.ok_or_else(|| EntryError::NoKind(all.iter().map(|kind| kind.name).collect()))?;
    kinds::find(all, &name, what).map_err(EntryError::Kind)
}

pub(super) fn source_entry(keys: &Table) -> Result<SourceEntry, EntryError> {
    let mut own = keys.clone();
    let kind = kind_of(&mut own, KINDS, "source")?;
    let name = take(&mut own, "name")?.unwrap_or_else(|| kind.name.to_owned());
    let data_deadline_secs = take(&mut own, "data_deadline_secs")?.unwrap_or(DATA_DEADLINE_SECS);
    let (config, shown) = kind.read(own).map_err(|source| EntryError::Own { kind: kind.name, source })?;
    let mut keys = Table::new();
    keys.insert("kind".to_owned(), kind.name.into());
    keys.insert("name".to_owned(), name.clone().into());
    keys.insert("data_deadline_secs".to_owned(), data_deadline_secs.into());
    keys.extend(shown);
    Ok(SourceEntry { name, kind: kind.name, data_deadline_secs, config, keys })
}

pub(super) fn sink_entry(keys: &Table) -> Result<SinkEntry, EntryError> {
    let mut own = keys.clone();
    let kind = kind_of(&mut own, sink::KINDS, "sink")?;
    let name = take(&mut own, "name")?.unwrap_or_else(|| kind.name.to_owned());
    let queue = take(&mut own, "queue")?.unwrap_or(SINK_QUEUE);
    let when_full = take(&mut own, "when_full")?;
    let (config, shown) = kind.read(own).map_err(|source| EntryError::Own { kind: kind.name, source })?;
    let mut keys = Table::new();
    keys.insert("kind".to_owned(), kind.name.into());
    keys.insert("name".to_owned(), name.clone().into());
    keys.insert("queue".to_owned(), i64::try_from(queue).unwrap_or(i64::MAX).into());
    if let Some(policy) = when_full {
        keys.insert("when_full".to_owned(), toml::Value::try_from(policy)?);
    }
    keys.extend(shown);
    Ok(SinkEntry { name, kind: kind.name, queue, when_full, config, keys })
}
