//! Whether the physics that was named predicts recordings that took no part in sizing it.
//!
//! The sheet's own train is simulated with and without the effects at every operating point. What adds to a machine has a phase that nothing tells, so powers add: a line of the
//! reference becomes `√(P + |J g|²)`, `J` what the effect adds in the model and `g` the gain from model to sensor, as the mesh harmonics of the reference have it. What alters
//! lines changes them by the ratio of the simulated amplitudes. A path is what the other recordings have in common at each frequency.

use gearwatch_core::bench::EffectSpec;
use gearwatch_sim::effects;
use gearwatch_sim::setup::SimSetup;
use gearwatch_sim::steady::{SteadyOptions, SteadySolver};

use crate::change::compare::LineChange;
use crate::change::locate::{self, Cell};
use crate::judge::report::Fit;
use crate::name::subname;
use crate::name::{Finding, Question};
use crate::read::dsp::median;
use crate::read::lines::Family;
use crate::score::calibration::PROFILES;

/// Largest squared residual of one line.
const CAP: f64 = 100.0;

/// The physical model against what was measured, over the pairs that sized it and over the last, which took no part.
pub fn held_out(q: &Question<'_>, cells: &[Cell], speeds: &[f64], findings: &[Finding]) -> Option<Fit> {
    if speeds.len() < 2 || findings.is_empty() {
        return None;
    }
    let held = speeds.len() - 1;
    let paths: Vec<&str> = findings.iter().filter(|f| subname::is_path(f.effect)).map(|f| f.place.as_str()).collect();
    let train: Vec<Cell> = cells.iter().filter(|c| c.pair != held).copied().collect();
    let specs: Vec<EffectSpec> = findings.iter().filter(|f| !subname::is_path(f.effect)).filter_map(spec).collect();
    let rises = findings.iter().any(|f| PROFILES.iter().any(|p| p.effect == f.effect && p.rises));
    if specs.is_empty() && paths.is_empty() {
        return None;
    }
    let plain = SimSetup::nominal(q.bench);
    let mut with = plain.clone();
    for s in &specs {
        effects::apply(s, &mut with).ok()?;
    }
    let mut sums = [0.0f64; 4];
    let mut counts = [0usize; 2];
    for pair in 0..speeds.len() {
        let lines: Vec<&LineChange> = q.comparison.lines.iter().filter(|l| l.pair == pair).collect();
        let machine =
            if specs.is_empty() { vec![0.0; lines.len()] } else { simulated(q, pair, &lines, (&plain, &with), rises)? };
        for (l, by_machine) in lines.iter().zip(machine) {
            let mut predicted = by_machine;
            if paths.iter().any(|p| *p == "housing" || *p == q.comparison.channels[l.channel]) {
                let cell = Cell {
                    pair,
                    channel: l.channel,
                    family: Some(l.family),
                    frequency_hz: l.frequency_hz,
                    change: l.log_ratio,
                    variance: l.variance,
                };
                let others: Vec<Cell> = train.iter().filter(|c| c.pair != pair).copied().collect();
                if let Some((p, v)) = locate::path_prediction(&cell, &others, speeds) {
                    predicted += p * p * p / (p * p + v).max(1e-12);
                }
            }
            let variance = l.variance + locate::repetition(q.comparison.pairs[pair].speed_gap);
            let side = usize::from(pair == held);
            sums[side] += (l.log_ratio * l.log_ratio / variance).min(CAP);
            sums[2 + side] += ((l.log_ratio - predicted).powi(2) / variance).min(CAP);
            counts[side] += 1;
        }
    }
    let rms = |sum: f64, n: usize| (sum / n.max(1) as f64).sqrt();
    Some(Fit {
        metric: "root mean square of ln(amplitude measured / modelled) over its standard deviation, all lines; before, the model is the reference, \
                 after, the reference with what the simulated effects do to each line; 1 or less is repetition"
            .into(),
        train_before: rms(sums[0], counts[0]),
        train_after: rms(sums[2], counts[0]),
        held_out_before: rms(sums[1], counts[1]),
        held_out_after: rms(sums[3], counts[1]),
        noise_floor: 1.0,
        held_out: vec![q.recordings[q.comparison.pairs[held].recording].name.clone()],
    })
}

fn spec(f: &Finding) -> Option<EffectSpec> {
    let effect = effects::find(f.effect).ok()?;
    let parameters = f
        .parameters
        .iter()
        .filter_map(|(name, value)| {
            let range = effect.parameters().iter().find(|p| p.name == name)?;
            Some((name.clone(), value.value.clamp(range.min, range.max)))
        })
        .collect();
    Some(EffectSpec { effect: f.effect.to_owned(), place: f.place.clone(), parameters })
}

/// ln of the ratio of amplitudes by which the effects change each line of a pair; `None` where the motion has no steady state.
fn simulated(
    q: &Question<'_>,
    pair: usize,
    lines: &[&LineChange],
    (plain, with): (&SimSetup, &SimSetup),
    rises: bool,
) -> Option<Vec<f64>> {
    let point = &q.comparison.pairs[pair];
    let motor_hz = q.recordings[point.recording].input_hz * q.train.motor_order;
    let orders: Vec<f64> = lines.iter().map(|l| l.order).collect();
    let mut solver = SteadySolver::new(SteadyOptions { samples_per_cycle: 128, tolerance: 1e-3, together: false });
    let before = solver.solve(plain, motor_hz, point.torque_nm, 1, &orders).ok()?;
    let after = solver.solve(with, motor_hz, point.torque_nm, 1, &orders).ok()?;
    let mut out = vec![0.0; lines.len()];
    for (c, name) in q.comparison.channels.iter().enumerate() {
        let Some(sensor) = q.bench.sensors.iter().position(|s| s.name == *name) else { continue };
        let (x, y) = (&before.sensors[sensor], &after.sensors[sensor]);
        let mut levels: Vec<f64> = lines
            .iter()
            .enumerate()
            .filter(|(i, l)| l.channel == c && matches!(l.family, Family::Mesh { .. }) && x[*i].norm() > 0.0)
            .filter(|(_, l)| l.reference_power > 4.0 * l.noise)
            .map(|(i, l)| 0.5 * (l.reference_power / x[i].norm_sqr()).ln())
            .collect();
        if levels.is_empty() {
            continue;
        }
        let gain = median(&mut levels).exp();
        for (i, l) in lines.iter().enumerate().filter(|(_, l)| l.channel == c) {
            let mesh = matches!(l.family, Family::Mesh { .. });
            out[i] = if rises || !mesh {
                let added = (y[i] - x[i]).norm_sqr() * gain * gain;
                0.5 * (added / l.reference_power.max(l.noise)).ln_1p()
            } else if x[i].norm() > 0.0 && y[i].norm() > 0.0 {
                (y[i].norm() / x[i].norm()).ln()
            } else {
                0.0
            };
        }
    }
    Some(out)
}
