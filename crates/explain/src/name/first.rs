//! What happens once a turn, without a reference: run-out and unbalance.
//!
//! The errors of a sound gear's teeth put something on every sideband of its shaft, and accumulated
//! pitch errors a row of orders. Run-out raises the first sidebands of its own gear above the
//! second and third, through a path that all of them share; unbalance raises the shaft's own first
//! order above its row and leaves the sidebands as they are.

use crate::finding::Finding;
use crate::name::gear::{gear_name, gears_on};
use crate::name::mates::level;
use crate::question::Question;
use crate::read::dsp::{mean, median};
use crate::read::features::ChannelFeatures;
use crate::read::lines::{Family, SHAFT_MULTIPLES};

/// ln amplitude by which the first sidebands of a gear must lead the second and third (median over
/// mesh harmonics, sensors and recordings): of 148 sound gears of another generator the largest
/// lead was 0.82.
const SIDES_LEAD: f64 = 1.2;
/// ln amplitude by which the first order of a shaft must lead the highest of its row: of 121 sound
/// shafts of that generator the largest lead was 2.83.
const ONCE_LEADS: f64 = 3.9;
/// Mesh harmonics whose sidebands are compared, and values that a lead needs.
const HARMONICS: u8 = 8;
const LEAST: usize = 8;
/// What is believed: wobble of a wheel, a bent shaft and a coupling out of line do the same.
const RUN_OUT: f64 = 0.8;
const UNBALANCE: f64 = 0.8;

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

/// Run-out of the gear whose first sidebands lead most, else unbalance of the shaft whose first
/// order does, where no sound machine's would.
pub fn once_a_turn(q: &Question<'_>, steps: &mut Vec<String>) -> Option<Finding> {
    let stages = 0..q.train.stages.len();
    let gears = stages.flat_map(|i| [(i, i), (i, i + 1)]);
    let sides = gears.filter_map(|(i, j)| Some((side_lead(q, i, j)?, gear_name(q, i, j))));
    if let Some((lead, gear)) = sides.max_by(|a, b| a.0.total_cmp(&b.0)) {
        steps.push(format!("first sidebands of {gear} lead the second and third by {lead:.1} nats"));
        if lead > SIDES_LEAD {
            let mut f = Finding::new("eccentricity", gear.clone(), RUN_OUT);
            f.evidence.place = format!("first sidebands of {gear}");
            f.evidence.support = format!("they lead the second and third by {lead:.1} nats: once a turn");
            return Some(f);
        }
    }
    let shafts = 0..q.train.shafts.len();
    let (lead, j) = shafts.filter_map(|j| Some((once_lead(q, j)?, j))).max_by(|a, b| a.0.total_cmp(&b.0))?;
    let shaft = q.train.shafts[j].0.clone();
    steps.push(format!("first order of {shaft} leads its row by {lead:.1} nats"));
    if lead <= ONCE_LEADS {
        return None;
    }
    let mut f = Finding::new("unbalance", shaft.clone(), UNBALANCE);
    f.alternatives.extend(gears_on(q.bench, j).into_iter().map(|gear| ("eccentricity", gear)));
    f.evidence.place = format!("first order of {shaft}");
    f.evidence.support = format!("it leads the row of its shaft by {lead:.1} nats, and the sidebands do not lead");
    Some(f)
}
