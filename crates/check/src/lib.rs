//! Whether bench file, recordings and baseline belong together, before the first verdict.
//!
//! A wrong number in the bench file or in the set-up of the acquisition makes a healthy machine
//! look faulty, or a faulty one look healthy. Each [`Finding`] states what was found, what was
//! expected and what to do. What is certainly wrong is refused by the command; what is doubtful
//! stands in every verdict until it is cleared (`[check] cleared` of the bench file).
//!
//! The lower part reads speed and tooth numbers of a recording from its lines ([`steady`],
//! [`comb`], [`kinematics`], [`last_wheel`]); explanations begin with it too.
//!
//! ```text
//! bench file ──────────────────────────────┐
//! recording ─► Look ─► speed, lines, teeth ─┼─► check ─► Finding: note, doubtful, wrong ─► refused, or doubts of verdicts
//! baseline ────────────────────────────────┘
//! ```
//!
//! A sample rate that is too low for the fifth mesh harmonic shows in the bench file alone:
//!
//! ```
//! use gearwatch_check::{Severity, check};
//! use gearwatch_core::bench::Bench;
//!
//! let bench = Bench::from_toml(
//!     r#"
//! format = "gearwatch-bench/1"
//! name = "small"
//! motor = { speed_hz = 30.0 }
//! shaft = [{ name = "input" }, { name = "output" }]
//! stage = [{ name = "stage1", pinion = { teeth = 23 }, wheel = { teeth = 41 } }]
//! sensor = [{ name = "acc_1", shaft = "input" }]
//! acquisition = { sample_rate_hz = 4096.0 }
//! "#,
//! )?;
//! let checked = check(&bench, &[], None);
//! assert_eq!(checked.worst(), Some(Severity::Doubtful));
//! assert!(checked.findings.iter().any(|finding| finding.id == "band"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use std::fmt;

use gearwatch_core::baseline::Baseline;
use gearwatch_core::bench::Bench;
use serde::Serialize;

pub mod belt;
pub mod carriers;
pub mod comb;
pub mod dsp;
pub mod integrity;
pub mod kinematics;
pub mod last_wheel;
pub mod lines;
pub mod orders;
pub mod powers;
pub mod steady;
pub mod turning;

mod blocks;
mod channels;
mod jitter;
mod look;
mod normal;
mod over_angle;
mod parted;
mod sheet;
mod slip;
mod speed;
mod teeth;

pub use look::Look;

/// How sure a finding is, and what it means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Worth knowing; it changes no verdict. So is what was doubtful and has been cleared.
    Note,
    /// It may be wrong: it goes along with every verdict.
    Doubtful,
    /// It is wrong: nothing is judged.
    Wrong,
}

/// Something that does not fit.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// What kind of thing, such as `tooth_number`; the word by which it is cleared.
    pub id: &'static str,
    /// How sure.
    pub severity: Severity,
    /// File name of the recording; empty where the sheet alone says it.
    pub recording: String,
    /// A stage, a sensor, `tacho`, `motor`, `acquisition` and the like.
    pub place: String,
    /// What was found.
    pub found: String,
    /// What was expected.
    pub expected: String,
    /// What to do.
    pub advice: String,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.recording.is_empty() {
            write!(f, "{}: ", self.recording)?;
        }
        write!(f, "{}: {}; expected {}; {} [{}]", self.place, self.found, self.expected, self.advice, self.id)
    }
}

/// All that was found, the gravest first.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Checked {
    /// The findings.
    pub findings: Vec<Finding>,
}

impl Checked {
    /// The gravest; none where all fits.
    pub fn worst(&self) -> Option<Severity> {
        self.findings.iter().map(|finding| finding.severity).max()
    }

    /// Findings of a severity.
    pub fn of(&self, severity: Severity) -> impl Iterator<Item = &Finding> {
        self.findings.iter().filter(move |finding| finding.severity == severity)
    }

    /// Why nothing may be judged, one sentence after the other; `None` where something may.
    pub fn refusal(&self) -> Option<String> {
        let wrong: Vec<String> = self.of(Severity::Wrong).map(Finding::to_string).collect();
        (!wrong.is_empty()).then(|| wrong.join("; "))
    }

    /// The words of what is doubtful (or wrong) about one recording, as verdicts carry them:
    /// sorted, each once, with a space between.
    pub fn doubts(&self, recording: &str) -> String {
        let of_it = |finding: &&Finding| finding.recording.is_empty() || finding.recording == recording;
        let mut ids: Vec<&str> = self
            .findings
            .iter()
            .filter(|finding| finding.severity > Severity::Note)
            .filter(of_it)
            .map(|finding| finding.id)
            .collect();
        ids.sort_unstable();
        ids.dedup();
        ids.join(" ")
    }
}

/// Checks a bench with what was looked at of its recordings, and with the baseline that is to judge
/// them.
pub fn check(bench: &Bench, looks: &[Look], baseline: Option<&Baseline>) -> Checked {
    let mut findings = sheet::findings(bench, looks);
    for look in looks {
        findings.extend(channels::findings(bench, look, baseline));
    }
    let mut heard = speed::hear(bench, looks);
    findings.extend(speed::findings(bench, &heard, baseline));
    findings.extend(teeth::findings(bench, &mut heard));
    findings.extend(normal::findings(bench, looks, &heard, baseline));
    for finding in &mut findings {
        if finding.severity == Severity::Doubtful && bench.check.cleared.iter().any(|id| id == finding.id) {
            finding.severity = Severity::Note;
        }
    }
    // Stable: within a severity the order is that of the questions.
    findings.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    Checked { findings }
}

#[cfg(test)]
mod tests;
