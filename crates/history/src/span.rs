//! What a span of time holds of one row.

use gearwatch_core::estimate::Estimate;
use gearwatch_core::indicators::columns::Mean;
use gearwatch_core::verdict::HARMONICS;

use crate::verdict_line::{VerdictLine, indicator_names};

/// Machine states, in the order of their weight.
pub const STATES: [&str; 5] = ["alarm", "deviating", "path_changed", "unknown", "normal"];

/// Which indicators a history holds: all of them take five times the memory of the rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Wanted {
    /// By their places in [`indicator_names`].
    All,
    /// One, by its place.
    One(usize),
    /// None.
    Nothing,
}

impl Wanted {
    /// First place, and how many.
    fn places(self) -> (usize, usize) {
        match self {
            Self::All => (0, indicator_names().count()),
            Self::One(place) => (place, 1),
            Self::Nothing => (0, 0),
        }
    }
}

/// What a span of time holds of one row.
#[derive(Clone)]
pub struct Span {
    /// Windows.
    pub windows: u64,
    /// Windows by [`STATES`].
    pub states: [u64; 5],
    /// Windows whose instrument state is not `ok`.
    pub not_ok: u64,
    /// Highest level of a rank by harmonic, −1 where none was known.
    pub levels: [i8; HARMONICS],
    /// Deviations from the baseline (percent).
    pub deviations: [Mean; HARMONICS],
    /// Amplitudes in the channel's unit.
    pub amplitudes: [Mean; HARMONICS],
    /// Speed of the input shaft (Hz).
    pub speed: Mean,
    /// Torque at the brake (N m).
    pub torque: Mean,
    /// Those that are wanted, usually all by the names of [`indicator_names`]; empty where no
    /// window has any.
    pub indicators: Vec<Mean>,
}

impl Span {
    pub(crate) fn new() -> Self {
        Self {
            windows: 0,
            states: [0; 5],
            not_ok: 0,
            levels: [-1; HARMONICS],
            deviations: [Mean::default(); HARMONICS],
            amplitudes: [Mean::default(); HARMONICS],
            speed: Mean::default(),
            torque: Mean::default(),
            indicators: Vec::new(),
        }
    }

    /// The gravest state that a window was in, and how many were.
    pub fn state(&self) -> (&'static str, u64) {
        STATES.iter().zip(self.states).find(|(_, count)| *count > 0).map_or(("unknown", 0), |(&name, n)| (name, n))
    }

    pub(crate) fn push(&mut self, line: &VerdictLine, wanted: Wanted) {
        self.windows += 1;
        let state = STATES.iter().position(|state| *state == line.machine).unwrap_or(3);
        self.states[state] += 1;
        self.not_ok += u64::from(line.instrument != "ok");
        let (speed, sigma) = line.speed();
        self.speed.push(Estimate::new(speed, sigma));
        self.torque.push(Estimate::new(line.torque(), 0.0));
        for h in 0..HARMONICS {
            let [deviation, deviation_sigma, amplitude, sigma, level] = line.harmonic(h);
            self.deviations[h].push(Estimate::new(deviation, deviation_sigma));
            self.amplitudes[h].push(Estimate::new(amplitude, sigma));
            if level.is_finite() {
                self.levels[h] = self.levels[h].max(level as i8);
            }
        }
        let (first, count) = wanted.places();
        let indicators = || line.indicators().skip(first).take(count);
        if indicators().any(|(value, _)| value.is_finite()) {
            self.indicators.resize(count, Mean::default());
            for (mean, (value, sigma)) in self.indicators.iter_mut().zip(indicators()) {
                mean.push(Estimate::new(value, sigma));
            }
        }
    }

    /// Takes in a part of the same span that was put together elsewhere.
    pub(crate) fn merge(&mut self, other: &Self) {
        self.windows += other.windows;
        self.not_ok += other.not_ok;
        self.states.iter_mut().zip(other.states).for_each(|(n, more)| *n += more);
        self.levels.iter_mut().zip(other.levels).for_each(|(level, more)| *level = (*level).max(more));
        if self.indicators.is_empty() {
            self.indicators = vec![Mean::default(); other.indicators.len()];
        }
        let (mine, theirs) = (self.means_mut(), other.means());
        mine.zip(theirs).for_each(|(mean, more)| mean.merge(more));
    }

    /// All means in a fixed order, those of the indicators last.
    pub(crate) fn means(&self) -> impl Iterator<Item = &Mean> {
        self.deviations.iter().chain(&self.amplitudes).chain([&self.speed, &self.torque]).chain(&self.indicators)
    }

    /// The same, to be changed.
    pub(crate) fn means_mut(&mut self) -> impl Iterator<Item = &mut Mean> {
        let own = self.deviations.iter_mut().chain(&mut self.amplitudes);
        own.chain([&mut self.speed, &mut self.torque]).chain(&mut self.indicators)
    }
}
