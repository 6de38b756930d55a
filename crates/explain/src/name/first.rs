//! What happens once a turn, without a reference: run-out and unbalance.
//!
//! The errors of a sound gear's teeth put something on every sideband of its shaft, and accumulated pitch errors a row of orders. Run-out raises the first sidebands of its own
//! gear above the second and third, through a path that all of them share; unbalance raises the shaft's own first order above its row and leaves the sidebands as they are.

use crate::name::direct::gears_on;
use crate::name::gear::gear_name;
use crate::name::{Finding, Question};
use crate::read::dsp::{mean, median};
use crate::read::features::{ChannelFeatures, RecordingFeatures};
use crate::read::lines::{Family, SHAFT_MULTIPLES};

/// ln amplitude by which the first sidebands of a gear lead the second and third (median over mesh harmonics, sensors and recordings): mean and scale of sound gears, on 89 of
/// another generator's; the largest lead was 0.82, four scales above the mean, so that the tails are those of a t distribution.
const SOUND_SIDES: (f64, f64) = (-0.15, 0.30);
/// ln amplitude by which the first order of a shaft leads the highest of its row; the same of 64 shafts, where the largest was 1.98.
const SOUND_ONCE: (f64, f64) = (-0.6, 1.0);
/// Scales above the mean from which a lead is no sound gear's or rotor's: by a t distribution of six degrees one in three thousand.
const BEYOND: f64 = 4.5;
/// Mesh harmonics whose sidebands are compared, and values that a lead needs.
const HARMONICS: u8 = 8;
const LEAST: usize = 8;
/// What is believed: wobble of a wheel, a bent shaft and a coupling out of line do the same.
const RUN_OUT: f64 = 0.8;
const UNBALANCE: f64 = 0.8;

/// ln amplitude of a line, not below its noise.
fn level(r: &RecordingFeatures, c: &ChannelFeatures, family: Family) -> Option<f64> {
    let at = r.lines.iter().position(|l| l.family == family)?;
    let v = c.values[at]?;
    Some(0.5 * v.amplitude.norm_sqr().max(v.noise).max(f64::MIN_POSITIVE).ln())
}

fn sound(c: &ChannelFeatures) -> bool {
    c.integrity.clipped_at.is_none()
}

/// Lead of a gear's first sidebands over its second and third.
fn side_lead(q: &Question<'_>, stage: usize, shaft: usize) -> Option<f64> {
    let mut leads = Vec::new();
    for r in q.recordings {
        for c in r.channels.iter().filter(|c| sound(c)) {
            for harmonic in 1..=HARMONICS {
                let of = |offsets: &[i8]| -> Vec<f64> {
                    let side = |offset: &i8| level(r, c, Family::Side { stage, harmonic, shaft, offset: *offset });
                    offsets.iter().filter_map(side).collect()
                };
                let (first, beyond) = (of(&[-1, 1]), of(&[-3, -2, 2, 3]));
                if !first.is_empty() && beyond.len() > 1 {
                    leads.push(mean(&first) - mean(&beyond));
                }
            }
        }
    }
    (leads.len() >= LEAST).then(|| median(&mut leads))
}

/// Lead of a shaft's first order over the highest of its row, which rises as the multiple does.
fn once_lead(q: &Question<'_>, shaft: usize) -> Option<f64> {
    let mut rows: Vec<Vec<f64>> = vec![Vec::new(); usize::from(SHAFT_MULTIPLES)];
    for r in q.recordings {
        for c in r.channels.iter().filter(|c| sound(c)) {
            for multiple in 1..=SHAFT_MULTIPLES {
                if let Some(l) = level(r, c, Family::Shaft { shaft, multiple }) {
                    rows[usize::from(multiple) - 1].push(l - f64::from(multiple).ln());
                }
            }
        }
    }
    let (first, rest) = rows.split_first()?;
    let rest: Vec<f64> = rest.iter().filter(|v| !v.is_empty()).map(|v| mean(v)).collect();
    (!first.is_empty() && rest.len() >= LEAST / 2)
        .then(|| mean(first) - rest.into_iter().fold(f64::NEG_INFINITY, f64::max))
}

fn scales(lead: f64, (usual, scale): (f64, f64)) -> f64 {
    (lead - usual) / scale
}

/// Run-out of the gear whose first sidebands lead most, else unbalance of the shaft whose first order does, where no sound machine's would.
pub fn once_a_turn(q: &Question<'_>, steps: &mut Vec<String>) -> Option<Finding> {
    let stages = 0..q.train.stages.len();
    let gears = stages.flat_map(|i| [(i, i), (i, i + 1)]);
    let sides = gears.filter_map(|(i, j)| Some((scales(side_lead(q, i, j)?, SOUND_SIDES), i, j)));
    let best = sides.max_by(|a, b| a.0.total_cmp(&b.0));
    if let Some((z, i, j)) = best {
        let gear = gear_name(q, i, j);
        steps.push(format!("first sidebands of {gear} lead its others by {z:.1} scales of sound gears"));
        if z > BEYOND {
            let mut f = Finding::new("eccentricity", gear.clone(), RUN_OUT);
            f.evidence.place = format!("first sidebands of {gear}");
            f.evidence.support =
                format!("they lead the second and third by {z:.1} scales more than those of sound gears: once a turn");
            return Some(f);
        }
    }
    let shafts = 0..q.train.shafts.len();
    let once = shafts.filter_map(|j| Some((scales(once_lead(q, j)?, SOUND_ONCE), j)));
    let (z, j) = once.max_by(|a, b| a.0.total_cmp(&b.0))?;
    let shaft = q.train.shafts[j].0.clone();
    steps.push(format!("first order of {shaft} leads its row by {z:.1} scales of sound shafts"));
    if z <= BEYOND {
        return None;
    }
    let mut f = Finding::new("unbalance", shaft.clone(), UNBALANCE);
    f.alternatives.extend(gears_on(q, j).into_iter().map(|gear| ("eccentricity", gear)));
    f.evidence.place = format!("first order of {shaft}");
    f.evidence.support =
        format!("it leads the row of its shaft by {z:.1} scales more than on sound shafts, and the sidebands do not");
    Some(f)
}
