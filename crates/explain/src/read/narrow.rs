//! Narrow bands of what is left when the train's lines are taken out, recording against reference:
//! as wide as a line that wanders by 0.2 % to each side, narrow against every mode.

use crate::read::dsp::{WINDOW_NOISE_BINS, median};
use crate::read::features::{ChannelFeatures, RecordingFeatures, USABLE_BAND};
use crate::read::scan::Twin;

/// Least width of a band (Hz), and its width relative to its frequency.
const LEAST_HZ: f64 = 8.0;
const RELATIVE: f64 = 0.004;
/// Where the bands begin (Hz).
const FIRST_HZ: f64 = 30.0;
/// Share of its bins, and bins, that no line of the train takes.
const FREE: f64 = 1.0 / 3.0;
const LEAST_BINS: usize = 8;
/// Bands on each side from which the scatter of one is read.
const SCATTER: usize = 60;

/// Middles of the bands of a sample rate, each half a width from the next.
pub fn middles(sample_rate_hz: f64) -> Vec<f64> {
    let highest_hz = USABLE_BAND * sample_rate_hz;
    let next = |hz: &f64| Some(hz + 0.5 * LEAST_HZ.max(RELATIVE * hz));
    std::iter::successors(Some(FIRST_HZ), next).take_while(|hz| *hz < highest_hz).collect()
}

/// Mean power of the bins of a band that no line takes, and their number; `None` where there are
/// too few.
fn power(recording: &RecordingFeatures, channel: &ChannelFeatures, hz: f64) -> Option<(f64, usize)> {
    let half = 0.5 * LEAST_HZ.max(RELATIVE * hz);
    let low = ((hz - half) / recording.hz_per_bin).ceil() as usize;
    let high = ((hz + half) / recording.hz_per_bin) as usize;
    let bins = channel.remainder.get(low..=high)?;
    let taken = recording.taken.get(low..=high)?;
    let free = bins.iter().zip(taken).filter(|(_, taken)| !**taken).map(|(bin, _)| bin.norm_sqr());
    let (sum, count) = free.fold((0.0, 0usize), |(sum, count), p| (sum + p, count + 1));
    (count >= LEAST_BINS && count as f64 >= FREE * bins.len() as f64).then(|| (sum / count as f64, count))
}

/// Changes (ln power) of one pair and channel by band, with their variance if both were noise.
pub fn changes(twin: &Twin<'_>, name: &str, middles: &[f64]) -> Option<Vec<Option<(f64, f64)>>> {
    let reference = twin.reference?;
    let of = |r: &'_ RecordingFeatures| r.channels.iter().position(|c| c.name == name);
    let (now, before) = (&twin.recording.channels[of(twin.recording)?], &reference.channels[of(reference)?]);
    let highest = USABLE_BAND * twin.recording.sample_rate_hz.min(reference.sample_rate_hz);
    let of = |hz: &f64| {
        let ((a, n), (b, m)) = (power(twin.recording, now, *hz)?, power(reference, before, *hz)?);
        let change = (a / b).ln();
        (*hz < highest && change.is_finite())
            .then(|| (change, WINDOW_NOISE_BINS / n as f64 + WINDOW_NOISE_BINS / m as f64))
    };
    Some(middles.iter().map(of).collect())
}

/// Changes (ln power) beside a level, with their standard deviation: that of noise, or by which the
/// bands about them scatter.
pub fn standard(changes: &[Option<(f64, f64)>], level: impl Fn(usize) -> f64) -> Vec<Option<(f64, f64)>> {
    let off = |(k, c): (usize, &Option<(f64, f64)>)| c.map(|(change, variance)| (change - level(k), variance));
    let left: Vec<Option<(f64, f64)>> = changes.iter().enumerate().map(off).collect();
    let of = |k: usize| {
        let (off, variance) = left[k]?;
        let near = k.saturating_sub(SCATTER)..(k + SCATTER + 1).min(left.len());
        let mut sizes: Vec<f64> = left[near].iter().flatten().map(|l| l.0.abs()).collect();
        Some((off, (1.4826 * median(&mut sizes)).max(variance.sqrt())))
    };
    (0..left.len()).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Wherever a line lies, it is within a quarter of a width of the middle of a band.
    #[test]
    fn analytic_every_line_falls_into_the_middle_of_a_band() {
        let all = middles(7000.0 / USABLE_BAND);
        for k in 0..2000 {
            let hz = FIRST_HZ * (6900.0 / FIRST_HZ).powf(f64::from(k) / 1999.0);
            let nearest = all.iter().map(|middle| (middle - hz).abs()).fold(f64::INFINITY, f64::min);
            assert!(nearest <= 0.2501 * LEAST_HZ.max(RELATIVE * hz), "{hz} Hz: {nearest}");
        }
    }
}
