//! Sample rate and gaps from time stamps that jitter.

/// Stamps that are looked at beyond the current one before a gap is believed: a late stamp is
/// followed by early ones, a gap is not.
pub(crate) const LOOK_AHEAD: usize = 5;

/// Samples from which a rate is estimated before any is handed over.
pub(crate) const ESTIMATE_FROM: usize = 8192;

/// Time stamps that no rate can be read from; said as what was expected.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(crate) enum StampsError {
    #[error("time stamps that go on, found {found_s} s where {due_s} s was due")]
    Backwards { found_s: f64, due_s: f64 },
    #[error("at least 3 time stamps, found {0}")]
    TooFew(usize),
    #[error("ascending time stamps, found a {what} of {step_s} s")]
    NotAscending { what: &'static str, step_s: f64 },
}

/// A regular grid that follows the stamps.
#[derive(Clone, Debug)]
pub(crate) struct Grid {
    period_s: f64,
    next_s: Option<f64>,
}

impl Grid {
    /// A grid of `period_s` that begins at the first stamp.
    pub(crate) fn new(period_s: f64) -> Self {
        Self { period_s, next_s: None }
    }

    /// Number of samples that are missing before the first of `upcoming` (seconds, at least one);
    /// its stamps beyond the first are a look ahead. A gap is where this stamp and the following
    /// ones are all late by more than half a period. Slow drift of the clock against the period is
    /// followed.
    ///
    /// # Errors
    /// The stamps go back by more than the period of ten samples.
    pub(crate) fn missing_before(&mut self, upcoming: &[f64]) -> Result<u64, StampsError> {
        const FOLLOW: f64 = 0.02;
        let Some(&now) = upcoming.first() else { return Ok(0) };
        let expected = self.next_s.unwrap_or(now);
        let mut late = [0.0; LOOK_AHEAD];
        let n = upcoming.len().min(LOOK_AHEAD);
        for (j, (late, stamp)) in late.iter_mut().zip(upcoming).enumerate() {
            *late = (stamp - expected) / self.period_s - j as f64;
        }
        let first = late[0];
        let late = &mut late[..n];
        if !first.is_finite() || first < -10.0 {
            return Err(StampsError::Backwards { found_s: now, due_s: expected });
        }
        late.sort_unstable_by(f64::total_cmp);
        let missing = if late[0] > 0.5 { late[n / 2].round().max(1.0) } else { 0.0 };
        self.next_s = Some(expected + self.period_s * (missing + 1.0 + FOLLOW * (first - missing)));
        // Above 2^53 periods the stamps are nonsense, and the cast saturates.
        Ok(missing as u64)
    }
}

/// Period of regular samples with jitter and gaps (s): median over lags, then a least-squares line
/// through all stamps on the grid.
///
/// # Errors
/// With fewer than three stamps, or stamps that do not ascend.
pub(crate) fn period_s(stamps: &[f64]) -> Result<f64, StampsError> {
    let n = stamps.len();
    if n < 3 {
        return Err(StampsError::TooFew(n));
    }
    // A lag over many samples averages jitter and coarse printing; few of the lags meet a gap.
    let lag = (n / 4).clamp(1, 64);
    let mut steps: Vec<f64> = stamps.iter().zip(&stamps[lag..]).map(|(a, b)| (b - a) / lag as f64).collect();
    steps.sort_unstable_by(f64::total_cmp);
    let coarse = steps[steps.len() / 2];
    if !(coarse.is_finite() && coarse > 0.0) {
        return Err(StampsError::NotAscending { what: "median step", step_s: coarse });
    }
    let mut grid = Grid::new(coarse);
    let mut index = 0.0;
    let (mut sum_i, mut sum_t) = (0.0, 0.0);
    let mut points = Vec::with_capacity(n);
    for k in 0..n {
        index += grid.missing_before(&stamps[k..n.min(k + LOOK_AHEAD)])? as f64;
        let t = stamps[k] - stamps[0];
        points.push((index, t));
        sum_i += index;
        sum_t += t;
        index += 1.0;
    }
    let (mean_i, mean_t) = (sum_i / n as f64, sum_t / n as f64);
    let (mut cross, mut square) = (0.0, 0.0);
    for (i, t) in points {
        cross += (i - mean_i) * (t - mean_t);
        square += (i - mean_i) * (i - mean_i);
    }
    let fine = cross / square;
    if fine.is_finite() && fine > 0.0 {
        Ok(fine)
    } else {
        Err(StampsError::NotAscending { what: "step", step_s: fine })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A triangle wave as jitter: bounded, without drift.
    fn jitter(k: usize) -> f64 {
        ((k * 7919) % 101) as f64 / 50.0 - 1.0
    }

    /// 40 Hz with a jitter of ±4 ms and two lost samples: the line through n stamps has a slope
    /// error of about sqrt(12) sd / (n^1.5), here 3e-7 s; both the rate and the gap are found.
    #[test]
    fn analytic_rate_and_gap_survive_jitter() {
        let stamps: Vec<f64> =
            (0..1000).map(|k| (k + if k >= 600 { 2 } else { 0 }) as f64 * 0.025 + 0.004 * jitter(k)).collect();
        let period = period_s(&stamps).unwrap();
        assert!((period / 0.025 - 1.0).abs() < 5e-5, "{period}");
        let mut grid = Grid::new(period);
        let gaps: Vec<(usize, u64)> = (0..stamps.len())
            .map(|k| (k, grid.missing_before(&stamps[k..stamps.len().min(k + LOOK_AHEAD)]).unwrap()))
            .filter(|&(_, missing)| missing > 0)
            .collect();
        assert_eq!(gaps, [(600, 2)]);
    }

    /// One stamp that is late by 1.8 periods, with the next ones in time, is no gap.
    #[test]
    fn analytic_a_late_stamp_is_no_gap() {
        let mut stamps: Vec<f64> = (0..50).map(|k| f64::from(k) * 0.01).collect();
        stamps[20] += 0.0099;
        let mut grid = Grid::new(0.01);
        for k in 0..50 {
            assert_eq!(grid.missing_before(&stamps[k..50.min(k + LOOK_AHEAD)]), Ok(0), "{k}");
        }
    }

    /// 16 384 Hz printed to a tenth of a millisecond: steps are 0 or 0.1 ms, the mean is right.
    #[test]
    fn analytic_coarsely_printed_times_give_the_rate() {
        let stamps: Vec<f64> = (0..4096).map(|k| (f64::from(k) / 16_384.0 * 1e4).round() / 1e4).collect();
        let rate = 1.0 / period_s(&stamps).unwrap();
        assert!((rate / 16_384.0 - 1.0).abs() < 1e-4, "{rate}");
    }

    #[test]
    fn analytic_time_that_stands_still_is_refused() {
        assert!(period_s(&[1.0; 100]).is_err());
        assert!(period_s(&[0.0, 1.0]).is_err());
        assert!(period_s(&[f64::NAN; 10]).is_err());
        let mut grid = Grid::new(0.01);
        assert_eq!(grid.missing_before(&[5.0]), Ok(0));
        assert!(grid.missing_before(&[4.0]).is_err());
    }
}
