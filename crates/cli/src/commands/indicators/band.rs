//! Which band of a recording rings: its kurtogram.

use std::io::Write;
use std::path::Path;

use gearwatch_core::estimate::Estimate;
use gearwatch_core::indicators::envelope::Band;
use gearwatch_core::indicators::kurtogram;
use gearwatch_core::pipeline::PipelineConfig;

use crate::input::InputOptions;
use crate::terminal;

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
    Ok(kurtogram::bands(&mut options.open(path)?, config)?)
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
