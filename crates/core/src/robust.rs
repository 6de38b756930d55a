//! Location and scatter of a few numbers among which some may be wild, and how many of them are
//! independent.

/// Distance from the median, in robust standard deviations, at which a value is left out.
///
/// Of normal values 1 in 1.7 million lies further out. In a series of a dozen the median absolute
/// deviation itself errs by a quarter, so that 1 value in 500 is left out and the mean loses some 2
/// % of its efficiency.
pub const REJECTION_SIGMAS: f64 = 5.0;

/// Standard deviation of normal values / their median absolute deviation: 1 / Φ⁻¹(3/4).
const SIGMA_PER_MAD: f64 = 1.482_602_218_505_602;

/// Mean and standard deviation of the values that belong together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Location {
    /// Mean of the values kept.
    pub mean: f64,
    /// Standard deviation of the values kept, with n − 1; `NaN` for fewer than two.
    pub scatter: f64,
    /// Lower end of what is kept.
    pub low: f64,
    /// Upper end of what is kept.
    pub high: f64,
    /// How many were kept.
    pub kept: usize,
}

/// Mean of the values that lie within [`REJECTION_SIGMAS`] robust standard deviations of the
/// median.
///
/// Breakdown point 50 %: as long as more than half of the values are sound, wild ones of any size
/// cannot carry the mean out of the sound ones' neighbourhood (median and median absolute deviation
/// break down at 50 %, and everything kept lies near them). Fewer than three values are all kept:
/// nothing tells which is wild. `scratch` is overwritten.
///
/// # Source
/// F. R. Hampel, "The breakdown points of the mean combined with some rejection rules",
/// Technometrics 27 (1985): the rule X84, with 5.2 times the MAD; here 5 × 1.4826 = 7.4 times,
/// which leaves out fewer sound values of short series.
pub fn location(values: &[f64], scratch: &mut Vec<f64>) -> Option<Location> {
    if values.is_empty() || values.iter().any(|v| !v.is_finite()) {
        return None;
    }
    let (low, high) = if values.len() < 3 {
        (f64::NEG_INFINITY, f64::INFINITY)
    } else {
        scratch.clear();
        scratch.extend_from_slice(values);
        let centre = median(scratch);
        scratch.iter_mut().for_each(|v| *v = (*v - centre).abs());
        let reach = REJECTION_SIGMAS * SIGMA_PER_MAD * median(scratch);
        (centre - reach, centre + reach)
    };
    let kept = || values.iter().copied().filter(|v| (low..=high).contains(v));
    let count = kept().count();
    let mean = kept().sum::<f64>() / count as f64;
    let scatter = (kept().map(|v| (v - mean).powi(2)).sum::<f64>() / (count as f64 - 1.0)).sqrt();
    Some(Location { mean, scatter: if count < 2 { f64::NAN } else { scatter }, low, high, kept: count })
}

/// Median; reorders the values. They are finite and at least one.
fn median(values: &mut [f64]) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let middle = values.len() / 2;
    if values.len() % 2 == 1 { values[middle] } else { f64::midpoint(values[middle - 1], values[middle]) }
}

/// Correlation of what two windows measure in white noise when one starts `lag` window lengths
/// after the other (0 to 1; nothing from 1 on): the share of the samples that they have in common.
///
/// That is exact for windows without weighting, which the estimator's efficient one nearly is;
/// windows that taper off share less (Hann at half a window: 1/6).
pub fn overlap_correlation(lag: f64) -> f64 {
    if (0.0..1.0).contains(&lag) { 1.0 - lag } else { 0.0 }
}

/// Lags beyond this many hops are not searched for correlation.
const MOST_LAGS: usize = 500;

/// How many independent values a series of windows is worth, for the variance of its mean:
/// `s²/n_eff`.
///
/// `starts` are the windows' first samples, ascending, `length` the samples in a window, `values`
/// what was measured. Two things correlate neighbours: shared samples (known:
/// [`overlap_correlation`]) and slow changes of the machine (estimated from the series itself,
/// summed until the autocorrelation first drops to zero). At each lag the larger counts.
///
/// # Formula
/// `n_eff = n / (1 + 2 Σ (1 − k/n) ρ_k)`, initial positive sequence (C. J. Geyer, Statistical
/// Science 7, 1992). Autocovariances about the mean of the series itself are too small by the
/// variance of that mean; this is put right in a second pass. Of a drift that is slower than the
/// series nothing can be known from it.
pub fn effective_number(starts: &[u64], length: u64, values: &[f64]) -> f64 {
    let n = values.len().min(starts.len());
    if n < 2 {
        return n as f64;
    }
    let (starts, count) = (&starts[..n], n as f64);
    let mean = values[..n].iter().sum::<f64>() / count;
    let centred: Vec<f64> = values[..n].iter().map(|v| v - mean).collect();
    let variance = centred.iter().map(|v| v * v).sum::<f64>() / count;
    let hop = starts.windows(2).map(|pair| pair[1].saturating_sub(pair[0])).filter(|&d| d > 0).min();
    let Some(hop) = hop else { return 1.0 };
    let mut mean_variance = 0.0;
    for _ in 0..2 {
        let total = variance + mean_variance;
        let mut sum = 0.0;
        for lag in 1..n.min(MOST_LAGS) {
            let distance = hop.saturating_mul(lag as u64);
            let weight = 1.0 - lag as f64 / count;
            let overlap = overlap_correlation(distance as f64 / length.max(1) as f64);
            let measured = if total > 0.0 {
                (autocovariance(starts, &centred, distance) + weight * mean_variance) / total
            } else {
                0.0
            };
            let correlation = overlap.max(measured);
            if correlation <= 0.0 {
                break;
            }
            sum += weight * correlation;
        }
        mean_variance = total * ((1.0 + 2.0 * sum) / count).min(1.0);
    }
    if mean_variance > 0.0 {
        // Stated against the variance with n − 1, which is what the user divides.
        (variance * count / (count - 1.0) / mean_variance).clamp(1.0, count)
    } else {
        // A series that does not move: what is known is the overlap.
        let overlap = overlap_correlation(hop as f64 / length.max(1) as f64);
        (count / (1.0 + 2.0 * overlap)).max(1.0)
    }
}

/// Autocovariance at one distance, over the pairs that have exactly it; 0 where there is none.
/// Divided by the number of values, not of pairs: long lags, known from few pairs, weigh little.
fn autocovariance(starts: &[u64], centred: &[f64], distance: u64) -> f64 {
    let (mut sum, mut later) = (0.0, 0);
    for (i, &start) in starts.iter().enumerate() {
        let wanted = start.saturating_add(distance);
        while later < starts.len() && starts[later] < wanted {
            later += 1;
        }
        if later < starts.len() && starts[later] == wanted {
            sum += centred[i] * centred[later];
        }
    }
    sum / centred.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Random;

    /// Of 21 normal values, 10 replaced by wild ones leave the mean among the sound ones; 11 carry
    /// it away.
    #[test]
    fn analytic_breakdown_at_half() {
        let mut random = Random(3);
        let sound: Vec<f64> = (0..21).map(|_| random.normal()).collect();
        for wild in [1e9, -1e9, 50.0] {
            for replaced in 0..=10 {
                let mut values = sound.clone();
                values[..replaced].fill(wild);
                let found = location(&values, &mut Vec::new()).expect("finite values");
                let sound_range = 3.0; // the largest of 21 normal values
                assert!(found.mean.abs() < sound_range, "{replaced} at {wild}: {found:?}");
                assert_eq!(found.kept, 21 - replaced, "{replaced} at {wild}: {found:?}");
            }
            let mut values = sound.clone();
            values[..11].fill(wild);
            let found = location(&values, &mut Vec::new()).expect("finite values");
            assert!((found.mean - wild).abs() < 1.0, "beyond half the wild ones are the majority: {found:?}");
        }
    }

    /// On sound values the price of robustness is small: over 5000 series of 12 the variance of the
    /// mean is 1/12 and the mean scatter² is 1, both within 5 % (standard error of a variance from
    /// 5000: 2 %; 1 value in 300 of such short series is left out).
    #[test]
    fn oracle_efficiency_on_normal_values() {
        let mut random = Random(4);
        let (mut mean_square, mut scatter_square, mut left_out) = (0.0, 0.0, 0);
        for _ in 0..5000 {
            let values: Vec<f64> = (0..12).map(|_| random.normal()).collect();
            let found = location(&values, &mut Vec::new()).expect("finite values");
            mean_square += found.mean.powi(2) / 5000.0;
            scatter_square += found.scatter.powi(2) / 5000.0;
            left_out += 12 - found.kept;
        }
        assert!((mean_square * 12.0 - 1.0).abs() < 0.05, "{mean_square}");
        assert!((scatter_square - 1.0).abs() < 0.05, "{scatter_square}");
        assert!(left_out < 600, "{left_out} of 60000");
    }

    /// `E ln |A + n| = ln A + E1(A²/2σ²)/2` (ln |z| is harmonic), where `E |A + n|` is too large by
    /// σ²/2A. At 13 dB, σ/A = 0.158: 1.25 % for the arithmetic mean, E1(20)/2 = 5e-11 for the
    /// logarithmic one.
    #[test]
    fn analytic_logarithmic_mean_is_unbiased_in_noise() {
        let mut random = Random(5);
        let sigma = 10.0_f64.powf(-13.0 / 20.0) / std::f64::consts::SQRT_2;
        let (series, length) = (4000, 50);
        let (mut logarithmic, mut arithmetic) = (0.0, 0.0);
        for _ in 0..series {
            let amplitudes: Vec<f64> =
                (0..length).map(|_| (1.0 + sigma * random.normal()).hypot(sigma * random.normal())).collect();
            let logs: Vec<f64> = amplitudes.iter().map(|a| a.ln()).collect();
            logarithmic += location(&logs, &mut Vec::new()).expect("finite values").mean / f64::from(series);
            arithmetic += amplitudes.iter().sum::<f64>() / f64::from(length) / f64::from(series);
        }
        // 200 000 draws: standard error 0.035 %; what is left out as wild at 13 dB below the line
        // moves it by less than that.
        let standard_error = sigma / f64::from(series * length).sqrt();
        assert!(logarithmic.abs() < 4.0 * standard_error, "{logarithmic} against {standard_error}");
        assert!((arithmetic - 1.0 - sigma * sigma / 2.0).abs() < 4.0 * standard_error, "{arithmetic}");
    }

    /// The stated variance of a mean, s²/n_eff, against the true one over many series, with windows
    /// that overlap by 75 % over white noise (correlation from shared samples), and an
    /// autoregressive machine (correlation of its own). Long series are right within 35 %, on the
    /// safe side; so are short ones that only overlap. Of a drift with a time constant of 4.5
    /// windows, a series of 30 sees no more than six times the constant: it may understate by half.
    #[test]
    fn oracle_effective_number_against_simulated_means() {
        let mut random = Random(6);
        let ratio = |series: &mut dyn FnMut() -> Vec<f64>, hop: u64| {
            let (mut stated, mut squares, mut sum, trials) = (0.0, 0.0, 0.0, 400.0);
            for _ in 0..400 {
                let values = series();
                let starts: Vec<u64> = (0..values.len() as u64).map(|i| i * hop).collect();
                let n = values.len() as f64;
                let mean = values.iter().sum::<f64>() / n;
                let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
                stated += variance / effective_number(&starts, 64, &values) / trials;
                squares += mean * mean / trials;
                sum += mean / trials;
            }
            stated / (squares - sum * sum)
        };
        let overlapping = |random: &mut Random, count: usize| -> Vec<f64> {
            let noise: Vec<f64> = (0..16 * (count - 1) + 64).map(|_| random.normal()).collect();
            (0..count).map(|w| noise[16 * w..16 * w + 64].iter().sum()).collect()
        };
        let long = ratio(&mut || overlapping(&mut random, 200), 16);
        assert!((1.0..1.35).contains(&long), "{long}");
        let short = ratio(&mut || overlapping(&mut random, 28), 16);
        assert!((1.0..1.5).contains(&short), "{short}");
        let drifting = |random: &mut Random, count: usize| -> Vec<f64> {
            let mut state = random.normal();
            let mut next = || {
                state = 0.8 * state + 0.6 * random.normal();
                state
            };
            (0..count).map(|_| next()).collect()
        };
        let long = ratio(&mut || drifting(&mut random, 400), 64);
        assert!((0.9..1.35).contains(&long), "{long}");
        let short = ratio(&mut || drifting(&mut random, 30), 64);
        assert!((0.45..1.2).contains(&short), "{short}");
        assert_eq!(effective_number(&[0], 64, &[1.0]), 1.0);
    }
}
