//! Whether it is the teeth of one gear that changed, or something that concerns all teeth.
//!
//! Errors of single teeth and run-out *add* to what a gear's sidebands come from: a line of
//! amplitude `g₀` becomes `g₀ + r g`, where both are sums over many teeth, of unknown phase. The
//! ratio of two such amplitudes has a known distribution (Goodman 1985, Lee et al. 1994, of two
//! correlated complex Gaussian variables): even about the mean rise `½ ln(1 + r²)`. What concerns
//! all teeth moves the sidebands of both gears either way, as it moves the mesh harmonics that they
//! stand beside.

use gearwatch_core::train::Train;

use crate::change::locate::Cell;
use crate::change::masks::{INDEPENDENT, SPREADS, TAIL, spread};
use crate::read::lines::{Family, SIDE_OFFSETS};

/// Log density of a change (ln) that spreads either way, beside the noise and repetition of its
/// line.
fn either_way(cell: &Cell, spread: f64) -> f64 {
    let variance = spread * spread + cell.variance;
    -0.5 * variance.ln() - 0.5 * (TAIL + 1.0) * (cell.change * cell.change / (TAIL * variance)).ln_1p() + T_PEAK
}

/// ln 3/8, of a t distribution at its middle: Γ(5/2) / (Γ(2) √(4π)) with four degrees of freedom.
const T_PEAK: f64 = -0.980_829_253_011_726_2;
const _: () = assert!(TAIL == 4.0, "T_PEAK is that of four degrees of freedom");

/// Log density of a change (ln) where `spread²` times the old power was added in any phase. Noise
/// and repetition widen it as an addition of twice their variance would, and do not raise it.
fn added(cell: &Cell, spread: f64) -> f64 {
    let power = spread * spread;
    let apart = power + 2.0 * cell.variance;
    let off = (cell.change - 0.5 * power.ln_1p()).abs();
    // With u = exp(−2 off), ε = 1 − ρ² = apart/(1 + apart): 2 u ε (1 + u)/((1 + u)² − 4 (1 − ε)
    // u)^1.5.
    let (u, own) = ((-2.0 * off).exp(), apart / (1.0 + apart));
    let spread_out = (1.0 - u).powi(2) + 4.0 * own * u;
    (2.0 * own * (1.0 + u)).ln() - 2.0 * off - 1.5 * spread_out.ln()
}

type Density = fn(&Cell, f64) -> f64;

/// Log likelihood of a set of lines by the spread of their changes; `None` of none.
fn by_spread(cells: &[Cell], of: &dyn Fn(Family) -> bool, density: Density) -> Option<[f64; SPREADS]> {
    let mut inside = cells.iter().filter(|c| c.family.is_some_and(of)).peekable();
    inside.peek()?;
    let mut sums = [0.0; SPREADS];
    for c in inside {
        sums.iter_mut().enumerate().for_each(|(k, sum)| *sum += INDEPENDENT * density(c, spread(k)));
    }
    Some(sums)
}

/// Log likelihood of a set of lines at the spread that suits them best; 0 of none.
fn best(cells: &[Cell], of: &dyn Fn(Family) -> bool, density: Density) -> f64 {
    by_spread(cells, of, density).map_or(0.0, |sums| sums.into_iter().fold(f64::NEG_INFINITY, f64::max))
}

/// How much likelier (nats) it is that the changes of some lines, by one of some densities, spread
/// further than those of others do than that both spread alike, less the price of the second spread
/// (Schwarz 1978); 0 where either is empty. What moves all lines may raise them too.
fn spreads_further(
    cells: &[Cell],
    (of, densities): (&dyn Fn(Family) -> bool, &[Density]),
    than: &dyn Fn(Family) -> bool,
) -> f64 {
    let tables = |set: &dyn Fn(Family) -> bool| -> Option<[[f64; SPREADS]; 2]> {
        Some([by_spread(cells, set, either_way)?, by_spread(cells, set, added)?])
    };
    let (Some(own), Some(others)) = (tables(of), tables(than)) else { return 0.0 };
    let least = f64::NEG_INFINITY;
    let alike = (0..SPREADS).map(|k| (own[0][k] + others[0][k]).max(own[1][k] + others[1][k])).fold(least, f64::max);
    let nearer = |k: usize| (0..k).map(|l| others[0][l].max(others[1][l])).fold(least, f64::max);
    let nearest: [f64; SPREADS] = std::array::from_fn(nearer);
    let of_density = |density: &Density| by_spread(cells, of, *density);
    let together = |own: [f64; SPREADS]| own.into_iter().zip(nearest).map(|(a, b)| a + b).fold(least, f64::max);
    let further = densities.iter().filter_map(of_density).map(together).fold(least, f64::max);
    let count = cells.iter().filter(|c| c.family.is_some_and(|f| of(f) || than(f))).count();
    further - alike - 0.5 * (1.0 + INDEPENDENT * count as f64).ln()
}

/// Either density.
const ANY: &[Density] = &[either_way, added];

/// Distance from a mesh harmonic (revolutions) from which on a gear out of square or out of round
/// makes no sidebands.
const BEYOND_WOBBLE: u8 = 3;

/// How far the lines of one gear's comb spread beside those of its stage (nats).
#[derive(Clone, Copy, Debug)]
pub struct OneGear {
    /// How much likelier it is that something was added to its sidebands, more than those of its
    /// mate moved, than that both moved alike.
    pub over_mate: f64,
    /// The same of its sidebands over the mesh harmonics.
    pub over_mesh: f64,
    /// How much likelier it is that the mesh harmonics moved further than its sidebands than that
    /// both moved alike.
    pub below_mesh: f64,
    /// How much likelier it is that something was added to its sidebands than that they moved
    /// either way.
    pub adds: f64,
}

impl OneGear {
    /// Of the gear of a stage that is on a shaft. Sidebands of the mate that lie on the comb of
    /// this gear are its own too.
    pub fn of(train: &Train, cells: &[Cell], stage: usize, shaft: usize) -> Self {
        Self::by_comb(train, cells, (stage, shaft), 1)
    }

    /// The same by the lines of the comb that are no nearer to a mesh harmonic than so many
    /// revolutions. From the third on the orders of the shaft count too: they come of the same
    /// errors, which the mesh passes on unmodulated.
    fn by_comb(train: &Train, cells: &[Cell], (stage, shaft): (usize, usize), nearest: u8) -> Self {
        let side = |f: Family| matches!(f, Family::Side { stage: i, offset, .. } if i == stage && offset.unsigned_abs() >= nearest);
        let order = |f: Family| matches!(f, Family::Shaft { shaft: j, multiple } if j == shaft && multiple >= nearest);
        let own = |f: Family| (side(f) && f.is_on_comb(train, shaft)) || (nearest >= BEYOND_WOBBLE && order(f));
        let mate = |f: Family| side(f) && !f.is_on_comb(train, shaft);
        let mesh = |f: Family| matches!(f, Family::Mesh { stage: i, .. } if i == stage);
        Self {
            over_mate: spreads_further(cells, (&own, &[added]), &mate),
            over_mesh: spreads_further(cells, (&own, &[added]), &mesh),
            below_mesh: spreads_further(cells, (&mesh, ANY), &own).max(0.0),
            adds: best(cells, &own, added) - best(cells, &own, either_way),
        }
    }

    /// How much likelier it is that the teeth of this gear differ from each other than that what
    /// concerns all teeth moved its sidebands (nats). That moves them as far as the mesh harmonics
    /// at most; and the first two on either side follow run-out, a wobble of the gear and a bent
    /// shaft too.
    pub fn teeth_differ(train: &Train, cells: &[Cell], stage: usize, shaft: usize) -> f64 {
        let one = Self::by_comb(train, cells, (stage, shaft), BEYOND_WOBBLE);
        one.gain().min(one.over_mesh - one.below_mesh)
    }

    /// How much likelier it is that the teeth of this gear differ from what they were than that the
    /// mesh as a whole does. What concerns all teeth alters the sidebands of both gears through the
    /// mesh harmonics that they stand beside.
    pub fn gain(&self) -> f64 {
        (self.over_mate - self.below_mesh).min(self.adds)
    }
}

/// How much likelier it is that the gear of a stage on a shaft is out of round than that something
/// moved all of its lines alike (nats): once a revolution is added to its first sidebands and to
/// the first order of its shaft, beyond what the mesh harmonics, the sidebands of its mate and its
/// own at any other distance move. All sidebands at one distance come from one component of the
/// teeth's errors, whose size is chance, so that the first must lead each of the others.
pub fn out_of_round(train: &Train, cells: &[Cell], stage: usize, shaft: usize) -> f64 {
    let on_comb = |f: Family| f.is_on_comb(train, shaft);
    let side = |f: Family| match f {
        Family::Side { stage: i, shaft: j, offset, .. } if i == stage => Some((j, offset.unsigned_abs())),
        _ => None,
    };
    let first = |f: Family| matches!(f, Family::Shaft { shaft: j, multiple: 1 } if j == shaft);
    let once = |f: Family| side(f) == Some((shaft, 1)) || first(f);
    let mesh = |f: Family| matches!(f, Family::Mesh { stage: i, .. } if i == stage);
    let mate = |f: Family| side(f).is_some_and(|(j, _)| j != shaft) && !on_comb(f);
    let over = |set: &dyn Fn(Family) -> bool| {
        let below = spreads_further(cells, (set, ANY), &once);
        spreads_further(cells, (&once, &[added]), set) - below.max(0.0)
    };
    let distances = (2..=SIDE_OFFSETS.unsigned_abs()).map(|k| over(&move |f| side(f) == Some((shaft, k))));
    distances.fold(over(&mesh).min(over(&mate)), f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell(family: Family, change: f64) -> Cell {
        Cell {
            pair: 0,
            channel: 0,
            family: Some(family),
            frequency_hz: 500.0,
            change,
            turn: None,
            variance: 0.0025,
            noise: 0.0,
            repetition: 0.0025,
            differs: 1.0,
        }
    }

    /// Changes of two sets drawn evenly with spreads of 0.3 and 0.1 over noise of 0.05: the first
    /// spreads further by as much evidence as a t distribution of four degrees gives (more than 3
    /// nats for forty of each), the second does not; sets of one spread by less than a nat, and
    /// none where one is empty.
    #[test]
    fn analytic_a_set_that_changes_more_spreads_further() {
        let side = |shaft| move |f: Family| matches!(f, Family::Side { shaft: s, .. } if s == shaft);
        let cells = |spreads: [f64; 2]| -> Vec<Cell> {
            let of = |shaft: usize| {
                (0..40u8).map(move |k| {
                    let quantile = (f64::from(k) - 19.5) / 20.0;
                    let family = Family::Side { stage: 0, harmonic: 1 + k / 10, shaft, offset: (k % 10) as i8 - 5 };
                    cell(family, 1.7 * spreads[shaft] * quantile)
                })
            };
            of(0).chain(of(1)).collect()
        };
        let further = |cells: &[Cell], of, than| spreads_further(cells, (&side(of), &[either_way]), &side(than));
        let apart = cells([0.3, 0.1]);
        assert!(further(&apart, 0, 1) > 3.0);
        assert!(further(&apart, 1, 0) <= 0.0);
        assert!(further(&cells([0.2, 0.2]), 0, 1) < 1.0);
        assert_eq!(further(&apart, 0, 2), 0.0);
    }

    /// Both densities integrate to 1; drawn additions have the density that is stated: of `g₀ + g`
    /// over `g₀` half rise by more than `½ ln 2`.
    #[test]
    fn analytic_what_is_added_raises_by_half_the_log_of_the_power() {
        let line = Family::Mesh { stage: 0, harmonic: 1 };
        for density in [either_way, added] {
            for size in [0.1, 1.0, 3.0] {
                let step = 1e-3;
                let sum: f64 =
                    (-40_000..40_000).map(|k| density(&cell(line, f64::from(k) * step), size).exp() * step).sum();
                assert!((sum - 1.0).abs() < 1e-3, "{sum}");
            }
        }
        let rise = 0.5 * 2f64.ln();
        let at = |change: f64| added(&cell(line, change), 1.0);
        assert!((at(rise + 0.4) - at(rise - 0.4)).abs() < 1e-12);
        assert!(at(rise) > at(0.0));
        let mut random = <rand_chacha::ChaCha8Rng as rand::SeedableRng>::seed_from_u64(3);
        let mut normal = || {
            let (u, v): (f64, f64) = (rand::RngExt::random(&mut random), rand::RngExt::random(&mut random));
            num_complex::Complex64::from_polar((-2.0 * (1.0 - u).ln()).sqrt(), std::f64::consts::TAU * v)
        };
        let drawn: Vec<f64> = (0..20_000)
            .map(|_| {
                let old = normal();
                ((old + normal()).norm() / old.norm()).ln()
            })
            .collect();
        // A share of 0.5 ± 0.0035; of the density, without noise, the share within 0.5 of the
        // middle.
        let share = |from: f64, to: f64| drawn.iter().filter(|d| (from..to).contains(*d)).count() as f64 / 20_000.0;
        assert!((share(rise, f64::INFINITY) - 0.5).abs() < 0.012);
        let exact = |d: f64| added(&Cell { variance: 0.0, ..cell(line, d) }, 1.0).exp();
        let within: f64 = (-500..500).map(|k| exact(rise + f64::from(k) * 1e-3) * 1e-3).sum();
        assert!((share(rise - 0.5, rise + 0.5) - within).abs() < 0.012, "{within}");
    }

    /// Orders of a shaft rise from the third on, and sidebands and mesh harmonics stay: the teeth
    /// of its gear differ, not those of its mate. What raises the first two alone, as unbalance
    /// and a coupling do, is no error of teeth.
    #[test]
    fn analytic_orders_of_a_shaft_are_on_the_comb_of_its_gear() {
        let shafts = vec![("input".to_owned(), 1.0), ("output".to_owned(), 33.0 / 61.0)];
        let stage = gearwatch_core::train::StageKinematics::pair("stage1", 33, 61, 1.0);
        let train = Train { motor_order: 1.0, shafts, stages: vec![stage], nominal_input_hz: 20.0 };
        let cells = |raised: std::ops::RangeInclusive<u8>| -> Vec<Cell> {
            let ripple = |k: u8| 0.04 * f64::from(k % 5) - 0.08;
            let sides = (1..=8u8).flat_map(|harmonic| {
                let side = move |offset: i8| [0, 1].map(|shaft| Family::Side { stage: 0, harmonic, shaft, offset });
                let all = (-5..=5i8).filter(|k| *k != 0).flat_map(side);
                all.chain(std::iter::once(Family::Mesh { stage: 0, harmonic }))
            });
            let still: Vec<Cell> = sides.zip(0..).map(|(family, k)| cell(family, ripple(k))).collect();
            let order = |multiple: u8| {
                let rise = if raised.contains(&multiple) { 1.5 } else { 0.0 };
                cell(Family::Shaft { shaft: 0, multiple }, rise + 5.0 * rise * ripple(multiple) + ripple(multiple))
            };
            still.into_iter().chain((1..=30).map(order)).collect()
        };
        let differ = |raised, shaft| OneGear::teeth_differ(&train, &cells(raised), 0, shaft);
        assert!(differ(3..=30, 0) > 3.0, "{}", differ(3..=30, 0));
        assert!(differ(3..=30, 1) <= 0.0, "{}", differ(3..=30, 1));
        assert!(differ(1..=2, 0) <= 0.0, "{}", differ(1..=2, 0));
    }

    /// A gear's first sidebands rise and the others stay: it is out of round. Where they fall as
    /// much, or all of them rise alike, it is not.
    #[test]
    fn analytic_run_out_raises_the_first_sidebands() {
        let shafts = vec![("input".to_owned(), 1.0), ("output".to_owned(), 33.0 / 61.0)];
        let stage = gearwatch_core::train::StageKinematics::pair("stage1", 33, 61, 1.0);
        let train = Train { motor_order: 1.0, shafts, stages: vec![stage], nominal_input_hz: 20.0 };
        let cells = |first: f64, beyond: f64| -> Vec<Cell> {
            let of = move |harmonic: u8| {
                let side = move |shaft: usize, offset: i8| {
                    let ripple = 0.05 * f64::from(offset) * if harmonic.is_multiple_of(2) { 1.0 } else { -1.0 };
                    let size = match (shaft, offset.abs()) {
                        (0, 1) => first,
                        (0, _) => beyond,
                        _ => 0.0,
                    };
                    cell(Family::Side { stage: 0, harmonic, shaft, offset }, size + ripple)
                };
                let offsets = (-5..=5i8).filter(|k| *k != 0);
                let sides = offsets.flat_map(move |k| [0, 1].map(|shaft| side(shaft, k)));
                sides.chain(std::iter::once(cell(Family::Mesh { stage: 0, harmonic }, 0.02 * f64::from(harmonic))))
            };
            (1..=8).flat_map(of).collect()
        };
        assert!(out_of_round(&train, &cells(1.0, 0.0), 0, 0) > 5.0);
        assert!(out_of_round(&train, &cells(-1.0, 0.0), 0, 0) <= 0.0);
        assert!(out_of_round(&train, &cells(1.0, 1.0), 0, 0) <= 0.0);
        assert!(out_of_round(&train, &cells(1.0, 0.0), 0, 1) <= 0.0);
    }
}
