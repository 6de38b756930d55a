//! What the machine's own lines gain where no mains are: the same question at frequencies beside
//! theirs.

use super::{DEVIATION, FixedLine, MAINS_HZ, Place};

/// Places beside each multiple of the mains (relative): on both sides, no two alike, far enough
/// that no line reaches from one to the next.
const BESIDE: [f64; 6] = [-0.043, -0.029, -0.017, 0.017, 0.029, 0.043];

/// Places beside those of the mains, as wide, that lie on no multiple.
pub fn beside(mains: &[Place]) -> Vec<Place> {
    let on_mains = |hz: f64| MAINS_HZ.iter().any(|base| (hz - (hz / base).round() * base).abs() < 3.0 * DEVIATION * hz);
    let about = |place: &Place| BESIDE.map(|off| Place { hz: place.hz * (1.0 + off), multiple: None, ..*place });
    mains.iter().flat_map(about).filter(|place| !on_mains(place.hz)).collect()
}

/// Lines at sham places on one sensor.
pub struct Shams {
    asked: usize,
    /// Leads of those that are there.
    leads: Vec<f64>,
}

impl Shams {
    /// From the lines at all sham places.
    pub fn new<'a>(lines: impl ExactSizeIterator<Item = &'a Option<FixedLine>>) -> Self {
        Self { asked: lines.len(), leads: lines.flatten().filter(|l| l.is_there()).map(|l| l.lead).collect() }
    }

    /// How many of so many places may be expected to hold a line of the machine by which this
    /// sensor leads the others as far, and whose amplitudes are as much alike in all recordings,
    /// which is one in `exp(alike)` of them; and that this one was there before.
    pub fn expected(&self, line: &FixedLine, places: f64) -> f64 {
        let as_far = self.leads.iter().filter(|lead| **lead >= line.lead).count();
        // Jeffreys' prior of a share.
        let share = (0.5 + as_far as f64) / (1.0 + self.asked as f64);
        places * share * (-line.alike).exp() + line.known
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(gain: f64, alike: f64) -> FixedLine {
        FixedLine {
            hz: (100.0, 0.1),
            multiple: None,
            channel: "acc".into(),
            amplitude: (1.0, 0.1),
            gain,
            alike,
            known: 0.0,
            by_speed: vec![gain; 2],
            speeds_seen: 2,
            lead: gain,
            elsewhere: 0.0,
            expected: f64::INFINITY,
        }
    }

    /// Of 99 shams none is there: of 20 places 20 · 0.5/100 exp(-a) are expected. Nine of them that
    /// lead as far: 20 times 9.5/100 exp(-a). Of a line that leads further, as without any.
    #[test]
    fn analytic_expected_lines_follow_the_shams() {
        let nothing = vec![None; 99];
        let none = Shams::new(nothing.iter());
        assert!((none.expected(&line(40.0, 3.0), 20.0) - 0.1 * (-3.0f64).exp()).abs() < 1e-12);
        let some: Vec<_> = (0..99).map(|k| (k < 9).then(|| line(40.0, 0.0))).collect();
        let some = Shams::new(some.iter());
        let before = FixedLine { known: 0.5, ..line(40.0, 1e3) };
        assert!((none.expected(&before, 20.0) - 0.5).abs() < 1e-12);
        assert!((some.expected(&line(40.0, 1.0), 20.0) - 1.9 * (-1.0f64).exp()).abs() < 1e-12);
        assert_eq!(some.expected(&line(41.0, 1.0), 20.0), none.expected(&line(41.0, 1.0), 20.0));
    }

    /// No sham lies on a multiple of the mains.
    #[test]
    fn conform_shams_are_beside_the_mains() {
        let shams = beside(&super::super::mains());
        assert!(shams.len() > 100);
        for place in shams {
            let off = |base: f64| ((place.hz / base).round() * base / place.hz - 1.0).abs();
            assert!(place.multiple.is_none() && MAINS_HZ.iter().all(|b| off(*b) >= 3.0 * DEVIATION), "{}", place.hz);
        }
    }
}
