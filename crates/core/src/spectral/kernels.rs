//! Loops over arrays, each compiled for the vector unit that the processor has (AVX2 where there is one) and for the plain one.
//!
//! Sums run over a fixed number of lanes and nothing is fused, so that the result does not depend on which of the two is taken.

use num_complex::Complex64;

/// Partial sums that are kept side by side.
const LANES: usize = 8;

/// Defines functions whose bodies are compiled for each vector unit and chosen at run time. What a body calls must be `inline(always)`.
macro_rules! kernels {
    ($($(#[$meta:meta])* $vis:vis fn $name:ident<$life:lifetime>($($arg:ident: $kind:ty),* $(,)?) -> $out:ty $body:block)*) => {$(
        $(#[$meta])*
        #[allow(clippy::too_many_arguments)]
        $vis fn $name<$life>($($arg: $kind),*) -> $out {
            struct Kernel<$life> { $($arg: $kind),* }
            impl<$life> pulp::WithSimd for Kernel<$life> {
                type Output = $out;
                #[inline(always)]
                fn with_simd<S: pulp::Simd>(self, _: S) -> $out {
                    let Self { $($arg),* } = self;
                    $body
                }
            }
            pulp::Arch::new().dispatch(Kernel { $($arg),* })
        }
    )*};
}
pub(crate) use kernels;

/// `e^{-j 2π order θ}` over the points of a decimated signal: real and imaginary parts in arrays of their own.
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

/// Coefficient `±π^k / k!` of a sine or cosine series.
const fn coefficient(k: u32) -> f64 {
    let (mut value, mut i) = (1.0, 0);
    while i < k {
        i += 1;
        value *= std::f64::consts::PI / i as f64;
    }
    if k / 2 % 2 == 0 { value } else { -value }
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

/// `(cos, -sin)` of `2π turns`, by the series of half the angle: in |πr| ≤ π/2 the first term left out is below 3e-16.
#[inline(always)]
pub(crate) fn turned_back(turns: f64) -> (f64, f64) {
    let r = turns - ((turns + ROUNDER) - ROUNDER);
    let y = r * r;
    let (mut cos, mut sin) = (COSINE[10], SINE[10]);
    let mut i = 10;
    while i > 0 {
        i -= 1;
        cos = cos * y + COSINE[i];
        sin = sin * y + SINE[i];
    }
    sin *= r;
    (1.0 - 2.0 * sin * sin, -2.0 * sin * cos)
}

/// Sum over fixed lanes.
#[inline(always)]
pub(crate) fn total(lanes: [f64; LANES]) -> f64 {
    ((lanes[0] + lanes[4]) + (lanes[2] + lanes[6])) + ((lanes[1] + lanes[5]) + (lanes[3] + lanes[7]))
}

/// `Σ a b` over fixed lanes.
#[inline(always)]
pub(crate) fn dot<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    const { assert!(N.is_multiple_of(LANES)) };
    let mut lanes = [0.0; LANES];
    for (a, b) in a.as_chunks::<LANES>().0.iter().zip(b.as_chunks::<LANES>().0) {
        for l in 0..LANES {
            lanes[l] += a[l] * b[l];
        }
    }
    total(lanes)
}

/// `Σ a` over fixed lanes.
#[inline(always)]
pub(crate) fn sum_of<const N: usize>(a: &[f64; N]) -> f64 {
    const { assert!(N.is_multiple_of(LANES)) };
    let mut lanes = [0.0; LANES];
    for a in a.as_chunks::<LANES>().0 {
        for l in 0..LANES {
            lanes[l] += a[l];
        }
    }
    total(lanes)
}

kernels! {
    /// `out = x w`.
    pub(crate) fn weigh<'a>(x: &'a [f64], w: &'a [f64], out: &'a mut [f64]) -> () {
        for ((o, x), w) in out.iter_mut().zip(x).zip(w) {
            *o = x * w;
        }
    }

    /// `e^{-j 2π (order θ - centre τ)}` at points that are evenly spaced in `τ` from −1/2.
    pub(crate) fn rotation<'a>(theta: &'a [f64], order: f64, centre: f64, re: &'a mut [f64], im: &'a mut [f64]) -> () {
        let step = centre / theta.len() as f64;
        for (i, ((t, re), im)) in theta.iter().zip(re).zip(im).enumerate() {
            (*re, *im) = turned_back(order * t - (step * i as u32 as f64 - 0.5 * centre));
        }
    }

    /// Element by element, `out = a b`.
    pub(crate) fn multiply<'a>(
        a_re: &'a [f64], a_im: &'a [f64], b_re: &'a [f64], b_im: &'a [f64], re: &'a mut [f64], im: &'a mut [f64]
    ) -> () {
        let b = b_re.iter().zip(b_im);
        for (((re, im), (a_re, a_im)), (b_re, b_im)) in re.iter_mut().zip(im).zip(a_re.iter().zip(a_im)).zip(b) {
            *re = a_re * b_re - a_im * b_im;
            *im = a_re * b_im + a_im * b_re;
        }
    }

    /// Element by element, `a = a b`.
    pub(crate) fn advance<'a>(re: &'a mut [f64], im: &'a mut [f64], b_re: &'a [f64], b_im: &'a [f64]) -> () {
        for ((re, im), (b_re, b_im)) in re.iter_mut().zip(im).zip(b_re.iter().zip(b_im)) {
            (*re, *im) = (*re * b_re - *im * b_im, *re * b_im + *im * b_re);
        }
    }

    /// Takes a carrier out of the points of a band and weighs what is left with two windows; the second also goes back into the points.
    pub(crate) fn take_out<'a>(
        points: &'a mut [Complex64], p_re: &'a [f64], p_im: &'a [f64], weights: [&'a [f64]; 2], efficient: &'a mut Phasors,
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
    pub(crate) fn sums_of_pair<'a>(z_re: &'a [f64], z_im: &'a [f64], c_re: &'a [f64], c_im: &'a [f64]) -> (Complex64, Complex64) {
        let mut lanes = [[0.0; LANES]; 4];
        let (z_re, z_im) = (z_re.as_chunks::<LANES>().0, z_im.as_chunks::<LANES>().0);
        let (c_re, c_im) = (c_re.as_chunks::<LANES>().0, c_im.as_chunks::<LANES>().0);
        for ((a, b), (c, s)) in z_re.iter().zip(z_im).zip(c_re.iter().zip(c_im)) {
            for l in 0..LANES {
                lanes[0][l] += a[l] * c[l];
                lanes[1][l] += b[l] * s[l];
                lanes[2][l] += a[l] * s[l];
                lanes[3][l] += b[l] * c[l];
            }
        }
        let [rr, ii, ri, ir] = lanes.map(|l| total(l));
        (Complex64::new(rr - ii, ri + ir), Complex64::new(rr + ii, ir - ri))
    }

    /// Powers of the bins of a spectrum.
    pub(crate) fn powers<'a>(bins: &'a [Complex64], out: &'a mut [f64]) -> () {
        for (o, y) in out.iter_mut().zip(bins) {
            *o = y.re * y.re + y.im * y.im;
        }
    }

    /// `Σ z`.
    pub(crate) fn sum<'a>(re: &'a [f64], im: &'a [f64]) -> Complex64 {
        let mut lanes = [[0.0; LANES]; 2];
        for (a, b) in re.as_chunks::<LANES>().0.iter().zip(im.as_chunks::<LANES>().0) {
            for l in 0..LANES {
                lanes[0][l] += a[l];
                lanes[1][l] += b[l];
            }
        }
        Complex64::new(total(lanes[0]), total(lanes[1]))
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
