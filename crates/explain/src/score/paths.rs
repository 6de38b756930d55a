//! A changed path: one function of frequency for lines and background, the same at every speed and load.
//!
//! Within a band of frequencies all changes of a channel have one mean `m`, of which the path's size is the scale; what each differs from it by is repetition, noise and a
//! share of the change. The likelihood integrates `m` about its mode (Laplace), whose prior has the tail of the changes: a resonance is local.

use super::calibration::Calibration;
use super::changes::{Change, density, weight_and_variance};

/// Rounds of reweighting to the mode.
const ROUNDS: usize = 4;

/// Log likelihood of all changes where some channels' paths changed by this scale; the others stayed.
///
/// A changed factor is a path whose bands are one. Else what lies far below the modes of housings and mountings stays: there they follow as a whole.
pub fn log_likelihood(
    all: &[Change],
    (changed, factor): (&dyn Fn(usize) -> bool, bool),
    rho: f64,
    scale: f64,
    c: &Calibration,
) -> f64 {
    let mut sum = 0.0;
    let mut bands: std::collections::BTreeMap<(usize, i64), Vec<&Change>> = std::collections::BTreeMap::new();
    for x in all {
        if changed(x.channel) && (factor || x.frequency_hz >= c.path_from_hz) {
            let band = if factor { 0 } else { band(x.frequency_hz, c) };
            bands.entry((x.channel, band)).or_default().push(x);
        } else {
            let (weight, variance) = weight_and_variance(x, rho, c);
            sum += weight * density(x.change, variance, c.tail);
        }
    }
    sum + bands.values().map(|members| mean_of(members, rho, scale, c).1).sum::<f64>()
}

fn band(frequency_hz: f64, c: &Calibration) -> i64 {
    (frequency_hz.max(1.0).ln() / c.path_width) as i64
}

/// Mode of the common change of some changes, and the log likelihood integrated about it.
fn mean_of(members: &[&Change], rho: f64, scale: f64, c: &Calibration) -> (f64, f64) {
    let prior = scale * scale;
    let mut middle = 0.0;
    let mut precision = 1.0 / prior;
    let own = |x: &Change, middle: f64| {
        let (weight, variance) = weight_and_variance(x, rho, c);
        (weight, variance + (c.path_error * middle).powi(2))
    };
    for round in 0..ROUNDS {
        let at = middle;
        let pull = if round == 0 { 1.0 } else { (c.tail + 1.0) / (c.tail + at * at / prior) };
        precision = pull / prior;
        let mut target = 0.0;
        for x in members {
            let (weight, variance) = own(x, at);
            let off = if round == 0 { 0.0 } else { (x.change - at).powi(2) / variance };
            let w = weight * (c.tail + 1.0) / (c.tail + off) / variance;
            precision += w;
            target += w * x.change;
        }
        middle = target / precision;
    }
    let mut sum = density(middle, prior, c.tail) - 0.5 * precision.ln();
    for x in members {
        let (weight, variance) = own(x, middle);
        sum += weight * density(x.change - middle, variance, c.tail);
    }
    (middle, sum)
}

/// The change of a channel's path by band: frequency and common change.
pub fn by_band(all: &[Change], channel: usize, rho: f64, scale: f64, c: &Calibration) -> Vec<(f64, f64)> {
    let mut bands: std::collections::BTreeMap<i64, Vec<&Change>> = std::collections::BTreeMap::new();
    for x in all.iter().filter(|x| x.channel == channel && x.frequency_hz >= c.path_from_hz) {
        bands.entry(band(x.frequency_hz, c)).or_default().push(x);
    }
    bands
        .into_iter()
        .map(|(k, members)| (((k as f64 + 0.5) * c.path_width).exp(), mean_of(&members, rho, scale, c).0))
        .collect()
}
