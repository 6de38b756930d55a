//! The reference rotation: how the train turns as a rigid whole, before any vibration.

use std::f64::consts::TAU;

use gearwatch_core::train::Train;

use crate::setup::{Rate, SpeedFluctuation};

/// A quantity over time, linear between its points and held before the first and after the last.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// Times (s, ascending) and values.
    points: Vec<(f64, f64)>,
    /// Integral up to each point.
    integrals: Vec<f64>,
}

impl Profile {
    /// The same at any time.
    pub fn constant(value: f64) -> Self {
        Self { points: vec![(0.0, value)], integrals: vec![0.0] }
    }

    /// Through points (time in s, value). `None` where there is none, a time is not above the one
    /// before, or a number is not finite.
    pub fn through(points: &[(f64, f64)]) -> Option<Self> {
        let ascending = points.windows(2).all(|w| w[1].0 > w[0].0);
        let finite = points.iter().all(|&(t, v)| t.is_finite() && v.is_finite());
        if points.is_empty() || !ascending || !finite {
            return None;
        }
        let mut integrals = vec![0.0];
        let mut sum = 0.0;
        for w in points.windows(2) {
            sum += 0.5 * (w[0].1 + w[1].1) * (w[1].0 - w[0].0);
            integrals.push(sum);
        }
        Some(Self { points: points.to_vec(), integrals })
    }

    /// The same, later by some time (s).
    pub fn delayed(&self, by_s: f64) -> Self {
        let points = self.points.iter().map(|&(t, v)| (t + by_s, v)).collect();
        Self { points, integrals: self.integrals.clone() }
    }

    /// Value at a time (s).
    pub fn at(&self, t: f64) -> f64 {
        let (i, slope) = self.segment(t);
        self.points[i].1 + slope * (t - self.points[i].0)
    }

    /// Slope at a time, of the segment that begins there at a corner (1/s).
    pub fn slope(&self, t: f64) -> f64 {
        self.segment(t).1
    }

    /// Integral from the first point's time (s).
    #[inline(always)]
    pub fn integral(&self, t: f64) -> f64 {
        let (i, slope) = self.segment(t);
        let since = t - self.points[i].0;
        self.integrals[i] + since * (self.points[i].1 + 0.5 * slope * since)
    }

    /// The same at any time.
    pub fn is_constant(&self) -> bool {
        self.points.len() == 1
    }

    /// Smallest and largest value.
    pub fn range(&self) -> (f64, f64) {
        let values = self.points.iter().map(|&(_, v)| v);
        (values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max))
    }

    /// Time of the largest value (s), the first one, and not before 0.
    pub fn highest_at_s(&self) -> f64 {
        let highest = self.points.iter().copied().reduce(|a, b| if b.1 > a.1 { b } else { a });
        highest.map_or(0.0, |(t, _)| t.max(0.0))
    }

    #[inline(always)]
    fn segment(&self, t: f64) -> (usize, f64) {
        if self.points.len() == 1 {
            return (0, 0.0);
        }
        let i = self.points.partition_point(|&(time, _)| time <= t);
        match i {
            0 => (0, 0.0),
            i if i == self.points.len() => (i - 1, 0.0),
            i => {
                let (a, b) = (self.points[i - 1], self.points[i]);
                (i - 1, (b.1 - a.1) / (b.0 - a.0))
            }
        }
    }
}

/// Angle, speed and acceleration of the first shaft as the drive prescribes them.
///
/// # Formula
/// `ψ = ψ̄ + Σ d sin(o ψ̄)/o` for a fluctuation per revolution (`Ω = Ω̄ (1 + Σ d cos o ψ̄)`
/// exactly), and `ψ = ψ̄ + Σ d Ω̄/(2πf) sin 2πft` for one at a fixed frequency, with `ψ̄` from the
/// speed profile.
#[derive(Clone, Debug, PartialEq)]
pub struct Rotation {
    motor_hz: Profile,
    /// First shaft's rad per motor revolution.
    rad_per_rev: f64,
    /// Mean angle of the first shaft at t = 0 (rad).
    start_rad: f64,
    /// (order of the first shaft or 0, Hz or 0, depth)
    fluctuations: Vec<(f64, f64, f64)>,
}

impl Rotation {
    /// From the motor's speed profile (Hz), the kinematics, and belt creep (1).
    pub fn new(motor_hz: Profile, train: &Train, belt_creep: f64, fluctuations: &[SpeedFluctuation]) -> Self {
        let fluctuations = fluctuations
            .iter()
            .map(|f| match f.rate {
                Rate::Hertz(hz) => (0.0, hz, f.depth),
                Rate::PerRevolution { shaft, order } => {
                    (order * shaft.map_or(train.motor_order, |i| train.shafts[i].1), 0.0, f.depth)
                }
            })
            .collect();
        Self { motor_hz, rad_per_rev: TAU * (1.0 - belt_creep) / train.motor_order, start_rad: 0.0, fluctuations }
    }

    /// The same from another mean angle of the first shaft at t = 0 (rad).
    pub fn starting_at(self, start_rad: f64) -> Self {
        Self { start_rad, ..self }
    }

    /// Mean speed of the motor, fluctuations left out (Hz).
    pub fn motor_hz(&self, t: f64) -> f64 {
        self.motor_hz.at(t)
    }

    /// When the mean speed is highest (s).
    pub fn fastest_at_s(&self) -> f64 {
        self.motor_hz.highest_at_s()
    }

    /// Highest mean speed of the first shaft (rad/s).
    pub fn fastest_rad_per_s(&self) -> f64 {
        self.rad_per_rev * self.motor_hz.range().1
    }

    /// The speed never changes.
    pub fn is_uniform(&self) -> bool {
        self.motor_hz.is_constant() && self.fluctuations.is_empty()
    }

    /// Angle of the first shaft at a time (rad).
    #[inline(always)]
    pub fn angle(&self, t: f64) -> f64 {
        let mean = self.start_rad + self.rad_per_rev * self.motor_hz.integral(t);
        if self.fluctuations.is_empty() { mean } else { self.at(t).0 }
    }

    /// Angle (rad), speed (rad/s) and acceleration (rad/s²) of the first shaft at a time (s).
    pub fn at(&self, t: f64) -> (f64, f64, f64) {
        let mean = self.start_rad + self.rad_per_rev * self.motor_hz.integral(t);
        let speed = self.rad_per_rev * self.motor_hz.at(t);
        let acceleration = self.rad_per_rev * self.motor_hz.slope(t);
        let (mut angle, mut omega, mut alpha) = (mean, speed, acceleration);
        for &(order, hz, depth) in &self.fluctuations {
            if order > 0.0 {
                let (sin, cos) = (order * mean).sin_cos();
                angle += depth * sin / order;
                omega += depth * speed * cos;
                alpha += depth * (acceleration * cos - order * speed * speed * sin);
            } else {
                let w = TAU * hz;
                let (sin, cos) = (w * t).sin_cos();
                angle += depth * speed * sin / w;
                omega += depth * (speed * cos + acceleration * sin / w);
                alpha += depth * (2.0 * acceleration * cos - speed * w * sin);
            }
        }
        (angle, omega, alpha)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_bench;

    /// Speed and acceleration are the derivatives of the angle, in a run-up with both kinds of
    /// fluctuation.
    #[test]
    fn analytic_speed_is_the_derivative_of_the_angle() {
        let profile = Profile::through(&[(0.0, 10.0), (4.0, 30.0)]).unwrap();
        let fluctuations = [
            SpeedFluctuation { rate: Rate::PerRevolution { shaft: Some(1), order: 2.0 }, depth: 0.01 },
            SpeedFluctuation { rate: Rate::Hertz(3.0), depth: 0.02 },
        ];
        let rotation = Rotation::new(profile, &Train::new(&test_bench::two_stages()), 0.01, &fluctuations);
        let h = 1e-4;
        for t in [0.3, 1.7, 3.9] {
            let (a, b, c) = (rotation.at(t - h), rotation.at(t), rotation.at(t + h));
            // Central differences err by h²/6 of the third derivative: below 1e-5 here.
            assert!(((c.0 - a.0) / (2.0 * h) / b.1 - 1.0).abs() < 1e-5);
            assert!(((c.1 - a.1) / (2.0 * h) - b.2).abs() < 1e-5 * b.1 * 60.0, "{} {}", (c.1 - a.1) / (2.0 * h), b.2);
        }
    }
}
