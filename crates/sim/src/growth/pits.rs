//! Pits by counting: when each of the places of all flanks of a gear gives way, and how its pit
//! grows.
//!
//! A gear has sites side by side about the pitch line of each tooth. The life of a site is drawn
//! from a Weibull distribution, whose scale follows from that of the gear: sites fail
//! independently, so that a gear of n sites lives as its weakest one, `η_gear = η_site n^(−1/e)`
//! (Lundberg & Palmgren 1947). 1 gear of 100 has a pit after `N₁ = 5·10⁷ (σ_end/σ_H)^q` cycles (ISO
//! 6336-2), so that `η_gear = N₁ / (−ln 0.99)^(1/e)`. σ_H is the Hertzian pressure at the pitch
//! point, where one pair carries all of the load; pits leave less of the contact line, and the
//! pressure on that tooth rises. Cycles at several pressures are added up by Miner's rule.
//!
//! On helical teeth the contact line crosses the pitch line at one site after the other. Each site
//! has the pressure of its own slice at that moment, `σ_H = √(F' E* cos β_b/(π R))`, and only those
//! pits shorten the line that it crosses then. The load of the missing length goes to all contact
//! lines of the moment.

use std::f64::consts::PI;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::contact::{FaceLoads, PLACES, contact_modulus_pa};
use super::law::Constants;
use super::wear::even;
use super::{Duty, GrowthError};
use crate::faults::Pit;
use crate::geometry::GearGeometry;
use crate::mesh::{FlankStore, StageMesh};
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
    /// By tooth and site: cycles so far, as cycles at the endurance pressure.
    passed: Vec<Vec<f64>>,
    /// Of helical teeth.
    face: Option<HelicalFace>,
}

/// What the pressure on helical teeth is found from.
#[derive(Clone, Debug)]
struct HelicalFace {
    mesh: StageMesh,
    /// Height on the flank by which the contact line rises per place along the face (1):
    /// `tan β_b r_b/ξ` at the pitch point, where an involute is `dξ ξ/r_b` long per roll
    /// coordinate.
    climb: f64,
}

/// Load at the pitch line by site.
struct SiteLoads {
    /// Force if all of the face carried as this site does (N).
    force_n: Vec<f64>,
    /// Length along the axis of all contact lines when the site passes the pitch line (m).
    length_m: Vec<f64>,
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
        let teeth = even(&setup.teeth[stage]);
        let mesh = StageMesh::new(&setup.bench, stage, &setup.mesh, &teeth, &mut FlankStore::default())?;
        let pair = mesh.section().geometry();
        let gear = if wheel { pair.wheel.clone() } else { pair.pinion.clone() };
        let [own, other] = pair.rolls_m(pair.pitch_phase());
        let base_helix_rad = mesh.face().map_or(0.0, |face| face.base_helix_rad());
        let radius = own * other / ((own + other) * base_helix_rad.cos());
        let pressure_factor = (contact_modulus_pa(mesh.section().material()) / (PI * radius)).sqrt();
        let climb = base_helix_rad.tan() * if wheel { other } else { own } / gear.base_radius_m;
        let full_m = (FULL * gear.flank_height_m()).min(gear.face_width_m / APART);
        let sites = (gear.face_width_m / (APART * full_m)) as usize;
        let count = sites as f64 * f64::from(gear.teeth);
        let slope = law.get("weibull_slope");
        let scale = REFERENCE_CYCLES * (count / -REFERENCE_SURVIVAL.ln()).powf(1.0 / slope);
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x9175);
        let mut life = || scale * (-(1.0 - rng.random::<f64>()).ln()).powf(1.0 / slope);
        let lives = (0..gear.teeth).map(|_| (0..sites).map(|_| life()).collect()).collect();
        let passed = vec![vec![0.0; sites]; gear.teeth as usize];
        let depth_m = depth_m.min(0.5 * gear.module_m);
        let face = mesh.face().is_some().then_some(HelicalFace { mesh, climb });
        Ok(Self { stage, wheel, law, gear, pressure_factor, full_m, depth_m, lives, passed, face })
    }

    /// Contact pressure at the pitch point (Pa) under a force, if all of the face carries alike,
    /// with `lost_m` of a length `of_m` of contact lines gone.
    fn pressure_pa(&self, force_n: f64, lost_m: f64, of_m: f64) -> f64 {
        // What is left of a pitted line: a tenth at least, since rims stand between the pits.
        let left = (of_m - lost_m).max(0.1 * of_m) / of_m;
        self.pressure_factor * (force_n / (left * self.gear.face_width_m)).sqrt()
    }

    /// Place of a site along the face from its middle (m).
    fn place_m(&self, site: usize, sites: usize) -> f64 {
        self.gear.face_width_m * ((site as f64 + 0.5) / sites as f64 - 0.5)
    }

    /// What the sites bear on the pitch line while the mesh carries a force.
    fn site_loads(&self, force_n: f64) -> SiteLoads {
        let (sites, width) = (self.lives[0].len(), self.gear.face_width_m);
        let Some(HelicalFace { mesh, .. }) = &self.face else {
            return SiteLoads { force_n: vec![force_n; sites], length_m: vec![width; sites] };
        };
        let (section, mut out) = (mesh.section(), SiteLoads { force_n: Vec::new(), length_m: Vec::new() });
        let Some(face) = mesh.face() else { return out };
        let bands = sites.min(face.count() as usize);
        let loads = FaceLoads::new(section, face, force_n, (bands, PLACES), |_, _| 0.0);
        let pitch = section.geometry().pitch_phase();
        let x = pitch / section.contact_ratio() * (PLACES - 1) as f64;
        for site in 0..sites {
            let places = &loads.bands_n[site * bands / sites];
            let before = (x as usize).min(PLACES - 2);
            out.force_n.push(places[before] + (x - before as f64) * (places[before + 1] - places[before]));
            let lag = face.overlap_ratio() * self.place_m(site, sites) / width;
            out.length_m.push(width * loads.pairs_that_carry(pitch + lag).max(f64::MIN_POSITIVE));
        }
        out
    }

    /// Length (m) of the contact line that the pits of a tooth take where the line crosses the
    /// pitch line at a site.
    fn lost_m(&self, tooth: usize, site: usize) -> f64 {
        let Some(HelicalFace { climb, .. }) = self.face else {
            return self.diameters_m(tooth).map(|(_, diameter)| diameter).sum();
        };
        let sites = self.lives[tooth].len();
        let chord = |(other, diameter): (usize, f64)| {
            let height = climb * (self.place_m(other, sites) - self.place_m(site, sites));
            (diameter * diameter - 4.0 * height * height).max(0.0).sqrt()
        };
        self.diameters_m(tooth).map(chord).sum()
    }

    /// Pressure on a whole flank (Pa) at a duty, and hours after which 1 gear of 100 has a pit; of
    /// helical teeth the pressure at the site that bears most.
    pub fn outlook(&self, setup: &SimSetup, duty: &Duty) -> (f64, f64) {
        let loads = self.site_loads(duty.mesh_force_n(&setup.bench, self.stage));
        let most = loads.force_n.into_iter().fold(0.0, f64::max);
        let pressure = self.pressure_pa(most, 0.0, self.gear.face_width_m);
        let ratio = 1e6 * self.law.get("endurance_mpa") / pressure;
        let cycles = REFERENCE_CYCLES * ratio.powf(self.law.get("stress_exponent"));
        (pressure, cycles / duty.passages_per_hour(&setup.bench, self.stage)[usize::from(self.wheel)])
    }

    /// Site and diameter (m) of each pit of a tooth.
    fn diameters_m(&self, tooth: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let grown_in = self.law.get("growth_cycles");
        let sites = self.lives[tooth].iter().zip(&self.passed[tooth]).enumerate();
        sites.filter(|(_, (life, passed))| life <= passed).map(move |(site, (life, passed))| {
            let share = ((passed - life) / grown_in).min(1.0);
            (site, self.full_m * share.sqrt().max(FIRST))
        })
    }

    /// Goes on for so many hours at some duties.
    pub fn advance(&mut self, setup: &SimSetup, duties: &[Duty], hours: f64) {
        let (endurance, exponent) = (1e6 * self.law.get("endurance_mpa"), self.law.get("stress_exponent"));
        let loads: Vec<(f64, SiteLoads)> = duties
            .iter()
            .map(|duty| {
                let passages = duty.passages_per_hour(&setup.bench, self.stage)[usize::from(self.wheel)];
                (duty.share * passages, self.site_loads(duty.mesh_force_n(&setup.bench, self.stage)))
            })
            .collect();
        for _ in 0..PARTS {
            for tooth in 0..self.passed.len() {
                let lost: Vec<f64> = (0..self.lives[tooth].len()).map(|site| self.lost_m(tooth, site)).collect();
                for (site, lost) in lost.into_iter().enumerate() {
                    let worth = |(passages, loads): &(f64, SiteLoads)| {
                        let pressure = self.pressure_pa(loads.force_n[site], lost, loads.length_m[site]);
                        passages * (pressure / endurance).powf(exponent)
                    };
                    let worth = loads.iter().map(worth).sum::<f64>();
                    self.passed[tooth][site] += hours / PARTS as f64 * worth;
                }
            }
        }
    }

    /// Pits of a tooth.
    fn pits(&self, tooth: usize) -> Vec<Pit> {
        let pit = |diameter_m: f64| Pit { diameter_m, depth_m: self.depth_m * diameter_m / self.full_m, height_m: 0.0 };
        self.diameters_m(tooth).map(|(_, diameter)| pit(diameter)).collect()
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
        let area = |tooth: usize| self.diameters_m(tooth).map(|(_, d)| 0.25 * PI * d * d).sum::<f64>() / flank;
        let teeth = 0..self.passed.len();
        let worst = teeth.clone().map(area).fold(0.0, f64::max);
        let counts: Vec<usize> = teeth.map(|tooth| self.diameters_m(tooth).count()).collect();
        (worst, counts.iter().sum(), counts.iter().filter(|&&count| count > 0).count())
    }
}
