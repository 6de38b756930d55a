//! From the spectrum of a real signal's even samples as real and odd ones as imaginary parts to the
//! amplitudes of the spectrum of all: two bins, `k` and `half − k`, give two.

use num_complex::Complex;
use pulp::{Arch, Simd, WithSimd};

use crate::powers::{Precision, Turns};

/// A spectrum in a table: bin `k` lies in row `k mod rows` and column `k / rows`.
pub(crate) struct Table<T> {
    pub(crate) bins: Vec<Complex<T>>,
    pub(crate) columns: usize,
    pub(crate) rows: usize,
}

impl<T: Precision> Table<T> {
    /// From the spectrum of even samples as real and odd samples as imaginary parts to the
    /// amplitudes of the spectrum of all.
    pub(crate) fn parted(&self) -> Vec<T> {
        let half = self.bins.len();
        let mut amplitudes = vec![T::zero(); half + 1];
        let (re, im): (f64, f64) = (self.bins[0].re.into(), self.bins[0].im.into());
        amplitudes[0] = T::of((re + im).abs());
        amplitudes[half] = T::of((re - im).abs());
        let (mut up, mut down) = (Place { row: 0, column: 0 }, Place { row: 0, column: self.columns });
        up.next(self);
        let mut some = Parting::new();
        for first in (1..=half / 2).step_by(PARTED) {
            let count = PARTED.min(half / 2 + 1 - first);
            for i in 0..count {
                let (low, high) = (self.bins[up.next(self)], self.bins[down.previous(self)]);
                (some.low[0][i], some.low[1][i]) = (low.re.into(), low.im.into());
                (some.high[0][i], some.high[1][i]) = (high.re.into(), high.im.into());
            }
            some.turns.fill(first, 0.5 / half as f64);
            Arch::new().dispatch(Part(&mut some));
            // Squares of single precision do not overflow in double, nor do those of any signal.
            for (i, (low, high)) in some.low[0].iter().zip(&some.high[0]).enumerate().take(count) {
                amplitudes[first + i] = T::of(*low);
                amplitudes[half - first - i] = T::of(*high);
            }
        }
        amplitudes
    }
}

/// Bins that are parted at a time.
const PARTED: usize = 512;

/// Bins `k` and `half − k` of the spectrum of pairs, real and imaginary parts; then their
/// amplitudes in the spectrum of all, where the real parts were.
struct Parting {
    low: [Vec<f64>; 2],
    high: [Vec<f64>; 2],
    turns: Turns,
}

impl Parting {
    fn new() -> Self {
        let zeros = || vec![0.0; PARTED];
        Self { low: [zeros(), zeros()], high: [zeros(), zeros()], turns: Turns::new(PARTED) }
    }
}

struct Part<'a>(&'a mut Parting);

impl WithSimd for Part<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Parting { low: [low_re, low_im], high: [high_re, high_im], turns } = self.0;
        part([low_re, high_re], [low_im, high_im], [&turns.re, &turns.im]);
    }
}

/// The arguments are slices so that the compiler knows them for apart.
#[inline(always)]
fn part([low_re, high_re]: [&mut [f64]; 2], [low_im, high_im]: [&[f64]; 2], [turn_re, turn_im]: [&[f64]; 2]) {
    let n = low_re.len();
    let (high_re, low_im, high_im) = (&mut high_re[..n], &low_im[..n], &high_im[..n]);
    let (turn_re, turn_im) = (&turn_re[..n], &turn_im[..n]);
    for i in 0..n {
        // Of the bin at half − k the conjugate is wanted.
        let (sum_re, sum_im) = (0.5 * (low_re[i] + high_re[i]), 0.5 * (low_im[i] - high_im[i]));
        let (odd_re, odd_im) = (0.5 * (low_im[i] + high_im[i]), -0.5 * (low_re[i] - high_re[i]));
        let re = odd_re * turn_re[i] - odd_im * turn_im[i];
        let im = odd_re * turn_im[i] + odd_im * turn_re[i];
        // The bin at half − k is the conjugate of the difference.
        let (plus_re, plus_im, minus_re, minus_im) = (sum_re + re, sum_im + im, sum_re - re, sum_im - im);
        low_re[i] = (plus_re * plus_re + plus_im * plus_im).sqrt();
        high_re[i] = (minus_re * minus_re + minus_im * minus_im).sqrt();
    }
}

/// A bin's place in the table.
struct Place {
    row: usize,
    column: usize,
}

impl Place {
    /// Index of this one; steps on to the next bin.
    fn next<T>(&mut self, of: &Table<T>) -> usize {
        let index = self.row * of.columns + self.column;
        self.row += 1;
        if self.row == of.rows {
            (self.row, self.column) = (0, self.column + 1);
        }
        index
    }

    /// Steps back to the bin before; its index.
    fn previous<T>(&mut self, of: &Table<T>) -> usize {
        if self.row == 0 {
            (self.row, self.column) = (of.rows, self.column - 1);
        }
        self.row -= 1;
        self.row * of.columns + self.column
    }
}
