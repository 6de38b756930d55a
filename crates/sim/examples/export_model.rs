//! Writes a bench's train as JSON for other solvers, with what the exponential stepper makes of it:
//! see `tests/peers`.

use std::io::Write;
use std::sync::Arc;
use std::time::Instant;

use gearwatch_sim::etd::Etd;
use gearwatch_sim::lines::line;
use gearwatch_sim::mesh::Pairs;
use gearwatch_sim::model::TrainModel;
use gearwatch_sim::rk4::Rk4;
use gearwatch_sim::rotation::Profile;
use gearwatch_sim::setup::SimSetup;
use serde_json::json;

const SETTLE_S: f64 = 1.0;
const RECORD_S: f64 = 1.0;
const NODES: u32 = 4000;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut bench = gearwatch_sim::shipped::bench("paper-rig").ok_or("shipped bench")?;
    // The bare train: no tooth errors and no housing, so that the tables below are the whole mesh.
    bench.effects.clear();
    bench.housing_modes.clear();
    let setup = SimSetup::nominal(&bench);
    let torque = bench.brake.torque_nm;
    let model = Arc::new(TrainModel::new(&setup, Profile::constant(30.0), Profile::constant(torque), 1)?);
    let rate = bench.acquisition.sample_rate_hz;
    let (etd_s, lines) = exponential(&model, rate, 1)?;
    let (half_s, half_lines) = exponential(&model, rate, 2)?;
    let record = (RECORD_S * rate) as usize;
    let mut rk4 = Rk4::new(&model, 1.0 / (4.0 * rate))?;
    let started = Instant::now();
    for _ in 0..record {
        rk4.step_plain();
    }
    let rk4_s = started.elapsed().as_secs_f64() / (record as f64 / (4.0 * rate));

    let mut pairs = Pairs::default();
    let meshes: Vec<_> = (0..model.contacts.len())
        .map(|stage| {
            let (contact, geometry) = (&model.contacts[stage], &model.linear.meshes[stage]);
            let force = torque * model.force_per_torque[stage];
            // F = K δ − G about the static approach, at phases between whole ones.
            let table: Vec<[f64; 2]> = (0..NODES)
                .map(|i| {
                    let phase = f64::from(i) / f64::from(NODES);
                    let approach = contact.static_approach(phase, force);
                    let at = contact.at(phase, approach, 0.0, &mut pairs);
                    [at.stiffness_n_per_m, at.stiffness_n_per_m * approach - at.force_n]
                })
                .collect();
            let z1 = bench.stages[stage].pinion.teeth;
            json!({
                "row": model.linear.mesh[stage].as_slice(),
                "damping": contact.damping_n_s_per_m,
                "pinion": geometry.pinion.angle,
                "teeth": z1,
                "order": model.linear.shaft_orders[geometry.pinion.shaft],
                "phase0": model.initial_phases[stage],
                "table": table,
            })
        })
        .collect();
    let matrix =
        |m: &nalgebra::DMatrix<f64>| m.row_iter().map(|r| r.iter().copied().collect::<Vec<_>>()).collect::<Vec<_>>();
    let mut externals = Vec::new();
    model.external_values(0.0, &mut externals);
    let mut load = vec![0.0; model.coordinates()];
    for (vector, value) in model.external_vectors().zip(&externals) {
        load.iter_mut().zip(vector.iter()).for_each(|(load, v)| *load += v * value);
    }
    let out = json!({
        "mass": model.linear.mass.diagonal().as_slice(),
        "damping": matrix(&model.linear.damping),
        "stiffness": matrix(&model.linear.stiffness),
        "load": load,
        "start": model.static_state()?,
        "meshes": meshes,
        "omega": model.rotation.at(0.0).1,
        "sensor_position": model.linear.sensors[0].position.as_slice(),
        "sensor_velocity": model.linear.sensors[0].velocity.as_slice(),
        "rate_hz": rate,
        "etd_s_per_s": etd_s,
        "etd_half_s_per_s": half_s,
        "etd_half_lines": half_lines,
        "rk4_s_per_s": rk4_s,
        "etd_lines": lines,
    });
    writeln!(std::io::stdout().lock(), "{out}")?;
    Ok(())
}

/// Seconds of computing per simulated second with a step for one sample or for two, and 1x to 5x of
/// the first stage.
fn exponential(
    model: &Arc<TrainModel>,
    rate: f64,
    samples_per_step: u32,
) -> Result<(f64, Vec<f64>), Box<dyn std::error::Error>> {
    let step_s = f64::from(samples_per_step) / rate;
    let mut etd = Etd::<1>::new([model.clone()], step_s)?;
    let (settle, steps) = ((SETTLE_S / step_s) as usize, ((SETTLE_S + RECORD_S) / step_s) as usize);
    let started = Instant::now();
    let (mut samples, mut angles) = (Vec::new(), Vec::new());
    for n in 0..steps {
        etd.step()?;
        if n >= settle {
            // The middle of a step for two samples is a sample too.
            for half in (2 - samples_per_step as usize)..2 {
                samples.push(etd.readings()[half][0][0]);
                angles.push(model.rotation.at((n as f64 + 0.5 * (half + 1) as f64) * step_s).0);
            }
        }
    }
    let spent_s = started.elapsed().as_secs_f64() / (SETTLE_S + RECORD_S);
    Ok((spent_s, (1..=5).map(|h| line(&samples, &angles, 34.0 * f64::from(h)).norm()).collect()))
}
