//! A shaft in a few coordinates.
//!
//! # Formula
//! The basis is that of R. R. Craig, M. C. C. Bampton, "Coupling of substructures for dynamic
//! analyses", AIAA J. 6 (1968) 1313, with the shaft on its supports: its deflection under a unit
//! force at each gear, its modes up to a frequency, and its deflection under a unit force at each
//! support as far as what that adds moves below four times this frequency. So static deflections
//! under forces at gears are exact, and so is what each support carries of them. The basis is then
//! turned into the modes of the reduced shaft (Rayleigh–Ritz), scaled so that each has the mass of
//! the rotor: mass and stiffness are diagonal, and a coordinate has the unit m.
//!
//! What supports add beyond matters to forces of their own, as those of dampers and of a seat with
//! play. On shafts of a laboratory bench it moves at some 40 kHz and asks for three times as many
//! steps.
//!
//! Damping of the shaft's own deformation is the modal strain energy method of C. D. Johnson, D. A.
//! Kienholz, AIAA J. 20 (1982) 1284: `ζ_k = ζ φᵀK_shaft φ / φᵀK φ`.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

use super::{Held, Rotor};

/// What is left of a vector beside the ones before it is rounding below this part of its length.
const NEW: f64 = 1e-6;
/// What the deflection under a force at a support adds is left out where it moves faster than so
/// many times the highest mode that is wanted.
const FAST: f64 = 4.0;

/// A shaft with its gears on its supports, in one plane.
#[derive(Clone, Debug, PartialEq)]
pub struct Reduced {
    /// Mass of shaft and gears, which every coordinate has (kg).
    pub mass_kg: f64,
    /// Angular frequency of each coordinate by itself (rad/s), ascending.
    pub omegas: Vec<f64>,
    /// Deflection at each disc as a function of the coordinates.
    pub seats: Vec<DVector<f64>>,
    /// Slope at each disc (1/m).
    pub slopes: Vec<DVector<f64>>,
    /// Deflection at each support.
    pub held: Vec<DVector<f64>>,
    /// The supports.
    pub supports: Vec<Held>,
    /// Damping matrix (N s/m).
    pub damping: DMatrix<f64>,
    /// Gyroscopic matrix, times the speed of rotation in rad/s (kg).
    pub polar: DMatrix<f64>,
}

impl Rotor {
    /// The shaft in its static deflections under its gears and its modes up to a frequency (Hz),
    /// with the damping ratio of its own deformation. None where nothing holds it.
    pub fn reduced(&self, modes_to_hz: f64, damping_ratio: f64) -> Option<Reduced> {
        let n = self.mass.nrows();
        let factor = self.stiffness.clone().cholesky()?;
        // K = L Lᵀ: the largest eigenvalues of L⁻¹ M L⁻ᵀ are 1/ω² of the lowest modes, without the
        // rounding that the highest ones bring into `M⁻¹ K`.
        let lower = factor.l();
        let half = lower.solve_lower_triangular(&self.mass)?;
        let inverse = lower.solve_lower_triangular(&half.transpose())?;
        let eigen = SymmetricEigen::new(0.5 * (&inverse + inverse.transpose()));
        let highest = std::f64::consts::TAU * modes_to_hz;
        let mut kept: Vec<usize> = (0..n).filter(|&k| eigen.eigenvalues[k] * highest * highest >= 1.0).collect();
        kept.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        let upper = lower.transpose();
        let mut basis: Vec<DVector<f64>> = Vec::new();
        for k in kept {
            self.add(&mut basis, upper.solve_upper_triangular(&eigen.eigenvectors.column(k).into_owned())?);
        }
        let under_force = |at: usize| {
            let mut force = DVector::zeros(n);
            force[2 * at] = 1.0;
            factor.solve(&force)
        };
        for &at in &self.discs {
            self.add(&mut basis, under_force(at));
        }
        for held in &self.supports {
            let before = basis.len();
            self.add(&mut basis, under_force(held.node));
            let fast = |new: &DVector<f64>| new.dot(&(&self.stiffness * new)) > (FAST * highest).powi(2);
            if basis.len() > before && basis.last().is_some_and(fast) {
                basis.pop();
            }
        }
        let basis = DMatrix::from_columns(&basis);
        let ritz = SymmetricEigen::new(basis.transpose() * &self.stiffness * &basis);
        let mut order: Vec<usize> = (0..ritz.eigenvalues.len()).collect();
        order.sort_by(|&a, &b| ritz.eigenvalues[a].total_cmp(&ritz.eigenvalues[b]));
        let turned = DMatrix::from_columns(&order.iter().map(|&k| signed(&ritz, k)).collect::<Vec<_>>());
        let shapes = basis * turned * self.mass_kg.sqrt();
        let omegas: Vec<f64> = order.iter().map(|&k| ritz.eigenvalues[k].max(0.0).sqrt()).collect();
        let row = |at: usize| shapes.row(at).transpose();
        let held: Vec<DVector<f64>> = self.supports.iter().map(|held| row(2 * held.node)).collect();
        let mut damping = DMatrix::zeros(omegas.len(), omegas.len());
        for (support, row) in self.supports.iter().zip(&held) {
            damping.ger(support.damping_n_s_per_m, row, row, 1.0);
        }
        let strain = shapes.transpose() * &self.shaft * &shapes;
        for (k, omega) in omegas.iter().enumerate() {
            damping[(k, k)] += 2.0 * damping_ratio * strain[(k, k)] / omega;
        }
        Some(Reduced {
            mass_kg: self.mass_kg,
            seats: self.discs.iter().map(|&at| row(2 * at)).collect(),
            slopes: self.discs.iter().map(|&at| row(2 * at + 1)).collect(),
            held,
            supports: self.supports.clone(),
            damping,
            polar: shapes.transpose() * &self.polar * &shapes,
            omegas,
        })
    }

    /// Adds what is new of a vector to a basis with `φᵀ M φ = 1`.
    fn add(&self, basis: &mut Vec<DVector<f64>>, vector: DVector<f64>) {
        let length = |v: &DVector<f64>| v.dot(&(&self.mass * v)).max(0.0).sqrt();
        let before = length(&vector);
        let mut rest = vector / before;
        // Twice is enough against rounding (Kahan, in B. N. Parlett, The Symmetric Eigenvalue
        // Problem, section 6.9).
        for _ in 0..2 {
            for known in basis.iter() {
                let along = known.dot(&(&self.mass * &rest));
                rest.axpy(-along, known, 1.0);
            }
        }
        let left = length(&rest);
        if left > NEW {
            basis.push(rest / left);
        }
    }
}

/// An eigenvector with its largest part positive: the decomposition leaves the sign open.
fn signed(eigen: &SymmetricEigen<f64, nalgebra::Dyn>, k: usize) -> DVector<f64> {
    let vector = eigen.eigenvectors.column(k).into_owned();
    let sign = vector[vector.icamax()].signum();
    vector * sign
}

impl Reduced {
    /// Eigenfrequencies at standstill (Hz), ascending.
    pub fn frequencies_hz(&self) -> Vec<f64> {
        self.omegas.iter().map(|omega| omega / std::f64::consts::TAU).collect()
    }

    /// Eigenfrequencies of the whirl against the rotation and with it at a speed (rad/s, > 0), in
    /// Hz, each ascending, undamped.
    ///
    /// # Formula
    /// With `u_x + i u_y = z e^{iωt}`: `(K + ω Ω G − ω² M) z = 0`; ω > 0 turns with the shaft.
    pub fn whirl_hz(&self, speed_rad_per_s: f64) -> [Vec<f64>; 2] {
        let n = self.omegas.len();
        // With the unit of time 1/ω of the highest mode all entries are of order 1 or below.
        let unit = self.omegas.last().copied().unwrap_or(1.0).max(1.0);
        let mut a = DMatrix::zeros(2 * n, 2 * n);
        for i in 0..n {
            a[(i, n + i)] = 1.0;
            a[(n + i, i)] = (self.omegas[i] / unit).powi(2);
            for j in 0..n {
                a[(n + i, n + j)] = speed_rad_per_s * self.polar[(i, j)] / (self.mass_kg * unit);
            }
        }
        let of = |sign: f64| {
            let all = a.complex_eigenvalues();
            let mut out: Vec<f64> = all.iter().map(|z| sign * z.re * unit / std::f64::consts::TAU).collect();
            out.retain(|&hz| hz > 0.0);
            out.sort_by(f64::total_cmp);
            out
        };
        [of(-1.0), of(1.0)]
    }
}
