//! Indicators of recordings, a number a row: means over the windows of each channel, beside those
//! of healthy recordings.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::Serialize;
use serde::ser::SerializeStruct;

use crate::analysis::WindowAnalysis;
use crate::estimate::Estimate;
use crate::indicators::columns::{Column, Mean, columns};
use crate::indicators::running::{Reading, Running};
use crate::indicators::{CHANNEL_INDICATORS, GEAR_INDICATORS, GearIndicator, GearIndicators};
use crate::one_shot::each_window;
use crate::pipeline::{Pipeline, PipelineConfig};
use crate::source::Source;
use crate::verdict::{InstrumentState, published};
use crate::window::Window;

/// Names of the four that need a history of windows.
const NAMES: [&str; 4] = ["na4", "nb4", "na4_star", "nb4_star"];

/// The four stand behind it.
const LAST_OF_GEAR: GearIndicator = GearIndicator::ALL[GEAR_INDICATORS - 1];

/// The settings with which indicators of recordings are computed: windows of `window_s` seconds
/// that overlap by half, gears in each.
pub fn settings(window_s: f64) -> PipelineConfig {
    let mut config = PipelineConfig { indicators: true, gear_indicators_every: 1, ..PipelineConfig::default() };
    config.window.length_s = window_s;
    config.window.hop_s = 0.5 * window_s;
    config
}

/// By channel and gear: variances of residual and envelope over readings.
type History = BTreeMap<(Arc<str>, usize), [Running; 2]>;

/// NA4, NB4, NA4*, NB4* of a reading of residual signal and envelope, by channel and gear.
type Normalise<'a> = &'a mut dyn FnMut(&Arc<str>, usize, [Reading; 2]) -> [Estimate; 4];

/// Makes rows of recordings, one after the other; healthy ones come first.
pub struct IndicatorTable<'a> {
    pipeline: &'a Pipeline,
    columns: Vec<Column>,
    /// What NA4* and NB4* are normalised by.
    reference: History,
    history: History,
    healthy: Vec<Channel>,
}

/// What came of a recording.
#[derive(Debug, Default)]
pub struct Recorded {
    /// Channels in the order of their first windows, each with all its rows.
    pub rows: Vec<Row>,
    /// Windows that were left out: channel, why, how many, of how many.
    pub refused: Vec<(String, &'static str, u64, u64)>,
    /// Every channel had a window that could be used. False too where no channel had a window at
    /// all.
    pub usable: bool,
    /// Windows of all channels, used or not; 0 where every run of samples was shorter than a
    /// window.
    pub windows: u64,
}

impl<'a> IndicatorTable<'a> {
    /// For a pipeline with [`settings`].
    pub fn new(pipeline: &'a Pipeline) -> Self {
        Self {
            pipeline,
            columns: columns(pipeline.bench()),
            reference: History::new(),
            history: History::new(),
            healthy: Vec::new(),
        }
    }

    /// Takes in a recording of the healthy machine at the same speed and load; gives its number of
    /// windows.
    ///
    /// # Errors
    /// As the source.
    pub fn healthy<S: Source>(&mut self, source: &mut S) -> Result<u64, S::Error> {
        let reference = &mut self.reference;
        let channels = channels(self.pipeline, self.columns.len(), source, &mut |channel, gear, reading| {
            let running = reference.entry((channel.clone(), gear)).or_default();
            for (running, reading) in running.iter_mut().zip(&reading) {
                running.push(reading);
            }
            [Estimate::UNKNOWN; 4]
        })?;
        let windows = channels.iter().map(|channel| channel.windows).sum();
        self.healthy.extend(channels);
        Ok(windows)
    }

    /// The rows of a recording of this name.
    ///
    /// # Errors
    /// As the source.
    pub fn recording<S: Source>(&mut self, name: &str, source: &mut S) -> Result<Recorded, S::Error> {
        let (reference, history) = (&self.reference, &mut self.history);
        let channels = channels(self.pipeline, self.columns.len(), source, &mut |channel, gear, reading| {
            let key = (channel.clone(), gear);
            let star = reference.get(&key);
            let running = history.entry(key).or_default();
            let [na4, nb4] = [0, 1].map(|i| running[i].push(&reading[i]));
            let [na4_star, nb4_star] = [0, 1].map(|i| star.map_or(Estimate::UNKNOWN, |star| star[i].star(&reading[i])));
            [na4, nb4, na4_star, nb4_star]
        })?;
        let mut out = Recorded { usable: !channels.is_empty(), ..Recorded::default() };
        for channel in &channels {
            out.usable &= channel.speed.count() > 0;
            out.windows += channel.windows;
            out.refused.extend(
                channel.refused.iter().map(|(why, count)| (channel.name.to_string(), *why, *count, channel.windows)),
            );
            self.rows(name, channel, &mut out.rows);
        }
        Ok(out)
    }

    fn rows(&self, recording: &str, channel: &Channel, out: &mut Vec<Row>) {
        let normals: Vec<&Channel> = self.healthy.iter().filter(|h| h.name == channel.name).collect();
        let base = |place: &str, name: &str, unit: &str, mean: Mean, revolutions: u32| Row {
            recording: recording.to_owned(),
            channel: channel.name.to_string(),
            place: place.to_owned(),
            indicator: name.to_owned(),
            unit: unit.to_owned(),
            value: mean.estimate(0.5),
            windows: mean.count(),
            revolutions,
            speed_hz: channel.speed.estimate(0.5),
            normal: Estimate::UNKNOWN,
        };
        for (i, column) in self.columns.iter().enumerate() {
            let gear = i.checked_sub(CHANNEL_INDICATORS).map(|i| i / GEAR_INDICATORS);
            let moments = gear.and_then(|gear| channel.moments.get(gear));
            let revolutions = moments.map_or(0, |m| m.revolutions);
            let unit = column.unit.text(&channel.unit);
            let mut row = base(&column.place, column.name, unit, channel.means[i], revolutions);
            row.normal = normal(normals.iter().map(|h| h.means[i]));
            out.push(row);
            // The four that need a history stand behind the last of their gear.
            if let (true, Some(moments)) = (column.name == LAST_OF_GEAR.name(), moments) {
                let four = NAMES.iter().zip(moments.means);
                out.extend(four.map(|(name, mean)| base(&column.place, name, "1", mean, revolutions)));
            }
        }
    }
}

/// All windows of a recording, a channel each. `normalise` is asked for NA4, NB4, NA4*, NB4* of
/// each reading of a gear, in order.
fn channels<S: Source>(
    pipeline: &Pipeline,
    columns: usize,
    source: &mut S,
    normalise: Normalise<'_>,
) -> Result<Vec<Channel>, S::Error> {
    let gears = 2 * pipeline.train().stages.len();
    let mut out: Vec<Channel> = Vec::new();
    each_window::<S, S::Error>(pipeline, source, &mut |window, analysis| {
        let at = out.iter().position(|c| c.name == window.sensor).unwrap_or_else(|| {
            out.push(Channel::new(window, columns, gears));
            out.len() - 1
        });
        out[at].push(window, analysis, normalise);
        Ok(())
    })?;
    Ok(out)
}

/// What is collected of one channel of one recording.
#[derive(Debug)]
struct Channel {
    name: Arc<str>,
    unit: Arc<str>,
    means: Vec<Mean>,
    moments: Vec<Moments>,
    speed: Mean,
    windows: u64,
    refused: BTreeMap<&'static str, u64>,
}

impl Channel {
    fn new(window: &Window, columns: usize, gears: usize) -> Self {
        Self {
            name: window.sensor.clone(),
            unit: window.unit.clone(),
            means: vec![Mean::default(); columns],
            moments: vec![Moments::default(); gears],
            speed: Mean::default(),
            windows: 0,
            refused: BTreeMap::new(),
        }
    }

    fn push(&mut self, window: &Window, analysis: &WindowAnalysis, normalise: Normalise<'_>) {
        self.windows += 1;
        if analysis.instrument != InstrumentState::Ok {
            *self.refused.entry(analysis.instrument.code()).or_default() += 1;
            return;
        }
        self.speed.push(analysis.input_speed_hz);
        self.means.iter_mut().zip(analysis.indicators.row()).for_each(|(mean, x)| mean.push(x));
        for (gear, indicators) in analysis.indicators.gears.iter().flatten().enumerate() {
            let values = normalise(&window.sensor, gear, readings(indicators));
            let moments = &mut self.moments[gear];
            moments.means.iter_mut().zip(values).for_each(|(mean, x)| mean.push(x));
            moments.revolutions = moments.revolutions.max(indicators.revolutions);
        }
    }
}

/// Means of the four, and how many turns the averages had.
#[derive(Clone, Copy, Debug, Default)]
struct Moments {
    means: [Mean; 4],
    revolutions: u32,
}

/// Residual signal and envelope of a window.
fn readings(gear: &GearIndicators) -> [Reading; 2] {
    let of = |deviation, kurtosis| Reading { deviation: gear.get(deviation), kurtosis: gear.get(kurtosis) };
    [
        of(GearIndicator::ResidualRms, GearIndicator::ResidualKurtosis),
        of(GearIndicator::EnvelopeDeviation, GearIndicator::EnvelopeKurtosis),
    ]
}

/// One number.
#[derive(Clone, Debug)]
pub struct Row {
    /// Name of the recording.
    pub recording: String,
    /// The sensor.
    pub channel: String,
    /// A gear or a bearing's part; empty for the channel.
    pub place: String,
    /// Name of the indicator.
    pub indicator: String,
    /// What it is measured in.
    pub unit: String,
    /// Mean over windows.
    pub value: Estimate,
    /// How many windows.
    pub windows: u64,
    /// Turns in the average of a window; 0 for the channel.
    pub revolutions: u32,
    /// Speed of the input shaft (Hz).
    pub speed_hz: Estimate,
    /// Of the healthy recordings; unknown without.
    pub normal: Estimate,
}

impl Row {
    /// Difference from normal, in percent of normal, and its sigma.
    pub fn deviation_percent(&self) -> Estimate {
        let percent = 100.0 / self.normal.value.abs();
        let difference = self.value.value - self.normal.value;
        Estimate::new(percent * difference, percent * self.value.sigma.hypot(self.normal.sigma))
    }

    /// Difference from normal in standard errors.
    pub fn z(&self) -> f64 {
        (self.value.value - self.normal.value) / self.value.sigma.hypot(self.normal.sigma)
    }
}

/// A flat object; numbers that are not known are `null`.
impl Serialize for Row {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let deviation = self.deviation_percent();
        let mut out = serializer.serialize_struct("Row", 15)?;
        out.serialize_field("recording", &self.recording)?;
        out.serialize_field("channel", &self.channel)?;
        out.serialize_field("place", &self.place)?;
        out.serialize_field("indicator", &self.indicator)?;
        out.serialize_field("unit", &self.unit)?;
        out.serialize_field("value", &published(self.value.value))?;
        out.serialize_field("sigma", &published(self.value.sigma))?;
        out.serialize_field("windows", &self.windows)?;
        out.serialize_field("revolutions", &self.revolutions)?;
        out.serialize_field("input_speed_hz", &published(self.speed_hz.value))?;
        out.serialize_field("baseline", &published(self.normal.value))?;
        out.serialize_field("baseline_sigma", &published(self.normal.sigma))?;
        out.serialize_field("dev_percent", &published(deviation.value))?;
        out.serialize_field("dev_sigma_percent", &published(deviation.sigma))?;
        out.serialize_field("z", &published(self.z()))?;
        out.end()
    }
}

/// Mean of healthy recordings. Sigma: from the scatter between them where there are several, at
/// least what they state themselves; it is that of one further recording.
fn normal(recordings: impl Iterator<Item = Mean>) -> Estimate {
    let mut mean = Mean::default();
    let mut stated: f64 = 0.0;
    for recording in recordings {
        let estimate = recording.estimate(0.5);
        mean.push(estimate);
        stated = stated.max(estimate.sigma);
    }
    let Estimate { value, .. } = mean.estimate(1.0);
    let count = mean.count() as f64;
    let scatter = mean.scatter();
    let sigma = if scatter.is_finite() { scatter * (1.0 + 1.0 / count).sqrt() } else { 0.0 };
    Estimate::new(value, sigma.max(stated))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three healthy recordings of 1, 2 and 3: a further one scatters by `1 · sqrt(1 + 1/3)`
    /// about 2.
    #[test]
    fn analytic_scatter_of_a_further_recording() {
        let one = |value: f64| {
            let mut mean = Mean::default();
            mean.push(Estimate::new(value, 1e-6));
            mean
        };
        let found = normal([1.0, 2.0, 3.0].map(one).into_iter());
        assert!((found.value - 2.0).abs() < 1e-12);
        assert!((found.sigma - (4.0f64 / 3.0).sqrt()).abs() < 1e-12);
    }
}
