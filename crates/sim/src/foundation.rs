//! Compliance of the gear body under a tooth: fillet-foundation after Sainsot, Velex & Duverger
//! 2004 (J. Mech. Des. 126:748–752).
//!
//! `1/k_f = cos²α₁/(E L) { L* (u_f/S_f)² + M* (u_f/S_f) + P* (1 + Q* tan²α₁) }`

use crate::geometry::GearGeometry;
use crate::hertz::Material;

/// Coefficients A…F of `X*(h, θ) = A/θ² + B h² + C h/θ + D/θ + E h + F` for L*, M*, P*, Q*, with
/// the range of values that the polynomials were fitted to.
const POLYNOMIALS: [(&str, [f64; 6], [f64; 2]); 4] = [
    ("L*", [-5.574e-5, -1.9986e-3, -2.3015e-4, 4.7702e-3, 0.0271, 6.8045], [6.82, 6.94]),
    ("M*", [60.111e-5, 28.100e-3, -83.431e-4, -9.9256e-3, 0.1624, 0.9086], [1.08, 3.29]),
    ("P*", [-50.952e-5, 185.50e-3, 0.0538e-4, 53.300e-3, 0.2895, 0.9236], [2.56, 13.47]),
    ("Q*", [-6.2042e-5, 9.0889e-3, -4.0964e-4, 7.8297e-3, -0.1472, 0.6904], [0.141, 0.62]),
];

/// Ratio root radius / bore radius for which the polynomials hold.
const RADIUS_RATIO: [f64; 2] = [1.4, 7.0];
/// Half of the tooth's angle at the root (rad) for which the polynomials were made.
const ROOT_ANGLE_RAD: [f64; 2] = [0.01, 0.12];

/// The polynomials L*, M*, P*, Q* as published, without any check of their range.
pub fn sainsot_polynomials(radius_ratio: f64, root_angle_rad: f64) -> [f64; 4] {
    let (h, t) = (radius_ratio, root_angle_rad);
    POLYNOMIALS.map(|(_, [a, b, c, d, e, f], _)| a / (t * t) + b * h * h + c * h / t + d / t + e * h + f)
}

/// The body of one gear under one tooth.
#[derive(Clone, Debug, PartialEq)]
pub struct Foundation {
    /// L*, M*, P*, Q* in use.
    pub coefficients: [f64; 4],
    /// Half of the tooth's angle at the root circle θ_f (rad).
    pub root_angle_rad: f64,
    /// Tooth thickness at the root circle, `S_f = 2 r_f θ_f` (m).
    pub root_thickness_m: f64,
}

impl Foundation {
    /// The foundation of a gear; `which` names it in the warnings that are added where a parameter
    /// lies outside the fitted range.
    ///
    /// `θ_f = (1/z)[π/2 + 2 tan α₀ (h_a* − ρ*) + 2 ρ*/cos α₀]`, `ρ* = c*/(1 − sin α₀)`,
    /// `h = r_f / r_bore`. Profile shift moves the rack across its rolling line, not along it: θ_f
    /// stays, r_f and with it the thickness `2 r_f θ_f` grow. A radius ratio outside 1.4–7 and a
    /// coefficient outside the range that it was fitted to are held at the limit.
    pub fn new(which: &str, gear: &GearGeometry, warnings: &mut Vec<String>) -> Self {
        if gear.internal {
            return Self::half_plane(gear);
        }
        let (sin, cos) = gear.pressure_angle_rad.sin_cos();
        let fillet = gear.clearance / (1.0 - sin);
        let root_angle_rad =
            (std::f64::consts::FRAC_PI_2 + 2.0 * sin / cos * (gear.addendum - fillet) + 2.0 * fillet / cos)
                / f64::from(gear.teeth);
        let ratio = gear.root_radius_m / gear.bore_radius_m;
        let held = ratio.clamp(RADIUS_RATIO[0], RADIUS_RATIO[1]);
        if held != ratio {
            warnings.push(format!(
                "{which}: root radius / bore radius is {ratio:.2}; the foundation formula holds from {} to {}, \
                 so {held} is used (the compliance of the body has no validated value here)",
                RADIUS_RATIO[0], RADIUS_RATIO[1]
            ));
        }
        if !(ROOT_ANGLE_RAD[0]..=ROOT_ANGLE_RAD[1]).contains(&root_angle_rad) {
            warnings.push(format!(
                "{which}: with {} teeth the half tooth angle at the root is {root_angle_rad:.3} rad; the foundation formula \
                 was made for {} to {} rad (its coefficients are checked against their fitted ranges)",
                gear.teeth, ROOT_ANGLE_RAD[0], ROOT_ANGLE_RAD[1]
            ));
        }
        let mut coefficients = sainsot_polynomials(held, root_angle_rad);
        for (value, (name, _, [low, high])) in coefficients.iter_mut().zip(POLYNOMIALS) {
            if *value < low || *value > high {
                warnings.push(format!(
                    "{which}: foundation coefficient {name} = {value:.4} lies outside its fitted range {low} to {high} and is held there"
                ));
                *value = value.clamp(low, high);
            }
        }
        Self { coefficients, root_angle_rad, root_thickness_m: 2.0 * gear.root_radius_m * root_angle_rad }
    }

    /// The rim of an internal gear, thick by the tooth, as a half plane.
    ///
    /// # Formula
    /// R. W. Cornell, "Compliance and stress sensitivity of spur gear teeth", J. Mech. Des. 103
    /// (1981) 447, plane stress: `L* = 16.67/π`, `M* = 2 (1 − ν)`, `P* = 1.534`,
    /// `Q* = 1/(2.4 (1 + ν))` with ν = 0.3, in the form of Sainsot's, of which it is the limit of
    /// an infinite body.
    fn half_plane(gear: &GearGeometry) -> Self {
        const POISSON: f64 = 0.3;
        let half = gear.half_root_m();
        Self {
            coefficients: [16.67 / std::f64::consts::PI, 2.0 * (1.0 - POISSON), 1.534, 1.0 / (2.4 * (1.0 + POISSON))],
            root_angle_rad: half / gear.root_radius_m,
            root_thickness_m: 2.0 * half,
        }
    }

    /// Compliance 1/k_f (m/N) under a force at load angle α₁ whose line crosses the tooth's centre
    /// line `lever_m` above the root circle (u_f).
    pub fn compliance_m_per_n(&self, material: &Material, face_width_m: f64, load_angle_rad: f64, lever_m: f64) -> f64 {
        self.compliance_of(material, face_width_m, load_angle_rad.sin_cos(), lever_m)
    }

    /// As [`Self::compliance_m_per_n`], from sine and cosine of the load angle.
    pub(crate) fn compliance_of(
        &self,
        material: &Material,
        face_width_m: f64,
        (sin, cos): (f64, f64),
        lever_m: f64,
    ) -> f64 {
        let [l, m, p, q] = self.coefficients;
        let ratio = lever_m / self.root_thickness_m;
        let tan = sin / cos;
        cos * cos / (material.youngs_modulus_pa * face_width_m)
            * (l * ratio * ratio + m * ratio + p * (1.0 + q * tan * tan))
    }
}

/// Lever u_f (m) from the root circle to where the force line crosses the tooth's centre line:
/// `r_b / cos α₁ − r_f`.
pub fn lever_m(gear: &GearGeometry, load_angle_rad: f64) -> f64 {
    lever_of(gear, load_angle_rad.cos())
}

/// As [`lever_m`], from the cosine of the load angle.
pub(crate) fn lever_of(gear: &GearGeometry, cos: f64) -> f64 {
    let height = gear.base_radius_m / cos - gear.root_radius_m;
    if gear.internal { -height } else { height }
}
