//! Pits by counting: when each of the places of all flanks of a gear gives way, and how its pit grows.
//!
//! A gear has sites side by side about the pitch line of each tooth. The life of a site is drawn from a Weibull distribution, whose scale follows from that of the gear: sites fail independently, so
//! that a gear of n sites lives as its weakest one, `η_gear = η_site n^(−1/e)` (Lundberg & Palmgren 1947). 1 gear of 100 has a pit after `N₁ = 5·10⁷ (σ_end/σ_H)^q` cycles (ISO 6336-2), so that
//! `η_gear = N₁ / (−ln 0.99)^(1/e)`. σ_H is the Hertzian pressure at the pitch point, where one pair carries all of the load; pits leave less of the contact line, and the pressure on that tooth
//! rises. Cycles at several pressures are added up by Miner's rule.

use std::f64::consts::PI;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::contact::contact_modulus_pa;
use super::law::Constants;
use super::wear::even;
use super::{Duty, GrowthError};
use crate::faults::Pit;
use crate::geometry::GearGeometry;
use crate::mesh::MeshModel;
use crate::setup::SimSetup;

/// Cycles that the endurance pressure belongs to (ISO 6336-2).
const REFERENCE_CYCLES: f64 = 5e7;
/// Gears that bear them.
const REFERENCE_SURVIVAL: f64 = 0.99;
/// Diameter of a full pit / height of the flank.
const FULL: f64 = 0.4;
/// Width of a site / diameter of a full pit: rims stand between pits.
const APART: f64 = 1.25;
/// Parts of a stretch of time within which the pressure is held.
const PARTS: usize = 20;
/// Diameter of a pit that has just begun / that of a full one.
const FIRST: f64 = 0.2;

/// A gear whose flanks pit.
#[derive(Clone, Debug)]
pub struct PitGrowth {
    stage: usize,
    wheel: bool,
    law: Constants,
    gear: GearGeometry,
    /// Pressure at the pitch point (Pa) is this times √(force / length of the contact line).
    pressure_factor: f64,
    full_m: f64,
    depth_m: f64,
    /// By tooth and site: cycles at the endurance pressure after which a pit begins.
    lives: Vec<Vec<f64>>,
    /// By tooth: cycles so far, as cycles at the endurance pressure.
    passed: Vec<f64>,
}

impl PitGrowth {
    /// A gear without pits, with the lives that `seed` draws; pits of full size are `depth_m` deep.
    ///
    /// # Errors
    /// For a gear pair that cannot be.
    pub fn new(
        setup: &SimSetup,
        (stage, wheel): (usize, bool),
        depth_m: f64,
        law: Constants,
        seed: u64,
    ) -> Result<Self, GrowthError> {
        let mesh = MeshModel::new(&setup.bench, stage, &setup.mesh, &even(&setup.teeth[stage]))?;
        let pair = mesh.geometry();
        let gear = if wheel { pair.wheel.clone() } else { pair.pinion.clone() };
        let [own, other] = pair.rolls_m(pair.pitch_phase());
        let radius = own * other / (own + other);
        let pressure_factor = (contact_modulus_pa(mesh.material()) / (PI * radius)).sqrt();
        let full_m = (FULL * gear.flank_height_m()).min(gear.face_width_m / APART);
        let sites = (gear.face_width_m / (APART * full_m)) as usize;
        let count = sites as f64 * f64::from(gear.teeth);
        let slope = law.get("weibull_slope");
        let scale = REFERENCE_CYCLES * (count / -REFERENCE_SURVIVAL.ln()).powf(1.0 / slope);
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x9175);
        let mut life = || scale * (-(1.0 - rng.random::<f64>()).ln()).powf(1.0 / slope);
        let lives = (0..gear.teeth).map(|_| (0..sites).map(|_| life()).collect()).collect();
        let passed = vec![0.0; gear.teeth as usize];
        let depth_m = depth_m.min(0.5 * gear.module_m);
        Ok(Self { stage, wheel, law, gear, pressure_factor, full_m, depth_m, lives, passed })
    }

    /// Contact pressure at the pitch point (Pa) with `lost_m` of the contact line gone.
    fn pressure_pa(&self, force_n: f64, lost_m: f64) -> f64 {
        // What is left of a pitted line: a tenth at least, since rims stand between the pits.
        let length = (self.gear.face_width_m - lost_m).max(0.1 * self.gear.face_width_m);
        self.pressure_factor * (force_n / length).sqrt()
    }

    /// Pressure on a whole flank (Pa) at a duty, and hours after which 1 gear of 100 has a pit.
    pub fn outlook(&self, setup: &SimSetup, duty: &Duty) -> (f64, f64) {
        let pressure = self.pressure_pa(duty.mesh_force_n(&setup.bench, self.stage), 0.0);
        let ratio = 1e6 * self.law.get("endurance_mpa") / pressure;
        let cycles = REFERENCE_CYCLES * ratio.powf(self.law.get("stress_exponent"));
        (pressure, cycles / duty.passages_per_hour(&setup.bench, self.stage)[usize::from(self.wheel)])
    }

    /// Diameters of the pits of a tooth (m).
    fn diameters_m(&self, tooth: usize) -> impl Iterator<Item = f64> + '_ {
        let (passed, grown_in) = (self.passed[tooth], self.law.get("growth_cycles"));
        self.lives[tooth].iter().filter(move |&&life| life <= passed).map(move |life| {
            let share = ((passed - life) / grown_in).min(1.0);
            self.full_m * share.sqrt().max(FIRST)
        })
    }

    /// Goes on for so many hours at some duties.
    pub fn advance(&mut self, setup: &SimSetup, duties: &[Duty], hours: f64) {
        let (endurance, exponent) = (1e6 * self.law.get("endurance_mpa"), self.law.get("stress_exponent"));
        let loads: Vec<(f64, f64)> = duties
            .iter()
            .map(|duty| {
                let passages = duty.passages_per_hour(&setup.bench, self.stage)[usize::from(self.wheel)];
                (duty.share * passages, duty.mesh_force_n(&setup.bench, self.stage))
            })
            .collect();
        for _ in 0..PARTS {
            for tooth in 0..self.passed.len() {
                let lost: f64 = self.diameters_m(tooth).sum();
                let worth = |&(passages, force): &(f64, f64)| {
                    passages * (self.pressure_pa(force, lost) / endurance).powf(exponent)
                };
                self.passed[tooth] += hours / PARTS as f64 * loads.iter().map(worth).sum::<f64>();
            }
        }
    }

    /// Pits of a tooth.
    fn pits(&self, tooth: usize) -> Vec<Pit> {
        let pit = |diameter_m: f64| Pit { diameter_m, depth_m: self.depth_m * diameter_m / self.full_m, height_m: 0.0 };
        self.diameters_m(tooth).map(pit).collect()
    }

    /// Puts the pits into a setup.
    pub fn apply(&self, setup: &mut SimSetup) {
        let teeth = &mut setup.teeth[self.stage];
        let gear = if self.wheel { &mut teeth.wheel } else { &mut teeth.pinion };
        for tooth in 0..self.passed.len() {
            let pits = self.pits(tooth);
            if !pits.is_empty() {
                gear.damage_tooth(tooth as u32, |damage| damage.pits.extend(pits));
            }
        }
    }

    /// Pitted share of the worst tooth's flank (1), pits, and teeth that have some.
    pub fn size(&self) -> (f64, usize, usize) {
        let flank = self.gear.flank_height_m() * self.gear.face_width_m;
        let area = |tooth: usize| self.diameters_m(tooth).map(|d| 0.25 * PI * d * d).sum::<f64>() / flank;
        let teeth = 0..self.passed.len();
        let worst = teeth.clone().map(area).fold(0.0, f64::max);
        let counts: Vec<usize> = teeth.map(|tooth| self.diameters_m(tooth).count()).collect();
        (worst, counts.iter().sum(), counts.iter().filter(|&&count| count > 0).count())
    }
}
