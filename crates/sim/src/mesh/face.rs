//! The face of a pair cut into thin slices: each a section with its own lag, missing material and
//! damage.

use super::{LoadPoint, MeshModel, MeshProblem, MeshState, Pairs};
use crate::faults::{Breakage, BreakageKind, GearModifications, ToothModifications};

/// Most steps of Newton's method on a force that is piecewise linear in the approach.
const ROUNDS: usize = 64;

/// One slice.
#[derive(Clone, Copy, Debug)]
struct Slice {
    /// By which its pairs enter later (mesh cycles).
    lag: f64,
    /// Missing material (m).
    gap_m: f64,
    /// Of [`Face::sections`]; `None` for the section of the whole face.
    section: Option<usize>,
}

/// Slices along the face width. An immutable plan; the section of the whole face stands beside it.
#[derive(Clone, Debug)]
pub struct Face {
    slices: Vec<Slice>,
    /// Where a part of a tooth is broken off, or wear is another one.
    sections: Vec<MeshModel>,
    /// Base helix angle β_b (rad).
    base_helix_rad: f64,
    /// Overlap ratio ε_β.
    overlap_ratio: f64,
    /// Factor on the contact compliance of the transverse section.
    hertz_factor: f64,
}

/// What a slice is asked for: the section's model and where its teeth stand.
pub(crate) struct Cut<'a> {
    /// The section.
    pub(crate) mesh: &'a MeshModel,
    /// Later by this (mesh cycles).
    pub(crate) lag: f64,
    /// Missing material (m).
    pub(crate) gap_m: f64,
}

impl Face {
    /// Slices of equal width, `gap_m` by the place along the face (−½ to ½).
    pub(super) fn new(
        slices: usize,
        overlap_ratio: f64,
        base_helix_rad: f64,
        hertz_factor: f64,
        gap_m: impl Fn(f64) -> f64,
    ) -> Self {
        let slices = (0..slices)
            .map(|j| (j as f64 + 0.5) / slices as f64 - 0.5)
            .map(|x| Slice { lag: overlap_ratio * x, gap_m: gap_m(x), section: None })
            .collect();
        Self { slices, sections: Vec::new(), base_helix_rad, overlap_ratio, hertz_factor }
    }

    /// The damage of the section that stands for the whole face: that of the end that enters first.
    pub(super) fn whole(&self, teeth: &ToothModifications) -> ToothModifications {
        broken(teeth, 0, self.slices.len())
    }

    /// Gives the slices that lie in a broken part of a tooth, or in a band of other wear, a section
    /// of their own, which `make` builds.
    pub(super) fn break_off(
        &mut self,
        teeth: &ToothModifications,
        mut make: impl FnMut(&ToothModifications) -> Result<MeshModel, MeshProblem>,
    ) -> Result<(), MeshProblem> {
        let count = self.slices.len();
        let whole = self.whole(teeth);
        let mut known: Vec<ToothModifications> = Vec::new();
        for (j, slice) in self.slices.iter_mut().enumerate() {
            let here = broken(teeth, j, count);
            if here == whole {
                continue;
            }
            let section = match known.iter().position(|other| *other == here) {
                Some(section) => section,
                None => {
                    self.sections.push(make(&here)?);
                    known.push(here);
                    known.len() - 1
                }
            };
            slice.section = Some(section);
        }
        Ok(())
    }

    /// Base helix angle β_b (rad).
    pub fn base_helix_rad(&self) -> f64 {
        self.base_helix_rad
    }

    /// Overlap ratio ε_β.
    pub fn overlap_ratio(&self) -> f64 {
        self.overlap_ratio
    }

    /// What the compliances of a slice take from a force on the whole face.
    pub(crate) fn at_load(&self, whole: &MeshModel, load_n: f64) -> LoadPoint {
        let mut load = whole.at_load(load_n);
        load.hertz_alone *= self.hertz_factor;
        load.hertz_shared *= self.hertz_factor;
        // What a slice carries under the static load is not known here: its law stays the secant.
        load.hardening = 0.0;
        load
    }

    /// The slices, `whole` being the section of the whole face.
    pub(crate) fn cuts<'a>(&'a self, whole: &'a MeshModel) -> impl Iterator<Item = Cut<'a>> {
        self.slices.iter().map(move |slice| Cut {
            mesh: slice.section.map_or(whole, |section| &self.sections[section]),
            lag: slice.lag,
            gap_m: slice.gap_m,
        })
    }

    /// Number of slices.
    pub(crate) fn count(&self) -> f64 {
        self.slices.len() as f64
    }

    /// Force (N) and tangent stiffness (N/m) at an approach (m).
    pub(crate) fn force(&self, whole: &MeshModel, state: &MeshState, load: &LoadPoint, approach_m: f64) -> (f64, f64) {
        let mut pairs = Pairs::default();
        let (mut force, mut stiffness) = (0.0, 0.0);
        for cut in self.cuts(whole) {
            cut.mesh.pairs_behind(state, cut.lag, load, &mut pairs);
            let of_slice = pairs.force(approach_m - cut.gap_m);
            force += of_slice.force_n;
            stiffness += of_slice.stiffness_n_per_m;
        }
        (force / self.count(), stiffness / self.count())
    }

    /// Static approach (m) under a force and the tangent stiffness (N/m) there. `None` without load
    /// or where nothing can touch.
    pub(crate) fn static_point(
        &self,
        whole: &MeshModel,
        state: &MeshState,
        load: &LoadPoint,
        force_n: f64,
    ) -> Option<(f64, f64)> {
        if force_n <= 0.0 {
            return None;
        }
        Self::approach_of(&self.pairs(whole, state, load), force_n)
    }

    /// The pairs near contact in each slice, with its missing material (m).
    pub(crate) fn pairs(&self, whole: &MeshModel, state: &MeshState, load: &LoadPoint) -> Vec<(Pairs, f64)> {
        self.cuts(whole)
            .map(|cut| {
                let mut pairs = Pairs::default();
                cut.mesh.pairs_behind(state, cut.lag, load, &mut pairs);
                (pairs, cut.gap_m)
            })
            .collect()
    }

    /// Static approach (m) of the pairs of all slices under a force, and the tangent stiffness
    /// (N/m) there. `None` where nothing can touch.
    pub(crate) fn approach_of(found: &[(Pairs, f64)], force_n: f64) -> Option<(f64, f64)> {
        let count = found.len() as f64;
        // The force rises and steepens with the approach but for pairs that unload others: Newton
        // from the stiff side.
        let alone = found.iter().filter_map(|(pairs, gap)| {
            let (approach, stiffness) = pairs.approach_at(force_n)?;
            (stiffness > 0.0).then_some(approach + gap)
        });
        let mut approach = alone.max_by(f64::total_cmp)?;
        let mut tangent = 0.0;
        for _ in 0..ROUNDS {
            let (mut force, mut stiffness) = (0.0, 0.0);
            for (pairs, gap) in found {
                let of_slice = pairs.force(approach - gap);
                force += of_slice.force_n;
                stiffness += of_slice.stiffness_n_per_m;
            }
            tangent = stiffness / count;
            let step = (force_n - force / count) / tangent;
            approach += step;
            if step.abs() <= 1e-13 * approach.abs() {
                break;
            }
        }
        Some((approach, tangent))
    }
}

/// The damage in slice `j` of `count`: the worn depth is that of its band, and a tooth of which a
/// part of the width is broken off is whole before the break and gone behind it, the break being at
/// the end that enters last.
fn broken(teeth: &ToothModifications, j: usize, count: usize) -> ToothModifications {
    let mut out = teeth.clone();
    let local = |gear: &mut GearModifications| {
        for damage in gear.teeth.values_mut().chain([&mut gear.all_teeth]) {
            if let Some(Breakage { fraction, kind: BreakageKind::Width }) = damage.breakage {
                let lost = (fraction * count as f64 - (count - 1 - j) as f64).clamp(0.0, 1.0);
                let breakage = Breakage { fraction: lost, kind: BreakageKind::Width };
                damage.breakage = (lost > 1e-9).then_some(breakage);
            }
        }
        gear.worn_m = gear.worn_in_slice_m(j, count).to_vec();
        gear.worn_bands_m.clear();
    };
    local(&mut out.pinion);
    local(&mut out.wheel);
    out
}
