//! What a search has found so far.

use crate::change::locate::Cell;
use crate::finding::Finding;

/// Misfit per line from which something changed that no mask singles out: of 147 unchanged benches
/// 145 stay below 0.9, one came to 1.06, and one to 2.4 (by a mask).
pub const MISFIT: f64 = 1.2;
/// Factor on the probability of a second effect: it may be what the first does elsewhere.
pub const SECOND_SURE: f64 = 0.7;

/// What was found so far.
pub struct Found<'a> {
    /// Findings, to which those of this search are added.
    pub findings: &'a mut Vec<Finding>,
    /// Set where something changed that has no name.
    pub unexplained: &'a mut bool,
    /// What comes nearest to that: a path that was given up, effects that no name is justified for.
    pub nearest: &'a mut Vec<Finding>,
    /// What was seen, in words.
    pub steps: &'a mut Vec<String>,
    /// The cells, without what a changed sensor path did to them.
    pub cells: &'a mut Vec<Cell>,
}

/// What was found before a search, to go back to.
pub struct Before {
    findings: Vec<Finding>,
    unexplained: bool,
    nearest: Vec<Finding>,
    steps: usize,
}

impl Found<'_> {
    /// What is found now.
    pub fn now(&self) -> Before {
        Before {
            findings: self.findings.clone(),
            unexplained: *self.unexplained,
            nearest: self.nearest.clone(),
            steps: self.steps.len(),
        }
    }

    /// What was added to the findings since.
    pub fn since(&self, before: &Before) -> &[Finding] {
        &self.findings[before.findings.len()..]
    }

    /// Forgets all that was found since; the cells are those of the next search.
    pub fn go_back(&mut self, before: Before) {
        *self.findings = before.findings;
        *self.unexplained = before.unexplained;
        *self.nearest = before.nearest;
        self.steps.truncate(before.steps);
    }

    /// Something changed that has no name. What comes nearest shares what earlier leads leave of
    /// the probability.
    pub fn leave_unexplained(&mut self, nearest: Vec<Finding>) {
        *self.unexplained = true;
        let left = 1.0 - self.nearest.iter().map(|f| f.probability).sum::<f64>();
        self.nearest.extend(nearest.into_iter().map(|f| Finding { probability: left * f.probability, ..f }));
    }
}
