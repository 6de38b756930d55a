//! What stands between the lines: the background in bands.

use num_complex::Complex64;

use super::USABLE_BAND;

/// Floor bands per octave.
const BANDS_PER_OCTAVE: f64 = 6.0;
/// Lower edge of the first floor band (Hz).
const FIRST_BAND_HZ: f64 = 50.0;

/// Background between the lines in one band.
#[derive(Clone, Copy, Debug)]
pub struct FloorBand {
    /// Middle of the band (Hz).
    pub frequency_hz: f64,
    /// Mean power of one hertz: that of a bin is the less, the longer the recording.
    pub power: f64,
    /// Bins that were read.
    pub bins: usize,
}

/// The value below which a quarter lies; `NaN` of nothing. Lines that nobody listed sit in the
/// upper part of a band, its lower quartile is noise: −ln 0.75 of the mean of an exponential
/// distribution.
fn lower_quartile(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let at = values.len() / 4;
    let (_, quartile, _) = values.select_nth_unstable_by(at, f64::total_cmp);
    *quartile
}

/// Background in sixths of an octave, between the lines.
pub fn bands(spectrum: &[Complex64], taken: &[bool], hz_per_bin: f64, rate: f64) -> Vec<FloorBand> {
    let mut out = Vec::new();
    let ratio = 2f64.powf(1.0 / BANDS_PER_OCTAVE);
    let mut low = FIRST_BAND_HZ;
    while low * ratio < USABLE_BAND * rate {
        let (a, b) = ((low / hz_per_bin) as usize, ((low * ratio / hz_per_bin) as usize).min(spectrum.len()));
        let mut powers: Vec<f64> = (a..b).filter(|&k| !taken[k]).map(|k| spectrum[k].norm_sqr()).collect();
        let bins = powers.len();
        out.push(FloorBand {
            frequency_hz: low * ratio.sqrt(),
            power: lower_quartile(&mut powers) / (-(0.75f64.ln()) * hz_per_bin),
            bins,
        });
        low *= ratio;
    }
    out
}
