//! A cylindrical Timoshenko beam element in one plane.
//!
//! # Formula
//! S. P. Timoshenko, Phil. Mag. 41 (1921) 744, with the deflection u and the slope ψ of the
//! section:
//!
//! ```text
//! potential ½ ∫ E I ψ'² + κ G A (u' − ψ)² ds      kinetic ½ ∫ ρ A u̇² + ρ I ψ̇² ds
//! ```
//!
//! and `2 ρ I` of the gyroscopic moments for each length. u is of the fourth degree along an
//! element and ψ of the third, as hierarchical polynomials (B. Szabó, I. Babuška, Finite Element
//! Analysis (1991), section 3.1): values at either end and integrated Legendre polynomials between.
//! Static bending under forces at the ends is exact, and no degree locks.
//!
//! κ of a hollow cylinder with `m = d/D`: G. R. Cowper, "The shear coefficient in Timoshenko's beam
//! theory", J. Appl. Mech. 33 (1966) 335:
//! `κ = 6 (1 + ν)(1 + m²)² / ((7 + 6ν)(1 + m²)² + (20 + 12ν) m²)`.

use std::f64::consts::PI;

use gearwatch_core::bench::{GearMaterial, Section};
use nalgebra::{SMatrix, SVector};

/// Coordinates of an element: `u₁ ψ₁ u₂ ψ₂`, three more of u and two more of ψ.
pub const SIZE: usize = 9;
/// Those of them that are its own.
pub const INNER: usize = SIZE - 4;

type Row = SVector<f64, SIZE>;
type Matrix = SMatrix<f64, SIZE, SIZE>;

/// Matrices of an element in one plane.
#[derive(Clone, Debug, PartialEq)]
pub struct Element {
    /// (N/m, N, N m).
    pub stiffness: Matrix,
    /// With rotary inertia (kg, kg m, kg m²).
    pub mass: Matrix,
    /// Couples the slopes of both planes, times the speed of rotation (kg m²).
    pub polar: Matrix,
}

/// Shear coefficient of a hollow cylinder (Cowper 1966).
pub fn shear_coefficient(section: &Section, poisson_ratio: f64) -> f64 {
    let ratio = (section.bore_mm / section.diameter_mm).powi(2);
    let square = (1.0 + ratio).powi(2);
    let nu = poisson_ratio;
    6.0 * (1.0 + nu) * square / ((7.0 + 6.0 * nu) * square + (20.0 + 12.0 * nu) * ratio)
}

/// Points and weights of Gauss and Legendre on −1 to 1: exact to the ninth degree, of which the
/// products here reach the eighth.
fn gauss() -> [(f64, f64); 5] {
    let root = 2.0 * (10.0_f64 / 7.0).sqrt();
    let (near, far) = ((5.0 - root).sqrt() / 3.0, (5.0 + root).sqrt() / 3.0);
    let spread = 13.0 * 70.0_f64.sqrt();
    let (heavy, light) = ((322.0 + spread) / 900.0, (322.0 - spread) / 900.0);
    [(-far, light), (-near, heavy), (0.0, 128.0 / 225.0), (near, heavy), (far, light)]
}

/// Integrated Legendre polynomials of degree 2 to 4 with their derivatives; 0 at both ends.
///
/// # Formula
/// `φ_j = (P_j − P_{j−2}) / √(2 (2j − 1))`, `φ_j' = √((2j − 1)/2) P_{j−1}`.
fn inner(x: f64) -> [(f64, f64); 3] {
    let p = [
        1.0,
        x,
        0.5 * (3.0 * x * x - 1.0),
        0.5 * (5.0 * x * x * x - 3.0 * x),
        0.125 * (35.0 * x.powi(4) - 30.0 * x * x + 3.0),
    ];
    [2, 3, 4].map(|j| {
        let odd = (2 * j - 1) as f64;
        ((p[j] - p[j - 2]) / (2.0 * odd).sqrt(), (0.5 * odd).sqrt() * p[j - 1])
    })
}

impl Element {
    /// A length (m) of a section.
    pub fn new(section: &Section, length_m: f64, material: &GearMaterial) -> Self {
        let GearMaterial { youngs_modulus_pa: e, poisson_ratio, density_kg_per_m3: rho } = *material;
        let area = 0.25 * PI * 1e-6 * (section.diameter_mm.powi(2) - section.bore_mm.powi(2));
        let second = 0.5 * section.polar_m4();
        let shear = shear_coefficient(section, poisson_ratio) * e / (2.0 * (1.0 + poisson_ratio)) * area;
        let mut out = Self { stiffness: Matrix::zeros(), mass: Matrix::zeros(), polar: Matrix::zeros() };
        // By the unit coordinate an element is 2 long.
        let half = 0.5 * length_m;
        for (x, weight) in gauss() {
            let ends = [(0.5 * (1.0 - x), -0.5), (0.5 * (1.0 + x), 0.5)];
            let (mut u, mut du, mut psi, mut dpsi) = (Row::zeros(), Row::zeros(), Row::zeros(), Row::zeros());
            for (k, (value, slope)) in ends.into_iter().enumerate() {
                (u[2 * k], du[2 * k]) = (value, slope / half);
                (psi[2 * k + 1], dpsi[2 * k + 1]) = (value, slope / half);
            }
            for (k, (value, slope)) in inner(x).into_iter().enumerate() {
                (u[4 + k], du[4 + k]) = (value, slope / half);
                if k < 2 {
                    (psi[7 + k], dpsi[7 + k]) = (value, slope / half);
                }
            }
            let sheared = du - psi;
            let part = weight * half;
            out.stiffness += (dpsi * dpsi.transpose()) * (part * e * second);
            out.stiffness += (sheared * sheared.transpose()) * (part * shear);
            let rotary = (psi * psi.transpose()) * (part * rho * second);
            out.mass += (u * u.transpose()) * (part * rho * area) + rotary;
            out.polar += rotary * 2.0;
        }
        out
    }
}
