//! The lower part of signals' bands over shaft angle: as few steps of angle as that part takes.
//!
//! Between the samples a low-pass filter gives the value, a sine over its argument through the
//! Blackman–Harris window: what lies above the part is 90 dB down before it could fold into it, and
//! fewer steps make shorter transforms. One table of the filter serves all channels.

use std::f64::consts::PI;

use pulp::{Arch, Simd, WithSimd};

use crate::dsp::{even_steps, window_at};
use crate::turning::Turning;

/// Steps of angle over the highest bin that is wanted: the filter has from it to three times of it
/// to fall.
const STEPS: f64 = 4.0;
/// A speed that is not even moves the band (relative).
const WANDER: f64 = 1.05;
/// Highest share of the sample rate that stays whole where all steps are needed.
const WHOLE: f64 = 0.45;
/// Taps of the filter times the width of its edge: the main lobe of the window on both sides.
const EDGE_TAPS: f64 = 8.0;
/// Positions between two samples at which the filter is worked out; straight lines between them are
/// off by (2π f / 256)² / 8 at a share `f` of the sample rate, below −94 dB.
const PHASES: usize = 256;
/// Taps are whole vectors of any processor.
const VECTOR: usize = 16;

/// So many even steps of angle that bins up to one are whole, of a recording of `len` samples.
pub(crate) fn steps(bins: usize, len: usize) -> usize {
    let least = (STEPS * WANDER * bins as f64).ceil() as usize;
    let is_smooth = |mut n: usize| {
        for factor in [2, 3, 5] {
            while n.is_multiple_of(factor) {
                n /= factor;
            }
        }
        n == 1
    };
    let steps = least.next_multiple_of(4).max(64);
    (steps..len).step_by(4).find(|&n| is_smooth(n)).unwrap_or(len)
}

/// Gives all channels at so many even steps of angle, step after step; bins up to one are whole.
pub(crate) fn resample(
    channels: &[&[f32]],
    turning: &Turning,
    (bins, steps): (usize, usize),
    mut take: impl FnMut(usize, &[f32]),
) {
    let len = turning.len();
    let highest = WANDER * bins as f64 / len as f64;
    let filter = Filter::new(highest.min(WHOLE), steps as f64 / len as f64);
    let arch = Arch::new();
    let mut out = vec![0.0; channels.len()];
    let mut window = vec![0.0; 2 * filter.taps];
    for (step, position) in even_steps(turning.angles(), turning.ends(), len, steps).enumerate() {
        arch.dispatch(At { filter: &filter, channels, position, window: &mut window, out: &mut out });
        take(step, &out);
    }
}

/// A low-pass filter between samples.
struct Filter {
    taps: usize,
    /// Its values at each phase, and the way to the next phase.
    table: Vec<f32>,
}

impl Filter {
    /// That leaves frequencies up to the highest as they are, and of what lies above half the steps
    /// (both by the sample) nothing that would fold onto them.
    fn new(highest: f64, steps: f64) -> Self {
        let edge = steps - 2.0 * highest;
        let taps = ((EDGE_TAPS / edge).ceil() as usize).next_multiple_of(VECTOR);
        let half = (taps / 2) as f64;
        let at = |distance: f64| {
            if distance.abs() >= half {
                return 0.0;
            }
            let turn = PI * steps * distance;
            let sinc = if turn.abs() < 1e-9 { 1.0 } else { turn.sin() / turn };
            steps * sinc * window_at(0.5 + 0.5 * distance / half)
        };
        let value = |phase: usize, tap: usize| at(phase as f64 / PHASES as f64 + half - 1.0 - tap as f64);
        let mut table = Vec::with_capacity(2 * taps * PHASES);
        for phase in 0..PHASES {
            table.extend((0..taps).map(|tap| value(phase, tap) as f32));
            table.extend((0..taps).map(|tap| (value(phase + 1, tap) - value(phase, tap)) as f32));
        }
        Self { taps, table }
    }
}

/// All channels at one position (samples).
struct At<'a> {
    filter: &'a Filter,
    channels: &'a [&'a [f32]],
    position: f64,
    /// Room for the samples about it of two channels, where the recording ends there.
    window: &'a mut [f32],
    out: &'a mut [f32],
}

impl WithSimd for At<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { filter, channels, position, window, out } = self;
        let taps = filter.taps;
        let centre = position as usize;
        let phase = (position - centre as f64) * PHASES as f64;
        // A position at the very end may be rounded to a whole one.
        let at = (phase as usize).min(PHASES - 1);
        let along = simd.splat_f32s((phase - at as f64) as f32);
        let row = &filter.table[2 * at * taps..2 * (at + 1) * taps];
        let (values, ways) = row.split_at(taps);
        let (values, ways) = (S::as_simd_f32s(values).0, S::as_simd_f32s(ways).0);
        // Two channels together: the filter is worked out once for both, and two sums do not wait
        // for each other.
        let (one, other) = window.split_at_mut(taps);
        let mut out = out.chunks_mut(2);
        for pair in channels.chunks(2) {
            let Some(out) = out.next() else { return };
            let (a, b) = (pair[0], pair[pair.len() - 1]);
            let a = S::as_simd_f32s(about(a, centre, one)).0;
            let b = S::as_simd_f32s(about(b, centre, other)).0;
            let mut sums = [simd.splat_f32s(0.0); 2];
            for (((a, b), value), way) in a.iter().zip(b).zip(values).zip(ways) {
                let factor = simd.mul_add_e_f32s(along, *way, *value);
                sums[0] = simd.mul_add_e_f32s(*a, factor, sums[0]);
                sums[1] = simd.mul_add_e_f32s(*b, factor, sums[1]);
            }
            for (out, sum) in out.iter_mut().zip(sums) {
                *out = simd.reduce_sum_f32s(sum);
            }
        }
    }
}

/// The samples of a channel about one of them, zeros beyond its ends; `room` is as long as they
/// are.
#[inline(always)]
fn about<'a>(channel: &'a [f32], centre: usize, room: &'a mut [f32]) -> &'a [f32] {
    let taps = room.len();
    let low = (centre + 1).checked_sub(taps / 2);
    if let Some(about) = low.and_then(|low| channel.get(low..low + taps)) {
        return about;
    }
    for (tap, x) in room.iter_mut().enumerate() {
        let sample = (centre + 1 + tap).checked_sub(taps / 2);
        *x = sample.and_then(|n| channel.get(n)).copied().unwrap_or(0.0);
    }
    room
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::tests::noise;
    use crate::dsp::{Transforms, resample_to_angle, window, window_scale};
    use crate::turning::Start;

    /// The bins that are asked for are those of the whole band over angle, whose interpolation is
    /// good to −80 dB of a line: a speed that wanders, lines within the part and above it, noise;
    /// a part of the band and all of it.
    #[test]
    fn oracle_a_part_of_the_band_is_that_of_the_whole() {
        const LEN: usize = 60_000;
        let mut turning = Turning::new(Start::Even { input_hz: 25.0, sample_rate_hz: 10_000.0 }, LEN);
        let wander: Vec<f64> = (0..200).map(|b| 0.02 * (0.1 * f64::from(b)).sin()).collect();
        turning.correct(&wander);
        let angle: Vec<f64> = turning.angles().collect();
        let mut white = noise();
        let orders = [1.0, 7.3, 19.0, 46.0, 93.0, 141.0];
        let lines = |a: f64| orders.map(|o| (2.0 * PI * o * a + o).cos()).iter().sum::<f64>();
        let signal: Vec<f32> = angle.iter().map(|a| (lines(*a) + 0.01 * white()) as f32).collect();
        let spectrum = |signal: &[f64]| {
            let len = signal.len();
            let mut weighted: Vec<f64> = signal.iter().enumerate().map(|(n, x)| x * window(n, len)).collect();
            let bins = Transforms::default().forward_real(&mut weighted);
            bins.iter().map(|bin| bin * window_scale(len)).collect::<Vec<_>>()
        };
        let whole = spectrum(&resample_to_angle(&mut Transforms::default(), &signal, &angle));
        for bins in [1500, 4000, 12_000, 16_000, 25_000] {
            let count = steps(bins, LEN);
            assert!(count < LEN || bins > 12_000, "{bins}: {count}");
            let mut over_angle = Vec::with_capacity(count);
            resample(&[&signal], &turning, (bins, count), |_, x| over_angle.push(f64::from(x[0])));
            let part = spectrum(&over_angle);
            let off = (0..bins).map(|k| (part[k] - whole[k]).norm()).fold(0.0, f64::max);
            assert!(off < 1e-4, "{bins}: {off:.1e}");
        }
    }
}
