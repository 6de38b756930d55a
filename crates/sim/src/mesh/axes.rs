//! Displaced axes: eccentric gears, and bearings that give way.

use std::f64::consts::TAU;

use super::{MeshModel, MeshState};
use crate::geometry::PairGeometry;

impl MeshModel {
    /// Total backlash (m) along the line of action: nominal, and `2 sin α_w` times what the centre
    /// distance has grown by.
    pub fn backlash_m(&self, state: &MeshState) -> f64 {
        if self.geometry.is_internal() {
            // Axes that part come together on the other side of the ring.
            let sin = self.geometry.operating_angle_rad.sin();
            return (self.backlash_m - 2.0 * sin * self.modifications.pair.centre_shift_m).max(0.0);
        }
        let lag = self.shift(state).wheel * self.geometry.base_pitch_m;
        let sin = self.geometry.operating_angle_rad.sin();
        (self.backlash_m + 2.0 * sin * (self.modifications.pair.centre_shift_m + lag * sin)).max(0.0)
    }

    /// By how much the levers of the mesh force about the shafts of pinion and wheel exceed the
    /// base radii (m) at a phase: the centres of eccentric gears stand beside their shafts.
    ///
    /// # Formula
    /// The approach holds `ε₁ sin(ψ₁ + α) + ε₂ sin(ψ₂ − α)`, so virtual work gives the moments
    /// `−F ε₁ cos(ψ₁ + α)` and `−F ε₂ cos(ψ₂ − α)`, each about its own shaft in its sense of
    /// rotation. Gears of an internal pair turn in one sense: there the wheel's approach is
    /// `−ε₂ sin(ψ₂ + α)`, and α is negative where the pinion is internal.
    pub fn lever_m(&self, phase: f64) -> [f64; 2] {
        let alpha = self.geometry.signed_angle_rad();
        let same_sense = self.geometry.is_internal();
        let gears = [
            (&self.modifications.pinion, self.geometry.pinion.teeth, alpha, 1.0),
            (
                &self.modifications.wheel,
                self.geometry.wheel.teeth,
                if same_sense { alpha } else { -alpha },
                if same_sense { -1.0 } else { 1.0 },
            ),
        ];
        gears.map(|(gear, z, alpha, sign)| {
            let turns = phase / f64::from(z);
            let angle = TAU * (turns - turns.floor()) + gear.eccentricity_phase_rad;
            if gear.eccentricity_m == 0.0 { 0.0 } else { sign * gear.eccentricity_m * (angle + alpha).cos() }
        })
    }

    /// A gear is eccentric: [`Self::lever_m`] is not 0.
    pub fn is_eccentric(&self) -> bool {
        self.modifications.pinion.eccentricity_m != 0.0 || self.modifications.wheel.eccentricity_m != 0.0
    }

    /// What displaced axes do to the contact.
    #[inline(always)]
    pub(super) fn shift(&self, state: &MeshState) -> Shift {
        let [mut x, mut y] = state.displacement_m;
        let (pinion, wheel) = (&self.modifications.pinion, &self.modifications.wheel);
        let (mut own_x, mut own_y) = (0.0, 0.0);
        for (gear, z, sense) in [(pinion, self.geometry.pinion.teeth, 1.0), (wheel, self.geometry.wheel.teeth, -1.0)] {
            if gear.eccentricity_m != 0.0 {
                let turns = state.phase / f64::from(z);
                let (sin, cos) = (TAU * (turns - turns.floor()) + gear.eccentricity_phase_rad).sin_cos();
                // The wheel turns the other way, but not in an internal pair, and its displacement
                // counts against the pinion's.
                own_x += sense * gear.eccentricity_m * cos;
                own_y += if self.geometry.is_internal() { sense } else { 1.0 } * gear.eccentricity_m * sin;
            }
        }
        x += own_x;
        y += own_y;
        if x == 0.0 && y == 0.0 {
            return Shift::default();
        }
        let f = &self.shifts;
        Shift { pinion: f.pinion_x * x + f.pinion_y * y, wheel: f.wheel_x * x, gap_m: -(own_x * f.sin + own_y * f.cos) }
    }
}

/// [`Shift`] per metre of displacement.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShiftFactors {
    pinion_x: f64,
    pinion_y: f64,
    wheel_x: f64,
    /// Of the operating pressure angle.
    sin: f64,
    cos: f64,
}

impl ShiftFactors {
    pub(super) fn new(geometry: &PairGeometry) -> Self {
        let (sin, cos) = geometry.signed_angle_rad().sin_cos();
        if geometry.is_internal() {
            // To first order the contact of an internal pair stays where it is on both flanks:
            // radii of curvature differ little.
            return Self { pinion_x: 0.0, pinion_y: 0.0, wheel_x: 0.0, sin, cos };
        }
        let a = geometry.centre_distance_m;
        // Rotation of the line of action: the line of centres turns by −y/a, the pressure angle
        // grows by −x cos α/(a sin α).
        let per_turn = -geometry.pinion.base_radius_m / geometry.base_pitch_m;
        Self {
            pinion_x: per_turn * cos / (a * sin),
            pinion_y: -per_turn / a,
            // T = sqrt(a² − (r_b1 + r_b2)²) grows by Δa / sin α.
            wheel_x: -1.0 / sin / geometry.base_pitch_m,
            sin,
            cos,
        }
    }
}

/// What displaced axes do to the contact: advance of the pinion's position and lag of the wheel's
/// against it (mesh cycles), and the gap (m) that the gears' own eccentricity opens.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Shift {
    pub(super) pinion: f64,
    pub(super) wheel: f64,
    pub(super) gap_m: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::ToothModifications;
    use crate::mesh::MeshOptions;
    use crate::test_bench;

    /// The levers are the derivatives of the approach by the angles of the gears: central
    /// differences over 1e-4 rad err by 2e-9 of the eccentricity.
    #[test]
    fn analytic_levers_are_the_derivative_of_the_approach() {
        let bench = test_bench::single_stage();
        for wheel in [false, true] {
            let mut teeth = ToothModifications::default();
            let gear = if wheel { &mut teeth.wheel } else { &mut teeth.pinion };
            (gear.eccentricity_m, gear.eccentricity_phase_rad) = (50e-6, 0.7);
            let mesh = MeshModel::new(&bench, 0, &MeshOptions::default(), &teeth).unwrap();
            let cycles_per_rad = f64::from(if wheel { 73 } else { 34 }) / TAU;
            for phase in [0.3, 11.2, 29.9] {
                let gap = |angle: f64| {
                    let phase = phase + angle * cycles_per_rad;
                    mesh.shift(&MeshState { phase, displacement_m: [0.0; 2] }).gap_m
                };
                let derivative = -(gap(1e-4) - gap(-1e-4)) / 2e-4;
                let lever = mesh.lever_m(phase)[usize::from(wheel)];
                assert!((derivative - lever).abs() < 1e-7 * 50e-6, "{derivative} {lever}");
            }
        }
    }
}
