//! Lines of a fixed frequency that wanders: those of another machine, whose motor slips with its
//! own load.
//!
//! A search bin by bin asks a line to stand still for the whole recording and to come back at the
//! same bin. A motor's speed wanders by some parts in a thousand. Here the power of what is left
//! when the train's own lines are taken out is compared with the reference in narrow bands: as wide
//! as such a line, narrow against every resonance.

use crate::read::dsp::median;
use crate::read::narrow;
use crate::read::scan::Twin;

/// Bands on each side whose median is what a path or a background changed by.
const AROUND: usize = 20;

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

/// Standard scores of one pair and channel, by band: beside what the bands about it changed by.
fn scores(twin: &Twin<'_>, name: &str, middles: &[f64]) -> Option<Vec<Option<f64>>> {
    let changes = narrow::changes(twin, name, middles)?;
    let about = |k: usize| {
        let near = k.saturating_sub(AROUND)..(k + AROUND + 1).min(changes.len());
        median(&mut changes[near].iter().flatten().map(|c| c.0).collect::<Vec<f64>>())
    };
    let standard = narrow::standard(&changes, about);
    Some(standard.into_iter().map(|band| band.map(|(off, sigma)| off / sigma)).collect())
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
    let middles = narrow::middles(rate);
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
