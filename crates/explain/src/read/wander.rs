//! Lines of a fixed frequency that wanders: those of another machine, whose motor slips with its
//! own load.
//!
//! A search bin by bin asks a line to stand still for the whole recording and to come back at the
//! same bin. A motor's speed wanders by some parts in a thousand. Here the power of what is left
//! when the train's own lines are taken out is compared with the reference in narrow bands: as wide
//! as such a line, narrow against every resonance.

use crate::read::dsp::{WINDOW_NOISE_BINS, median};
use crate::read::features::{ChannelFeatures, RecordingFeatures, USABLE_BAND};
use crate::read::scan::Twin;

/// Least width of a band (Hz), and its width relative to its frequency: a line that wanders by 0.2
/// % to each side.
const LEAST_HZ: f64 = 8.0;
const RELATIVE: f64 = 0.004;
/// Where the bands begin (Hz).
const FIRST_HZ: f64 = 30.0;
/// Share of its bins, and bins, that no line of the train takes.
const FREE: f64 = 1.0 / 3.0;
const LEAST_BINS: usize = 8;
/// Bands on each side whose median is what a path or a background changed by.
const AROUND: usize = 20;
/// Those from which the scatter is read.
pub const SCATTER: usize = 60;

/// The band that grew most.
#[derive(Clone, Debug)]
pub struct Wandering {
    /// Its middle (Hz).
    pub hz: f64,
    /// Sum of the standard scores of all pairs and channels over the root of their number.
    pub score: f64,
    /// As `score`, of the band that fell most: what chance does to either side.
    pub fallen: f64,
}

impl Wandering {
    /// In words.
    pub fn describe(&self) -> String {
        format!(
            "narrow band that grew most, at all speeds alike: {:.0} Hz by {:.1} standard scores; the one that fell most by {:.1}",
            self.hz, self.score, self.fallen
        )
    }
}

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

/// Standard scores of one pair and channel, by band.
fn scores(twin: &Twin<'_>, name: &str, middles: &[f64]) -> Option<Vec<Option<f64>>> {
    let changes = changes(twin, name, middles)?;
    let near = |k: usize, reach: usize| k.saturating_sub(reach)..(k + reach + 1).min(changes.len());
    let left: Vec<Option<(f64, f64)>> = (0..changes.len())
        .map(|k| {
            let (change, variance) = changes[k]?;
            let mut around: Vec<f64> = changes[near(k, AROUND)].iter().flatten().map(|c| c.0).collect();
            Some((change - median(&mut around), variance))
        })
        .collect();
    let score = |k: usize| {
        let (left_here, variance) = left[k]?;
        let mut sizes: Vec<f64> = left[near(k, SCATTER)].iter().flatten().map(|l| l.0.abs()).collect();
        Some(left_here / (1.4826 * median(&mut sizes)).max(variance.sqrt()))
    };
    Some((0..left.len()).map(score).collect())
}

/// The band that grew most in all recordings and channels; `None` without a reference at two
/// speeds.
pub fn wandering(twins: &[Twin<'_>], channels: &[String]) -> Option<Wandering> {
    let speeds = || twins.iter().filter(|t| t.reference.is_some()).map(|t| t.recording.input_hz);
    let (low, high) = speeds().fold((f64::INFINITY, 0.0f64), |(low, high), hz| (low.min(hz), high.max(hz)));
    if high < 1.05 * low {
        return None;
    }
    let rate = twins.iter().map(|t| t.recording.sample_rate_hz).fold(f64::INFINITY, f64::min);
    let middles = middles(rate);
    let rows: Vec<Vec<Option<f64>>> =
        twins.iter().flat_map(|t| channels.iter().filter_map(|name| scores(t, name, &middles))).collect();
    let mut out = Wandering { hz: f64::NAN, score: 0.0, fallen: 0.0 };
    for (k, hz) in middles.iter().enumerate() {
        let here: Vec<f64> = rows.iter().filter_map(|row| row[k]).collect();
        if here.len() < 2 || 4 * here.len() < 3 * rows.len() {
            continue;
        }
        let score = here.iter().sum::<f64>() / (here.len() as f64).sqrt();
        if score > out.score {
            out.hz = *hz;
            out.score = score;
        }
        out.fallen = out.fallen.max(-score);
    }
    out.hz.is_finite().then_some(out)
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
