//! What changed sensor paths did, named and taken out: first by the background, then by the lines.

use std::cell::LazyCell;

use crate::change::frequency::{self, Frequency, Points};
use crate::change::locate::{self, Cell};
use crate::finding::{Finding, HOUSING};
use crate::judge::held_out;
use crate::name::found::{Found, MISFIT, SECOND_SURE};
use crate::name::{path, supports};
use crate::question::Question;

/// What is left to be asked of the machine.
pub struct WithoutPaths {
    /// Cells that a changed path has no part in.
    pub cells: Vec<Cell>,
    /// A path was taken off these very cells, and what else changed lies under it: a wide mask
    /// would take up what that leaves.
    pub under_path: bool,
    /// Paths that the background shows and that were given up, since the lines go with orders.
    pub given_up: Vec<Finding>,
    /// A path was given up for a bearing or a mesh, which the lines are to name.
    pub for_machine: bool,
}

/// Names sensor paths that changed, and takes out what they did. Where one is a factor, its own
/// lines less that stay; without another channel the path is taken off as the background tells it.
/// A path may be given up for a bearing or a mesh where `may_give_up` says so.
pub fn without_paths(
    q: &Question<'_>,
    (cells, speeds): (&[Cell], &[f64]),
    may_give_up: bool,
    found: &mut Found<'_>,
) -> WithoutPaths {
    found.steps.push(format!(
        "{} pairs of recording and reference, {} lines, misfit {:.2} per line (below 0.8 on an unchanged bench)",
        speeds.len(),
        cells.iter().filter(|c| c.family.is_some()).count(),
        locate::line_misfit(cells, None)
    ));
    let (paths, leads) = (found.findings.len(), found.nearest.len());
    let by_frequency = LazyCell::new(|| frequency::frequency(cells, Points::of(q)));
    let (reaches_all, mut clear) =
        by_background(q, (cells, speeds), &|| by_frequency.as_ref().map(|f| f.apart(cells).0), found);
    if (found.findings.len() > paths || locate::line_misfit(cells, None) >= MISFIT)
        && let Some(by_frequency) = LazyCell::force(&by_frequency)
        && let Some(finding) = supports::by_load(q, cells, by_frequency, found.steps)
    {
        // No path does that, nor what comes near one.
        found.findings.truncate(paths);
        found.nearest.truncate(leads);
        found.findings.push(finding);
        let cells = by_frequency.left_by_load(cells);
        return WithoutPaths { cells, under_path: true, given_up: Vec::new(), for_machine: false };
    }
    let (mut asked, mut given_up) = (None, Vec::new());
    let of_all = reaches_all || is_of_all(q, cells, &found.findings[paths..]);
    if (of_all || (found.findings.len() == paths && locate::line_misfit(cells, None) >= MISFIT))
        && let Some(by_frequency) = LazyCell::force(&by_frequency)
    {
        found.steps.push(format!(
            "a function of frequency accounts for the change {:.0} nats better than orders, beside them {:.0}",
            by_frequency.alone, by_frequency.beside
        ));
        if of_all && by_frequency.is_rather_orders() {
            // Meshes that changed bring more or less into the background too.
            given_up.extend(found.findings.drain(paths..));
            clear = (cells.to_vec(), false);
        } else if !of_all && let Some(by_lines) = by_lines(q, cells, speeds, by_frequency, found) {
            // What the background alone would not prove is proved by the lines.
            found.nearest.truncate(leads);
            clear = by_lines;
        }
        asked = Some(by_frequency);
    }
    // Supports of a shaft pass for the housing.
    let mut for_machine = false;
    let may_be_of_all = |at: &usize| reaches_all || path::may_be_the_housing(&found.findings[*at]);
    if let Some(at) = (paths..found.findings.len()).find(may_be_of_all)
        && supports::weigh(q, cells, asked, &mut found.findings[at], found.steps)
        && may_give_up
    {
        found.findings.remove(at);
        clear = (cells.to_vec(), false);
        for_machine = true;
    }
    let (cells, under_path) = clear;
    WithoutPaths { cells, under_path, given_up, for_machine }
}

/// The same by the background first: what moved there, and the lines with it. Says before whether
/// one path reaches all sensors.
fn by_background(
    q: &Question<'_>,
    (cells, speeds): (&[Cell], &[f64]),
    by_frequency: &dyn Fn() -> Option<Vec<Cell>>,
    found: &mut Found<'_>,
) -> (bool, (Vec<Cell>, bool)) {
    let mut remaining: Vec<Cell> = cells.to_vec();
    let mut reaches_all = false;
    let known = found.findings.len();
    if speeds.iter().all(|s| (s / speeds[0] - 1.0).abs() < 0.1) {
        found.findings.extend(path::paths_at_one_speed(q, &mut remaining, found.steps));
    } else if let Some((channels, mut finding)) = path::path(q, cells, speeds, by_frequency, found.steps) {
        if let Some(probability) = held_out::of_path(q, &finding, found.steps) {
            if probability < held_out::UNPROVED {
                found.nearest.push(Finding { probability, ..finding });
                return (false, (cells.to_vec(), false));
            }
            finding.probability = finding.probability.min(probability);
        }
        reaches_all = channels.len() > 1;
        for channel in channels {
            remaining = locate::without_path(&remaining, channel, speeds);
        }
        found.findings.push(finding);
    }
    let paths = &found.findings[known..];
    let changed = |c: &Cell| paths.iter().find(|f| of_path(q, f, c));
    if paths.is_empty() || reaches_all || remaining.iter().all(|c| changed(c).is_some()) {
        return (reaches_all, (remaining, !paths.is_empty()));
    }
    let clear = cells.iter().filter_map(|c| match changed(c) {
        None => Some(*c),
        Some(f) => {
            let factor = f.parameters.get("factor").filter(|_| f.effect == "scaling")?;
            Some(Cell { change: c.change - factor.value.ln(), ..*c })
        }
    });
    (false, (clear.collect(), false))
}

/// The same by the lines first: a function of frequency, alone (true) or beside what goes with
/// orders.
fn by_lines(
    q: &Question<'_>,
    cells: &[Cell],
    speeds: &[f64],
    by_frequency: &Frequency,
    found: &mut Found<'_>,
) -> Option<(Vec<Cell>, bool)> {
    if !by_frequency.is_there() {
        return None;
    }
    let (path, left) = by_frequency.apart(cells);
    let mut finding = path::of_lines(q, &path, &by_frequency.by_channel, speeds, found.steps)?;
    if by_frequency.has_orders_beside() {
        finding.probability *= SECOND_SURE;
    }
    found.findings.push(finding);
    Some((left, !by_frequency.has_orders_beside()))
}

/// Whether a cell is read through a changed path.
fn of_path(q: &Question<'_>, path: &Finding, cell: &Cell) -> bool {
    path.place == HOUSING || path.place == q.comparison.channels[cell.channel]
}

/// Whether all that was found are paths that every line is read through, and that are more than one
/// factor: the meshes' own changes pass for such.
fn is_of_all(q: &Question<'_>, cells: &[Cell], paths: &[Finding]) -> bool {
    let on_path = |c: &Cell| paths.iter().any(|f| of_path(q, f, c));
    !paths.is_empty() && cells.iter().all(on_path) && !paths.iter().all(|f| f.effect == "scaling")
}
