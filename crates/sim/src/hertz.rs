//! Compliance of the Hertzian line contact of a tooth pair.

use std::f64::consts::PI;

use crate::geometry::PairGeometry;

/// Which law gives the contact compliance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hertz {
    /// `k_h = π E L / (4 (1 − ν²))`, Yang & Sun 1985: the paper's form. Independent of load, and 3
    /// to 4 times too stiff at the loads of a test bench.
    Linear,
    /// `k_h = E^0.9 L^0.8 F^0.1 / 1.275` (SI units; secant stiffness F/δ), equal materials.
    LoadDependent,
}

/// Elastic constants of the gears' material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Young's modulus E (Pa).
    pub youngs_modulus_pa: f64,
    /// Poisson's ratio ν.
    pub poisson_ratio: f64,
}

impl Material {
    /// Shear modulus `G = E / (2 (1 + ν))` (Pa).
    pub fn shear_modulus_pa(&self) -> f64 {
        self.youngs_modulus_pa / (2.0 * (1.0 + self.poisson_ratio))
    }
}

/// Load (N) below which the load-dependent law is held: `F^0.1` has no meaning at 0.
pub const LEAST_LOAD_N: f64 = 1.0;

impl Hertz {
    /// Contact compliance δ/F (m/N) at contact length `length_m` and pair load `load_n`.
    pub fn compliance_m_per_n(self, material: &Material, length_m: f64, load_n: f64) -> f64 {
        let Material { youngs_modulus_pa: e, poisson_ratio: nu } = *material;
        match self {
            Self::Linear => 4.0 * (1.0 - nu * nu) / (PI * e * length_m),
            Self::LoadDependent => 1.275 / (e.powf(0.9) * length_m.powf(0.8) * load_n.max(LEAST_LOAD_N).powf(0.1)),
        }
    }

    /// Power of `1 / length` in the compliance.
    pub fn length_exponent(self) -> f64 {
        match self {
            Self::Linear => 1.0,
            Self::LoadDependent => 0.8,
        }
    }
}

/// Contact compliance δ/F (m/N) after Weber & Banaschek 1953, an independent check of [`Hertz`]:
/// `δ = Σᵢ 2 F (1 − ν²)/(π E L) [ln(2 dᵢ / a) − ν / (2 (1 − ν))]`,
/// `a = sqrt(8 F ρ (1 − ν²)/(π E L))`.
///
/// `pinion_roll_m` is the pinion's roll coordinate ξ; `ρ = ξ (T − ξ) / T`; dᵢ is the depth from the
/// contact to the tooth's centre line along the force, `hᵢ / cos α₁ᵢ`.
pub fn weber_compliance_m_per_n(pair: &PairGeometry, material: &Material, pinion_roll_m: f64, load_n: f64) -> f64 {
    let Material { youngs_modulus_pa: e, poisson_ratio: nu } = *material;
    let length = pair.pinion.face_width_m.min(pair.wheel.face_width_m);
    let other_roll = pair.tangent_length_m - pinion_roll_m;
    let curvature = pinion_roll_m * other_roll / pair.tangent_length_m;
    let unit = (1.0 - nu * nu) / (PI * e * length);
    let half_width = (8.0 * load_n * curvature * unit).sqrt();
    [(&pair.pinion, pinion_roll_m), (&pair.wheel, other_roll)]
        .into_iter()
        .map(|(gear, roll)| {
            let angle = gear.load_angle_rad(roll);
            let depth = gear.flank_point_m(angle).1 / angle.cos();
            2.0 * unit * ((2.0 * depth / half_width).ln() - nu / (2.0 * (1.0 - nu)))
        })
        .sum()
}
