//! What is normal: the baseline of a bench, and how it is put together from runs.
//!
//! A [`Run`] is what one recording of the normal state says at one operating point. A [`Baseline`]
//! is a set of runs; the cells and the surface over speed and torque are computed from the set
//! ([`Surface`]), so that joining two baselines is joining two sets: it does not matter in which
//! order or in how many steps.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::verdict::HARMONICS;

mod cells;
mod learner;
mod machine;
mod mixed;
mod moderated;
mod slip;
mod surface;

pub use cells::{Cell, Reference};
pub use learner::{LearnError, Learner, Origin};
pub(crate) use learner::{Series, split};
pub use machine::{Change, Machine, Mounted, Rebinding, Teeth};
pub use mixed::MixedCell;
pub use moderated::ScatterPrior;
pub use slip::Slip;
pub use surface::{Place, Surface};

/// The value of the key `format`.
pub const FORMAT: &str = "gearwatch-baseline/1";

/// How near an operating point must be to a cell to be judged by it, and how many windows a cell
/// needs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BaselineConfig {
    /// Input-shaft speeds this near are one operating point (percent of the speed, above 0).
    pub speed_tolerance_percent: f64,
    /// Torques this near are one operating point (percent of the torque, ≥ 0); the larger of the
    /// two counts.
    pub torque_tolerance_percent: f64,
    /// Torques this near are one operating point (N m, above 0); the larger of the two counts.
    pub torque_tolerance_nm: f64,
    /// Independent windows that a line's scatter must be known from before anything is judged by
    /// it: its own, and what the other lines of its stage at the sensor are worth for it (above 1).
    pub least_windows: f64,
}

impl Default for BaselineConfig {
    fn default() -> Self {
        Self {
            speed_tolerance_percent: 1.0,
            torque_tolerance_percent: 3.0,
            torque_tolerance_nm: 0.5,
            least_windows: 3.0,
        }
    }
}

impl BaselineConfig {
    /// What is wrong with the values, in a sentence; `None` for usable ones.
    pub fn problem(&self) -> Option<String> {
        let above = |value: f64, least: f64| value.is_finite() && value > least;
        if !above(self.speed_tolerance_percent, 0.0) {
            return Some(format!(
                "speed_tolerance_percent is {}; expected a number above 0",
                self.speed_tolerance_percent
            ));
        }
        if !(self.torque_tolerance_percent >= 0.0 && above(self.torque_tolerance_nm, 0.0)) {
            return Some(format!(
                "torque_tolerance_percent is {} and torque_tolerance_nm is {}; expected at least 0 and above 0",
                self.torque_tolerance_percent, self.torque_tolerance_nm
            ));
        }
        (!above(self.least_windows, 1.0))
            .then(|| format!("least_windows is {}; a scatter needs more than one window", self.least_windows))
    }

    /// Two speeds (Hz) are one operating point.
    pub fn speed_matches(&self, a: f64, b: f64) -> bool {
        (a - b).abs() <= self.speed_tolerance_percent / 100.0 * a.abs().max(b.abs())
    }

    /// How far two torques (N m) about this one may lie apart and be one operating point.
    fn torque_reach(&self, torque_nm: f64) -> f64 {
        self.torque_tolerance_nm.max(self.torque_tolerance_percent / 100.0 * torque_nm.abs())
    }

    /// Two torques are one operating point; an unknown one matches only an unknown one.
    pub fn torque_matches(&self, a: Option<f64>, b: Option<f64>) -> bool {
        match (a, b) {
            (Some(a), Some(b)) => (a - b).abs() <= self.torque_reach(a.abs().max(b.abs())),
            (None, None) => true,
            _ => false,
        }
    }
}

/// What is normal on a bench. The io crate reads and writes it as a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Baseline {
    /// Always [`FORMAT`].
    pub format: String,
    /// Name of the bench, for people.
    pub bench: String,
    /// SHA-256 of the bench's content when it was learned, lower-case hexadecimal.
    pub bench_sha256: String,
    /// What of the bench it rests on; files of before 2026-11-22 do not say, and belong to the
    /// whole bench file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub machine: Option<Machine>,
    /// When it was tied to a changed bench by hand, and why; in order of time.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub history: Vec<Rebinding>,
    /// Length of the windows (s). Floors and scatter depend on it.
    pub window_s: f64,
    /// Rank steps that were in force when it was learned (percent).
    pub rank_steps_percent: [f64; 5],
    /// Tolerances of its cells.
    pub config: BaselineConfig,
    /// Stage names from motor to brake, in the order of all lists by stage.
    pub stages: Vec<String>,
    /// Sorted by session, mounting, recording, speed and torque.
    pub runs: Vec<Run>,
}

/// One recording of the normal state at one operating point.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Run {
    /// The session: what was recorded without switching off for long. Sessions differ in
    /// temperature, oil, supply.
    pub session: String,
    /// The mounting: since when neither sensors nor gears were taken off.
    pub mounting: String,
    /// The recording, by its file name.
    pub recording: String,
    /// Mean input-shaft speed (Hz).
    pub input_speed_hz: f64,
    /// Mean torque at the brake (N m); unknown where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub brake_torque_nm: Option<f64>,
    /// Mean motor speed as stated (Hz), behind which the motor may slip; left out where unstated,
    /// and in files of before 2026-11-22.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motor_speed_hz: Option<f64>,
    /// By sensor name.
    pub channels: BTreeMap<String, RunChannel>,
}

/// What one sensor says in a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunChannel {
    /// Unit of the amplitudes.
    pub unit: String,
    /// Windows that were offered with a sound instrument.
    pub windows: u32,
    /// By stage, then 1x to 5x; none where the line was not known in at least two windows.
    pub stages: Vec<[Option<LineStatistics>; HARMONICS]>,
    /// Condition indicators by name, `rms` or `1.pinion.fm4` with the position of the stage from 1;
    /// those that were known in at least two windows. Files of before 2026-11-22 have none.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub indicators: BTreeMap<String, IndicatorStatistics>,
}

/// A condition indicator over the windows of a run, averaged as a logarithm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IndicatorStatistics {
    /// How many independent windows those kept are worth.
    pub effective: f64,
    /// Geometric mean.
    pub value: f64,
    /// Window-to-window standard deviation of ln value.
    pub scatter: f64,
    /// What of the scatter windows state themselves (relative, root mean square of sigma / value).
    pub noise: f64,
}

/// One mesh harmonic over the windows of a run. Amplitudes are averaged as logarithms: the mean of
/// `ln |A + noise|` is `ln A` up to E1(A²/2σ²)/2, below 0.001 % from 13 dB above the noise on,
/// whereas the mean of `|A + noise|` is too large.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LineStatistics {
    /// Windows kept.
    pub windows: u32,
    /// Windows left out as wild.
    pub left_out: u32,
    /// How many independent windows those kept are worth.
    pub effective: f64,
    /// Geometric mean of the amplitude (the channel's unit).
    pub amplitude: f64,
    /// Window-to-window standard deviation of ln amplitude: a relative scatter, 0.05 is 5 %.
    pub scatter: f64,
    /// What of the scatter is the noise beside the line (relative, root mean square of sigma /
    /// amplitude).
    pub noise: f64,
    /// Geometric mean of the local floor (the channel's unit); left out where it was not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub floor: Option<FloorStatistics>,
}

/// The local floor beside a mesh harmonic over the windows of a run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FloorStatistics {
    /// How many independent windows it was averaged over.
    pub effective: f64,
    /// Geometric mean (the channel's unit).
    pub amplitude: f64,
    /// Window-to-window standard deviation of ln floor.
    pub scatter: f64,
}

impl Run {
    /// Session, mounting and recording.
    fn origin(&self) -> (&str, &str, &str) {
        (&self.session, &self.mounting, &self.recording)
    }

    /// Order of the runs in a baseline.
    fn order(&self, other: &Self) -> std::cmp::Ordering {
        let torque = |run: &Self| run.brake_torque_nm.unwrap_or(f64::NEG_INFINITY);
        self.origin()
            .cmp(&other.origin())
            .then(self.input_speed_hz.total_cmp(&other.input_speed_hz))
            .then(torque(self).total_cmp(&torque(other)))
    }
}

/// Why two baselines cannot be joined, or a run cannot be added.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MergeError {
    /// They describe different things.
    #[error("{what} differs: {left} and {right}; only baselines of one bench and one configuration can be joined")]
    Different {
        /// What differs.
        what: &'static str,
        /// In the first.
        left: String,
        /// In the second.
        right: String,
    },
    /// They were learned on machines that differ.
    #[error("{change}; only baselines of one machine can be joined")]
    Machine {
        /// The first field that differs.
        change: String,
    },
    /// The same recording stands in both, with other content.
    #[error(
        "recording {recording:?} of session {session:?}, mounting {mounting:?}, is in both with different content; \
         give the sessions names of their own"
    )]
    Conflict {
        /// The session.
        session: String,
        /// The mounting.
        mounting: String,
        /// The recording.
        recording: String,
    },
    /// A sensor's unit changed.
    #[error("channel {channel:?} is in {left} in one run and in {right} in another")]
    Unit {
        /// The sensor.
        channel: String,
        /// One unit.
        left: String,
        /// The other.
        right: String,
    },
}

impl Baseline {
    /// A baseline without runs.
    pub fn new(bench: &crate::bench::Bench, bench_sha256: String, window_s: f64, config: BaselineConfig) -> Self {
        Self {
            format: FORMAT.to_owned(),
            bench: bench.name.clone(),
            bench_sha256,
            machine: Some(Machine::of(bench)),
            history: Vec::new(),
            window_s,
            rank_steps_percent: crate::rank::RankConfig::default().steps_percent,
            config,
            stages: bench.stages.iter().map(|s| s.name.clone()).collect(),
            runs: Vec::new(),
        }
    }

    /// Adds the runs of one recording.
    ///
    /// # Errors
    /// When the recording is there already with other content, or a unit differs. Nothing is
    /// changed then.
    pub fn add(&mut self, runs: Vec<Run>) -> Result<(), MergeError> {
        let mut other = Self { runs, ..self.clone_empty() };
        other.runs.sort_by(Run::order);
        *self = self.merged(&other)?;
        Ok(())
    }

    fn clone_empty(&self) -> Self {
        Self {
            format: self.format.clone(),
            bench: self.bench.clone(),
            bench_sha256: self.bench_sha256.clone(),
            machine: self.machine.clone(),
            history: self.history.clone(),
            stages: self.stages.clone(),
            runs: Vec::new(),
            ..*self
        }
    }

    /// Both together. Associative and commutative; joining a baseline with itself changes nothing.
    ///
    /// # Errors
    /// When they are of different benches or configurations, hold different content of one
    /// recording, or units differ.
    pub fn merged(&self, other: &Self) -> Result<Self, MergeError> {
        let different = |what, left: &dyn std::fmt::Debug, right: &dyn std::fmt::Debug| {
            Err(MergeError::Different { what, left: format!("{left:?}"), right: format!("{right:?}") })
        };
        match (&self.machine, &other.machine) {
            (Some(left), Some(right)) => {
                if let Some(change) = left.changes(right).into_iter().chain(right.changes(left)).next() {
                    return Err(MergeError::Machine { change: change.sentence });
                }
            }
            // One does not say what it rests on: then the whole bench file counts.
            _ if self.bench_sha256 != other.bench_sha256 => {
                return different("the bench (SHA-256)", &self.bench_sha256, &other.bench_sha256);
            }
            _ => {}
        }
        if self.window_s != other.window_s {
            return different("the window length (s)", &self.window_s, &other.window_s);
        }
        if self.rank_steps_percent != other.rank_steps_percent {
            return different("the list of rank steps (percent)", &self.rank_steps_percent, &other.rank_steps_percent);
        }
        if self.config != other.config {
            return different("the configuration of cells", &self.config, &other.config);
        }
        if self.stages != other.stages {
            return different("the list of stages", &self.stages, &other.stages);
        }
        let mut merged = self.clone();
        if other.bench_sha256 < self.bench_sha256 {
            // Either will do, as long as it does not depend on the order.
            (merged.bench, merged.bench_sha256) = (other.bench.clone(), other.bench_sha256.clone());
        }
        merged.machine = self.machine.clone().or_else(|| other.machine.clone());
        merged.history.extend_from_slice(&other.history);
        merged.history.sort();
        merged.history.dedup();
        for group in other.runs.chunk_by(|a, b| a.origin() == b.origin()) {
            let mine: Vec<&Run> = self.runs.iter().filter(|run| run.origin() == group[0].origin()).collect();
            if mine.is_empty() {
                merged.runs.extend_from_slice(group);
            } else if mine.into_iter().ne(group) {
                let run = &group[0];
                return Err(MergeError::Conflict {
                    session: run.session.clone(),
                    mounting: run.mounting.clone(),
                    recording: run.recording.clone(),
                });
            }
        }
        merged.runs.sort_by(Run::order);
        merged.unit_conflict().map_or(Ok(merged), Err)
    }

    fn unit_conflict(&self) -> Option<MergeError> {
        let mut units: BTreeMap<&str, &str> = BTreeMap::new();
        for (name, channel) in self.runs.iter().flat_map(|run| &run.channels) {
            let known = *units.entry(name).or_insert(&channel.unit);
            if known != channel.unit {
                return Some(MergeError::Unit {
                    channel: name.clone(),
                    left: known.to_owned(),
                    right: channel.unit.clone(),
                });
            }
        }
        None
    }

    /// What is wrong with the values, one sentence each; empty for a usable baseline.
    pub fn problems(&self) -> Vec<String> {
        let mut out = Vec::new();
        if self.format != FORMAT {
            out.push(format!("format is {:?}; this version reads {FORMAT:?}", self.format));
        }
        if !(self.window_s.is_finite() && self.window_s > 0.0) {
            out.push(format!("window_s is {}; expected seconds above 0", self.window_s));
        }
        out.extend(self.config.problem());
        out.extend(crate::rank::RankConfig { steps_percent: self.rank_steps_percent }.problem());
        out.extend(self.unit_conflict().map(|conflict| conflict.to_string()));
        if self.runs.is_empty() {
            out.push("there are no runs".to_owned());
        }
        for run in &self.runs {
            let place = format!("run {:?} of session {:?}", run.recording, run.session);
            if !(run.input_speed_hz.is_finite() && run.input_speed_hz > 0.0) {
                out.push(format!("{place}: input_speed_hz is {}; expected Hz above 0", run.input_speed_hz));
            }
            for (name, channel) in &run.channels {
                if channel.stages.len() != self.stages.len() {
                    out.push(format!(
                        "{place}, channel {name:?}: {} stages, but the baseline names {}",
                        channel.stages.len(),
                        self.stages.len()
                    ));
                }
                if channel.stages.iter().flatten().flatten().any(|line| !line.is_usable()) {
                    out.push(format!(
                        "{place}, channel {name:?}: a line has an amplitude that is not above 0 or a negative scatter"
                    ));
                }
            }
        }
        out
    }

    /// Distinct sessions, each with its mountings.
    pub fn sessions(&self) -> BTreeMap<&str, Vec<&str>> {
        let mut out: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        for run in &self.runs {
            let mountings = out.entry(&run.session).or_default();
            if !mountings.contains(&run.mounting.as_str()) {
                mountings.push(&run.mounting);
            }
        }
        out
    }
}

impl LineStatistics {
    fn is_usable(&self) -> bool {
        let line = self.amplitude > 0.0 && self.amplitude.is_finite();
        let spread = self.scatter >= 0.0 && self.noise >= 0.0 && self.effective >= 1.0;
        line && spread
            && self
                .floor
                .is_none_or(|f| f.amplitude > 0.0 && f.amplitude.is_finite() && f.scatter >= 0.0 && f.effective >= 1.0)
    }
}

#[cfg(test)]
mod tests;
