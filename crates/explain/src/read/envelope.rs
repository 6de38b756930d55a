//! Envelope orders of what the gears do not make: rolling bearings with a defect.
//!
//! The train's lines are cut out of the spectrum over shaft angle, the rest is whitened (each bin
//! divided by the local floor), and the spectrum of its squared envelope is read at orders that no
//! gear explains (Antoni & Randall 2002; whitening: Sawalhi & Randall 2011).

use gearwatch_core::train::Train;
use num_complex::Complex64;

use crate::read::combs::distance_to_combs;
use crate::read::dsp::{Transforms, median};
use crate::read::features::{ChannelFeatures, RecordingFeatures};

/// Lowest frequency that the envelope is made of (Hz): above the strong mesh lines of most benches.
const LOWEST_HZ: f64 = 500.0;
/// Amplitude over the root of the floor to which single bins are limited.
const LIMIT: f64 = 3.0;
/// Highest envelope order that is kept, of the input shaft.
const HIGHEST_ORDER: f64 = 60.0;

/// Orders that are scanned: from, in turns of the slowest shaft; to, of the input shaft.
const LOWEST: f64 = 1.6;
const HIGHEST: f64 = 16.0;

/// Half width that is cut out about a line of a comb, in spacings, up to which a long comb leaves
/// most orders.
const APART: f64 = 0.1;
/// Bins from a shaft's comb at which a line of the window that is used has fallen to nothing.
const CLEAR_OF_COMB: f64 = 2.0;

/// Share of the strongest multiple's power from which an order is heard.
const HEARD: f64 = 0.3;

/// Squared-envelope spectrum of one channel, power over local floor per bin; bin `k` is order `k /
/// revolutions`.
pub fn spectrum(transforms: &mut Transforms, recording: &RecordingFeatures, channel: &ChannelFeatures) -> Vec<f64> {
    let len = recording.phase_rev.len();
    let bins = &channel.order_spectrum;
    let revs = recording.revolutions;
    let low = (LOWEST_HZ / recording.hz_per_bin) as usize;
    let high = ((crate::read::features::USABLE_BAND * recording.sample_rate_hz / recording.hz_per_bin) as usize)
        .min(bins.len());
    let mut analytic = vec![Complex64::ZERO; len];
    for k in low..high {
        if !recording.taken[k] && channel.order_floor[k] > 0.0 {
            let value = bins[k] / channel.order_floor[k].sqrt();
            // What still stands far above its floor is a line that nobody listed; it is limited,
            // not trusted.
            analytic[k] = if value.norm() > LIMIT { value * (LIMIT / value.norm()) } else { value };
        }
    }
    transforms.inverse(&mut analytic);
    let mut squared: Vec<f64> = analytic.iter().map(|z| z.norm_sqr()).collect();
    let mean = squared.iter().sum::<f64>() / len as f64;
    squared.iter_mut().for_each(|v| *v -= mean);
    // The signal was windowed before it was squared, so its envelope falls to zero at the ends by
    // itself.
    let envelope = transforms.forward_real(&mut squared);
    let end = ((HIGHEST_ORDER * revs) as usize).min(envelope.len());
    let power: Vec<f64> = envelope[..end].iter().map(|b| b.norm_sqr()).collect();
    (0..end)
        .map(|k| {
            let mut around: Vec<f64> = power[k.saturating_sub(60)..(k + 61).min(end)].to_vec();
            power[k] * std::f64::consts::LN_2 / median(&mut around).max(f64::MIN_POSITIVE)
        })
        .collect()
}

/// An envelope order that no gear explains.
#[derive(Clone, Debug)]
pub struct EnvelopeLine {
    /// Order of the input shaft.
    pub order: f64,
    /// Standard scores of the summed logarithms against all other orders.
    pub score: f64,
    /// Orders among which it stands out most.
    pub range: f64,
    /// By channel: envelope power of the order beyond the noise, in units of a bin of noise, sum
    /// over recordings; `None` of channels that were left out.
    pub by_channel: Vec<Option<f64>>,
    /// What noise alone scatters such a sum by.
    pub noise: f64,
}

/// One envelope spectrum with what it belongs to.
pub struct EnvelopeSpectrum {
    /// Revolutions of the input shaft.
    pub revolutions: f64,
    /// Position of the channel.
    pub channel: usize,
    /// Position of the recording.
    pub recording: usize,
    /// 1 for recordings; negative for references, so that what was there before is taken off.
    pub sign: f64,
    /// Power over local floor.
    pub power: Vec<f64>,
}

/// Bins about an order, over a part in 200 of it and `least` bins at least on each side: rolling
/// elements slip.
fn around(spectrum: &EnvelopeSpectrum, order: f64, least: f64) -> &[f64] {
    let centre = order * spectrum.revolutions;
    let reach = (centre * 0.0025).max(least).round() as usize;
    let centre = centre.round() as usize;
    let high = (centre + reach + 1).min(spectrum.power.len());
    &spectrum.power[centre.saturating_sub(reach).min(high)..high]
}

/// Mean log power about an order.
fn at(spectrum: &EnvelopeSpectrum, order: f64) -> f64 {
    let bins = around(spectrum, order, 0.5);
    if bins.is_empty() {
        return 0.0;
    }
    let mean = bins.iter().sum::<f64>() / bins.len() as f64;
    mean.max(0.05).ln().min(3.0)
}

/// Whether two shafts modulate at an order: what they do beats at the sums and differences of their
/// orders and of their first multiples, four together; a sum over harmonics shows that of the first
/// orders at their half too.
pub fn is_mixed(train: &Train, order: f64, tolerance: f64) -> bool {
    let mixed = |a: f64, b: f64| {
        let both = |m: u32, n: u32| [1.0, -1.0].map(|s| (f64::from(m) * a + s * f64::from(n) * b).abs());
        let beats = [(1, 1), (1, 2), (2, 1), (1, 3), (3, 1), (2, 2)].into_iter().flat_map(|(m, n)| both(m, n));
        beats.chain(both(1, 1).map(|o| 0.5 * o)).any(|o| (order - o).abs() < tolerance)
    };
    let mut pairs =
        train.shafts.iter().enumerate().flat_map(|(i, a)| train.shafts[..i].iter().map(move |b| (a.1, b.1)));
    pairs.any(|(a, b)| mixed(a, b))
}

/// Whether a train makes an order of its own: shafts, meshes and what two shafts modulate.
/// `revolutions` of the shortest recording give how sharp orders are.
fn is_of_train(train: &Train, order: f64, revolutions: f64) -> bool {
    let tolerance = (3.0 / revolutions).max(0.004 * order);
    let comb = |o: f64| {
        let m = (order / o).round();
        // A comb whose lines the tolerance leaves apart is cut out to its end.
        m >= 1.0 && (order - m * o).abs() < tolerance && (m <= 14.0 || tolerance < APART * o)
    };
    // Lines of a mesh beat at its order whatever is cut out, and the sum over harmonics shows that
    // at a half and a third of it too.
    let mesh = |o: f64| {
        (1..=3).any(|k| {
            let own = f64::from(k) * order;
            let m = (own / o).round();
            m >= 1.0 && (own - m * o).abs() < f64::from(k) * tolerance
        })
    };
    is_mixed(train, order, tolerance)
        || train.shafts.iter().any(|s| s.1 * revolutions > 12.0 && comb(s.1))
        || comb(train.motor_order)
        || train.stages.iter().any(|s| mesh(s.mesh_order))
}

/// The envelope order that stands out most over all recordings: sum over its first three harmonics,
/// in standard scores of the same sum over all orders that were scanned.
pub fn scan(spectra: &[EnvelopeSpectrum], train: &Train, channels: usize) -> Option<EnvelopeLine> {
    let revolutions = spectra.iter().map(|s| s.revolutions).fold(0.0, f64::max);
    let least_revs = spectra.iter().map(|s| s.revolutions).fold(f64::INFINITY, f64::min);
    if revolutions <= 0.0 {
        return None;
    }
    let slowest = train.shafts.iter().map(|s| s.1).fold(f64::INFINITY, f64::min);
    let (low, high) = (LOWEST * slowest, HIGHEST);
    let near = |order: f64| is_of_train(train, order, least_revs);
    let mut orders = Vec::new();
    let mut order = low;
    while order < high {
        if !near(order) {
            orders.push(order);
        }
        order += (0.5 / revolutions).max(order * 0.0005);
    }
    let mut best: Option<(f64, f64)> = None;
    for channel in 0..=channels {
        // The last turn takes all channels together.
        let members: Vec<&EnvelopeSpectrum> =
            spectra.iter().filter(|s| channel == channels || s.channel == channel).collect();
        if members.is_empty() || (channel == channels && channels == 1) {
            continue;
        }
        let sums: Vec<f64> = orders
            .iter()
            .map(|&o| {
                members.iter().map(|s| s.sign * (at(s, o) + 0.7 * at(s, 2.0 * o) + 0.5 * at(s, 3.0 * o))).sum::<f64>()
            })
            .collect();
        let mut sorted = sums.clone();
        let middle = median(&mut sorted);
        let mut deviations: Vec<f64> = sums.iter().map(|s| (s - middle).abs()).collect();
        let scale = 1.4826 * median(&mut deviations);
        for (&order, &sum) in orders.iter().zip(&sums) {
            let score = (sum - middle) / scale.max(1e-9);
            if best.is_none_or(|b| score > b.1) {
                best = Some((order, score));
            }
        }
    }
    let (order, score) = best?;
    let heard = |channel: usize, order: f64| {
        let own = spectra.iter().filter(|s| s.sign > 0.0 && s.channel == channel);
        own.map(|s| excess(s, order)).reduce(|a, b| (a.0 + b.0, a.1 + b.1))
    };
    let strength = |order: f64| (0..channels).filter_map(|c| heard(c, order)).map(|x| x.0).sum::<f64>();
    // The order itself may lie too near a shaft's comb to be scanned, and its harmonics not:
    // passages are strongest at their own order. What lies on the comb is the gears'.
    let apart = |o: &f64| *o > low && distance_to_combs(train, revolutions, *o) * revolutions > CLEAR_OF_COMB;
    let parts = [2.0, 3.0].map(|m| order / m).into_iter().filter(apart);
    // Impacts light their own order and its multiples: the lowest that is heard at all is theirs.
    let most = std::iter::once(order).chain(parts.clone()).map(strength).fold(0.0, f64::max);
    let order = parts.filter(|o| strength(*o) > HEARD * most).fold(order, f64::min);
    let all: Vec<Option<(f64, usize)>> = (0..channels).map(|c| heard(c, order)).collect();
    let noise = all.iter().flatten().map(|x| (x.1 as f64).sqrt()).fold(1.0, f64::max);
    Some(EnvelopeLine {
        order,
        score,
        range: high - low,
        by_channel: all.iter().map(|x| x.map(|x| x.0)).collect(),
        noise,
    })
}

/// Envelope power of an order beyond what noise gives its bins, in units of a bin of noise, and the
/// number of bins.
fn excess(spectrum: &EnvelopeSpectrum, order: f64) -> (f64, usize) {
    let bins = around(spectrum, order, 1.5);
    (bins.iter().map(|p| p - 1.0).sum(), bins.len())
}
