//! A steady, noise-free run of a setup, for tests, signatures and comparisons: samples with the
//! first shaft's angle at each.

use std::sync::Arc;

use crate::model::TrainModel;
use crate::path::Channel;
use crate::rotation::Profile;
use crate::setup::{Rate, SimSetup};
use crate::source::SimError;
use crate::stepper::Stepper;

/// What a run gives.
#[derive(Clone, Debug, PartialEq)]
pub struct Rendered {
    /// Samples per second.
    pub sample_rate_hz: f64,
    /// Angle of the first shaft at each sample (rad).
    pub angles_rad: Vec<f64>,
    /// Samples by sensor of the bench, in its unit.
    pub samples: Vec<Vec<f64>>,
}

/// Runs a setup at a motor speed (Hz) and brake torque (N m): `settle_s` to settle, then
/// `duration_s` that are kept. Neither noise nor rounding is added; all else that lies between
/// bearing and record is.
///
/// # Errors
/// As [`crate::source::Simulator::new`].
pub fn steady(
    setup: &SimSetup,
    motor_hz: f64,
    torque_nm: f64,
    seed: u64,
    settle_s: f64,
    duration_s: f64,
) -> Result<Rendered, SimError> {
    let nominal = setup.bench.acquisition.sample_rate_hz;
    let rate = nominal * (1.0 + 1e-6 * setup.clock_ppm);
    let model = Arc::new(TrainModel::new(setup, Profile::constant(motor_hz), Profile::constant(torque_nm), seed)?);
    let mut channels: Vec<Channel> = (setup.bench.sensors.iter().zip(&setup.sensors))
        .map(|(sensor, channel)| {
            let mut quiet = channel.clone();
            (quiet.noise, quiet.background_m_per_s2, quiet.bits) = (0.0, 0.0, 32);
            Channel::new(&quiet, &sensor.unit, rate, seed)
        })
        .collect();
    let mut stepper = Stepper::new(&model, rate)?;
    let lead = (settle_s * rate).round() as usize;
    let count = (duration_s * rate).round() as usize;
    let mut out = Rendered {
        sample_rate_hz: nominal,
        angles_rad: Vec::with_capacity(count),
        samples: vec![Vec::with_capacity(count); channels.len()],
    };
    for n in 0..lead + count {
        stepper.advance(&model, rate, n as u64, &mut channels)?;
        // The filter hands out what went in this much earlier.
        let time = (n + 1) as f64 / rate - f64::from(Channel::DELAY_SAMPLES) / rate;
        let angle = model.rotation.at(time).0;
        let kept = n >= lead;
        if kept {
            out.angles_rad.push(angle);
        }
        for ((channel, sensor), samples) in channels.iter_mut().zip(&setup.sensors).zip(&mut out.samples) {
            let tones = sensor.tones.iter().map(|tone| {
                let phase = match tone.rate {
                    Rate::Hertz(hz) => std::f64::consts::TAU * hz * time,
                    Rate::PerRevolution { shaft, order } => {
                        order * angle * shaft.map_or(model.motor_order(), |i| model.linear.shaft_orders[i])
                    }
                };
                tone.amplitude * phase.sin()
            });
            let tones: f64 = tones.sum();
            let (value, _) = channel.sample(tones);
            if kept {
                samples.push(f64::from(value) * channel.scale());
            }
        }
    }
    Ok(out)
}
