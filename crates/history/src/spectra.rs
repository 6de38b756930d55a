//! Order spectra of a log in short form: amplitudes as logarithms, one spectrum a channel and span
//! of time.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use serde::Deserialize;

/// Steps of a code in a decade: 1 part in 890 of an amplitude, finer than a screen shows.
const STEPS: f64 = 2047.0;
/// Decades below 1 that codes begin at; they end as many above.
const DECADES: f64 = 16.0;
/// More lines than any spectrum of the service has; a file that says so is none of it.
const MOST_LINES: usize = 100_000;

/// A spectrum as it stands in a log.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub(crate) struct LoggedSpectrum {
    #[serde(default)]
    pub(crate) bench: String,
    pub(crate) channel: String,
    #[serde(default)]
    pub(crate) unit: String,
    pub(crate) t0_ns: i64,
    order: Vec<f64>,
    amplitude: Vec<Option<f64>>,
}

/// A spectrum that is kept.
#[derive(Clone, Debug, PartialEq)]
pub struct Spectrum {
    /// Time of the first sample (ns since the epoch).
    pub t0_ns: i64,
    /// Order of the first line, in multiples of the input shaft's speed.
    pub first_order: f64,
    /// Distance between lines.
    pub order_step: f64,
    /// Unit of the amplitudes.
    pub unit: String,
    /// Peak amplitudes; 0 where none is known.
    pub amplitude: Vec<f32>,
}

impl LoggedSpectrum {
    /// None where the orders are no equal steps.
    pub(crate) fn kept(self) -> Option<Spectrum> {
        let (first, last) = (*self.order.first()?, *self.order.last()?);
        let lines = self.order.len();
        let order_step = (last - first) / (lines.max(2) - 1) as f64;
        let fits = (2..=MOST_LINES).contains(&lines) && lines == self.amplitude.len() && order_step > 0.0;
        let amplitude = self.amplitude.into_iter().map(|a| a.filter(|a| a.is_finite()).unwrap_or(0.0) as f32).collect();
        fits.then_some(Spectrum { t0_ns: self.t0_ns, first_order: first, order_step, unit: self.unit, amplitude })
    }
}

impl Spectrum {
    /// Everything but the time: unit, first order, step, and a code of two bytes for each line.
    pub(crate) fn encode(&self) -> Vec<u8> {
        let unit = &self.unit.as_bytes()[..self.unit.len().min(usize::from(u8::MAX))];
        let mut out = Vec::with_capacity(17 + unit.len() + 2 * self.amplitude.len());
        out.push(unit.len() as u8);
        out.extend_from_slice(unit);
        out.extend_from_slice(&self.first_order.to_le_bytes());
        out.extend_from_slice(&self.order_step.to_le_bytes());
        self.amplitude.iter().for_each(|&a| out.extend_from_slice(&code(a).to_le_bytes()));
        out
    }

    /// None where these are no such bytes.
    pub(crate) fn decode(t0_ns: i64, bytes: &[u8]) -> Option<Self> {
        let (&length, rest) = bytes.split_first()?;
        let (unit, rest) = rest.split_at_checked(usize::from(length))?;
        let (first, rest) = rest.split_first_chunk::<8>()?;
        let (step, rest) = rest.split_first_chunk::<8>()?;
        let codes = rest.as_chunks::<2>().0;
        Some(Self {
            t0_ns,
            first_order: f64::from_le_bytes(*first),
            order_step: f64::from_le_bytes(*step),
            unit: String::from_utf8_lossy(unit).into_owned(),
            amplitude: codes.iter().map(|code| amplitude(u16::from_le_bytes(*code))).collect(),
        })
    }
}

/// 0 for no amplitude; else its logarithm.
fn code(amplitude: f32) -> u16 {
    let level = (f64::from(amplitude).log10() + DECADES) * STEPS;
    if level.is_finite() { level.round().clamp(1.0, f64::from(u16::MAX)) as u16 } else { 0 }
}

fn amplitude(code: u16) -> f32 {
    if code == 0 { 0.0 } else { 10_f64.powf(f64::from(code) / STEPS - DECADES) as f32 }
}

/// The first spectrum of each channel in each span of time, by bench and channel.
#[derive(Clone, Debug, Default)]
pub(crate) struct Shelf {
    pub(crate) spectra: BTreeMap<(String, String), BTreeMap<i64, Spectrum>>,
}

impl Shelf {
    pub(crate) fn put(&mut self, every: i64, logged: LoggedSpectrum) {
        let at = logged.t0_ns.div_euclid(every) * every;
        let channel = self.spectra.entry((logged.bench.clone(), logged.channel.clone())).or_default();
        match channel.entry(at) {
            Entry::Occupied(mut kept) if logged.t0_ns < kept.get().t0_ns => {
                if let Some(spectrum) = logged.kept() {
                    kept.insert(spectrum);
                }
            }
            Entry::Vacant(free) => {
                if let Some(spectrum) = logged.kept() {
                    free.insert(spectrum);
                }
            }
            Entry::Occupied(_) => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The step of a code is a factor 10^(1/2047), so an amplitude comes back within half of it:
    /// 5.7e-4 and the digits of an f32.
    #[test]
    fn analytic_amplitudes_come_back_within_half_a_step() {
        let step = 10_f64.powf(0.5 / STEPS) - 1.0;
        for i in -150..150 {
            let a = (1.37 * 10_f64.powf(f64::from(i) / 10.0)) as f32;
            let back = amplitude(code(a));
            assert!((f64::from(back) / f64::from(a) - 1.0).abs() < step + 1e-6, "{a} {back}");
        }
        assert_eq!([0.0, -1.0, f32::NAN].map(|a| amplitude(code(a))), [0.0; 3]);
    }

    #[test]
    fn conform_a_spectrum_comes_back_and_a_cut_one_does_not() {
        let logged: LoggedSpectrum = serde_json::from_str(
            r#"{"bench":"b","channel":"a","unit":"m/s²","t0_ns":7,"order":[0.5,1.0,1.5],"amplitude":[1.0,null,0.01]}"#,
        )
        .expect("a spectrum");
        let spectrum = logged.kept().expect("equal steps");
        let bytes = spectrum.encode();
        let back = Spectrum::decode(7, &bytes).expect("its own bytes");
        assert_eq!((back.first_order, back.order_step, back.unit.as_str(), back.amplitude[1]), (0.5, 0.5, "m/s²", 0.0));
        assert_eq!(back.amplitude.len(), 3);
        assert!((0..22).all(|end| Spectrum::decode(7, &bytes[..end]).is_none()));
    }
}
