//! The joint of a belt, which runs over both pulleys once a turn of the belt.
//!
//! # Formula
//! An open belt of length L over pulleys of radii R₁ (motor) and R₂ = i R₁ at the distance C
//! (Niemann & Winter, Maschinenelemente III; any handbook):
//!
//! ```text
//! sin β = (R₂ − R₁)/C      L = 2 C cos β + R₁ (π − 2β) + R₂ (π + 2β)      f_belt = 2π R₁ n_motor / L
//! ```
//!
//! The pitch line of the joint, of length l, lies farther out by h: glue, lacing or a lap. A pulley
//! takes in `(R + h) dφ` of it instead of `R dφ`, so that `h l/R` more belt is on the pulley as
//! long as the joint is. What the motor's pulley takes in tightens the tight span, what it then
//! lets out slackens the slack one; at the other pulley it is the reverse. Both spans hold the
//! torque together, each by half. So the belt is stretched, as seen at the input shaft, by
//!
//! ```text
//! R₂ e = ½ Σ ± h l/R        + when the joint enters and leaves the motor's pulley, − at the other one
//! ```
//!
//! less its mean rise over a turn of the belt, which the ratio of the bench file has in it. Each
//! step takes the way l and is a half wave of a cosine. The torque is `k e + c ė` of the belt.

use std::f64::consts::{PI, TAU};

use gearwatch_core::bench::{Belt, Bench};
use nalgebra::DVector;

use crate::linear::LinearTrain;

/// Where a belt runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct BeltPath {
    /// Length of the pitch line (m).
    pub(crate) length_m: f64,
    /// Pitch radii of the motor's pulley and the other one (m).
    pub(crate) radii_m: [f64; 2],
    /// On the motor's pulley, and on the other one (m).
    arcs_m: [f64; 2],
}

impl BeltPath {
    /// The path by the numbers of the bench file.
    ///
    /// # Errors
    /// A sentence that names the key of the bench file, and what would be right.
    pub(crate) fn new(belt: &Belt) -> Result<Self, String> {
        let (Some(length_mm), Some(pulley_mm)) = (belt.length_mm, belt.motor_pulley_mm) else {
            let missing = if belt.length_mm.is_none() { "length_mm" } else { "motor_pulley_mm" };
            return Err(format!(
                "[belt] of the bench file has no {missing}; give length_mm of the belt and motor_pulley_mm, the pitch diameter of the \
                 motor's pulley"
            ));
        };
        let (length_m, first) = (1e-3 * length_mm, 0.5e-3 * pulley_mm);
        let second = belt.ratio * first;
        let apart = second - first;
        let length_at = |centres: f64| {
            let beta = (apart / centres).asin();
            2.0 * centres * beta.cos() + first * (PI - 2.0 * beta) + second * (PI + 2.0 * beta)
        };
        // The pulleys touch: the shortest belt.
        let (mut low, mut high) = (first + second, 0.5 * length_m);
        if length_at(low) >= length_m {
            return Err(format!(
                "[belt] of the bench file: length_mm is {length_mm}; pulleys of {pulley_mm} mm and ratio {} times that touch each other with \
                 {:.0} mm; expected a longer belt or a smaller motor_pulley_mm",
                belt.ratio,
                1e3 * length_at(low)
            ));
        }
        // The length rises with the distance.
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if length_at(middle) < length_m { low = middle } else { high = middle }
        }
        let beta = (apart / low).asin();
        Ok(Self { length_m, radii_m: [first, second], arcs_m: [first * (PI - 2.0 * beta), second * (PI + 2.0 * beta)] })
    }

    /// Turns of the belt per revolution of the motor.
    pub(crate) fn order(&self) -> f64 {
        TAU * self.radii_m[0] / self.length_m
    }
}

/// The joint on its way.
#[derive(Clone, Debug)]
pub(super) struct Joint {
    /// Where a step begins (turns of the belt), and its height as an angle of the input shaft
    /// (rad).
    steps: [(f64, f64); 4],
    /// Duration of a step (turns of the belt).
    width: f64,
    /// Mean over a turn of the belt (rad).
    mean_rad: f64,
    /// Turns of the belt per rad of the first shaft.
    turns_per_rad: f64,
    stiffness_nm_per_rad: f64,
    damping_nm_s_per_rad: f64,
}

impl Joint {
    fn new(path: &BeltPath, [raised_m, length_m]: [f64; 2], belt: &Belt) -> Self {
        let BeltPath { length_m: turn, radii_m: [first, second], arcs_m: [on_first, on_second] } = *path;
        let span = 0.5 * (turn - on_first - on_second);
        let [of_first, of_second] = [first, second].map(|radius| 0.5 * raised_m * length_m / (radius * second));
        let places = [0.0, on_first, on_first + span, on_first + span + on_second];
        let heights = [of_first, of_first, -of_second, -of_second];
        let mut out = Self {
            steps: std::array::from_fn(|i| (places[i] / turn, heights[i])),
            width: length_m / turn,
            mean_rad: 0.0,
            turns_per_rad: belt.ratio * path.order() / TAU,
            stiffness_nm_per_rad: belt.stiffness_nm_per_rad,
            damping_nm_s_per_rad: belt.damping_nm_s_per_rad,
        };
        // Mean of `rise − since − place`: the rise lacks half of its width, since is ½ in the mean.
        let area = |(place, height): (f64, f64)| height * (0.5 - place - 0.5 * out.width);
        out.mean_rad = out.steps.map(area).iter().sum();
        out
    }

    /// Stretch as an angle of the input shaft (rad), and its slope per turn of the belt.
    fn stretch(&self, turns: f64) -> (f64, f64) {
        let (mut angle, mut slope) = (-self.mean_rad, 0.0);
        for (place, height) in self.steps {
            // What the step has risen by, less its mean rise since the turn began at τ. From the
            // step on that is `rise − τ = rise − since − place`, and so it is ahead of the step,
            // where the turn before counts: `−τ = 1 − (since + place)`.
            let since = (turns - place).rem_euclid(1.0);
            let (rise, rate) = match since / self.width {
                x if x < 1.0 => (0.5 - 0.5 * (PI * x).cos(), 0.5 * PI * (PI * x).sin() / self.width),
                _ => (1.0, 0.0),
            };
            angle += height * (rise - since - place);
            slope += height * (rate - 1.0);
        }
        (angle, slope)
    }

    /// Torque (N m) at an angle (rad) and speed (rad/s) of the first shaft.
    pub(super) fn value(&self, angle: f64, omega: f64) -> f64 {
        let (stretch, slope) = self.stretch(self.turns_per_rad * angle);
        self.stiffness_nm_per_rad * stretch + self.damping_nm_s_per_rad * slope * self.turns_per_rad * omega
    }
}

/// Generalised force of a unit torque of the belt, seen at the input shaft.
pub(super) fn stretch(linear: &LinearTrain, ratio: f64) -> DVector<f64> {
    let mut out = DVector::zeros(linear.names.len());
    out[linear.motor_angle] = -1.0 / ratio;
    out[linear.shaft_angles[0].0] = 1.0;
    out
}

/// The joint and what it acts on; nothing where the bench file does not say where the belt runs.
pub(super) fn of(linear: &LinearTrain, joint: [f64; 2], bench: &Bench) -> Option<(DVector<f64>, Joint)> {
    let belt = bench.belt.as_ref()?;
    let path = BeltPath::new(belt).ok()?;
    Some((stretch(linear, belt.ratio), Joint::new(&path, joint, belt)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn belt(ratio: f64) -> Belt {
        Belt {
            ratio,
            stiffness_nm_per_rad: 4000.0,
            damping_nm_s_per_rad: 2.0,
            length_mm: Some(1600.0),
            motor_pulley_mm: Some(60.0),
        }
    }

    /// Equal pulleys: half a turn on each, and the motor takes in π D a turn. Of unequal ones the
    /// parts make up the belt, and the spans are tangents of both circles: `s² = C² − (R₂ − R₁)²`.
    #[test]
    fn analytic_path_of_a_belt() {
        let even = BeltPath::new(&belt(1.0)).unwrap();
        assert!((even.arcs_m[0] - PI * 0.03).abs() < 1e-9 && (even.order() - PI * 60.0 / 1600.0).abs() < 1e-12);
        let path = BeltPath::new(&belt(3.56)).unwrap();
        let span = 0.5 * (path.length_m - path.arcs_m[0] - path.arcs_m[1]);
        let apart = path.radii_m[1] - path.radii_m[0];
        // The wraps differ from half a turn by 2 β, and tan β = (R₂ − R₁)/s.
        let beta = (apart / span).atan();
        for (arc, radius, sign) in [(path.arcs_m[0], path.radii_m[0], -1.0), (path.arcs_m[1], path.radii_m[1], 1.0)] {
            assert!((arc / radius - PI - sign * 2.0 * beta).abs() < 1e-9, "{path:?}");
        }
    }

    /// The joint carried round by small steps of belt: each pulley takes in and lets out at the
    /// radius that it has at the tangent, what is on the spans is counted, and their difference
    /// holds the torque. On the plateaus between the steps the stretch differs by the constants
    /// that are to be found.
    #[test]
    fn oracle_stretch_by_carrying_the_joint_round() {
        let belt = belt(3.56);
        let path = BeltPath::new(&belt).unwrap();
        let (raised_m, long_m) = (1e-4, 0.04);
        let joint = Joint::new(&path, [raised_m, long_m], &belt);
        let span = 0.5 * (path.length_m - path.arcs_m[0] - path.arcs_m[1]);
        // Tangent points along the belt: in and out of the motor's pulley, in and out of the other.
        let points = [0.0, path.arcs_m[0], path.arcs_m[0] + span, path.length_m - span];
        let steps = 400_000;
        let way = path.length_m / f64::from(steps);
        // Belt on tight and slack span beyond what is there without a joint.
        let (mut tight, mut slack) = (0.0, 0.0);
        let mut found = Vec::new();
        for i in 0..steps {
            let head = (f64::from(i) + 0.5) * way;
            let more = |point: f64, radius: f64| {
                let since = (head - point).rem_euclid(path.length_m);
                if since < long_m { raised_m / radius * way } else { 0.0 }
            };
            let [first, second] = path.radii_m;
            tight += more(points[3], second) - more(points[0], first);
            slack += more(points[1], first) - more(points[2], second);
            found.push(0.5 * (slack - tight) / second);
        }
        // Less the mean rise and the mean.
        let rise = found.last().copied().unwrap_or(0.0);
        let mean = found.iter().sum::<f64>() / f64::from(steps) - 0.5 * rise;
        let largest = joint.steps.iter().map(|step| step.1.abs()).fold(0.0, f64::max);
        for place in [0.04, 0.09, 0.3, 0.4, 0.55, 0.7, 0.95] {
            let i = (place * f64::from(steps)) as usize;
            let expected = found[i] - rise * place - mean;
            let (stretch, _) = joint.stretch(place);
            // The straight rise and the half wave of a cosine have the same mean; counting by 1e-4
            // of the joint leaves 2e-6.
            assert!((stretch - expected).abs() < 1e-5 * largest, "{place}: {stretch:e} {expected:e} {largest:e}");
        }
    }

    /// The stretch has no mean, repeats with the turn of the belt, and its slope is its derivative.
    #[test]
    fn analytic_stretch_repeats_and_has_no_mean() {
        let belt = belt(2.0);
        let joint = Joint::new(&BeltPath::new(&belt).unwrap(), [3e-5, 0.05], &belt);
        let count = 20_000;
        let at = |i: i32| joint.stretch(f64::from(i) / f64::from(count));
        let mean = (0..count).map(|i| at(i).0).sum::<f64>() / f64::from(count);
        let largest = (0..count).map(|i| at(i).0.abs()).fold(0.0, f64::max);
        assert!(mean.abs() < 1e-6 * largest, "{mean} {largest}");
        for i in 0..count {
            assert!((at(i).0 - at(i + 3 * count).0).abs() < 1e-9 * largest);
            let slope = (at(i + 1).0 - at(i - 1).0) * 0.5 * f64::from(count);
            // A step is 625 of these places long: its curvature leaves 1e-2 of the steepest slope.
            assert!((slope - at(i).1).abs() < 1e-2 * 2.0 * largest / joint.width, "{i}: {slope} {}", at(i).1);
        }
    }

    #[test]
    fn conform_a_belt_without_a_path_is_refused() {
        let said = BeltPath::new(&Belt { length_mm: None, ..belt(2.0) }).unwrap_err();
        assert!(said.contains("[belt]") && said.contains("no length_mm"), "{said}");
        let said = BeltPath::new(&Belt { motor_pulley_mm: None, ..belt(2.0) }).unwrap_err();
        assert!(said.contains("no motor_pulley_mm") && said.contains("pitch diameter"), "{said}");
        let said = BeltPath::new(&Belt { length_mm: Some(300.0), ..belt(2.0) }).unwrap_err();
        assert!(said.contains("length_mm is 300") && said.contains("expected a longer belt"), "{said}");
    }
}
