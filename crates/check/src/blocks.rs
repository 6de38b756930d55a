//! Harmonics of a shaft's angle in a recording, gathered in blocks: some fifty values a second in
//! place of samples.
//!
//! A stretch of a block is worked at a time. The phasor of an order is made of the angle, its
//! powers are the harmonics, and each of them is summed over the stretch with the weights of the
//! three blocks about it: loops over numbers that lie side by side, for the processor's vectors.

use std::ops::Range;

use gearwatch_core::spectral::kernels::turned_back;
use num_complex::Complex64;
use pulp::{Arch, Simd, WithSimd};

/// An order and how many of its harmonics are asked for.
pub(crate) struct Comb {
    pub(crate) order: f64,
    pub(crate) count: usize,
}

/// The harmonics of some orders in every channel, turned back by the angle and gathered in blocks
/// by the weights of a quadratic spline; by order, then harmonic, then channel. `angle` fills in
/// those of the next samples (revolutions).
pub(crate) fn demodulate<T: Copy + Into<f64>>(
    channels: &[&[T]],
    (mut angle, len): (impl FnMut(&mut [f64]), usize),
    combs: &[Comb],
    blocks: usize,
) -> Vec<Vec<Complex64>> {
    let lanes = combs.iter().map(|comb| comb.count).sum::<usize>() * channels.len();
    let mut out = vec![vec![Complex64::ZERO; blocks]; lanes];
    let arch = Arch::new();
    let mut stretch = Stretch::new(channels.len());
    let mut sums = vec![[Complex64::ZERO; 3]; lanes];
    let mut first = 0;
    while first < len {
        let block = block_of(first, len, blocks);
        let samples = first..end_of(block, first, len, blocks).min(first + MOST);
        arch.dispatch(Take { stretch: &mut stretch, channels, samples: samples.clone(), block, of: (len, blocks) });
        angle(&mut stretch.angle[..samples.len()]);
        arch.dispatch(Gather { stretch: &mut stretch, combs, sums: &mut sums });
        // The record counts as going round, as it does to the transform.
        let about = [(block + blocks - 1) % blocks, block, (block + 1) % blocks];
        for (lane, sums) in out.iter_mut().zip(&sums) {
            about.iter().zip(sums).for_each(|(&k, sum)| lane[k] += sum);
        }
        first = samples.end;
    }
    out
}

/// Middle of a sample in blocks.
fn position(sample: usize, len: usize, blocks: usize) -> f64 {
    (sample as f64 + 0.5) * blocks as f64 / len as f64
}

fn block_of(sample: usize, len: usize, blocks: usize) -> usize {
    (position(sample, len, blocks) as usize).min(blocks - 1)
}

/// The first sample from `first` on that is not in its block any more.
fn end_of(block: usize, first: usize, len: usize, blocks: usize) -> usize {
    let guess = ((block + 1) as f64 * len as f64 / blocks as f64) as usize;
    let mut end = guess.saturating_sub(1).clamp(first + 1, len);
    while end < len && block_of(end, len, blocks) == block {
        end += 1;
    }
    while end > first + 1 && block_of(end - 1, len, blocks) != block {
        end -= 1;
    }
    end
}

/// Samples that are worked at a time, whole vectors of any processor.
const MOST: usize = 512;
const VECTOR: usize = 8;

/// Some samples of one block.
struct Stretch {
    /// Up to whole vectors.
    len: usize,
    angle: Vec<f64>,
    /// Phasor of an order and of its harmonic: real and imaginary parts.
    first: [Vec<f64>; 2],
    power: [Vec<f64>; 2],
    /// Samples times the weights of the three blocks, channel after channel; zero beyond the end.
    weighted: Vec<[Vec<f64>; 3]>,
}

impl Stretch {
    fn new(channels: usize) -> Self {
        let zeros = || vec![0.0; MOST];
        Self {
            len: 0,
            angle: zeros(),
            first: [zeros(), zeros()],
            power: [zeros(), zeros()],
            weighted: (0..channels).map(|_| [zeros(), zeros(), zeros()]).collect(),
        }
    }

    /// Weighs samples of a block.
    #[inline(always)]
    fn take<T: Copy + Into<f64>>(
        &mut self,
        channels: &[&[T]],
        samples: Range<usize>,
        block: usize,
        (len, blocks): (usize, usize),
    ) {
        let (count, first) = (samples.len(), samples.start as f64);
        self.len = count.next_multiple_of(VECTOR);
        self.angle[count..self.len].fill(0.0);
        // The weights lie where the phasors will.
        let [[before, own], [after, _]] = [&mut self.first, &mut self.power].map(|two| two.each_mut());
        let (before, own, after) = (&mut before[..count], &mut own[..count], &mut after[..count]);
        for i in 0..count {
            // As `position` has it.
            let t = (first + f64::from(i as u32) + 0.5) * blocks as f64 / len as f64 - block as f64;
            (before[i], own[i], after[i]) = (0.5 * (1.0 - t) * (1.0 - t), 0.5 + t * (1.0 - t), 0.5 * t * t);
        }
        for (channel, weighted) in channels.iter().zip(&mut self.weighted) {
            let channel = &channel[samples.clone()];
            for (weighted, weight) in weighted.iter_mut().zip([&*before, &*own, &*after]) {
                weigh(channel, weight, &mut weighted[..count]);
                weighted[count..self.len].fill(0.0);
            }
        }
    }
}

/// Weighing of samples.
struct Take<'a, T> {
    stretch: &'a mut Stretch,
    channels: &'a [&'a [T]],
    samples: Range<usize>,
    block: usize,
    of: (usize, usize),
}

impl<T: Copy + Into<f64>> WithSimd for Take<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        self.stretch.take(self.channels, self.samples, self.block, self.of);
    }
}

/// Samples times weights.
#[inline(always)]
fn weigh<T: Copy + Into<f64>>(samples: &[T], weights: &[f64], out: &mut [f64]) {
    for ((out, x), weight) in out.iter_mut().zip(samples).zip(weights) {
        *out = (*x).into() * weight;
    }
}

/// Sums of all harmonics over a stretch.
struct Gather<'a> {
    stretch: &'a mut Stretch,
    combs: &'a [Comb],
    /// By order, harmonic and channel.
    sums: &'a mut [[Complex64; 3]],
}

impl WithSimd for Gather<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { stretch, combs, sums } = self;
        let n = stretch.len;
        let (angle, weighted) = (&stretch.angle[..n], &stretch.weighted);
        let [first_re, first_im] = &mut stretch.first;
        let [re, im] = &mut stretch.power;
        let (first_re, first_im, re, im) = (&mut first_re[..n], &mut first_im[..n], &mut re[..n], &mut im[..n]);
        let mut sums = sums.chunks_exact_mut(weighted.len());
        for comb in combs {
            turn_back(comb.order, angle, first_re, first_im);
            for harmonic in 0..comb.count {
                if harmonic == 0 {
                    re.copy_from_slice(first_re);
                    im.copy_from_slice(first_im);
                } else {
                    turn_on(re, im, first_re, first_im);
                }
                let Some(of_channels) = sums.next() else { return };
                // Two channels together: six sums wait for their own additions, twelve do not.
                let (of_two, of_last) = of_channels.as_chunks_mut::<2>();
                let (two, last) = weighted.as_chunks::<2>();
                for (sums, [one, other]) in of_two.iter_mut().zip(two) {
                    let [a, b, c] = one;
                    let [d, e, f] = other;
                    let signals = [&a[..n], &b[..n], &c[..n], &d[..n], &e[..n], &f[..n]];
                    let [a, b, c, d, e, f] = products(simd, [re, im], signals);
                    *sums = [[a, b, c], [d, e, f]];
                }
                for (sums, [before, own, after]) in of_last.iter_mut().zip(last) {
                    *sums = products(simd, [re, im], [&before[..n], &own[..n], &after[..n]]);
                }
            }
        }
    }
}

/// Phasors of an order. The arguments are slices so that the compiler knows them for apart.
#[inline(always)]
fn turn_back(order: f64, angle: &[f64], re: &mut [f64], im: &mut [f64]) {
    for ((re, im), angle) in re.iter_mut().zip(im).zip(angle) {
        (*re, *im) = turned_back(order * angle);
    }
}

/// From a harmonic's phasors to the next one's.
#[inline(always)]
fn turn_on(re: &mut [f64], im: &mut [f64], first_re: &[f64], first_im: &[f64]) {
    for (((re, im), first_re), first_im) in re.iter_mut().zip(im).zip(first_re).zip(first_im) {
        (*re, *im) = (*re * first_re - *im * first_im, *re * first_im + *im * first_re);
    }
}

/// Sum of each of some real signals times a complex one.
#[inline(always)]
fn products<S: Simd, const N: usize>(simd: S, [re, im]: [&[f64]; 2], signals: [&[f64]; N]) -> [Complex64; N] {
    let (re, im) = (S::as_simd_f64s(re).0, S::as_simd_f64s(im).0);
    let n = re.len();
    let im = &im[..n];
    let mut of = [re; N];
    for (of, signal) in of.iter_mut().zip(signals) {
        *of = &S::as_simd_f64s(signal).0[..n];
    }
    let mut sums = [[simd.splat_f64s(0.0); 2]; N];
    for i in 0..n {
        for k in 0..N {
            sums[k][0] = simd.mul_add_e_f64s(re[i], of[k][i], sums[k][0]);
            sums[k][1] = simd.mul_add_e_f64s(im[i], of[k][i], sums[k][1]);
        }
    }
    sums.map(|[re, im]| Complex64::new(simd.reduce_sum_f64s(re), simd.reduce_sum_f64s(im)))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::dsp::tests::noise;

    /// Each sample put straight into the three blocks about it.
    fn straight(channels: &[&[f64]], angle: &[f64], order: f64, count: usize, blocks: usize) -> Vec<Vec<Complex64>> {
        let len = angle.len();
        let mut out = vec![vec![Complex64::ZERO; blocks]; count * channels.len()];
        for (n, a) in angle.iter().enumerate() {
            let position = (n as f64 + 0.5) * blocks as f64 / len as f64;
            let block = (position as usize).min(blocks - 1);
            let t = position - block as f64;
            let weights = [0.5 * (1.0 - t) * (1.0 - t), 0.5 + t * (1.0 - t), 0.5 * t * t];
            let at = [(block + blocks - 1) % blocks, block, (block + 1) % blocks];
            let phasor = Complex64::from_polar(1.0, -TAU * (order * a).fract());
            let mut power = Complex64::ONE;
            for h in 0..count {
                power *= phasor;
                for (c, x) in channels.iter().enumerate() {
                    for (k, w) in at.iter().zip(weights) {
                        out[h * channels.len() + c][*k] += power * x[n] * w;
                    }
                }
            }
        }
        out
    }

    /// Up to the rounding of sums in another order, also at the ends, where the record goes round.
    #[test]
    fn oracle_blocks_gather_what_each_sample_puts_into_them() {
        let mut noise = noise();
        let channels: Vec<Vec<f64>> = (0..2).map(|_| (0..5000).map(|_| noise()).collect()).collect();
        let channels: Vec<&[f64]> = channels.iter().map(Vec::as_slice).collect();
        let angle: Vec<f64> = (0..5000).map(|n| 0.003 * n as f64 + 1e-4 * noise()).collect();
        for (count, blocks) in [(3, 64), (1, 77), (8, 1250)] {
            let mut left = &angle[..];
            let fill = |out: &mut [f64]| {
                out.copy_from_slice(&left[..out.len()]);
                left = &left[out.len()..];
            };
            let combs = [Comb { order: 23.0, count }, Comb { order: 7.3, count: 0 }, Comb { order: 16.7, count: 2 }];
            let gathered = demodulate(&channels, (fill, angle.len()), &combs, blocks);
            let mut expected = straight(&channels, &angle, 23.0, count, blocks);
            expected.extend(straight(&channels, &angle, 16.7, 2, blocks));
            assert_eq!(gathered.len(), expected.len());
            // A block gathers some hundred products of at most 1, each off by the rounding of the
            // phasor's powers, some 1e-15.
            let pairs = gathered.iter().flatten().zip(expected.iter().flatten());
            let worst = pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
            assert!(worst < 1e-12, "{count} {blocks}: {worst:.1e}");
        }
    }
}
