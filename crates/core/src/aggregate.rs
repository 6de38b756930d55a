//! Averages over windows: what a whole recording says at each of its operating points.
//!
//! A rank that one window cannot resolve, because a healthy machine scatters by 5 to 10 % from
//! second to second, a whole recording may.
//!
//! Of each window a few numbers are kept, and of each channel at most [`MOST_WINDOWS`] windows:
//! beyond that every second one goes, then every second one of those that are left, and so on,
//! evenly over the recording. So memory is bounded, whatever the length of a recording.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::analysis::{Line, Sidebands, SpeedOrigin, StageAnalysis, WindowAnalysis};
use crate::baseline::{BaselineConfig, Series, split};
use crate::block::{OperatingPoint, UnixNanos};
use crate::deviation::Observed;
use crate::estimate::Estimate;
use crate::indicators::Indicators;
use crate::verdict::{HARMONICS, InstrumentState};

/// Windows of a channel that are kept: 2.3 h of windows every half second.
pub const MOST_WINDOWS: usize = 16_384;

/// Mean of the windows of one channel at one operating point.
#[derive(Clone, Debug, PartialEq)]
pub struct Average {
    /// The mean as if it were one window: amplitudes and floors are geometric means with the sigma
    /// of the mean, speed and torque are means, time and sample index are those of the first
    /// window. Sidebands are not averaged.
    pub analysis: WindowAnalysis,
    /// Windows averaged.
    pub windows: u32,
    /// By stage and harmonic: line and floor.
    observed: Vec<[(Option<Observed>, Option<Observed>); HARMONICS]>,
}

impl Average {
    /// What was measured of a line and of the floor beside it.
    pub fn observed(&self, stage: usize, harmonic: usize) -> (Option<Observed>, Option<Observed>) {
        self.observed.get(stage).map_or((None, None), |stage| stage[harmonic])
    }
}

/// Why windows were left out, by sensor: `no_speed`, or the code of the instrument's state.
pub type Refused = BTreeMap<(Arc<str>, &'static str), u64>;

/// Collects windows and averages them by channel and operating point.
#[derive(Clone, Debug)]
pub struct Aggregate {
    config: BaselineConfig,
    channels: Vec<Channel>,
    refused: Refused,
}

/// What is kept of a channel.
#[derive(Clone, Debug)]
struct Channel {
    /// A window without its stages: what all windows of the channel share.
    template: WindowAnalysis,
    windows: Vec<Kept>,
    /// Windows whose number is a multiple of it are kept.
    stride: u64,
    /// Sound windows, kept or not.
    offered: u64,
}

/// What is kept of a window.
#[derive(Clone, Debug)]
struct Kept {
    window: u64,
    t0: UnixNanos,
    first_sample_index: u64,
    input_speed_hz: Estimate,
    ramp_percent: f64,
    speed_origin: SpeedOrigin,
    operating_point: OperatingPoint,
    stages: Box<[KeptStage]>,
}

#[derive(Clone, Copy, Debug)]
struct KeptStage {
    mesh_hz: f64,
    amplitudes: [Estimate; HARMONICS],
    floors: [f64; HARMONICS],
    shared: [bool; HARMONICS],
}

impl From<&WindowAnalysis> for Kept {
    fn from(window: &WindowAnalysis) -> Self {
        let stage = |stage: &StageAnalysis| KeptStage {
            mesh_hz: stage.mesh_hz,
            amplitudes: stage.harmonics.map(|line| line.amplitude),
            floors: stage.harmonics.map(|line| line.floor),
            shared: stage.shared,
        };
        Self {
            window: window.window,
            t0: window.t0,
            first_sample_index: window.first_sample_index,
            input_speed_hz: window.input_speed_hz,
            ramp_percent: window.ramp_percent,
            speed_origin: window.speed_origin,
            operating_point: window.operating_point,
            stages: window.stages.iter().map(stage).collect(),
        }
    }
}

impl Kept {
    fn known_torque(&self) -> Option<f64> {
        Some(self.operating_point.brake_torque_nm).filter(|torque| torque.is_finite())
    }
}

impl Channel {
    fn push(&mut self, window: &WindowAnalysis) {
        self.offered += 1;
        if !window.window.is_multiple_of(self.stride) {
            return;
        }
        if self.windows.len() == MOST_WINDOWS {
            self.stride *= 2;
            let stride = self.stride;
            self.windows.retain(|kept| kept.window.is_multiple_of(stride));
            if !window.window.is_multiple_of(stride) {
                return;
            }
        }
        self.windows.push(Kept::from(window));
    }

    fn averages(mut self, config: &BaselineConfig, out: &mut Vec<Average>) {
        let torque = |kept: &Kept| kept.known_torque().unwrap_or(f64::NEG_INFINITY);
        let speed = |kept: &Kept| kept.input_speed_hz.value;
        self.windows.sort_by(|a, b| torque(a).total_cmp(&torque(b)));
        let together = |first: &Kept, kept: &Kept| config.torque_matches(first.known_torque(), kept.known_torque());
        for group in split(&mut self.windows, together) {
            group.sort_by(|a, b| speed(a).total_cmp(&speed(b)));
            for point in split(group, |first, kept| config.speed_matches(speed(first), speed(kept))) {
                point.sort_by_key(|kept| kept.first_sample_index);
                out.push(average(&self.template, point));
            }
        }
    }
}

impl Aggregate {
    /// Windows within the tolerances of `config` are averaged together.
    pub fn new(config: BaselineConfig) -> Self {
        Self { config, channels: Vec::new(), refused: Refused::new() }
    }

    /// Adds a window.
    pub fn push(&mut self, window: &WindowAnalysis) {
        let speed = window.input_speed_hz.value;
        let sound = window.instrument == InstrumentState::Ok;
        if !(sound && speed.is_finite() && speed > 0.0) {
            // A window that is sound but for its speed has no other reason to be left out.
            let why = if sound { "no_speed" } else { window.instrument.code() };
            *self.refused.entry((window.sensor.clone(), why)).or_default() += 1;
            return;
        }
        let same = |channel: &Channel| {
            // A channel whose windows change their length or unit is another one.
            let kept = &channel.template;
            kept.channel == window.channel && kept.samples == window.samples && kept.unit == window.unit
        };
        let at = self.channels.iter().position(same).unwrap_or_else(|| {
            let template = WindowAnalysis { stages: Vec::new(), indicators: Indicators::unknown(0), ..window.clone() };
            self.channels.push(Channel { template, windows: Vec::new(), stride: 1, offered: 0 });
            self.channels.len() - 1
        });
        self.channels[at].push(window);
    }

    /// Windows left out because of the instrument, or because their speed is not known.
    pub fn refused(&self) -> &Refused {
        &self.refused
    }

    /// Sensors of whose windows only every so many-th is averaged, since there are too many, and
    /// how many of how many those are.
    pub fn thinned(&self) -> impl Iterator<Item = (&str, u64, usize, u64)> {
        let thinned = self.channels.iter().filter(|channel| channel.stride > 1);
        thinned.map(|channel| (&*channel.template.sensor, channel.stride, channel.windows.len(), channel.offered))
    }

    /// The averages, by channel, torque and speed.
    pub fn finish(mut self) -> Vec<Average> {
        self.channels.sort_by_key(|channel| (channel.template.channel, channel.template.samples));
        let mut out = Vec::new();
        for channel in self.channels {
            channel.averages(&self.config, &mut out);
        }
        out
    }
}

/// Averages sound windows of one channel, at least one.
fn average(template: &WindowAnalysis, windows: &[Kept]) -> Average {
    let first = &windows[0];
    let count = windows.len() as f64;
    let mean = |value: &dyn Fn(&Kept) -> f64| windows.iter().map(value).sum::<f64>() / count;
    let stages = windows.iter().map(|w| w.stages.len()).min().unwrap_or(0);
    let speed = mean(&|w| w.input_speed_hz.value);
    let speed_sigma = mean(&|w| w.input_speed_hz.sigma.powi(2)).sqrt();
    let stage = |kept: &KeptStage| StageAnalysis {
        mesh_hz: kept.mesh_hz,
        harmonics: std::array::from_fn(|harmonic| Line {
            amplitude: kept.amplitudes[harmonic],
            phase_rad: f64::NAN,
            floor: kept.floors[harmonic],
        }),
        pinion_sidebands: [Sidebands::UNKNOWN; HARMONICS],
        wheel_sidebands: [Sidebands::UNKNOWN; HARMONICS],
        shared: kept.shared,
    };
    let mut analysis = WindowAnalysis {
        window: first.window,
        t0: first.t0,
        first_sample_index: first.first_sample_index,
        ramp_percent: first.ramp_percent,
        speed_origin: first.speed_origin,
        // Overlapping windows share samples: no better than one of them is certain.
        input_speed_hz: Estimate::new(speed, speed_sigma),
        operating_point: OperatingPoint {
            brake_torque_nm: mean(&|w| w.operating_point.brake_torque_nm),
            motor_speed_hz: mean(&|w| w.operating_point.motor_speed_hz),
            temperature_c: mean(&|w| w.operating_point.temperature_c),
            ..first.operating_point
        },
        stages: first.stages[..stages].iter().map(stage).collect(),
        ..template.clone()
    };
    let mut observed = Vec::with_capacity(stages);
    for (index, stage) in analysis.stages.iter_mut().enumerate() {
        stage.mesh_hz = mean(&|w| w.stages[index].mesh_hz);
        let length = u64::from(template.samples);
        observed.push(std::array::from_fn(|harmonic| average_line(windows, length, (index, harmonic), stage)));
    }
    Average { analysis, windows: u32::try_from(windows.len()).unwrap_or(u32::MAX), observed }
}

/// Averages one line, writes its mean into `stage`, and says how it scatters.
fn average_line(
    windows: &[Kept],
    length: u64,
    (index, harmonic): (usize, usize),
    stage: &mut StageAnalysis,
) -> (Option<Observed>, Option<Observed>) {
    let series = |value: &dyn Fn(&KeptStage) -> f64| {
        let values = windows.iter().map(|w| (w.first_sample_index, value(&w.stages[index])));
        Series::of(values.filter(|(_, v)| *v > 0.0 && v.is_finite()).map(|(start, v)| (start, v.ln())), length)
    };
    let known = |amplitude: Estimate| if amplitude.is_known() { amplitude.value } else { f64::NAN };
    let line = series(&|stage| known(stage.amplitudes[harmonic]));
    let floor = series(&|stage| stage.floors[harmonic]);
    let target = &mut stage.harmonics[harmonic];
    let observed = |series: &Series| Observed::Average {
        ln: series.location.mean,
        scatter_variance: series.location.scatter.powi(2),
        effective: series.effective,
    };
    match &line {
        Some(line) => {
            let amplitude = line.location.mean.exp();
            let sigma = amplitude * line.location.scatter / line.effective.sqrt();
            target.amplitude = Estimate::new(amplitude, sigma);
        }
        // One window is no average: it is judged as the window it is.
        None if windows.len() == 1 && target.amplitude.is_known() && target.amplitude.value > 0.0 => {
            let noise = target.amplitude.sigma / target.amplitude.value;
            let floor = (target.floor > 0.0).then(|| Observed::Window { ln: target.floor.ln(), noise: 0.0 });
            return (Some(Observed::Window { ln: target.amplitude.value.ln(), noise }), floor);
        }
        None => target.amplitude = Estimate::UNKNOWN,
    }
    if let Some(floor) = &floor {
        target.floor = floor.location.mean.exp();
    }
    (line.as_ref().map(observed), floor.as_ref().map(observed))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn window(number: u64, amplitude: f64) -> WindowAnalysis {
        let mut stage = StageAnalysis::UNKNOWN;
        stage.harmonics[0].amplitude = Estimate::new(amplitude, 0.01 * amplitude);
        WindowAnalysis {
            window: number,
            first_sample_index: number * 1000,
            samples: 1000,
            input_speed_hz: Estimate::new(10.0, 1e-4),
            stages: vec![stage],
            ..WindowAnalysis::empty()
        }
    }

    /// Twenty times as many windows as are kept: what is kept lies evenly over the recording, so
    /// that a drift from 1 to 2 has the geometric mean that all windows have,
    /// `exp(∫ ln(1+x) dx) = 4/e`.
    #[test]
    fn analytic_long_recordings_are_thinned_evenly() {
        let count = 20 * MOST_WINDOWS as u64;
        let mut aggregate = Aggregate::new(BaselineConfig::default());
        for number in 0..count {
            aggregate.push(&window(number, 1.0 + number as f64 / count as f64));
            assert!(aggregate.channels[0].windows.len() <= MOST_WINDOWS);
        }
        let (_, stride, kept, offered) = aggregate.thinned().next().unwrap();
        assert_eq!((stride, kept, offered), (32, 20 * MOST_WINDOWS / 32, count));
        let averages = aggregate.finish();
        assert_eq!(averages.len(), 1);
        assert_eq!(averages[0].windows as usize, kept);
        let mean = averages[0].analysis.stages[0].harmonics[0].amplitude.value;
        assert!((mean / (4.0 / std::f64::consts::E) - 1.0).abs() < 1e-3, "{mean}");
    }

    /// Short recordings keep every window, and what is left out is counted by its reason.
    #[test]
    fn conform_what_is_left_out_is_counted() {
        let mut aggregate = Aggregate::new(BaselineConfig::default());
        for number in 0..9 {
            let mut window = window(number, 1.0);
            match number {
                3 => window.input_speed_hz = Estimate::UNKNOWN,
                5 | 6 => window.instrument = InstrumentState::Overload,
                _ => {}
            }
            aggregate.push(&window);
        }
        let refused: Vec<_> = aggregate.refused().iter().map(|((_, why), &count)| (*why, count)).collect();
        assert_eq!(refused, [("no_speed", 1), (InstrumentState::Overload.code(), 2)]);
        assert_eq!(aggregate.thinned().count(), 0);
        assert_eq!(aggregate.finish()[0].windows, 6);
    }
}
