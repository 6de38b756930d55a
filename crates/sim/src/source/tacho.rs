//! The tacho: edges by the true angle of its shaft, with jitter.

use std::f64::consts::TAU;
use std::sync::Arc;

use gearwatch_core::bench::{Bench, Tacho};
use gearwatch_core::train::Train;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::Simulator;
use crate::model::TrainModel;

/// Edges that were seen and not yet handed over.
pub(super) struct TachoState {
    pub(super) shaft: Arc<str>,
    /// Pulses per rad of the first shaft.
    per_rad: f64,
    /// Pulses per rad of its own shaft.
    pulses_per_rad: f64,
    pub(super) pulses_per_rev: f64,
    random: ChaCha8Rng,
    /// Coordinate of the shaft's angle.
    angle: usize,
    /// Its last known deviation (rad).
    deviation: f64,
    /// Model time (s) and pulse count of the last sample, where it was near an edge.
    previous: Option<(f64, f64)>,
    /// Recording times of edges not yet handed over (s).
    pub(super) edges: std::collections::VecDeque<f64>,
}

impl TachoState {
    pub(super) fn new(tacho: &Tacho, bench: &Bench, model: &TrainModel, seed: u64) -> Self {
        let order = Train::new(bench).shaft_order(&tacho.shaft).unwrap_or(1.0);
        let angle = match bench.shafts.iter().position(|s| s.name == tacho.shaft) {
            Some(i) => model.linear.shaft_angles[i].0,
            None => model.linear.motor_angle,
        };
        Self {
            shaft: tacho.shaft.as_str().into(),
            per_rad: order * tacho.pulses_per_rev / TAU,
            pulses_per_rad: tacho.pulses_per_rev / TAU,
            pulses_per_rev: tacho.pulses_per_rev,
            random: ChaCha8Rng::seed_from_u64(seed ^ 0x7ac0),
            angle,
            deviation: 0.0,
            previous: None,
            edges: std::collections::VecDeque::new(),
        }
    }

    /// Notes the edges of the sample that ends at `t`; `deviation` gives that of a coordinate from
    /// the reference rotation.
    pub(super) fn watch(
        &mut self,
        t: f64,
        rate_hz: f64,
        jitter_s: f64,
        model: &TrainModel,
        deviation: impl FnOnce(usize) -> f64,
    ) {
        let (reference, omega, _) = model.rotation.at(t);
        let counted = self.per_rad * reference + self.pulses_per_rad * self.deviation;
        // The shaft's true angle is worked out only near an edge; it deviates slowly from the
        // reference.
        let near = 2.0 * self.per_rad * omega / rate_hz + 0.1 * self.pulses_per_rad;
        if counted.ceil() - counted >= near && counted - counted.floor() >= near {
            self.previous = None;
            return;
        }
        self.deviation = deviation(self.angle);
        let now = self.per_rad * reference + self.pulses_per_rad * self.deviation;
        if let Some((then, before)) = self.previous {
            let mut edge = before.floor() + 1.0;
            while edge <= now {
                let part = (edge - before) / (now - before);
                let jitter: f64 = StandardNormal.sample(&mut self.random);
                let time = then + part * (t - then) - Simulator::offset_s(rate_hz);
                self.edges.push_back(time + jitter_s * jitter);
                edge += 1.0;
            }
        }
        self.previous = Some((t, now));
    }
}
