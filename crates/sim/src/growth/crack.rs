//! A crack at the root of one tooth by Paris' law.
//!
//! `da/dN = C (ΔK)^m` once per revolution of the gear, from nothing at a range below the threshold
//! until the tooth breaks. The load returns to 0 between two passages, so that ΔK is the largest K.
//!
//! # Stress intensity
//! `K = √(π a) [σ_b F_b(α) − σ_c F_t(α)]`, `α = a sin v/t`: an edge crack of depth a along its
//! direction v through a bar as thick as the tooth's root, bent and pressed by the nominal stresses
//! of [`RootSection`]. F_b and F_t are those of Tada, Paris & Irwin 1985 (pages 2.14 and 2.11),
//! within 2.5 % of the polynomials beside them. Left out: the notch effect of the fillet, which
//! raises K of cracks shorter than its radius, and mode II of the inclined crack; K of deeper
//! cracks is worth ± 20 %, and hours its power m.

use std::f64::consts::{FRAC_PI_2, PI};

use super::contact::{RootSection, pair_loads};
use super::law::Constants;
use super::wear::even;
use super::{Duty, End, GrowthError};
use crate::faults::{Crack, ToothModifications};
use crate::geometry::GearGeometry;
use crate::mesh::{FlankStore, MeshModel};
use crate::setup::SimSetup;

/// Places of the path that the largest stress is looked for at.
const PLACES: usize = 61;
/// Growth after which the load is shared anew: the stiffness of the tooth has changed by less than
/// 2 %.
const SHARED_ANEW: f64 = 1.03;
/// Growth within one step of the integration.
const STEP: f64 = 0.005;
/// Largest share of the root that a crack may take: beyond it the cantilever of the mesh stiffness
/// means nothing.
const DEEPEST: f64 = 0.78;

/// Geometry factor of an edge crack in pure bending (Tada, Paris & Irwin 1985, 2.14).
pub fn bending_factor(alpha: f64) -> f64 {
    let angle = FRAC_PI_2 * alpha;
    if angle == 0.0 {
        return 0.923 + 0.199;
    }
    (angle.tan() / angle).sqrt() * (0.923 + 0.199 * (1.0 - angle.sin()).powi(4)) / angle.cos()
}

/// Geometry factor of an edge crack in tension (Tada, Paris & Irwin 1985, 2.11).
pub fn tension_factor(alpha: f64) -> f64 {
    let angle = FRAC_PI_2 * alpha;
    if angle == 0.0 {
        return 0.752 + 0.37;
    }
    (angle.tan() / angle).sqrt() * (0.752 + 2.02 * alpha + 0.37 * (1.0 - angle.sin()).powi(3)) / angle.cos()
}

/// Goes on for `duration` with a crack that grows at `rate(depth)` per unit of it, up to
/// `deepest_m`: its depth then, and what is left of the duration.
///
/// Runge–Kutta of order 4 in steps of half a percent of the depth.
pub fn grown(from_m: f64, duration: f64, deepest_m: f64, rate: impl Fn(f64) -> f64) -> (f64, f64) {
    let (mut depth, mut left) = (from_m, duration);
    while left > 0.0 && depth < deepest_m {
        let first = rate(depth);
        if first <= 0.0 {
            return (depth, 0.0);
        }
        let increase = |step: f64| {
            let second = rate(depth + 0.5 * step * first);
            let third = rate(depth + 0.5 * step * second);
            let fourth = rate(depth + step * third);
            step / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
        };
        let mut step = left.min(STEP * depth / first);
        let mut by = increase(step);
        // Beyond the border: shortened by straight line until the border is met.
        for _ in 0..4 {
            if depth + by > deepest_m {
                step *= (deepest_m - depth) / by;
                by = increase(step);
            }
        }
        depth = if deepest_m - depth - by < 1e-9 * by { deepest_m } else { depth + by };
        left = if step >= left { 0.0 } else { left - step };
    }
    (depth.min(deepest_m), left)
}

/// A cracked tooth.
#[derive(Clone, Debug)]
pub struct RootCrackGrowth {
    stage: usize,
    wheel: bool,
    tooth: u32,
    crack: Crack,
    law: Constants,
    teeth: ToothModifications,
    gear: GearGeometry,
    root: RootSection,
    ended: Option<End>,
}

impl RootCrackGrowth {
    /// A tooth with its first crack.
    ///
    /// # Errors
    /// For a gear pair or a crack that cannot be.
    pub fn new(
        setup: &SimSetup,
        (stage, wheel): (usize, bool),
        (tooth, crack): (u32, Crack),
        law: Constants,
    ) -> Result<Self, GrowthError> {
        let teeth = even(&setup.teeth[stage]);
        let mesh = MeshModel::new(&setup.bench, stage, &setup.mesh, &teeth)?;
        let pair = mesh.geometry();
        let gear = if wheel { pair.wheel.clone() } else { pair.pinion.clone() };
        let root = RootSection::new(&gear);
        let out = Self { stage, wheel, tooth, crack, law, teeth, gear, root, ended: None };
        out.mesh(setup, crack.depth_m, &mut FlankStore::default())?;
        Ok(out)
    }

    fn mesh(&self, setup: &SimSetup, depth_m: f64, flanks: &mut FlankStore) -> Result<MeshModel, GrowthError> {
        let mut teeth = self.teeth.clone();
        let gear = if self.wheel { &mut teeth.wheel } else { &mut teeth.pinion };
        gear.damage_tooth(self.tooth, |damage| damage.crack = Some(Crack { depth_m, ..self.crack }));
        Ok(MeshModel::with_flanks(&setup.bench, self.stage, &setup.mesh, &teeth, flanks)?)
    }

    /// Bending and compression at the root (Pa) at the place of the path where the crack of the
    /// present depth opens most, under a mesh force.
    fn stresses_pa(&self, mesh: &MeshModel, force_n: f64) -> [f64; 2] {
        let index = i64::from(self.tooth);
        let loads = pair_loads(mesh, force_n, index, PLACES, |_| 0.0);
        let pair = mesh.geometry();
        let stresses = loads.iter().enumerate().map(|(i, &load)| {
            let rolls = pair.rolls_m(pair.contact_ratio * i as f64 / (PLACES - 1) as f64);
            self.root.stresses_pa(&self.gear, rolls[usize::from(self.wheel)].max(0.0), load)
        });
        let intensity = |stresses: &[f64; 2]| self.intensity_pa_sqrt_m(*stresses, self.crack.depth_m);
        stresses.max_by(|a, b| intensity(a).total_cmp(&intensity(b))).unwrap_or_default()
    }

    /// Stress intensity (Pa √m) of a crack under nominal stresses.
    fn intensity_pa_sqrt_m(&self, [bending, compression]: [f64; 2], depth_m: f64) -> f64 {
        let alpha = (depth_m * self.crack.angle_rad.sin() / self.root.thickness_m()).min(0.99);
        let opening = bending * bending_factor(alpha) - compression * tension_factor(alpha);
        (PI * depth_m).sqrt() * opening.max(0.0)
    }

    /// Stress intensity (MPa √m) of the present crack at each duty.
    ///
    /// # Errors
    /// For a gear pair that cannot be.
    pub fn intensities_mpa_sqrt_m(&self, setup: &SimSetup, duties: &[Duty]) -> Result<Vec<f64>, GrowthError> {
        let mesh = self.mesh(setup, self.crack.depth_m, &mut FlankStore::default())?;
        let of = |duty: &Duty| self.stresses_pa(&mesh, duty.mesh_force_n(&setup.bench, self.stage));
        Ok(duties.iter().map(|duty| 1e-6 * self.intensity_pa_sqrt_m(of(duty), self.crack.depth_m)).collect())
    }

    /// Goes on for so many hours at some duties; how many were left when the tooth broke.
    ///
    /// # Errors
    /// For a gear pair that cannot be.
    pub fn advance(&mut self, setup: &SimSetup, duties: &[Duty], hours: f64) -> Result<f64, GrowthError> {
        let [c, m, threshold, toughness] =
            ["paris_c", "paris_m", "threshold_mpa_sqrt_m", "toughness_mpa_sqrt_m"].map(|name| self.law.get(name));
        let deepest_m = DEEPEST * 2.0 * self.gear.half_root_m() / self.crack.angle_rad.sin();
        let mut flanks = FlankStore::default();
        let mut left = hours;
        while left > 0.0 && self.ended.is_none() {
            let mesh = self.mesh(setup, self.crack.depth_m, &mut flanks)?;
            let loads: Vec<(f64, [f64; 2])> = duties
                .iter()
                .map(|duty| {
                    let passages = duty.passages_per_hour(&setup.bench, self.stage)[usize::from(self.wheel)];
                    (duty.share * passages, self.stresses_pa(&mesh, duty.mesh_force_n(&setup.bench, self.stage)))
                })
                .collect();
            let range = |stresses: [f64; 2], depth: f64| 1e-6 * self.intensity_pa_sqrt_m(stresses, depth);
            let largest = loads.iter().map(|load| range(load.1, self.crack.depth_m)).fold(0.0, f64::max);
            if largest >= toughness {
                self.ended = Some(End::Fracture);
                break;
            }
            if self.crack.depth_m >= deepest_m {
                self.ended = Some(End::Deepest);
                break;
            }
            let rate = |depth: f64| {
                let growth = |&(cycles, stresses): &(f64, [f64; 2])| {
                    let range = range(stresses, depth);
                    if range > threshold { cycles * c * range.powf(m) } else { 0.0 }
                };
                loads.iter().map(growth).sum::<f64>()
            };
            let until = (SHARED_ANEW * self.crack.depth_m).min(deepest_m);
            let (depth, rest) = grown(self.crack.depth_m, left, until, rate);
            (self.crack.depth_m, left) = (depth, rest);
        }
        Ok(left)
    }

    /// Puts the crack into a setup.
    pub fn apply(&self, setup: &mut SimSetup) {
        let teeth = &mut setup.teeth[self.stage];
        let gear = if self.wheel { &mut teeth.wheel } else { &mut teeth.pinion };
        gear.damage_tooth(self.tooth, |damage| damage.crack = Some(self.crack));
    }

    /// Depth (m).
    pub fn size_m(&self) -> f64 {
        self.crack.depth_m
    }

    /// Why it grows no further.
    pub fn ended(&self) -> Option<End> {
        self.ended
    }
}
