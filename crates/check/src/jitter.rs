//! Pulse times of a tacho without their jitter.
//!
//! Each edge is seen a little early or late, by chance and anew at each pulse. Read as turning that
//! shakes the whole spectrum over angle: every strong line gets noise beside it. A shaft with
//! inertia does not turn so, and how much of what the times show is turning they tell themselves.

/// Logarithms of the ratios that are tried, least, most and apart: of the variance by which the
/// period changes from pulse to pulse to that of the jitter. At the least times are a straight line
/// over a thousand pulses, at the most they stay as they are.
const LEAST: f64 = -28.0;
const MOST: f64 = 8.0;
const APART: f64 = 1.0;
/// Pulses of which the ratio is found.
const TELLING: usize = 20_000;
/// Relative change of a variance from one pulse to the next below which it stays.
const SETTLED: f64 = 1e-12;

/// The pulse times (s, ascending) without jitter: their means given all of them, where the period
/// of the turning walks at random and each time is seen with an error of its own. How far it walks
/// is the likeliest for these times.
///
/// # Formula
/// The filter and smoother of Kalman and of Rauch, Tung & Striebel (AIAA J. 3 (1965) 1445) for a
/// time and its period: a cubic smoothing spline (Wecker & Ansley, J. Am. Stat. Assoc. 78 (1983)
/// 81).
pub(crate) fn without_jitter(pulse_s: &[f64]) -> Vec<f64> {
    let n = pulse_s.len();
    if n < 4 {
        return pulse_s.to_vec();
    }
    // About the mean period, where differences keep their digits.
    let (first, period) = (pulse_s[0], (pulse_s[n - 1] - pulse_s[0]) / (n - 1) as f64);
    let even = |k: usize| first + period * k as f64;
    let off: Vec<f64> = pulse_s.iter().enumerate().map(|(k, t)| t - even(k)).collect();
    let tried = (0..=((MOST - LEAST) / APART) as usize).map(|i| (LEAST + APART * i as f64).exp());
    let telling = &off[..n.min(TELLING)];
    let likeliest = tried.map(|walk| (walk, log_likelihood(telling, walk))).max_by(|a, b| a.1.total_cmp(&b.1));
    let Some((walk, _)) = likeliest else { return pulse_s.to_vec() };
    smoothed(&off, walk).iter().enumerate().map(|(k, t)| even(k) + t).collect()
}

/// Time and period, in units of the jitter where they are variances.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Covariance {
    time: f64,
    both: f64,
    period: f64,
}

impl Covariance {
    /// Before the first pulse, where next to nothing is known.
    const BEFORE: Self = Self { time: 1e8, both: 0.0, period: 1e8 };

    /// One pulse on.
    fn predicted(self, walk: f64) -> Self {
        Self {
            time: self.time + 2.0 * self.both + self.period + walk / 3.0,
            both: self.both + self.period + walk / 2.0,
            period: self.period + walk,
        }
    }

    /// Whether no variance differs by more than rounding does.
    fn is_near(self, other: &Self) -> bool {
        let near = |a: f64, b: f64| (a - b).abs() <= SETTLED * b.abs();
        near(self.time, other.time) && near(self.both, other.both) && near(self.period, other.period)
    }

    /// When a time with the variance 1 was seen.
    fn seen(self) -> Self {
        let s = self.time + 1.0;
        Self { time: self.time / s, both: self.both / s, period: self.period - self.both * self.both / s }
    }
}

/// ln of the likelihood of the times at a ratio and the likeliest jitter for it, up to a constant.
fn log_likelihood(off: &[f64], walk: f64) -> f64 {
    let ([mut time, mut period], mut before) = ([0.0; 2], Covariance::BEFORE);
    let (mut squares, mut logs) = (0.0, 0.0);
    for (k, seen) in off.iter().enumerate() {
        let (s, innovation) = (before.time + 1.0, seen - time);
        // Two times make a period, and tell nothing of it.
        if k >= 2 {
            squares += innovation * innovation / s;
            logs += s.ln();
        }
        period += before.both / s * innovation;
        time += before.time / s * innovation + period;
        before = before.seen().predicted(walk);
    }
    let n = (off.len() - 2) as f64;
    -0.5 * (n * (squares / n).max(f64::MIN_POSITIVE).ln() + logs)
}

/// Means of the times given all of them.
fn smoothed(off: &[f64], walk: f64) -> Vec<f64> {
    // Of time and period when each pulse was seen. Covariances settle; the last one holds from
    // then on.
    let mut states = Vec::with_capacity(off.len());
    let mut covariances: Vec<Covariance> = Vec::new();
    let ([mut time, mut period], mut before) = ([0.0; 2], Covariance::BEFORE);
    for seen in off {
        let (s, innovation) = (before.time + 1.0, seen - time);
        period += before.both / s * innovation;
        time += before.time / s * innovation;
        states.push([time, period]);
        time += period;
        if covariances.last().is_none_or(|last| !before.seen().is_near(last)) {
            covariances.push(before.seen());
            before = before.seen().predicted(walk);
        }
    }
    let mut out: Vec<f64> = states.iter().map(|state| state[0]).collect();
    let mut after = states[states.len() - 1];
    for k in (0..states.len() - 1).rev() {
        let c = covariances[k.min(covariances.len() - 1)];
        let p = c.predicted(walk);
        let [time, period] = states[k];
        let (dt, dp) = (after[0] - time - period, after[1] - period);
        let determinant = p.time * p.period - p.both * p.both;
        let [a, b] = [(p.period * dt - p.both * dp) / determinant, (p.time * dp - p.both * dt) / determinant];
        after = [time + (c.time + c.both) * a + c.both * b, period + (c.both + c.period) * a + c.period * b];
        out[k] = after[0];
    }
    out
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;

    /// Times of pulses 20 ms apart whose period walks steadily by `walk_s` a pulse: as they are,
    /// and seen with a jitter of 5 µs.
    fn pulses(n: usize, walk_s: f64) -> (Vec<f64>, Vec<f64>) {
        let mut random = ChaCha8Rng::seed_from_u64(11);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let (mut time, mut period) = (3.0, 0.02);
        let turned: Vec<f64> = (0..n)
            .map(|_| {
                let (a, b) = (walk_s * normal(), walk_s * normal());
                time += period + 0.5 * a + b / 12.0f64.sqrt();
                period += a;
                time
            })
            .collect();
        let seen = turned.iter().map(|t| t + 5e-6 * normal()).collect();
        (turned, seen)
    }

    fn rms(a: &[f64], b: &[f64]) -> f64 {
        (a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
    }

    /// The smoother against the mean of a normal vector given its sum with another, by matrices:
    /// the second differences of the times have the variances 2/3 and 1/6 of the walk beside each
    /// other, and line and slope are free.
    #[test]
    fn oracle_smoother_by_matrices() {
        let walk = 0.05;
        let (n, off) =
            (40, pulses(40, 2e-6).1.iter().enumerate().map(|(k, t)| t - 0.02 * k as f64).collect::<Vec<_>>());
        let differences =
            DMatrix::from_fn(n - 2, n, |i, j| [1.0, -2.0, 1.0].get(j.wrapping_sub(i)).copied().unwrap_or(0.0));
        let variances = DMatrix::from_fn(n - 2, n - 2, |i, j| match i.abs_diff(j) {
            0 => walk * 2.0 / 3.0,
            1 => walk / 6.0,
            _ => 0.0,
        });
        let roughness = differences.transpose() * variances.try_inverse().unwrap() * &differences;
        let expected = (DMatrix::identity(n, n) + roughness).try_inverse().unwrap() * DVector::from_vec(off.clone());
        let found = smoothed(&off, walk);
        // The variance of 1e8 before the first pulse shrinks its 3 s by 1e-8.
        assert!(rms(&found, expected.as_slice()) < 1e-7, "{}", rms(&found, expected.as_slice()));
    }

    /// Of an even turning 5 µs of jitter leave 5 µs √(2/n) where a straight line is fitted: 0.35 µs
    /// of 400 pulses, and less than thrice that where its straightness is found as well. Of a
    /// period that walks by 3 µs a pulse they leave less than themselves, and where it walks by
    /// 0.3 ms, next to none is taken away.
    #[test]
    fn analytic_what_is_left_of_jitter() {
        let left = |walk_s: f64| {
            let (turned, seen) = pulses(400, walk_s);
            rms(&without_jitter(&seen), &turned)
        };
        assert!(left(0.0) < 1e-6, "{}", left(0.0));
        assert!((1.5e-6..4.5e-6).contains(&left(3e-6)), "{}", left(3e-6));
        assert!((4.5e-6..5.5e-6).contains(&left(3e-4)), "{}", left(3e-4));
    }
}
