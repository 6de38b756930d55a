//! Recordings of a drawn machine: lines of its steady state through housing and sensors, noise, and
//! what enters on the way.

use gearwatch_core::bench::{Bench, EffectSpec};
use gearwatch_core::block::{OperatingPoint, Quality, TachoBlock};
use gearwatch_core::recording::{Channel, Recording, Segment};
use gearwatch_core::train::Train;
use gearwatch_sim::setup::SimSetup;
use gearwatch_sim::steady::{SteadyOptions, SteadySolver};
use num_complex::Complex64;
use std::f64::consts::TAU;

use super::draw::{Draw, RATE_HZ};
use super::machine::{Housing, sensor_factor};

/// Length of a recording (s).
const SECONDS: f64 = 6.0;
/// Amplitude over the standard deviation of the noise below which a line is left out: noise alone
/// gives 0.008.
const FAINTEST: f64 = 0.002;
/// Samples within which the speed counts as steady.
const BLOCK: usize = 32;
/// Start of all recordings (ns since the epoch).
const T0: i64 = 1_700_000_000_000_000_000;

/// A machine and what is done to its signals.
pub struct Session<'a> {
    /// The sheet.
    pub sheet: &'a Bench,
    /// What turns.
    pub setup: SimSetup,
    /// By sensor.
    pub housings: &'a [Housing],
    /// Noise by sensor, standard deviation at the nominal speed; the machine's, whatever is wrong
    /// with it.
    pub noise: Vec<f64>,
    /// Root mean square of the lines by sensor at the nominal setting, before anything was
    /// concealed.
    pub level: Vec<f64>,
    /// What is concealed.
    pub effects: &'a [EffectSpec],
    /// What no library knows.
    pub alien: Option<&'a Alien>,
    /// Draws how the gears sit on their shafts: one number for a machine.
    pub assembly: u64,
}

/// Physics outside the library.
#[derive(Clone, Debug, PartialEq)]
pub struct Alien {
    /// One of [`super::draw::ALIENS`].
    pub kind: &'static str,
    /// Speed of the other machine (Hz), order of the belt, lower edge of the band (Hz), or knocks
    /// per second.
    pub rate: f64,
    /// Teeth of the other machine; upper edge of the band over its lower.
    pub ratio: f64,
    /// Over the standard deviation of the noise.
    pub size: f64,
    /// By sensor.
    pub share: Vec<f64>,
}

/// A line: order of the input shaft, and the group of lines that it is compared in.
pub type Order = (f64, (u8, usize, usize));

/// Sidebands of a mesh harmonic, on each side, that recordings hold: a ghost's own order lies up to
/// 14 beside the first, and its neighbours on the comb are there as well.
const SIDEBANDS: u32 = 20;

/// The lines that a machine can make, ascending.
pub fn orders_of(train: &Train) -> Vec<Order> {
    let mut out: Vec<Order> = Vec::new();
    for (i, s) in train.stages.iter().enumerate() {
        for h in 1..=16 {
            let m = s.mesh_order * f64::from(h);
            out.push((m, (0, i, 0)));
            for k in 1..=SIDEBANDS {
                for (shaft, o) in [(i, s.pinion_order), (i + 1, s.wheel_order)] {
                    out.push((m - o * f64::from(k), (1, i, shaft)));
                    out.push((m + o * f64::from(k), (1, i, shaft)));
                }
            }
        }
    }
    for (j, (_, o)) in train.shafts.iter().enumerate() {
        out.push((*o, (3, j, 0)));
        out.extend((2..=14).map(|k| (o * f64::from(k), (2, j, 0))));
    }
    out.retain(|o| o.0 > 0.0);
    out.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    out.dedup_by(|a, b| (a.0 - b.0).abs() < 1e-6);
    out
}

/// The lines at each sensor, housing included; `None` where the steady state cannot be found.
pub fn lines(
    solver: &mut SteadySolver,
    s: &Session<'_>,
    motor_hz: f64,
    torque_nm: f64,
    input_hz: f64,
    orders: &[Order],
) -> Option<Vec<Vec<Complex64>>> {
    let wanted: Vec<f64> = orders.iter().map(|o| o.0).collect();
    let solved = solver.solve(&s.setup, motor_hz, torque_nm, s.assembly, &wanted).ok()?;
    Some(
        solved
            .sensors
            .iter()
            .enumerate()
            .map(|(c, values)| {
                wanted
                    .iter()
                    .zip(values)
                    .map(|(o, a)| {
                        let hz = o * input_hz;
                        a * s.housings[c].at(hz) * sensor_factor(s.effects, &s.sheet.sensors[c].name, hz)
                    })
                    .collect()
            })
            .collect(),
    )
}

/// The solver of a case: each solution starts from the one before.
pub fn solver() -> SteadySolver {
    SteadySolver::new(SteadyOptions { samples_per_cycle: 256, tolerance: 1e-4, together: false, parting: false })
}

/// One recording; `None` where the steady state cannot be found.
pub fn record(
    d: &mut Draw,
    solver: &mut SteadySolver,
    s: &Session<'_>,
    motor_hz: f64,
    torque_nm: f64,
    name: String,
) -> Option<Recording> {
    let setting = motor_hz * (1.0 + 0.001 * d.normal());
    let torque = torque_nm * (1.0 + 0.003 * d.normal());
    let find = |id: &str| s.effects.iter().find(|e| e.effect == id);
    let slip = find("belt_slip")
        .map_or(0.0, |e| 0.01 * e.parameters["slip_percent"] * torque_nm / s.sheet.brake.torque_nm)
        + if s.sheet.belt.is_some() { d.uniform(0.0, 0.001) } else { 0.0 };
    let clock = find("clock_offset").map_or(1.0 + 2e-5 * d.uniform(-1.0, 1.0), |e| 1.0 + 1e-6 * e.parameters["ppm"]);
    let train = Train::new(&s.setup.bench);
    let orders = orders_of(&train);
    let mean_hz = setting * (1.0 - slip) / train.motor_order;
    let lines = lines(solver, s, setting, torque, mean_hz, &orders)?;
    let count = (SECONDS * RATE_HZ) as usize;
    // A slow wander of the speed.
    let (mut wander, mut phase) = (0.0, d.uniform(0.0, 5000.0));
    let mut angle = Vec::with_capacity(count);
    for _ in 0..count {
        angle.push(phase);
        wander += -wander / (0.8 * RATE_HZ) + 4e-4 * d.normal() / (0.8 * RATE_HZ).sqrt();
        phase += mean_hz * (1.0 + wander) / (RATE_HZ * clock);
    }
    let mut recording = Recording { name, ..Recording::default() };
    for (c, sensor) in s.sheet.sensors.iter().enumerate() {
        let mut x = vec![0.0; count];
        let amplitudes: Vec<(f64, Complex64)> = orders
            .iter()
            .zip(&lines[c])
            .map(|(o, a)| (o.0, *a))
            .filter(|(o, _)| o * mean_hz < 0.47 * RATE_HZ)
            .collect();
        // Lines far below the noise of a six-second spectrum are left out.
        for (o, a) in amplitudes.iter().filter(|a| a.1.norm() > FAINTEST * s.noise[c]) {
            // Set exactly at the start of every block, turned at the mean speed within: the speed
            // wanders far more slowly.
            let turns: [Complex64; BLOCK] =
                std::array::from_fn(|k| Complex64::from_polar(1.0, TAU * o * mean_hz * k as f64 / (RATE_HZ * clock)));
            for (block, start) in x.chunks_mut(BLOCK).zip(angle.iter().step_by(BLOCK)) {
                let z = *a * Complex64::from_polar(1.0, TAU * (o * start).fract());
                for (out, turn) in block.iter_mut().zip(&turns) {
                    *out += z.re * turn.re - z.im * turn.im;
                }
            }
        }
        let noise = s.noise[c] * setting / s.sheet.motor.speed_hz;
        let path = |hz: f64| s.housings[c].at(hz) * sensor_factor(s.effects, &sensor.name, hz);
        coloured(d, &mut x, noise, 0.1 * s.noise[c], path);
        if let Some(e) = find("bearing_defect") {
            impacts(d, e, s, c, &angle, &train, &mut x);
        }
        if let Some(alien) = s.alien {
            alien.add(d, s, c, &angle, &mut x);
        }
        for e in s.effects.iter().filter(|e| e.place == sensor.name) {
            alter(e, s, c, &angle, &mut x);
        }
        let segment = Segment { t0: T0, first_sample_index: 0, samples: x, quality: Quality::GOOD };
        recording.channels.insert(
            sensor.name.clone(),
            Channel { sample_rate_hz: RATE_HZ, unit: sensor.unit.as_str().into(), segments: vec![segment] },
        );
    }
    if let Some(tacho) = &s.sheet.tacho {
        let order = train.shaft_order(&tacho.shaft)?;
        let mut pulse_times = Vec::new();
        for n in 1..count {
            let (a, b) = (angle[n - 1] * order, angle[n] * order);
            if b.floor() > a.floor() {
                let t = (n as f64 - 1.0 + (b.floor() - a) / (b - a)) / (RATE_HZ * clock);
                pulse_times.push(T0 + ((t + 2e-6 * d.normal()) * 1e9).round() as i64);
            }
        }
        recording.tachos.insert(
            tacho.shaft.as_str().into(),
            TachoBlock {
                shaft: tacho.shaft.as_str().into(),
                t0: T0,
                pulses_per_rev: 1.0,
                pulse_times,
                quality: Quality::GOOD,
            },
        );
    }
    recording.operating_points.push(OperatingPoint {
        t: T0,
        motor_speed_hz: setting * (1.0 + 5e-4 * d.normal()),
        brake_torque_nm: torque_nm,
        temperature_c: f64::NAN,
    });
    Some(recording)
}

/// Adds noise through a path, and white noise behind it.
fn coloured(d: &mut Draw, x: &mut [f64], size: f64, white_size: f64, path: impl Fn(f64) -> Complex64) {
    let mut transforms = crate::read::dsp::Transforms::default();
    let len = x.len();
    let mut white: Vec<f64> = (0..len).map(|_| d.normal() * size).collect();
    let mut bins = transforms.forward_real(&mut white);
    for (k, b) in bins.iter_mut().enumerate() {
        let hz = k as f64 * RATE_HZ / len as f64;
        *b *= path(hz) / (1.0 + hz / 3000.0);
    }
    let through = transforms.inverse_real(&mut bins, len);
    for (v, n) in x.iter_mut().zip(through) {
        *v += n + white_size * d.normal();
    }
}

/// What enters behind the sensor.
fn alter(effect: &EffectSpec, s: &Session<'_>, channel: usize, angle: &[f64], x: &mut [f64]) {
    let value = |name: &str| effect.parameters.get(name).copied().unwrap_or(0.0);
    match effect.effect.as_str() {
        "electrical_pickup" => {
            let size = value("amplitude") * s.noise[channel];
            for (n, v) in x.iter_mut().enumerate() {
                *v += size * (TAU * value("frequency_hz") * n as f64 / RATE_HZ).cos();
            }
        }
        "aliasing" => {
            // A component far up that keeps its order; taken at the sample times it folds by
            // itself.
            let size = value("amplitude") * s.noise[channel];
            let order = value("frequency_hz") / (s.sheet.motor.speed_hz / Train::new(s.sheet).motor_order);
            for (v, a) in x.iter_mut().zip(angle) {
                *v += size * (TAU * (order * a).fract()).cos();
            }
        }
        "clipping" => {
            let level = value("level") * 2.5 * s.level[channel];
            x.iter_mut().for_each(|v| *v = v.clamp(-level, level));
        }
        _ => {}
    }
}

/// Impacts at an order that slips a little, each ringing the housing.
fn impacts(d: &mut Draw, e: &EffectSpec, s: &Session<'_>, channel: usize, angle: &[f64], train: &Train, x: &mut [f64]) {
    let order = e.parameters["order"] * train.shaft_order(&e.place).unwrap_or(1.0);
    // The housing carries a third of it to the bearings of other shafts.
    let near = if s.sheet.sensors[channel].shaft == e.place { 1.0 } else { 0.35 };
    let size = 0.4 * near * e.parameters["amplitude"] * s.noise[channel];
    let mut next = angle[0] + d.uniform(0.0, 1.0) / order;
    for (n, a) in angle.iter().enumerate().take(x.len()) {
        if *a < next {
            continue;
        }
        next += (1.0 + 0.01 * d.normal()) / order;
        ring(&s.housings[channel], n, 6.0 * size, x);
    }
}

impl Alien {
    fn add(&self, d: &mut Draw, s: &Session<'_>, channel: usize, angle: &[f64], x: &mut [f64]) {
        let size = self.size * self.share[channel] * s.noise[channel];
        let housing = &s.housings[channel];
        match self.kind {
            "neighbour_machine" => {
                let speed = self.rate * (1.0 + 1e-4 * d.normal());
                for h in 1..=3 {
                    for hz in [
                        f64::from(h) * speed,
                        (self.ratio * f64::from(h) - 1.0) * speed,
                        self.ratio * f64::from(h) * speed,
                    ] {
                        let a = Complex64::from_polar(size / f64::from(h), d.uniform(0.0, TAU)) * housing.at(hz);
                        let turn = TAU * hz / RATE_HZ;
                        for (n, v) in x.iter_mut().enumerate().filter(|_| hz < 0.4 * RATE_HZ) {
                            *v += (a * Complex64::from_polar(1.0, turn * n as f64)).re;
                        }
                    }
                }
            }
            "belt_splice" => {
                let hz = RATE_HZ * (angle[x.len() - 1] - angle[0]) / x.len() as f64;
                for h in 1..=12 {
                    let order = self.rate * f64::from(h);
                    let a = Complex64::from_polar(size, 0.7 * f64::from(h)) * housing.at(order * hz);
                    for (v, p) in x.iter_mut().zip(angle) {
                        *v += (a * Complex64::from_polar(1.0, TAU * (order * p).fract())).re;
                    }
                }
            }
            "process_noise" => {
                let band = |hz: f64| {
                    let inside = hz > self.rate && hz < self.rate * self.ratio;
                    if inside { housing.at(hz) } else { Complex64::ZERO }
                };
                coloured(d, x, 3.0 * size, 0.0, band);
            }
            _ => {
                let mut next = 0.0;
                while next < x.len() as f64 {
                    next -= RATE_HZ / self.rate * d.uniform(f64::MIN_POSITIVE, 1.0).ln();
                    let push = 12.0 * size * (0.5 * d.normal()).exp();
                    ring(housing, next as usize, push, x);
                }
            }
        }
    }
}

/// One push on the housing.
fn ring(housing: &Housing, at: usize, push: f64, x: &mut [f64]) {
    for (hz, zeta, weight) in housing.0.iter().filter(|m| m.0 > 800.0) {
        let length = ((4.0 / (zeta * hz)) * RATE_HZ / TAU) as usize;
        for (k, v) in x.iter_mut().skip(at).take(length).enumerate() {
            let t = k as f64 / RATE_HZ;
            *v += push * weight.re * (-zeta * TAU * hz * t).exp() * (TAU * hz * t).sin();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prove::draw;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    /// Whatever ghost is drawn, its own order is among the lines that are put into the recordings,
    /// and so are its neighbours.
    #[test]
    fn conform_recordings_hold_the_order_of_every_ghost() {
        let mut d = Draw(ChaCha8Rng::seed_from_u64(1));
        for _ in 0..50 {
            let bench = draw::bench(&mut d);
            let train = Train::new(&bench);
            let Some(ghost) = draw::effect(&mut d, &bench, "ghost_component") else { panic!("no ghost") };
            let stage = train.stages.iter().find(|s| ghost.place.starts_with(&s.name)).unwrap();
            let turns = if ghost.place.ends_with("pinion") { stage.pinion_order } else { stage.wheel_order };
            let held = orders_of(&train);
            for beside in -4..=4 {
                let order = turns * (ghost.parameters["order"] + f64::from(beside));
                assert!(held.iter().any(|o| (o.0 - order).abs() < 1e-6), "{ghost:?} {beside:+}");
            }
        }
    }
}
