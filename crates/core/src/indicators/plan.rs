//! All indicators of a window: plans by speed, buffers, and the row of steps.

#![allow(clippy::needless_range_loop, reason = "a lane is the same place of several arrays")]

use rustfft::FftPlanner;

use realfft::RealFftPlanner;

use crate::indicators::envelope::EnvelopeState;
use crate::indicators::gear::{GearState, ShaftPlan};
use crate::indicators::grid::{FEWEST_REVOLUTIONS, groups};
use crate::indicators::moments::moments;
use crate::indicators::resample::{Positions, Resampler};
use crate::indicators::velocity::{Weighted, velocity};
use crate::indicators::{ChannelIndicator, Indicators, USABLE_SHARE};
use crate::spectral::angle::AngleTrack;
use crate::spectral::kernels::kernels;
use crate::train::Train;

/// Ratio between two steps of speed that have plans of their own is `e^0.02`: within a step the
/// points per sample move by 1 % at most.
const STEP: f64 = 0.02;

/// Plans that are kept, half a megabyte each: a steady machine has one or two, a run-up makes new
/// ones as it goes.
const MOST_PLANS: usize = 8;

/// One copy of the window for some shafts at a step of speed.
struct GroupPlan {
    order: f64,
    points: usize,
    shafts: Vec<(f64, usize, ShaftPlan)>,
}

/// What depends on samples in a window and on the speed.
struct SpeedPlan {
    samples: usize,
    step: i64,
    groups: Vec<GroupPlan>,
}

/// Plans for the speeds seen last, and buffers.
#[derive(Default)]
pub struct IndicatorState {
    resampler: Resampler,
    plans: Vec<SpeedPlan>,
    positions: Positions,
    points: Vec<f64>,
    average: Vec<f64>,
    gear: GearState,
    room: Vec<f64>,
    envelopes: Vec<EnvelopeState>,
}

kernels! {
    /// Adds one turn to the sum, and returns the sum of its squares.
    fn accumulate<'a>(_simd; turn: &'a [f64], sum: &'a mut [f64]) -> f64 {
        let mut squares = [0.0; 8];
        let (turns, rest) = turn.as_chunks::<8>();
        let (sums, rest_sums) = sum.as_chunks_mut::<8>();
        for (x, s) in turns.iter().zip(sums) {
            for lane in 0..8 {
                s[lane] += x[lane];
                squares[lane] += x[lane] * x[lane];
            }
        }
        for (x, s) in rest.iter().zip(rest_sums) {
            *s += x;
            squares[0] += x * x;
        }
        squares.iter().sum()
    }
}

/// What is known of a window besides its samples.
pub struct Known<'a> {
    /// Unit of the samples.
    pub unit: &'a str,
    /// The transformed window.
    pub spectrum: Weighted<'a>,
    /// Share of the sample rate up to which lines are believed.
    pub usable_band: f64,
}

impl IndicatorState {
    /// What needs no shaft speed.
    pub fn channel(&mut self, samples: &[f64], known: &Known<'_>, out: &mut Indicators) {
        moments(samples, &mut out.channel);
        let highest_hz = known.usable_band * known.spectrum.sample_rate_hz;
        out.channel[ChannelIndicator::VelocityRms as usize] =
            velocity(&known.spectrum, known.unit, highest_hz, &mut self.room);
    }

    /// The envelope of a band at orders of the input shaft, a bearing a row.
    pub fn bearings(
        &mut self,
        samples: &[f64],
        sample_rate_hz: f64,
        band: [f64; 2],
        orders: &[[f64; 4]],
        track: &AngleTrack,
        out: &mut Indicators,
    ) {
        let known = self.envelopes.iter().position(|e| e.fits(samples.len()));
        let at = known.unwrap_or_else(|| {
            self.envelopes.push(EnvelopeState::new(samples.len()));
            self.envelopes.len() - 1
        });
        let envelope = &mut self.envelopes[at];
        envelope.transform(samples);
        if envelope.envelope(band, sample_rate_hz, track) {
            let revolutions = track.revolutions();
            for (out, orders) in out.bearings.iter_mut().zip(orders) {
                *out = orders.map(|order| envelope.line(order, revolutions));
            }
        }
    }

    /// What the time-synchronous averages tell, with the angle of the input shaft over the window.
    pub fn gears(&mut self, train: &Train, samples: &[f64], track: &AngleTrack, out: &mut Indicators) {
        let (start, span) = Resampler::span(samples.len(), track);
        let revolutions = track.revolutions();
        if !(revolutions.is_finite() && revolutions > 0.0 && span > 0.0) {
            return;
        }
        let step = (revolutions.ln() / STEP).round() as i64;
        let known = self.plans.iter().position(|p| p.samples == samples.len() && p.step == step);
        let at = known.unwrap_or_else(|| {
            let plan = SpeedPlan::new(train, samples.len(), step, &mut self.gear);
            // Room for the fastest window of the step, so that none of it allocates again.
            let turns = revolutions.max(((step as f64 + 0.5) * STEP).exp());
            for group in &plan.groups {
                let most = (turns * group.points as f64 * group.order) as usize + 2;
                self.points.reserve(most.saturating_sub(self.points.len()));
                let longest = group.shafts.iter().map(|s| s.1).max().unwrap_or(0);
                self.average.reserve(longest.saturating_sub(self.average.len()));
            }
            if self.plans.len() == MOST_PLANS {
                self.plans.remove(0);
            }
            self.plans.push(plan);
            self.plans.len() - 1
        });
        let Self { resampler, plans, positions, points, average, gear, .. } = self;
        let samples_per_turn = samples.len() as f64 / revolutions;
        for group in &plans[at].groups {
            let per_turn = group.points as f64 * group.order;
            let count = (span * per_turn).floor() as usize + 1;
            points.clear();
            points.resize(count, 0.0);
            if !resampler.fill(samples, track, start, per_turn, positions, points) {
                return;
            }
            for (order, length, plan) in &group.shafts {
                let turns = count / length;
                if (turns as f64) < FEWEST_REVOLUTIONS {
                    continue;
                }
                average.clear();
                average.resize(*length, 0.0);
                let squares: f64 = points.chunks_exact(*length).map(|turn| accumulate(turn, average)).sum();
                average.iter_mut().for_each(|x| *x /= turns as f64);
                let all = squares / (turns * length) as f64;
                let mean = average.iter().map(|x| x * x).sum::<f64>() / *length as f64;
                let variance = ((all - mean) / (turns - 1) as f64).max(0.0);
                let highest = (USABLE_SHARE * samples_per_turn / order) as usize;
                plan.process(gear, average, variance, turns as u32, highest, &mut out.gears);
            }
        }
    }
}

impl SpeedPlan {
    fn new(train: &Train, samples: usize, step: i64, state: &mut GearState) -> Self {
        let revolutions = (step as f64 * STEP).exp();
        let (mut real, mut complex) = (RealFftPlanner::new(), FftPlanner::new());
        let mut group_plan = |group: crate::indicators::grid::Group| {
            let shaft_plan = |&(shaft, points): &(usize, usize)| {
                let gears = train.gears_on(shaft).into_iter();
                let plan = ShaftPlan::new(points, gears, &mut real, &mut complex);
                plan.prepare(state);
                (train.shafts[shaft].1, points, plan)
            };
            let shafts = group.shafts.iter().map(shaft_plan).collect();
            GroupPlan { order: train.shafts[group.shaft].1, points: group.points, shafts }
        };
        let groups = groups(train, samples, revolutions).into_iter().map(&mut group_plan).collect();
        Self { samples, step, groups }
    }
}
