//! The one pipeline: daemon, command line and tests push the same packets into it and get the same
//! results.
//!
//! ```text
//! Assembler (ordered, one thread) ─► Window ─► analyse (any thread, one WorkerState each) ─► WindowAnalysis ─► judge ─► Verdict
//! ```
//!
//! [`Pipeline`] is immutable and shared. [`Pipeline::analyse`] depends on the window alone, so that
//! results are the same for any number of workers; after the first window of each sample rate it
//! does not allocate.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::analysis::{SpeedOrigin, StageAnalysis, WindowAnalysis};
use crate::assemble::Assembler;
use crate::baseline::Baseline;
use crate::bench::{Bearing, Bench, Gearing};
use crate::estimate::Estimate;
use crate::health::instrument_state;
use crate::indicators::plan::{IndicatorState, Known};
use crate::judge::{Judge, JudgeConfig, JudgeError};
use crate::rank::RankConfig;
use crate::signature::{SignatureTable, Signatures};
use crate::spectral::angle::AngleTrack;
use crate::spectral::harmonics::KnownAngle;
use crate::spectral::plan::{RatePlan, RateState};
use crate::spectral::pulses_fit::{PulseFitState, fit_pulses};
use crate::speed::{SpeedConfig, SpeedMethod};
use crate::state::StateConfig;
use crate::train::Train;
use crate::verdict::{InstrumentState, Verdict};
use crate::window::{Window, WindowConfig};

/// Everything that a user may choose about the signal path.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PipelineConfig {
    /// Length and hop.
    pub window: WindowConfig,
    /// How the shaft speed is found.
    pub speed: SpeedConfig,
    /// Steps between the ranks.
    pub rank: RankConfig,
    /// How sure the machine's state must be.
    pub state: StateConfig,
    /// Share of the sample rate up to which lines are believed (0–0.5). Anti-aliasing filters begin
    /// at 0.39 of the sample rate in most instruments; what lies above 0.45 is filtered in all of
    /// them.
    pub usable_band: f64,
    /// A window whose mean lies more standard deviations from zero than this has a wrong bias (>
    /// 0). To be raised for sensors that measure gravity too.
    pub largest_offset: f64,
    /// Condition indicators beside the lines.
    pub indicators: bool,
    /// Those of gears and bearings come in windows whose number is a multiple of it (≥ 1): they
    /// cost three times what the lines do, those of the channel an eighth.
    pub gear_indicators_every: u64,
}

impl Default for PipelineConfig {
    fn default() -> Self {
        Self {
            window: WindowConfig::default(),
            speed: SpeedConfig::default(),
            rank: RankConfig::default(),
            state: StateConfig::default(),
            usable_band: 0.45,
            largest_offset: 10.0,
            indicators: true,
            gear_indicators_every: 10,
        }
    }
}

/// The angle of a window: where it is from, how many revolutions at the mean speed, and how well
/// that is known (rev²).
struct Found {
    origin: SpeedOrigin,
    revolutions: f64,
    revolutions_variance: f64,
    angle_variance: f64,
}

/// Mean of `τ²` over a window without weighting, which the efficient window comes near to.
const MEAN_TAU2: f64 = 1.0 / 12.0;

/// Why there is no pipeline for a bench and a configuration.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PipelineError {
    /// Values of the bench file that no pipeline can work with.
    #[error("the bench file cannot be used: {}", .0.join("; "))]
    Bench(Vec<String>),
    /// Values of the configuration that are out of range.
    #[error("the configuration cannot be used: {}", .0.join("; "))]
    Config(Vec<String>),
    /// The baseline is not of this bench.
    #[error(transparent)]
    Judge(#[from] JudgeError),
}

/// The immutable plan. `Send + Sync`: share it by `Arc`.
#[derive(Clone, Debug)]
pub struct Pipeline {
    bench: Bench,
    train: Train,
    config: PipelineConfig,
    judge: Judge,
    /// Orders of the input shaft, a bearing a row.
    bearing_orders: Vec<[f64; 4]>,
}

/// Scratch of one worker: transforms and buffers for each sample rate that it has seen.
#[derive(Default)]
pub struct WorkerState {
    rates: Vec<(RatePlan, RateState)>,
    track: AngleTrack,
    pulses: PulseFitState,
    indicators: IndicatorState,
}

impl WorkerState {
    /// Sample rates and lengths of windows that it has plans for.
    pub fn rates(&self) -> usize {
        self.rates.len()
    }
}

impl Pipeline {
    /// The plan for a bench. Without a baseline every rank is unknown.
    ///
    /// # Errors
    /// Values of bench or configuration that are out of range, all of them, each in a sentence; a
    /// baseline of another bench.
    pub fn new(bench: &Bench, config: &PipelineConfig, baseline: Option<Baseline>) -> Result<Self, PipelineError> {
        let problems = bench.problems();
        if !problems.is_empty() {
            return Err(PipelineError::Bench(problems));
        }
        let mut problems = config.window.problems();
        problems.extend(config.speed.problems());
        if !(config.usable_band > 0.0 && config.usable_band <= 0.5) {
            problems.push(format!("usable_band is {}; it must be above 0 and at most 0.5", config.usable_band));
        }
        if config.largest_offset.is_nan() || config.largest_offset <= 0.0 {
            problems.push(format!("largest_offset is {}; it must be above 0", config.largest_offset));
        }
        if config.gear_indicators_every == 0 {
            problems.push(
                "gear_indicators_every is 0; expected 1 or more (indicators = false switches them off)".to_owned(),
            );
        }
        if !problems.is_empty() {
            return Err(PipelineError::Config(problems));
        }
        let stages = bench.stages.iter().map(|s| s.name.clone()).collect();
        let judging = JudgeConfig { rank: config.rank, state: config.state };
        let mut judge = Judge::new(judging, stages, baseline.as_ref(), SignatureTable::paper())?;
        judge.leave_states(bench.stages.iter().map(|stage| stage.gearing != Gearing::default()).collect());
        let train = Train::new(bench);
        let of_bearing = |bearing: &Bearing| {
            let shaft = train.shaft_order(&bearing.shaft).unwrap_or(f64::NAN);
            bearing.orders().map_or([f64::NAN; 4], |orders| orders.all().map(|order| order * shaft))
        };
        let bearing_orders = bench.bearings.iter().map(of_bearing).collect();
        Ok(Self { bench: bench.clone(), train, config: config.clone(), judge, bearing_orders })
    }

    /// Compares with these states in place of the paper's.
    #[must_use]
    pub fn with_signatures(mut self, signatures: Signatures) -> Self {
        self.judge.set_signatures(signatures);
        self
    }

    /// The same with doubts of its own, which all verdicts carry: words of findings with a space
    /// between.
    #[must_use]
    pub fn with_doubts(mut self, words: &str) -> Self {
        self.judge.doubt_anew();
        self.judge.doubts().set(words);
        self
    }

    /// The bench that the plan was made for.
    pub fn bench(&self) -> &Bench {
        &self.bench
    }

    /// Kinematics of the bench.
    pub fn train(&self) -> &Train {
        &self.train
    }

    /// The configuration that the plan was made from.
    pub fn config(&self) -> &PipelineConfig {
        &self.config
    }

    /// The ordered state: one for a source.
    pub fn assembler(&self) -> Assembler {
        let mut shafts = self.train.shafts.clone();
        shafts.push(("motor".to_owned(), self.train.motor_order));
        Assembler::new(&self.config.window, &shafts, self.bench.tacho.as_ref().map(|t| t.shaft.as_str()))
    }

    /// Scratch: one for a worker.
    pub fn worker(&self) -> WorkerState {
        WorkerState::default()
    }

    /// Analyses a window. Pure: the result depends on the window alone. Does not allocate once
    /// `state` and `out` have seen a window of this sample rate, length and (for indicators, in
    /// steps of 2 %) speed.
    pub fn analyse(&self, state: &mut WorkerState, window: &Window, out: &mut WindowAnalysis) {
        out.channel = window.channel;
        out.sensor.clone_from(&window.sensor);
        out.unit.clone_from(&window.unit);
        out.window = window.number;
        out.t0 = window.t0;
        out.first_sample_index = window.first_sample_index;
        out.samples = window.samples.len() as u32;
        out.sample_rate_hz = window.sample_rate_hz;
        out.operating_point = window.operating_point;
        out.input_speed_hz = Estimate::UNKNOWN;
        out.ramp_percent = f64::NAN;
        out.speed_origin = SpeedOrigin::MeshLines;
        out.stages.resize(self.train.stages.len(), StageAnalysis::UNKNOWN);
        out.stages.fill(StageAnalysis::UNKNOWN);
        // Without stages where they are switched off: then verdicts have none.
        let stages = if self.config.indicators { self.train.stages.len() } else { 0 };
        out.indicators.clear(stages, self.bearing_orders.len());
        out.instrument = instrument_state(window, self.config.largest_offset);
        if !matches!(out.instrument, InstrumentState::NotFinite | InstrumentState::ChannelDead) {
            self.analyse_lines(state, window, out);
        }
    }

    /// Compares an analysis with the baseline: one verdict a stage, in order. Pure. Verdicts
    /// already in `out` are overwritten.
    pub fn judge(&self, analysis: &WindowAnalysis, out: &mut Vec<Verdict>) {
        self.judge.judge(analysis, out);
    }

    /// The judge itself, which also judges averages over many windows.
    pub fn judging(&self) -> &Judge {
        &self.judge
    }

    fn analyse_lines(&self, state: &mut WorkerState, window: &Window, out: &mut WindowAnalysis) {
        let n = window.samples.len();
        let rate = window.sample_rate_hz;
        let known = state.rates.iter().position(|(plan, _)| plan.fits(n, rate));
        let at = known.unwrap_or_else(|| {
            let plan = RatePlan::new(&self.train, &self.config.speed, n, rate);
            let buffers = plan.state();
            state.rates.push((plan, buffers));
            state.rates.len() - 1
        });
        let WorkerState { rates, track, pulses, indicators } = state;
        let Some((plan, buffers)) = rates.get_mut(at) else { return };
        let length_s = n as f64 / rate;
        let motor_hz = window.operating_point.motor_speed_hz;
        let start_hz = if motor_hz.is_finite() && motor_hz > 0.0 {
            motor_hz / self.train.motor_order
        } else {
            self.train.nominal_input_hz
        };
        let highest_bin = self.config.usable_band * n as f64;
        plan.transform(&window.samples, buffers);
        if self.config.indicators {
            let known =
                Known { unit: &window.unit, spectrum: plan.weighted(buffers), usable_band: self.config.usable_band };
            indicators.channel(&window.samples, &known, &mut out.indicators);
        }

        let method = self.config.speed.method;
        let mut found = None;
        if matches!(method, SpeedMethod::Auto | SpeedMethod::Tacho) {
            found = fit_pulses(pulses, &window.pulses, length_s, track).map(|fit| Found {
                origin: SpeedOrigin::Tacho,
                revolutions: track.revolutions(),
                revolutions_variance: fit.revolutions_variance,
                angle_variance: fit.angle_variance,
            });
        }
        if method == SpeedMethod::Given {
            let revolutions = start_hz * length_s;
            track.set_polynomial(&[revolutions]);
            let sigma = self.config.speed.given_sigma_percent * 1e-2 * revolutions;
            found = Some(Found {
                origin: SpeedOrigin::Given,
                revolutions,
                revolutions_variance: sigma * sigma,
                angle_variance: sigma * sigma * MEAN_TAU2,
            });
        }
        if found.is_none() && method != SpeedMethod::Tacho {
            found = plan.mesh_speed(buffers, &window.samples, start_hz * length_s, highest_bin).map(|mesh| {
                track.set_polynomial(&mesh.coefficients);
                Found {
                    origin: SpeedOrigin::MeshLines,
                    revolutions: mesh.revolutions,
                    revolutions_variance: mesh.revolutions_variance,
                    angle_variance: mesh.angle_variance,
                }
            });
        }
        let Some(found) = found else {
            if out.instrument == InstrumentState::Ok {
                let in_band = plan.some_harmonic_in_band(start_hz * length_s, highest_bin);
                out.instrument = if in_band { InstrumentState::NoSpeed } else { InstrumentState::OutOfBand };
            }
            return;
        };
        out.speed_origin = found.origin;
        out.input_speed_hz = Estimate::new(found.revolutions / length_s, found.revolutions_variance.sqrt() / length_s);
        out.ramp_percent = 100.0 * track.ramp();
        if out.instrument == InstrumentState::Ok && plan.is_hum(buffers, &self.train, found.revolutions) {
            out.instrument = InstrumentState::MainsHum;
        }
        if self.config.indicators && window.number.is_multiple_of(self.config.gear_indicators_every) {
            indicators.gears(&self.train, &window.samples, track, &mut out.indicators);
            if let Some(band) = self.bench.indicators.envelope_hz.filter(|_| !self.bearing_orders.is_empty()) {
                let orders = &self.bearing_orders;
                indicators.bearings(&window.samples, rate, band, orders, track, &mut out.indicators);
            }
        }
        let angle = KnownAngle { track, variance: found.angle_variance };
        plan.lines(buffers, &self.train, angle, highest_bin, &mut out.stages);
        // One speed for all that is published: the mean from end to end differs from the efficient
        // estimate by the bend, which is noise.
        for (stage, kinematics) in out.stages.iter_mut().zip(&self.train.stages) {
            stage.mesh_hz = kinematics.mesh_order * out.input_speed_hz.value;
        }
        let seen = out.stages.iter().flat_map(|s| &s.harmonics).any(|l| l.amplitude.is_known());
        if !seen && out.instrument == InstrumentState::Ok {
            out.instrument = InstrumentState::OutOfBand;
        }
    }
}
