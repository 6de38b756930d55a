//! What the tables of sources and sinks have in common: a kind has a name, help, an example, and
//! reads its own keys.

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// One line of a table of kinds. `C` is what the kind's configuration becomes.
pub struct Kind<C: ?Sized + 'static> {
    /// As written in `kind = "…"`.
    pub name: &'static str,
    /// One sentence for `gearwatch list` and help.
    pub help: &'static str,
    /// TOML keys as a user would write them; the conformance tests parse them.
    pub example: &'static str,
    read: Read<C>,
    schema: fn(&mut SchemaGenerator) -> Schema,
}

/// Why a table of keys is no configuration.
#[derive(Debug, thiserror::Error)]
pub enum KindError {
    /// No kind has this name.
    #[error("there is no {what} of kind {name:?}; there are {}", known.join(", "))]
    Unknown {
        /// What was looked for: `source` or `sink`.
        what: String,
        /// The name.
        name: String,
        /// Names that there are.
        known: Vec<&'static str>,
    },
    /// A key is wrong or missing.
    #[error("{}", one_line(.0))]
    Keys(Box<toml::de::Error>),
    /// What was read cannot be written as TOML.
    #[error(transparent)]
    Shown(#[from] toml::ser::Error),
}

/// Turns a table of keys into a configuration, and into the table with all defaults filled in.
type Read<C> = fn(toml::Table) -> Result<(Box<C>, toml::Table), KindError>;

impl<C: ?Sized> Kind<C> {
    /// A kind whose keys are the fields of `T`.
    pub const fn new<T: JsonSchema>(
        name: &'static str,
        help: &'static str,
        example: &'static str,
        read: Read<C>,
    ) -> Self {
        Self { name, help, example, read, schema: T::json_schema }
    }

    /// Reads the kind's own keys.
    ///
    /// # Errors
    /// Which key is wrong and which there are.
    pub fn read(&self, keys: toml::Table) -> Result<(Box<C>, toml::Table), KindError> {
        (self.read)(keys)
    }

    /// JSON schema of the kind's own keys.
    pub fn schema(&self, generator: &mut SchemaGenerator) -> Schema {
        (self.schema)(generator)
    }
}

/// What to do about a part of the program that a build has left out.
pub fn with_feature(feature: &str) -> String {
    format!(
        "it needs the cargo feature {feature:?} (cargo install --path crates/cli --features {feature}; \"full\" has them all)"
    )
}

/// A sentence for the problems of a kind whose code is compiled with a feature, where it was not.
pub fn left_out(what: &str, feature: &str, compiled: bool) -> Option<String> {
    (!compiled).then(|| format!("this build has left out {what}; {}", with_feature(feature)))
}

/// Reads keys into the type that describes a kind, and fills in the defaults.
///
/// # Errors
/// Which key is wrong and which there are.
pub fn read_keys<T: DeserializeOwned + Serialize>(keys: toml::Table) -> Result<(T, toml::Table), KindError> {
    let config: T = keys.try_into().map_err(|e| KindError::Keys(Box::new(e)))?;
    let shown = toml::Table::try_from(&config)?;
    Ok((config, shown))
}

/// What is wrong, and with which key.
pub fn one_line(error: &toml::de::Error) -> String {
    error.to_string().trim_end().replace('\n', " ")
}

/// Finds a kind by name.
///
/// # Errors
/// Which there are, where none has the name.
pub fn find<'a, C: ?Sized>(kinds: &'a [Kind<C>], name: &str, what: &str) -> Result<&'a Kind<C>, KindError> {
    kinds.iter().find(|kind| kind.name == name).ok_or_else(|| KindError::Unknown {
        what: what.to_owned(),
        name: name.to_owned(),
        known: kinds.iter().map(|kind| kind.name).collect(),
    })
}
