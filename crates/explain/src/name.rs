//! From evidence to names: direct findings first (data, teeth, speeds), then sensor paths, then masks of lines, then strange lines.

pub mod alone;
pub mod bearing;
pub mod classes;
pub mod direct;
pub mod gear;
pub mod gear_side;
pub mod ghost;
pub mod path;
pub mod strange;
pub mod subname;

use std::collections::BTreeMap;

use gearwatch_core::bench::Bench;
use gearwatch_core::estimate::Estimate;
use gearwatch_core::train::Train;

use crate::change::compare::Comparison;
use crate::change::locate::{self, Cell};
use crate::judge::held_out;
use crate::judge::latent;
use crate::judge::publish::publish;
use crate::judge::report::{Evidence, Explanation};
use crate::read::dsp::mean;
use crate::read::features::RecordingFeatures;
use crate::read::folded::FoldedLine;
use crate::read::kinematics::OtherTeeth;
use crate::read::ratio::Ratios;
use crate::score::calibration::CALIBRATION;
use crate::score::search;

/// Everything that was measured.
pub struct Question<'a> {
    /// With corrected teeth where the sheet's were wrong.
    pub bench: &'a Bench,
    /// Kinematics of `bench`.
    pub train: &'a Train,
    /// Steady recordings.
    pub recordings: &'a [RecordingFeatures],
    /// Steady reference recordings.
    pub references: &'a [RecordingFeatures],
    /// Recordings against reference.
    pub comparison: &'a Comparison,
    /// Speeds; recordings first, then references.
    pub ratios: &'a Ratios,
    /// A tooth number of the sheet that is wrong.
    pub teeth: Option<&'a OtherTeeth>,
    /// Effects that are taken out of the library.
    pub without: &'a [&'a str],
}

/// An effect found, before it is published.
#[derive(Clone, Debug)]
pub struct Finding {
    /// Effect id.
    pub effect: &'static str,
    /// Place.
    pub place: String,
    /// That effect and place are right.
    pub probability: f64,
    /// That it enters there by an effect of this kind, whichever; not below `probability`.
    pub entry: f64,
    /// By name.
    pub parameters: BTreeMap<String, Estimate>,
    /// What cannot be told from it here.
    pub alternatives: Vec<(&'static str, String)>,
    /// Why.
    pub evidence: Evidence,
}

impl Finding {
    /// A finding without parameters.
    pub fn new(effect: &'static str, place: impl Into<String>, probability: f64) -> Self {
        Self {
            effect,
            place: place.into(),
            probability,
            entry: probability,
            parameters: BTreeMap::new(),
            alternatives: Vec::new(),
            evidence: Evidence::default(),
        }
    }

    /// With a parameter.
    pub fn with(mut self, name: &str, value: f64, sigma: f64) -> Self {
        self.parameters.insert(name.to_owned(), Estimate::new(value, sigma));
        self
    }
}

/// Largest misfit of one line: none decides.
const CAP: f64 = 30.0;
/// Half width of what a folded line covers (Hz): it wanders with the speed, and its neighbours' noise is not theirs.
const FOLDED_HZ: f64 = 10.0;

/// Whether a folded line, or the same line at a speed at which it lies in the band, falls on a cell.
fn folded_onto(q: &Question<'_>, l: &FoldedLine, c: &Cell) -> bool {
    let recording = &q.recordings[q.comparison.pairs[c.pair].recording];
    let hz = l.order * recording.input_hz;
    let seen_hz = if hz > 0.5 * recording.sample_rate_hz { recording.sample_rate_hz - hz } else { hz };
    c.family.is_some() && q.comparison.channels[c.channel] == l.channel && (c.frequency_hz - seen_hz).abs() < FOLDED_HZ
}

/// Channels of the first recording.
fn channel_names(q: &Question<'_>) -> Vec<String> {
    q.recordings.first().map(|r| r.channels.iter().map(|c| c.name.clone()).collect()).unwrap_or_default()
}

/// Answers.
pub fn answer(
    q: &Question<'_>,
    strange: strange::Strange,
    mut steps: Vec<String>,
    progress: &mut dyn FnMut(&str),
) -> Explanation {
    let mut findings = direct::findings(q, &mut steps);
    let mut unexplained = false;
    let mut fit = None;
    let mut p = None;
    let mut cells = locate::cells(q.comparison);
    if let Some(l) = &strange.folded {
        cells.retain(|c| !folded_onto(q, l, c));
    }
    let speeds: Vec<f64> = q.comparison.pairs.iter().map(|p| p.speed_hz).collect();
    if let Some(e) = &strange.envelope {
        steps.push(format!("envelope: order {:.3} stands out by {:.1} standard scores", e.order, e.score));
    }
    if !q.comparison.pairs.is_empty() && direct::comparable(q, &findings) {
        progress("what changed against the reference");
        let direct = findings.len();
        let lines = cells.iter().filter(|c| c.family.is_some());
        let squares: Vec<f64> = lines.map(|c| (c.change * c.change / c.variance).min(CAP)).collect();
        steps.push(format!(
            "{} pairs of recording and reference, {} lines, misfit {:.2} per line (below 0.8 on an unchanged bench)",
            speeds.len(),
            squares.len(),
            mean(&squares)
        ));
        let ghost = ghost::ghost(q, &mut steps);
        let outcome = search::search(q, &cells, &strange, ghost.as_ref(), &mut steps);
        findings.extend(ghost);
        findings.extend(outcome.findings);
        unexplained |= outcome.unexplained;
        p = Some(outcome.p_null);
        if findings.len() > direct || unexplained {
            fit = held_out::held_out(q, &cells, &speeds, &findings);
        }
    }
    strange::add_strange(q, &strange, &mut findings, &mut unexplained, &mut steps);
    if q.comparison.pairs.is_empty() && !unexplained && findings.iter().all(|f| strange::leaves_shafts(f.effect)) {
        direct::without_reference(q, &mut findings, &mut steps);
    }
    if q.comparison.pairs.is_empty()
        && findings.is_empty()
        && strange.bursts.as_ref().is_some_and(|b| b.nats(CALIBRATION.lone_bursts) > 0.0)
    {
        steps.extend(strange.bursts.iter().map(|b| b.describe(&channel_names(q))));
        unexplained = true;
    }
    if fit.is_none() {
        fit = direct::ratio_fit(q, &findings);
    }
    // With a second effect under it, a path's form is known far worse than its own fit says.
    if findings.len() > 1 {
        for f in findings.iter_mut().filter(|f| subname::is_path(f.effect)) {
            f.parameters.values_mut().for_each(|p| p.sigma *= 3.0);
        }
    }
    let known = findings.len();
    findings.retain(|f| !q.without.contains(&f.effect));
    unexplained |= findings.len() < known;
    let latent_force = if unexplained && findings.is_empty() { latent::force(q, &strange, &mut steps) } else { None };
    Explanation { p_null: p, latent_force, ..publish(q, findings, unexplained, &cells, fit, steps) }
}
