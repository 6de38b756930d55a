//! Wear by Archard's law: the flanks lose depth where they press and slide, and what is lost moves
//! the load to other places.
//!
//! `dh/dN = k p̄ s` at each place of each flank, with the mean contact pressure p̄ and the way s
//! that the other flank slides over the place in one passage (Archard 1953; for gears Flodin &
//! Andersson 1997). The pinion's teeth pass z₂/z₁ times as often as the wheel's. All teeth of a
//! gear wear alike: teeth that differ, by pitch errors or damage, would each meet all others in
//! turn.
//!
//! Helical teeth wear by the load of the slices of their face, in sixteen bands along it. Their
//! flanks lose depth along the normal, which opens the transverse line of action by `1/cos β_b` of
//! it.

use gearwatch_core::bench::Bench;

use super::contact::{FaceLoads, FlankPoint, PLACES, pair_loads};
use super::law::Constants;
use super::{Duty, GrowthError};
use crate::faults::{GearModifications, ToothModifications};
use crate::mesh::{FlankStore, StageMesh};
use crate::setup::SimSetup;

/// Most that any place loses within one step of the integration (m): a twentieth of what teeth give
/// way at light loads, so that the load can follow.
const STEP_M: f64 = 0.2e-6;

/// Bands of a helical face that wear by themselves: the fewest slices that a face has.
const BANDS: usize = 16;

/// Worn flanks of a stage.
#[derive(Clone, Debug)]
pub struct Wear {
    stage: usize,
    k_m2_per_n: f64,
    mesh: StageMesh,
    /// Lost depth along the transverse line of action by band of the face and place, pinion and
    /// wheel (m).
    worn_m: Worn,
}

/// By gear, band and place.
type Worn = [Vec<Vec<f64>>; 2];

impl Wear {
    /// Flanks as they are in a setup, before any of this wear.
    ///
    /// # Errors
    /// For a gear pair that cannot be.
    pub fn new(setup: &SimSetup, stage: usize, law: &Constants) -> Result<Self, GrowthError> {
        let teeth = even(&setup.teeth[stage]);
        let mesh = StageMesh::new(&setup.bench, stage, &setup.mesh, &teeth, &mut FlankStore::default())?;
        let bands = if mesh.face().is_some() { BANDS } else { 1 };
        let worn_m = [(); 2].map(|()| vec![vec![0.0; PLACES]; bands]);
        Ok(Self { stage, k_m2_per_n: law.get("k_m2_per_n"), mesh, worn_m })
    }

    /// Depth of both flanks together at a place of the path in a band (m).
    fn opened_m(&self, band: usize, cycles: f64) -> f64 {
        let x = (cycles / self.mesh.section().contact_ratio()).clamp(0.0, 1.0) * (PLACES - 1) as f64;
        let before = (x as usize).min(PLACES - 2);
        let at = |i: usize| self.worn_m[0][band][i] + self.worn_m[1][band][i];
        at(before) + (x - before as f64) * (at(before + 1) - at(before))
    }

    /// What one passage takes from each place of pinion and wheel under a mesh force, by band,
    /// along the transverse line of action (m).
    pub fn per_passage_m(&self, force_n: f64) -> [Vec<Vec<f64>>; 2] {
        let mesh = self.mesh.section();
        let (loads, helix_rad) = match self.mesh.face() {
            None => (vec![pair_loads(mesh, force_n, 0, PLACES, |s| self.opened_m(0, s))], 0.0),
            Some(face) => {
                let opened = |band: usize, s: f64| self.opened_m(band, s);
                (FaceLoads::new(mesh, face, force_n, (BANDS, PLACES), opened).bands_n, face.base_helix_rad())
            }
        };
        let length = mesh.geometry().pinion.face_width_m.min(mesh.geometry().wheel.face_width_m);
        let mut out = [(); 2].map(|()| vec![vec![0.0; PLACES]; loads.len()]);
        for (band, loads) in loads.iter().enumerate() {
            for (i, &load) in loads.iter().enumerate() {
                let cycles = mesh.contact_ratio() * i as f64 / (PLACES - 1) as f64;
                let point = FlankPoint::inclined(mesh, cycles, load, length, helix_rad);
                for (flank, slid) in out.iter_mut().zip(point.sliding_m) {
                    // The flank loses depth along its normal.
                    let depth = self.k_m2_per_n * point.mean_pressure_pa * slid / helix_rad.cos();
                    flank[band][i] = if load > 0.0 { depth } else { 0.0 };
                }
            }
        }
        out
    }

    /// Goes on for so many hours at some duties.
    pub fn advance(&mut self, bench: &Bench, duties: &[Duty], hours: f64) {
        let mut left = hours;
        while left > 0.0 {
            let mut rate = self.worn_m.each_ref().map(|bands| vec![vec![0.0; PLACES]; bands.len()]);
            for duty in duties {
                let passages = duty.passages_per_hour(bench, self.stage);
                let lost = self.per_passage_m(duty.mesh_force_n(bench, self.stage));
                for (flank, passages) in passages.into_iter().enumerate() {
                    for (rate, lost) in rate[flank].iter_mut().flatten().zip(lost[flank].iter().flatten()) {
                        *rate += duty.share * passages * lost;
                    }
                }
            }
            let fastest = rate.iter().flatten().flatten().fold(0.0_f64, |most, &rate| most.max(rate));
            let step = if fastest > 0.0 { left.min(STEP_M / fastest) } else { left };
            for (worn, rate) in self.worn_m.iter_mut().flatten().flatten().zip(rate.iter().flatten().flatten()) {
                *worn += step * rate;
            }
            left = if step >= left { 0.0 } else { left - step };
        }
    }

    /// Adds the lost depth to a setup.
    pub fn apply(&self, setup: &mut SimSetup) {
        let teeth = &mut setup.teeth[self.stage];
        for (gear, worn) in [&mut teeth.pinion, &mut teeth.wheel].into_iter().zip(&self.worn_m) {
            match &worn[..] {
                [all] => gear.worn_m.clone_from(all),
                bands => gear.worn_bands_m = bands.to_vec(),
            }
        }
    }

    /// Largest depth of both flanks together along the transverse line of action (m).
    pub fn size_m(&self) -> f64 {
        let depth = |band: usize, i: usize| self.worn_m[0][band][i] + self.worn_m[1][band][i];
        let bands = 0..self.worn_m[0].len();
        bands.flat_map(|band| (0..PLACES).map(move |i| depth(band, i))).fold(0.0, f64::max)
    }

    /// Lost depth by place of the path, entry first, of pinion and wheel (m), as a mean over the
    /// face.
    pub fn worn_m(&self) -> [Vec<f64>; 2] {
        let mean = |bands: &Vec<Vec<f64>>| {
            let at = |i: usize| bands.iter().map(|band| band[i]).sum::<f64>() / bands.len() as f64;
            (0..PLACES).map(at).collect()
        };
        self.worn_m.each_ref().map(mean)
    }

    /// The same by band of the face, the end that enters first in front; of spur teeth one band.
    pub fn bands_m(&self) -> &[Vec<Vec<f64>>; 2] {
        &self.worn_m
    }
}

/// The teeth without what only some of them have.
pub(super) fn even(teeth: &ToothModifications) -> ToothModifications {
    let even = |gear: &GearModifications| GearModifications {
        all_teeth: gear.all_teeth.clone(),
        tip_relief: gear.tip_relief,
        worn_m: gear.worn_m.clone(),
        worn_bands_m: gear.worn_bands_m.clone(),
        ..GearModifications::default()
    };
    ToothModifications { pinion: even(&teeth.pinion), wheel: even(&teeth.wheel), pair: teeth.pair.clone() }
}
