//! Findings that need no comparison of lines: the data themselves, tooth numbers, speeds.

use crate::dsp::{mean, median};
use crate::name::{Finding, Question};
use crate::ratio::{CREEP, DISPLAY_SIGMA};
use crate::report::Fit;

/// Sample clocks of good converters stay within 20 ppm; beyond three times that the clock is named.
const CLOCK_PPM: f64 = 60.0;
/// Standard deviations at which a speed ratio is believed.
const RATIO_Z: f64 = 4.0;

/// Places that carry a gear on a shaft: pinion of the stage behind it, wheel of the stage before it.
pub fn gears_on(q: &Question<'_>, shaft: usize) -> Vec<String> {
    let mut out = Vec::new();
    if let Some(s) = q.train.stages.get(shaft) {
        out.push(format!("{}.pinion", s.name));
    }
    if let Some(s) = shaft.checked_sub(1).and_then(|i| q.train.stages.get(i)) {
        out.push(format!("{}.wheel", s.name));
    }
    out
}

/// Clipping, tooth numbers, belt slip, clock.
pub fn findings(q: &Question<'_>, steps: &mut Vec<String>) -> Vec<Finding> {
    let mut out = Vec::new();
    clipping(q, &mut out);
    if let Some(t) = q.teeth {
        let gear = if t.pinion { "pinion" } else { "wheel" };
        let stage = &q.train.stages[t.stage].name;
        let mut f =
            Finding::new("wrong_tooth_count", format!("{stage}.{gear}"), 0.97).with("teeth", f64::from(t.teeth), 0.3);
        f.evidence.place = format!(
            "with {} instead of {} teeth, mesh lines, sidebands and shaft orders meet lines in all recordings: {:.2} nats more per line",
            t.teeth, t.sheet, t.gain
        );
        steps.push(format!("tooth numbers: {stage}.{gear} has {} teeth, the sheet says {}", t.teeth, t.sheet));
        out.push(f);
    }
    speeds(q, &mut out, steps);
    out
}

fn clipping(q: &Question<'_>, out: &mut Vec<Finding>) {
    let names: Vec<&String> = q.recordings.iter().flat_map(|r| r.channels.iter().map(|c| &c.name)).collect();
    let mut seen: Vec<&String> = Vec::new();
    for name in names {
        if seen.contains(&name) {
            continue;
        }
        seen.push(name);
        let levels: Vec<f64> = q
            .recordings
            .iter()
            .flat_map(|r| r.channels.iter().filter(|c| c.name == *name).filter_map(|c| c.integrity.clipped_at))
            .collect();
        if levels.is_empty() {
            continue;
        }
        let mean = levels.iter().sum::<f64>() / levels.len() as f64;
        let spread = levels.iter().map(|l| (l - mean).abs()).fold(0.0, f64::max);
        let mut f = Finding::new("clipping", name.clone(), 0.97).with("level", mean, (0.002 * mean).max(spread));
        f.evidence.place =
            format!("samples of {name} pile up at ±{mean:.4} in {} of {} recordings", levels.len(), q.recordings.len());
        out.push(f);
    }
}

fn mean_finite(values: impl Iterator<Item = f64>) -> Option<(f64, usize)> {
    let kept: Vec<f64> = values.filter(|v| v.is_finite()).collect();
    (!kept.is_empty()).then(|| (kept.iter().sum::<f64>() / kept.len() as f64, kept.len()))
}

/// How much a sample clock runs fast by which all speeds appear this much too low: `1/(1 + ε) = 1 − d`.
fn fast(low: f64) -> f64 {
    low / (1.0 - low)
}

fn speeds(q: &Question<'_>, out: &mut Vec<Finding>, steps: &mut Vec<String>) {
    let n = q.recordings.len();
    let mut clocks: Vec<f64> = q.ratios.clock[..n].iter().copied().filter(|c| c.is_finite()).collect();
    let clock = if clocks.is_empty() { f64::NAN } else { median(&mut clocks) };
    let clock_known = clock.is_finite();
    if clock_known {
        steps.push(format!("gear lines against tacho: {:+.0} ppm", clock * 1e6));
        if clock.abs() * 1e6 > CLOCK_PPM {
            let spread = clocks.iter().map(|c| (c - clock).abs()).fold(0.0, f64::max) * 1e6;
            let mut f = Finding::new("clock_offset", "acquisition", 0.95).with(
                "ppm",
                1e6 * fast(-clock),
                (0.5 * spread).max(12.0),
            );
            f.evidence.place = format!("all gear lines lie {:+.0} ppm off the tacho", clock * 1e6);
            f.evidence.law = "the same at every speed and load".into();
            out.push(f);
        }
    }
    // What the sample clock is off must not pass for slip.
    let known = |c: f64| if c.is_finite() && c.abs() * 1e6 > CLOCK_PPM { c } else { 0.0 };
    let corrected: Vec<f64> = q.ratios.slip.iter().zip(&q.ratios.clock).map(|(s, c)| s + known(*c)).collect();
    let slip = &corrected[..n];
    let Some((mean, count)) = mean_finite(slip.iter().copied()) else { return };
    let reference = mean_finite(corrected[n..].iter().copied());
    let base = reference.map_or(if q.bench.belt.is_some() { CREEP } else { 0.0 }, |r| r.0);
    let base_variance = reference.map_or(2e-4f64.powi(2), |r| DISPLAY_SIGMA.powi(2) / r.1 as f64);
    let sigma = (DISPLAY_SIGMA.powi(2) / count as f64 + base_variance).sqrt();
    let excess = mean - base;
    steps.push(format!(
        "input shaft behind the drive display: {:.3} % (usual up to {:.3} %)",
        100.0 * mean,
        100.0 * (base + 2.0 * sigma)
    ));
    if excess.abs() < RATIO_Z * sigma + 3e-4 {
        return;
    }
    // Load: slip grows with torque, a wrong clock does not.
    let (mut low, mut high) = (f64::INFINITY, 0.0f64);
    for r in q.recordings {
        low = low.min(r.brake_torque_nm);
        high = high.max(r.brake_torque_nm);
    }
    let at = |torque: f64| {
        mean_finite(
            q.recordings
                .iter()
                .zip(slip)
                .filter(|(r, _)| (r.brake_torque_nm / torque - 1.0).abs() < 0.1)
                .map(|(_, s)| *s),
        )
    };
    let loaded = at(high);
    let grows = match (at(low), loaded) {
        (Some(a), Some(b)) if high > 1.3 * low => {
            (b.0 - a.0) / (DISPLAY_SIGMA * (1.0 / a.1 as f64 + 1.0 / b.1 as f64).sqrt())
        }
        _ => 0.0,
    };
    if q.bench.belt.is_some() && excess > 0.0 {
        let (value, n_high) = loaded.unwrap_or((mean, count));
        let sure = clock_known || grows > 3.0;
        let mut f = Finding::new("belt_slip", "belt", if sure { 0.96 } else { 0.7 }).with(
            "slip_percent",
            100.0 * (value - base),
            100.0 * (DISPLAY_SIGMA.powi(2) / n_high as f64 + base_variance + 2e-4f64.powi(2)).sqrt(),
        );
        f.evidence.place = format!("all gear orders lie {:.2} % below the motor's display", 100.0 * mean);
        f.evidence.law = format!("change from least to highest load: {grows:.1} standard deviations");
        if !sure {
            f.alternatives.push(("clock_offset", "acquisition".into()));
        }
        out.push(f);
    } else if !clock_known || clock.abs() * 1e6 > CLOCK_PPM {
        if out.iter().any(|f| f.effect == "clock_offset") {
            return;
        }
        let mut f = Finding::new("clock_offset", "acquisition", 0.85).with("ppm", 1e6 * fast(excess), 1e6 * sigma);
        f.evidence.place = format!("all gear lines lie {:.2} % off the drive display", -100.0 * excess);
        out.push(f);
    }
}

/// Whether lines may be compared one by one: not at another speed, and not where every channel is clipped. A wrong sample clock
/// moves no line over shaft angle.
pub fn comparable(q: &Question<'_>, findings: &[Finding]) -> bool {
    let clipped = |c: &String| findings.iter().any(|f| f.effect == "clipping" && f.place == *c);
    !findings.iter().any(|f| f.effect == "belt_slip") && q.comparison.channels.iter().any(|c| !clipped(c))
}

/// What can be said without a reference beyond the direct findings.
pub fn without_reference(q: &Question<'_>, findings: &mut Vec<Finding>, steps: &mut Vec<String>) {
    crate::alone::shaft_orders(q, findings, steps);
}

/// Speed ratios before and after, where the finding is one of speed.
pub fn ratio_fit(q: &Question<'_>, findings: &[Finding]) -> Option<Fit> {
    let f = findings.iter().find(|f| matches!(f.effect, "belt_slip" | "clock_offset"))?;
    let n = q.recordings.len();
    if n < 2 {
        return None;
    }
    let values: Vec<f64> = q.ratios.slip[..n].iter().map(|s| s - CREEP).collect();
    let torques: Vec<f64> = q.recordings.iter().map(|r| r.brake_torque_nm).collect();
    let held = n - 1;
    let model = |i: usize| -> f64 {
        let others = (0..n).filter(|k| *k != held && *k != i);
        if f.effect == "belt_slip" {
            let (xy, xx) =
                others.fold((0.0, 0.0), |(a, b), k| (a + values[k] * torques[k], b + torques[k] * torques[k]));
            if xx > 0.0 { xy / xx * torques[i] } else { 0.0 }
        } else {
            let kept: Vec<f64> = others.map(|k| values[k]).collect();
            mean(&kept)
        }
    };
    let rms = |members: Vec<f64>| {
        (members.iter().map(|v| v * v).sum::<f64>() / members.len().max(1) as f64).sqrt() / DISPLAY_SIGMA
    };
    Some(Fit {
        metric: "root mean square of the speed ratio's deviation from the sheet over the standard deviation of a drive display".into(),
        train_before: rms((0..held).map(|i| values[i]).collect()),
        train_after: rms((0..held).map(|i| values[i] - model(i)).collect()),
        held_out_before: rms(vec![values[held]]),
        held_out_after: rms(vec![values[held] - model(held)]),
        noise_floor: 1.0,
        held_out: vec![q.recordings[held].name.clone()],
    })
}
