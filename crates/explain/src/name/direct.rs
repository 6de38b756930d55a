//! Findings that need no comparison of lines: the data themselves, tooth numbers, speeds.

use crate::finding::Finding;
use crate::judge::report::Fit;
use crate::question::Question;
use crate::read::dsp::{mean, median};
use crate::read::ratio::{CREEP, DISPLAY_SIGMA};

/// Sample clocks of good converters stay within 20 ppm; beyond three times that the clock is named.
const CLOCK_PPM: f64 = 60.0;
/// Least standard deviation of a clock's error (ppm).
const CLOCK_SIGMA_PPM: f64 = 12.0;
/// Standard deviations at which a speed ratio is believed.
const RATIO_Z: f64 = 4.0;
/// Slip of an induction motor at full load, at most (relative): design B of NEMA MG 1.
const MOST_SLIP: f64 = 0.05;
/// Log odds of belt slip against a wrong clock from which the other is not kept in the set.
const LARGE_ODDS: f64 = 4.5;

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

/// How much a sample clock runs fast by which all speeds appear this much too low: `1/(1 + ε) = 1 −
/// d`.
fn fast(low: f64) -> f64 {
    low / (1.0 - low)
}

/// Slip of the recordings of one session less what their sample clock is off, which must not pass
/// for slip. A clock is one for a session: recordings whose own lines do not show it against the
/// tacho have the error of the others.
fn without_clock(slip: &[f64], clock: &[f64]) -> Vec<f64> {
    let mut seen: Vec<f64> = clock.iter().copied().filter(|c| c.is_finite()).collect();
    let session = if seen.is_empty() { 0.0 } else { median(&mut seen) };
    let of = |c: f64| if c.is_finite() { c } else { session };
    let known = |c: f64| if c.abs() * 1e6 > CLOCK_PPM { c } else { 0.0 };
    slip.iter().zip(clock).map(|(s, c)| s + known(of(*c))).collect()
}

fn speeds(q: &Question<'_>, out: &mut Vec<Finding>, steps: &mut Vec<String>) {
    let n = q.recordings.len();
    let mut clocks: Vec<f64> = q.ratios.clock[..n].iter().copied().filter(|c| c.is_finite()).collect();
    let clock = if clocks.is_empty() { f64::NAN } else { median(&mut clocks) };
    let clock_known = clock.is_finite();
    if clock_known {
        steps.push(format!("gear lines against tacho: {:+.0} ppm", clock * 1e6));
        let spread = clocks.iter().map(|c| (c - clock).abs()).fold(0.0, f64::max) * 1e6;
        let sigma_ppm = (0.5 * spread).max(CLOCK_SIGMA_PPM);
        if clock.abs() * 1e6 > CLOCK_PPM.max(RATIO_Z * sigma_ppm) {
            let mut f = Finding::new("clock_offset", "acquisition", 0.95).with("ppm", 1e6 * fast(-clock), sigma_ppm);
            f.evidence.place = format!("all gear lines lie {:+.0} ppm off the tacho", clock * 1e6);
            f.evidence.law = "the same at every speed and load".into();
            out.push(f);
        }
    }
    let mut corrected = without_clock(&q.ratios.slip[..n], &q.ratios.clock[..n]);
    corrected.extend(without_clock(&q.ratios.slip[n..], &q.ratios.clock[n..]));
    let slip = &corrected[..n];
    let Some((mean, count)) = mean_finite(slip.iter().copied()) else { return };
    let reference = mean_finite(corrected[n..].iter().copied());
    let base = reference.map_or(if q.bench.belt.is_some() { CREEP } else { 0.0 }, |r| r.0);
    let base_variance = reference.map_or(2e-4f64.powi(2), |r| DISPLAY_SIGMA.powi(2) / r.1 as f64);
    let (slope, constant) = (law(q, slip, base, true), law(q, slip, base, false));
    // Where no law brings the speeds together (a speed that swings), they tell less by as much as
    // they scatter about the better one (Birge ratio).
    let freedom = count.saturating_sub(1).max(1) as f64;
    let scatter = (slope.misfit.min(constant.misfit) / freedom).max(1.0);
    let sigma = (scatter * DISPLAY_SIGMA.powi(2) / count as f64 + base_variance).sqrt();
    let odds = 0.5 * (constant.misfit - slope.misfit) / scatter;
    let excess = mean - base;
    steps.push(format!(
        "input shaft behind the drive display: {:.3} % (usual up to {:.3} %)",
        100.0 * mean,
        100.0 * (base + 2.0 * sigma)
    ));
    if excess.abs() < RATIO_Z * sigma + 3e-4 {
        return;
    }
    if q.bench.belt.is_some() && excess > 0.0 {
        // A clock that the tacho shows to be right leaves slip.
        let odds = if clock_known { f64::INFINITY } else { odds };
        let slipping = 1.0 / (1.0 + (-odds).exp());
        steps.push(format!(
            "speed against display: slip in proportion to torque leaves χ² = {:.1}, a wrong clock {:.1} ({count} recordings)",
            slope.misfit, constant.misfit
        ));
        let floor = |sigma: f64| (scatter * sigma.powi(2) + base_variance).sqrt();
        let slipped = |p: f64| {
            Finding::new("belt_slip", "belt", p.min(0.96)).with(
                "slip_percent",
                100.0 * slope.value,
                100.0 * floor(slope.sigma).hypot(2e-4),
            )
        };
        let fast_by = 1e6 * fast(constant.value);
        let clocked = |p: f64| {
            Finding::new("clock_offset", "acquisition", p.min(0.96)).with("ppm", fast_by, 1e6 * floor(constant.sigma))
        };
        let (mut f, other) = if slipping >= 0.5 {
            (slipped(slipping), ("clock_offset", "acquisition".to_owned()))
        } else if out.iter().any(|f| f.effect == "clock_offset") {
            return;
        } else {
            (clocked(1.0 - slipping), ("belt_slip", "belt".to_owned()))
        };
        f.evidence.place = format!("all gear orders lie {:.2} % below the motor's display", 100.0 * mean);
        f.evidence.law = if clock_known {
            "the tacho says that the clock is right".into()
        } else if f.effect == "belt_slip" {
            format!("grows with the torque: likelier than constant by {:.1} nats", odds)
        } else {
            format!("the same at every load: likelier than in proportion to the torque by {:.1} nats", -odds)
        };
        if odds.abs() < LARGE_ODDS {
            f.alternatives.push(other);
        }
        out.push(f);
    } else if !clock_known || clock.abs() * 1e6 > CLOCK_PPM {
        if out.iter().any(|f| f.effect == "clock_offset") {
            return;
        }
        // Behind the display without a reference: a motor that slips, in proportion to its torque,
        // unless the loads say that it does not.
        if q.bench.belt.is_none() && excess > 0.0 && excess < MOST_SLIP && reference.is_none() {
            steps.push(format!("behind the display by {:.2} %: the slip of the motor, unless the clock is likelier by {LARGE_ODDS} nats; it is by {:.1}", 100.0 * excess, -odds));
            if -odds < LARGE_ODDS {
                return;
            }
        }
        let mut f = Finding::new("clock_offset", "acquisition", 0.85).with("ppm", 1e6 * fast(excess), 1e6 * sigma);
        f.evidence.place = format!("all gear lines lie {:.2} % off the drive display", -100.0 * excess);
        out.push(f);
    }
}

/// Speed behind the display by one law.
struct SpeedLaw {
    /// At the highest torque.
    value: f64,
    sigma: f64,
    /// χ² that it leaves.
    misfit: f64,
}

/// Fits the speeds behind the display: in proportion to the torque (a belt slips more the more it
/// carries: PHYSICS 4) or all the same (a clock). Both laws have one number, so that their
/// likelihoods may be compared as they are.
fn law(q: &Question<'_>, slip: &[f64], base: f64, with_torque: bool) -> SpeedLaw {
    let highest = q.recordings.iter().map(|r| r.brake_torque_nm).fold(0.0, f64::max);
    // An unknown torque counts as the highest.
    let share = |torque: f64| if with_torque && highest > 0.0 && torque.is_finite() { torque / highest } else { 1.0 };
    let points: Vec<(f64, f64)> = q
        .recordings
        .iter()
        .zip(slip)
        .filter(|(_, s)| s.is_finite())
        .map(|(r, s)| (share(r.brake_torque_nm), s - base))
        .collect();
    let (xy, xx) = points.iter().fold((0.0, 0.0), |(a, b), (x, y)| (a + x * y, b + x * x));
    let value = xy / xx;
    let misfit = points.iter().map(|(x, y)| ((y - value * x) / DISPLAY_SIGMA).powi(2)).sum();
    SpeedLaw { value, sigma: DISPLAY_SIGMA / xx.sqrt(), misfit }
}

/// Whether lines may be compared one by one: not at another speed, and not where every channel is
/// clipped. A wrong sample clock moves no line over shaft angle.
pub fn comparable(q: &Question<'_>, findings: &[Finding]) -> bool {
    let clipped = |c: &String| findings.iter().any(|f| f.effect == "clipping" && f.place == *c);
    !slips(findings) && q.comparison.channels.iter().any(|c| !clipped(c))
}

/// Whether the belt slips, so that speeds differ from those of the reference.
pub fn slips(findings: &[Finding]) -> bool {
    findings.iter().any(|f| f.effect == "belt_slip")
}

/// What can be said without a reference beyond the direct findings.
pub fn without_reference(q: &Question<'_>, findings: &mut Vec<Finding>, steps: &mut Vec<String>) {
    // A limit spoils phases. Slip moves the speeds apart that are subtracted, by less than what a
    // resonance is wide; the phases of one damaged tooth stay even.
    let spoilt = findings.iter().any(|f| f.effect == "clipping");
    if !spoilt && let Some(f) = crate::name::gear::lone_tooth(q, steps) {
        findings.push(f);
        return;
    }
    let known = findings.len();
    // A bearing in the envelope would have been named, and nothing asked here.
    findings.extend(crate::name::ghost::ghost(q, None, steps));
    if !spoilt && findings.len() == known {
        findings.extend(crate::name::mates::pitch_error(q, steps));
    }
    // A ripple leaves the first order as it is, while what happens once a turn may lift others of
    // the row.
    if !spoilt && findings.len() == known {
        findings.extend(crate::name::first::run_out(q, steps));
    }
    // Unbalance is a force of its own, beside errors of the teeth too.
    if !spoilt && findings[known..].iter().all(|f| f.effect == "pitch_error") {
        findings.extend(crate::name::first::unbalance(q, steps));
    }
    if findings.len() == known {
        findings.extend(crate::name::alone::ripple(q, steps));
    }
    if !spoilt && findings.len() == known {
        findings.extend(crate::name::gear::faint_lone_tooth(q, steps));
    }
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
        beside: Vec::new(),
        sham: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A clock that is fast by 5400 ppm takes as much off the speeds of all recordings of its
    /// session, also of the one whose lines do not show it; one that is right to 20 ppm takes
    /// nothing.
    #[test]
    fn analytic_a_session_has_one_clock() {
        let fast = without_clock(&[5.9e-3, 5.9e-3, 6.0e-3], &[-5.4e-3, f64::NAN, -5.4e-3]);
        assert!(fast.iter().zip([5e-4, 5e-4, 6e-4]).all(|(s, e)| (s - e).abs() < 1e-12), "{fast:?}");
        assert_eq!(without_clock(&[5e-4, 6e-4], &[2e-5, f64::NAN]), [5e-4, 6e-4]);
        assert_eq!(without_clock(&[5e-4], &[f64::NAN]), [5e-4]);
    }
}
