//! A shaft that bends: Timoshenko beam elements with gears as rigid discs on supports, reduced to a
//! few coordinates.
//!
//! Supports are alike in all radial directions, so that both planes have the same matrices and one
//! of them is made. Only the gyroscopic moments couple the planes. The slope is that of the axis
//! against the position along it, in either plane.
//!
//! # Formula
//! With the discs' mass and diametral inertia `I_d` and the supports in M, K and C, and spin Ω
//! (counter-clockwise seen from the motor positive):
//!
//! ```text
//! M ü_x + C u̇_x + Ω G u̇_y + K u_x = f_x
//! M ü_y + C u̇_y − Ω G u̇_x + K u_y = f_y
//! ```
//!
//! The reduction is in [`reduced`], the element in [`element`].

pub mod element;
pub mod reduced;

use gearwatch_core::bench::Beam;
use gearwatch_core::bench::beam::NEAREST_MM;
use nalgebra::DMatrix;

pub use self::element::Element;
use self::element::{INNER, SIZE};
pub use self::reduced::Reduced;

/// Elements along a shaft, at least: frequencies of up to four half waves along it are right to
/// 2e-5 (`analytic_simply_supported_timoshenko_beam`).
const ELEMENTS: f64 = 10.0;

/// A gear as a rigid disc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disc {
    /// Along the shaft (mm).
    pub at_mm: f64,
    /// (kg).
    pub mass_kg: f64,
    /// About the shaft's axis (kg m²).
    pub polar_kg_m2: f64,
    /// About a diameter (kg m²).
    pub diametral_kg_m2: f64,
}

impl Disc {
    /// A gear of a face width (m).
    ///
    /// # Formula
    /// `I_d = J/2 + m b²/12`, of any body of revolution that is the same along its width b.
    pub fn gear(at_mm: f64, mass_kg: f64, polar_kg_m2: f64, width_m: f64) -> Self {
        Self { at_mm, mass_kg, polar_kg_m2, diametral_kg_m2: 0.5 * polar_kg_m2 + mass_kg * width_m * width_m / 12.0 }
    }
}

/// A support as the matrices have it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Held {
    /// Radial (N/m).
    pub stiffness_n_per_m: f64,
    /// Radial (N s/m).
    pub damping_n_s_per_m: f64,
    /// Number of its node.
    node: usize,
}

/// Matrices of a shaft in one plane: deflection and slope of each node, then what is inside of the
/// elements.
#[derive(Clone, Debug)]
pub struct Rotor {
    /// Of the nodes (mm).
    pub nodes_mm: Vec<f64>,
    /// Without supports (N/m, N, N m).
    shaft: DMatrix<f64>,
    /// With supports.
    stiffness: DMatrix<f64>,
    mass: DMatrix<f64>,
    polar: DMatrix<f64>,
    supports: Vec<Held>,
    /// Nodes of the discs.
    discs: Vec<usize>,
    mass_kg: f64,
}

impl Rotor {
    /// A beam with discs; `scales` are the factors on stiffness and damping of its supports.
    pub fn new(beam: &Beam, scales: (f64, f64), discs: &[Disc]) -> Self {
        let nodes_mm = nodes(beam, discs);
        let ends = 2 * nodes_mm.len();
        let n = ends + INNER * (nodes_mm.len() - 1);
        let zero = || DMatrix::zeros(n, n);
        let (mut shaft, mut mass, mut polar) = (zero(), zero(), zero());
        let mut begin = 0.0;
        let mut at = 0;
        for section in &beam.sections {
            let end = begin + section.length_mm;
            while at + 1 < nodes_mm.len() && nodes_mm[at + 1] < end + 0.5 * NEAREST_MM {
                let element = Element::new(section, 1e-3 * (nodes_mm[at + 1] - nodes_mm[at]), &beam.material);
                let places: [usize; SIZE] =
                    std::array::from_fn(|k| if k < 4 { 2 * at + k } else { ends + INNER * at + k - 4 });
                for (i, j) in (0..SIZE).flat_map(|i| (0..SIZE).map(move |j| (i, j))) {
                    let to = (places[i], places[j]);
                    shaft[to] += element.stiffness[(i, j)];
                    mass[to] += element.mass[(i, j)];
                    polar[to] += element.polar[(i, j)];
                }
                at += 1;
            }
            begin = end;
        }
        let node = |mm: f64| {
            let distance = |i: &usize| (nodes_mm[*i] - mm).abs();
            (0..nodes_mm.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0)
        };
        let along: Vec<f64> = (0..n).map(|i| if i < ends && i % 2 == 0 { 1.0 } else { 0.0 }).collect();
        let along = nalgebra::DVector::from_vec(along);
        let mut mass_kg = along.dot(&(&mass * &along));
        let places: Vec<usize> = discs.iter().map(|disc| node(disc.at_mm)).collect();
        for (disc, &at) in discs.iter().zip(&places) {
            mass[(2 * at, 2 * at)] += disc.mass_kg;
            mass[(2 * at + 1, 2 * at + 1)] += disc.diametral_kg_m2;
            polar[(2 * at + 1, 2 * at + 1)] += disc.polar_kg_m2;
            mass_kg += disc.mass_kg;
        }
        let mut stiffness = shaft.clone();
        let mut supports = Vec::with_capacity(beam.supports.len());
        for support in &beam.supports {
            let at = node(support.at_mm);
            let held = Held {
                stiffness_n_per_m: scales.0 * support.stiffness_n_per_m,
                damping_n_s_per_m: scales.1 * support.damping_n_s_per_m,
                node: at,
            };
            stiffness[(2 * at, 2 * at)] += held.stiffness_n_per_m;
            stiffness[(2 * at + 1, 2 * at + 1)] += scales.0 * support.tilt_nm_per_rad;
            supports.push(held);
        }
        Self { shaft, stiffness, mass, polar, supports, discs: places, mass_kg, nodes_mm }
    }
}

/// Nodes at all places of the shaft, and between them so that no element is longer than a part of
/// it (mm).
fn nodes(beam: &Beam, discs: &[Disc]) -> Vec<f64> {
    let mut places = vec![0.0];
    for section in &beam.sections {
        places.push(places.last().copied().unwrap_or(0.0) + section.length_mm);
    }
    // Ends of sections come first: of places next to each other they stay.
    for mm in discs.iter().map(|disc| disc.at_mm).chain(beam.supports.iter().map(|support| support.at_mm)) {
        if places.iter().all(|place| (place - mm).abs() >= NEAREST_MM) {
            places.push(mm);
        }
    }
    places.sort_by(f64::total_cmp);
    let longest = beam.length_mm() / ELEMENTS;
    let mut out = vec![0.0];
    for pair in places.windows(2) {
        let parts = ((pair[1] - pair[0]) / longest - 1e-9).ceil().max(1.0);
        out.extend((1..=parts as usize).map(|k| pair[0] + (pair[1] - pair[0]) * k as f64 / parts));
    }
    out
}

#[cfg(test)]
mod tests;
