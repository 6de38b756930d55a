//! One bench of the service.

use std::collections::BTreeSet;
use std::path::PathBuf;

use gearwatch_alarm::AlarmConfig;
use gearwatch_core::pipeline::PipelineConfig;

use super::SourceEntry;

/// A source that may be silent for longer is not watched (s).
const LONGEST_DEADLINE_SECS: f64 = 86_400.0;

/// One bench of the service.
#[derive(Debug)]
pub struct BenchConfig {
    /// Bench file; `None`: the built-in demonstration bench.
    pub file: Option<PathBuf>,
    /// Baseline file.
    pub baseline: Option<PathBuf>,
    /// Learns the baseline at start.
    pub learn_from: Option<SourceEntry>,
    /// Fault states of this bench.
    pub signatures: Option<PathBuf>,
    /// The row of stages from samples to ranks.
    pub pipeline: PipelineConfig,
    /// When alarms come and go.
    pub alarm: AlarmConfig,
    /// Where its packets come from.
    pub sources: Vec<SourceEntry>,
}

impl BenchConfig {
    pub(super) fn is_live(&self) -> bool {
        self.sources.iter().any(|source| source.config.is_live())
    }

    pub(super) fn problems(&self) -> Vec<String> {
        let mut out = self.pipeline.window.problems();
        out.extend(self.pipeline.speed.problems());
        out.extend(self.pipeline.rank.problem());
        out.extend(self.alarm.problems());
        out.extend(self.pipeline.state.problem());
        if self.sources.is_empty() {
            out.push("there is no [[bench.source]]".to_owned());
        }
        if self.baseline.is_some() && self.learn_from.is_some() {
            out.push("baseline and learn_from exclude each other; leave one out".to_owned());
        }
        if let Some(learn_from) = &self.learn_from {
            out.extend(learn_from.config.problems().into_iter().map(|problem| format!("learn_from: {problem}")));
            if learn_from.config.is_live() {
                out.push("learn_from: a live source does not end; use a recording, or speed = \"max\"".to_owned());
            }
        }
        let mut names = BTreeSet::new();
        for source in &self.sources {
            if !names.insert(&source.name) {
                out.push(format!("two sources are called {:?}; give one another name", source.name));
            }
            if !(source.data_deadline_secs > 0.0 && source.data_deadline_secs <= LONGEST_DEADLINE_SECS) {
                out.push(format!(
                    "source {:?}: data_deadline_secs is {}; it must be above 0 and at most a day",
                    source.name, source.data_deadline_secs
                ));
            }
            out.extend(
                source.config.problems().into_iter().map(|problem| format!("source {:?}: {problem}", source.name)),
            );
        }
        out
    }
}
