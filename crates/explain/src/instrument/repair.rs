//! Takes instrument faults out of a recording, so that physics is asked about the machine alone.

use gearwatch_core::block::Quality;
use gearwatch_core::recording::{Channel, Recording, Segment};

use super::cross::Wiring;

/// Where a run is cut: samples from `from` to `to` are left out, and `lost` more are missing there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cut {
    /// First sample that is left out.
    pub from: usize,
    /// First sample after it.
    pub to: usize,
    /// Samples that were never recorded; negative where there are too many.
    pub lost: i64,
}

/// The longest run of all channels over the samples that they have in common.
pub fn common_run<'a>(recording: &'a Recording, sensors: &[&str]) -> Vec<(&'a str, &'a [f64])> {
    let runs: Vec<(&str, &Segment)> = recording
        .channels
        .iter()
        .filter(|(name, _)| sensors.contains(&name.as_str()))
        .filter_map(|(name, c)| Some((name.as_str(), c.segments.iter().max_by_key(|s| s.samples.len())?)))
        .collect();
    let first = runs.iter().map(|(_, s)| s.first_sample_index).max().unwrap_or(0);
    let last = runs.iter().map(|(_, s)| s.first_sample_index + s.samples.len() as u64).min().unwrap_or(0);
    if last <= first {
        // Counters of their own: each from its own beginning.
        let len = runs.iter().map(|(_, s)| s.samples.len()).min().unwrap_or(0);
        return runs.into_iter().map(|(name, s)| (name, &s.samples[..len])).collect();
    }
    runs.into_iter()
        .map(|(name, s)| {
            let from = (first - s.first_sample_index) as usize;
            (name, &s.samples[from..from + (last - first) as usize])
        })
        .collect()
}

/// Cuts the longest run of every channel at the same samples.
pub fn cut(recording: &mut Recording, cuts: &[Cut]) {
    for channel in recording.channels.values_mut() {
        cut_channel(channel, cuts);
    }
}

fn cut_channel(channel: &mut Channel, cuts: &[Cut]) {
    let Some(longest) = (0..channel.segments.len()).max_by_key(|i| channel.segments[*i].samples.len()) else { return };
    let whole = channel.segments.remove(longest);
    let mut parts = Vec::new();
    let (mut from, mut lost) = (0usize, 0i64);
    let mut part = |from: usize, to: usize, lost: i64| {
        if from < to && to <= whole.samples.len() {
            let offset = from as i64 + lost;
            parts.push(Segment {
                t0: whole.t0 + (offset as f64 * 1e9 / channel.sample_rate_hz).round() as i64,
                first_sample_index: whole.first_sample_index.saturating_add_signed(offset),
                samples: whole.samples[from..to].to_vec(),
                quality: whole.quality | if from > 0 { Quality::GAP_BEFORE } else { Quality::GOOD },
            });
        }
    };
    for c in cuts {
        part(from, c.from.min(whole.samples.len()), lost);
        from = c.to;
        lost += c.lost;
    }
    part(from, whole.samples.len(), lost);
    for (k, segment) in parts.into_iter().enumerate() {
        channel.segments.insert(longest + k, segment);
    }
}

/// Gives the channels their places and signs back; `names` in the order of the wiring.
pub fn rewire(recording: &mut Recording, names: &[String], wiring: &Wiring) {
    let taken: Vec<Option<Channel>> = names.iter().map(|n| recording.channels.remove(n)).collect();
    for ((name, from), sign) in names.iter().zip(&wiring.from).zip(&wiring.sign) {
        if let Some(mut channel) = taken[*from].clone() {
            scale(&mut channel, *sign);
            recording.channels.insert(name.clone(), channel);
        }
    }
}

/// Multiplies all samples of a channel.
pub fn scale(channel: &mut Channel, factor: f64) {
    channel.segments.iter_mut().flat_map(|s| &mut s.samples).for_each(|x| *x *= factor);
}
