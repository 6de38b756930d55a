//! The ratio of the belt, where the sheet's puts no mesh lines and another does.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use crate::comb::CombField;
use crate::kinematics::{LEAST_COMB, OTHER_SPEED, SLIP_REACH, comb_orders, deciding_orders, own_speed};
use crate::steady::{Run, Steady};

/// Ratios that are tried, relative to the sheet's, in pieces in which no speed and its double lie
/// together.
const TRIED: [(f64, f64); 8] = [
    (0.2, 0.32),
    (0.32, 0.5),
    (0.5, 0.8),
    (0.8, 1.0 - SLIP_REACH),
    (1.0 + SLIP_REACH, 1.6),
    (1.6, 2.5),
    (2.5, 4.0),
    (4.0, 5.0),
];
/// Lines of the comb that must lie in the usable band, and its upper end (share of the sample
/// rate).
const LEAST_LINES: usize = 3;
const USABLE_BAND: f64 = 0.45;
/// Ratios of two recordings are one within this (relative): belts creep by up to a per cent.
const SAME: f64 = 0.01;
/// At a whole multiple of the speed every line of the comb is a harmonic of the right one, within
/// this (relative). At broken ratios few are.
const MULTIPLE: f64 = 5e-3;
/// The creep of a belt, by which a measured ratio is above that of the pulleys (relative).
const CREEP: f64 = 5e-3;

/// A belt ratio that fits all recordings where the sheet's does not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OtherRatio {
    /// Speed of the motor over that of the input shaft, and its standard deviation.
    pub ratio: (f64, f64),
    /// The same by the sheet.
    pub sheet: f64,
}

/// Why the mesh lines are not where the sheet puts them.
pub enum Elsewhere {
    /// The belt has another ratio.
    Ratio(OtherRatio),
    /// A gear has another tooth number, as likely or likelier: that of the rival.
    Teeth,
}

/// The bench with this ratio.
pub fn with_ratio(bench: &Bench, other: &OtherRatio) -> Bench {
    let mut out = bench.clone();
    if let Some(belt) = &mut out.belt {
        belt.ratio = other.ratio.0;
    }
    out
}

/// Another ratio, by the tacho of a shaft behind the belt or by where the mesh lines lie, the same
/// in all recordings with a stated motor speed.
///
/// `rival` is the bench with the likeliest other tooth number: whichever puts more lines where
/// there are some is the better explanation.
pub fn other_ratio(
    bench: &Bench,
    rival: Option<&Bench>,
    all: &[Steady<'_, impl Run>],
    fields: &[CombField],
) -> Option<Elsewhere> {
    let sheet = bench.belt.as_ref()?.ratio;
    let train = Train::new(bench);
    let known: Vec<(&Steady<'_, _>, &CombField)> =
        all.iter().zip(fields).filter(|(steady, _)| steady.display_motor_hz.is_finite()).collect();
    let mut speeds = Vec::with_capacity(known.len());
    for (steady, field) in &known {
        speeds.push(elsewhere(&train, bench, steady, field)?);
    }
    let ratios: Vec<f64> = known.iter().zip(&speeds).map(|((steady, _), hz)| steady.display_motor_hz / hz).collect();
    let count = ratios.len() as f64;
    let mean = ratios.iter().sum::<f64>() / count;
    let most = ratios.iter().map(|r| (r / mean - 1.0).abs()).fold(0.0, f64::max);
    if ratios.is_empty() || most > SAME || (mean / sheet - 1.0).abs() <= SLIP_REACH {
        return None;
    }
    let score = |bench: &Bench, speed: &dyn Fn(usize) -> f64| -> f64 {
        let orders = deciding_orders(&Train::new(bench));
        known.iter().enumerate().map(|(i, (_, field))| field.score(&orders, speed(i))).sum()
    };
    if let Some(rival) = rival {
        let train = Train::new(rival);
        let comb = comb_orders(&train);
        let rivals: Vec<f64> =
            known.iter().map(|(steady, field)| own_speed(rival, &train, steady, field, &comb, SAME).0).collect();
        if score(rival, &|i| rivals[i]) >= score(bench, &|i| speeds[i]) {
            return Some(Elsewhere::Teeth);
        }
    }
    Some(Elsewhere::Ratio(OtherRatio { ratio: (mean, mean * CREEP.hypot(most)), sheet }))
}

/// Speed of the input shaft (Hz) where the sheet's ratio does not put it.
fn elsewhere(train: &Train, bench: &Bench, steady: &Steady<'_, impl Run>, field: &CombField) -> Option<f64> {
    let orders = comb_orders(train);
    let by_ratio = steady.display_motor_hz / train.motor_order;
    let behind_the_belt = steady.recording.tachos.keys().next().is_some_and(|shaft| shaft != "motor");
    if let (true, Some(hz)) = (behind_the_belt, steady.tacho_hz(train)) {
        let (hz, score) = field.search(&orders, hz * (1.0 - SAME), hz * (1.0 + SAME));
        return (score > LEAST_COMB && (hz / by_ratio - 1.0).abs() > SLIP_REACH).then_some(hz);
    }
    let own = own_speed(bench, train, steady, field, &orders, SAME).1;
    // Of a speed and its multiples, all of which meet lines, the slowest meets most.
    let inside = |hz: f64| orders.iter().filter(|order| **order * hz < USABLE_BAND * steady.sample_rate_hz).count();
    let (hz, score) = TRIED
        .map(|(low, high)| field.search(&orders, low * by_ratio, high * by_ratio))
        .into_iter()
        .filter(|(hz, _)| inside(*hz) >= LEAST_LINES)
        .max_by(|a, b| (a.1 * inside(a.0) as f64).total_cmp(&(b.1 * inside(b.0) as f64)))?;
    let near = |times: f64| (hz / by_ratio / times - 1.0).abs() < MULTIPLE;
    let multiple = (2..=5).any(|times| near(f64::from(times)));
    // A belt that is not there is the likeliest of all.
    let direct = (hz / steady.display_motor_hz - 1.0).abs() < MULTIPLE;
    (score > own + OTHER_SPEED && (!multiple || direct)).then_some(hz)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use gearwatch_core::bench::Belt;
    use gearwatch_core::block::{OperatingPoint, Quality};
    use gearwatch_core::recording::{Channel, Recording, Segment};

    use super::*;
    use crate::dsp::Transforms;
    use crate::steady::steady;

    const RATE_HZ: f64 = 8192.0;

    /// 23 teeth at a speed, with sidebands and orders of the shaft, in noise; the motor behind a
    /// belt of 2.
    fn recording(input_hz: f64) -> Recording {
        let mut state = 7_u64;
        let mut even = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        let mut lines: Vec<(f64, f64)> = (1..=12).map(|k| (f64::from(k), 0.1)).collect();
        for h in 1..=8 {
            let order = 23.0 * f64::from(h);
            lines.push((order, 2.0 / f64::from(h)));
            lines.extend((1..=4).flat_map(|k| [-1.0, 1.0].map(|s| (order + s * f64::from(k), 0.08 / f64::from(k)))));
        }
        let samples = (0..3 * 8192)
            .map(|n| {
                let angle = input_hz * f64::from(n) / RATE_HZ;
                let gears: f64 = lines.iter().map(|(o, a)| a * (TAU * (o * angle + o * o)).cos()).sum();
                gears + even() + even() - 1.0
            })
            .collect();
        let segment = Segment { t0: 0, first_sample_index: 0, samples, quality: Quality::GOOD };
        let channel = Channel { sample_rate_hz: RATE_HZ, unit: "m/s^2".into(), segments: vec![segment] };
        let mut out = Recording { name: format!("{input_hz}"), ..Recording::default() };
        out.channels.insert("acc_1".into(), channel);
        out.operating_points.push(OperatingPoint { motor_speed_hz: 2.0 * input_hz, ..OperatingPoint::UNKNOWN });
        out
    }

    /// Ratios that are too large and too small, at a broken and at no broken ratio to the right
    /// one; the right one is left alone.
    #[test]
    fn analytic_the_ratio_that_fits_is_found() {
        let mut bench = gearwatch_sim::shipped::bench("single-pair").unwrap();
        bench.tacho = None;
        bench.acquisition.sample_rate_hz = RATE_HZ;
        bench.sensors.truncate(1);
        (bench.sensors[0].name, bench.sensors[0].unit) = ("acc_1".into(), "m/s^2".into());
        let recordings = [recording(20.0), recording(30.1)];
        for stated in [2.5, 1.3, 2.0, 3.7] {
            bench.belt = Some(Belt {
                ratio: stated,
                stiffness_nm_per_rad: 4000.0,
                damping_nm_s_per_rad: 1.2,
                length_mm: None,
                motor_pulley_mm: None,
            });
            let train = Train::new(&bench);
            let all: Vec<Steady<'_>> = recordings.iter().filter_map(|r| steady(&bench, &train, r).ok()).collect();
            assert_eq!(all.len(), 2, "{stated}");
            let fields: Vec<CombField> = all.iter().map(|s| s.comb_field(&mut Transforms::default())).collect();
            let teeth = crate::kinematics::likeliest_teeth(&bench, &all, &fields);
            match other_ratio(&bench, teeth.as_ref().map(|t| &t.bench), &all, &fields) {
                Some(Elsewhere::Ratio(found)) => {
                    assert!((found.ratio.0 / 2.0 - 1.0).abs() < 0.01, "{stated}: {found:?}");
                }
                Some(Elsewhere::Teeth) => panic!("{stated}: other teeth"),
                None => assert_eq!(stated, 2.0),
            }
        }
    }
}
