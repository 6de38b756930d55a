//! Location and scatter of a few numbers among which some may be wild, and how many of them are independent.

/// Distance from the median, in robust standard deviations, at which a value is left out.
///
/// Of normal values 1 in 16 000 lies further out, so that the mean of the rest keeps 99.9 % of its efficiency.
pub const REJECTION_SIGMAS: f64 = 4.0;

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

/// Mean of the values that lie within [`REJECTION_SIGMAS`] robust standard deviations of the median.
///
/// Breakdown point 50 %: as long as more than half of the values are sound, wild ones of any size cannot carry the mean
/// out of the sound ones' neighbourhood (median and median absolute deviation break down at 50 %, and everything kept
/// lies near them). Fewer than three values are all kept: nothing tells which is wild. `scratch` is overwritten.
///
/// # Source
/// F. R. Hampel, "The breakdown points of the mean combined with some rejection rules", Technometrics 27 (1985):
/// the rule X84 with factor 5.2 on the MAD; here 4 × 1.4826 = 5.93, which rejects fewer sound values.
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

/// Correlation of what two Hann windows measure in white noise when one starts `lag` window lengths after the other
/// (0 to 1; nothing from 1 on).
///
/// # Formula
/// `∫ w(t) w(t+x) dt / ∫ w² dt = (1−x)(2/3 + cos(2πx)/3) + sin(2πx)/(2π)`; 1/6 at half a window (P. D. Welch 1967; A. H.
/// Nuttall 1971).
pub fn hann_overlap_correlation(lag: f64) -> f64 {
    if !(0.0..1.0).contains(&lag) {
        return 0.0;
    }
    let angle = std::f64::consts::TAU * lag;
    (1.0 - lag) * (2.0 + angle.cos()) / 3.0 + angle.sin() / std::f64::consts::TAU
}

/// Lags beyond this many hops are not searched for correlation.
const MOST_LAGS: usize = 500;

/// How many independent values a series of windows is worth, for the variance of its mean: `s²/n_eff`.
///
/// `starts` are the windows' first samples, ascending, `length` the samples in a window, `values` what was measured.
/// Two things correlate neighbours: shared samples (known: [`hann_overlap_correlation`]) and slow changes of the machine
/// (estimated from the series itself, summed until the autocorrelation first drops to zero). At each lag the larger counts.
///
/// # Formula
/// `n_eff = n / (1 + 2 Σ (1 − k/n) ρ_k)`, initial positive sequence (C. J. Geyer, Statistical Science 7, 1992).
pub fn effective_number(starts: &[u64], length: u64, values: &[f64]) -> f64 {
    let n = values.len().min(starts.len());
    if n < 2 {
        return n as f64;
    }
    let mean = values[..n].iter().sum::<f64>() / n as f64;
    let variance = values[..n].iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n as f64;
    let hop = starts[..n].windows(2).map(|pair| pair[1].saturating_sub(pair[0])).filter(|&d| d > 0).min();
    let Some(hop) = hop else { return 1.0 };
    let mut sum = 0.0;
    for lag in 1..n.min(MOST_LAGS) {
        let distance = hop.saturating_mul(lag as u64);
        let overlap = hann_overlap_correlation(distance as f64 / length.max(1) as f64);
        let measured = autocorrelation(&starts[..n], &values[..n], distance, mean, variance);
        let correlation = overlap.max(measured);
        if correlation <= 0.0 {
            break;
        }
        sum += (1.0 - lag as f64 / n as f64) * correlation;
    }
    (n as f64 / (1.0 + 2.0 * sum)).max(1.0)
}

/// Autocorrelation at one distance, over the pairs that have it (within half a sample); 0 where there is none.
fn autocorrelation(starts: &[u64], values: &[f64], distance: u64, mean: f64, variance: f64) -> f64 {
    if variance <= 0.0 {
        return 0.0;
    }
    let (mut sum, mut later) = (0.0, 0);
    for (i, &start) in starts.iter().enumerate() {
        let wanted = start.saturating_add(distance);
        while later < starts.len() && starts[later] < wanted {
            later += 1;
        }
        if later < starts.len() && starts[later] == wanted {
            sum += (values[i] - mean) * (values[later] - mean);
        }
    }
    // Divided by n, not by the number of pairs: long lags, known from few pairs, weigh little.
    sum / (variance * values.len() as f64)
}
