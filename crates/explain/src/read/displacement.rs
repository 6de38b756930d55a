//! Displacement that a channel shows at the lowest frequencies, where no bench moves so far.
//!
//! Integrated twice, `x(f) = a(f) / (2π f)²`, the jumps and recoveries of a cable that lets go now
//! and then are tenths of a millimetre and more. A bench on soft mounts rocks too, and then every
//! sensor on it shows that: a channel is asked against the steadiest of the others.

use std::f64::consts::TAU;

use gearwatch_core::indicators::velocity;

use crate::read::dsp::{WINDOW_NOISE_BINS, median};
use crate::read::features::{ChannelFeatures, RecordingFeatures};

/// From here on (Hz): below it the drift of a sensor's supply counts for displacement.
const FIRST_HZ: f64 = 1.5;
/// rms from which a channel is asked (mm), how many times the steadiest other channel's it must be,
/// and what the only one must show: the sound channels of 71 benches of another generator show 0.27
/// at most, one on a loose cable 0.55 at least. What rocks a bench on soft mounts by so much as 2
/// mm at 1.5 Hz is seen by eye.
const MOVES_MM: f64 = 0.5;
const STEADIER: f64 = 5.0;
const LONE_MM: f64 = 2.0;

/// A channel that moves alone.
#[derive(Clone, Debug, PartialEq)]
pub struct Displaced {
    /// Its name.
    pub channel: String,
    /// Median over the recordings of its displacement (mm rms).
    pub mm: f64,
    /// The same of the steadiest other channel; `None` where there is no other.
    pub other_mm: Option<f64>,
}

impl Displaced {
    /// In words.
    pub fn describe(&self) -> String {
        let other = self.other_mm.map_or("there is no other".to_owned(), |mm| format!("another one {mm:.2} mm"));
        format!("{} shows {:.2} mm rms of displacement above {FIRST_HZ} Hz; {other}", self.channel, self.mm)
    }
}

/// Displacement (mm rms) of one channel; `None` where its unit is no acceleration.
fn displacement_mm(recording: &RecordingFeatures, channel: &ChannelFeatures) -> Option<f64> {
    let (mm_per_s2, true) = velocity::in_millimetres(&channel.unit)? else { return None };
    // The speed is steady: bins over shaft angle are bins over time.
    let squares = channel.order_spectrum.iter().enumerate().map(|(k, bin)| {
        let hz = k as f64 * recording.hz_per_bin;
        if hz < FIRST_HZ { 0.0 } else { bin.norm_sqr() / (TAU * hz).powi(4) }
    });
    Some(mm_per_s2 * (0.5 * squares.sum::<f64>() / WINDOW_NOISE_BINS).sqrt())
}

/// The channel that moves most against the others, where none of them does.
pub fn displaced(recordings: &[RecordingFeatures]) -> Option<Displaced> {
    let names = recordings.first()?.channels.iter().map(|c| c.name.as_str());
    let of = |name: &str| {
        let channel = |r: &RecordingFeatures| {
            let channel = r.channels.iter().find(|c| c.name == name)?;
            displacement_mm(r, channel)
        };
        let mut all: Vec<f64> = recordings.iter().filter_map(channel).collect();
        (!all.is_empty()).then(|| median(&mut all))
    };
    alone(&names.filter_map(|name| Some((name, of(name)?))).collect::<Vec<_>>())
}

/// Of channels and their displacement (mm).
fn alone(all: &[(&str, f64)]) -> Option<Displaced> {
    let (most, &(name, mm)) = all.iter().enumerate().max_by(|a, b| a.1.1.total_cmp(&b.1.1))?;
    let others = all.iter().enumerate().filter(|(k, _)| *k != most).map(|(_, (_, mm))| *mm);
    let other_mm = others.min_by(f64::total_cmp);
    let moves = match other_mm {
        Some(other) => mm > MOVES_MM && mm > STEADIER * other,
        None => mm > LONE_MM,
    };
    moves.then(|| Displaced { channel: name.to_owned(), mm, other_mm })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn analytic_one_channel_moves_alone_or_none_does() {
        assert_eq!(alone(&[("a", 0.9), ("b", 0.1)]).map(|d| d.channel), Some("a".to_owned()));
        // The bench rocks.
        assert_eq!(alone(&[("a", 0.9), ("b", 0.8)]), None);
        assert_eq!(alone(&[("a", 0.4), ("b", 0.01)]), None);
        assert_eq!(alone(&[("a", 0.9)]), None);
        assert!(alone(&[("a", 2.5)]).is_some());
        assert_eq!(alone(&[]), None);
    }
}
