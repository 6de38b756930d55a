//! Averages over windows: what a whole recording says at each of its operating points.
//!
//! A rank that one window cannot resolve, because a healthy machine scatters by 5 to 10 % from second to second, a
//! whole recording may.

use crate::analysis::{Line, StageAnalysis, WindowAnalysis};
use crate::baseline::{BaselineConfig, Series, split};
use crate::block::OperatingPoint;
use crate::deviation::Observed;
use crate::estimate::Estimate;
use crate::verdict::{HARMONICS, InstrumentState};

/// Mean of the windows of one channel at one operating point.
#[derive(Clone, Debug, PartialEq)]
pub struct Average {
    /// The mean as if it were one window: amplitudes and floors are geometric means with the sigma of the mean, speed and
    /// torque are means, time and sample index are those of the first window. Sidebands are those of the first window.
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

/// Collects windows and averages them by channel and operating point.
#[derive(Clone, Debug)]
pub struct Aggregate {
    config: BaselineConfig,
    windows: Vec<WindowAnalysis>,
    refused: Vec<WindowAnalysis>,
}

impl Aggregate {
    /// Windows within the tolerances of `config` are averaged together.
    pub fn new(config: BaselineConfig) -> Self {
        Self { config, windows: Vec::new(), refused: Vec::new() }
    }

    /// Adds a window.
    pub fn push(&mut self, window: &WindowAnalysis) {
        let speed = window.input_speed_hz.value;
        let sound = window.instrument == InstrumentState::Ok && speed.is_finite() && speed > 0.0;
        if sound { self.windows.push(window.clone()) } else { self.refused.push(window.clone()) }
    }

    /// Windows left out because of the instrument, in order.
    pub fn refused(&self) -> &[WindowAnalysis] {
        &self.refused
    }

    /// The averages, by channel, torque and speed.
    pub fn finish(mut self) -> Vec<Average> {
        let config = self.config;
        let torque = |w: &WindowAnalysis| {
            Some(w.operating_point.brake_torque_nm).filter(|t| t.is_finite()).unwrap_or(f64::NEG_INFINITY)
        };
        let known = |w: &WindowAnalysis| Some(w.operating_point.brake_torque_nm).filter(|t| t.is_finite());
        let speed = |w: &WindowAnalysis| w.input_speed_hz.value;
        self.windows.sort_by(|a, b| a.channel.cmp(&b.channel).then(torque(a).total_cmp(&torque(b))));
        let together = |first: &WindowAnalysis, w: &WindowAnalysis| {
            first.channel == w.channel && config.torque_matches(known(first), known(w))
        };
        let mut out = Vec::new();
        for group in split(&mut self.windows, together) {
            group.sort_by(|a, b| speed(a).total_cmp(&speed(b)));
            for point in split(group, |first, w| config.speed_matches(speed(first), speed(w))) {
                point.sort_by_key(|w| w.first_sample_index);
                out.push(average(point));
            }
        }
        out
    }
}

/// Averages sound windows of one channel, at least one.
fn average(windows: &[WindowAnalysis]) -> Average {
    let first = &windows[0];
    let count = windows.len() as f64;
    let mean = |value: &dyn Fn(&WindowAnalysis) -> f64| windows.iter().map(value).sum::<f64>() / count;
    let stages = windows.iter().map(|w| w.stages.len()).min().unwrap_or(0);
    let speed = mean(&|w| w.input_speed_hz.value);
    let speed_sigma = mean(&|w| w.input_speed_hz.sigma.powi(2)).sqrt();
    let mut analysis = WindowAnalysis {
        // Overlapping windows share samples: no better than one of them is certain.
        input_speed_hz: Estimate::new(speed, speed_sigma),
        operating_point: OperatingPoint {
            brake_torque_nm: mean(&|w| w.operating_point.brake_torque_nm),
            motor_speed_hz: mean(&|w| w.operating_point.motor_speed_hz),
            temperature_c: mean(&|w| w.operating_point.temperature_c),
            ..first.operating_point
        },
        stages: first.stages[..stages].to_vec(),
        ..first.clone()
    };
    let mut observed = Vec::with_capacity(stages);
    for (index, stage) in analysis.stages.iter_mut().enumerate() {
        stage.mesh_hz = mean(&|w| w.stages[index].mesh_hz);
        observed.push(std::array::from_fn(|harmonic| average_line(windows, index, harmonic, stage)));
    }
    Average { analysis, windows: u32::try_from(windows.len()).unwrap_or(u32::MAX), observed }
}

/// Averages one line, writes its mean into `stage`, and says how it scatters.
fn average_line(
    windows: &[WindowAnalysis],
    index: usize,
    harmonic: usize,
    stage: &mut StageAnalysis,
) -> (Option<Observed>, Option<Observed>) {
    let length = u64::from(windows[0].samples);
    let series = |value: &dyn Fn(&Line) -> f64| {
        let values = windows.iter().map(|w| (w.first_sample_index, value(&w.stages[index].harmonics[harmonic])));
        Series::of(values.filter(|(_, v)| *v > 0.0 && v.is_finite()).map(|(start, v)| (start, v.ln())), length)
    };
    let line = series(&|line| if line.amplitude.is_known() { line.amplitude.value } else { f64::NAN });
    let floor = series(&|line| line.floor);
    let target = &mut stage.harmonics[harmonic];
    target.phase_rad = f64::NAN;
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
