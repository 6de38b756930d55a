//! Made recordings with something in them that no gear does.

use super::*;

/// Points at which no mesh harmonic folds.
const SLOW: [(f64, f64); 4] = [(14.0, 20.0), (14.0, 40.0), (20.0, 20.0), (20.0, 40.0)];

/// Another machine's line at 347 Hz, whose motor wanders by 0.6 %, on both sensors and at all
/// speeds: no bin holds it, its band does. An eighth of it is no line.
#[test]
fn analytic_a_line_that_wanders_is_of_another_machine() {
    let beside = |size: f64, seed: u64| -> Vec<Recording> {
        let recorded = SLOW.iter().zip(seed..).map(|(&(speed, torque), seed)| {
            let more = |c: usize, t: f64, _: f64| {
                let wander = 0.006 / (TAU * 0.7) * (TAU * 0.7 * t + seed as f64).sin();
                size * (1.0 + c as f64) * (TAU * 347.0 * (t + wander)).cos()
            };
            record(speed, torque, seed, 23.0, &more)
        });
        recorded.collect()
    };
    let reference = beside(0.0, 50);
    let answer = ask(&beside(0.04, 1), &reference);
    assert_eq!(answer.status, Status::Unexplained, "{:?}", answer.steps);
    assert!(answer.effects.is_empty() && answer.steps.iter().any(|s| s.contains("narrow band")), "{:?}", answer.steps);
    let answer = ask(&beside(0.005, 1), &reference);
    assert_eq!(answer.status, Status::Consistent, "{:?}", answer.steps);
}

/// A cable that lets go three times: jumps of 6 m/s² that decay in 60 ms are millimetres of
/// displacement, on one sensor only. Without a reference too; and where both sensors show it, the
/// bench may rock.
#[test]
fn analytic_a_displacement_on_one_sensor_is_its_cable() {
    let jump = |t: f64| [0.4, 1.3, 2.3].iter().filter(|at| t > **at).map(|at| 6.0 * ((at - t) / 0.06).exp()).sum();
    let one = |c: usize, t: f64, _: f64| if c == 0 { jump(t) } else { 0.0 };
    let both = |_: usize, t: f64, _: f64| jump(t);
    let slow = |more: &dyn Fn(usize, f64, f64) -> f64, seed: u64| -> Vec<Recording> {
        SLOW.iter().zip(seed..).map(|(&(speed, torque), seed)| record(speed, torque, seed, 23.0, more)).collect()
    };
    for reference in [Vec::new(), slow(&nothing, 50)] {
        let answer = ask(&slow(&one, 1), &reference);
        assert_eq!(answer.status, Status::Unexplained, "{:?} {:?}", answer.effects, answer.steps);
        assert!(answer.effects.is_empty() && answer.advice[0].contains("cable, connector and mounting of acc_1"));
    }
    let answer = ask(&slow(&both, 1), &[]);
    assert!(!answer.advice.iter().any(|a| a.contains("cable")), "{:?}", answer.advice);
}
