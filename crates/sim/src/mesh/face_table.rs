//! Force of a whole face by mesh phase and approach, for faces that repeat with the mesh cycle but
//! where single teeth are damaged.

use super::{Face, LoadPoint, MeshForce, MeshModel, MeshState, Pairs};

/// Nodes a mesh cycle and along the approach.
const PHASES: usize = 192;
const DEPTHS: usize = 25;
/// The approaches between the first and the last node, by the static one.
const LEAST: f64 = 0.2;
const MOST: f64 = 2.6;
/// Tolerated miss of the force between the nodes, by the force at the static approach: single
/// places where a slice comes to carry. Mesh harmonics are met within 1e-5 of it
/// (`oracle_harmonics_of_the_table_are_those_of_the_slices`).
const TOLERATED: f64 = 1e-3;
/// Overlap below which pairs come and go too abruptly for a table.
const LEAST_OVERLAP: f64 = 0.25;
/// Mesh cycles among which one without a damaged tooth is looked for.
const MOST_CYCLES: u64 = 1000;
/// Places at which the table is held against the slices.
const TRIALS: usize = 97;

/// How much earlier or later than the pairs are looked for one may still be near contact (mesh
/// cycles); displaced axes move less.
const MARGIN: f64 = 0.1;

/// Which teeth of a gear are not like the others, by number.
type Special = Vec<bool>;

/// Bicubic table of force and tangent stiffness.
#[derive(Clone, Debug)]
pub(crate) struct FaceTable {
    /// By phase: force (N) and its derivative by the step of the table (N), by depth.
    rows: Vec<[[f64; 2]; DEPTHS]>,
    first_m: f64,
    per_m: f64,
    /// Of pinion and wheel; `None` where all teeth are alike.
    special: Option<[Special; 2]>,
    /// Pairs with numbers from the phase less the first to the phase plus the second are near
    /// contact.
    near: [f64; 2],
}

impl FaceTable {
    /// The table about a static approach (m). `None` where most of the teeth differ, where gears
    /// turn off their centres, or where the force is no smooth function.
    pub(crate) fn new(
        face: &Face,
        whole: &MeshModel,
        load: &LoadPoint,
        displacement_m: [f64; 2],
        approach_m: f64,
    ) -> Option<Self> {
        if face.overlap_ratio() < LEAST_OVERLAP {
            return None;
        }
        if !whole.repeats_with_the_mesh() || approach_m <= 0.0 {
            return None;
        }
        let reach = whole.reach() + MARGIN + 0.5 * face.overlap_ratio();
        let special = whole.special_teeth();
        let mut out = Self {
            rows: Vec::new(),
            first_m: LEAST * approach_m,
            per_m: (DEPTHS - 1) as f64 / ((MOST - LEAST) * approach_m),
            special: special.iter().flatten().any(|&damaged| damaged).then_some(special),
            near: [whole.contact_ratio() + reach, reach],
        };
        // A mesh cycle without a damaged tooth.
        let teeth = whole.tooth_counts();
        let cycles = u64::from(teeth[0]) * u64::from(teeth[1]);
        let sound = |cycle: &f64| out.is_sound(*cycle) && out.is_sound(cycle + 1.0);
        let base = (0..cycles.min(MOST_CYCLES)).map(|cycle| cycle as f64).find(sound)?;
        let first_m = LEAST * approach_m;
        let step_m = (MOST - LEAST) * approach_m / (DEPTHS - 1) as f64;
        let state = |phase: f64| MeshState { phase, displacement_m };
        let mut pairs = Pairs::default();
        out.rows = (0..PHASES)
            .map(|p| {
                let mut row = [[0.0; 2]; DEPTHS];
                for cut in face.cuts(whole) {
                    cut.mesh.pairs_behind(&state(base + p as f64 / PHASES as f64), cut.lag, load, &mut pairs);
                    add_slice(&mut row, (&pairs, first_m - cut.gap_m), step_m, 1.0 / face.count());
                }
                row
            })
            .collect();
        let scale = face.force(whole, &state(base), load, approach_m).0;
        let misses = (0..TRIALS).any(|i| {
            let phase = (i as f64 * 0.618_033_988_749_895).fract();
            let depth =
                first_m + (0.25 + 0.5 * (i as f64 * 0.381_966_011_250_105).fract()) * (MOST - LEAST) * approach_m;
            let (exact, _) = face.force(whole, &state(base + phase), load, depth);
            out.at(base + phase, depth).is_none_or(|(found, _)| (found - exact).abs() > TOLERATED * scale)
        });
        (!misses).then_some(out)
    }

    /// No damaged tooth is near contact at a phase.
    #[inline]
    fn is_sound(&self, phase: f64) -> bool {
        let Some([pinion, wheel]) = &self.special else { return true };
        let (first, last) = ((phase - self.near[0]).ceil() as i64, (phase + self.near[1]).floor() as i64);
        let damaged = |teeth: &Special, pair: i64| teeth[pair.rem_euclid(teeth.len() as i64) as usize];
        !(first..=last).any(|pair| damaged(pinion, pair) || damaged(wheel, pair))
    }

    /// Force (N) and tangent stiffness (N/m); `None` outside of the table, and where a damaged
    /// tooth is near contact.
    #[inline]
    pub(crate) fn at(&self, phase: f64, approach_m: f64) -> Option<(f64, f64)> {
        if !self.is_sound(phase) {
            return None;
        }
        let depth = (approach_m - self.first_m) * self.per_m;
        if !(0.0..(DEPTHS - 1) as f64).contains(&depth) {
            return None;
        }
        let (j, y) = (depth as usize, depth.fract());
        // Cubics of Hermite along the approach, for the value and for its derivative by the step.
        let (a, b) = (1.0 - y, y);
        let value = [a * a * (1.0 + 2.0 * b), a * a * b, b * b * (3.0 - 2.0 * b), -b * b * a];
        let slope = [-6.0 * a * b, a * (1.0 - 3.0 * b), 6.0 * a * b, b * (3.0 * b - 2.0)];
        let cycle = (phase - phase.floor()) * PHASES as f64;
        let (i, x) = (cycle as usize, cycle.fract());
        // The cubic of Catmull and Rom through four phases.
        let weights = [
            0.5 * x * (x * (2.0 - x) - 1.0),
            0.5 * (x * x * (3.0 * x - 5.0) + 2.0),
            0.5 * x * (x * (4.0 - 3.0 * x) + 1.0),
            0.5 * x * x * (x - 1.0),
        ];
        let (mut force, mut stiffness) = (0.0, 0.0);
        for (k, weight) in weights.into_iter().enumerate() {
            let row = &self.rows[(i + PHASES + k - 1) % PHASES];
            let [f0, s0] = row[j];
            let [f1, s1] = row[j + 1];
            force += weight * (value[0] * f0 + value[1] * s0 + value[2] * f1 + value[3] * s1);
            stiffness += weight * (slope[0] * f0 + slope[1] * s0 + slope[2] * f1 + slope[3] * s1);
        }
        Some((force, stiffness * self.per_m))
    }

    /// Approach (m) and tangent stiffness (N/m) at a force (N); `None` outside of the table.
    pub(crate) fn static_point(&self, phase: f64, force_n: f64) -> Option<(f64, f64)> {
        let middle = 0.5 * (DEPTHS - 1) as f64 / self.per_m;
        let mut approach = self.first_m + middle;
        for _ in 0..32 {
            let (force, stiffness) = self.at(phase, approach)?;
            let step = (force_n - force) / stiffness;
            approach += step;
            if step.abs() <= 1e-12 * approach.abs() {
                return Some((approach, stiffness));
            }
        }
        None
    }
}

/// Adds a share of one slice's force and slope at every depth, the first of which is an approach of
/// `first_m`.
///
/// While one set of pairs carries, the force is a straight line. The conditions of the set are
/// linear in the approach as well, so that a set that carries at two depths carries at all between
/// them: only where the sets at both ends differ does the middle have to be looked at.
fn add_slice(row: &mut [[f64; 2]; DEPTHS], (pairs, first_m): (&Pairs, f64), step_m: f64, share: f64) {
    let at = |i: usize| pairs.force(first_m + i as f64 * step_m);
    let mut put = |i: usize, force_n: f64, stiffness_n_per_m: f64| {
        row[i][0] += share * force_n;
        row[i][1] += share * stiffness_n_per_m * step_m;
    };
    // Ends of the stretches that are left, the furthest one first.
    let mut ends = [(0, MeshForce::default()); DEPTHS];
    let (mut begin, mut low) = (0, at(0));
    put(0, low.force_n, low.stiffness_n_per_m);
    ends[0] = (DEPTHS - 1, at(DEPTHS - 1));
    let mut left = 1;
    while left > 0 {
        let (end, high) = ends[left - 1];
        if high.set == low.set || end == begin + 1 {
            for i in begin + 1..end {
                put(i, low.force_n + low.stiffness_n_per_m * ((i - begin) as f64 * step_m), low.stiffness_n_per_m);
            }
            put(end, high.force_n, high.stiffness_n_per_m);
            (begin, low) = (end, high);
            left -= 1;
        } else {
            let middle = (begin + end) / 2;
            ends[left] = (middle, at(middle));
            left += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use num_complex::Complex64;

    use super::*;
    use crate::mesh::{MeshOptions, StageMesh};

    /// Force of table and slices at places along some mesh cycles from the first, at an approach
    /// near that of the load.
    fn both(effects: &[&str], cycles: usize, places: usize) -> (Vec<(Option<f64>, f64)>, f64) {
        let mut bench = crate::shipped::bench("helical-two-stage").unwrap();
        bench.effects = effects
            .iter()
            .map(|effect| gearwatch_core::bench::EffectSpec {
                effect: (*effect).into(),
                place: "fast.pinion".into(),
                parameters: [].into(),
            })
            .collect();
        let setup = crate::effects::setup(&bench, &[]).unwrap();
        let mesh =
            StageMesh::new(&setup.bench, 0, &MeshOptions::default(), &setup.teeth[0], &mut Default::default()).unwrap();
        let (face, whole) = (mesh.face().unwrap(), mesh.section());
        let load = mesh.at_load(1000.0);
        let approach = mesh.static_point(10.0, &load).0;
        let table = FaceTable::new(face, whole, &load, [0.0; 2], approach).expect("a table");
        let at = |i: usize| {
            let phase = i as f64 / places as f64;
            let exact = face.force(whole, &MeshState { phase, displacement_m: [0.0; 2] }, &load, approach).0;
            (table.at(phase, approach).map(|(force, _)| force), exact)
        };
        ((0..cycles * places).map(at).collect(), 1000.0)
    }

    /// Mesh harmonics 1 to 5 of the force at one approach are those of the slices within 1e-5 of
    /// the load.
    #[test]
    fn oracle_harmonics_of_the_table_are_those_of_the_slices() {
        let places = 960;
        let (forces, load) = both(&[], 1, places);
        for harmonic in 1..=5 {
            let part = |i: usize, force: f64| {
                Complex64::from_polar(2.0 * force / places as f64, -TAU * (harmonic * i) as f64 / places as f64)
            };
            let miss: Complex64 =
                forces.iter().enumerate().map(|(i, (table, exact))| part(i, table.unwrap() - exact)).sum();
            assert!(miss.norm() < 1e-5 * load, "{harmonic}: {:.1e}", miss.norm() / load);
        }
    }

    /// Force and slope of slices at each depth are those of their pairs, asked one by one: the
    /// straight lines between are exact.
    #[test]
    fn oracle_depths_of_a_slice_are_those_of_its_pairs() {
        let mut bench = crate::shipped::bench("helical-two-stage").unwrap();
        bench.effects.clear();
        let setup = crate::effects::setup(&bench, &[]).unwrap();
        for body_coupling in [None, Some(0.3)] {
            let options = MeshOptions { body_coupling, ..MeshOptions::default() };
            let mesh = StageMesh::new(&setup.bench, 0, &options, &setup.teeth[0], &mut Default::default()).unwrap();
            let (face, whole) = (mesh.face().unwrap(), mesh.section());
            let load = mesh.at_load(1000.0);
            let approach = mesh.static_point(10.0, &load).0;
            let (first, step) = (LEAST * approach, (MOST - LEAST) * approach / (DEPTHS - 1) as f64);
            let mut pairs = Pairs::default();
            for place in 0..96 {
                let state = MeshState { phase: f64::from(place) / 96.0, displacement_m: [0.0; 2] };
                for cut in face.cuts(whole) {
                    cut.mesh.pairs_behind(&state, cut.lag, &load, &mut pairs);
                    let mut row = [[0.0; 2]; DEPTHS];
                    add_slice(&mut row, (&pairs, first - cut.gap_m), step, 1.0);
                    for (i, found) in row.into_iter().enumerate() {
                        let exact = pairs.force(first - cut.gap_m + i as f64 * step);
                        let expected = [exact.force_n, exact.stiffness_n_per_m * step];
                        // Rounding of a load of 1 kN.
                        let near = found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9);
                        assert!(near, "{place}, {i}: {found:?} {expected:?}");
                    }
                }
            }
        }
    }

    /// Near a damaged tooth the table has no answer, and of the 23 mesh cycles of a turn it leaves
    /// out those alone in which that tooth may touch; elsewhere it holds.
    #[test]
    fn oracle_a_damaged_tooth_is_left_to_the_slices() {
        for effect in ["tooth_breakage", "root_crack", "pitting"] {
            let (forces, load) = both(&[effect], 23, 96);
            let known = forces.iter().filter(|(table, _)| table.is_some()).count() as f64 / forces.len() as f64;
            assert!((0.7..0.9).contains(&known), "{effect}: {known}");
            for (table, exact) in &forces {
                assert!(
                    table.is_none_or(|force| (force - exact).abs() < TOLERATED * load),
                    "{effect}: {table:?} {exact}"
                );
            }
        }
    }
}
