//! Springs and dampers of the train that are not linear: forces of [`gearwatch_core::bench::term`]
//! and of loose seats.
//!
//! # Formula
//! With the deflection u and its rate v (along one line, or x and y of a bearing, then |u| is the
//! length of the vector) the force against u is
//!
//! ```text
//! u², along a line   c u²            |v| v        c |v| v
//! |u| u              c |u| u         sgn v        c v/√(v² + corner²)
//! u³                 c |u|² u        dead zone    c (1 − gap/|u|)₊ u
//! clearance          −k u min(1, gap/|u|), and −d v for |u| < gap, with the k and d of the place: both act beyond the gap only
//! ```
//!
//! The force on the housing that a bearing passes on is the same with the opposite sign.

use gearwatch_core::bench::Bench;
use gearwatch_core::bench::term::{self, Entry, SpringLaw};
use nalgebra::DVector;

use crate::linear::{DIRECT_PATH_MASS_KG, Hold, LinearTrain, MeshGeometry};
use crate::model::problem::ModelError;
use crate::rolling::Elements;
use crate::terms::Scale;

/// A number along each of the lines of a spring; the second is 0 where there is one line.
pub(crate) type Pair = [f64; 2];

/// Derivative of the force along each line by the deflection along each (N/m or N m/rad).
pub(crate) type SpringSlope = [Pair; 2];

/// Form and size of the force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ForceLaw {
    pub(crate) law: SpringLaw,
    /// In SI units.
    pub(crate) coefficient: f64,
    /// Half width of the dead zone or clearance (m or rad).
    pub(crate) gap: f64,
    /// Rate at which `sgn v` is rounded off.
    pub(crate) corner: f64,
    /// The place's own stiffness and damping.
    pub(crate) own: (f64, f64),
}

/// A force at one instant with its derivatives.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Force {
    pub(crate) force: Pair,
    /// `∂force_i/∂u_j`.
    pub(crate) by_deflection: [Pair; 2],
    /// `∂force_i/∂v_j`.
    pub(crate) by_rate: [Pair; 2],
}

impl ForceLaw {
    /// The force at a deflection and its rate.
    pub(crate) fn at(&self, u: Pair, v: Pair) -> Force {
        let c = self.coefficient;
        let mut out = Force::default();
        let (s, w) = (u[0].hypot(u[1]), v[0].hypot(v[1]));
        match self.law {
            SpringLaw::Linear => radial(&mut out.force, &mut out.by_deflection, u, c, 0.0),
            SpringLaw::Square => {
                out.force[0] = c * u[0] * u[0];
                out.by_deflection[0][0] = 2.0 * c * u[0];
            }
            SpringLaw::SignedSquare => radial(&mut out.force, &mut out.by_deflection, u, c * s, over(c, s)),
            SpringLaw::Cube => radial(&mut out.force, &mut out.by_deflection, u, c * s * s, 2.0 * c),
            SpringLaw::Rate => radial(&mut out.force, &mut out.by_rate, v, c, 0.0),
            SpringLaw::SignedSquareRate => radial(&mut out.force, &mut out.by_rate, v, c * w, over(c, w)),
            SpringLaw::SignRate => {
                let root = 1.0 / (w * w + self.corner * self.corner).sqrt();
                radial(&mut out.force, &mut out.by_rate, v, c * root, -c * root * root * root);
            }
            SpringLaw::DeadZone => {
                if s > self.gap {
                    radial(
                        &mut out.force,
                        &mut out.by_deflection,
                        u,
                        c * (1.0 - self.gap / s),
                        over(c * self.gap, s * s * s),
                    );
                }
            }
            SpringLaw::Clearance => {
                let (k, d) = self.own;
                if s > self.gap {
                    radial(&mut out.force, &mut out.by_deflection, u, -k * self.gap / s, over(k * self.gap, s * s * s));
                } else {
                    radial(&mut out.force, &mut out.by_deflection, u, -k, 0.0);
                    for (axis, rate) in v.into_iter().enumerate() {
                        out.force[axis] -= d * rate;
                        out.by_rate[axis][axis] = -d;
                    }
                }
            }
        }
        out
    }

    /// The deflection is within the dead zone or clearance: the law is another one there.
    pub(crate) fn is_free(&self, u: Pair) -> bool {
        u[0].hypot(u[1]) <= self.gap
    }
}

/// `value / by`, 0 at 0.
fn over(value: f64, by: f64) -> f64 {
    if by > 0.0 { value / by } else { 0.0 }
}

/// `force = p x` with `p` a function of `|x|`, and its derivative `p δ_ij + q x_i x_j`, where
/// `q = p'/|x|`.
fn radial(force: &mut Pair, by: &mut [Pair; 2], x: Pair, p: f64, q: f64) {
    for i in 0..2 {
        force[i] += p * x[i];
        by[i][i] += p;
        for j in 0..2 {
            by[i][j] += q * x[i] * x[j];
        }
    }
}

/// A spring or damper of the train beyond its linear part.
#[derive(Clone, Debug)]
pub(crate) struct Spring {
    /// Deflection along each line as a function of the coordinates.
    pub(crate) rows: Vec<DVector<f64>>,
    /// Generalised force per unit of force along each line.
    pub(crate) inputs: Vec<DVector<f64>>,
    /// Reading of each sensor per unit of force along each line (1/kg), ahead of what the
    /// coordinates give.
    pub(crate) feeds: Vec<Vec<f64>>,
    pub(crate) force: ForceLaw,
    pub(crate) scale: Scale,
    /// The mesh whose approach it acts on, while teeth touch.
    pub(crate) stage: Option<usize>,
    /// Rolling elements that carry in place of what the linear train has there, `force.own`.
    pub(crate) rolling: Option<Elements>,
}

impl Spring {
    /// Deflection and rate in a state `(q, q̇)`.
    pub(crate) fn motion(&self, state: &[f64]) -> (Pair, Pair) {
        let n = state.len() / 2;
        let (mut u, mut v) = ([0.0; 2], [0.0; 2]);
        for (axis, row) in self.rows.iter().enumerate() {
            for (i, &r) in row.iter().enumerate().filter(|(_, r)| **r != 0.0) {
                u[axis] += r * state[i];
                v[axis] += r * state[n + i];
            }
        }
        (u, v)
    }

    /// The force in a motion at an angle of the first shaft (rad); that of rolling elements is
    /// their mean over a passage where none is given.
    pub(crate) fn at(&self, u: Pair, v: Pair, reference_rad: Option<f64>) -> Force {
        let Some(rolling) = &self.rolling else { return self.force.at(u, v) };
        let mut out = rolling.at(u, reference_rad);
        for (axis, deflection) in u.into_iter().enumerate() {
            out.force[axis] -= self.force.own.0 * deflection;
            out.by_deflection[axis][axis] -= self.force.own.0;
        }
        out
    }

    /// What a force along the lines adds to the reading of a sensor (m/s²).
    pub(crate) fn reading(&self, sensor: usize, force: Pair) -> f64 {
        self.feeds.iter().zip(force).map(|(feed, f)| feed.get(sensor).copied().unwrap_or(0.0) * f).sum()
    }

    /// Adds a slope to the matrices and sensors of a train.
    pub(crate) fn fold_slope(&self, slope: &SpringSlope, linear: &mut LinearTrain) {
        for (a, (input, feed)) in self.inputs.iter().zip(&self.feeds).enumerate() {
            for (b, row) in self.rows.iter().enumerate() {
                linear.stiffness.ger(-slope[a][b], input, row, 1.0);
                for (sensor, &feed) in linear.sensors.iter_mut().zip(feed) {
                    sensor.position.axpy(slope[a][b] * feed, row, 1.0);
                }
            }
        }
    }

    /// Adds a factor on the linear law to the matrices and sensors of a train; false where the law
    /// is not linear.
    pub(crate) fn fold(&self, factor: f64, linear: &mut LinearTrain) -> bool {
        let rate = match self.force.law {
            SpringLaw::Linear => false,
            SpringLaw::Rate => true,
            _ => return false,
        };
        let size = factor * self.force.coefficient;
        for ((row, input), feed) in self.rows.iter().zip(&self.inputs).zip(&self.feeds) {
            let matrix = if rate { &mut linear.damping } else { &mut linear.stiffness };
            matrix.ger(-size, input, row, 1.0);
            for (sensor, &feed) in linear.sensors.iter_mut().zip(feed) {
                let out = if rate { &mut sensor.velocity } else { &mut sensor.position };
                out.axpy(size * feed, row, 1.0);
            }
        }
        true
    }
}

/// The springs of a term, one per gear of a bearing's shaft or mode of the housing.
pub(crate) fn of_term(
    term: &term::ResolvedTerm,
    scale: &Scale,
    bench: &Bench,
    linear: &LinearTrain,
) -> Result<Vec<Spring>, ModelError> {
    let Entry::Spring { at, law, coefficient, gap, corner, direction_rad, .. } = term.entry else {
        return Ok(Vec::new());
    };
    let force = ForceLaw { law, coefficient, gap, corner, own: (0.0, 0.0) };
    Ok(match at {
        term::Spring::Bearing(shaft) => {
            stands_in_space(bench, linear, shaft)?;
            if law == SpringLaw::Clearance {
                has_springs(bench, shaft)?;
            }
            bearings(force, scale, bench, linear, shaft, direction_rad)
        }
        term::Spring::Torsion(shaft) => {
            let (driven, driving) = linear.shaft_angles[shaft];
            let own = (bench.shafts[shaft].torsion_nm_per_rad, bench.shafts[shaft].torsion_damping_nm_s_per_rad);
            vec![line(linear, &[(driven, 1.0), (driving, -1.0)], ForceLaw { own, ..force }, scale, None)]
        }
        term::Spring::Belt => {
            let Some(belt) = &bench.belt else { return Ok(Vec::new()) };
            let own = (belt.stiffness_nm_per_rad, belt.damping_nm_s_per_rad);
            let row = [(linear.motor_angle, 1.0 / belt.ratio), (linear.shaft_angles[0].0, -1.0)];
            vec![line(linear, &row, ForceLaw { own, ..force }, scale, None)]
        }
        term::Spring::Mesh(stage) => {
            let meshes = linear.meshes.iter().enumerate().filter(|(_, mesh)| mesh.place.stage == stage);
            let spring = |(i, _): (usize, &MeshGeometry)| {
                let row: Vec<(usize, f64)> = linear.mesh[i].iter().copied().enumerate().collect();
                line(linear, &row, force, scale, Some(i))
            };
            meshes.map(spring).collect()
        }
        term::Spring::Housing(which) => {
            let modes = bench.housing_modes.len().max(1);
            let directions = (linear.names.len() - linear.structural) / modes;
            (linear.structural..linear.names.len())
                .filter(|at| which.is_none_or(|mode| (at - linear.structural) / directions == mode))
                .map(|at| {
                    let own = (linear.stiffness[(at, at)], linear.damping[(at, at)]);
                    line(linear, &[(at, 1.0)], ForceLaw { own, ..force }, scale, None)
                })
                .collect()
        }
    })
}

/// A shaft whose gears do not turn with a carrier.
pub(crate) fn stands_in_space(bench: &Bench, linear: &LinearTrain, shaft: usize) -> Result<(), ModelError> {
    match linear.gears_on(shaft).iter().find_map(|gear| gear.carried) {
        None => Ok(()),
        Some(stage) => Err(ModelError::Bench(format!(
            "shaft {:?} carries a member of the planetary stage {:?}, whose bearings are simulated as linear and alike in all directions; change its bearing_n_per_m, or choose another shaft",
            bench.shafts[shaft].name, bench.stages[stage].name
        ))),
    }
}

/// A shaft whose supports are springs, which a clearance takes away within its gap.
fn has_springs(bench: &Bench, shaft: usize) -> Result<(), ModelError> {
    let spec = &bench.shafts[shaft];
    let rolls = spec.beam.iter().flat_map(|beam| &beam.supports).any(|support| support.rolling.is_some());
    if !rolls {
        return Ok(());
    }
    Err(ModelError::Bench(format!(
        "shaft {:?} has a term clearance(u) at its bearing and supports with rolling elements, which carry in place of springs; expected one of them: widen rolling.clearance_um, or leave rolling out",
        spec.name
    )))
}

/// A law at the bearing of each gear of a shaft, or at its supports: in all directions alike, or
/// along one line (rad).
pub(crate) fn bearings(
    force: ForceLaw,
    scale: &Scale,
    bench: &Bench,
    linear: &LinearTrain,
    shaft: usize,
    direction_rad: Option<f64>,
) -> Vec<Spring> {
    let spec = &bench.shafts[shaft];
    let lines = match direction_rad {
        Some(direction) => vec![[direction.cos(), direction.sin()]],
        None => vec![[1.0, 0.0], [0.0, 1.0]],
    };
    let of_hold = |hold: Hold| {
        let force = ForceLaw { own: (hold.stiffness, hold.damping), ..force };
        let mut out = Spring {
            rows: vec![],
            inputs: vec![],
            feeds: vec![],
            force,
            scale: scale.clone(),
            stage: None,
            rolling: None,
        };
        for along in &lines {
            let [x, y] = &hold.rows;
            let row = x * along[0] + y * along[1];
            // What the bearing passes on: to the housing modes as its linear force is, or straight
            // to the sensors.
            let mut input = -&row;
            let unit = linear.bearing_to_housing(bench, shaft);
            for (at, factor) in unit {
                input[at] += factor[0] * along[0] + factor[1] * along[1];
            }
            let feed = bench.sensors.iter().map(|sensor| {
                let own = bench.housing_modes.is_empty() && sensor.shaft == spec.name;
                let (sin, cos) = sensor.direction_deg.to_radians().sin_cos();
                if own { (cos * along[0] + sin * along[1]) / DIRECT_PATH_MASS_KG } else { 0.0 }
            });
            out.feeds.push(feed.collect());
            out.rows.push(row);
            out.inputs.push(input);
        }
        out
    };
    linear.holds(bench, shaft, linear.gears_on(shaft)).into_iter().map(of_hold).collect()
}

/// The rolling elements of all supports that have some; `wider_m` is what seats with play add to
/// the clearance of each shaft's.
pub(crate) fn rolling(scale: &Scale, bench: &Bench, linear: &LinearTrain, wider_m: &[f64]) -> Vec<Spring> {
    let mut out = Vec::new();
    for (at, shaft) in bench.shafts.iter().enumerate() {
        let (Some(beam), Some(place)) = (&shaft.beam, &linear.beams[at]) else { continue };
        let law = ForceLaw { law: SpringLaw::Linear, coefficient: 0.0, gap: 0.0, corner: 0.0, own: (0.0, 0.0) };
        let springs = bearings(law, scale, bench, linear, at, None);
        for (support, mut spring) in beam.supports.iter().zip(springs) {
            let named = bench.bearings.iter().find(|bearing| support.bearing.as_ref() == Some(&bearing.name));
            let (Some(rolling), Some(bearing)) = (&support.rolling, named) else { continue };
            let elements = Elements::new(bearing, rolling, linear.shaft_orders[at], place.sense);
            spring.rolling = elements.map(|elements| elements.changed(beam.scales(shaft).0, wider_m[at]));
            spring.force.gap = 0.5 * spring.rolling.map_or(0.0, |elements| elements.clearance_m);
            out.push(spring);
        }
    }
    out
}

fn line(linear: &LinearTrain, row: &[(usize, f64)], force: ForceLaw, scale: &Scale, stage: Option<usize>) -> Spring {
    let mut vector = DVector::zeros(linear.names.len());
    for &(at, value) in row {
        vector[at] += value;
    }
    Spring {
        inputs: vec![-&vector],
        rows: vec![vector],
        feeds: vec![vec![0.0; linear.sensors.len()]],
        force,
        scale: scale.clone(),
        stage,
        rolling: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Derivatives of every law are those of its force by central differences, in and off the axes,
    /// in the gap and beyond.
    #[test]
    fn analytic_derivatives_of_the_laws() {
        let laws = [
            SpringLaw::Linear,
            SpringLaw::SignedSquare,
            SpringLaw::Cube,
            SpringLaw::Rate,
            SpringLaw::SignedSquareRate,
            SpringLaw::SignRate,
            SpringLaw::DeadZone,
            SpringLaw::Clearance,
        ];
        for law in laws {
            let force = ForceLaw { law, coefficient: 3.0, gap: 0.7, corner: 0.3, own: (5.0, 0.4) };
            for (u, v) in [([0.4, -0.3], [0.2, 0.9]), ([1.1, 0.6], [-0.5, 0.1]), ([-2.0, 0.0], [0.0, 1.3])] {
                let at = force.at(u, v);
                let h = 1e-5;
                for j in 0..2 {
                    let shift = |x: Pair, by: f64| {
                        let mut x = x;
                        x[j] += by;
                        x
                    };
                    let by_u = [force.at(shift(u, h), v).force, force.at(shift(u, -h), v).force];
                    let by_v = [force.at(u, shift(v, h)).force, force.at(u, shift(v, -h)).force];
                    for i in 0..2 {
                        // Central differences err by h²/6 of the third derivative, some 10.
                        let (du, dv) = ((by_u[0][i] - by_u[1][i]) / (2.0 * h), (by_v[0][i] - by_v[1][i]) / (2.0 * h));
                        assert!((du - at.by_deflection[i][j]).abs() < 1e-8, "{law:?} {u:?}: {du}");
                        assert!((dv - at.by_rate[i][j]).abs() < 1e-8, "{law:?} {v:?}: {dv}");
                    }
                }
            }
        }
    }
}
