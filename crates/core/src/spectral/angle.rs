//! Input-shaft angle over a window.

/// Input-shaft angle in revolutions over window time `τ = (t - T/2) / T`, zero in the middle.
#[derive(Clone, Debug, PartialEq)]
pub struct AngleTrack {
    /// Coefficients of `τ, τ², τ³ …`.
    polynomial: Vec<f64>,
    /// Knots of a natural cubic spline, used where there are any: `τ`, angle, second derivative.
    knots: Vec<[f64; 3]>,
    offset: f64,
}

impl Default for AngleTrack {
    /// No turning at all, with room for the longest spline.
    fn default() -> Self {
        Self { polynomial: Vec::with_capacity(16), knots: Vec::with_capacity(MAX_KNOTS), offset: 0.0 }
    }
}

impl AngleTrack {
    /// Becomes a polynomial without constant term.
    pub fn set_polynomial(&mut self, coefficients: &[f64]) {
        self.knots.clear();
        self.polynomial.clear();
        self.polynomial.extend_from_slice(coefficients);
        self.offset = 0.0;
    }

    /// Becomes the natural cubic spline through `(τ, angle)` with ascending `τ`, at least three of
    /// them.
    pub fn set_spline(&mut self, points: impl Iterator<Item = (f64, f64)>) {
        self.polynomial.clear();
        self.knots.clear();
        self.knots.extend(points.map(|(tau, angle)| [tau, angle, 0.0]));
        natural_spline(&mut self.knots);
        self.offset = 0.0;
        self.offset = self.at(0.0);
    }

    /// Angle at `τ` (rev).
    pub fn at(&self, tau: f64) -> f64 {
        if self.knots.is_empty() {
            return self.polynomial.iter().rev().fold(0.0, |sum, c| (sum + c) * tau);
        }
        let after = self.knots.partition_point(|k| k[0] < tau).clamp(1, self.knots.len() - 1);
        let ([t0, y0, m0], [t1, y1, m1]) = (self.knots[after - 1], self.knots[after]);
        let h = t1 - t0;
        let (a, b) = ((t1 - tau) / h, (tau - t0) / h);
        let value = a * y0 + b * y1;
        // Beyond the ends a natural spline goes on straight.
        let bend = if (0.0..=1.0).contains(&a) {
            (a * (a * a - 1.0) * m0 + b * (b * b - 1.0) * m1) * h * h / 6.0
        } else if b < 0.0 {
            -(2.0 * m0 + m1) * b * h * h / 6.0
        } else {
            (m0 + 2.0 * m1) * (b - 1.0) * h * h / 6.0
        };
        value + bend - self.offset
    }

    /// Angle at points that are evenly spaced from −1/2, counted from `origin`.
    pub fn fill(&self, out: &mut [f64], origin: f64) {
        let step = 1.0 / out.len() as f64;
        if let ([], &[c1, c2, c3]) = (&self.knots[..], &self.polynomial[..]) {
            // What mesh lines give, without a loop over terms.
            for (i, angle) in out.iter_mut().enumerate() {
                let tau = i as u32 as f64 * step - 0.5;
                *angle = ((c3 * tau + c2) * tau + c1) * tau - origin;
            }
        } else {
            for (i, angle) in out.iter_mut().enumerate() {
                *angle = self.at(i as f64 * step - 0.5) - origin;
            }
        }
    }

    /// Revolutions from end to end.
    pub fn revolutions(&self) -> f64 {
        self.at(0.5) - self.at(-0.5)
    }

    /// Speed in revolutions per window, around `τ`.
    pub fn speed(&self, tau: f64) -> f64 {
        const STEP: f64 = 1.0 / 256.0;
        let (a, b) = ((tau - STEP).max(-0.5), (tau + STEP).min(0.5));
        (self.at(b) - self.at(a)) / (b - a)
    }

    /// Speed at the end minus speed at the start, by the mean speed.
    pub fn ramp(&self) -> f64 {
        (self.speed(0.5) - self.speed(-0.5)) / self.revolutions()
    }

    /// Largest difference between the speed at any time and the mean, revolutions per window.
    pub fn excursion(&self) -> f64 {
        let mean = self.revolutions();
        (0..=16).map(|i| (self.speed(f64::from(i) / 16.0 - 0.5) - mean).abs()).fold(0.0, f64::max)
    }
}

/// Second derivatives of the natural cubic spline (tridiagonal system, Press et al., Numerical
/// Recipes, section 3.3).
fn natural_spline(knots: &mut [[f64; 3]]) {
    let n = knots.len();
    if n < 3 {
        return;
    }
    // The forward sweep keeps its factors in a second pass over the same memory: column 2 holds the
    // right-hand side.
    let mut factor = [0.0; MAX_KNOTS];
    for i in 1..n - 1 {
        let [t0, y0, m0] = knots[i - 1];
        let [t1, y1, _] = knots[i];
        let [t2, y2, _] = knots[i + 1];
        let share = (t1 - t0) / (t2 - t0);
        let pivot = share * factor[i - 1] + 2.0;
        factor[i] = (share - 1.0) / pivot;
        let slope = (y2 - y1) / (t2 - t1) - (y1 - y0) / (t1 - t0);
        knots[i][2] = (6.0 * slope / (t2 - t0) - share * m0) / pivot;
    }
    knots[n - 1][2] = 0.0;
    for i in (1..n - 1).rev() {
        knots[i][2] += factor[i] * knots[i + 1][2];
    }
}

/// Most knots of a spline.
pub const MAX_KNOTS: usize = 512;

#[cfg(test)]
mod tests {
    use super::*;

    /// A straight line is its own spline, beyond the ends too.
    #[test]
    fn analytic_spline_of_a_line() {
        let mut track = AngleTrack::default();
        track.set_spline((0..9).map(|i| (-0.4 + 0.1 * f64::from(i), 3.0 + 30.0 * (-0.4 + 0.1 * f64::from(i)))));
        for tau in [-0.5, -0.43, 0.0, 0.17, 0.5] {
            assert!((track.at(tau) - 30.0 * tau).abs() < 1e-12, "{tau}");
        }
    }

    /// A sine through 30 knots per window: the spline's error is of fourth order, 5/384 h⁴
    /// max|f''''| inside.
    #[test]
    fn analytic_spline_error_of_a_sine() {
        let f = |t: f64| 30.0 * t + 0.01 * (2.0 * std::f64::consts::PI * 2.0 * t).sin();
        let mut track = AngleTrack::default();
        track.set_spline((-2..=32).map(|i| f64::from(i) / 30.0 - 0.5).map(|t| (t, f(t))));
        let bound = 5.0 / 384.0 * (1.0f64 / 30.0).powi(4) * 0.01 * (4.0 * std::f64::consts::PI).powi(4);
        for i in 0..=100 {
            let tau = f64::from(i) / 100.0 - 0.5;
            assert!((track.at(tau) - f(tau)).abs() < 2.0 * bound, "{tau}");
        }
    }
}
