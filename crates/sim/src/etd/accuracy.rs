//! How long a step may be: so that halving it leaves 1x to 5x of all stages where they are.
//!
//! A first guess comes from the eigenvalues and the mesh frequencies, the rest from a short run of
//! the model itself with that step and with half of it: how much an error of the remainder is
//! amplified on its way to a line depends on all modes, and no bound in the eigenvalues alone holds
//! for every bench. The stepper is of order 4 there.

use std::f64::consts::TAU;
use std::sync::Arc;

use super::Etd;
use crate::lines::line;
use crate::model::{ModelError, TrainModel};

/// Largest `|λ| h` of the first guess: the fastest mode, the teeth against each other as a rule,
/// rings at every pair change.
const RINGING: f64 = 1.3;
/// Largest turn of the highest mesh harmonic within its step (rad). A quadratic through a wave that
/// turns by 2θ misses θ⁴/60 of it.
const TURN: f64 = 0.56;
/// Mesh harmonics that are looked at.
const HARMONICS: u32 = 5;
/// Change of a line on halving that is aimed at, as a part of the line, or of [`FLOOR`] of its
/// sensor's largest. The promise is 5e-4; a short run shows it within a third.
const AIM: f64 = 3e-4;
const FLOOR: f64 = 0.05;
/// Duration of the short run (s), and of what is looked at of it.
const RUN_S: f64 = 0.35;
const RECORD_S: f64 = 0.25;
/// The guess is refined by this at most: teeth that part amplify any difference, and no step would
/// be short enough.
const MOST: f64 = 3.0;

/// Longest step (s) that leaves 1x to 5x, as far as they lie below `highest_hz`, within 0.05 % of
/// what half of it gives.
pub(super) fn accurate_step_s(model: &Arc<TrainModel>, highest_hz: f64) -> Result<f64, ModelError> {
    let rigid = Etd::<1>::new([model.clone()], 1.0)?;
    let highest = (f64::from(HARMONICS) * model.fastest_mesh_hz()).min(highest_hz);
    let guess = (RINGING / rigid.plans[0].modes.fastest()).min(TURN / (TAU * highest));
    let coarse = lines(model, guess, 1, highest_hz)?;
    let fine = lines(model, 0.5 * guess, 2, highest_hz)?;
    // A run that leaves all that makes sense says so when it is run.
    let change = coarse.zip(fine).map_or(0.0, |(coarse, fine)| change(&coarse, &fine));
    Ok(guess / (change / AIM).powf(0.25).clamp(1.0, MOST))
}

/// Amplitudes of 1x to 5x below `highest_hz` by sensor, at the highest speed of the profile; `None`
/// where the run leaves all that makes sense, which the caller will be told then.
fn lines(
    model: &Arc<TrainModel>,
    step_s: f64,
    every: usize,
    highest_hz: f64,
) -> Result<Option<Vec<Vec<f64>>>, ModelError> {
    let mut etd = Etd::<1>::new([model.clone()], step_s)?;
    let begin = (model.rotation.fastest_at_s() / step_s).floor() * step_s;
    etd.set_time(begin);
    let interval = step_s * every as f64;
    let (lead, count) = (((RUN_S - RECORD_S) / interval) as usize, (RECORD_S / interval) as usize);
    let mut samples = vec![Vec::with_capacity(count); model.linear.sensors.len()];
    let mut angles = Vec::with_capacity(count);
    for n in 0..lead + count {
        for _ in 0..every {
            if etd.step().is_err() {
                return Ok(None);
            }
        }
        if n >= lead {
            angles.push(model.rotation.angle(etd.time()));
            for (samples, reading) in samples.iter_mut().zip(&etd.readings()[1]) {
                samples.push(reading[0]);
            }
        }
    }
    let hz_per_order = model.rotation.fastest_rad_per_s() / TAU;
    let orders: Vec<f64> = model
        .mesh_orders()
        .flat_map(|mesh| (1..=HARMONICS).map(move |h| f64::from(h) * mesh))
        .filter(|order| order * hz_per_order <= highest_hz)
        .collect();
    let of_sensor = |samples: &Vec<f64>| orders.iter().map(|&order| line(samples, &angles, order).norm()).collect();
    Ok(Some(samples.iter().map(of_sensor).collect()))
}

/// Largest change of a line, as a part of it or of [`FLOOR`] of the sensor's largest.
fn change(coarse: &[Vec<f64>], fine: &[Vec<f64>]) -> f64 {
    let mut most = 0.0_f64;
    for (coarse, fine) in coarse.iter().zip(fine) {
        let largest = fine.iter().copied().fold(0.0, f64::max);
        for (a, b) in coarse.iter().zip(fine) {
            most = most.max((a - b).abs() / b.max(FLOOR * largest));
        }
    }
    most
}
