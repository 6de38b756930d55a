//! A changed sensor path, gain or mounting: the same function of frequency for lines and background
//! at every speed.

use crate::change::locate::{self, Cell};
use crate::finding::{Finding, HOUSING};
use crate::name::own_sensor::{self, Leader};
use crate::name::path_form::{
    DampingFit, PathFit, Profile, damping_fit, mounting_fit, one_factor_misfit, profile, resonance_fit,
};
use crate::question::Question;
use crate::read::dsp::median;

/// Least misfit per background band, and least share that a path must account for, before a path is
/// believed: on an unchanged bench background changes by less than 1 per band, by 2.05 at most.
const FLOOR_MISFIT: f64 = 2.5;
const FLOOR_SHARE: f64 = 0.55;
/// Misfit per band that a path accounts for, from which a sensor is one of those that moved
/// together: unchanged sensors reach 0.33, those beside one whose path changed 0.12.
const TOGETHER: f64 = 0.8;
/// How far the lines may go with the background, and how clearly (standard deviations). A path
/// takes both along by the same factor, but for the sensor's own noise: 0.5 to 1.7 of what the
/// background does. Noise leaves the lines (0 ± 0.04), gears move them first (2.4 to 4.3 times the
/// background, or against it).
const FOLLOWS: std::ops::RangeInclusive<f64> = 0.4..=1.9;
const CLEARLY: f64 = 5.0;
/// How much worse per band one factor may fit than a resonance and still be the simpler answer.
const ONE_FACTOR: f64 = 1.5;
/// Largest misfit per line of the quietest other channel over that of the channel.
const OTHERS_SHARE: f64 = 1.0;

/// The same at one speed, where only the background tells a path from the gears: least misfit per
/// band, least share of the misfit of the lines that the background's own change accounts for. How
/// many times less the background of other channels must have moved, at one speed or several:
/// meshes that make noise move it on all.
const FLOOR_MISFIT_ALONE: f64 = 6.0;
const LINE_SHARE_ALONE: f64 = 0.3;
const STEADIER: f64 = 3.0;
/// Where there is no other channel: gears that change move the background by 2.7 per band at most,
/// and do not take two thirds of the lines' misfit along.
const FLOOR_MISFIT_LONE: f64 = 12.0;
const LINE_SHARE_LONE: f64 = 0.66;
/// What remains to doubt of a path of all sensors: what else they may have in common; of a support
/// that was taken for one, the sheet's masses too.
pub const SUREST: f64 = 0.8;
/// Share of the best from which another stands in the set.
pub const IN_SET: f64 = 0.05;
/// How far a line lies from the band of background that stands for it (ln).
const BAND_SIGMA: f64 = 0.2;

/// What the background about a line did in the same pair and channel.
fn floor_beside(cell: &Cell, cells: &[Cell]) -> Option<f64> {
    cells
        .iter()
        .filter(|f| f.family.is_none() && f.pair == cell.pair && f.channel == cell.channel)
        .map(|f| ((f.frequency_hz / cell.frequency_hz).ln().abs(), f.change))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .filter(|(distance, _)| *distance < 0.12)
        .map(|(_, change)| change)
}

/// Changed paths where all recordings were made at one speed: channels whose background moved,
/// whose lines moved along with it, while the background of another channel stayed. Takes what the
/// background says off the lines of these channels.
pub fn paths_at_one_speed(q: &Question<'_>, cells: &mut [Cell], steps: &mut Vec<String>) -> Vec<Finding> {
    let misfit = |c: usize| {
        let bands = cells.iter().filter(|x| x.channel == c && x.family.is_none());
        let (sum, n) = bands.fold((0.0, 0usize), |(s, n), x| (s + x.change * x.change / x.variance, n + 1));
        sum / n.max(1) as f64
    };
    let floors: Vec<f64> = (0..q.comparison.channels.len()).map(misfit).collect();
    let steadiest = floors.iter().copied().fold(f64::INFINITY, f64::min);
    let lone = floors.len() == 1;
    let mut out = Vec::new();
    for (c, floor) in floors.iter().enumerate() {
        let corrected: Vec<(usize, f64)> = cells
            .iter()
            .enumerate()
            .filter(|(_, x)| x.channel == c && x.family.is_some())
            .filter_map(|(i, x)| Some((i, floor_beside(x, cells)?)))
            .collect();
        let (before, after) = corrected.iter().fold((0.0, 0.0), |(b, a), (i, by)| {
            let x = &cells[*i];
            (b + x.change.powi(2) / x.variance, a + (x.change - by).powi(2) / x.variance)
        });
        let share = 1.0 - after / before.max(1e-9);
        let name = &q.comparison.channels[c];
        steps.push(format!(
            "one speed; background of {name}: misfit {floor:.1} per band, its change accounts for {:.0} % of the misfit of the lines",
            100.0 * share
        ));
        let moved = match lone {
            true => *floor > FLOOR_MISFIT_LONE && share > LINE_SHARE_LONE,
            false => *floor > FLOOR_MISFIT_ALONE && share > LINE_SHARE_ALONE && *floor > STEADIER * steadiest,
        };
        if !moved {
            continue;
        }
        let mut f = Finding::new("sensor_mounting", name.clone(), 0.8);
        f.alternatives.push(("structural_resonance", name.clone()));
        f.evidence.place = format!("lines and background of {name} alone");
        let other = match lone {
            true => "there is no other channel to compare it with".to_owned(),
            false => format!("that of another channel stayed at {steadiest:.1}"),
        };
        f.evidence.law = format!(
            "the background moved by {floor:.1} per band and took the lines along ({:.0} % of their misfit); {other}",
            100.0 * share
        );
        out.push((f, corrected));
    }
    for (_, corrected) in &out {
        for (i, by) in corrected {
            cells[*i].change -= by;
            cells[*i].variance += BAND_SIGMA * BAND_SIGMA;
            cells[*i].noise += BAND_SIGMA * BAND_SIGMA;
        }
    }
    out.into_iter().map(|(f, _)| f).collect()
}

/// Whether the lines of a channel follow its background as a path takes both along.
fn follow(follows: f64, sigma: f64) -> bool {
    FOLLOWS.contains(&follows) && follows > CLEARLY * sigma
}

/// Whether the background of a sensor (share of its misfit that a path accounts for, misfit per
/// band) moved as that of one did whose path changed.
fn moved_together(&(share, misfit): &(f64, f64)) -> bool {
    share > FLOOR_SHARE && share * misfit > TOGETHER
}

/// A changed path that reaches all sensors: on each of several the background moved as the same
/// function of frequency at every speed, and the lines with it.
fn of_several(
    q: &Question<'_>,
    cells: &[Cell],
    floors: &[(f64, f64)],
    by_frequency: &dyn Fn() -> Option<Vec<Cell>>,
    steps: &mut Vec<String>,
) -> Option<Finding> {
    if floors.len() < 2 || !floors.iter().all(moved_together) {
        return None;
    }
    let follows: Vec<(f64, f64)> =
        (0..floors.len()).map(|c| locate::follows_background(cells, c)).collect::<Option<_>>()?;
    let said: Vec<String> = follows.iter().map(|(f, s)| format!("{f:.2} ± {s:.2}")).collect();
    steps.push(format!(
        "the background moved on all sensors; their lines follow it by {} of its change (1 of a path, 0 of noise)",
        said.join(", ")
    ));
    // What all sensors share is one number, of which each tells its part.
    let weight: f64 = follows.iter().map(|(_, s)| s.powi(-2)).sum();
    let shared = follows.iter().map(|(f, s)| f * s.powi(-2)).sum::<f64>() / weight;
    if !follow(shared, weight.sqrt().recip()) {
        return None;
    }
    let by_frequency = by_frequency().unwrap_or_else(|| cells.to_vec());
    Some(of_all_or_one(q, (cells, &by_frequency), floors, (1.0, 0), steps))
}

/// What a changed path is that is clearest on one sensor and reaches all with the probability
/// `all`: the housing's, or that of the sensor which it moved most. `floors` has the share of each
/// sensor's background that the same function of frequency at all speeds accounts for, and its
/// misfit per band; `by_frequency` the part of the changes that is one.
fn of_all_or_one(
    q: &Question<'_>,
    (cells, by_frequency): (&[Cell], &[Cell]),
    floors: &[(f64, f64)],
    (all, clearest): (f64, usize),
    steps: &mut Vec<String>,
) -> Finding {
    let leader = own_sensor::leader(by_frequency, floors.len());
    if let Some(Leader { channel, lead, own }) = leader {
        steps.push(format!(
            "the path moved {} {:.1} times as much as the next sensor: its own with probability {own:.2}, twice as much being even odds",
            q.comparison.channels[channel],
            lead.exp()
        ));
    }
    let of_housing = all * leader.map_or(1.0, |l| 1.0 - l.own);
    let mut f = if of_housing < 0.5 {
        let own = leader.map_or(clearest, |l| l.channel);
        let (share, misfit) = floors[own];
        of_one(q, cells, (own, floors.len()), (misfit, share), all >= 0.5, steps)
    } else {
        of_all(cells, floors.len(), steps)
    };
    f.probability *= of_housing.max(1.0 - of_housing);
    let other = match leader {
        _ if f.place != HOUSING => HOUSING.to_owned(),
        Some(leader) => q.comparison.channels[leader.channel].clone(),
        None => return f,
    };
    if of_housing.min(1.0 - of_housing) > IN_SET * of_housing.max(1.0 - of_housing) {
        f.alternatives.push(("structural_resonance", other));
    }
    f
}

/// What a changed path of all sensors is: modes that are damped otherwise, or one that came or
/// moved, both as likely before.
fn of_all(cells: &[Cell], sensors: usize, steps: &mut Vec<String>) -> Finding {
    let (resonance, damping) = modes(cells, sensors);
    if let Some(damping) = &damping {
        steps.push(format!(
            "change of the housing over frequency: {} modes that are damped {:.2} times as much account for it better than modes that moved, by {:.1} nats",
            damping.modes, damping.factor, damping.nats
        ));
    }
    let is_damping = probability(damping.as_ref().map_or(f64::NEG_INFINITY, |d| d.nats));
    let sure = SUREST * is_damping.max(1.0 - is_damping);
    let mut f = if let Some(damping) = damping.filter(|_| is_damping > 0.5) {
        let mut f = Finding::new("damping", HOUSING, sure).with("factor", damping.factor, 0.35 * damping.factor);
        f.alternatives.push(("structural_resonance", HOUSING.to_owned()));
        f
    } else {
        let sigma_hz = (0.03 * (1.0 + resonance.left).sqrt() * resonance.frequency_hz).hypot(resonance.spread_hz);
        let mut f =
            Finding::new("structural_resonance", HOUSING, sure).with("frequency_hz", resonance.frequency_hz, sigma_hz);
        f.alternatives.push(("damping", HOUSING.to_owned()));
        f
    };
    f.evidence.place = "lines and background of all sensors".into();
    f.evidence.law = "a function of frequency, the same at every speed".into();
    f
}

/// By how much (nats) modes that are damped otherwise account better for what all sensors show than
/// modes that moved.
pub fn damping_nats(q: &Question<'_>, cells: &[Cell]) -> f64 {
    modes(cells, q.comparison.channels.len()).1.map_or(f64::NEG_INFINITY, |damping| damping.nats)
}

/// What all sensors show as one mode that came or moved, and as modes that are damped otherwise.
fn modes(cells: &[Cell], sensors: usize) -> (PathFit, Option<DampingFit>) {
    let profiles: Vec<Profile> = (0..sensors).map(|c| profile(cells, c)).collect();
    let resonance = resonance_fit(&profiles);
    let damping = damping_fit(&profiles, &resonance);
    (resonance, damping)
}

/// Whether what was named of a path may be the housing's.
pub fn may_be_the_housing(f: &Finding) -> bool {
    f.place == HOUSING || f.alternatives.iter().any(|(_, place)| place == HOUSING)
}

/// The channels whose path or gain changed, and what to call it; `by_frequency` gives the part of
/// the changes that is a function of frequency.
pub fn path(
    q: &Question<'_>,
    cells: &[Cell],
    speeds: &[f64],
    by_frequency: &dyn Fn() -> Option<Vec<Cell>>,
    steps: &mut Vec<String>,
) -> Option<(Vec<usize>, Finding)> {
    let mut best: Option<(usize, f64, f64)> = None;
    let channels = 0..q.comparison.channels.len();
    let floors: Vec<(f64, f64)> = channels.map(|c| locate::floor_account(cells, c, speeds)).collect();
    for (c, &(share, misfit)) in floors.iter().enumerate() {
        steps.push(format!(
            "background of {}: misfit {misfit:.2} per band, of which the same function of frequency at all speeds explains {:.0} %",
            q.comparison.channels[c],
            100.0 * share
        ));
        if misfit > FLOOR_MISFIT && share > FLOOR_SHARE && best.is_none_or(|b| misfit * share > b.1 * b.2) {
            best = Some((c, misfit, share));
        }
    }
    let (c, misfit, share) = best?;
    let noisy = |k: usize, other: f64| k != c && other > FLOOR_MISFIT && misfit < STEADIER * other;
    let all = floors.len() > 1 && floors.iter().all(moved_together);
    if all || floors.iter().enumerate().any(|(k, (_, other))| noisy(k, *other)) {
        return Some(((0..floors.len()).collect(), of_several(q, cells, &floors, by_frequency, steps)?));
    }
    let lines = |k: usize| locate::line_misfit(cells, Some(k));
    let others = (0..q.comparison.channels.len()).filter(|k| *k != c).map(lines).fold(f64::NAN, f64::min);
    let (own, (follows, sigma)) = (lines(c), locate::follows_background(cells, c)?);
    let name = q.comparison.channels[c].clone();
    steps.push(format!(
        "lines of {name}: misfit {own:.2} per line, other channels {others:.2}; they follow the background by {follows:.2} ± {sigma:.2} of its change (1 of a path, 0 of noise)"
    ));
    if !follow(follows, sigma) || others > OTHERS_SHARE * own {
        return None;
    }
    let f = of_one(q, cells, (c, floors.len()), (misfit, share), false, steps);
    Some((vec![c], f))
}

/// What a function of frequency that the lines prove is: the sensor's own way, or what all sensors
/// have in common. `by_channel` are the log evidences (nats) of each sensor's part in it: the odds
/// of all against the clearest alone are those of the others together, both as likely before.
pub fn of_lines(
    q: &Question<'_>,
    cells: &[Cell],
    by_channel: &[f64],
    speeds: &[f64],
    steps: &mut Vec<String>,
) -> Option<Finding> {
    let clearest = (0..by_channel.len()).max_by(|a, b| by_channel[*a].total_cmp(&by_channel[*b]))?;
    let said: Vec<String> =
        by_channel.iter().zip(&q.comparison.channels).map(|(nats, name)| format!("{nats:.0} on {name}")).collect();
    steps.push(format!("nats of the function of frequency by sensor: {}", said.join(", ")));
    let sensors = q.comparison.channels.len();
    let others: f64 = by_channel.iter().sum::<f64>() - by_channel[clearest];
    let all = if sensors > 1 { probability(others) } else { 0.0 };
    let floors: Vec<(f64, f64)> = (0..sensors).map(|c| locate::floor_account(cells, c, speeds)).collect();
    Some(of_all_or_one(q, (cells, cells), &floors, (all, clearest), steps))
}

/// Probability by log odds (nats), however large.
fn probability(nats: f64) -> f64 {
    (1.0 + (-nats).exp()).recip()
}

/// What the changed path or gain of one sensor out of so many is; its background moved by `misfit`
/// per band, of which the same function of frequency at all speeds is a `share`. A mounting does
/// not reach other sensors.
fn of_one(
    q: &Question<'_>,
    cells: &[Cell],
    (c, sensors): (usize, usize),
    (misfit, share): (f64, f64),
    reaches_others: bool,
    steps: &mut Vec<String>,
) -> Finding {
    let name = q.comparison.channels[c].clone();
    // One factor for lines and background alike?
    let mut changes: Vec<f64> = cells.iter().filter(|x| x.channel == c).map(|x| x.change).collect();
    let middle = median(&mut changes);
    let flat: f64 = {
        let mut spread: Vec<f64> =
            cells.iter().filter(|x| x.channel == c && x.variance < 0.02).map(|x| (x.change - middle).abs()).collect();
        1.4826 * median(&mut spread)
    };
    let profile = profile(cells, c);
    let resonance = resonance_fit(std::slice::from_ref(&profile));
    let mounting = mounting_fit(&profile);
    let one_factor = one_factor_misfit(&profile);
    let evidence_law = format!(
        "lines and background of {name} change together: background by {misfit:.1} per band, {:.0} % of it the same at every speed",
        100.0 * share
    );
    steps.push(format!(
        "change of {name} over frequency: misfit of one factor {one_factor:.2} per band, of a mounting resonance {:.2}, of a resonance of the structure {:.2}",
        mounting.left, resonance.left
    ));
    // Above its frequency a resonance of the structure is one factor too; what it does about its
    // frequency tells.
    if flat < 0.12 && middle.abs() > 0.15 && one_factor < ONE_FACTOR + mounting.left.min(resonance.left) {
        let mut f = Finding::new("scaling", name, 0.97).with("factor", middle.exp(), 0.02 * middle.exp());
        f.evidence.law = evidence_law;
        f.evidence.place =
            format!("every line and the background of this channel by the same factor {:.3}", middle.exp());
        return f;
    }
    let (first, second) = if mounting.left <= resonance.left && !reaches_others {
        ("sensor_mounting", "structural_resonance")
    } else {
        ("structural_resonance", "sensor_mounting")
    };
    let mut f = Finding::new(first, name.clone(), 0.95);
    if first == "sensor_mounting" {
        // What the form of the fit leaves enters the sigmas: a second effect may lie under it.
        let doubt = (1.0 + mounting.left).sqrt();
        let sigma_hz = (0.03 * doubt * mounting.frequency_hz).hypot(mounting.spread_hz);
        let gain = mounting.gain;
        f = f.with("frequency_hz", mounting.frequency_hz, sigma_hz).with("gain", gain, 0.08 * doubt * gain);
    } else {
        let sigma_hz = (0.015 * (1.0 + resonance.left).sqrt() * resonance.frequency_hz).hypot(resonance.spread_hz);
        let damping = resonance.damping;
        f = f.with("frequency_hz", resonance.frequency_hz, sigma_hz).with("damping_ratio", damping, 0.4 * damping);
    }
    f.alternatives.push((second, name));
    // The only sensor cannot tell its own way from the housing's, which no mounting has below its
    // resonance.
    if sensors == 1 && first == "structural_resonance" {
        f.alternatives.push((first, HOUSING.to_owned()));
        f.probability = 0.6;
    }
    f.evidence.law = evidence_law;
    f.evidence.place = "all lines and the background of one sensor".into();
    f.evidence.shape = format!(
        "misfit of the change over frequency: mounting resonance {:.2}, resonance of the structure {:.2}",
        mounting.left, resonance.left
    );
    f
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Even odds are a half, ln 3 is three in four; odds beyond what a number holds are certain.
    #[test]
    fn analytic_log_odds_of_any_size_are_a_probability() {
        assert_eq!(probability(0.0), 0.5);
        assert!((probability(3f64.ln()) - 0.75).abs() < 1e-15);
        assert_eq!((probability(2000.0), probability(-2000.0), probability(f64::NEG_INFINITY)), (1.0, 0.0, 0.0));
    }
}
