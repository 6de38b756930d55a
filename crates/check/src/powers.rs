//! Powers of long spectra in the memory of the signal itself, in single precision where that is
//! enough.

use std::sync::Arc;

use gearwatch_core::spectral::kernels::turned_back;
use num_complex::Complex;
use pulp::{Arch, Simd, WithSimd};
use rustfft::{Fft, FftNum};

use crate::dsp::Transforms;
use crate::parted::Table;

/// What samples are kept in, and the powers of long spectra are worked out in: in single precision
/// noise of the transform lies some 180 dB below the signal in each bin of half a minute.
pub trait Precision: FftNum + Into<f64> {
    /// Rounded.
    fn of(x: f64) -> Self;
    /// The number's bits, in the order of numbers that are not negative.
    type Bits: Ord + Copy;
    /// Those of this one.
    fn bits(self) -> Self::Bits;
    /// Square of the number that has these bits.
    fn power_of(bits: Self::Bits) -> f64;
    /// Plan of its forward transform of this length.
    fn forward(transforms: &mut Transforms, len: usize) -> Arc<dyn Fft<Self>>;
}

impl Precision for f64 {
    type Bits = u64;

    fn of(x: f64) -> Self {
        x
    }

    fn bits(self) -> u64 {
        self.to_bits()
    }

    fn power_of(bits: u64) -> f64 {
        squared(f64::from_bits(bits))
    }

    fn forward(transforms: &mut Transforms, len: usize) -> Arc<dyn Fft<Self>> {
        transforms.complex.forward(len)
    }
}

impl Precision for f32 {
    type Bits = u32;

    fn of(x: f64) -> Self {
        x as f32
    }

    fn bits(self) -> u32 {
        self.to_bits()
    }

    fn power_of(bits: u32) -> f64 {
        squared(f32::from_bits(bits))
    }

    fn forward(transforms: &mut Transforms, len: usize) -> Arc<dyn Fft<Self>> {
        transforms.single.forward(len)
    }
}

impl Transforms {
    /// Powers of the bins of a real signal's spectrum, not scaled, in the memory of the signal
    /// itself: a transform that keeps its input and tables of factors takes five times as much.
    pub fn powers<T: Precision>(&mut self, signal: Paired<T>) -> Powers<T> {
        let len = signal.len;
        match columns(len / 2).filter(|_| len.is_multiple_of(2)) {
            Some(columns) => self.powers_in_place(signal.pairs, columns),
            None => {
                let values = signal.pairs.iter().flat_map(|pair| [pair.re.into(), pair.im.into()]);
                let mut signal: Vec<f64> = values.take(len).collect();
                let bins = self.forward_real(&mut signal);
                Powers { amplitudes: bins.iter().map(|b| T::of(b.norm())).collect() }
            }
        }
    }

    /// Bailey's four steps: even and odd samples as one complex signal, in a table of so many
    /// columns; transforms of the columns, turning, transforms of the rows. Bin `k` then lies in
    /// row `k mod rows` and column `k / rows`.
    fn powers_in_place<T: Precision>(&mut self, mut bins: Vec<Complex<T>>, columns: usize) -> Powers<T> {
        let half = bins.len();
        let rows = half / columns;
        let (of_column, of_row) = (T::forward(self, rows), T::forward(self, columns));
        let wanted = of_column.get_inplace_scratch_len().max(of_row.get_inplace_scratch_len());
        let mut scratch = vec![Complex::new(T::zero(), T::zero()); wanted];
        // Some columns at a time, so that a line of the cache is read once.
        let mut some = vec![Complex::new(T::zero(), T::zero()); rows * BESIDE_COLUMNS];
        let mut turns = Turns::new(rows);
        for first in (0..columns).step_by(BESIDE_COLUMNS) {
            let count = BESIDE_COLUMNS.min(columns - first);
            for row in 0..rows {
                for c in 0..count {
                    some[c * rows + row] = bins[row * columns + first + c];
                }
            }
            for (c, column) in some.chunks_exact_mut(rows).take(count).enumerate() {
                of_column.process_with_scratch(column, &mut scratch);
                turns.fill(0, (first + c) as f64 / half as f64);
                for (value, (re, im)) in column.iter_mut().zip(turns.re.iter().zip(&turns.im)) {
                    *value = *value * Complex::new(T::of(*re), T::of(*im));
                }
            }
            for row in 0..rows {
                for c in 0..count {
                    bins[row * columns + first + c] = some[c * rows + row];
                }
            }
        }
        for row in bins.chunks_exact_mut(columns) {
            of_row.process_with_scratch(row, &mut scratch);
        }
        Powers { amplitudes: Table { bins, columns, rows }.parted() }
    }
}

/// A real signal, its even samples as real and the odd ones as imaginary parts.
pub struct Paired<T> {
    pairs: Vec<Complex<T>>,
    len: usize,
}

impl<T: Precision> Paired<T> {
    /// Nothing yet, with room for so many samples.
    pub fn with_capacity(len: usize) -> Self {
        Self { pairs: Vec::with_capacity(len.div_ceil(2)), len: 0 }
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.len
    }

    /// There is no sample.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// One more sample.
    pub fn push(&mut self, x: f64) {
        match self.pairs.last_mut().filter(|_| !self.len.is_multiple_of(2)) {
            Some(last) => last.im = T::of(x),
            None => self.pairs.push(Complex::new(T::of(x), T::zero())),
        }
        self.len += 1;
    }

    /// More samples, each times its weight, behind an even number of them.
    pub(crate) fn weigh(&mut self, samples: &[T], weights: &[f64]) {
        debug_assert!(self.len.is_multiple_of(2));
        let ((twos, rest), (weights_of_twos, _)) = (samples.as_chunks::<2>(), weights.as_chunks::<2>());
        let times = |x: T, weight: f64| T::of(x.into() * weight);
        let pairs = twos.iter().zip(weights_of_twos).map(|([a, b], [u, v])| Complex::new(times(*a, *u), times(*b, *v)));
        self.pairs.extend(pairs);
        self.len += 2 * twos.len();
        for (x, weight) in rest.iter().zip(&weights[2 * twos.len()..]) {
            self.push((*x).into() * weight);
        }
    }
}

impl<T: Precision> Extend<f64> for Paired<T> {
    fn extend<I: IntoIterator<Item = f64>>(&mut self, samples: I) {
        let mut samples = samples.into_iter();
        if !self.len.is_multiple_of(2)
            && let Some(x) = samples.next()
        {
            self.push(x);
        }
        while let Some(x) = samples.next() {
            let next = samples.next();
            self.pairs.push(Complex::new(T::of(x), next.map_or(T::zero(), T::of)));
            self.len += 1 + usize::from(next.is_some());
        }
    }
}

/// Columns of a table that are transformed together.
const BESIDE_COLUMNS: usize = 8;
/// Shorter spectra take little memory anyhow; the rows and columns of longer ones are at most so
/// long.
const LEAST_TABLE: usize = 1 << 14;
const LONGEST_SIDE: usize = 1 << 13;

/// Columns of a table of so many values that is nearly square; `None` where there is no need of it,
/// or it cannot be had.
fn columns(values: usize) -> Option<usize> {
    let root = values.isqrt();
    let columns = (1..=root).rev().find(|c| values.is_multiple_of(*c))?;
    (values >= LEAST_TABLE && values / columns <= LONGEST_SIDE).then_some(columns)
}

/// `exp(-2πi k / of)` for `k` that follow each other: real and imaginary parts.
pub(crate) struct Turns {
    pub(crate) re: Vec<f64>,
    pub(crate) im: Vec<f64>,
}

impl Turns {
    pub(crate) fn new(count: usize) -> Self {
        Self { re: vec![0.0; count], im: vec![0.0; count] }
    }

    /// From `k` = `first` on, given one part of a turn for each.
    pub(crate) fn fill(&mut self, first: usize, each: f64) {
        Arch::new().dispatch(Fill { to: self, first: first as f64, each });
    }
}

struct Fill<'a> {
    to: &'a mut Turns,
    first: f64,
    each: f64,
}

impl WithSimd for Fill<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { to: Turns { re, im }, first, each } = self;
        let n = re.len();
        let im = &mut im[..n];
        for i in 0..n {
            (re[i], im[i]) = turned_back((first + i as u32 as f64) * each);
        }
    }
}

/// Powers of the bins of a spectrum.
pub struct Powers<T> {
    /// The bins' amplitudes, one after the other.
    amplitudes: Vec<T>,
}

impl<T: Precision> Powers<T> {
    /// Number of bins.
    pub fn len(&self) -> usize {
        self.amplitudes.len()
    }

    /// There is no bin.
    pub fn is_empty(&self) -> bool {
        self.amplitudes.is_empty()
    }

    /// The amplitudes, whose squares are the powers.
    pub fn amplitudes(&self) -> &[T] {
        &self.amplitudes
    }

    /// Power of a bin.
    pub fn at(&self, k: usize) -> f64 {
        squared(self.amplitudes[k])
    }

    /// Powers of the bins from one on, up to the last.
    pub fn from(&self, first: usize) -> impl Iterator<Item = f64> + '_ {
        self.amplitudes[first..].iter().map(|amplitude| squared(*amplitude))
    }
}

fn squared<T: Precision>(amplitude: T) -> f64 {
    let amplitude: f64 = amplitude.into();
    amplitude * amplitude
}

#[cfg(test)]
mod tests {
    use num_complex::Complex64;

    use super::*;
    use crate::dsp::tests::noise;

    /// The powers that are worked out in the memory of the signal are those of the plain transform:
    /// lengths that make a table, square or not, short ones, odd ones, and one whose half is prime.
    #[test]
    fn oracle_powers_in_place_are_those_of_the_transform() {
        let mut white = noise();
        for (len, is_table) in
            [(1 << 15, true), (491_520, true), (2 * 17_017, true), (4096, false), (40_001, false), (2 * 20_011, false)]
        {
            assert_eq!(columns(len / 2).is_some() && len % 2 == 0, is_table, "{len}");
            let mut signal: Vec<f64> = (0..len).map(|n| white() + 30.0 * (0.37 * n as f64).cos()).collect();
            let mut transforms = Transforms::default();
            let mut paired = Paired::<f64>::with_capacity(signal.len());
            paired.extend(signal.iter().copied());
            let powers = transforms.powers(paired);
            let mut paired = Paired::<f32>::with_capacity(signal.len());
            paired.extend(signal.iter().copied());
            let single = transforms.powers(paired);
            let bins = transforms.forward_real(&mut signal);
            assert_eq!(powers.len(), bins.len());
            let highest = bins.iter().map(Complex64::norm_sqr).fold(0.0, f64::max);
            for first in [0, 1, powers.len() / 3, powers.len() - 1] {
                let run: Vec<f64> = powers.from(first).collect();
                assert_eq!(run, (first..powers.len()).map(|k| powers.at(k)).collect::<Vec<_>>(), "{len} from {first}");
            }
            for (k, bin) in bins.iter().enumerate() {
                // Rounding of the two transforms: some units in the last place of the highest
                // amplitude.
                let off = (powers.at(k).sqrt() - bin.norm()).abs();
                assert!(off < 1e-13 * highest.sqrt(), "{len}: bin {k} off by {off:.2e}");
                let off = (single.at(k).sqrt() - bin.norm()).abs();
                assert!(off < 1e-6 * highest.sqrt(), "{len}: bin {k} off by {off:.2e} in single precision");
            }
        }
    }
}
