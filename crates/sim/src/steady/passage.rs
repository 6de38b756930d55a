//! Lines that a sensor hears of planetary stages: every force that is passed on, in the frame of
//! its carrier, and the carrier's turning as sidebands.

use nalgebra::{Complex, DVector};

use super::response::{Input, Output, Response};
use super::solver::{Problem, Solution};
use crate::linear::{Heard, LinearTrain, Passage, Passed};

/// Sidebands of the planets' passing on either side that are taken; `e^{−κ} I_d(κ)` has fallen
/// below 1e-9 there up to κ = 3.
const SIDEBANDS: i32 = 16;
/// Places at which a period of the weight is sampled for its coefficients: exact beyond their
/// number.
const PLACES: u32 = 128;

/// What lines of the passage take from the linear train.
pub(super) struct PassageLines {
    passage: Passage,
    /// Per force its rows: x and y of a bearing, or the linear part of a mesh's force.
    rows: Vec<Vec<Output>>,
    /// Per housing coordinate.
    housing: Vec<Input>,
    /// Counter-clockwise turns of each stage's carrier per revolution of the first shaft.
    carriers: Vec<f64>,
    /// `e^{−κ} I_d(κ)`, from d = 0.
    weights: Vec<f64>,
}

impl PassageLines {
    /// Of a train whose meshes stand at their mean stiffness and damping in `meshes`.
    pub(super) fn new(linear: &LinearTrain, meshes: &[(f64, f64)], response: &Response, planet_pass: f64) -> Self {
        let passage = linear.passage.clone();
        let zero = || DVector::zeros(linear.names.len());
        let rows_of = |(_, passed): &(usize, Passed)| -> Vec<Output> {
            match *passed {
                Passed::Bearing { x, stiffness, damping } => [x, x + 1]
                    .map(|at| {
                        let (mut position, mut velocity) = (zero(), zero());
                        (position[at], velocity[at]) = (stiffness, damping);
                        response.output(&position, &velocity, None)
                    })
                    .into(),
                Passed::Ring { mesh, .. } => {
                    let (row, (stiffness, damping)) = (&linear.mesh[mesh], meshes[mesh]);
                    vec![response.output(&(row * stiffness), &(row * damping), None)]
                }
            }
        };
        let unit = |heard: &Heard| {
            let mut vector = zero();
            vector[heard.at] = 1.0;
            response.input(&vector)
        };
        let coefficient = |d: i32| {
            let at = |i: u32| {
                let x = std::f64::consts::TAU * f64::from(i) / f64::from(PLACES);
                (planet_pass * (x.cos() - 1.0)).exp() * (f64::from(d) * x).cos()
            };
            (0..PLACES).map(at).sum::<f64>() / f64::from(PLACES)
        };
        let turns = |carrier: &Option<(usize, f64)>| {
            carrier.map_or(0.0, |(mesh, per_cycle)| per_cycle * linear.meshes[mesh].order / std::f64::consts::TAU)
        };
        Self {
            rows: passage.forces.iter().map(rows_of).collect(),
            housing: passage.housing.iter().map(unit).collect(),
            carriers: passage.carriers.iter().map(turns).collect(),
            weights: (0..=SIDEBANDS).map(coefficient).collect(),
            passage,
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.passage.is_empty()
    }

    /// Adds the lines of a part at some orders to those of each sensor.
    pub(super) fn add(
        &self,
        (sign, problem, solution): (f64, &Problem, &Solution),
        (linear, response, sensors): (&LinearTrain, &Response, &[Output]),
        orders: &[f64],
        out: &mut [Vec<Complex<f64>>],
    ) {
        for (k, &order) in orders.iter().enumerate() {
            let omega = std::f64::consts::TAU * order * problem.revolutions / problem.period_s;
            let line = |heard: &Heard| self.heard(heard, problem, solution, (linear, response), order);
            for heard in &self.passage.sensors {
                out[heard.at][k] += sign * line(heard);
            }
            for (heard, input) in self.passage.housing.iter().zip(&self.housing) {
                let force = line(heard);
                if force != Complex::ZERO {
                    for (sensor, out) in sensors.iter().zip(out.iter_mut()) {
                        out[k] += sign * response.at(sensor, input, omega) * force;
                    }
                }
            }
        }
    }

    /// Amplitude of an order in what is heard.
    fn heard(
        &self,
        heard: &Heard,
        problem: &Problem,
        solution: &Solution,
        (linear, response): (&LinearTrain, &Response),
        order: f64,
    ) -> Complex<f64> {
        let mut sum = Complex::ZERO;
        for (f, &(stage, passed)) in self.passage.forces.iter().enumerate() {
            let gain = heard.gains[f];
            if gain == 0.0 {
                continue;
            }
            let carrier = self.carriers[stage];
            // Mean forces belong to the part that solves for the stage's own meshes.
            let own = problem.active.iter().any(|&mesh| linear.meshes[mesh].place.stage == stage);
            let of_row = |row: usize, d: i32| {
                let bin = (order - f64::from(d) * carrier) * problem.revolutions;
                self.force(problem, solution, response, (f, row), bin, own)
            };
            match passed {
                Passed::Bearing { .. } => {
                    for d in [-1, 1] {
                        let turned = Complex::from_polar(0.5 * gain, -f64::from(d) * heard.direction_rad);
                        let quadrature = Complex::new(0.0, f64::from(d));
                        sum += turned * (of_row(0, d) + quadrature * of_row(1, d));
                    }
                }
                Passed::Ring { position_rad, .. } => {
                    for d in -SIDEBANDS..=SIDEBANDS {
                        let weight = self.weights[d.unsigned_abs() as usize];
                        let angle = f64::from(d) * (position_rad - heard.direction_rad);
                        sum += Complex::from_polar(gain * weight, angle) * of_row(0, d);
                    }
                }
            }
        }
        sum
    }

    /// Amplitude of a bin of one row of a force; of a negative bin the conjugate, 0 between bins.
    fn force(
        &self,
        problem: &Problem,
        solution: &Solution,
        response: &Response,
        (f, row): (usize, usize),
        bin: f64,
        own: bool,
    ) -> Complex<f64> {
        let whole = bin.round();
        if (bin - whole).abs() > 1e-6 * bin.abs().max(1.0) || whole.abs() > (problem.samples / 2) as f64 {
            return Complex::ZERO;
        }
        let at = whole.abs() as usize;
        if at == 0 && !own {
            return Complex::ZERO;
        }
        let output = &self.rows[f][row];
        let omega = std::f64::consts::TAU * at as f64 / problem.period_s;
        let mut sum = Complex::ZERO;
        for (input, spectrum) in &solution.forces {
            if spectrum[at] != Complex::ZERO {
                let by = if at == 0 {
                    Complex::new(response.constant(output, input), 0.0)
                } else {
                    response.at(output, input, omega)
                };
                sum += by * spectrum[at];
            }
        }
        if let (_, Passed::Ring { mesh, .. }) = self.passage.forces[f]
            && let Some(rest) = solution.rest_of(problem, mesh)
        {
            sum += rest[at];
        }
        match whole {
            // A mean is no half of a pair of lines.
            0.0 => 2.0 * sum,
            w if w < 0.0 => sum.conj(),
            _ => sum,
        }
    }
}
