//! States of a service, as codes in status, page and letters.

use gearwatch_alarm::ChannelHealth;
use gearwatch_core::codes;
use gearwatch_core::verdict::{Code, MachineState};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

codes! {
    /// Answer of the self test.
    pub enum SelfTestState, default NotYet {
        /// The known signal got its known ranks.
        Right = "right",
        /// It got others, or its lane has ended.
        Wrong = "wrong",
        /// It has had no right answer for too long.
        Late = "late",
        /// The first answer is still to come.
        NotYet = "not_yet",
    }
}

impl SelfTestState {
    /// Nothing speaks against the workers.
    pub fn is_good(self) -> bool {
        matches!(self, Self::Right | Self::NotYet)
    }
}

codes! {
    /// What a source does.
    pub enum SourceCondition, default Unknown {
        /// It is being opened.
        Opening = "opening",
        /// It delivers.
        Running = "running",
        /// It is live and has delivered nothing for longer than its deadline.
        Silent = "silent",
        /// It failed and is tried again after a while.
        Waiting = "waiting",
        /// It came to its end.
        Ended = "ended",
        /// It failed for good.
        Failed = "failed",
        /// A code of another version.
        Unknown = "unknown",
    }
}

impl SourceCondition {
    /// Data that should come do not.
    pub fn is_silent(self) -> bool {
        matches!(self, Self::Silent | Self::Waiting | Self::Failed)
    }

    /// It does what it should.
    pub fn is_good(self) -> bool {
        matches!(self, Self::Opening | Self::Running | Self::Ended)
    }
}

codes! {
    /// What a sink does.
    pub enum SinkCondition, default Unknown {
        /// It takes what comes.
        Running = "running",
        /// It failed and is tried again after a while.
        Waiting = "waiting",
        /// Its reader has gone.
        Disabled = "disabled",
        /// It has written all it got.
        Ended = "ended",
        /// A code of another version.
        Unknown = "unknown",
    }
}

codes! {
    /// Whether the service of a bench runs.
    pub enum Life, default Unheard {
        /// It has not said so yet.
        Unheard = "",
        /// It runs.
        Running = "running",
        /// It was stopped.
        Stopped = "stopped",
    }
}

/// Instrument state of a bench: good only if all its channels are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BenchInstrument {
    /// All channels are all right, or the state of one that is not.
    Channel(ChannelHealth),
    /// A source delivers nothing.
    Silent,
    /// The service was stopped.
    Stopped,
    /// Not heard, or a code of another version.
    #[default]
    Unknown,
}

impl BenchInstrument {
    /// Of a bench whose channels are all right.
    pub const OK: Self = Self::Channel(ChannelHealth::Ok);

    /// As written in JSON and metrics.
    pub const fn code(self) -> &'static str {
        match self {
            Self::Channel(health) => health.code(),
            Self::Silent => "silent",
            Self::Stopped => "stopped",
            Self::Unknown => "unknown",
        }
    }

    /// The state of a code; [`Self::Unknown`] where no state has it.
    pub fn of_code(code: &str) -> Self {
        match code {
            "silent" => Self::Silent,
            "stopped" => Self::Stopped,
            _ => ChannelHealth::of_code(code).map_or(Self::Unknown, Self::Channel),
        }
    }
}

/// A bench in one word, for a fleet. Silence is never good news.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BenchCondition {
    /// Its service was stopped.
    Stopped,
    /// It was not heard for too long.
    Silent,
    /// Service or instrument are not all right.
    NotOk,
    /// The worst state of its places.
    Machine(MachineState),
}

impl BenchCondition {
    /// As tables and the page show it.
    pub const fn code(self) -> &'static str {
        match self {
            Self::Stopped => "stopped",
            Self::Silent => "silent",
            Self::NotOk => "not ok",
            Self::Machine(state) => state.code(),
        }
    }
}

impl Serialize for BenchInstrument {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.code())
    }
}

impl<'de> Deserialize<'de> for BenchInstrument {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Ok(Self::of_code(&String::deserialize(deserializer)?))
    }
}

/// A code of another version becomes the default, so that the rest of its status can be read.
pub(crate) fn tolerant<'de, D: Deserializer<'de>, C: Code + Default>(deserializer: D) -> Result<C, D::Error> {
    Ok(C::of_code(&String::deserialize(deserializer)?).unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;
    use gearwatch_core::verdict::InstrumentState;

    #[test]
    fn conform_states_go_there_and_back_and_codes_of_other_versions_are_never_good() {
        let states = InstrumentState::ALL.iter().map(|&state| match state {
            InstrumentState::Ok => ChannelHealth::Ok,
            state => ChannelHealth::NotOk(state),
        });
        let channels = states.chain([ChannelHealth::Earning]).map(BenchInstrument::Channel);
        for state in channels.chain([BenchInstrument::Silent, BenchInstrument::Stopped, BenchInstrument::Unknown]) {
            assert_eq!(BenchInstrument::of_code(state.code()), state);
        }
        assert_eq!(BenchInstrument::of_code("fine"), BenchInstrument::Unknown);
        assert_eq!(BenchInstrument::of_code(""), BenchInstrument::Unknown);
        assert!(!SourceCondition::default().is_good());
    }
}
