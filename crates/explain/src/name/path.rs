//! A changed sensor path, gain or mounting: the same function of frequency for lines and background at every speed.

use std::collections::BTreeMap;

use gearwatch_core::estimate::Estimate;

use crate::change::locate::Cell;
use crate::read::dsp::median;

/// A form of a path's change over frequency.
#[derive(Clone, Debug)]
pub struct Form {
    /// Effect id.
    pub effect: &'static str,
    /// What it is ahead of the best form (nats, not above 0).
    pub nats: f64,
    /// Its numbers.
    pub parameters: BTreeMap<String, Estimate>,
}

/// Share of a band's misfit that counts: neighbouring bands share what the path does.
const BANDS_COUNT: f64 = 0.25;
/// What each number of a form costs (nats).
const NUMBER: f64 = 1.5;

/// The forms that a changed path may have, each with what it leaves of the change over frequency.
pub fn forms(cells: &[Cell], channel: usize) -> Vec<Form> {
    let profile = profile(cells, channel);
    if profile.is_empty() {
        return Vec::new();
    }
    let (mounting, resonance) = (mounting_fit(&profile), resonance_fit(&profile));
    let mut changes: Vec<f64> = cells.iter().filter(|x| x.channel == channel).map(|x| x.change).collect();
    let factor = median(&mut changes).exp();
    let doubt = |left: f64| (1.0 + left).sqrt();
    let estimates = |all: &[(&str, f64, f64)]| -> BTreeMap<String, Estimate> {
        all.iter().map(|(name, value, sigma)| ((*name).to_owned(), Estimate::new(*value, *sigma))).collect()
    };
    let all = [
        ("scaling", one_factor_misfit(&profile), 1.0, estimates(&[("factor", factor, 0.02 * factor)])),
        (
            "sensor_mounting",
            mounting.left,
            3.0,
            estimates(&[
                ("frequency_hz", mounting.frequency_hz, 0.05 * doubt(mounting.left) * mounting.frequency_hz),
                ("gain", mounting.gain, 0.1 * doubt(mounting.left) * mounting.gain),
            ]),
        ),
        (
            "structural_resonance",
            resonance.left,
            4.0,
            estimates(&[
                ("frequency_hz", resonance.frequency_hz, 0.03 * doubt(resonance.left) * resonance.frequency_hz),
                ("damping_ratio", resonance.damping, 0.5 * resonance.damping),
            ]),
        ),
    ];
    let bands = profile.len() as f64;
    let nats = |left: f64, numbers: f64| -0.5 * BANDS_COUNT * bands * left - NUMBER * numbers;
    let best = all.iter().map(|f| nats(f.1, f.2)).fold(f64::NEG_INFINITY, f64::max);
    all.into_iter()
        .map(|(effect, left, numbers, parameters)| Form { effect, nats: nats(left, numbers) - best, parameters })
        .collect()
}

/// Median change over frequency in sixths of an octave: (Hz, ln ratio, variance).
fn profile(cells: &[Cell], channel: usize) -> Vec<(f64, f64, f64)> {
    let mut out = Vec::new();
    let ratio = 2f64.powf(1.0 / 6.0);
    let mut low = 20.0;
    while low < 1e5 {
        let members: Vec<&Cell> = cells
            .iter()
            .filter(|c| c.channel == channel && c.frequency_hz >= low && c.frequency_hz < low * ratio)
            .collect();
        if members.len() >= 3 {
            let mut values: Vec<f64> = members.iter().map(|c| c.change).collect();
            let middle = median(&mut values);
            let mut spread: Vec<f64> = members.iter().map(|c| (c.change - middle).abs()).collect();
            let sigma = (1.4826 * median(&mut spread)).max(0.04);
            out.push((low * ratio.sqrt(), middle, sigma * sigma / members.len() as f64 + 0.03 * 0.03));
        }
        low *= ratio;
    }
    out
}

/// Misfit per band of one factor for all frequencies.
fn one_factor_misfit(profile: &[(f64, f64, f64)]) -> f64 {
    let (sum, weight) = profile.iter().fold((0.0, 0.0), |(s, w), p| (s + p.1 / p.2, w + 1.0 / p.2));
    let level = sum / weight.max(1e-12);
    robust(profile.iter().map(|p| (p.1 - level).powi(2) / p.2))
}

struct PathFit {
    frequency_hz: f64,
    damping: f64,
    gain: f64,
    left: f64,
}

/// `gain / |1 − (f/f0)² + 2iζ f/f0|`, the sensor on a spring (PHYSICS L11), searched on a grid.
fn mounting_fit(profile: &[(f64, f64, f64)]) -> PathFit {
    let mut best = PathFit { frequency_hz: f64::NAN, damping: 0.06, gain: 1.0, left: f64::INFINITY };
    for i in 0..120 {
        let f0 = 300.0 * (12_000.0f64 / 300.0).powf(f64::from(i) / 119.0);
        for damping in [0.02, 0.04, 0.06, 0.1, 0.16, 0.25] {
            let shape = |f: f64| {
                let r = f / f0;
                -0.5 * ((1.0 - r * r).powi(2) + (2.0 * damping * r).powi(2)).ln()
            };
            let (sum, weight) =
                profile.iter().fold((0.0, 0.0), |(s, w), p| (s + (p.1 - shape(p.0)) / p.2, w + 1.0 / p.2));
            let level = sum / weight.max(1e-12);
            let left = robust(profile.iter().map(|p| (p.1 - level - shape(p.0)).powi(2) / p.2));
            if left < best.left {
                best = PathFit { frequency_hz: f0, damping, gain: level.exp(), left };
            }
        }
    }
    best
}

/// `|1 + a H(f)|` of a mode at `f0` with complex share `a` in the response, searched on a grid.
fn resonance_fit(profile: &[(f64, f64, f64)]) -> PathFit {
    use num_complex::Complex64;
    let mut best = PathFit { frequency_hz: f64::NAN, damping: 0.03, gain: 1.0, left: f64::INFINITY };
    for i in 0..160 {
        let f0 = 80.0 * (6000.0f64 / 80.0).powf(f64::from(i) / 159.0);
        for damping in [0.01, 0.02, 0.03, 0.05, 0.08] {
            for size in [0.05, 0.1, 0.2, 0.4, 0.8, 1.6] {
                for turn in 0..8 {
                    let a = Complex64::from_polar(size, f64::from(turn) * std::f64::consts::FRAC_PI_4);
                    let left = robust(profile.iter().map(|p| {
                        let r = p.0 / f0;
                        let h = r * r / Complex64::new(1.0 - r * r, 2.0 * damping * r);
                        let model = (Complex64::new(1.0, 0.0) + a * h).norm().max(1e-3).ln();
                        (p.1 - model).powi(2) / p.2
                    }));
                    if left < best.left {
                        best = PathFit { frequency_hz: f0, damping, gain: size, left };
                    }
                }
            }
        }
    }
    best
}

/// Mean of squares, each limited: a few bands that follow something else do not decide.
fn robust(squares: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut n) = (0.0, 0usize);
    for s in squares {
        sum += s.min(25.0);
        n += 1;
    }
    sum / n.max(1) as f64
}
