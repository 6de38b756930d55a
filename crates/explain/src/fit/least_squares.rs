//! Levenberg–Marquardt for a few dozen numbers with Gaussian priors and heavy-tailed residuals.
//!
//! Minimises `Σ (ν + 1) ln(1 + r²/ν) + Σ ((x − μ)/s)²`: residuals `r` in standard deviations follow
//! a t distribution with ν = 4, taken by iterated weights `(ν + 1)/(ν + r²)` (Lange, Little &
//! Taylor 1989); the damped normal equations are Marquardt's (1963), scaled by the diagonal.
//! Between difference quotients, which take a model a number, the Jacobian follows the steps
//! themselves by Broyden's update (1965), row by row over the numbers that the row depends on
//! (Schubert 1970). The covariance is Laplace's: the inverse of the weighted normal matrix at fresh
//! quotients, priors included. No crate is used: `levenberg-marquardt` 0.15 is tied to an older
//! `nalgebra` than this workspace has, and knows neither heavy tails nor a point without a model.

use nalgebra::{DMatrix, DVector};

/// Degrees of freedom of the t distribution of residuals.
const TAIL: f64 = 4.0;
/// Step of the difference quotients, in standard deviations of the prior.
pub const QUOTIENT_STEP: f64 = 0.05;
/// Share of that step by which a state is moved along it: states follow the numbers in nearly
/// straight lines, and residuals the states not everywhere.
const SHARE: f64 = 0.02;
/// Steps that are tried in one direction, each shorter than the one before.
const TRIES: usize = 8;
/// Relative gain at which iterations end.
const SETTLED: f64 = 1e-3;
/// Steps that one Jacobian by difference quotients serves, and the share of the gain that it
/// promises below which it serves no longer.
const SERVES: usize = 4;
const KEEPS: f64 = 0.3;
/// How far a number may go from its prior (standard deviations).
const FARTHEST: f64 = 4.0;

/// Prior of one number.
#[derive(Clone, Copy, Debug)]
pub struct Prior {
    /// Middle.
    pub mean: f64,
    /// Standard deviation.
    pub sigma: f64,
}

/// Rows of the residuals that a number moves; `None` for all.
pub type Reach = Option<Vec<usize>>;

/// A minimum.
#[derive(Clone, Debug)]
pub struct Solution {
    /// The numbers.
    pub x: DVector<f64>,
    /// Their covariance.
    pub covariance: DMatrix<f64>,
    /// Cost at the start and at the end; twice the negative log posterior but for a constant.
    pub cost: (f64, f64),
    /// Iterations that improved.
    pub iterations: usize,
}

/// Cost of residuals: twice their negative log likelihood but for a constant; 1 each, on average
/// (0.97), where they are Gaussian of deviation 1.
pub fn losses(residuals: &[f64]) -> f64 {
    // One logarithm of a product is quicker than those of its factors; four of them stay finite.
    let factor = |r: &f64| {
        let square = r * r / TAIL;
        // What is no number stays none.
        1.0 + if square > 1e70 { 1e70 } else { square }
    };
    (TAIL + 1.0) * residuals.chunks(4).map(|of| of.iter().map(factor).product::<f64>().ln()).sum::<f64>()
}

/// The residual (not negative) of a cost (≥ 0): the inverse of [`losses`] of one.
pub fn residual_of(cost: f64) -> f64 {
    (TAIL * (cost / (TAIL + 1.0)).exp_m1()).sqrt()
}

/// Cost of being off the priors.
pub fn pulls(x: &DVector<f64>, priors: &[Prior]) -> f64 {
    x.iter().zip(priors).map(|(x, p)| ((x - p.mean) / p.sigma).powi(2)).sum()
}

/// What is fitted: a model of a point, and what it leaves of the data.
pub trait Model {
    /// What a point comes to, before it is held against the data; the costly step.
    type State;

    /// At a point; `None` where there is no model.
    fn state(&mut self, x: &DVector<f64>) -> Option<Self::State>;

    /// At a point that is little off the last one, to first order.
    fn near(&mut self, x: &DVector<f64>) -> Option<Self::State> {
        self.state(x)
    }

    /// What a state leaves (standard deviations).
    fn residuals(&self, state: &Self::State) -> Vec<f64>;

    /// A state with a share of what one number alone did, of one where several were moved that
    /// reach different parts of it.
    fn reached(&self, state: &Self::State, moved: &Self::State, number: usize, share: f64) -> Self::State;
}

/// Minimises from a start over the numbers listed in `free`, the others stay; at most so many
/// iterations. Where there is no model at a point the search turns back. The covariance is that of
/// the free numbers, in their order. Numbers that reach different residuals are moved at once for
/// the difference quotients (Curtis, Powell & Reid 1974).
pub fn minimise<M: Model>(
    start: DVector<f64>,
    priors: &[Prior],
    reaches: &[Reach],
    free: &[usize],
    iterations: usize,
    model: &mut M,
) -> Option<Solution> {
    let descent = descend(start, priors, reaches, free, iterations, model)?;
    let Descent { x, state, r, first, cost, done, normal, groups, .. } = descent;
    let normal = match normal {
        Some(normal) => normal,
        None => {
            let jacobian = quotients(&x, (&state, &r), priors, (free, &groups), model);
            equations(&jacobian, &x, &r, priors, free).0
        }
    };
    Some(Solution { x, covariance: normal.cholesky()?.inverse(), cost: (first, cost), iterations: done })
}

/// As [`minimise`], without a covariance: the cost and the numbers of where so many iterations
/// lead.
pub fn approach<M: Model>(
    start: DVector<f64>,
    priors: &[Prior],
    reaches: &[Reach],
    free: &[usize],
    iterations: usize,
    model: &mut M,
) -> Option<(f64, DVector<f64>)> {
    descend(start, priors, reaches, free, iterations, model).map(|descent| (descent.cost, descent.x))
}

/// Iterations from a start; `None` where the equations cannot be solved.
fn descend<'a, M: Model>(
    start: DVector<f64>,
    priors: &'a [Prior],
    reaches: &'a [Reach],
    free: &'a [usize],
    iterations: usize,
    model: &mut M,
) -> Option<Descent<'a, M::State>> {
    let state = model.state(&start)?;
    let r = model.residuals(&state);
    let cost = losses(&r) + pulls(&start, priors);
    let groups = groups(reaches, free);
    let mut depends = vec![Vec::new(); r.len()];
    for (column, rows) in groups.iter().flatten() {
        match rows {
            Some(rows) => rows.iter().for_each(|&row| depends[row].push(*column)),
            None => depends.iter_mut().for_each(|columns| columns.push(*column)),
        }
    }
    let (x, jacobian, normal) = (start, DMatrix::zeros(0, 0), None);
    let (first, done, followed) = (cost, 0, SERVES);
    let mut descent =
        Descent { priors, free, groups, depends, x, state, r, first, cost, done, jacobian, followed, normal };
    descent.go(iterations, model)?;
    Some(descent)
}

/// A search under way.
struct Descent<'a, S> {
    priors: &'a [Prior],
    free: &'a [usize],
    groups: Vec<Group<'a>>,
    /// The free numbers (positions among them) that each residual depends on.
    depends: Vec<Vec<usize>>,
    x: DVector<f64>,
    state: S,
    r: Vec<f64>,
    /// At the start, and now.
    first: f64,
    cost: f64,
    /// Iterations that improved.
    done: usize,
    jacobian: DMatrix<f64>,
    /// Steps that the Jacobian has followed since it was taken by difference quotients; from
    /// [`SERVES`] on it is taken again.
    followed: usize,
    /// The normal matrix of the last iteration, where its Jacobian was fresh.
    normal: Option<DMatrix<f64>>,
}

impl<S> Descent<'_, S> {
    /// At most so many iterations.
    fn go<M: Model<State = S>>(&mut self, iterations: usize, model: &mut M) -> Option<()> {
        let mut damping = 1e-2;
        for _ in 0..iterations {
            if self.followed >= SERVES {
                let here = (&self.state, &*self.r);
                self.jacobian = quotients(&self.x, here, self.priors, (self.free, &self.groups), model);
                self.followed = 0;
            }
            let fresh = self.followed == 0;
            let (normal, gradient) = equations(&self.jacobian, &self.x, &self.r, self.priors, self.free);
            let mut better = None;
            for _ in 0..if fresh { TRIES } else { 1 } {
                let mut damped = normal.clone();
                (0..self.free.len()).for_each(|k| damped[(k, k)] *= 1.0 + damping);
                let step = damped.cholesky()?.solve(&gradient);
                let mut next = self.x.clone();
                for (&k, by) in self.free.iter().zip(step.iter()) {
                    let p = self.priors[k];
                    next[k] = (self.x[k] - by).clamp(p.mean - FARTHEST * p.sigma, p.mean + FARTHEST * p.sigma);
                }
                if let Some(state) = model.state(&next) {
                    let at = model.residuals(&state);
                    let value = losses(&at) + pulls(&next, self.priors);
                    if value < self.cost {
                        // The gain of the quadratic model, whose gradient is halved.
                        let promised = 2.0 * gradient.dot(&step) - step.dot(&(&normal * &step));
                        better = Some((next, state, at, value, promised));
                        damping = (damping * 0.2).max(1e-6);
                        break;
                    }
                }
                damping *= 8.0;
            }
            self.normal = fresh.then_some(normal);
            let Some((next, state, at, value, promised)) = better else {
                if fresh {
                    break;
                }
                self.followed = SERVES;
                continue;
            };
            self.follow(&next, &at);
            let gained = self.cost - value;
            (self.x, self.state, self.r, self.cost) = (next, state, at, value);
            self.done += 1;
            let settled = gained < SETTLED * self.cost.max(1.0);
            if settled && fresh {
                break;
            }
            // What a Jacobian that followed says is not the last word.
            if settled || gained < KEEPS * promised {
                self.followed = SERVES;
            }
        }
        Some(())
    }

    /// Makes each row of the Jacobian agree with what a step did to its residual, by the least
    /// change in the numbers that it depends on, each in standard deviations of its prior.
    fn follow(&mut self, next: &DVector<f64>, at: &[f64]) {
        self.followed += 1;
        let sigmas: Vec<f64> = self.free.iter().map(|&k| self.priors[k].sigma).collect();
        let step: Vec<f64> = self.free.iter().zip(&sigmas).map(|(&k, s)| (next[k] - self.x[k]) / s).collect();
        for (i, columns) in self.depends.iter().enumerate() {
            let length: f64 = columns.iter().map(|&c| step[c] * step[c]).sum();
            if length == 0.0 {
                continue;
            }
            let told: f64 = columns.iter().map(|&c| self.jacobian[(i, c)] * step[c] * sigmas[c]).sum();
            let missed = (at[i] - self.r[i] - told) / length;
            columns.iter().for_each(|&c| self.jacobian[(i, c)] += missed * step[c] / sigmas[c]);
        }
    }
}

/// Columns that are moved at once, each with the rows that it reaches.
type Group<'a> = Vec<(usize, Option<&'a [usize]>)>;

/// Columns of the free numbers in groups, each into the first in which no other reaches its rows.
fn groups<'a>(reaches: &'a [Reach], free: &[usize]) -> Vec<Group<'a>> {
    let mut out: Vec<Group<'a>> = Vec::new();
    for (column, &k) in free.iter().enumerate() {
        let reach = reaches.get(k).and_then(|r| r.as_deref());
        let apart = |a: &[usize]| reach.is_some_and(|rows| rows.iter().all(|i| !a.contains(i)));
        match out.iter_mut().find(|group| group.iter().all(|(_, other)| other.is_some_and(apart))) {
            Some(group) => group.push((column, reach)),
            None => out.push(vec![(column, reach)]),
        }
    }
    out
}

/// Jacobian by difference quotients. Numbers on both sides of which there is no model have none:
/// nothing but their priors moves them.
fn quotients<M: Model>(
    x: &DVector<f64>,
    (state, r): (&M::State, &[f64]),
    priors: &[Prior],
    (free, groups): (&[usize], &[Group<'_>]),
    model: &mut M,
) -> DMatrix<f64> {
    let mut jacobian = DMatrix::zeros(r.len(), free.len());
    for group in groups {
        let moved = |by: f64| {
            let mut moved = x.clone();
            group.iter().for_each(|&(column, _)| moved[free[column]] += by * priors[free[column]].sigma);
            moved
        };
        // At the edge of what can be solved, the quotient looks back.
        let sides = [QUOTIENT_STEP, -QUOTIENT_STEP].into_iter();
        let Some((at, by)) = sides.filter_map(|by| Some((model.near(&moved(by))?, by))).next() else { continue };
        for &(column, _) in group {
            let by = by * SHARE * priors[free[column]].sigma;
            let alone = model.residuals(&model.reached(state, &at, free[column], SHARE));
            let quotients = alone.iter().zip(r).map(|(a, r)| (a - r) / by);
            jacobian.column_mut(column).iter_mut().zip(quotients).for_each(|(j, q)| *j = q);
        }
    }
    jacobian
}

/// Weighted normal matrix and gradient (halved), priors included.
fn equations(
    jacobian: &DMatrix<f64>,
    x: &DVector<f64>,
    r: &[f64],
    priors: &[Prior],
    free: &[usize],
) -> (DMatrix<f64>, DVector<f64>) {
    let mut weighted = jacobian.clone();
    for (i, r) in r.iter().enumerate() {
        let w = (TAIL + 1.0) / (TAIL + r * r);
        weighted.row_mut(i).scale_mut(w);
    }
    let mut normal = jacobian.transpose() * &weighted;
    let mut gradient = weighted.transpose() * DVector::from_column_slice(r);
    for (column, &k) in free.iter().enumerate() {
        let p = priors[k];
        normal[(column, column)] += 1.0 / (p.sigma * p.sigma);
        gradient[column] += (x[k] - p.mean) / (p.sigma * p.sigma);
    }
    (normal, gradient)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As the sum of logarithms one by one, whatever the number of residuals; a residual that is no
    /// number is no cost.
    #[test]
    fn oracle_losses_one_by_one() {
        let residuals: Vec<f64> = (0..11).map(|k| f64::from(k - 5) * 10f64.powi(k % 4 - 2)).collect();
        for count in 0..residuals.len() {
            let of = &residuals[..count];
            let expected: f64 = of.iter().map(|r| (TAIL + 1.0) * (r * r / TAIL).ln_1p()).sum();
            assert!((losses(of) - expected).abs() < 1e-12 * (1.0 + expected), "{count}");
        }
        assert!(losses(&[1e40; 4]).is_finite() && losses(&[1.0, f64::NAN]).is_nan());
    }

    /// Residuals by a function, and the rows that each number reaches.
    struct Rows<'a, F> {
        of: F,
        reaches: &'a [Reach],
    }

    impl<F: FnMut(&DVector<f64>) -> Vec<f64>> Model for Rows<'_, F> {
        type State = Vec<f64>;

        fn state(&mut self, x: &DVector<f64>) -> Option<Vec<f64>> {
            Some((self.of)(x))
        }

        fn residuals(&self, state: &Vec<f64>) -> Vec<f64> {
            state.clone()
        }

        fn reached(&self, state: &Vec<f64>, moved: &Vec<f64>, number: usize, share: f64) -> Vec<f64> {
            let reach = self.reaches.get(number).and_then(Option::as_ref);
            let own = |i: &usize| reach.is_none_or(|rows| rows.contains(i));
            let part = |i: usize| state[i] + share * (moved[i] - state[i]);
            (0..state.len()).map(|i| if own(&i) { part(i) } else { state[i] }).collect()
        }
    }

    /// A line through five points with one wild one: the prior is weak, so slope and offset are
    /// those of the other four, and the covariance of a plain fit is `(JᵀJ)⁻¹` but for the weights,
    /// which at small residuals are 5/4.
    #[test]
    fn analytic_line_is_found_beside_a_wild_point() {
        let points = [(0.0, 1.0), (1.0, 3.0), (2.0, 5.0), (3.0, 7.0), (4.0, 60.0)];
        let priors = [Prior { mean: 0.0, sigma: 100.0 }; 2];
        let of = |x: &DVector<f64>| points.iter().map(|(t, y)| (x[0] + x[1] * t - y) / 0.1).collect::<Vec<f64>>();
        let mut model = Rows { of, reaches: &[] };
        let found = minimise(DVector::from_vec(vec![1.2, 1.8]), &priors, &[], &[0, 1], 16, &mut model).unwrap();
        assert!((found.x[0] - 1.0).abs() < 0.02 && (found.x[1] - 2.0).abs() < 0.02, "{found:?}");
        // Of the four good points: Σt = 6, Σt² = 14, so var(offset) = σ² 14/(4·14 − 36), over 5/4.
        let expected = 0.01 * 14.0 / 20.0 / 1.25;
        assert!((found.covariance[(0, 0)] / expected - 1.0).abs() < 0.05, "{}", found.covariance[(0, 0)]);
        assert!(found.cost.1 < found.cost.0);
        // With the slope held where it is, the offset makes the best of it: the mean of what is
        // left of the four good points, nearly.
        let held = minimise(DVector::from_vec(vec![0.0, 2.1]), &priors, &[], &[0], 16, &mut model).unwrap();
        assert!(held.x[1] == 2.1 && (held.x[0] - 0.85).abs() < 0.05, "{held:?}");
        assert_eq!(held.covariance.shape(), (1, 1));
    }

    /// Three offsets of two points each and one of all six: the offsets are moved at once, in two
    /// calls an iteration instead of four, and found where single steps find them.
    #[test]
    fn analytic_numbers_that_reach_other_rows_are_moved_at_once() {
        let data = [1.0, 1.2, -2.0, -2.2, 0.5, 0.7];
        let priors = [
            Prior { mean: 0.0, sigma: 10.0 },
            Prior { mean: 0.0, sigma: 10.0 },
            Prior { mean: 0.0, sigma: 10.0 },
            Prior { mean: 0.0, sigma: 0.1 },
        ];
        let reaches: Vec<Reach> = vec![Some(vec![0, 1]), Some(vec![2, 3]), Some(vec![4, 5]), None];
        let free = [0, 1, 2, 3];
        assert_eq!(groups(&reaches, &free).iter().map(Vec::len).collect::<Vec<_>>(), [3, 1]);
        assert_eq!(groups(&[], &free).len(), 4);
        let find = |reaches: &[Reach]| {
            let mut calls = 0;
            let of = |x: &DVector<f64>| {
                calls += 1;
                data.iter().enumerate().map(|(i, d)| (x[i / 2] + x[3] - d) / 0.1).collect::<Vec<f64>>()
            };
            let mut model = Rows { of, reaches };
            let found = minimise(DVector::zeros(4), &priors, reaches, &free, 16, &mut model).unwrap();
            (found.x, found.iterations, calls)
        };
        let ((together, iterations, fewer), (single, same, more)) = (find(&reaches), find(&[]));
        assert!((&together - single).norm() < 1e-9, "{together}");
        assert_eq!(iterations, same);
        assert!(2 * fewer < more + 3 * iterations, "{fewer} {more}");
    }

    /// A decay `a exp(−b t)` without noise, far from where the search starts: the steps that share
    /// a Jacobian end at the same numbers, with the covariance of the Jacobian there, whose
    /// difference quotients over 5 % of a wide prior are good to some per cent.
    #[test]
    fn analytic_a_jacobian_that_follows_its_steps_leads_to_the_minimum() {
        let priors = [Prior { mean: 1.0, sigma: 2.0 }, Prior { mean: 1.0, sigma: 0.6 }];
        let times: Vec<f64> = (0..20).map(|k| 0.2 * f64::from(k)).collect();
        let calls = std::cell::Cell::new(0);
        let of = |x: &DVector<f64>| {
            calls.set(calls.get() + 1);
            let off = |t: &f64| (x[0] * (-x[1] * t).exp() - 3.0 * (-0.7 * t).exp()) / 1e-3;
            times.iter().map(off).collect::<Vec<f64>>()
        };
        let reaches: Vec<Reach> = vec![None, None];
        let mut model = Rows { of, reaches: &reaches };
        let start = || DVector::from_vec(vec![1.0, 1.6]);
        let found = minimise(start(), &priors, &reaches, &[0, 1], 40, &mut model).unwrap();
        assert!((found.x[0] - 3.0).abs() < 1e-3 && (found.x[1] - 0.7).abs() < 1e-3, "{found:?}");
        let mut expected = DMatrix::<f64>::zeros(2, 2);
        for t in &times {
            let slopes = DVector::from_vec(vec![(-0.7 * t).exp(), -3.0 * t * (-0.7 * t).exp()]) / 1e-3;
            expected += 1.25 * &slopes * slopes.transpose();
        }
        let expected = expected.try_inverse().unwrap();
        for k in 0..2 {
            assert!((found.covariance[(k, k)] / expected[(k, k)] - 1.0).abs() < 0.1, "{found:?}, {expected}");
        }
        assert!(calls.get() < 4 * found.iterations, "{calls:?} models for {} steps", found.iterations);
        let (cost, x) = approach(start(), &priors, &reaches, &[0, 1], 40, &mut model).unwrap();
        assert!(cost == found.cost.1 && x == found.x);
    }

    /// Where the model ends on both sides of one number, the other is fitted all the same, and the
    /// prior's middle, where that number starts, is where it stays.
    #[test]
    fn analytic_a_number_without_neighbours_stays() {
        struct Edge;
        impl Model for Edge {
            type State = Vec<f64>;

            fn state(&mut self, x: &DVector<f64>) -> Option<Vec<f64>> {
                (x[1] == 0.5).then(|| vec![(x[0] - 2.0) / 1e-3])
            }

            fn residuals(&self, state: &Vec<f64>) -> Vec<f64> {
                state.clone()
            }

            fn reached(&self, state: &Vec<f64>, moved: &Vec<f64>, _: usize, share: f64) -> Vec<f64> {
                state.iter().zip(moved).map(|(a, b)| a + share * (b - a)).collect()
            }
        }
        let priors = [Prior { mean: 1.0, sigma: 2.0 }, Prior { mean: 0.5, sigma: 0.1 }];
        let (_, x) = approach(DVector::from_vec(vec![1.0, 0.5]), &priors, &[], &[0, 1], 16, &mut Edge).unwrap();
        assert!((x[0] - 2.0).abs() < 1e-4 && x[1] == 0.5, "{x}");
    }

    /// Without data the prior is the answer.
    #[test]
    fn analytic_prior_stands_without_data() {
        let priors = [Prior { mean: 0.3, sigma: 0.2 }];
        let mut model = Rows { of: |_: &DVector<f64>| Vec::new(), reaches: &[] };
        let found = minimise(DVector::from_vec(vec![0.0]), &priors, &[], &[0], 16, &mut model).unwrap();
        assert!((found.x[0] - 0.3).abs() < 1e-3);
        assert!((found.covariance[(0, 0)] - 0.04).abs() < 1e-9);
    }
}
