//! The linear train in its complex modes, where it can be stepped exactly.
//!
//! With `x = (q, q̇)` and `ẋ = A x + B u`, the modes are the eigenvectors of `A = V Λ V⁻¹`. Of
//! every conjugate pair one mode is kept and counted twice, so that `y = C x = Σ w_m Re(c_m z_m)`,
//! `ż_m = λ_m z_m + b_m u`.

use nalgebra::{Complex, DMatrix, DVector};

use crate::linear::LinearTrain;

/// The eigenvectors do not span the state space to working precision.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "the modes of the train cannot be separated (relative residual {residual:.1e}, expected below {expected:.0e}); change \
     one of two equal stiffnesses, inertias or housing frequencies slightly"
)]
pub struct ModalError {
    /// Largest `|A V − V Λ| / |A|`, or the error of `V V⁻¹ = 1`.
    pub residual: f64,
    /// What would be accepted.
    pub expected: f64,
}

const ACCEPTED_RESIDUAL: f64 = 1e-7;

/// The complex modes of a train.
#[derive(Clone, Debug)]
pub struct Modes {
    /// Eigenvalues λ_m (1/s), conjugates left out.
    pub eigenvalues: Vec<Complex<f64>>,
    /// 2 for one of a conjugate pair, 1 for a real eigenvalue.
    weights: Vec<f64>,
    /// Columns of V for the kept modes.
    shapes: DMatrix<Complex<f64>>,
    /// Rows of V⁻¹ for the kept modes.
    inverse: DMatrix<Complex<f64>>,
    /// Diagonal of the mass matrix.
    mass: DVector<f64>,
}

impl Modes {
    /// The modes of a train, meshes included as they stand in its matrices.
    ///
    /// # Errors
    /// Where the eigenvectors do not span the space, as for two equal real modes that are coupled.
    pub fn new(train: &LinearTrain) -> Result<Self, ModalError> {
        let n = train.names.len();
        let mass = train.mass.diagonal();
        // Mass-normalised coordinates, displacements times a frequency: all entries of the matrix
        // are then frequencies.
        let scale = (train.stiffness.diagonal().component_div(&mass)).max().max(1.0).sqrt();
        let mut a = DMatrix::<f64>::zeros(2 * n, 2 * n);
        for i in 0..n {
            a[(i, n + i)] = scale;
            for j in 0..n {
                // K and C are unsymmetric in the housing rows, hence row and column are scaled
                // apart.
                let root = mass[i].sqrt() * mass[j].sqrt();
                a[(n + i, j)] = -train.stiffness[(i, j)] / root / scale;
                a[(n + i, n + j)] = -train.damping[(i, j)] / root;
            }
        }
        let (eigenvalues, vectors) = eigen(&a)?;
        let mut to_physical = DVector::zeros(2 * n);
        for i in 0..n {
            to_physical[i] = 1.0 / (mass[i].sqrt() * scale);
            to_physical[n + i] = 1.0 / mass[i].sqrt();
        }
        let inverse =
            vectors.clone().try_inverse().ok_or(ModalError { residual: f64::INFINITY, expected: ACCEPTED_RESIDUAL })?;
        let identity_error = (&vectors * &inverse - DMatrix::identity(2 * n, 2 * n)).map(|z| z.norm()).max();
        if identity_error.is_nan() || identity_error > ACCEPTED_RESIDUAL {
            return Err(ModalError { residual: identity_error, expected: ACCEPTED_RESIDUAL });
        }
        let largest = eigenvalues.iter().map(|l| l.norm()).fold(0.0, f64::max);
        let mut kept: Vec<usize> = (0..2 * n).filter(|&m| eigenvalues[m].im >= -1e-9 * largest).collect();
        // A fixed order whatever the decomposition's: by frequency, then by damping.
        kept.sort_by(|&a, &b| {
            let (a, b) = (eigenvalues[a], eigenvalues[b]);
            a.im.total_cmp(&b.im).then(a.re.total_cmp(&b.re))
        });
        let is_real = |m: usize| eigenvalues[m].im.abs() <= 1e-9 * largest;
        Ok(Self {
            weights: kept.iter().map(|&m| if is_real(m) { 1.0 } else { 2.0 }).collect(),
            shapes: DMatrix::from_fn(2 * n, kept.len(), |i, m| vectors[(i, kept[m])] * to_physical[i]),
            inverse: DMatrix::from_fn(kept.len(), 2 * n, |m, i| inverse[(kept[m], i)] / to_physical[i]),
            eigenvalues: kept
                .iter()
                .map(|&m| if is_real(m) { Complex::new(eigenvalues[m].re, 0.0) } else { eigenvalues[m] })
                .collect(),
            mass,
        })
    }

    /// Number of kept modes.
    pub fn len(&self) -> usize {
        self.eigenvalues.len()
    }

    /// There is no mode.
    pub fn is_empty(&self) -> bool {
        self.eigenvalues.is_empty()
    }

    /// Largest |λ| (1/s).
    pub fn fastest(&self) -> f64 {
        self.eigenvalues.iter().map(|l| l.norm()).fold(0.0, f64::max)
    }

    /// `b_m` of a generalised force.
    pub fn input(&self, force: &DVector<f64>) -> Vec<Complex<f64>> {
        let n = self.mass.len();
        (0..self.len()).map(|m| (0..n).map(|i| self.inverse[(m, n + i)] * (force[i] / self.mass[i])).sum()).collect()
    }

    /// `w_m c_m` of the output `position·q + velocity·q̇`.
    pub fn output(&self, position: &DVector<f64>, velocity: &DVector<f64>) -> Vec<Complex<f64>> {
        let n = self.mass.len();
        (0..self.len())
            .map(|m| {
                let sum: Complex<f64> =
                    (0..n).map(|i| self.shapes[(i, m)] * position[i] + self.shapes[(n + i, m)] * velocity[i]).sum();
                sum * self.weights[m]
            })
            .collect()
    }

    /// Modal coordinates of a state `(q, q̇)`.
    pub fn project(&self, state: &[f64]) -> Vec<Complex<f64>> {
        (0..self.len()).map(|m| state.iter().enumerate().map(|(i, &x)| self.inverse[(m, i)] * x).sum()).collect()
    }

    /// The state `(q, q̇)` of modal coordinates.
    pub fn reconstruct(&self, modal: impl Iterator<Item = Complex<f64>>, state: &mut [f64]) {
        state.fill(0.0);
        for (m, z) in modal.take(self.len()).enumerate() {
            let z = z * self.weights[m];
            for (i, x) in state.iter_mut().enumerate() {
                let shape = self.shapes[(i, m)];
                *x += shape.re * z.re - shape.im * z.im;
            }
        }
    }
}

/// Eigenvalues, and right eigenvectors in columns.
type Eigen = (Vec<Complex<f64>>, DMatrix<Complex<f64>>);

/// Eigenvalues and right eigenvectors (columns) of a real matrix, by its complex Schur form
/// `A = Q T Qᴴ` and back substitution.
fn eigen(a: &DMatrix<f64>) -> Result<Eigen, ModalError> {
    let n = a.nrows();
    let norm = a.norm();
    let failed = |residual| ModalError { residual, expected: ACCEPTED_RESIDUAL };
    let schur = nalgebra::Schur::try_new(a.map(|x| Complex::new(x, 0.0)), f64::EPSILON, 10_000)
        .ok_or_else(|| failed(f64::INFINITY))?;
    let (q, t) = schur.unpack();
    let mut y = DMatrix::<Complex<f64>>::zeros(n, n);
    for k in 0..n {
        y[(k, k)] = Complex::new(1.0, 0.0);
        for i in (0..k).rev() {
            let sum: Complex<f64> = (i + 1..=k).map(|j| t[(i, j)] * y[(j, k)]).sum();
            let mut gap = t[(k, k)] - t[(i, i)];
            if gap.norm() < f64::EPSILON * norm {
                // Equal eigenvalues of uncoupled modes: any vector of their space will do.
                gap = Complex::new(f64::EPSILON * norm, 0.0);
            }
            y[(i, k)] = sum / gap;
        }
        let length = y.column(k).norm();
        y.column_mut(k).unscale_mut(length);
    }
    let vectors = q * y;
    let eigenvalues: Vec<_> = (0..n).map(|k| t[(k, k)]).collect();
    let complex = a.map(|x| Complex::new(x, 0.0));
    let residual = (0..n)
        .map(|k| (&complex * vectors.column(k) - vectors.column(k) * eigenvalues[k]).norm() / norm)
        .fold(0.0, f64::max);
    if residual.is_nan() || residual > ACCEPTED_RESIDUAL {
        return Err(failed(residual));
    }
    Ok((eigenvalues, vectors))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_bench;

    /// Undamped, the complex modes have the frequencies of the symmetric eigenvalue problem.
    #[test]
    fn oracle_frequencies_are_those_of_the_symmetric_problem() {
        let mut bench = test_bench::two_stages();
        bench.motor.slip_slope_nm_s_per_rad = 1e-6;
        if let Some(belt) = &mut bench.belt {
            belt.damping_nm_s_per_rad = 0.0;
        }
        for shaft in &mut bench.shafts {
            shaft.torsion_damping_nm_s_per_rad = 0.0;
            shaft.bearing_damping_n_s_per_m = 0.0;
        }
        let train = LinearTrain::new(&bench).with_meshes(&[3.1e8, 3.4e8], &[0.0, 0.0]);
        let modes = Modes::new(&train).unwrap();
        let mut damped: Vec<f64> = modes.eigenvalues.iter().map(|l| l.im / std::f64::consts::TAU).collect();
        damped.sort_by(f64::total_cmp);
        let undamped = train.natural_frequencies_hz();
        for (i, expected) in undamped.iter().enumerate().skip(1) {
            let found = damped[damped.len() - undamped.len() + i];
            assert!((found - expected).abs() < 1e-8 * expected, "{found} {expected}");
        }
    }

    /// The response to forces, solved for without any modes, peaks at the eigenfrequencies: three
    /// times higher than 0.1 % beside them, at dampings of 1e-4 of the critical and less.
    #[test]
    fn oracle_peaks_of_the_response_are_the_eigenfrequencies() {
        let train = LinearTrain::new(&test_bench::two_stages()).with_meshes(&[3.1e8, 3.4e8], &[0.0, 0.0]);
        let frequencies = train.natural_frequencies_hz();
        let fastest = std::f64::consts::TAU * frequencies[frequencies.len() - 1];
        let n = train.structural;
        let response = |hz: f64| -> f64 {
            let omega = std::f64::consts::TAU * hz;
            // Damping in proportion to the stiffness: an eigenvector stays one.
            let dynamic = DMatrix::from_fn(n, n, |i, j| {
                let k = train.stiffness[(i, j)] / (train.mass[(i, i)] * train.mass[(j, j)]).sqrt();
                let inertia = if i == j { omega * omega } else { 0.0 };
                Complex::new(k - inertia, omega * 2e-4 / fastest * k)
            });
            dynamic.try_inverse().unwrap().norm()
        };
        for &hz in &frequencies[1..] {
            let beside = response(0.999 * hz).max(response(1.001 * hz));
            assert!(response(hz) > 3.0 * beside, "{hz} Hz: {} beside {beside}", response(hz));
        }
    }

    /// There and back again.
    #[test]
    fn analytic_projection_and_reconstruction() {
        let train = LinearTrain::new(&test_bench::two_stages()).with_meshes(&[3.1e8, 3.4e8], &[800.0, 900.0]);
        let modes = Modes::new(&train).unwrap();
        let n = 2 * train.names.len();
        let state: Vec<f64> = (0..n).map(|i| ((i * 37 + 11) % 23) as f64 - 11.0).collect();
        let mut again = vec![0.0; n];
        modes.reconstruct(modes.project(&state).into_iter(), &mut again);
        for (a, b) in state.iter().zip(&again) {
            assert!((a - b).abs() < 1e-6 * 11.0, "{a} {b}");
        }
    }
}
