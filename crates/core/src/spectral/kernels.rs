//! Loops over arrays, each compiled for the vector unit that the processor has (AVX2 where there is
//! one) and for the plain one.
//!
//! `mul_add` does not round in between; x86 processors before 2013 have no such instruction, and
//! the loops are right but slow there.

use num_complex::Complex64;
use pulp::Simd;

/// Defines functions whose bodies are compiled for each vector unit and chosen at run time. What a
/// body calls must be `inline(always)`.
macro_rules! kernels {
    ($($(#[$meta:meta])* $vis:vis fn $name:ident<$life:lifetime>($simd:ident; $($arg:ident: $kind:ty),* $(,)?) -> $out:ty $body:block)*) => {$(
        $(#[$meta])*
        #[allow(clippy::too_many_arguments)]
        $vis fn $name<$life>($($arg: $kind),*) -> $out {
            struct Kernel<$life> { $($arg: $kind),* }
            impl<$life> pulp::WithSimd for Kernel<$life> {
                type Output = $out;
                #[inline(always)]
                fn with_simd<S: pulp::Simd>(self, $simd: S) -> $out {
                    let Self { $($arg),* } = self;
                    $body
                }
            }
            pulp::Arch::new().dispatch(Kernel { $($arg),* })
        }
    )*};
}
pub(crate) use kernels;

/// `e^{-j 2π order θ}` over the points of a decimated signal: real and imaginary parts in arrays of
/// their own.
#[derive(Clone, Debug, Default)]
pub(crate) struct Phasors {
    pub(crate) re: Vec<f64>,
    pub(crate) im: Vec<f64>,
}

impl Phasors {
    /// `n` zeros.
    pub(crate) fn zeros(n: usize) -> Self {
        Self { re: vec![0.0; n], im: vec![0.0; n] }
    }
}

/// Decimated signals and rows of matrices have a multiple of this many points: whole vectors of any
/// processor.
pub(crate) const ROW: usize = 8;

/// Coefficient `±π^k / k!` of a sine or cosine series.
const fn coefficient(k: u32) -> f64 {
    let (mut value, mut i) = (1.0, 0);
    while i < k {
        i += 1;
        value *= std::f64::consts::PI / i as f64;
    }
    if (k / 2).is_multiple_of(2) { value } else { -value }
}

const fn series(first: u32) -> [f64; 11] {
    let (mut out, mut i) = ([0.0; 11], 0);
    while i < 11 {
        out[i] = coefficient(first + 2 * i as u32);
        i += 1;
    }
    out
}

const COSINE: [f64; 11] = series(0);
const SINE: [f64; 11] = series(1);

/// Adding this to a number of less than 2^51 and taking it off again rounds to the nearest integer.
const ROUNDER: f64 = 6_755_399_441_055_744.0;

/// `(cos, -sin)` of `2π turns`, by the series of half the angle: in |πr| ≤ π/2 the first term left
/// out is below 3e-16.
#[inline(always)]
pub fn turned_back(turns: f64) -> (f64, f64) {
    let r = turns - ((turns + ROUNDER) - ROUNDER);
    let y = r * r;
    let (mut cos, mut sin) = (COSINE[10], SINE[10]);
    let mut i = 10;
    while i > 0 {
        i -= 1;
        cos = cos.mul_add(y, COSINE[i]);
        sin = sin.mul_add(y, SINE[i]);
    }
    sin *= r;
    (1.0 - 2.0 * sin * sin, -2.0 * sin * cos)
}

/// Running sums of products, a vector each.
pub(crate) struct Sums<S: Simd, const N: usize> {
    simd: S,
    sums: [S::f64s; N],
}

impl<S: Simd, const N: usize> Sums<S, N> {
    #[inline(always)]
    pub(crate) fn new(simd: S) -> Self {
        Self { simd, sums: [simd.splat_f64s(0.0); N] }
    }

    /// Adds `a b` to sum `i`.
    #[inline(always)]
    pub(crate) fn add(&mut self, i: usize, a: S::f64s, b: S::f64s) {
        self.sums[i] = self.simd.mul_add_e_f64s(a, b, self.sums[i]);
    }

    #[inline(always)]
    pub(crate) fn total(self) -> [f64; N] {
        let mut out = [0.0; N];
        for (out, sum) in out.iter_mut().zip(self.sums) {
            *out = self.simd.reduce_sum_f64s(sum);
        }
        out
    }
}

impl<S: Simd> Sums<S, 4> {
    /// The four products of two complex numbers: real by real, imaginary by imaginary, and across.
    #[inline(always)]
    fn add_pair(&mut self, z: [S::f64s; 2], c: [S::f64s; 2]) {
        self.add(0, z[0], c[0]);
        self.add(1, z[1], c[1]);
        self.add(2, z[0], c[1]);
        self.add(3, z[1], c[0]);
    }
}

/// An array as vectors; its length is a multiple of theirs.
#[inline(always)]
pub(crate) fn vectors<S: Simd>(_: S, values: &[f64]) -> &[S::f64s] {
    let (vectors, rest) = S::as_simd_f64s(values);
    debug_assert!(rest.is_empty());
    vectors
}

/// `Σ z c` and `Σ z c*`.
#[inline(always)]
pub(crate) fn pair_of<S: Simd>(simd: S, z: [&[f64]; 2], c: [&[f64]; 2]) -> (Complex64, Complex64) {
    let (z_re, z_im) = (vectors(simd, z[0]), vectors(simd, z[1]));
    let (c_re, c_im) = (vectors(simd, c[0]), vectors(simd, c[1]));
    let n = z_re.len();
    let (z_im, c_re, c_im) = (&z_im[..n], &c_re[..n], &c_im[..n]);
    // Two sets, so that one addition need not wait for the other. No closures: they would be
    // compiled without the vector unit.
    let (mut even, mut odd) = (Sums::<S, 4>::new(simd), Sums::<S, 4>::new(simd));
    let mut i = 0;
    while i + 1 < n {
        even.add_pair([z_re[i], z_im[i]], [c_re[i], c_im[i]]);
        odd.add_pair([z_re[i + 1], z_im[i + 1]], [c_re[i + 1], c_im[i + 1]]);
        i += 2;
    }
    if i < n {
        even.add_pair([z_re[i], z_im[i]], [c_re[i], c_im[i]]);
    }
    let (even, odd) = (even.total(), odd.total());
    let [rr, ii, ri, ir] = [even[0] + odd[0], even[1] + odd[1], even[2] + odd[2], even[3] + odd[3]];
    (Complex64::new(rr - ii, ri + ir), Complex64::new(rr + ii, ir - ri))
}

kernels! {
    /// `out = x w`.
    pub(crate) fn weigh<'a>(_simd; x: &'a [f64], w: &'a [f64], out: &'a mut [f64]) -> () {
        for ((o, x), w) in out.iter_mut().zip(x).zip(w) {
            *o = x * w;
        }
    }

    /// `e^{-j 2π (order θ - centre τ)}` at points that are evenly spaced in `τ` from −1/2.
    pub(crate) fn rotation<'a>(_simd; theta: &'a [f64], order: f64, centre: f64, re: &'a mut [f64], im: &'a mut [f64]) -> () {
        let n = theta.len();
        let (re, im) = (&mut re[..n], &mut im[..n]);
        let (step, half) = (centre / n as f64, 0.5 * centre);
        for i in 0..n {
            (re[i], im[i]) = turned_back(order.mul_add(theta[i], half) - step * i as u32 as f64);
        }
    }

    /// Element by element, `out = a b`.
    pub(crate) fn multiply<'a>(_simd; a: &'a Phasors, b: &'a Phasors, re: &'a mut [f64], im: &'a mut [f64]) -> () {
        let n = re.len();
        let (im, a_re, a_im, b_re, b_im) = (&mut im[..n], &a.re[..n], &a.im[..n], &b.re[..n], &b.im[..n]);
        for i in 0..n {
            re[i] = a_re[i] * b_re[i] - a_im[i] * b_im[i];
            im[i] = a_re[i] * b_im[i] + a_im[i] * b_re[i];
        }
    }

    /// Element by element, `a = a b`.
    pub(crate) fn advance<'a>(_simd; re: &'a mut [f64], im: &'a mut [f64], b: &'a Phasors) -> () {
        let n = re.len();
        let (im, b_re, b_im) = (&mut im[..n], &b.re[..n], &b.im[..n]);
        for i in 0..n {
            (re[i], im[i]) = (re[i] * b_re[i] - im[i] * b_im[i], re[i] * b_im[i] + im[i] * b_re[i]);
        }
    }

    /// Takes a carrier out of the points of a band and weighs what is left with two windows; the
    /// second also goes back into the points.
    pub(crate) fn take_out<'a>(
        _simd; points: &'a mut [Complex64], p_re: &'a [f64], p_im: &'a [f64], weights: [&'a [f64]; 2], efficient: &'a mut Phasors,
        guard: &'a mut Phasors,
    ) -> () {
        let n = points.len();
        let (p_re, p_im, u, v) = (&p_re[..n], &p_im[..n], &weights[0][..n], &weights[1][..n]);
        let (e_re, e_im) = (&mut efficient.re[..n], &mut efficient.im[..n]);
        let (g_re, g_im) = (&mut guard.re[..n], &mut guard.im[..n]);
        for i in 0..n {
            let z = points[i];
            let (re, im) = (z.re * p_re[i] - z.im * p_im[i], z.re * p_im[i] + z.im * p_re[i]);
            (e_re[i], e_im[i]) = (re * u[i], im * u[i]);
            (g_re[i], g_im[i]) = (re * v[i], im * v[i]);
            points[i] = Complex64::new(g_re[i], g_im[i]);
        }
    }

    /// `Σ z c` and `Σ z c*`, sharing the products.
    pub(crate) fn sums_of_pair<'a>(
        simd; z_re: &'a [f64], z_im: &'a [f64], c_re: &'a [f64], c_im: &'a [f64]
    ) -> (Complex64, Complex64) {
        pair_of(simd, [z_re, z_im], [c_re, c_im])
    }

    /// Powers of the bins of a spectrum.
    pub(crate) fn powers<'a>(_simd; bins: &'a [Complex64], out: &'a mut [f64]) -> () {
        for (o, y) in out.iter_mut().zip(bins) {
            *o = y.re * y.re + y.im * y.im;
        }
    }

    /// A real matrix, row by row, times complex sums. The rows are as long as the sums, a multiple
    /// of [`ROW`].
    pub(crate) fn combine<'a>(simd; rows: &'a [f64], sums: &'a Phasors, re: &'a mut [f64], im: &'a mut [f64]) -> () {
        let rows = rows.chunks_exact(sums.re.len());
        let (s_re, s_im) = (vectors(simd, &sums.re), vectors(simd, &sums.im));
        for ((row, re), im) in rows.zip(re).zip(im) {
            let mut sums = Sums::<S, 2>::new(simd);
            for ((r, a), b) in vectors(simd, row).iter().zip(s_re).zip(s_im) {
                sums.add(0, *r, *a);
                sums.add(1, *r, *b);
            }
            [*re, *im] = sums.total();
        }
    }

    /// `Σ z`.
    pub(crate) fn sum<'a>(simd; re: &'a [f64], im: &'a [f64]) -> Complex64 {
        let one = simd.splat_f64s(1.0);
        let mut sums = Sums::<S, 2>::new(simd);
        for (a, b) in vectors(simd, re).iter().zip(vectors(simd, im)) {
            sums.add(0, *a, one);
            sums.add(1, *b, one);
        }
        let [re, im] = sums.total();
        Complex64::new(re, im)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the library's sine and cosine, over many turns.
    #[test]
    fn oracle_turned_back() {
        for i in -20_000..20_000 {
            let turns = f64::from(i) * 0.013_7;
            let (sin, cos) = (std::f64::consts::TAU * (turns - turns.round())).sin_cos();
            let (re, im) = turned_back(turns);
            assert!((re - cos).abs() < 2e-15 && (im + sin).abs() < 2e-15, "{turns}: {re} {cos}, {im} {sin}");
        }
    }

    /// The pair of sums is what the products give one by one.
    #[test]
    fn oracle_sums_of_pair() {
        let theta: Vec<f64> = (0..64).map(|i| 0.37 * f64::from(i)).collect();
        let (mut z, mut c) = (Phasors::zeros(64), Phasors::zeros(64));
        rotation(&theta, 1.3, 5.0, &mut z.re, &mut z.im);
        rotation(&theta, 0.7, 0.0, &mut c.re, &mut c.im);
        let (plain, mirrored) = sums_of_pair(&z.re, &z.im, &c.re, &c.im);
        let at = |p: &Phasors, i: usize| Complex64::new(p.re[i], p.im[i]);
        let direct: Complex64 = (0..64).map(|i| at(&z, i) * at(&c, i)).sum();
        let conjugate: Complex64 = (0..64).map(|i| at(&z, i) * at(&c, i).conj()).sum();
        assert!((plain - direct).norm() < 1e-12 && (mirrored - conjugate).norm() < 1e-12);
    }
}
