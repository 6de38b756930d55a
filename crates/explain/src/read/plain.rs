//! The plain spectrum of a recording, as any analyser shows it: what a person sees before anything
//! was explained.

use std::f64::consts::PI;

use gearwatch_core::recording::Recording;

use crate::read::dsp::Transforms;

/// Length of the averaged windows (s): lines 1.5 Hz apart are told apart.
const WINDOW_S: f64 = 1.0;

/// An averaged spectrum.
#[derive(Clone, Debug, PartialEq)]
pub struct PlainSpectrum {
    /// Distance of the bins (Hz).
    pub hz_per_bin: f64,
    /// Root of the mean square over all windows, so scaled that a sine shows its peak amplitude;
    /// from 0 Hz on.
    pub amplitudes: Vec<f64>,
    /// Windows that were averaged, half overlapping.
    pub windows: usize,
}

/// Hann windows of one second, half overlapping, averaged in power (Welch 1967); `None` where the
/// channel is missing or shorter.
pub fn spectrum(transforms: &mut Transforms, recording: &Recording, channel: &str) -> Option<PlainSpectrum> {
    let channel = recording.channels.get(channel)?;
    let len = (WINDOW_S * channel.sample_rate_hz).round() as usize;
    if len < 4 {
        return None;
    }
    let hann: Vec<f64> = (0..len).map(|n| 0.5 - 0.5 * (2.0 * PI * n as f64 / len as f64).cos()).collect();
    // A sine of amplitude A shows A/2 times the sum of the window.
    let scale = 2.0 / hann.iter().sum::<f64>();
    let mut power = vec![0.0; len / 2 + 1];
    let mut windows = 0usize;
    for segment in &channel.segments {
        for start in (0..).map(|k| k * len / 2).take_while(|start| start + len <= segment.samples.len()) {
            let mut samples: Vec<f64> =
                segment.samples[start..start + len].iter().zip(&hann).map(|(x, w)| x * w).collect();
            let bins = transforms.forward_real(&mut samples);
            power.iter_mut().zip(&bins).for_each(|(sum, bin)| *sum += (bin * scale).norm_sqr());
            windows += 1;
        }
    }
    let amplitudes = power.iter().map(|p| (p / windows as f64).sqrt()).collect();
    (windows > 0).then(|| PlainSpectrum { hz_per_bin: channel.sample_rate_hz / len as f64, amplitudes, windows })
}

#[cfg(test)]
mod tests {
    use super::*;
    use gearwatch_core::block::Quality;
    use gearwatch_core::recording::{Channel, Segment};

    /// A sine shows its amplitude at its frequency, and white noise of standard deviation s shows
    /// `s √(2 · 1.5 · 2/N)` peak: 1.5 bins is the noise bandwidth of the window.
    #[test]
    fn analytic_a_sine_shows_its_amplitude() {
        let rate = 1024.0;
        let samples = (0..4096).map(|n| 0.7 * (2.0 * PI * 100.0 * f64::from(n) / rate).sin()).collect();
        let segment = Segment { t0: 0, first_sample_index: 0, samples, quality: Quality::GOOD };
        let mut recording = Recording::default();
        recording
            .channels
            .insert("a".into(), Channel { sample_rate_hz: rate, unit: "m/s^2".into(), segments: vec![segment] });
        let found = spectrum(&mut Transforms::default(), &recording, "a").unwrap();
        assert_eq!((found.windows, found.hz_per_bin), (7, 1.0));
        assert!((found.amplitudes[100] - 0.7).abs() < 1e-9, "{}", found.amplitudes[100]);
        assert!(found.amplitudes[110] < 1e-9);
        assert!(spectrum(&mut Transforms::default(), &recording, "b").is_none());
    }
}
