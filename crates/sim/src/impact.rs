//! The contact law of ADAMS solid contacts, which the paper's simulation rests on: IMPACT.
//!
//! `F = max(0, K pᵉ + c(p) ṗ)` for p > 0 and 0 otherwise, with p the penetration and
//! `c(p) = STEP(p, 0, 0, d, c_max)`: a cubic that rises from 0 at p = 0 to c_max at p = d.
//!
//! What it lacks, beside the potential-energy model of [`crate::mesh`]: it is the law of a *sphere*
//! where teeth make a line contact; it knows no bending of teeth and no gear body, so that nothing
//! but the number of touching pairs varies over a mesh cycle; at the loads of a test bench it is 3
//! to 6 times too soft (the mesh resonance comes out 2 times too low) and stiffens with F^(1/3);
//! and with the usual d of 0.1 mm only a few per cent of c_max act, so that it is practically
//! undamped.

use crate::geometry::PairGeometry;
use crate::hertz::Material;
use crate::mesh::Pairs;

/// Parameters of the law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Impact {
    /// K (N/mᵉ).
    pub stiffness: f64,
    /// e (1); 1.5 is usual.
    pub exponent: f64,
    /// c_max (N s/m).
    pub greatest_damping_n_s_per_m: f64,
    /// d (m): penetration at which all of the damping acts.
    pub depth_m: f64,
}

impl Impact {
    /// As gear papers set it: `K = (4/3) sqrt(R) E*` with the radii of curvature at the pitch
    /// point, `1/R = 1/ξ_P + 1/(T − ξ_P)`, `E* = E/(2 (1 − ν²))`, e = 1.5; c_max = 50 N s/mm at d =
    /// 0.1 mm.
    pub fn usual(pair: &PairGeometry, material: &Material) -> Self {
        let (one, two) = (pair.pitch_roll_m, pair.tangent_length_m - pair.pitch_roll_m);
        let radius = one * two / (one + two);
        let nu = material.poisson_ratio;
        let modulus = material.youngs_modulus_pa / (2.0 * (1.0 - nu * nu));
        Self {
            stiffness: 4.0 / 3.0 * radius.sqrt() * modulus,
            exponent: 1.5,
            greatest_damping_n_s_per_m: 5e4,
            depth_m: 1e-4,
        }
    }

    /// Force (N) at penetration `p_m` closing at `rate_m_per_s`.
    pub fn force_n(&self, p_m: f64, rate_m_per_s: f64) -> f64 {
        if p_m <= 0.0 {
            return 0.0;
        }
        (self.stiffness * p_m.powf(self.exponent) + self.damping_n_s_per_m(p_m) * rate_m_per_s).max(0.0)
    }

    /// Damping c(p) (N s/m).
    pub fn damping_n_s_per_m(&self, p_m: f64) -> f64 {
        let s = (p_m / self.depth_m).clamp(0.0, 1.0);
        self.greatest_damping_n_s_per_m * s * s * (3.0 - 2.0 * s)
    }

    /// Penetration (m) under a static force.
    pub fn penetration_m(&self, force_n: f64) -> f64 {
        (force_n / self.stiffness).powf(1.0 / self.exponent)
    }

    /// Tangent stiffness (N/m) at a penetration.
    pub fn tangent_n_per_m(&self, p_m: f64) -> f64 {
        if p_m <= 0.0 { 0.0 } else { self.exponent * self.stiffness * p_m.powf(self.exponent - 1.0) }
    }

    /// Force (N) and tangent stiffness (N/m) of all touching pairs at an approach and its rate: the
    /// teeth are rigid, and each pair has a contact of its own.
    pub fn mesh_force(&self, pairs: &Pairs, approach_m: f64, rate_m_per_s: f64) -> (f64, f64) {
        pairs.as_slice().iter().fold((0.0, 0.0), |(force, stiffness), pair| {
            let p = approach_m - pair.gap_m;
            (force + self.force_n(p, rate_m_per_s), stiffness + self.tangent_n_per_m(p))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::GearGeometry;

    /// 34 / 73 teeth, module 3: K = 1.65e10 N/m^1.5; at 730 N penetration 12.5 µm and tangent
    /// stiffness 0.87e8 N/m (0.45e8 at 100 N, 1.66e8 at 5 kN), and 4 % of c_max act at d = 0.1 mm.
    #[test]
    fn literature_tangent_stiffness_of_the_impact_law() {
        let gear = |teeth| GearGeometry::new("gear", teeth, 3e-3, 20_f64.to_radians(), 0.02, 0.01).unwrap();
        let pair = PairGeometry::new(gear(34), gear(73), 0.0).unwrap();
        let law = Impact::usual(&pair, &Material { youngs_modulus_pa: 2.06e11, poisson_ratio: 0.3 });
        assert!((law.stiffness / 1.65e10 - 1.0).abs() < 0.01, "{}", law.stiffness);
        for (force, tangent) in [(100.0, 0.45e8), (730.0, 0.87e8), (5000.0, 1.66e8)] {
            let found = law.tangent_n_per_m(law.penetration_m(force));
            assert!((found / tangent - 1.0).abs() < 0.01, "{found} at {force} N");
        }
        let p = law.penetration_m(730.0);
        assert!((p - 12.5e-6).abs() < 0.1e-6, "{p}");
        assert!((law.damping_n_s_per_m(p) / law.greatest_damping_n_s_per_m - 0.04).abs() < 0.005);
        assert_eq!(law.force_n(p, -1e9), 0.0, "a contact never pulls");
    }
}
