//! Force of a whole face by mesh phase and approach, for faces that repeat with the mesh cycle.

use super::{Face, LoadPoint, MeshModel, MeshState, Pairs};

/// Nodes a mesh cycle and along the approach.
const PHASES: usize = 96;
const DEPTHS: usize = 25;
/// The approaches between the first and the last node, by the static one.
const LEAST: f64 = 0.2;
const MOST: f64 = 2.6;
/// Tolerated miss of the force between the nodes, by the force at the static approach. Single places of this size move no mesh harmonic by 1e-5.
const TOLERATED: f64 = 1e-4;
/// Overlap below which pairs come and go too abruptly for a table.
const LEAST_OVERLAP: f64 = 0.25;
/// Places at which the table is held against the slices.
const TRIALS: usize = 97;

/// Bicubic table of force and tangent stiffness.
#[derive(Clone, Debug)]
pub(crate) struct FaceTable {
    /// By phase: force (N) and its derivative by the step of the table (N), by depth.
    rows: Vec<[[f64; 2]; DEPTHS]>,
    first_m: f64,
    per_m: f64,
}

impl FaceTable {
    /// The table about a static approach (m). `None` where the teeth are not alike, where gears turn off their centres, or where the force is no smooth function.
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
        if !whole.repeats_with_the_mesh() || !face.is_whole() || approach_m <= 0.0 {
            return None;
        }
        let first_m = LEAST * approach_m;
        let step_m = (MOST - LEAST) * approach_m / (DEPTHS - 1) as f64;
        let state = |phase: f64| MeshState { phase, displacement_m };
        let mut pairs = Pairs::default();
        let rows = (0..PHASES)
            .map(|p| {
                let mut row = [[0.0; 2]; DEPTHS];
                for cut in face.cuts(whole) {
                    cut.mesh.pairs_behind(&state(p as f64 / PHASES as f64), cut.lag, load, &mut pairs);
                    for (i, [force, slope]) in row.iter_mut().enumerate() {
                        let now = pairs.force(first_m + i as f64 * step_m - cut.gap_m);
                        *force += now.force_n / face.count();
                        *slope += now.stiffness_n_per_m * step_m / face.count();
                    }
                }
                row
            })
            .collect();
        let out = Self { rows, first_m, per_m: 1.0 / step_m };
        let scale = face.force(whole, &state(0.0), load, approach_m).0;
        let misses = (0..TRIALS).any(|i| {
            let phase = (i as f64 * 0.618_033_988_749_895).fract();
            let depth =
                first_m + (0.25 + 0.5 * (i as f64 * 0.381_966_011_250_105).fract()) * (MOST - LEAST) * approach_m;
            let (exact, _) = face.force(whole, &state(phase), load, depth);
            out.at(phase, depth).is_none_or(|(found, _)| (found - exact).abs() > TOLERATED * scale)
        });
        (!misses).then_some(out)
    }

    /// Force (N) and tangent stiffness (N/m); `None` outside of the table.
    #[inline]
    pub(crate) fn at(&self, phase: f64, approach_m: f64) -> Option<(f64, f64)> {
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
