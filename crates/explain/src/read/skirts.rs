//! Noise beside strong lines that comes of the shaft angle.
//!
//! An angle that is off by ε(t) revolutions (jitter of the tacho's pulses, a speed that wanders
//! faster than the mesh lines are followed) turns a line of order o and amplitude A into
//! `A (1 + 2πi o ε)`: beside it stands noise of power `(2π o A)² S(d)`, with the spectrum S of ε at
//! the distance d, on both sides and of all lines and sensors alike. Noise that is read some sixty
//! bins about a line misses it where it is narrower than that. So S is read from the free bins
//! beside all mesh harmonics together, and what it makes of each is added to its noise.

use gearwatch_check::orders::{NOISE_BINS, OrderSpectrum};

use crate::read::lines::{Family, Line};

/// Edges of the distances from a line (bins) at which S is taken as one number. The first lies
/// outside the main lobe of the window.
const EDGES: [f64; 9] = [3.5, 5.0, 7.0, 10.0, 14.0, 20.0, 28.0, 40.0, NOISE_BINS as f64];
const BANDS: usize = EDGES.len() - 1;
/// Free bins that a band must have.
const FEWEST: usize = 12;
/// Times its expected power at which a bin counts no further: a line that nobody listed. Noise
/// exceeds it in 1 of 1000 bins.
const MOST: f64 = 7.0;
/// Least share of the noise that is sought beside the heaviest line, and halvings of the search.
const LEAST: f64 = 1e-6;
const HALVINGS: usize = 60;

/// A mesh harmonic in one channel.
struct Carrier {
    bin: f64,
    /// Squared product of order and amplitude.
    weight: f64,
}

/// A free bin beside a carrier.
struct Beside {
    power: f64,
    /// Noise that is read about it.
    noise: f64,
    weight: f64,
}

/// Adds to the noise of all channels of a recording what the error of its angle makes beside the
/// mesh harmonics of the train's `lines`. `taken` says which bins lines take.
pub fn add(spectra: &mut [(Vec<f64>, OrderSpectrum)], lines: &[Line], revolutions: f64, taken: &[bool]) {
    let orders: Vec<f64> =
        lines.iter().filter(|l| matches!(l.family, Family::Mesh { .. })).map(|l| l.order).collect();
    let carriers: Vec<Vec<Carrier>> =
        spectra.iter().map(|s| carriers(&s.1, orders.iter().copied(), revolutions)).collect();
    let mut beside: [Vec<Beside>; BANDS] = std::array::from_fn(|_| Vec::new());
    for ((_, spectrum), carriers) in spectra.iter().zip(&carriers) {
        gather(spectrum, carriers, taken, &mut beside);
    }
    let spectrum_of_angle = beside.map(|bins| if bins.len() < FEWEST { 0.0 } else { likeliest(&bins) });
    for ((_, spectrum), carriers) in spectra.iter_mut().zip(&carriers) {
        for carrier in carriers {
            for k in about(carrier, spectrum.floor.len()) {
                // Within the main lobe as just outside it.
                let band = band(k, carrier).unwrap_or(0);
                spectrum.floor[k] += carrier.weight * spectrum_of_angle[band];
            }
        }
    }
}

fn carriers(spectrum: &OrderSpectrum, orders: impl Iterator<Item = f64>, revolutions: f64) -> Vec<Carrier> {
    let at = |order: f64| {
        let bin = order * revolutions;
        let near = spectrum.bins.get((bin.round() as usize).checked_sub(1)?..bin.round() as usize + 2)?;
        let power = near.iter().map(|b| b.norm_sqr()).fold(0.0, f64::max);
        Some(Carrier { bin, weight: order * order * power })
    };
    orders.filter_map(at).collect()
}

/// Bins about a carrier.
fn about(carrier: &Carrier, len: usize) -> std::ops::Range<usize> {
    let centre = carrier.bin.round() as usize;
    centre.saturating_sub(NOISE_BINS).min(len)..(centre + NOISE_BINS + 1).min(len)
}

/// The band of distances in which a bin lies; `None` within the main lobe.
fn band(bin: usize, carrier: &Carrier) -> Option<usize> {
    EDGES.partition_point(|edge| *edge <= (bin as f64 - carrier.bin).abs()).checked_sub(1).map(|b| b.min(BANDS - 1))
}

/// Adds the free bins beside the carriers of one channel, each to the carrier that weighs most
/// there.
fn gather(spectrum: &OrderSpectrum, carriers: &[Carrier], taken: &[bool], out: &mut [Vec<Beside>; BANDS]) {
    for (i, carrier) in carriers.iter().enumerate() {
        for k in about(carrier, spectrum.floor.len()).filter(|k| taken.get(*k) == Some(&false)) {
            let outweighs = |(j, other): (usize, &Carrier)| {
                j != i && other.weight >= carrier.weight && (k as f64 - other.bin).abs() <= NOISE_BINS as f64
            };
            if let Some(band) = band(k, carrier).filter(|_| !carriers.iter().enumerate().any(outweighs)) {
                let (power, noise) = (spectrum.bins[k].norm_sqr(), spectrum.floor[k]);
                if noise > 0.0 {
                    out[band].push(Beside { power, noise, weight: carrier.weight });
                }
            }
        }
    }
}

/// The likeliest number s where powers are distributed exponentially about `noise + weight s`: where
/// the slope `Σ weight/(noise + weight s) · (power/(noise + weight s) − 1)` of the logarithm of their
/// likelihood is 0, or 0 where it falls from there on.
fn likeliest(bins: &[Beside]) -> f64 {
    // What of an exponential variable with mean 1 counts on the mean.
    let counted = 1.0 - (-MOST).exp();
    let slope = |s: f64| -> f64 {
        let of = |b: &Beside| {
            let expected = b.noise + b.weight * s;
            b.weight / expected * ((b.power / expected).min(MOST) / counted - 1.0)
        };
        bins.iter().map(of).sum()
    };
    if slope(0.0) <= 0.0 {
        return 0.0;
    }
    let ends = |of: fn(&Beside) -> f64| bins.iter().map(of).filter(|s| s.is_finite());
    let mut high = ends(|b| b.power / b.weight).fold(0.0, f64::max);
    let mut low = ends(|b| b.noise / b.weight).fold(high, f64::min) * LEAST;
    for _ in 0..HALVINGS {
        let middle = (low * high).sqrt();
        if slope(middle) > 0.0 { low = middle } else { high = middle }
    }
    low
}

#[cfg(test)]
mod tests {
    use num_complex::Complex64;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;
    use crate::read::dsp::Transforms;

    const REVOLUTIONS: f64 = 60.0;
    const TEETH: f64 = 23.0;

    /// One sensor hears six mesh harmonics in noise, its angle off by `jitter` revolutions at 120
    /// even pulses and straight between them: powers of free bins about the carriers over their
    /// noise, near and far, before and after.
    fn over_noise(jitter: f64) -> [[f64; 2]; 2] {
        let mut random = ChaCha8Rng::seed_from_u64(4);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let (len, pulses) = (16_384, 120);
        let off: Vec<f64> = (0..=pulses).map(|_| jitter * normal()).collect();
        let samples: Vec<f64> = (0..len)
            .map(|n| {
                let at = n as f64 / len as f64 * pulses as f64;
                let (k, part) = (at as usize, at.fract());
                let angle = n as f64 / len as f64 * REVOLUTIONS + off[k] + part * (off[k + 1] - off[k]);
                let harmonics = (1..=6).map(|h| (std::f64::consts::TAU * f64::from(h) * TEETH * angle).cos());
                harmonics.sum::<f64>() + 0.05 * normal()
            })
            .collect();
        let line = |harmonic| Line {
            family: Family::Mesh { stage: 0, harmonic },
            order: f64::from(harmonic) * TEETH,
        };
        let lines: Vec<Line> = (1..=6).map(line).collect();
        let taken = gearwatch_check::orders::occupied(len / 2 + 1, (1..=6 * 23 + 4).map(|k| f64::from(k) * REVOLUTIONS));
        let spectrum = OrderSpectrum::of(&mut Transforms::default(), &samples, &taken);
        let mut spectra = [(samples, spectrum)];
        let ratios = |s: &OrderSpectrum| {
            [3..20, 48..60].map(|distances: std::ops::Range<usize>| {
                let bins = lines.iter().flat_map(|l| {
                    let centre = (l.order * REVOLUTIONS) as usize;
                    distances.clone().flat_map(move |d| [centre - d, centre + d])
                });
                let free: Vec<usize> = bins.filter(|k| !taken[*k]).collect();
                free.iter().map(|k| s.bins[*k].norm_sqr() / s.floor[*k]).sum::<f64>() / free.len() as f64
            })
        };
        let before = ratios(&spectra[0].1);
        add(&mut spectra, &lines, REVOLUTIONS, &taken);
        [before, ratios(&spectra[0].1)]
    }
}
