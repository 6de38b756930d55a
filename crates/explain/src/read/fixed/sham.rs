//! What the machine's own lines gain where no mains are: the same question at frequencies beside
//! theirs.

use super::{DEVIATION, FixedLine, MAINS_HZ, Place};

/// Places beside each multiple of the mains (relative): on both sides, no two alike, far enough
/// that no line reaches from one to the next.
const BESIDE: [f64; 6] = [-0.043, -0.029, -0.017, 0.017, 0.029, 0.043];
/// Mean gain of a machine's line before any was seen (nats), with the weight of one. Chosen: where
/// no sham passes, a line then needs some 30 nats; 675 benches of the own generator without a
/// pick-up gain 20 at most.
const USUAL_GAIN: f64 = 6.0;

/// Places beside those of the mains, as wide, that lie on no multiple.
pub fn beside(mains: &[Place]) -> Vec<Place> {
    let on_mains = |hz: f64| MAINS_HZ.iter().any(|base| (hz - (hz / base).round() * base).abs() < 3.0 * DEVIATION * hz);
    let about = |place: &Place| BESIDE.map(|off| Place { hz: place.hz * (1.0 + off), multiple: None, ..*place });
    mains.iter().flat_map(about).filter(|place| !on_mains(place.hz)).collect()
}

/// Gains at sham places on one sensor. Gains of lines that pass for one of a fixed frequency are
/// taken to be exponentially distributed, as those of noise are (likelihood ratio of one amplitude:
/// Wilks 1938).
pub struct Shams {
    asked: usize,
    passed: usize,
    mean_gain: f64,
}

impl Shams {
    /// From the lines at all sham places.
    pub fn new(lines: impl ExactSizeIterator<Item = Option<FixedLine>>) -> Self {
        let asked = lines.len();
        let gains: Vec<f64> = lines.flatten().filter(|l| l.gain > 0.0 && l.is_steady()).map(|l| l.gain).collect();
        let mean_gain = (USUAL_GAIN + gains.iter().sum::<f64>()) / (1.0 + gains.len() as f64);
        Self { asked, passed: gains.len(), mean_gain }
    }

    /// How many of so many places may be expected to gain as much by lines of the machine.
    pub fn expected(&self, gain: f64, places: usize) -> f64 {
        let share = (1.0 + self.passed as f64) / (1.0 + self.asked as f64);
        places as f64 * share * (-gain / self.mean_gain).exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(gain: f64) -> Option<FixedLine> {
        Some(FixedLine {
            hz: (100.0, 0.1),
            multiple: None,
            channel: "acc".into(),
            amplitude: (1.0, 0.1),
            gain,
            by_speed: vec![gain; 2],
            elsewhere: 0.0,
            expected: f64::INFINITY,
        })
    }

    /// Of 99 shams none passes: of 20 places 20/100 exp(-g/6) are expected. Nine with a mean of 40
    /// nats, with the prior's 6 a mean of 36.6: 20 · 10/100 exp(-g/36.6).
    #[test]
    fn analytic_expected_lines_follow_the_shams() {
        let none = Shams::new((0..99).map(|_| None));
        assert!((none.expected(60.0, 20) - 0.2 * (-10.0f64).exp()).abs() < 1e-12);
        let some: Vec<_> = (0..99).map(|k| if k < 9 { line(40.0) } else { None }).collect();
        let some = Shams::new(some.into_iter());
        assert!((some.expected(36.6, 20) - 2.0 * (-1.0f64).exp()).abs() < 1e-12);
    }

    /// No sham lies on a multiple of the mains.
    #[test]
    fn conform_shams_are_beside_the_mains() {
        let mains: Vec<Place> = (1..=12)
            .flat_map(|m| MAINS_HZ.map(|b| Place { hz: b * f64::from(m), multiple: Some(m), wander: DEVIATION }))
            .collect();
        let shams = beside(&mains);
        assert!(shams.len() > 100);
        for place in shams {
            let off = |base: f64| ((place.hz / base).round() * base / place.hz - 1.0).abs();
            assert!(place.multiple.is_none() && MAINS_HZ.iter().all(|b| off(*b) >= 3.0 * DEVIATION), "{}", place.hz);
        }
    }
}
