//! Sizes of named effects: how large the simulator's own effect must be to give the power that came
//! up in its lines.
//!
//! The steady state of the sheet's bench is solved with and without the effect at its typical size;
//! the difference `J` is what the effect adds to each line ahead of the unknown path. The path's
//! level is read from the mesh harmonics of the reference against the model's. With unknown phases
//! between old and new parts of a line, powers add on average: `s² Σ|J g|² = Σ (P − P_ref)`. What
//! the lumped path leaves open is a factor of about 1.6, and it stays in the sigma.

use std::collections::BTreeMap;

use gearwatch_core::bench::EffectSpec;
use gearwatch_core::estimate::Estimate;
use gearwatch_sim::effects;
use gearwatch_sim::setup::SimSetup;
use gearwatch_sim::steady::{SteadyOptions, SteadySolver};

use crate::change::locate::{self, Place};
use crate::question::Question;
use crate::read::dsp::median;
use crate::read::lines::Family;

/// Standard uncertainty of a size (relative): path level by line, and the model's own error.
const SIZE_SIGMA: f64 = 0.65;

/// Effects whose lines grow in proportion to a parameter: name and a size within the linear range.
const SCALED: &[(&str, &str, f64)] = &[
    ("eccentricity", "runout_um", 20.0),
    ("pitch_error", "total_um", 25.0),
    ("ghost_component", "amplitude_um", 1.0),
    ("unbalance", "amount_kg_m", 2e-4),
    ("tooth_breakage", "fraction", 0.5),
];

/// The size of an effect, where it can be told: parameter name and estimate.
pub fn estimate(
    q: &Question<'_>,
    effect: &str,
    place: &str,
    known: &BTreeMap<String, Estimate>,
    mask: Place,
) -> Option<(&'static str, Estimate)> {
    let &(_, parameter, unit_size) = SCALED.iter().find(|s| s.0 == effect)?;
    let mut parameters: BTreeMap<String, f64> = BTreeMap::from([(parameter.to_owned(), unit_size)]);
    for name in ["order"] {
        if let Some(e) = known.get(name) {
            parameters.insert(name.to_owned(), e.value);
        }
    }
    let spec = EffectSpec { effect: effect.to_owned(), place: place.to_owned(), parameters };
    let plain = SimSetup::nominal(q.bench);
    let mut with = plain.clone();
    effects::apply(&spec, &mut with).ok()?;
    let options = SteadyOptions { samples_per_cycle: 256, tolerance: 1e-3, together: false, parting: false };
    let mut sizes = Vec::new();
    for (p, pair) in q.comparison.pairs.iter().enumerate() {
        let rec = &q.recordings[pair.recording];
        let lines: Vec<_> = q.comparison.lines.iter().filter(|l| l.pair == p).collect();
        let orders: Vec<f64> = lines.iter().map(|l| l.order).collect();
        let motor_hz = rec.input_hz * q.train.motor_order;
        let mut solver = SteadySolver::new(options);
        let Ok(before) = solver.solve(&plain, motor_hz, pair.torque_nm, 1, &orders) else { continue };
        let Ok(after) = solver.solve(&with, motor_hz, pair.torque_nm, 1, &orders) else { continue };
        for (c, name) in q.comparison.channels.iter().enumerate() {
            let Some(sensor) = q.bench.sensors.iter().position(|s| s.name == *name) else { continue };
            let mut levels: Vec<f64> = Vec::new();
            let (mut risen, mut modelled) = (0.0, 0.0);
            for (i, line) in lines.iter().enumerate().filter(|(_, l)| l.channel == c) {
                if matches!(line.family, Family::Mesh { .. }) {
                    let model = before.sensors[sensor][i].norm_sqr();
                    if model > 0.0 && line.reference_power > 4.0 * line.noise {
                        levels.push(0.5 * (line.reference_power / model).ln());
                    }
                } else if locate::covers(mask, Some(line.family)) {
                    risen += line.power - line.reference_power;
                    modelled += (after.sensors[sensor][i] - before.sensors[sensor][i]).norm_sqr();
                }
            }
            if levels.len() < 3 || modelled <= 0.0 || risen <= 0.0 {
                continue;
            }
            let gain = median(&mut levels).exp();
            sizes.push(0.5 * (risen / (modelled * gain * gain)).ln());
        }
    }
    if sizes.is_empty() {
        return None;
    }
    let count = sizes.len() as f64;
    let middle = median(&mut sizes);
    let mut deviations: Vec<f64> = sizes.iter().map(|s| (s - middle).abs()).collect();
    let scatter = 1.4826 * median(&mut deviations) / count.sqrt();
    let mut value = unit_size * middle.exp();
    if effect == "tooth_breakage" {
        value = value.clamp(0.05, 1.0);
    }
    Some((parameter, Estimate::new(value, value * (SIZE_SIGMA * SIZE_SIGMA + scatter * scatter).sqrt())))
}
