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
