//! Holds packets back until they are due.

use std::time::{Duration, Instant};

use gearwatch_core::block::{Packet, UnixNanos};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use gearwatch_runtime::stop::Stop;

/// How fast recorded time goes by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "Written", into = "Written")]
#[schemars(with = "Written")]
pub enum Speed {
    /// As fast as the machine can.
    #[default]
    Max,
    /// Seconds of recording per second.
    Times(f64),
}

/// A speed as it stands in the configuration.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
enum Written {
    /// `"max"`.
    Word(String),
    /// Seconds of recording per second (> 0).
    Times(f64),
}

/// A text or number that is no speed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SpeedError {
    /// A word of the configuration.
    #[error("speed is {0:?}; expected \"max\" or a number")]
    Word(String),
    /// A text that is neither.
    #[error("expected max or a number, found {0:?}")]
    Text(String),
    /// It stands still, goes back, or is not finite.
    #[error("speed is {0}; it must be \"max\" or a number above 0, 1 being real time")]
    OutOfRange(f64),
}

impl TryFrom<Written> for Speed {
    type Error = SpeedError;

    fn try_from(written: Written) -> Result<Self, SpeedError> {
        match written {
            Written::Times(times) => Ok(Self::Times(times)),
            Written::Word(word) if word == "max" => Ok(Self::Max),
            Written::Word(word) => Err(SpeedError::Word(word)),
        }
    }
}

impl From<Speed> for Written {
    fn from(speed: Speed) -> Self {
        match speed {
            Speed::Max => Self::Word("max".to_owned()),
            Speed::Times(times) => Self::Times(times),
        }
    }
}

impl Speed {
    /// What is wrong with it.
    pub(crate) fn problem(self) -> Option<String> {
        self.checked().err().map(|error| error.to_string())
    }

    fn checked(self) -> Result<Self, SpeedError> {
        match self {
            Self::Times(times) if !(times.is_finite() && times > 0.0) => Err(SpeedError::OutOfRange(times)),
            _ => Ok(self),
        }
    }
}

impl std::str::FromStr for Speed {
    type Err = SpeedError;

    fn from_str(text: &str) -> Result<Self, SpeedError> {
        if text == "max" {
            return Ok(Self::Max);
        }
        let times = text.parse().map_err(|_| SpeedError::Text(text.to_owned()))?;
        Self::Times(times).checked()
    }
}

/// Waits in a thread until a packet's last sample is due.
#[derive(Debug)]
pub struct Pacer {
    speed: Speed,
    stop: Stop,
    start: Option<(Instant, UnixNanos)>,
}

impl Pacer {
    /// Begins with the first packet; `stop` ends a wait.
    pub fn new(speed: Speed, stop: Stop) -> Self {
        Self { speed, stop, start: None }
    }

    /// Returns when the packet is due; `false` when asked to stop meanwhile.
    pub fn wait_for(&mut self, packet: &Packet) -> bool {
        let Speed::Times(times) = self.speed else { return !self.stop.is_given() };
        let (begin, length_secs) = match packet {
            Packet::Vibration(block) => (block.t0, block.samples.len() as f64 / block.sample_rate_hz),
            Packet::Tacho(block) => (block.t0, 0.0),
            Packet::OperatingPoint(point) => (point.t, 0.0),
        };
        let &mut (start, first) = self.start.get_or_insert_with(|| (Instant::now(), begin));
        let recorded_secs = begin.saturating_sub(first).max(0) as f64 * 1e-9 + length_secs;
        // A damaged time stamp must not hold a replay up for years.
        let due = Duration::try_from_secs_f64(recorded_secs / times).unwrap_or_default();
        self.stop.sleep((start + due).saturating_duration_since(Instant::now()).min(LONGEST_WAIT))
    }
}

/// A jump of the recording's clock beyond this is passed over (an hour).
const LONGEST_WAIT: Duration = Duration::from_secs(3600);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conform_speed_is_max_or_a_positive_number() {
        assert_eq!("max".parse(), Ok(Speed::Max));
        assert_eq!("1".parse(), Ok(Speed::Times(1.0)));
        for bad in ["0", "-1", "nan", "inf", "fast", ""] {
            assert!(bad.parse::<Speed>().is_err(), "{bad}");
        }
    }
}
