//! Judging windows whose channels become known as they come.

use std::collections::BTreeSet;
use std::sync::Arc;

use gearwatch_core::aggregate::Average;
use gearwatch_core::analysis::WindowAnalysis;
use gearwatch_core::baseline::Baseline;
use gearwatch_core::judge::{ChannelInfo, Judge, JudgeConfig, JudgeError};
use gearwatch_core::signature::SignatureTable;
use gearwatch_core::verdict::Verdict;

/// What windows are judged by.
#[derive(Clone, Debug)]
pub struct Criteria {
    /// Rank steps, and how sure a state must be.
    pub config: JudgeConfig,
    /// Stages of the bench, in its order.
    pub stages: Vec<String>,
    /// What is normal; without it every rank is unknown.
    pub baseline: Option<Arc<Baseline>>,
}

/// Judges windows and averages; learns of channels as it meets them.
#[derive(Debug)]
pub struct Judging {
    criteria: Criteria,
    /// By position in the assembler's list; a blank for one that was not met yet.
    channels: Vec<ChannelInfo>,
    judge: Judge,
    /// Judges channels that do not fit the baseline: all ranks unknown.
    without_baseline: Judge,
    unfit: BTreeSet<usize>,
}

impl Judging {
    /// By these criteria.
    ///
    /// # Errors
    /// When the configuration is unusable, or the stages are not those of the baseline.
    pub fn new(criteria: Criteria) -> Result<Self, JudgeError> {
        let judge = judge(&criteria, Vec::new())?;
        let without_baseline = judge_without(&criteria, Vec::new())?;
        Ok(Self { criteria, channels: Vec::new(), judge, without_baseline, unfit: BTreeSet::new() })
    }

    /// Judges one window, one verdict a stage. The error is told once, with the first window of a channel that does not fit the
    /// baseline; there are verdicts all the same, with unknown ranks.
    pub fn judge(&mut self, window: &WindowAnalysis, out: &mut Vec<Verdict>) -> Result<(), JudgeError> {
        let met = self.meet(window);
        self.judge_of(window.channel).judge(window, out);
        met
    }

    /// Judges an average, as [`Self::judge`] a window.
    pub fn judge_average(&mut self, average: &Average, out: &mut Vec<Verdict>) -> Result<(), JudgeError> {
        let met = self.meet(&average.analysis);
        self.judge_of(average.analysis.channel).judge_average(average, out);
        met
    }

    fn judge_of(&self, channel: usize) -> &Judge {
        if self.unfit.contains(&channel) { &self.without_baseline } else { &self.judge }
    }

    /// Takes note of a channel at its first window, or when its unit changed.
    fn meet(&mut self, window: &WindowAnalysis) -> Result<(), JudgeError> {
        let known = self.channels.get(window.channel);
        if known.is_some_and(|known| known.name == *window.sensor && known.unit == *window.unit) {
            return Ok(());
        }
        while self.channels.len() <= window.channel {
            self.channels.push(ChannelInfo { name: String::new(), unit: String::new() });
        }
        let info = ChannelInfo { name: window.sensor.to_string(), unit: window.unit.to_string() };
        self.channels[window.channel] = info.clone();
        self.unfit.remove(&window.channel);
        self.without_baseline = judge_without(&self.criteria, self.channels.clone())?;
        let fits = judge(&self.criteria, vec![info]).map(|_| ());
        if fits.is_err() {
            self.unfit.insert(window.channel);
        }
        let mut fitting = self.channels.clone();
        for &channel in &self.unfit {
            // A blank is in no baseline, and keeps the others in their places.
            fitting[channel] = ChannelInfo { name: String::new(), unit: String::new() };
        }
        self.judge = judge(&self.criteria, fitting)?;
        fits
    }
}

fn judge(criteria: &Criteria, channels: Vec<ChannelInfo>) -> Result<Judge, JudgeError> {
    let Criteria { config, stages, baseline } = criteria;
    Judge::new(*config, channels, stages.clone(), baseline.as_deref(), SignatureTable::paper())
}

fn judge_without(criteria: &Criteria, channels: Vec<ChannelInfo>) -> Result<Judge, JudgeError> {
    Judge::new(criteria.config, channels, criteria.stages.clone(), None, SignatureTable::paper())
}
