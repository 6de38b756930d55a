//! The machine's state: normal, deviating, alarm, or a changed path, and only where it is resolved.

use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, StudentsT};

use crate::deviation::Deviation;
use crate::rank::RankConfig;
use crate::verdict::{HARMONICS, MachineState, Rank};

/// How sure the machine's state must be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StateConfig {
    /// Probability that a healthy machine is called deviating, over all harmonics of one verdict (0–0.5).
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

    /// State of the machine from the deviations of the harmonics and of the floors beside them; unknown where none is judged
    /// or nothing is resolved.
    ///
    /// - *Deviating*: some harmonic's deviation is larger than the first rank step, proven by Student's t test at the
    ///   false-alarm probability shared out over the harmonics (Šidák). *Alarm*: larger than the step of rank IV.
    /// - *Path changed*: deviating, a floor moved too (by the same test), and the floors explain how the harmonics moved
    ///   ([`floors_explain`]).
    /// - *Normal*: neither, and in no harmonic rank IV or V is more probable than not.
    pub fn machine(
        &self,
        ranks: &RankConfig,
        lines: &[Option<Deviation>; HARMONICS],
        floors: &[Option<Deviation>; HARMONICS],
    ) -> MachineState {
        let [deviating, _, _, alarm, _] = ranks.steps_percent;
        if !lines.iter().any(Option::is_some) {
            return MachineState::Unknown;
        }
        if self.exceeds(lines, deviating) {
            if self.exceeds(floors, deviating) && floors_explain(lines, floors, self.false_alarm) {
                return MachineState::PathChanged;
            }
            return if self.exceeds(lines, alarm) { MachineState::Alarm } else { MachineState::Deviating };
        }
        let alarming = |deviation: &Deviation| {
            let percent = deviation.percent();
            ranks.probability_of(Rank::IV, percent) + ranks.probability_of(Rank::V, percent)
        };
        // A comparison with NaN is false: what is not known is not normal.
        if lines.iter().flatten().all(|d| alarming(d) < 0.5) { MachineState::Normal } else { MachineState::Unknown }
    }

    /// Some deviation is proven to be larger than the limit.
    fn exceeds(&self, deviations: &[Option<Deviation>; HARMONICS], limit_percent: f64) -> bool {
        let judged = deviations.iter().flatten().count();
        let share = 1.0 - (1.0 - self.false_alarm).powf(1.0 / judged.max(1) as f64);
        deviations.iter().flatten().any(|d| d.p_within(limit_percent) < share)
    }
}

impl Deviation {
    /// Probability of a deviation at least this large if the true one were no larger than `limit_percent` (0–1): twice
    /// the upper tail of Student's t at the distance to the limit.
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
        // Beyond a thousand degrees of freedom Student's t is normal to three digits in any tail that matters here.
        match StudentsT::new(0.0, 1.0, self.freedom.clamp(1.0, 1e3)) {
            Ok(student) => (2.0 * student.sf(distance / sigma)).min(1.0),
            Err(_) => 1.0,
        }
    }
}

/// The floors say better how the harmonics moved than "they moved by themselves": the path from gear to sensor changed.
///
/// A linear path multiplies a mesh line and the noise right beside it by the same gain, so that the logarithmic
/// deviations `d` of the lines equal those of the floors, `f`, harmonic by harmonic. A gear that changes moves the lines and
/// leaves the floors. With an unknown common error of either statement the likelihoods are `(Σ (d−f)²)^(−n/2)` and
/// `(Σ d²)^(−n/2)`; the path is named where their ratio is above `1 / false_alarm`, 100 as a rule: for five harmonics the
/// floors must account for 84 % of the sum of squares, for two of them for 99 %.
pub fn floors_explain(
    lines: &[Option<Deviation>; HARMONICS],
    floors: &[Option<Deviation>; HARMONICS],
    false_alarm: f64,
) -> bool {
    let (mut alone, mut with_floor, mut count) = (0.0, 0.0, 0);
    for (line, floor) in lines.iter().zip(floors).filter_map(|(d, f)| Some(((*d)?, (*f)?))) {
        alone += line.ln.powi(2);
        with_floor += (line.ln - floor.ln).powi(2);
        count += 1;
    }
    if count < 2 {
        return false;
    }
    f64::from(count) / 2.0 * (alone / with_floor).ln() > -false_alarm.ln()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Random;

    fn deviations(ln: [f64; HARMONICS], sigma: f64) -> [Option<Deviation>; HARMONICS] {
        ln.map(|ln| Some(Deviation { ln, variance: sigma * sigma, freedom: 1e3 }))
    }

    fn machine(lines: [f64; HARMONICS], floors: [f64; HARMONICS], sigma: f64) -> MachineState {
        StateConfig::default().machine(&RankConfig::default(), &deviations(lines, sigma), &deviations(floors, sigma))
    }

    const STILL: [f64; HARMONICS] = [0.0; HARMONICS];

    /// Two-sided, 1 % shared by five harmonics: 0.2 % each, z = 3.09 (normal). With sigma 1 %, `deviating` begins at
    /// ln(1.01) + 3.09 sigma = 4.09 %, `alarm` at ln(1.10) + 3.09 sigma = 12.6 %, in ln.
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
        // A healthy machine that scatters by 20 % cannot be called normal by one window: rank IV is more probable than not.
        assert_eq!(machine(STILL, STILL, 0.20), MachineState::Unknown);
        assert_eq!(machine(STILL, STILL, 0.05), MachineState::Normal);
        let nothing = StateConfig::default().machine(&RankConfig::default(), &[None; HARMONICS], &[None; HARMONICS]);
        assert_eq!(nothing, MachineState::Unknown);
        assert_eq!(machine([f64::NAN; HARMONICS], STILL, 0.05), MachineState::Unknown);
    }

    #[test]
    fn analytic_floors_that_move_along_are_a_changed_path() {
        let moved = [1.2, -0.8, 0.5, 0.9, -1.5];
        assert_eq!(machine(moved, moved, 0.08), MachineState::PathChanged);
        // A new gain, the same for all.
        assert_eq!(machine([0.7; 5], [0.75, 0.66, 0.7, 0.72, 0.68], 0.08), MachineState::PathChanged);
        // Lines moved, floors did not: the gear. Floors moved, lines did not: background noise, the gear is normal.
        assert_eq!(machine(moved, STILL, 0.08), MachineState::Alarm);
        assert_eq!(machine(STILL, moved, 0.05), MachineState::Normal);
        // Both moved, but not together.
        assert_eq!(machine(moved, [-0.8, 0.5, 0.9, -1.5, 1.2], 0.08), MachineState::Alarm);
        // Likelihood ratio for n lines: (Σd²/Σ(d−f)²)^(n/2); floors short by a share q of each line give q^(−n).
        let short = |q: f64, count: usize| {
            let lines = deviations([1.0; 5], 0.05);
            let mut floors = deviations([1.0 - q; 5], 0.05);
            floors[count..].fill(None);
            floors_explain(&lines, &floors, 0.01)
        };
        // 100^(−1/5) = 0.398, 100^(−1/2) = 0.1
        assert!(short(0.39, 5) && !short(0.41, 5));
        assert!(short(0.099, 2) && !short(0.101, 2) && !short(0.0, 1));
    }

    /// Gear faults of 6 dB on lines whose floors wander by as much, independently: called a changed path in fewer than 1 %
    /// of 20 000 trials, as the likelihood ratio of 100 promises; a changed path with 1 dB of disagreement between line
    /// and floor is recognised in more than 95 %.
    #[test]
    fn oracle_path_rule_against_simulated_changes() {
        let mut random = Random(11);
        let mut draw = |sigma: f64| std::array::from_fn::<f64, HARMONICS, _>(|_| sigma * random.normal());
        let (mut wrong, mut missed) = (0, 0);
        let trials = 20_000;
        for _ in 0..trials {
            let (gear, floor, difference) = (draw(0.7), draw(0.7), draw(0.115));
            let explained = |d: [f64; HARMONICS], f| floors_explain(&deviations(d, 0.05), &deviations(f, 0.05), 0.01);
            wrong += u32::from(explained(gear, floor));
            missed += u32::from(!explained(std::array::from_fn(|h| floor[h] + difference[h]), floor));
        }
        assert!(f64::from(wrong) < 0.01 * f64::from(trials), "{wrong}");
        assert!(f64::from(missed) < 0.05 * f64::from(trials), "{missed}");
    }
}
