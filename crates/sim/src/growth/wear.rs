//! Wear by Archard's law: the flanks lose depth where they press and slide, and what is lost moves the load to other places.
//!
//! `dh/dN = k p̄ s` at each place of each flank, with the mean contact pressure p̄ and the way s that the other flank slides over the place in one passage (Archard 1953; for gears
//! Flodin & Andersson 1997). The pinion's teeth pass z₂/z₁ times as often as the wheel's. All teeth of a gear wear alike: teeth that differ, by pitch errors or damage, would each meet all
//! others in turn.

use gearwatch_core::bench::Bench;

use super::contact::{FlankPoint, PLACES, pair_loads};
use super::law::Constants;
use super::{Duty, GrowthError};
use crate::faults::{GearModifications, ToothModifications};
use crate::mesh::MeshModel;
use crate::setup::SimSetup;

/// Most that any place loses within one step of the integration (m): a twentieth of what teeth give way at light loads, so that the load can follow.
const STEP_M: f64 = 0.2e-6;

/// Worn flanks of a stage.
#[derive(Clone, Debug)]
pub struct Wear {
    stage: usize,
    k_m2_per_n: f64,
    mesh: MeshModel,
    /// Lost depth by place, pinion and wheel (m).
    worn_m: [Vec<f64>; 2],
}

impl Wear {
    /// Flanks as they are in a setup, before any of this wear.
    ///
    /// # Errors
    /// For a gear pair that cannot be.
    pub fn new(setup: &SimSetup, stage: usize, law: &Constants) -> Result<Self, GrowthError> {
        let mesh = MeshModel::new(&setup.bench, stage, &setup.mesh, &even(&setup.teeth[stage]))?;
        Ok(Self { stage, k_m2_per_n: law.get("k_m2_per_n"), mesh, worn_m: [vec![0.0; PLACES], vec![0.0; PLACES]] })
    }

    /// Depth of both flanks together at a place of the path (m).
    fn opened_m(&self, cycles: f64) -> f64 {
        let x = (cycles / self.mesh.contact_ratio()).clamp(0.0, 1.0) * (PLACES - 1) as f64;
        let before = (x as usize).min(PLACES - 2);
        let at = |i: usize| self.worn_m[0][i] + self.worn_m[1][i];
        at(before) + (x - before as f64) * (at(before + 1) - at(before))
    }

    /// What one passage takes from each place of pinion and wheel under a mesh force (m).
    pub fn per_passage_m(&self, force_n: f64) -> [Vec<f64>; 2] {
        let loads = pair_loads(&self.mesh, force_n, 0, PLACES, |s| self.opened_m(s));
        let length = self.mesh.geometry().pinion.face_width_m.min(self.mesh.geometry().wheel.face_width_m);
        let mut out = [vec![0.0; PLACES], vec![0.0; PLACES]];
        for (i, &load) in loads.iter().enumerate() {
            let cycles = self.mesh.contact_ratio() * i as f64 / (PLACES - 1) as f64;
            let point = FlankPoint::new(&self.mesh, cycles, load, length);
            for (flank, slid) in out.iter_mut().zip(point.sliding_m) {
                flank[i] = if load > 0.0 { self.k_m2_per_n * point.mean_pressure_pa * slid } else { 0.0 };
            }
        }
        out
    }

    /// Goes on for so many hours at some duties.
    pub fn advance(&mut self, bench: &Bench, duties: &[Duty], hours: f64) {
        let mut left = hours;
        while left > 0.0 {
            let mut rate = [vec![0.0; PLACES], vec![0.0; PLACES]];
            for duty in duties {
                let passages = duty.passages_per_hour(bench, self.stage);
                let lost = self.per_passage_m(duty.mesh_force_n(bench, self.stage));
                for flank in 0..2 {
                    for (rate, lost) in rate[flank].iter_mut().zip(&lost[flank]) {
                        *rate += duty.share * passages[flank] * lost;
                    }
                }
            }
            let fastest = rate.iter().flatten().fold(0.0_f64, |most, &rate| most.max(rate));
            let step = if fastest > 0.0 { left.min(STEP_M / fastest) } else { left };
            for (worn, rate) in self.worn_m.iter_mut().zip(&rate) {
                worn.iter_mut().zip(rate).for_each(|(worn, rate)| *worn += step * rate);
            }
            left = if step >= left { 0.0 } else { left - step };
        }
    }

    /// Adds the lost depth to a setup.
    pub fn apply(&self, setup: &mut SimSetup) {
        let teeth = &mut setup.teeth[self.stage];
        for (gear, worn) in [&mut teeth.pinion, &mut teeth.wheel].into_iter().zip(&self.worn_m) {
            gear.worn_m.clone_from(worn);
        }
    }

    /// Largest depth of both flanks together (m).
    pub fn size_m(&self) -> f64 {
        (0..PLACES).map(|i| self.worn_m[0][i] + self.worn_m[1][i]).fold(0.0, f64::max)
    }

    /// Lost depth by place of the path, entry first, of pinion and wheel (m).
    pub fn worn_m(&self) -> &[Vec<f64>; 2] {
        &self.worn_m
    }
}

/// The teeth without what only some of them have.
pub(super) fn even(teeth: &ToothModifications) -> ToothModifications {
    let even = |gear: &GearModifications| GearModifications {
        all_teeth: gear.all_teeth.clone(),
        tip_relief: gear.tip_relief,
        worn_m: gear.worn_m.clone(),
        ..GearModifications::default()
    };
    ToothModifications { pinion: even(&teeth.pinion), wheel: even(&teeth.wheel), pair: teeth.pair.clone() }
}
