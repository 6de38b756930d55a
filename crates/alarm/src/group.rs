//! Channels of one stage are one fault: one damaged gear shows at several sensors.

use serde::{Deserialize, Serialize};

use crate::{Alarm, Severity};

/// The alarms of one stage after one of them has changed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Group {
    /// Channels whose alarm holds, by name.
    pub channels: Vec<String>,
    /// The worst of them; where none holds any more, that of the one that ended last.
    pub severity: Severity,
    /// It says more than was known of the stage: the first channel, one that is worse than all
    /// others, or the end of the last.
    pub news: bool,
}

impl Group {
    /// Of an alarm that has changed, and all that stand of its stage.
    pub(super) fn of<'a>(changed: &Alarm, standing: impl Iterator<Item = &'a Alarm>) -> Self {
        let others: Vec<&Alarm> = standing.filter(|other| other.active && other.id != changed.id).collect();
        let mut channels: Vec<String> = others.iter().map(|other| other.channel.clone()).collect();
        let mut severity = others.iter().map(|other| other.severity).max();
        let news = if changed.active {
            channels.push(changed.channel.clone());
            channels.sort_unstable();
            let more = severity.is_none_or(|known| changed.severity > known);
            severity = severity.max(Some(changed.severity));
            more
        } else {
            others.is_empty()
        };
        Self { channels, severity: severity.unwrap_or(changed.severity), news }
    }
}
