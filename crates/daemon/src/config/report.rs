//! What reports say of bench and people.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Stands at the head of reports; what is left out is not shown.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ReportConfig {
    /// For whom it is.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub customer: String,
    /// Who answers for it.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub author: String,
    /// Name of the bench or of the machine under test.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub bench: String,
    /// Its serial number.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub serial: String,
}

impl ReportConfig {
    pub(super) fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}
