//! What the tables of sources and sinks have in common: a kind has a name, help, an example, and reads its own keys.

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

/// Turns a table of keys into a configuration, and into the table with all defaults filled in.
type Read<C> = fn(toml::Table) -> Result<(Box<C>, toml::Table), String>;

impl<C: ?Sized> Kind<C> {
    /// A kind whose keys are the fields of `T`.
    pub(crate) const fn new<T: JsonSchema>(
        name: &'static str,
        help: &'static str,
        example: &'static str,
        read: Read<C>,
    ) -> Self {
        Self { name, help, example, read, schema: T::json_schema }
    }

    /// Reads the kind's own keys; the error says which key is wrong and which there are.
    pub fn read(&self, keys: toml::Table) -> Result<(Box<C>, toml::Table), String> {
        (self.read)(keys)
    }

    /// JSON schema of the kind's own keys.
    pub(crate) fn schema(&self, generator: &mut SchemaGenerator) -> Schema {
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
pub(crate) fn left_out(what: &str, feature: &str, compiled: bool) -> Option<String> {
    (!compiled).then(|| format!("this build has left out {what}; {}", with_feature(feature)))
}

/// Reads keys into the type that describes a kind, and fills in the defaults.
pub(crate) fn read_keys<T: DeserializeOwned + Serialize>(keys: toml::Table) -> Result<(T, toml::Table), String> {
    let config: T = keys.try_into().map_err(|e: toml::de::Error| one_line(&e))?;
    let shown = toml::Table::try_from(&config).map_err(|e| e.to_string())?;
    Ok((config, shown))
}

/// What is wrong, and with which key.
pub(crate) fn one_line(error: &toml::de::Error) -> String {
    error.to_string().trim_end().replace('\n', " ")
}

/// Finds a kind by name, or says which there are.
pub fn find<'a, C: ?Sized>(kinds: &'a [Kind<C>], name: &str, what: &str) -> Result<&'a Kind<C>, String> {
    kinds.iter().find(|kind| kind.name == name).ok_or_else(|| {
        let names: Vec<_> = kinds.iter().map(|kind| kind.name).collect();
        format!("there is no {what} of kind {name:?}; there are {}", names.join(", "))
    })
}
