//! Properties of TDMS objects.

use std::collections::BTreeMap;

use gearwatch_core::block::UnixNanos;

/// Value of a property.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Value {
    Number(f64),
    Text(String),
    Time(UnixNanos),
}

impl Value {
    /// Bytes in memory.
    pub(super) fn size(&self) -> usize {
        32 + if let Self::Text(text) = self { text.len() } else { 0 }
    }

    pub(super) fn number(&self) -> Option<f64> {
        if let Self::Number(number) = self { Some(*number) } else { None }
    }

    pub(super) fn text(&self) -> Option<String> {
        if let Self::Text(text) = self { Some(text.clone()) } else { None }
    }

    pub(super) fn nanos(&self) -> Option<UnixNanos> {
        if let Self::Time(time) = self { Some(*time) } else { None }
    }
}

pub(super) type Properties = BTreeMap<String, Value>;
