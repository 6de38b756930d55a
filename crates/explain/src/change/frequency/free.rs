//! Changes of lines as a function of frequency beside what goes with orders: what a prediction of
//! them is held against.

use std::cmp::Reverse;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::{CLEAR, Data, Key, ORDERS, Part, Points, USUAL, log_mean_exp, selected, unusual};
use crate::change::locate::Cell;
use crate::read::lines::Family;

/// Channels that a prediction is held against, those with the most lines: each has a form of its
/// own, and all combinations are asked.
const PREDICTED: usize = 3;

/// What lines do at one load, at any speed.
const AT_LOAD: &[Part] = &[Part::FamilyAtLoad, Part::HarmonicAtLoad, Part::StageAtLoad, Part::SidesAtLoad];
/// Functions of frequency, those that each load has for itself last.
const FUNCTIONS: &[Part] = &[Part::PathInPair, Part::Path, Part::PathAtLoad];

/// Changes of lines as a function of frequency beside what goes with orders: what a prediction of
/// them is held against.
pub struct Free {
    channels: Vec<usize>,
    keys: Vec<Key>,
    changes: DVector<f64>,
    variances: Vec<f64>,
    /// Covariance by the size of the function of frequency, and its part of the log evidence.
    covariances: Vec<(Cholesky<f64, Dyn>, f64)>,
}

impl Free {
    /// Of the lines of meshes; `None` where there are too few lines or one speed only.
    pub fn of_meshes(cells: &[Cell], points: &Points) -> Option<Self> {
        Some(Self::of(cells, points, &is_of_mesh, &[ORDERS, &[Part::Path]].concat())?.0)
    }

    /// The same of their sidebands alone.
    pub fn of_sidebands(cells: &[Cell], points: &Points) -> Option<Self> {
        let asked = |family| matches!(family, Family::Side { .. });
        Some(Self::of(cells, points, &asked, &[ORDERS, &[Part::Path]].concat())?.0)
    }

    /// Of the lines of meshes, with functions of frequency and laws of lines that each load has for
    /// itself; and the log evidence (nats) of all functions of frequency over what goes with
    /// orders. `None` with one load, too.
    pub fn by_load(cells: &[Cell], points: &Points) -> Option<(Self, f64)> {
        if Points::is_one(&points.load) {
            return None;
        }
        let orders = [ORDERS, AT_LOAD].concat();
        let all = [&orders, FUNCTIONS].concat();
        let (free, (together, steps)) = Self::of(cells, points, &is_of_mesh, &all)?;
        let data = Data { keys: &free.keys, changes: &free.changes, variances: &free.variances };
        let alone = data.climb(&orders, steps[..orders.len()].to_vec()).0;
        Some((free, together - alone))
    }

    /// With these parts, of which the last is the function of frequency that predictions replace;
    /// and the log evidence with its sizes.
    fn of(
        cells: &[Cell],
        points: &Points,
        asked: &dyn Fn(Family) -> bool,
        parts: &[Part],
    ) -> Option<(Self, (f64, Vec<u8>))> {
        if Points::is_one(&points.speed) {
            return None;
        }
        let of_mesh = |c: &Cell| c.family.is_some_and(asked) && c.variance < CLEAR;
        let count = |channel: usize| cells.iter().filter(|c| c.channel == channel && of_mesh(c)).count();
        let last = cells.iter().map(|c| c.channel).max()?;
        let mut channels: Vec<usize> = (0..=last).filter(|c| count(*c) > 0).collect();
        channels.sort_by_key(|c| Reverse(count(*c)));
        channels.truncate(PREDICTED);
        let lines: Vec<Cell> = cells.iter().filter(|c| of_mesh(c) && channels.contains(&c.channel)).copied().collect();
        let (keys, changes, variances) = selected(&lines, points)?;
        let data = Data { keys: &keys, changes: &changes, variances: &variances };
        let (evidence, steps) = data.climb(parts, vec![USUAL; parts.len()]);
        let path = *steps.last()?;
        // What a prediction leaves may be a smaller function of frequency.
        let of_size = |step: u8| {
            let mut steps = steps.clone();
            *steps.last_mut()? = step;
            let factor = data.covariance(parts, &steps).cholesky()?;
            let half: f64 = factor.l_dirty().diagonal().iter().map(|d| d.ln()).sum();
            Some((factor, -half - unusual(step)))
        };
        let covariances = (0..=path).map(of_size).collect::<Option<_>>()?;
        Some((Self { channels, keys, changes, variances, covariances }, (evidence, steps)))
    }

    /// Pair, channel, line and frequency (Hz) of each change.
    pub fn lines(&self) -> impl Iterator<Item = (usize, usize, Family, f64)> {
        self.keys.iter().filter_map(|k| Some((k.pair, k.channel, k.family?, k.ln_hz.exp())))
    }

    /// Log evidence (nats) without a prediction.
    pub fn log_evidence(&self) -> f64 {
        let of_size =
            |(factor, own): &(Cholesky<f64, Dyn>, f64)| -0.5 * self.changes.dot(&factor.solve(&self.changes)) + own;
        self.covariances.iter().map(of_size).fold(f64::NEG_INFINITY, f64::max)
    }

    /// The same where a part of the changes is predicted, by their position and one of so many
    /// forms: on average over the forms, of which each channel has its own.
    pub fn log_evidence_of(&self, forms: usize, predicted: &dyn Fn(usize, usize) -> f64) -> f64 {
        log_mean_exp(&self.by_forms(forms, predicted))
    }

    /// The log evidence of each combination of forms ([`Self::by_forms`]), `exp` of what is beyond
    /// `most`, summed by the form that a channel has in it; of each channel that is asked.
    pub fn of_channels(&self, forms: usize, evidence: &[f64], most: f64) -> Vec<(usize, Vec<f64>)> {
        let of = |(at, channel): (usize, &usize)| {
            let mut sums = vec![0.0; forms];
            for (n, nats) in evidence.iter().enumerate() {
                sums[form_of(n, forms, at)] += (nats - most).exp();
            }
            (*channel, sums)
        };
        self.channels.iter().enumerate().map(of).collect()
    }

    /// The log evidence (nats) of each combination of forms.
    pub fn by_forms(&self, forms: usize, predicted: &dyn Fn(usize, usize) -> f64) -> Vec<f64> {
        let channels = self.channels.len();
        let column = |k: usize| {
            let of = |(i, key): (usize, &Key)| match k {
                1.. if key.channel == self.channels[(k - 1) / forms] => predicted(i, (k - 1) % forms),
                _ => 0.0,
            };
            DVector::from_iterator(self.keys.len(), self.keys.iter().enumerate().map(of))
        };
        let mut columns: Vec<DVector<f64>> = (0..=channels * forms).map(column).collect();
        columns[0].copy_from(&self.changes);
        let all = DMatrix::from_columns(&columns);
        let products: Vec<(DMatrix<f64>, f64)> =
            self.covariances.iter().map(|(factor, own)| (all.tr_mul(&factor.solve(&all)), *own)).collect();
        let combinations = forms.pow(channels as u32);
        let of_combination = |n: usize| {
            let chosen: Vec<usize> = (0..channels).map(|c| 1 + c * forms + form_of(n, forms, c)).collect();
            let of_size = |(m, own): &(DMatrix<f64>, f64)| {
                let across: f64 = chosen.iter().map(|i| m[(0, *i)]).sum();
                let inside: f64 = chosen.iter().flat_map(|i| chosen.iter().map(|j| m[(*i, *j)])).sum();
                -0.5 * (m[(0, 0)] - 2.0 * across + inside) + own
            };
            products.iter().map(of_size).fold(f64::NEG_INFINITY, f64::max)
        };
        (0..combinations).map(of_combination).collect()
    }
}

/// The form that the channel at a position has in a combination.
fn form_of(combination: usize, forms: usize, at: usize) -> usize {
    combination / forms.pow(at as u32) % forms
}

fn is_of_mesh(family: Family) -> bool {
    matches!(family, Family::Mesh { .. } | Family::Side { .. })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::change::frequency::tests::{cells, wave};

    /// Lines that follow a steep step of the frequency, which no smooth function does: predicted on
    /// one sensor by the right one of two forms the evidence rises by tens of nats, by a step
    /// elsewhere it does not.
    #[test]
    fn analytic_a_prediction_is_held_against_a_function_of_frequency() {
        let step = |hz: f64, at: f64| if hz < at { 0.8 } else { -0.8 };
        let change = |hz: f64, channel: usize| if channel == 0 { step(hz, 2000.0) } else { 0.0 };
        let (cells, points) = cells(&|_, hz, channel| change(hz, channel), &|_, _| 0.0);
        let free = Free::of_meshes(&cells, &points).unwrap();
        let hz: Vec<f64> = free.lines().map(|l| l.3).collect();
        let gain = |at: f64| {
            let form = |line: usize, form: usize| if form == 0 { 0.0 } else { step(hz[line], at) };
            free.log_evidence_of(2, &form) - free.log_evidence()
        };
        assert!(gain(2000.0) > 20.0, "{}", gain(2000.0));
        // No prediction at all is one of four combinations, which bounds the loss.
        assert!(gain(700.0) < 0.0 && gain(700.0) > -2.0 * 2f64.ln() - 1e-9, "{}", gain(700.0));
        // Where all forms are none, up to rounding.
        let none = free.log_evidence_of(3, &|_, _| 0.0);
        assert!((none - free.log_evidence()).abs() < 1e-6 * none.abs(), "{none}");
    }

    /// Of more channels than are asked those with the most lines stay: of five copies of one sensor
    /// the third, which lost half of its lines, is none of three.
    #[test]
    fn analytic_the_channels_with_the_most_lines_are_asked() {
        let (two, points) = cells(&|_, hz, channel| wave(hz, channel), &wave);
        let of = |channel: usize| {
            let kept = move |(k, _): &(usize, &Cell)| channel != 2 || k % 2 == 0;
            two.iter().filter(|c| c.channel == 0).enumerate().filter(kept).map(move |(_, c)| Cell { channel, ..*c })
        };
        let many: Vec<Cell> = (0..5).flat_map(of).collect();
        let free = Free::of_meshes(&many, &points).unwrap();
        assert_eq!(free.channels, [0, 1, 3]);
        assert!(free.log_evidence_of(11, &|_, form| 0.01 * form as f64).is_finite());
    }
}
