//! From the time-synchronous average of a shaft to the indicators of its gears.

#![allow(clippy::needless_range_loop, reason = "a lane is the same place of several arrays")]

use std::sync::Arc;

use num_complex::Complex64;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use rustfft::{Fft, FftPlanner};

use crate::estimate::Estimate;
use crate::indicators::{GEAR_INDICATORS, GearIndicator, GearIndicators, RATIO_SIDEBANDS};
use crate::spectral::kernels::kernels;

/// Harmonics of the shaft's own speed that belong to the regular signal: unbalance and
/// misalignment.
const SHAFT_HARMONICS: usize = 2;

/// A difference signal below this share of the average's power is rounding, no signal.
const ROUNDING: f64 = 1e-20;

/// Points of the envelope for each line of its band. The modulus is not limited to the band; four
/// points a line follow it.
const ENVELOPE_POINTS: usize = 4;

/// Lanes of the running sums.
const LANES: usize = 4;

/// A gear on a shaft.
#[derive(Clone)]
pub struct GearPlan {
    /// Stage, by position.
    pub stage: usize,
    /// 0: pinion, 1: wheel.
    pub side: usize,
    teeth: usize,
    /// Lines on each side of the mesh frequency that belong to its band: up to half way to the
    /// shaft's line and to the second harmonic.
    half_band: usize,
    envelope: Arc<dyn Fft<f64>>,
}

/// The average of a shaft, as its gears need it.
struct Average<'a> {
    spectrum: &'a [Complex64],
    /// Number of points.
    count: f64,
    /// Of each point.
    variance: f64,
    /// Highest line that is used.
    highest: usize,
    /// From the lowest point to the highest.
    span: f64,
    /// Mean square of all lines that are used.
    total: f64,
}

impl GearPlan {
    /// Indicators of this gear alone; `buffers` for its band, its envelope and the transform.
    fn fill(
        &self,
        average: &Average<'_>,
        buffers: (&mut [Complex64], &mut [f64], &mut [Complex64]),
        values: &mut [Estimate; GEAR_INDICATORS],
    ) {
        let Average { spectrum, count, variance, highest, span, total } = *average;
        // Variance of an amplitude: noise in one of the two components of 2 Y / M.
        let (z, line_variance) = (self.teeth, 2.0 * variance / count);
        let amplitude = |k: usize| 2.0 * spectrum[k].norm() / count;
        let mut set = |which: GearIndicator, estimate: Estimate| values[which as usize] = estimate;
        if z <= highest && amplitude(z) > 0.0 {
            let harmonics = highest / z;
            let mesh: f64 = (1..=harmonics).map(|h| amplitude(h * z)).sum();
            let value = span / mesh;
            let spread = 2.0 * variance + value * value * line_variance * harmonics as f64;
            set(GearIndicator::Fm0, Estimate::new(value, spread.sqrt() / mesh));
        }
        if z < highest {
            let index = 0.5 * (amplitude(z - 1) + amplitude(z + 1));
            set(GearIndicator::SidebandIndex, Estimate::new(index, (0.5 * line_variance).sqrt()));
        }
        if z > RATIO_SIDEBANDS && z + RATIO_SIDEBANDS <= highest && amplitude(z) > 0.0 {
            let sum: f64 = (1..=RATIO_SIDEBANDS).map(|k| amplitude(z - k) + amplitude(z + k)).sum();
            let ratio = sum / amplitude(z);
            let relative = line_variance * (2.0 * RATIO_SIDEBANDS as f64 + ratio * ratio);
            set(GearIndicator::SidebandRatio, Estimate::new(ratio, relative.sqrt() / amplitude(z)));
        }
        if z + self.half_band <= highest {
            let length = self.envelope.len();
            let band = &mut buffers.0[..length];
            let first = z - self.half_band;
            band.fill(Complex64::ZERO);
            band[..=2 * self.half_band].copy_from_slice(&spectrum[first..=z + self.half_band]);
            self.envelope.process_with_scratch(band, buffers.2);
            let envelope = &mut buffers.1[..length];
            envelope.iter_mut().zip(band).for_each(|(e, b)| *e = 2.0 * b.norm() / count);
            let mean = envelope.iter().sum::<f64>() / length as f64;
            envelope.iter_mut().for_each(|e| *e -= mean);
            let Powers { p2, p4, p6, .. } = powers(envelope).means(length as f64);
            // Noise of the band on more points than it has lines: σ² Σ g² is at most that of all
            // its lines, 2 L / M.
            let noise = 2.0 * variance * length as f64 / count;
            if p2 > ROUNDING * total {
                set(GearIndicator::EnvelopeDeviation, Estimate::new(p2.sqrt(), (noise / length as f64).sqrt()));
                set(GearIndicator::EnvelopeKurtosis, normalised(2, p2, p4, p6, length as f64, noise));
            }
        }
    }
}

/// Everything that depends on the number of points of an average.
#[derive(Clone)]
pub struct ShaftPlan {
    points: usize,
    gears: Vec<GearPlan>,
    forward: Arc<dyn RealToComplex<f64>>,
    inverse: Arc<dyn ComplexToReal<f64>>,
}

/// Buffers, for any plan; they grow when a plan is larger than those before.
#[derive(Default)]
pub struct GearState {
    input: Vec<f64>,
    spectrum: Vec<Complex64>,
    left: Vec<Complex64>,
    signal: Vec<f64>,
    scratch: Vec<Complex64>,
    envelope: Vec<Complex64>,
}

/// `Σ x^k` for even `k`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Powers {
    p2: f64,
    p4: f64,
    p6: f64,
    p8: f64,
    p10: f64,
    p14: f64,
}

kernels! {
    fn powers<'a>(_simd; x: &'a [f64]) -> Powers {
        let mut sums = [[0.0; LANES]; 6];
        let (chunks, rest) = x.as_chunks::<LANES>();
        for chunk in chunks {
            for lane in 0..LANES {
                let a = chunk[lane] * chunk[lane];
                let (b, c) = (a * a, a * a * a);
                sums[0][lane] += a;
                sums[1][lane] += b;
                sums[2][lane] += c;
                sums[3][lane] += b * b;
                sums[4][lane] += b * c;
                sums[5][lane] += b * b * c;
            }
        }
        for x in rest {
            let a = x * x;
            let (b, c) = (a * a, a * a * a);
            for (sum, power) in sums.iter_mut().zip([a, b, c, b * b, b * c, b * b * c]) {
                sum[0] += power;
            }
        }
        let [p2, p4, p6, p8, p10, p14] = sums.map(|s| (s[0] + s[1]) + (s[2] + s[3]));
        Powers { p2, p4, p6, p8, p10, p14 }
    }
}

impl Powers {
    fn means(mut self, count: f64) -> Self {
        for sum in [&mut self.p2, &mut self.p4, &mut self.p6, &mut self.p8, &mut self.p10, &mut self.p14] {
            *sum /= count;
        }
        self
    }
}

/// `K = m_2p / m_2^p` of a signal without mean, from its means: with `∂K/∂x_i = (2p/N) (x_i^(2p-1)
/// / m_2^p - m_2p x_i / m_2^(p+1))` the sum of the squared slopes is
/// `(4p²/N) (m_(4p-2) / m_2^2p - m_2p² / m_2^(2p+1))`.
fn normalised(p: i32, m2: f64, m2p: f64, m4p2: f64, count: f64, variance: f64) -> Estimate {
    let value = m2p / m2.powi(p);
    let slopes = 4.0 * f64::from(p * p) / count * (m4p2 / m2.powi(2 * p) - m2p * m2p / m2.powi(2 * p + 1));
    Estimate::new(value, (variance * slopes.max(0.0)).sqrt())
}

impl ShaftPlan {
    /// For an average of `points` points of a shaft that carries gears: stage, side and teeth of
    /// each.
    pub fn new(
        points: usize,
        gears: impl Iterator<Item = (usize, usize, u32)>,
        real: &mut RealFftPlanner<f64>,
        complex: &mut FftPlanner<f64>,
    ) -> Self {
        let gears = gears.map(|(stage, side, teeth)| {
            let teeth = teeth as usize;
            let half_band = (teeth - 1) / 2;
            let length = (ENVELOPE_POINTS * (2 * half_band + 1)).next_power_of_two();
            GearPlan { stage, side, teeth, half_band, envelope: complex.plan_fft_inverse(length) }
        });
        Self {
            points,
            gears: gears.collect(),
            forward: real.plan_fft_forward(points),
            inverse: real.plan_fft_inverse(points),
        }
    }

    /// Makes room for this plan.
    pub fn prepare(&self, state: &mut GearState) {
        let grow = |v: &mut Vec<Complex64>, n: usize| v.resize(v.len().max(n), Complex64::ZERO);
        let lines = self.points / 2 + 1;
        for buffer in [&mut state.input, &mut state.signal] {
            buffer.resize(buffer.len().max(self.points), 0.0);
        }
        grow(&mut state.spectrum, lines);
        grow(&mut state.left, lines);
        let mut scratch = self.forward.get_scratch_len().max(self.inverse.get_scratch_len());
        for gear in &self.gears {
            grow(&mut state.envelope, gear.envelope.len());
            scratch = scratch.max(gear.envelope.get_inplace_scratch_len());
            let room = state.signal.len().max(gear.envelope.len());
            state.signal.resize(room, 0.0);
        }
        grow(&mut state.scratch, scratch);
    }

    /// Indicators of all gears of the shaft from its average over `revolutions` revolutions.
    /// `variance`: that of one point of the average; lines above `highest` orders are left out.
    pub fn process(
        &self,
        state: &mut GearState,
        average: &[f64],
        variance: f64,
        revolutions: u32,
        highest: usize,
        out: &mut [[GearIndicators; 2]],
    ) {
        let count = self.points as f64;
        let highest = highest.min((self.points - 1) / 2);
        if !self.gears.iter().any(|g| g.teeth < highest) {
            return;
        }
        state.input[..self.points].copy_from_slice(average);
        let lines = self.points / 2 + 1;
        let spectrum = &mut state.spectrum[..lines];
        // Lengths are those of the plan, the only thing that could be wrong.
        if self.forward.process_with_scratch(&mut state.input[..self.points], spectrum, &mut state.scratch).is_err() {
            return;
        }
        let square = |k: &Complex64| k.norm_sqr();

        let left = &mut state.left[..lines];
        let signal = &mut state.signal[..self.points];
        self.remove(left, spectrum, highest, 0);
        if self.inverse.process_with_scratch(left, signal, &mut state.scratch).is_err() {
            return;
        }
        signal.iter_mut().for_each(|x| *x /= count);
        let residual = powers(signal).means(count);

        self.remove(left, spectrum, highest, 1);
        let taken: f64 = spectrum[1..=highest].iter().zip(&left[1..]).map(|(y, d)| square(&(y - d))).sum();
        let regular = 2.0 * taken / (count * count);
        if self.inverse.process_with_scratch(left, signal, &mut state.scratch).is_err() {
            return;
        }
        signal.iter_mut().for_each(|x| *x /= count);
        let difference = powers(signal).means(count);
        let total: f64 = 2.0 * spectrum[1..=highest].iter().map(square).sum::<f64>() / (count * count);

        let mut shaft = [Estimate::UNKNOWN; GEAR_INDICATORS];
        let mut set = |which: GearIndicator, estimate: Estimate| shaft[which as usize] = estimate;
        let rms = |m2: f64| Estimate::new(m2.sqrt(), (variance / count).sqrt());
        if residual.p2 > ROUNDING * total {
            let Powers { p2, p4, p6, .. } = residual;
            set(GearIndicator::ResidualRms, rms(p2));
            set(GearIndicator::ResidualKurtosis, normalised(2, p2, p4, p6, count, variance));
        }
        if difference.p2 > ROUNDING * total {
            let Powers { p2, p4, p6, p8, p10, p14 } = difference;
            set(GearIndicator::DifferenceRms, rms(p2));
            set(GearIndicator::Fm4, normalised(2, p2, p4, p6, count, variance));
            set(GearIndicator::M6a, normalised(3, p2, p6, p10, count, variance));
            set(GearIndicator::M8a, normalised(4, p2, p8, p14, count, variance));
            if regular > ROUNDING * total {
                let value = (p2 / regular).sqrt();
                let relative = variance / count * (1.0 / p2 + 1.0 / regular);
                set(GearIndicator::EnergyRatio, Estimate::new(value, value * relative.sqrt()));
            }
        }

        let extremes = average.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &x| (x.min(a), x.max(b)));
        let average = Average { spectrum, count, variance, highest, span: extremes.1 - extremes.0, total };
        for gear in &self.gears {
            let mut values = shaft;
            gear.fill(&average, (&mut state.envelope, &mut state.signal, &mut state.scratch), &mut values);
            if let Some(stage) = out.get_mut(gear.stage) {
                stage[gear.side] = GearIndicators { revolutions, values };
            }
        }
    }

    /// `left` becomes the spectrum without mean, without orders above `highest`, without the
    /// shaft's first two orders and without mesh harmonics and `sidebands` lines on each side of
    /// them.
    fn remove(&self, left: &mut [Complex64], spectrum: &[Complex64], highest: usize, sidebands: usize) {
        left[..=highest].copy_from_slice(&spectrum[..=highest]);
        left[highest + 1..].fill(Complex64::ZERO);
        left[..=SHAFT_HARMONICS.min(highest)].fill(Complex64::ZERO);
        for gear in &self.gears {
            for line in (gear.teeth..=highest + sidebands).step_by(gear.teeth) {
                let first = line - sidebands;
                if first <= highest {
                    left[first..=(line + sidebands).min(highest)].fill(Complex64::ZERO);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    const POINTS: usize = 1000;
    const TEETH: u32 = 29;

    fn of(average: &[f64], variance: f64) -> GearIndicators {
        let gears = [(0, 0, TEETH)].into_iter();
        let plan = ShaftPlan::new(average.len(), gears, &mut RealFftPlanner::new(), &mut FftPlanner::new());
        let mut state = GearState::default();
        plan.prepare(&mut state);
        let mut out = [[GearIndicators::UNKNOWN; 2]];
        plan.process(&mut state, average, variance, 25, 300, &mut out);
        out[0][0]
    }

    fn wave(order: usize, amplitude: f64) -> impl Fn(usize) -> f64 {
        move |i| amplitude * (TAU * (order * i) as f64 / POINTS as f64).cos()
    }

    /// Two mesh harmonics, first sidebands and one line that belongs to nothing: every indicator by
    /// hand.
    #[test]
    fn analytic_lines() {
        let lines = [(1, 0.3), (29, 2.0), (58, 1.0), (28, 0.4), (30, 0.2), (40, 0.1)];
        let average: Vec<f64> =
            (0..POINTS).map(|i| 7.0 + lines.iter().map(|&(k, a)| wave(k, a)(i)).sum::<f64>()).collect();
        let found = of(&average, 0.0);
        let span = average.iter().fold(f64::MIN, |a, &b| a.max(b)) - average.iter().fold(f64::MAX, |a, &b| a.min(b));
        let power = |lines: &[f64]| 0.5 * lines.iter().map(|a| a * a).sum::<f64>();
        let expected = [
            (GearIndicator::Fm0, span / 3.0),
            (GearIndicator::Fm4, 1.5),
            (GearIndicator::M6a, 2.5),
            (GearIndicator::M8a, 4.375),
            (GearIndicator::DifferenceRms, power(&[0.1]).sqrt()),
            (GearIndicator::ResidualRms, power(&[0.1, 0.4, 0.2]).sqrt()),
            (GearIndicator::EnergyRatio, (power(&[0.1]) / power(&[0.3, 2.0, 1.0, 0.4, 0.2])).sqrt()),
            (GearIndicator::SidebandIndex, 0.3),
            (GearIndicator::SidebandRatio, 0.3),
        ];
        for (which, expected) in expected {
            let value = found.get(which).value;
            assert!((value - expected).abs() < 1e-9, "{which:?}: {value} and {expected}");
        }
    }

    /// An amplitude modulation of the mesh of one line has the envelope `A (1 + m cos)`: deviation
    /// `A m / √2`, kurtosis 3/2.
    #[test]
    fn analytic_envelope() {
        let average: Vec<f64> =
            (0..POINTS).map(|i| wave(29, 2.0)(i) * (1.0 + 0.25 * (TAU * i as f64 / 1000.0).cos())).collect();
        let found = of(&average, 0.0);
        assert!((found.get(GearIndicator::EnvelopeDeviation).value - 0.5 / 2f64.sqrt()).abs() < 1e-9);
        assert!((found.get(GearIndicator::EnvelopeKurtosis).value - 1.5).abs() < 1e-9);
    }

    /// One tooth in trouble: a burst once a turn raises FM4 far above that of noise, which is 3
    /// within four standard errors of the remaining 280 lines.
    #[test]
    fn analytic_a_burst_raises_fm4() {
        let mut random = crate::testing::Random(5);
        let noise: Vec<f64> = (0..POINTS).map(|i| wave(29, 2.0)(i) + 0.1 * random.normal()).collect();
        let quiet = of(&noise, 0.01).get(GearIndicator::Fm4);
        assert!((quiet.value - 3.0).abs() < 4.0 * (24.0f64 / 560.0).sqrt(), "{quiet:?}");
        let burst = |i: usize| if (300..312).contains(&i) { 1.5 * f64::from(u8::from(i % 4 < 2)) - 0.75 } else { 0.0 };
        let hit: Vec<f64> = noise.iter().enumerate().map(|(i, x)| x + burst(i)).collect();
        let loud = of(&hit, 0.01).get(GearIndicator::Fm4);
        assert!(loud.value > quiet.value + 5.0 * loud.sigma.hypot(quiet.sigma), "{loud:?} and {quiet:?}");
    }

    /// The stated sigma is the scatter of repeated averages with fresh noise, where a fixed pattern
    /// stands well above it: within 20 % over 300 draws (8 % by 4 standard errors of a standard
    /// deviation, the rest is curvature).
    #[test]
    fn analytic_sigma_of_a_fixed_pattern() {
        let mut random = crate::testing::Random(9);
        let pattern: Vec<f64> = (0..POINTS)
            .map(|i| wave(29, 2.0)(i) + wave(28, 0.4)(i) + wave(33, 0.5)(i) + wave(41, 0.4)(i) + wave(77, 0.3)(i))
            .collect();
        let checked = [
            GearIndicator::Fm4,
            GearIndicator::M6a,
            GearIndicator::ResidualKurtosis,
            GearIndicator::DifferenceRms,
            GearIndicator::SidebandIndex,
            GearIndicator::SidebandRatio,
            GearIndicator::EnvelopeDeviation,
        ];
        let (mut sums, mut sigmas) = ([[0.0; 2]; 7], [0.0; 7]);
        let draws = 300;
        for _ in 0..draws {
            let noisy: Vec<f64> = pattern.iter().map(|x| x + 0.03 * random.normal()).collect();
            let found = of(&noisy, 0.03 * 0.03);
            for (i, which) in checked.iter().enumerate() {
                let Estimate { value, sigma } = found.get(*which);
                sums[i][0] += value / f64::from(draws);
                sums[i][1] += value * value / f64::from(draws);
                sigmas[i] += sigma / f64::from(draws);
            }
        }
        for (i, which) in checked.iter().enumerate() {
            let scatter = (sums[i][1] - sums[i][0] * sums[i][0]).sqrt();
            let ratio = sigmas[i] / scatter;
            assert!((0.8..1.4).contains(&ratio), "{which:?}: stated {}, seen {scatter}", sigmas[i]);
        }
    }
}
