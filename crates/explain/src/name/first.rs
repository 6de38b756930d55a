//! What happens once a turn, without a reference: run-out and unbalance.
//!
//! The errors of a sound gear's teeth put something on every sideband of its shaft. Run-out raises
//! the first sidebands of its own gear above the second and third, through a path that all of them
//! share. Unbalance leaves the sidebands as they are. Its force is known to scale: rotors are
//! balanced to a grade, `G = e ω` (ISO 21940-11), and the force `m e ω²` at a bearing moves the
//! mass of a gearbox. The first order of a shaft so tells its grade within what mass and balancing
//! vary.

use std::f64::consts::TAU;

use gearwatch_core::bench::{Bench, Stage};
use gearwatch_core::indicators::velocity;
use gearwatch_sim::linear::{DIRECT_PATH_MASS_KG, gear_mass_and_inertia};

use crate::change::align::CLEAR;
use crate::finding::Finding;
use crate::name::gear::{gear_name, gears_on};
use crate::name::mates::level;
use crate::name::odds::Usual;
use crate::question::Question;
use crate::read::dsp::{mean, median};
use crate::read::features::{ChannelFeatures, RecordingFeatures};
use crate::read::lines::Family;

/// ln amplitude by which the first sidebands of a gear must lead the second and third (median over
/// mesh harmonics, sensors and recordings): of 148 sound gears of another generator the largest
/// lead was 0.82.
const SIDES_LEAD: f64 = 1.2;
/// ln of the grade (mm/s) that sound rotors show through the mass that the simulator gives a
/// gearbox. Usual rotors keep G 2.5 to G 6.3 and are mostly well within: 1 mm/s, 0.16 to 6.3 in two
/// standard deviations of 0.9. The mass of a gearbox is known to a factor of 2.2 (0.8).
const SOUND: Usual = Usual { middle: 0.0, sigma: 1.2 };
/// With unbalance by anything from there to this much more (ln), as likely each: three thousand
/// times. What is believed beforehand of one effect of some thirty.
const MOST: f64 = 8.0;
const USUAL: f64 = 1.0 / 30.0;
/// Least speed of a shaft (Hz) whose vibration is judged by its velocity (ISO 20816-1). Below, what
/// turns the box or the floor moves it as much.
const JUDGED_HZ: f64 = 10.0;
/// Mesh harmonics whose sidebands are compared, and values that a lead needs.
const HARMONICS: u8 = 8;
const LEAST: usize = 8;
/// What is believed: wobble of a wheel, a bent shaft and a coupling out of line do the same.
const RUN_OUT: f64 = 0.8;
const SUREST: f64 = 0.8;

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

/// Mass of what turns with a shaft (kg): its gears, itself with what else is on it, the rotors of a
/// motor without a belt and of the brake.
pub(crate) fn turning_kg(bench: &Bench, shaft: usize) -> f64 {
    let density = bench.gear_material.density_kg_per_m3;
    let of = |(stage, s): (usize, &Stage)| {
        let gear = [&s.pinion, &s.wheel].get(shaft.checked_sub(stage)?).copied()?;
        Some(gear_mass_and_inertia(gear, 0.0, s, density).0)
    };
    let gears: f64 = bench.stages.iter().enumerate().filter_map(of).sum();
    let motor = if shaft == 0 && bench.belt.is_none() { bench.motor.inertia_kg_m2 } else { 0.0 };
    let brake = if shaft + 1 == bench.shafts.len() { bench.brake.inertia_kg_m2 } else { 0.0 };
    let rotors = [bench.shafts[shaft].inertia_kg_m2, motor, brake];
    gears + rotors.map(|inertia| rotor_kg(inertia, density)).iter().sum::<f64>()
}

/// Mass of a solid cylinder three radii long by its inertia: `J = m r²/2`, `m = 3 π ρ r³`. Rotors
/// are rarely more slender, so that none weighs much more.
fn rotor_kg(inertia_kg_m2: f64, density_kg_per_m3: f64) -> f64 {
    let per_cube = 3.0 * std::f64::consts::PI * density_kg_per_m3;
    per_cube * (2.0 * inertia_kg_m2 / per_cube).powf(0.6)
}

/// ln of the grade of balance (mm/s at the highest speed) by which what turns with a shaft makes
/// its first order: median over recordings, of the sensor that shows most. `None` where no sensor
/// shows it clearly.
fn grade(q: &Question<'_>, shaft: usize) -> Option<f64> {
    let hz = |r: &RecordingFeatures| r.order_hz(q.train.shafts[shaft].1);
    let highest = q.recordings.iter().map(hz).fold(0.0, f64::max);
    let family = Family::Shaft { shaft, multiple: 1 };
    let mut values = Vec::new();
    for r in q.recordings.iter().filter(|r| hz(r) >= JUDGED_HZ) {
        let Some(at) = r.lines.iter().position(|l| l.family == family) else { continue };
        let mm_per_s2 = |c: &ChannelFeatures| {
            let (factor, true) = velocity::in_millimetres(&c.unit)? else { return None };
            let v = c.values[at].as_ref()?;
            let power = v.amplitude.norm_sqr();
            (power > CLEAR * v.noise).then(|| factor * power.sqrt())
        };
        // The sensor that the force reaches best: at the shaft's own bearing.
        let highest_here = r.channels.iter().filter(|c| sound(c)).filter_map(mm_per_s2).fold(0.0, f64::max);
        if highest_here == 0.0 {
            return None;
        }
        values.push((highest_here / (TAU * hz(r)).powi(2) * TAU * highest).ln());
    }
    let per_kg = (DIRECT_PATH_MASS_KG / turning_kg(q.bench, shaft)).ln();
    (!values.is_empty()).then(|| median(&mut values) + per_kg)
}

/// Run-out of the gear whose first sidebands lead most, where no sound machine's would.
pub fn run_out(q: &Question<'_>, steps: &mut Vec<String>) -> Option<Finding> {
    let stages = 0..q.train.stages.len();
    let gears = stages.flat_map(|i| [(i, i), (i, i + 1)]);
    let sides = gears.filter_map(|(i, j)| Some((side_lead(q, i, j)?, gear_name(q, i, j))));
    let (lead, gear) = sides.max_by(|a, b| a.0.total_cmp(&b.0))?;
    steps.push(format!("first sidebands of {gear} lead the second and third by {lead:.1} nats"));
    if lead <= SIDES_LEAD {
        return None;
    }
    let mut f = Finding::new("eccentricity", gear.clone(), RUN_OUT);
    f.evidence.place = format!("first sidebands of {gear}");
    f.evidence.support = format!("they lead the second and third by {lead:.1} nats: once a turn");
    Some(f)
}

/// Unbalance of the shaft whose first order tells of the worst balance, where no sound machine's
/// would.
pub fn unbalance(q: &Question<'_>, steps: &mut Vec<String>) -> Option<Finding> {
    let shafts = 0..q.train.shafts.len();
    let (grade, j) = shafts.filter_map(|j| Some((grade(q, j)?, j))).max_by(|a, b| a.0.total_cmp(&b.0))?;
    let shaft = q.train.shafts[j].0.clone();
    let odds = SOUND.odds(grade - SOUND.middle, MOST, USUAL);
    steps.push(format!(
        "first order of {shaft}: out of balance by {:.1} mm/s (on a gearbox of {DIRECT_PATH_MASS_KG} kg); odds of unbalance {odds:.1e}",
        grade.exp()
    ));
    let probability = SUREST * odds / (1.0 + odds);
    if probability < 0.5 {
        return None;
    }
    let mut f = Finding::new("unbalance", shaft.clone(), probability);
    f.alternatives.extend(gears_on(q.bench, j).into_iter().map(|gear| ("eccentricity", gear)));
    f.evidence.place = format!("first order of {shaft}");
    f.evidence.support = format!(
        "as high as what turns with it makes it out of balance by {:.0} mm/s on a gearbox of {DIRECT_PATH_MASS_KG} kg; sound ones keep 6.3",
        grade.exp()
    );
    Some(f)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Unbalance is likelier than not from 43 mm/s on.
    #[test]
    fn analytic_the_grade_from_which_unbalance_is_named() {
        let probability = |grade_mm_per_s: f64| {
            let odds = SOUND.odds(grade_mm_per_s.ln() - SOUND.middle, MOST, USUAL);
            SUREST * odds / (1.0 + odds)
        };
        assert!(probability(42.0) < 0.5 && probability(43.0) > 0.5);
    }

    /// A steel cylinder of 40 mm radius and 120 mm length: 4.7 kg, 3.8e-3 kg m².
    #[test]
    fn analytic_mass_of_a_cylinder_by_its_inertia() {
        let (radius, density): (f64, f64) = (0.04, 7850.0);
        let kg = density * std::f64::consts::PI * radius.powi(2) * 0.12;
        assert!((rotor_kg(0.5 * kg * radius.powi(2), density) / kg - 1.0).abs() < 1e-12);
        assert_eq!(rotor_kg(0.0, density), 0.0);
    }
}
