//! The tooth as a cantilever of varying section: bending, shear and axial compression by the
//! potential-energy method (Yang & Lin 1987; shear: Tian 2004; root between base and root circle:
//! Liang, Zuo & Pandey 2014), integrated numerically.
//!
//! With the contact at height y_C and half thickness h_C and the load angle α₁, a section at y
//! carries the moment `M = (y_C − y) cos α₁ − h_C sin α₁`, so that `1/k_b = ∫ M²/(E I) dy`,
//! `1/k_s = ∫ 1.2 cos²α₁/(G A) dy`, `1/k_a = ∫ sin²α₁/(E A) dy`. M² splits into cumulative
//! integrals of 1/I, y/I and y²/I: all contact points cost one pass over the tooth.

use crate::faults::ToothDamage;
use crate::geometry::{GearGeometry, fillet_range};
use crate::hertz::Material;

/// Form of the tooth between the root circle and the involute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Root {
    /// Parallel sides from the base circle down to the root circle (none where the root circle is
    /// the larger): the classical form.
    Straight,
    /// The trochoid that a rack with round tips generates (Ma et al. 2014).
    Fillet,
}

/// Compliances (m/N) of one tooth at one contact point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Flexure {
    /// Bending 1/k_b.
    pub bending: f64,
    /// Shear 1/k_s.
    pub shear: f64,
    /// Axial compression 1/k_a.
    pub axial: f64,
}

impl Flexure {
    /// All three in series (m/N).
    pub fn total(&self) -> f64 {
        self.bending + self.shear + self.axial
    }
}

/// Five-point Gauss–Legendre rule on (0, 1).
const GAUSS: [(f64, f64); 5] = [
    (0.046_910_077_030_668_0, 0.118_463_442_528_094_54),
    (0.230_765_344_947_158_45, 0.239_314_335_249_683_23),
    (0.5, 0.284_444_444_444_444_44),
    (0.769_234_655_052_841_5, 0.239_314_335_249_683_23),
    (0.953_089_922_969_332, 0.118_463_442_528_094_54),
];
/// Two-point rule, enough between neighbouring points of a table: the error of 1/160 of a mesh
/// cycle is below 1e-9.
const GAUSS_SHORT: [(f64, f64); 2] = [(0.211_324_865_405_187_13, 0.5), (0.788_675_134_594_812_9, 0.5)];
/// Cells of the root piece, and of a whole flank as far as it lies below the first contact point;
/// five Gauss points each. Whole teeth are smooth there: the compliance differs by less than 1e-9
/// from that of many more cells. A crack or a pit ends somewhere within.
const SMOOTH_CELLS: usize = 10;
const DAMAGED_CELLS: usize = 48;

fn cells(damage: &ToothDamage) -> usize {
    if damage.crack.is_none() && damage.pits.is_empty() && damage.spall.is_none() {
        SMOOTH_CELLS
    } else {
        DAMAGED_CELLS
    }
}

/// Integrals from the root up to some height: ∫1/I, ∫y/I, ∫y²/I (y from the root), ∫1/A.
#[derive(Clone, Copy, Default)]
struct Sums([f64; 4]);

/// The shape of a gear's teeth.
#[derive(Clone, Debug, PartialEq)]
pub struct ToothProfile {
    gear: GearGeometry,
    root: Root,
    /// Load angle at which the involute begins.
    involute_start_rad: f64,
    /// Height of the root above the gear centre (m), the datum of y in the integrals.
    root_height_m: f64,
}

impl ToothProfile {
    /// The teeth of a gear. An undercut gear has no generated fillet that meets the involute
    /// smoothly: it gets the straight root, and a warning says so.
    pub fn new(which: &str, gear: &GearGeometry, root: Root, warnings: &mut Vec<String>) -> Self {
        if gear.internal {
            // The flank goes down to the root circle.
            let involute_start_rad = gear.load_angle_rad(gear.roll_at_radius_m(gear.root_radius_m));
            let root_height_m = gear.flank_point_m(involute_start_rad).0;
            return Self { gear: gear.clone(), root: Root::Straight, involute_start_rad, root_height_m };
        }
        let start = match root {
            Root::Fillet => gear.involute_start_radius_m(),
            Root::Straight => None,
        };
        let root = if root == Root::Fillet && start.is_none() {
            warnings.push(format!(
                "{which}: a rack undercuts a gear with {} teeth; its root is modelled with straight sides",
                gear.teeth
            ));
            Root::Straight
        } else {
            root
        };
        let start_radius = start.unwrap_or(gear.base_radius_m.max(gear.root_radius_m));
        let involute_start_rad = gear.load_angle_rad(gear.roll_at_radius_m(start_radius));
        let mut profile = Self { gear: gear.clone(), root, involute_start_rad, root_height_m: 0.0 };
        profile.root_height_m = match root {
            Root::Fillet => profile.fillet_point(0.0).0,
            Root::Straight if gear.root_radius_m < gear.base_radius_m => profile.straight_root_m().0,
            Root::Straight => gear.flank_point_m(involute_start_rad).0,
        };
        profile
    }

    /// Lower and upper end of the straight root piece and its half thickness (m).
    fn straight_root_m(&self) -> (f64, f64, f64) {
        let gear = &self.gear;
        let (sin, cos) = gear.half_base_angle_rad.sin_cos();
        let half = gear.base_radius_m * sin;
        let low = (gear.root_radius_m * gear.root_radius_m - half * half).max(0.0).sqrt();
        (low, gear.base_radius_m * cos, half)
    }

    /// Height, half thickness and d(height)/dt of the generated fillet at `t` in 0 (root) … 1
    /// (start of the involute).
    ///
    /// `h = r sin ψ − (A₁/sin γ + ρ) cos(γ − ψ)`, `y = r cos ψ − (A₁/sin γ + ρ) sin(γ − ψ)`,
    /// `ψ = (A₁/tan γ + B₁)/r`; `A₁ = (h_a* + c* − x) m − ρ` is how far the middle of the rack's
    /// round tip lies below its rolling line.
    fn fillet_point(&self, t: f64) -> (f64, f64, f64) {
        let gear = &self.gear;
        let m = gear.module_m;
        let (sin_0, cos_0) = gear.pressure_angle_rad.sin_cos();
        let rho = gear.clearance * m / (1.0 - sin_0);
        let a1 = (gear.addendum + gear.clearance - gear.profile_shift) * m - rho;
        let b1 = std::f64::consts::PI * m / 4.0 + gear.addendum * m * sin_0 / cos_0 + rho * cos_0;
        let (from, to) = fillet_range(gear);
        let gamma = from + t * (to - from);
        let r = gear.reference_radius_m;
        let (sin_g, cos_g) = gamma.sin_cos();
        let psi = (a1 * cos_g / sin_g + b1) / r;
        let arm = a1 / sin_g + rho;
        let (sin_d, cos_d) = (gamma - psi).sin_cos();
        let psi_rate = -a1 / (r * sin_g * sin_g);
        let arm_rate = -a1 * cos_g / (sin_g * sin_g);
        let y_rate = -r * psi.sin() * psi_rate - arm_rate * sin_d - arm * cos_d * (1.0 - psi_rate);
        (r * psi.cos() - arm * sin_d, r * psi.sin() - arm * cos_d, y_rate * (to - from))
    }

    /// Height above the gear's centre and half thickness (m) of sections of the generated fillet,
    /// root first; none of a straight root.
    pub(crate) fn fillet_sections(&self, count: usize) -> Vec<(f64, f64)> {
        if self.root == Root::Straight {
            return Vec::new();
        }
        (0..=count)
            .map(|i| self.fillet_point(i as f64 / count as f64))
            .map(|(height, half, _)| (height, half))
            .collect()
    }

    /// Height, half thickness and d(height)/da of the involute at load angle `a`; of an internal
    /// tooth d(height)/d(−a).
    fn involute_point(&self, a: f64) -> (f64, f64, f64) {
        let (sin, cos) = a.sin_cos();
        let (y, h) = self.gear.flank_point_of(a, (sin, cos));
        (y, h, self.gear.base_radius_m * (a + self.gear.half_base_angle_rad) * cos)
    }

    /// Adds the integrals over one cell of a curve `t ↦ (y, h, dy/dt)`.
    fn add_cell(
        &self,
        sums: &mut Sums,
        damage: &ToothDamage,
        rule: &[(f64, f64)],
        curve: impl Fn(f64) -> (f64, f64, f64),
        (from, to): (f64, f64),
    ) {
        for &(node, weight) in rule {
            let (y, h, rate) = curve(from + node * (to - from));
            let dy = rate * weight * (to - from);
            let (area, inertia) = damage.section(&self.gear, y, h);
            let lever = y - self.root_height_m;
            sums.0[0] += dy / inertia;
            sums.0[1] += lever * dy / inertia;
            sums.0[2] += lever * lever * dy / inertia;
            sums.0[3] += dy / area;
        }
    }

    /// Integrals from the root to the start of the involute.
    fn root_sums(&self, damage: &ToothDamage, cells: usize) -> Sums {
        let mut sums = Sums::default();
        match self.root {
            Root::Fillet => {
                for cell in 0..cells {
                    let at = |i: usize| i as f64 / cells as f64;
                    self.add_cell(&mut sums, damage, &GAUSS, |t| self.fillet_point(t), (at(cell), at(cell + 1)));
                }
            }
            Root::Straight if !self.gear.internal && self.gear.root_radius_m < self.gear.base_radius_m => {
                let (low, high, half) = self.straight_root_m();
                for cell in 0..cells {
                    let at = |i: usize| low + (high - low) * i as f64 / cells as f64;
                    self.add_cell(&mut sums, damage, &GAUSS, |y| (y, half, 1.0), (at(cell), at(cell + 1)));
                }
            }
            Root::Straight => {}
        }
        sums
    }

    /// Compliances at contact points given by their load angles, in their order from root to tip.
    /// Points below the start of the involute are taken at its start.
    pub fn flexure(&self, material: &Material, damage: &ToothDamage, load_angles_rad: &[f64]) -> Vec<Flexure> {
        self.flexure_by(cells(damage), material, damage, load_angles_rad)
    }

    fn flexure_by(
        &self,
        most_cells: usize,
        material: &Material,
        damage: &ToothDamage,
        load_angles_rad: &[f64],
    ) -> Vec<Flexure> {
        let mut sums = self.root_sums(damage, most_cells);
        // Points of a fine table are nearer than this share of a flank.
        let near = 0.5 / DAMAGED_CELLS as f64;
        // The load angle grows from root to tip, on internal teeth from tip to root.
        let sign = if self.gear.internal { -1.0 } else { 1.0 };
        let start = sign * self.involute_start_rad;
        let tip = sign * self.gear.load_angle_rad(self.gear.roll_at_radius_m(self.gear.tip_radius_m));
        let mut at = start;
        let mut out = Vec::with_capacity(load_angles_rad.len());
        for &angle in load_angles_rad {
            let angle = (sign * angle).max(start);
            if angle > at {
                // Many short cells up to the first contact point, one cell between neighbouring
                // points of a fine table.
                let share = (angle - at) / (tip - at);
                let cells = (share * most_cells as f64).ceil().max(1.0);
                let rule: &[(f64, f64)] = if share < near { &GAUSS_SHORT } else { &GAUSS };
                let step = (angle - at) / cells;
                for cell in 0..cells as usize {
                    let from = at + step * cell as f64;
                    self.add_cell(&mut sums, damage, rule, |a| self.involute_point(sign * a), (from, from + step));
                }
                at = angle;
            }
            out.push(self.flexure_from(&sums, material, sign * angle));
        }
        out
    }

    fn flexure_from(&self, sums: &Sums, material: &Material, load_angle_rad: f64) -> Flexure {
        let (sin, cos) = load_angle_rad.sin_cos();
        let (y, h) = self.gear.flank_point_of(load_angle_rad, (sin, cos));
        let y = y - self.root_height_m;
        let [i0, i1, i2, a0] = sums.0;
        let moment_2 =
            cos * cos * (y * y * i0 - 2.0 * y * i1 + i2) - 2.0 * cos * sin * h * (y * i0 - i1) + h * h * sin * sin * i0;
        Flexure {
            bending: moment_2 / material.youngs_modulus_pa,
            shear: 1.2 * cos * cos * a0 / material.shear_modulus_pa(),
            axial: sin * sin * a0 / material.youngs_modulus_pa,
        }
    }
}

#[cfg(test)]
mod rack;

#[cfg(test)]
mod tests {
    use super::*;

    /// Teeth of 17 to 200, generated and straight roots: few cells give what many give, a
    /// thousandth of the 1e-6 to which mesh stiffness agrees with independent integration.
    #[test]
    fn oracle_few_cells_are_enough_for_whole_teeth() {
        let material = Material { youngs_modulus_pa: 2.06e11, poisson_ratio: 0.3 };
        let mut worst = 0.0_f64;
        for teeth in [17, 23, 41, 80, 200] {
            for root in [Root::Fillet, Root::Straight] {
                let gear = GearGeometry::new("gear", teeth, 2e-3, 20f64.to_radians(), 0.02, 0.008).unwrap();
                let profile = ToothProfile::new("gear", &gear, root, &mut Vec::new());
                let top = gear.load_angle_rad(gear.roll_at_radius_m(gear.tip_radius_m));
                let angles: Vec<f64> = [0.2, 0.5, 0.9, 1.0].iter().map(|share| share * top).collect();
                let by = |cells| profile.flexure_by(cells, &material, &ToothDamage::default(), &angles);
                for (few, many) in by(SMOOTH_CELLS).iter().zip(by(16 * DAMAGED_CELLS)) {
                    worst = worst.max((few.total() / many.total() - 1.0).abs());
                }
            }
        }
        assert!(worst < 1e-9, "{worst:.1e}");
    }
}
