//! Complex amplitudes of lines, alone or jointly with their neighbours, each with its noise.

use num_complex::Complex64;

use crate::read::dsp::{self, LINE_FIT_NOISE_GAIN, MAIN_LOBE_BINS, median};
use crate::read::lines::{self, Line};

/// Power of a multiple of a shaft that nobody listed over the median of its neighbours on the comb.
const UNLISTED: f64 = 4.0;
/// Neighbours on each side.
const BESIDE: usize = 4;

/// A line as measured.
#[derive(Clone, Copy, Debug)]
pub struct LineValue {
    /// Complex peak amplitude, phase at the start of the angle axis.
    pub amplitude: Complex64,
    /// Mean power that noise alone would show in `amplitude`.
    pub noise: f64,
}

impl LineValue {
    /// Power over noise.
    pub fn ratio(&self) -> f64 {
        self.amplitude.norm_sqr() / self.noise.max(f64::MIN_POSITIVE)
    }
}

/// Amplitude at a place of a spectrum (bins), by itself; `None` beyond its end.
pub fn line_at(spectrum: &[Complex64], floor: &[f64], position: f64) -> Option<LineValue> {
    let bin = position.round() as usize;
    if bin + 2 * MAIN_LOBE_BINS >= spectrum.len() {
        return None;
    }
    let (mut sum, mut weight) = (Complex64::ZERO, 0.0);
    for (k, value) in spectrum.iter().enumerate().take(bin + 2).skip(bin.saturating_sub(1)) {
        let w = dsp::window_response(k as f64 - position);
        sum += w.conj() * value;
        weight += w.norm_sqr();
    }
    Some(LineValue { amplitude: sum / weight, noise: floor[bin] * LINE_FIT_NOISE_GAIN })
}

/// Amplitudes at the multiples of a spacing (bins), each by itself.
pub fn comb(spectrum: &[Complex64], floor: &[f64], spacing: f64, highest: f64) -> Vec<LineValue> {
    let positions = (1..).map(|n| f64::from(n) * spacing).take_while(|p| *p < highest);
    positions.map_while(|p| line_at(spectrum, floor, p)).collect()
}

/// What the lines of one spectrum are read from.
pub struct LineFit<'a> {
    /// Over shaft angle.
    pub spectrum: &'a [Complex64],
    /// Mean noise power by bin.
    pub floor: &'a [f64],
    /// Ascending.
    pub lines: &'a [Line],
    /// Name and order.
    pub shafts: &'a [(String, f64)],
    /// All multiples of each shaft, each by itself.
    pub combs: &'a [Vec<LineValue>],
    /// Other lines that take part with amplitudes of their own (orders).
    pub beside: &'a [f64],
    /// Of the input shaft.
    pub revolutions: f64,
}

impl LineFit<'_> {
    /// Amplitudes of all lines by least squares over the bins about each, jointly with the lines
    /// beside it.
    ///
    /// Errors of the teeth put a little on every multiple of every shaft. Where such a multiple
    /// lies in a line's bins without being listed, it beats with the line at a phase that differs
    /// from recording to recording; it takes part as a random amplitude of the size that its comb
    /// has there, so that the line's noise says how far it can be told from it.
    pub fn all(&self, highest_order: f64) -> Vec<Option<LineValue>> {
        let usable = self.lines.partition_point(|l| l.order < highest_order);
        let mut out = vec![None; self.lines.len()];
        for (i, slot) in out.iter_mut().enumerate().take(usable) {
            *slot = self.one(i, usable);
        }
        out
    }

    fn one(&self, i: usize, usable: usize) -> Option<LineValue> {
        let reach = 2.0 * MAIN_LOBE_BINS as f64;
        let position = self.lines[i].order * self.revolutions;
        let bin = position.round() as usize;
        if bin < 2 * MAIN_LOBE_BINS || bin + 2 * MAIN_LOBE_BINS >= self.spectrum.len() {
            return None;
        }
        let far = |l: &Line| (l.order * self.revolutions - position).abs() > reach;
        let first = self.lines[..i].iter().rposition(far).map_or(0, |k| k + 1);
        let last = self.lines[i..usable].iter().position(far).map_or(usable, |k| i + k);
        let (low, high) = (bin - MAIN_LOBE_BINS, bin + MAIN_LOBE_BINS);
        // Only lines that reach into these bins take part.
        let reaches = |p: f64| p > low as f64 - 3.0 && p < high as f64 + 3.0;
        // Positions, and the power of those that are random.
        let mut members: Vec<(f64, Option<f64>)> = vec![(position, None)];
        let listed = (first..last).filter(|k| *k != i).map(|k| self.lines[k].order * self.revolutions);
        members.extend(listed.filter(|p| reaches(*p)).map(|p| (p, None)));
        let same = lines::SAME_LINE * self.revolutions;
        let is_new = |members: &[(f64, Option<f64>)], p: f64| members.iter().all(|m| (m.0 - p).abs() > same);
        for p in self.beside.iter().map(|order| order * self.revolutions).filter(|p| reaches(*p)) {
            if is_new(&members, p) {
                members.push((p, None));
            }
        }
        for ((_, order), comb) in self.shafts.iter().zip(self.combs) {
            let spacing = order * self.revolutions;
            let nearest = (position / spacing).round() as usize;
            for n in nearest.saturating_sub(BESIDE).max(1)..=nearest + BESIDE {
                let p = n as f64 * spacing;
                if reaches(p) && is_new(&members, p) {
                    members.push((p, Some(usual_power(comb, n))));
                }
            }
        }
        let n = members.len();
        let mut normal = nalgebra::DMatrix::<Complex64>::zeros(n, n);
        let mut right = nalgebra::DVector::<Complex64>::zeros(n);
        let mut row = vec![Complex64::ZERO; n];
        for (k, bin_value) in self.spectrum.iter().enumerate().take(high + 1).skip(low) {
            row.iter_mut().zip(&members).for_each(|(r, m)| *r = dsp::window_response(k as f64 - m.0));
            for a in 0..n {
                right[a] += row[a].conj() * bin_value;
                for b in 0..n {
                    normal[(a, b)] += row[a].conj() * row[b];
                }
            }
        }
        // Alone, a line's normal equation is the energy of the window response; crowding raises the
        // variance by this factor.
        let alone = normal[(0, 0)].re;
        let noise = self.floor[bin] * LINE_FIT_NOISE_GAIN;
        for (a, (_, power)) in members.iter().enumerate() {
            if let Some(power) = power {
                normal[(a, a)] += noise * alone / power.max(f64::MIN_POSITIVE);
            }
        }
        let inverse = normal.try_inverse()?;
        let amplitude = (0..n).map(|a| inverse[(0, a)] * right[a]).sum();
        let crowding = (inverse[(0, 0)].re * alone).max(1.0);
        Some(LineValue { amplitude, noise: noise * crowding })
    }
}

/// Power that a multiple of a shaft usually has where nobody listed it: that of its neighbours.
fn usual_power(comb: &[LineValue], n: usize) -> f64 {
    let beside = (n.saturating_sub(BESIDE).max(1)..=n + BESIDE).filter(|k| *k != n);
    let mut powers: Vec<f64> = beside.filter_map(|k| comb.get(k - 1)).map(|l| l.amplitude.norm_sqr()).collect();
    if powers.is_empty() { 0.0 } else { UNLISTED * median(&mut powers) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read::dsp::Transforms;
    use std::f64::consts::TAU;

    /// A line that is not there, 1.3 bins beside one that is: it is seen where the other is not
    /// known, and not where the other takes part.
    #[test]
    fn analytic_what_is_left_beside_a_line_is_not_the_lines() {
        const LEN: usize = 8192;
        const REVOLUTIONS: f64 = 64.0;
        let family = crate::read::lines::Family::Shaft { shaft: 0, multiple: 9 };
        let lines = [Line { family, order: 9.5 }];
        let other = 9.5 + 1.3 / REVOLUTIONS;
        let turn = |n: usize| n as f64 * REVOLUTIONS / LEN as f64;
        let signal: Vec<f64> = (0..LEN).map(|n| (TAU * other * turn(n) + 0.4).cos()).collect();
        let spectrum = dsp::windowed_spectrum(&mut Transforms::default(), &signal);
        let floor = vec![1e-6; spectrum.len()];
        let read = |beside: &[f64]| {
            let (spectrum, floor, lines) = (&spectrum[..], &floor[..], &lines[..]);
            let fit = LineFit { spectrum, floor, lines, shafts: &[], combs: &[], beside, revolutions: REVOLUTIONS };
            fit.all(40.0)[0].unwrap().amplitude.norm()
        };
        assert!(read(&[]) > 0.3 && read(&[other]) < 1e-3, "{} {}", read(&[]), read(&[other]));
    }

    /// A line, and 0.3 bins beside it a multiple of another shaft half as large, unlisted, at any
    /// phase. By itself the line would be read wrong by up to a half; the joint fit tells both
    /// apart where there is little noise, and prices it. With noise as large as the neighbour it
    /// owns up to the doubt.
    #[test]
    fn analytic_a_line_beside_another_comb_is_told_apart_at_a_price() {
        const LEN: usize = 8192;
        const REVOLUTIONS: f64 = 64.0;
        let shafts = [("a".to_owned(), 1.0), ("b".to_owned(), (9.5 + 0.3 / REVOLUTIONS) / 20.0)];
        let family = crate::read::lines::Family::Shaft { shaft: 0, multiple: 9 };
        let lines = [Line { family, order: 9.5 }];
        let read = |phase: f64, floor: f64| {
            let signal: Vec<f64> = (0..LEN)
                .map(|n| {
                    let turn = n as f64 * REVOLUTIONS / LEN as f64;
                    // The other shaft makes all its multiples alike.
                    let comb: f64 = (14..27).map(|k| (TAU * shafts[1].1 * f64::from(k) * turn + phase).cos()).sum();
                    (TAU * 9.5 * turn).cos() + 0.5 * comb
                })
                .collect();
            let spectrum = dsp::windowed_spectrum(&mut Transforms::default(), &signal);
            let floor = vec![floor; spectrum.len()];
            let combs: Vec<Vec<LineValue>> =
                shafts.iter().map(|s| comb(&spectrum, &floor, s.1 * REVOLUTIONS, 40.0 * REVOLUTIONS)).collect();
            let alone = comb(&spectrum, &floor, 9.5 * REVOLUTIONS, 40.0 * REVOLUTIONS)[0];
            let (spectrum, floor, lines, combs) = (&spectrum, &floor[..], &lines[..], &combs[..]);
            let (shafts, beside, revolutions) = (&shafts[..], &[][..], REVOLUTIONS);
            let fit = LineFit { spectrum, floor, lines, shafts, combs, beside, revolutions };
            (fit.all(40.0)[0].unwrap(), alone)
        };
        let mut worst_alone = 0.0f64;
        for k in 0..16 {
            let phase = TAU * f64::from(k) / 16.0;
            let (value, alone) = read(phase, 1e-8);
            worst_alone = worst_alone.max((alone.amplitude.norm() - 1.0).abs());
            assert!((value.amplitude.norm() - 1.0).abs() < 1e-3, "{value:?}");
            // Window responses 0.3 bins apart agree to 0.98: 1/(1 − 0.98²) = 25 times the variance.
            assert!((10.0..60.0).contains(&(value.noise / alone.noise)), "{value:?} {alone:?}");
            let (value, _) = read(phase, 0.25);
            let off = value.amplitude.norm() - 1.0;
            assert!(off.powi(2) < 2.0 * value.noise && value.noise > 0.25, "{value:?}");
        }
        assert!(worst_alone > 0.3, "{worst_alone}");
    }
}
