//! Swapped cables and turned sensors: how the channels of a recording came to their places.

use super::cross::{Against, Cross, Wiring};
use super::{PRIOR, repetition};

/// Share of frequencies that must agree with the reference, once the cables are put right: most.
/// What changed besides, a path or a gear, spoils the rest.
const MOST: f64 = 0.5;
/// Neighbouring bins of Hann windows are not independent.
const TEMPER: f64 = 0.5;
/// Parts of the band whose scatter says how far one wiring being better than another is more than
/// what changed besides: enough for a standard deviation, each wider than a resonance.
const PARTS: usize = 20;

/// Another wiring than the reference has.
#[derive(Clone, Debug, PartialEq)]
pub struct Rewired {
    /// How it is.
    pub wiring: Wiring,
    /// That it is so.
    pub probability: f64,
    /// Share of the frequencies that agree with the reference as recorded, and wired so.
    pub agrees: (f64, f64),
    /// Wirings that cannot be told from it: two channels have one relation, whichever of them was
    /// turned.
    pub same: Vec<Wiring>,
}

/// Share of frequencies that agree, and the log likelihood, of each wiring.
struct Judged {
    wiring: Wiring,
    agrees: f64,
    ln_likelihood: f64,
    /// By part of the band.
    parts: Vec<f64>,
}

impl Judged {
    /// Log odds against another wiring that the parts of the band allow: as many nats as their sum
    /// has, and no more than the likelihood ratio of a mean beside zero with the scatter of the
    /// parts (`m/2 ln(1 + t²/(m − 1))`, Student's). Cables that were exchanged are so at all
    /// frequencies; a resonance or a gear that changed favours one wiring here and another there.
    fn ln_odds(&self, other: &Self) -> f64 {
        let gains: Vec<f64> = self.parts.iter().zip(&other.parts).map(|(a, b)| a - b).collect();
        let (count, sum) = (gains.len() as f64, gains.iter().sum::<f64>());
        let mean = sum / count;
        let scatter = gains.iter().map(|g| (g - mean).powi(2)).sum::<f64>();
        if count < 3.0 || mean <= 0.0 || scatter <= 0.0 {
            return sum;
        }
        // t² = mean² m (m − 1) / Σ(g − mean)²
        let student = 0.5 * count * (count * mean * mean / scatter).ln_1p();
        sum.min(student)
    }
}

/// No swap or one, no sensor turned or one.
fn candidates(n: usize) -> Vec<Wiring> {
    let mut orders = vec![Wiring::straight(n)];
    for i in 0..n {
        for j in i + 1..n {
            let mut w = Wiring::straight(n);
            w.from.swap(i, j);
            orders.push(w);
        }
    }
    let mut out = Vec::new();
    for order in orders {
        out.push(order.clone());
        for i in 0..n {
            let mut w = order.clone();
            w.sign[i] = -1.0;
            out.push(w);
        }
    }
    out
}

/// Judges one recording against its reference. Each frequency either agrees, by the Wishart
/// likelihood of its cross-spectra, or is anything, which costs the `n²/2 ln K` of its free numbers
/// (Schwarz 1978): what changed at some frequencies outvotes nothing.
fn judge(recording: &Cross, against: &Against<'_>, averages: f64) -> Vec<Judged> {
    let n = recording.channels.len();
    let counted =
        1.0 / (1.0 / recording.averages + 1.0 / averages + repetition::OF_CROSS_SPECTRA * repetition::OF_CROSS_SPECTRA);
    let anything = 0.5 * (n * n) as f64 * counted.max(3.0).ln() + (n * n) as f64;
    candidates(n)
        .into_iter()
        .map(|wiring| {
            let costs: Vec<f64> =
                against.divergence(recording, &wiring).into_iter().map(|d| counted * d.max(0.0)).collect();
            let agrees = costs.iter().filter(|c| **c < anything).count() as f64 / costs.len().max(1) as f64;
            let part = |of: &[f64]| -TEMPER * of.iter().map(|c| c.min(anything)).sum::<f64>();
            let parts: Vec<f64> = costs.chunks(costs.len().div_ceil(PARTS).max(1)).map(part).collect();
            Judged { wiring, agrees, ln_likelihood: parts.iter().sum(), parts }
        })
        .collect()
}

/// How well a recording agrees with a reference under its best wiring; to choose among references.
pub fn likeness(recording: &Cross, reference: &Cross) -> Option<f64> {
    let against = Against::new(reference)?;
    judge(recording, &against, reference.averages).into_iter().map(|j| j.ln_likelihood).max_by(f64::total_cmp)
}

/// Another wiring than the reference's, if there is one.
pub fn rewired(recording: &Cross, reference: &Cross) -> Option<Rewired> {
    if recording.channels.len() < 2 || !recording.is_like(reference) {
        return None;
    }
    let judged = judge(recording, &Against::new(reference)?, reference.averages);
    let straight = judged.first()?;
    let best = judged.iter().max_by(|a, b| a.ln_likelihood.total_cmp(&b.ln_likelihood))?;
    if best.wiring == straight.wiring || best.agrees < MOST {
        return None;
    }
    // Against staying as it was; what else it could be shares the odds.
    let near = |j: &&Judged| j.wiring != best.wiring && best.ln_likelihood - j.ln_likelihood < 3.0;
    let same: Vec<Wiring> = judged.iter().filter(near).map(|j| j.wiring.clone()).collect();
    let odds = PRIOR * best.ln_odds(straight).min(700.0).exp();
    let probability = odds / (1.0 + odds);
    (probability > 0.5).then(|| Rewired {
        wiring: best.wiring.clone(),
        probability: (probability / (1.0 + same.len() as f64)).min(0.99),
        agrees: (straight.agrees, best.agrees),
        same,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn judged(parts: &[f64]) -> Judged {
        Judged { wiring: Wiring::straight(2), agrees: 1.0, ln_likelihood: parts.iter().sum(), parts: parts.to_vec() }
    }

    /// Twenty parts that gain 10 ± 1 nats each: mean² m / Σ(g − mean)² = 100 · 20 / 20, and 10 ln
    /// 101 nats are left of 200. One part that gains all 200 has a mean of one standard error:
    /// mean² m / Σ(g − mean)² = 100 · 20 / (190² + 19 · 10²) = 1/19.
    #[test]
    fn analytic_odds_are_no_surer_than_the_parts_scatter_allows() {
        let nothing = judged(&[0.0; 20]);
        let even: Vec<f64> = (0..20).map(|k| if k % 2 == 0 { 9.0 } else { 11.0 }).collect();
        assert!((judged(&even).ln_odds(&nothing) - 10.0 * 101f64.ln()).abs() < 1e-9);
        let mut one = [0.0; 20];
        one[7] = 200.0;
        assert!((judged(&one).ln_odds(&nothing) - 10.0 * (20f64 / 19.0).ln()).abs() < 1e-9);
        // Few nats stay what they are, and so does what speaks against.
        assert!((judged(&[0.1; 20]).ln_odds(&nothing) - 2.0).abs() < 1e-9);
        assert_eq!(nothing.ln_odds(&judged(&even)), -200.0);
    }
}
