//! Rolling elements under a shaft: Hertzian contacts that carry where the rings come near enough.
//!
//! # Formula
//! T. A. Harris, M. N. Kotzalas, Rolling Bearing Analysis (2007), chapter 7: the inner ring
//! displaced by u brings the rings together by `δ_i = u · e_i − P_d/2` at the element i, and
//!
//! ```text
//! F = Σ K δ_i^n e_i over δ_i > 0        n = 3/2 for balls, 10/9 for rollers        K = (K_i^{−1/n} + K_o^{−1/n})^{−n}
//! ψ_i = 2π i/Z + φ, φ turning with the cage
//! ```
//!
//! so that the stiffness repeats with the elements that pass, without a defect. A ball's contact is
//! that of D. E. Brewe, B. J. Hamrock, J. Lubr. Technol. 99 (1977) 485:
//!
//! ```text
//! κ = 1.0339 (R_y/R_x)^0.636    E = 1.0003 + 0.5968 R_x/R_y    F = 1.5277 + 0.6023 ln(R_y/R_x)
//! K = π κ E' √(R E / (4.5 F³)),    1/R = 1/R_x + 1/R_y,    E' = E_steel/(1 − ν²)
//! R_x = d (1 ∓ γ)/2, γ = d/D_p at the inner and outer ring,    R_y = f d/(2f − 1)
//! ```
//!
//! and a roller's that of G. Lundberg and A. Palmgren in Harris's form: `8.06e4 l^{8/9}`
//! N/mm^{10/9}.

use std::f64::consts::{PI, TAU};

use gearwatch_core::bench::{Bearing, GearMaterial, Rolling};

use crate::springs::{Force, Pair};

/// Cage angles within a passage over which the mean law is taken.
const MEAN: u32 = 8;

/// The elements of a bearing as springs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Elements {
    count: u32,
    /// `K` (N/mⁿ).
    coefficient: f64,
    exponent: f64,
    /// `P_d` (m).
    pub(crate) clearance_m: f64,
    /// Turns of the cage, counter-clockwise seen from the motor, per revolution of the first shaft.
    cage_order: f64,
}

/// Stiffness of a ball's contact with the inner (−1) or outer (1) ring (N/m^1.5).
fn ball(diameter_m: f64, pitch_m: f64, conformity: f64, ring: f64) -> f64 {
    let GearMaterial { youngs_modulus_pa, poisson_ratio, .. } = GearMaterial::default();
    let modulus = youngs_modulus_pa / (1.0 - poisson_ratio * poisson_ratio);
    let x = 0.5 * diameter_m * (1.0 + ring * diameter_m / pitch_m);
    let y = conformity * diameter_m / (2.0 * conformity - 1.0);
    let ratio = y / x;
    let (kappa, e, f) = (1.0339 * ratio.powf(0.636), 1.0003 + 0.5968 / ratio, 1.5277 + 0.6023 * ratio.ln());
    PI * kappa * modulus * (e / ((1.0 / x + 1.0 / y) * 4.5 * f.powi(3))).sqrt()
}

impl Elements {
    /// Of a bearing of steel whose shaft has an order and a sense. None without a geometry.
    pub(crate) fn new(bearing: &Bearing, rolling: &Rolling, shaft_order: f64, sense: f64) -> Option<Self> {
        let (diameter, pitch) = (1e-3 * bearing.element_mm?, 1e-3 * bearing.pitch_mm?);
        let (exponent, [inner, outer]) = match rolling.roller_mm {
            Some(length) => (10.0 / 9.0, [8.06e4 * length.powf(8.0 / 9.0) * 1e3_f64.powf(10.0 / 9.0); 2]),
            None => (1.5, [-1.0, 1.0].map(|ring| ball(diameter, pitch, rolling.conformity, ring))),
        };
        let compliance = |k: f64| k.powf(-1.0 / exponent);
        Some(Self {
            count: bearing.elements?,
            coefficient: (compliance(inner) + compliance(outer)).powf(-exponent),
            exponent,
            clearance_m: 1e-6 * rolling.clearance_um,
            cage_order: bearing.orders()?.cage * shaft_order * sense,
        })
    }

    /// The same with the contacts stiffer by a factor, and with a wider clearance (m).
    pub(crate) fn changed(self, factor: f64, wider_m: f64) -> Self {
        Self { coefficient: factor * self.coefficient, clearance_m: self.clearance_m + wider_m, ..self }
    }

    /// Force against a displacement where the cage stands at an angle (rad).
    fn at_cage(&self, u: Pair, cage_rad: f64) -> Force {
        let mut out = Force::default();
        for i in 0..self.count {
            let (sin, cos) = (cage_rad + TAU * f64::from(i) / f64::from(self.count)).sin_cos();
            let near = u[0] * cos + u[1] * sin - 0.5 * self.clearance_m;
            if near <= 0.0 {
                continue;
            }
            let slope = self.coefficient * near.powf(self.exponent - 1.0);
            for (a, along) in [cos, sin].into_iter().enumerate() {
                out.force[a] += slope * near * along;
                for (b, other) in [cos, sin].into_iter().enumerate() {
                    out.by_deflection[a][b] += self.exponent * slope * along * other;
                }
            }
        }
        out
    }

    /// Force against a displacement at an angle of the first shaft (rad); its mean over the passage
    /// of an element where none is given.
    pub(crate) fn at(&self, u: Pair, reference_rad: Option<f64>) -> Force {
        if let Some(reference) = reference_rad {
            return self.at_cage(u, self.cage_order * reference);
        }
        let mut out = Force::default();
        for k in 0..MEAN {
            let part = self.at_cage(u, TAU * f64::from(k) / f64::from(MEAN * self.count));
            for a in 0..2 {
                out.force[a] += part.force[a] / f64::from(MEAN);
                for b in 0..2 {
                    out.by_deflection[a][b] += part.by_deflection[a][b] / f64::from(MEAN);
                }
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bearing(elements: u32) -> Bearing {
        Bearing {
            name: "b".into(),
            shaft: "s".into(),
            elements: Some(elements),
            element_mm: Some(7.94),
            pitch_mm: Some(39.04),
            contact_deg: 0.0,
            orders: None,
        }
    }

    fn elements(count: u32, clearance_um: f64, roller_mm: Option<f64>) -> Elements {
        let rolling = Rolling { clearance_um, conformity: 0.52, roller_mm };
        Elements::new(&bearing(count), &rolling, 1.0, 1.0).expect("a geometry")
    }

    /// `Q_max Z / F` of Stribeck for balls without clearance 4.37 and for rollers 4.08, and the
    /// radial load integral `J_r(ε)` of Harris & Kotzalas, table 7.1, of which they are
    /// `1/J_r(0.5)`, with clearance: `ε = ½ (1 − P_d/(2 δ_r))`. The table takes n = 1.1 of lines.
    /// Its four digits, with elements so many that the sum is the integral. Stribeck's 5 for
    /// bearings in practice lies between ε = 0.4 and 0.3.
    #[test]
    fn literature_load_distribution_of_harris() {
        let table = [(0.5, 0.2288, 0.2453), (0.4, 0.2117, 0.2286), (0.3, 0.1892, 0.2055), (0.2, 0.1590, 0.1737)];
        for (epsilon, point, line) in table {
            for (roller, integral) in [(None, point), (Some(9.6), line)] {
                let displaced = 20e-6;
                let clearance_um = 2e6 * displaced * (1.0 - 2.0 * epsilon);
                let mut bearing = elements(900, clearance_um, roller);
                if roller.is_some() {
                    bearing.exponent = 1.1;
                }
                let most = bearing.coefficient * (displaced - 0.5 * bearing.clearance_m).powf(bearing.exponent);
                let force = bearing.at([displaced, 0.0], None).force[0];
                let found = force / (900.0 * most);
                assert!((found / integral - 1.0).abs() < 1e-3, "{epsilon} {roller:?}: {found} {integral}");
            }
        }
        let stribeck = |integral: f64| 1.0 / integral;
        assert!((stribeck(0.2288) - 4.37).abs() < 0.005 && (stribeck(0.2453) - 4.08).abs() < 0.005);
        assert!(stribeck(0.2117) < 5.0 && stribeck(0.1892) > 5.0);
    }

    /// Complete elliptic integrals by the arithmetic-geometric mean, of the modulus k² = m.
    fn elliptic(m: f64) -> (f64, f64) {
        let (mut a, mut b, mut sum, mut power) = (1.0, (1.0 - m).sqrt(), 0.5 * m, 0.5);
        for _ in 0..40 {
            let c = 0.5 * (a - b);
            (a, b) = (0.5 * (a + b), f64::sqrt(a * b));
            power *= 2.0;
            sum += power * c * c;
        }
        let first = PI / (2.0 * a);
        (first, first * (1.0 - sum))
    }

    /// Brewe and Hamrock's fit against Hertz' solution with elliptic integrals: 3 %, as they say.
    ///
    /// # Formula
    /// `κ² = (2 F − E (1 + Γ)) / (E (1 − Γ))`, `Γ = R (1/R_x − 1/R_y)`, `m = 1 − 1/κ²`.
    #[test]
    fn oracle_contact_of_a_ball_by_elliptic_integrals() {
        for ring in [-1.0, 1.0] {
            let (d, pitch, f): (f64, f64, f64) = (7.94e-3, 39.04e-3, 0.52);
            let (x, y) = (0.5 * d * (1.0 + ring * d / pitch), f * d / (2.0 * f - 1.0));
            let r = 1.0 / (1.0 / x + 1.0 / y);
            let gamma = r * (1.0 / x - 1.0 / y);
            let mut kappa = (y / x).powf(0.636);
            for _ in 0..200 {
                let (first, second) = elliptic(1.0 - 1.0 / (kappa * kappa));
                kappa = ((2.0 * first - second * (1.0 + gamma)) / (second * (1.0 - gamma))).sqrt();
            }
            let (first, second) = elliptic(1.0 - 1.0 / (kappa * kappa));
            let modulus = 2.06e11 / (1.0 - 0.09);
            let expected = PI * kappa * modulus * (r * second / (4.5 * first.powi(3))).sqrt();
            let found = ball(d, pitch, f, ring);
            assert!((found / expected - 1.0).abs() < 0.03, "{ring}: {found:.4e} {expected:.4e}");
        }
    }

    /// The slope is the derivative of the force, and the force repeats when the cage turns by one
    /// element. Differences of 1e-11 m have the root at the edge of the load zone to 1e-6 and lose
    /// no more by rounding.
    #[test]
    fn analytic_slope_and_passage() {
        let bearing = elements(9, 6.0, None);
        let (u, h) = ([14e-6, -9e-6], 1e-11);
        for angle in [0.0, 0.3, 1.1] {
            let at = bearing.at(u, Some(angle));
            for b in 0..2 {
                let moved = |by: f64| {
                    let mut u = u;
                    u[b] += by;
                    bearing.at(u, Some(angle)).force
                };
                for a in 0..2 {
                    let slope = (moved(h)[a] - moved(-h)[a]) / (2.0 * h);
                    assert!((slope - at.by_deflection[a][b]).abs() < 1e-6 * at.by_deflection[0][0], "{slope}");
                }
            }
            let passage = TAU / (9.0 * bearing.cage_order);
            let next = bearing.at(u, Some(angle + passage));
            assert!((next.force[0] - at.force[0]).abs() < 1e-9 * at.force[0]);
        }
    }

    /// The bench with shafts that bend, with rolling elements under its input shaft.
    fn bench(clearance_um: f64) -> gearwatch_core::bench::Bench {
        let mut bench = crate::shipped::bench("bending-shafts").expect("shipped");
        bench.effects.clear();
        bench.bearings.push(Bearing { name: "other".into(), ..bench.bearings[0].clone() });
        let supports = &mut bench.shafts[0].beam.as_mut().expect("sections").supports;
        supports[1].bearing = Some("other".into());
        for support in supports {
            support.rolling = Some(Rolling { clearance_um, conformity: 0.52, roller_mm: None });
        }
        assert_eq!(bench.problems(), Vec::<String>::new());
        bench
    }

    fn model(bench: &gearwatch_core::bench::Bench) -> crate::model::TrainModel {
        use crate::rotation::Profile;
        let setup = crate::setup::SimSetup::nominal(bench);
        crate::model::TrainModel::new(&setup, Profile::constant(25.0), Profile::constant(120.0), 1).expect("a model")
    }

    /// At rest the elements carry what the lever arms ask for: the input shaft has one gear between
    /// two supports. 1e-6: the position of rest leaves 1e-9 of all loads.
    #[test]
    fn analytic_elements_carry_the_reactions() {
        let bench = bench(8.0);
        let model = model(&bench);
        let rest = model.static_state().expect("rest");
        let beam = bench.shafts[0].beam.as_ref().expect("sections");
        let [a, b] = [0, 1].map(|i| beam.supports[i].at_mm);
        let force = 120.0 * model.force_per_torque[0];
        for (spring, share) in model.springs().iter().zip([(b - 90.0) / (b - a), (90.0 - a) / (b - a)]) {
            let carried = spring.rolling.expect("elements").at(spring.motion(&rest).0, None).force;
            let found = carried[0].hypot(carried[1]);
            assert!((found / (share * force) - 1.0).abs() < 1e-6, "{found} {}", share * force);
        }
    }

    /// Elements that pass shake the shaft at their order without a defect. The line there is a
    /// thousand times what the same bench has there with springs in their place.
    #[test]
    fn analytic_elements_that_pass_make_their_line() {
        let rolling = bench(8.0);
        let mut springs = rolling.clone();
        let beam = springs.shafts[0].beam.as_mut().expect("sections");
        beam.supports.iter_mut().for_each(|support| support.rolling = None);
        let order = rolling.bearings[0].orders().expect("a geometry").outer;
        let [with, without] = [&rolling, &springs].map(|bench| {
            let model = model(bench);
            let mut rk4 = crate::rk4::Rk4::new(&model, 1.0 / (8.0 * 16_384.0)).expect("stable");
            let (mut samples, mut angles) = (Vec::new(), Vec::new());
            for n in 0..(0.9 * 8.0 * 16_384.0) as u32 {
                rk4.step_located().expect("steps");
                if n % 16 == 0 && f64::from(n) > 0.4 * 8.0 * 16_384.0 {
                    samples.push(rk4.sensor(0));
                    angles.push(model.rotation.at(f64::from(n + 1) / (8.0 * 16_384.0)).0);
                }
            }
            crate::lines::line(&samples, &angles, order).norm()
        });
        assert!(with > 1e3 * without && with > 1e-3, "{with} {without}");
    }

    /// A clearance takes the springs of the supports away, and rolling elements stand in place of
    /// them: both would do so twice.
    #[test]
    fn conform_a_clearance_beside_rolling_elements_is_refused() {
        use crate::rotation::Profile;
        use gearwatch_core::bench::term::{SpringLaw, Term};
        let mut term = Term::spring(SpringLaw::Clearance, "input.bearing", 0.0);
        term.parameters = [("gap_m".to_owned(), 1e-5)].into();
        let model = |bench: &gearwatch_core::bench::Bench| {
            let mut setup = crate::setup::SimSetup::nominal(bench);
            crate::terms::apply(&term, &mut setup).expect("a term");
            crate::model::TrainModel::new(&setup, Profile::constant(25.0), Profile::constant(120.0), 1)
        };
        let said = model(&bench(8.0)).expect_err("refused").to_string();
        assert!(said.contains("rolling.clearance_um"), "{said}");
        let mut springs = bench(8.0);
        let beam = springs.shafts[0].beam.as_mut().expect("sections");
        beam.supports.iter_mut().for_each(|support| support.rolling = None);
        assert!(model(&springs).is_ok());
    }
}
