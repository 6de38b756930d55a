//! The machine's state: normal, deviating, alarm, or a changed path, and only where it is resolved.

use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, StudentsT};

use crate::deviation::Deviation;
use crate::estimate::Estimate;
use crate::rank::RankConfig;
use crate::verdict::{HARMONICS, MachineState, Rank};

/// How sure the machine's state must be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StateConfig {
    /// Probability that a healthy machine is called deviating, over all harmonics of one verdict
    /// (0–0.5).
    pub false_alarm: f64,
}

impl Default for StateConfig {
    /// One verdict in a hundred.
    fn default() -> Self {
        Self { false_alarm: 0.01 }
    }
}

impl StateConfig {
    /// What is wrong with the values, in a sentence; `None` for usable ones.
    pub fn problem(&self) -> Option<String> {
        let usable = self.false_alarm > 0.0 && self.false_alarm < 0.5;
        (!usable).then(|| format!("false_alarm is {}; expected a probability between 0 and 0.5", self.false_alarm))
    }

    /// State of the machine from the deviations of one stage's harmonics at a sensor; `path` is
    /// what all lines and floors of the sensor say of its path. Unknown where no harmonic is judged
    /// or nothing is resolved.
    ///
    /// - *Deviating*: some harmonic's deviation is larger than the first rank step, proven by
    ///   Student's t test at the false-alarm probability shared out over the harmonics (Šidák).
    ///   *Alarm*: larger than the step of rank IV.
    /// - *Path changed*: deviating, and the path did change ([`Path::changed`]). Where it may have
    ///   ([`Path::may_have_changed`]) nothing is resolved: a single window must not call a gear
    ///   faulty where the average over all of them calls the path changed.
    /// - *Normal*: not deviating, and rank IV or V is less probable than not in each harmonic that
    ///   can be judged at all, of which there must be one. A harmonic whose deviation is so
    ///   uncertain that rank IV or V would be more probable than not even at 0 (sigma above 1.48
    ///   times the step of rank IV) says nothing for or against.
    pub fn machine(&self, ranks: &RankConfig, lines: &[Option<Deviation>; HARMONICS], path: &Path) -> MachineState {
        let [deviating, _, _, alarm, _] = ranks.steps_percent;
        if self.exceeds(lines, deviating) {
            if path.changed(self) {
                return MachineState::PathChanged;
            }
            if path.may_have_changed(self) {
                return MachineState::Unknown;
            }
            return if self.exceeds(lines, alarm) { MachineState::Alarm } else { MachineState::Deviating };
        }
        let alarming =
            |percent: Estimate| ranks.probability_of(Rank::IV, percent) + ranks.probability_of(Rank::V, percent);
        let percents = || lines.iter().flatten().map(Deviation::percent);
        let mut judged = percents().filter(|d| alarming(Estimate::new(0.0, d.sigma)) < 0.5).peekable();
        // A comparison with NaN is false: what is not known is not normal.
        if judged.peek().is_some() && judged.all(|d| alarming(d) < 0.5) {
            MachineState::Normal
        } else {
            MachineState::Unknown
        }
    }

    /// Deviating, but it cannot be told whether the path or the gear changed.
    pub fn is_path_or_gear(&self, ranks: &RankConfig, lines: &[Option<Deviation>; HARMONICS], path: &Path) -> bool {
        self.exceeds(lines, ranks.steps_percent[0]) && !path.changed(self) && path.may_have_changed(self)
    }

    /// Some deviation is proven to be larger than the limit.
    fn exceeds(&self, deviations: &[Option<Deviation>; HARMONICS], limit_percent: f64) -> bool {
        let share = self.share(deviations.iter().flatten().count() as u32);
        deviations.iter().flatten().any(|d| d.p_within(limit_percent) < share)
    }

    /// Probability at which one of `tests` is significant, so that all together err with the
    /// false-alarm probability (Šidák).
    fn share(&self, tests: u32) -> f64 {
        1.0 - (1.0 - self.false_alarm).powf(1.0 / f64::from(tests.max(1)))
    }
}

impl Deviation {
    /// Probability of a deviation at least this large if the true one were no larger than
    /// `limit_percent` (0–1): twice the upper tail of Student's t at the distance to the limit.
    pub fn p_within(&self, limit_percent: f64) -> f64 {
        let limit = limit_percent / 100.0;
        let distance = if self.ln >= 0.0 { self.ln - limit.ln_1p() } else { (-limit).ln_1p() - self.ln };
        // Within the limit, or not known.
        if distance.is_nan() || distance <= 0.0 {
            return 1.0;
        }
        let sigma = self.variance.sqrt();
        if sigma == 0.0 {
            return 0.0;
        }
        // Beyond a thousand degrees of freedom Student's t is normal to three digits in any tail
        // that matters here.
        match StudentsT::new(0.0, 1.0, self.freedom.clamp(1.0, 1e3)) {
            Ok(student) => (2.0 * student.sf(distance / sigma)).min(1.0),
            Err(_) => 1.0,
        }
    }
}

/// What the lines of all stages at one sensor, and the floors beside them, say of the path from the
/// gears to the sensor.
///
/// A linear path multiplies a mesh line and the noise right beside it by the same gain, so that the
/// logarithmic deviations `d` of the lines equal those of the floors, `f`, harmonic by harmonic. A
/// gear that changes moves the lines and leaves the floors. With an unknown common error of either
/// statement the likelihoods are `(Σ (d−f)²)^(−n/2)` and `(Σ d²)^(−n/2)`; the path is named where
/// their ratio is above `1 / false_alarm`, 100 as a rule: of five lines the floors must account for
/// 84 % of the sum of squares, of ten for 60 %, of two for 99 %.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Path {
    /// Σ d²
    lines_alone: f64,
    /// Σ (d − f)²
    beside_floors: f64,
    /// n
    pairs: u32,
    floors: u32,
    /// The least probable of the floors, if none had moved by a rank step.
    least_p: Option<f64>,
    /// The least probable of the lines less their floors, if none had moved by a rank step beside
    /// its floor.
    least_residual_p: Option<f64>,
}

impl Path {
    /// Adds the lines and floors of a stage.
    pub fn add(
        &mut self,
        ranks: &RankConfig,
        lines: &[Option<Deviation>; HARMONICS],
        floors: &[Option<Deviation>; HARMONICS],
    ) {
        for floor in floors.iter().flatten() {
            let p = floor.p_within(ranks.steps_percent[0]);
            self.floors += 1;
            self.least_p = Some(self.least_p.map_or(p, |least| least.min(p)));
        }
        for (line, floor) in lines.iter().zip(floors).filter_map(|(d, f)| Some(((*d)?, (*f)?))) {
            let residual = Deviation {
                ln: line.ln - floor.ln,
                variance: line.variance + floor.variance,
                freedom: line.freedom.min(floor.freedom),
            };
            let p = residual.p_within(ranks.steps_percent[0]);
            self.least_residual_p = Some(self.least_residual_p.map_or(p, |least| least.min(p)));
            self.lines_alone += line.ln.powi(2);
            self.beside_floors += (line.ln - floor.ln).powi(2);
            self.pairs += 1;
        }
    }

    /// A floor is proven to have moved by more than the first rank step, and the floors explain how
    /// the lines moved.
    pub fn changed(&self, config: &StateConfig) -> bool {
        self.have_floors_moved(config) && self.pairs >= 2 && self.ln_ratio() > -config.false_alarm.ln()
    }

    /// A floor is proven to have moved, the floors explain the lines no worse than a changed gear
    /// does, and no line is proven to have moved beside its floor: too little is known to say
    /// which.
    pub fn may_have_changed(&self, config: &StateConfig) -> bool {
        let none_beside = self.least_residual_p.is_some_and(|p| p >= config.share(self.pairs));
        self.have_floors_moved(config) && self.pairs >= 2 && self.ln_ratio() > 0.0 && none_beside
    }

    fn have_floors_moved(&self, config: &StateConfig) -> bool {
        self.least_p.is_some_and(|p| p < config.share(self.floors))
    }

    /// ln of the likelihood of a changed path over that of a changed gear.
    fn ln_ratio(&self) -> f64 {
        f64::from(self.pairs) / 2.0 * (self.lines_alone / self.beside_floors).ln()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Random;

    fn deviations(ln: [f64; HARMONICS], sigma: f64) -> [Option<Deviation>; HARMONICS] {
        ln.map(|ln| Some(Deviation { ln, variance: sigma * sigma, freedom: 1e3 }))
    }

    fn machine(lines: [f64; HARMONICS], floors: [f64; HARMONICS], sigma: f64) -> MachineState {
        let (lines, floors) = (deviations(lines, sigma), deviations(floors, sigma));
        StateConfig::default().machine(&RankConfig::default(), &lines, &path(&lines, &floors))
    }

    fn path(lines: &[Option<Deviation>; HARMONICS], floors: &[Option<Deviation>; HARMONICS]) -> Path {
        let mut path = Path::default();
        path.add(&RankConfig::default(), lines, floors);
        path
    }

    const STILL: [f64; HARMONICS] = [0.0; HARMONICS];

    /// Two-sided, 1 % shared by five harmonics: 0.2 % each, z = 3.09 (normal). With sigma 1 %,
    /// `deviating` begins at ln(1.01) + 3.09 sigma = 4.09 %, `alarm` at ln(1.10) + 3.09 sigma =
    /// 12.6 %, in ln.
    #[test]
    fn analytic_limits_of_the_states() {
        let one = |ln: f64| [0.0, ln, 0.0, 0.0, 0.0];
        for (ln, state) in [
            (0.0405, MachineState::Normal),
            (0.0415, MachineState::Deviating),
            (0.1255, MachineState::Deviating),
            (0.1270, MachineState::Alarm),
            // Downwards the limits are ln(0.99) and ln(0.90).
            (-0.0405, MachineState::Normal),
            (-0.0415, MachineState::Deviating),
            (-0.1355, MachineState::Deviating),
            (-0.1370, MachineState::Alarm),
        ] {
            assert_eq!(machine(one(ln), STILL, 0.01), state, "{ln}");
        }
        // A healthy machine that scatters by 15 % cannot be called normal by one window: rank IV is
        // more probable than not.
        assert_eq!(machine(STILL, STILL, 0.147), MachineState::Normal);
        assert_eq!(machine(STILL, STILL, 0.149), MachineState::Unknown);
        // One harmonic that says nothing does not keep the others from being normal; one that may
        // be rank IV does.
        let mut lines = deviations(STILL, 0.05);
        lines[3] = Some(Deviation { ln: 0.3, variance: 0.5 * 0.5, freedom: 1e3 });
        let judge =
            |lines: &[_; HARMONICS]| StateConfig::default().machine(&RankConfig::default(), lines, &Path::default());
        assert_eq!(judge(&lines), MachineState::Normal);
        lines[3] = Some(Deviation { ln: 0.12, variance: 0.05 * 0.05, freedom: 1e3 });
        assert_eq!(judge(&lines), MachineState::Unknown);
        assert_eq!(machine(STILL, STILL, 0.05), MachineState::Normal);
        let nothing = StateConfig::default().machine(&RankConfig::default(), &[None; HARMONICS], &Path::default());
        assert_eq!(nothing, MachineState::Unknown);
        assert_eq!(machine([f64::NAN; HARMONICS], STILL, 0.05), MachineState::Unknown);
    }

    #[test]
    fn analytic_floors_that_move_along_are_a_changed_path() {
        let moved = [1.2, -0.8, 0.5, 0.9, -1.5];
        assert_eq!(machine(moved, moved, 0.08), MachineState::PathChanged);
        // A new gain, the same for all.
        assert_eq!(machine([0.7; 5], [0.75, 0.66, 0.7, 0.72, 0.68], 0.08), MachineState::PathChanged);
        // Lines moved, floors did not: the gear. Floors moved, lines did not: background noise, the
        // gear is normal.
        assert_eq!(machine(moved, STILL, 0.08), MachineState::Alarm);
        assert_eq!(machine(STILL, moved, 0.05), MachineState::Normal);
        // Both moved, but not together.
        assert_eq!(machine(moved, [-0.8, 0.5, 0.9, -1.5, 1.2], 0.08), MachineState::Alarm);
        // Likelihood ratio for n lines: (Σd²/Σ(d−f)²)^(n/2); floors short by a share q of each line
        // give q^(−n).
        let short = |q: f64, count: usize| {
            let lines = deviations([1.0; 5], 0.05);
            let mut floors = deviations([1.0 - q; 5], 0.05);
            floors[count..].fill(None);
            path(&lines, &floors).changed(&StateConfig::default())
        };
        // 100^(−1/5) = 0.398, 100^(−1/2) = 0.1
        assert!(short(0.39, 5) && !short(0.41, 5));
        assert!(short(0.099, 2) && !short(0.101, 2) && !short(0.0, 1));
        // A path belongs to a sensor: a second stage with the same story makes it clearer, one
        // whose gear failed less so.
        let story = |lines: [f64; HARMONICS], floors| {
            let mut both = path(&deviations([1.0; 5], 0.05), &deviations([0.5; 5], 0.05));
            both.add(&RankConfig::default(), &deviations(lines, 0.05), &deviations(floors, 0.05));
            both.changed(&StateConfig::default())
        };
        assert!(!short(0.5, 5) && story([1.0; 5], [0.5; 5]) && !story([1.0; 5], STILL));
    }

    /// Lines and floors that move by half, known to 20 % in a window: the floors explain the lines,
    /// but not a hundred times better. That is no gear alarm; a gear whose lines move far beyond
    /// what its floors do still is one, however little the floors moved.
    #[test]
    fn regress_a_window_that_cannot_tell_path_from_gear_calls_no_gear() {
        let (lines, floors) = ([0.9, 0.2, 0.8, 0.3, 0.9], [0.5, 0.6, 0.4, 0.7, 0.5]);
        let judge = |lines: [f64; 5], floors: [f64; 5], line_sigma: f64, floor_sigma: f64| {
            let (lines, floors) = (deviations(lines, line_sigma), deviations(floors, floor_sigma));
            StateConfig::default().machine(&RankConfig::default(), &lines, &path(&lines, &floors))
        };
        assert_eq!(judge(lines, floors, 0.2, 0.05), MachineState::Unknown);
        assert_eq!(judge([1.2, 0.9, 1.0, 1.1, 0.8], [0.1; 5], 0.2, 0.02), MachineState::Alarm);
        assert_eq!(judge(lines, STILL, 0.2, 0.05), MachineState::Alarm);
    }

    /// Gear faults of 6 dB on lines whose floors wander by as much, independently: called a changed
    /// path in fewer than 1 % of 20 000 trials, as the likelihood ratio of 100 promises; a changed
    /// path with 1 dB of disagreement between line and floor is recognised in more than 95 %.
    #[test]
    fn oracle_path_rule_against_simulated_changes() {
        let mut random = Random(11);
        let mut draw = |sigma: f64| std::array::from_fn::<f64, HARMONICS, _>(|_| sigma * random.normal());
        let (mut wrong, mut missed) = (0, 0);
        let trials = 20_000;
        for _ in 0..trials {
            let (gear, floor, difference) = (draw(0.7), draw(0.7), draw(0.115));
            let explained = |d: [f64; HARMONICS], f: [f64; HARMONICS]| {
                path(&deviations(d, 0.05), &deviations(f, 0.05)).changed(&StateConfig::default())
            };
            wrong += u32::from(explained(gear, floor));
            missed += u32::from(!explained(std::array::from_fn(|h| floor[h] + difference[h]), floor));
        }
        assert!(f64::from(wrong) < 0.01 * f64::from(trials), "{wrong}");
        assert!(f64::from(missed) < 0.05 * f64::from(trials), "{missed}");
    }
}
