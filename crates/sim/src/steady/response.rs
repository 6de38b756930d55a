//! Exact frequency response of the linear train, meshes at their mean stiffness and damping.

use nalgebra::{Complex, DMatrix, DVector};

use super::solver::{Problem, Table};
use crate::linear::LinearTrain;
use crate::modal::Modes;
use crate::model::ModelError;

/// An output `position·q + velocity·q̇ + acceleration·q̈`.
#[derive(Clone, Debug)]
pub(super) struct Output {
    modal: Vec<Complex<f64>>,
    position: DVector<f64>,
    /// Modal form of the acceleration row as if it were one of q̇; empty where there is none.
    acceleration: Vec<Complex<f64>>,
}

/// An input: a generalised force.
#[derive(Clone, Debug)]
pub(super) struct Input {
    modal: Vec<Complex<f64>>,
    /// Displacements under a unit constant force, the train's free rotation held and its mean slip
    /// taken off.
    constant: DVector<f64>,
}

/// The linear train.
pub(super) struct Response {
    pub(super) modes: Modes,
    pinned: nalgebra::LU<f64, nalgebra::Dyn, nalgebra::Dyn>,
    rigid: DVector<f64>,
    damping_of_rigid: DVector<f64>,
}

impl Response {
    /// Of a train with its meshes (see [`LinearTrain::with_meshes`]); `motor_order` is the motor's
    /// speed / the first shaft's.
    pub(super) fn new(train: &LinearTrain, motor_order: f64) -> Result<Self, ModelError> {
        let rigid = train.rotation(motor_order);
        let mut k: DMatrix<f64> = train.stiffness.clone();
        k[(train.motor_angle, train.motor_angle)] += 1e4; // pins the free rotation
        Ok(Self { modes: Modes::new(train)?, pinned: k.lu(), damping_of_rigid: &train.damping * &rigid, rigid })
    }

    pub(super) fn input(&self, force: &DVector<f64>) -> Input {
        // A constant force that does work on the rotation changes the mean speed until the drive's
        // slope balances it.
        let slip = self.rigid.dot(force) / self.rigid.dot(&self.damping_of_rigid);
        let balanced = force - &self.damping_of_rigid * slip;
        Input {
            modal: self.modes.input(force),
            constant: self.pinned.solve(&balanced).unwrap_or_else(|| DVector::zeros(force.len())),
        }
    }

    pub(super) fn output(
        &self,
        position: &DVector<f64>,
        velocity: &DVector<f64>,
        acceleration: Option<&DVector<f64>>,
    ) -> Output {
        let zero = DVector::zeros(position.len());
        Output {
            modal: self.modes.output(position, velocity),
            position: position.clone(),
            acceleration: acceleration.map_or(Vec::new(), |row| self.modes.output(&zero, row)),
        }
    }

    /// Response of an output to a unit input at angular frequency ω > 0 (rad/s).
    pub(super) fn at(&self, output: &Output, input: &Input, omega: f64) -> Complex<f64> {
        let s = Complex::new(0.0, omega);
        let sum = |row: &[Complex<f64>]| -> Complex<f64> {
            let modes = self.modes.eigenvalues.iter().zip(&input.modal).zip(row);
            modes
                .map(|((&lambda, &b), &c)| {
                    let residue = c * b;
                    0.5 * (residue / (s - lambda) + residue.conj() / (s - lambda.conj()))
                })
                .sum()
        };
        // q̈ is q̇ times iω.
        sum(&output.modal) + if output.acceleration.is_empty() { Complex::ZERO } else { s * sum(&output.acceleration) }
    }

    /// `1/(iω − λ)` and `1/(iω − λ̄)` of every mode, to be used for several outputs and inputs.
    fn poles(&self, omega: f64, out: &mut Vec<[Complex<f64>; 2]>) {
        let s = Complex::new(0.0, omega);
        out.clear();
        out.extend(self.modes.eigenvalues.iter().map(|&lambda| [0.5 / (s - lambda), 0.5 / (s - lambda.conj())]));
    }

    /// As [`Self::at`], from the poles, for an output without acceleration.
    fn at_poles(&self, output: &Output, input: &Input, poles: &[[Complex<f64>; 2]]) -> Complex<f64> {
        let modes = output.modal.iter().zip(&input.modal).zip(poles);
        modes
            .map(|((&c, &b), pole)| {
                let residue = c * b;
                residue * pole[0] + residue.conj() * pole[1]
            })
            .sum()
    }

    /// Responses of outputs without acceleration at every bin of a problem's period, by pair of
    /// outputs and inputs: `table[output * inputs + input][bin]`.
    pub(super) fn tables<const N: usize>(&self, problem: &Problem, ends: [(&[Output], &[Input]); N]) -> [Table; N] {
        let bins = problem.samples / 2 + 1;
        let mut out = ends.map(|(rows, inputs)| vec![Vec::with_capacity(bins); rows.len() * inputs.len()]);
        let mut poles = Vec::new();
        for bin in 0..bins {
            let omega = std::f64::consts::TAU * bin as f64 / problem.period_s;
            self.poles(omega, &mut poles);
            for ((rows, inputs), table) in ends.iter().zip(&mut out) {
                for (at, response) in table.iter_mut().enumerate() {
                    let (row, input) = (&rows[at / inputs.len()], &inputs[at % inputs.len()]);
                    response.push(match bin {
                        0 => Complex::new(self.constant(row, input), 0.0),
                        _ => self.at_poles(row, input, &poles),
                    });
                }
            }
        }
        out
    }

    /// Spectrum over a problem's period of an output without acceleration under some forces.
    pub(super) fn line_motion<'a>(
        &self,
        problem: &Problem,
        row: &Output,
        forces: impl IntoIterator<Item = &'a (Input, Vec<Complex<f64>>)>,
    ) -> Vec<Complex<f64>> {
        let bins = problem.samples / 2 + 1;
        let mut sum = vec![Complex::ZERO; bins];
        for (input, spectrum) in forces {
            sum[0] += self.constant(row, input) * spectrum[0];
            let largest = spectrum.iter().skip(1).map(|z| z.norm_sqr()).fold(0.0, f64::max);
            for bin in 1..bins {
                // Most outside forces have a few lines only.
                if spectrum[bin].norm_sqr() > 1e-24 * largest {
                    let omega = std::f64::consts::TAU * bin as f64 / problem.period_s;
                    sum[bin] += self.at(row, input, omega) * spectrum[bin];
                }
            }
        }
        sum
    }

    /// Response of an output's displacement part to a constant unit input.
    pub(super) fn constant(&self, output: &Output, input: &Input) -> f64 {
        output.position.dot(&input.constant)
    }
}
