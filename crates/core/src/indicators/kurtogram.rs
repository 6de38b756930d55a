//! Which bands of a recording ring: its kurtogram, averaged over windows and channels.

use crate::assemble::Assembler;
use crate::indicators::columns::Mean;
use crate::indicators::envelope::{Band, EnvelopeState};
use crate::pipeline::PipelineConfig;
use crate::source::Source;
use crate::window::Window;

/// Windows that a kurtogram is averaged over, all channels together: enough for a scatter of a
/// hundredth in the narrowest band.
const MOST_WINDOWS: usize = 256;

/// Bands by falling kurtosis, which is the mean over windows and channels. Empty where the
/// recording is shorter than a window.
///
/// # Errors
/// As the source.
pub fn bands<S: Source>(source: &mut S, config: &PipelineConfig) -> Result<Vec<Band>, S::Error> {
    let mut assembler = Assembler::new(&config.window, &[], None);
    let mut state: Option<EnvelopeState> = None;
    let mut sums: Vec<(Band, Mean)> = Vec::new();
    let mut windows = 0;
    let mut take = |window: &Window| {
        let n = window.samples.len();
        if windows == MOST_WINDOWS || state.as_ref().is_some_and(|state| !state.fits(n)) {
            return;
        }
        windows += 1;
        let state = state.get_or_insert_with(|| EnvelopeState::new(n));
        state.transform(&window.samples);
        let bands = state.kurtogram(window.sample_rate_hz, config.usable_band * window.sample_rate_hz);
        for band in bands {
            let same = |(known, _): &(Band, Mean)| known.low_hz == band.low_hz && known.high_hz == band.high_hz;
            match sums.iter().position(same) {
                Some(at) => sums[at].1.push(band.kurtosis),
                None => {
                    let mut mean = Mean::default();
                    mean.push(band.kurtosis);
                    sums.push((band, mean));
                }
            }
        }
    };
    while let Some(packet) = source.next_packet()? {
        let mut ready = Vec::new();
        assembler.push(&packet, &mut |window| ready.push(window));
        ready.iter().for_each(&mut take);
    }
    let mut out: Vec<Band> =
        sums.into_iter().map(|(band, mean)| Band { kurtosis: mean.estimate(0.5), ..band }).collect();
    out.retain(|band| band.kurtosis.is_known());
    out.sort_by(|a, b| b.kurtosis.value.total_cmp(&a.kurtosis.value));
    Ok(out)
}
