//! Which band of a recording rings: its kurtogram.

use std::io::Write;
use std::path::Path;

use gearwatch_core::estimate::Estimate;
use gearwatch_core::indicators::columns::Mean;
use gearwatch_core::indicators::envelope::{Band, EnvelopeState};
use gearwatch_core::pipeline::PipelineConfig;
use gearwatch_core::source::Source;
use gearwatch_core::window::Window;

use crate::input::InputOptions;
use crate::terminal;

/// Windows that a kurtogram is averaged over, all channels together: enough for a scatter of a hundredth in the narrowest band.
const MOST_WINDOWS: usize = 256;

/// Bands that are told.
const TOLD: usize = 8;

/// `2000:4000`.
pub(super) fn parse(text: &str) -> Result<[f64; 2], String> {
    let ends = text.split_once(':').and_then(|(low, high)| Some([low.trim().parse().ok()?, high.trim().parse().ok()?]));
    match ends {
        Some([low, high]) if low >= 0.0 && high > low && f64::is_finite(high) => Ok([low, high]),
        _ => Err(format!("{text:?} is not a band; expected LOW:HIGH in Hz, such as 2000:4000")),
    }
}

/// Bands by falling kurtosis, which is the mean over windows and channels.
pub(super) fn of(path: &Path, options: &InputOptions, config: &PipelineConfig) -> anyhow::Result<Vec<Band>> {
    let mut source = options.open(path)?;
    let mut assembler = gearwatch_core::assemble::Assembler::new(&config.window, &[], None);
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

/// The bands that ring most.
pub(super) fn print(out: &mut impl Write, path: &Path, bands: &[Band]) -> anyhow::Result<()> {
    writeln!(
        out,
        "{}: kurtogram, bands by kurtosis of their envelope (0 in noise)",
        terminal::plain(&path.display().to_string())
    )?;
    for band in bands.iter().take(TOLD) {
        let Estimate { value, sigma } = band.kurtosis;
        writeln!(out, "  {:>8.0} to {:>8.0} Hz   {value:8.3} ± {sigma:.3}", band.low_hz, band.high_hz)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    #[test]
    fn conform_bands_are_read_or_refused() {
        assert_eq!(super::parse("2000:4000.5"), Ok([2000.0, 4000.5]));
        for wrong in ["", "2000", "4000:2000", "a:b", "1:inf", "-1:5", "nan:5"] {
            assert!(super::parse(wrong).is_err(), "{wrong}");
        }
    }
}
