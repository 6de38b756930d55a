//! Ghost components: an undulation of the flanks with a wave number that is no tooth number.
//!
//! `n` waves a turn make a line at order `n` of the gear's shaft; the mesh, which repeats `z` times
//! a turn, mixes it to `n + h z` and `h z − n`. Errors of the teeth are there on every multiple of
//! the shaft: their spectrum repeats about every harmonic of the mesh (Mark 1978) and runs through
//! a path that neighbours share, like Rayleigh amplitudes. The ghost's own order alone leads its
//! neighbours, at every speed and on all sensors, and those that it is mixed to as well. Against a
//! reference the same is asked of what changed.

use crate::finding::Finding;
use crate::name::alone::{self, Powers};
use crate::name::family::passes_at;
use crate::name::gear::gears_on;
use crate::question::Question;
use crate::read::SAME_SPEED;
use crate::read::dsp::mean;
use crate::read::features::{ChannelFeatures, RecordingFeatures};
use crate::read::lines::SHAFT_MULTIPLES;

/// Neighbours on each side that a multiple of a shaft must lead.
const BESIDE: usize = 4;
/// Waves a turn that are looked for: from where all neighbours lie above the low orders of the
/// shaft, below what the mesh mixes lines to.
const FEWEST: usize = SHAFT_MULTIPLES as usize + BESIDE + 1;
/// Multiples nearer than this to a mesh harmonic of the gear are its low sidebands.
const LOW: usize = 6;
/// Lines nearer than this (bins) may be one.
const ONE_BINS: f64 = 3.0;
/// ln amplitude (mean over sensors, loads and speeds) by which the own order leads the highest of
/// its neighbours, each above the line through them, and by half as much at every speed: a
/// resonance of the path lifts a line at one.
const LEAD: f64 = 1.7;
const LEAD_AT_ONE_SPEED: f64 = 2.5;
/// From this lead of the change against a reference on, nothing but a ghost is known. Below it,
/// bearings light single lines too: of 527 comparisons without a ghost three lead by 1.5 to 2.1,
/// which makes a ghost, one effect of some thirty, several times as probable.
const SURE_LEAD_OF_CHANGE: f64 = 2.3;
/// ln amplitude by which that lead exceeds that of every other multiple of the shaft, what the mesh
/// mixes the waves to among them: a component of the pitch error that stands out does so about
/// every mesh harmonic, and a bearing lights a family of lines. Of 352 benches of another generator
/// without a ghost, 266 of them by their references alone, some lead by up to 3.6. Of what a gear
/// could bear and no other shaft shares, none that leads enough exceeds by more than 0.9; ghosts
/// exceed by 1.4 at least.
const LONE: f64 = 1.0;
/// Mesh harmonics up to which mixed lines are looked at.
const MIXED: usize = 3;
/// ln amplitude by which a line is lower where another shaft's multiple is taken for its own: a
/// third of a bin off.
const OFF: f64 = 0.1;
/// Scale (nats) on which the lead of the lines that a gear's teeth mix tells of two gears on a
/// shaft.
const MIXED_SCALE: f64 = 0.5;
/// What is believed of a ripple of the brake at a high multiple of its shaft.
const OF_BRAKE: f64 = 0.8;
/// Distance from a whole multiple of a shaft.
const WHOLE: f64 = 0.02;
/// A gear this much less probable than its fellow does not stand in the set.
const LEFT_OUT: f64 = 0.05;

/// The multiples of a shaft.
struct Comb {
    /// Distance between multiples (orders of the input shaft).
    order: f64,
    /// Mean ln amplitude, from the first.
    level: Vec<f64>,
    /// Lead of that over the highest neighbour, and the least at one speed; `None` on mesh
    /// harmonics and where neighbours are missing.
    lead: Vec<Option<(f64, f64)>>,
    /// Lead that makes a ghost.
    needed: f64,
}

impl Comb {
    fn lead(&self, multiple: usize) -> Option<(f64, f64)> {
        *self.lead.get(multiple.checked_sub(1)?)?
    }

    fn at_all_speeds(&self, multiple: usize) -> Option<f64> {
        self.lead(multiple).map(|l| l.0)
    }

    /// Lead of the multiple, above the low orders, that leads most beside one.
    fn highest_beside(&self, multiple: usize) -> f64 {
        let others = (FEWEST..=self.lead.len()).filter(|m| *m != multiple);
        others.filter_map(|m| self.at_all_speeds(m)).fold(f64::NEG_INFINITY, f64::max)
    }
}

/// A gear that may carry the waves.
struct Bearer {
    gear: String,
    /// Lead of the highest line that its teeth mix the waves to.
    mixed: f64,
}

/// A multiple that leads its neighbours.
struct Candidate {
    shaft: usize,
    multiple: usize,
    lead: f64,
    level: f64,
    bearers: Vec<Bearer>,
}

/// ln amplitude, not below noise.
fn level(channel: &ChannelFeatures, shaft: usize) -> Vec<f64> {
    channel.combs[shaft].iter().map(|l| 0.5 * l.amplitude.norm_sqr().max(l.noise).max(f64::MIN_POSITIVE).ln()).collect()
}

/// Speed and ln amplitudes of the multiples of a shaft, by recording and sensor that does not clip,
/// each over its reference where there is one.
fn levels(q: &Question<'_>, shaft: usize) -> Vec<(f64, Vec<f64>)> {
    let clips = |c: &ChannelFeatures| c.integrity.clipped_at.is_some();
    let one = |recording: &RecordingFeatures, reference: Option<&RecordingFeatures>| {
        let channels = recording.channels.iter().filter(|c| !clips(c));
        let change = |c: &ChannelFeatures| {
            let own = level(c, shaft);
            let Some(reference) = reference else { return Some(own) };
            let before = reference.channels.iter().find(|x| x.name == c.name && !clips(x))?;
            Some(own.iter().zip(level(before, shaft)).map(|(a, b)| a - b).collect())
        };
        let all: Vec<Vec<f64>> = channels.filter_map(change).collect();
        (recording.input_hz, all)
    };
    let twins: Vec<(f64, Vec<Vec<f64>>)> = if q.comparison.pairs.is_empty() {
        q.recordings.iter().map(|r| one(r, None)).collect()
    } else {
        let pairs = q.comparison.pairs.iter();
        pairs.map(|p| one(&q.recordings[p.recording], Some(&q.references[p.reference]))).collect()
    };
    let each = |(hz, channels): (f64, Vec<Vec<f64>>)| channels.into_iter().map(move |c| (hz, c));
    twins.into_iter().flat_map(each).collect()
}

/// By multiple of a shaft, how far it leads its neighbours.
fn comb(q: &Question<'_>, shaft: usize, reach: f64) -> Comb {
    let order = q.train.shafts[shaft].1;
    let all = levels(q, shaft);
    let shown = all.iter().map(|l| l.1.len()).min().unwrap_or(0);
    let of_mesh: Vec<bool> = (1..=shown)
        .map(|m| {
            let own = m as f64 * order;
            q.train.stages.iter().any(|s| {
                let h = (own / s.mesh_order).round();
                h >= 1.0 && (h * s.mesh_order - own).abs() < reach
            })
        })
        .collect();
    let mut speeds: Vec<(f64, Vec<&Vec<f64>>)> = Vec::new();
    for (hz, values) in &all {
        match speeds.iter_mut().find(|s| (s.0 / hz - 1.0).abs() < SAME_SPEED) {
            Some(s) => s.1.push(values),
            None => speeds.push((*hz, vec![values])),
        }
    }
    let means = |members: &[&Vec<f64>]| -> Vec<f64> {
        (0..shown).map(|k| mean(&members.iter().map(|v| v[k]).collect::<Vec<_>>())).collect()
    };
    let by_speed: Vec<Vec<f64>> = speeds.iter().map(|(_, members)| means(members)).collect();
    let level = means(&by_speed.iter().collect::<Vec<_>>());
    let lead = |m: usize| {
        let beside = m.saturating_sub(BESIDE).max(1)..=(m + BESIDE).min(shown);
        let beside: Vec<usize> = beside.filter(|k| *k != m && !of_mesh[k - 1]).collect();
        if of_mesh[m - 1] || beside.len() < BESIDE {
            return None;
        }
        let over = |v: &Vec<f64>| over_neighbours(v, m, &beside);
        Some((over(&level), by_speed.iter().map(over).fold(f64::INFINITY, f64::min)))
    };
    let needed = if speeds.len() < 2 { LEAD_AT_ONE_SPEED } else { LEAD };
    let lead = (1..=shown).map(lead).collect();
    Comb { order, level, lead, needed }
}

/// Height of a multiple over its highest neighbour, both above the line through all of these where
/// they lie on both sides: on the flank of a resonance they rise or fall together.
fn over_neighbours(levels: &[f64], multiple: usize, beside: &[usize]) -> f64 {
    let off = |k: usize| k as f64 - multiple as f64;
    let count = beside.len() as f64;
    let middle = beside.iter().map(|&k| off(k)).sum::<f64>() / count;
    let height = beside.iter().map(|&k| levels[k - 1]).sum::<f64>() / count;
    let (mut rise, mut square) = (0.0, 0.0);
    for &k in beside {
        rise += (off(k) - middle) * (levels[k - 1] - height);
        square += (off(k) - middle).powi(2);
    }
    let sides = [beside.iter().filter(|k| **k < multiple).count(), beside.iter().filter(|k| **k > multiple).count()];
    let slope = if sides.iter().all(|n| *n > 1) { rise / square } else { 0.0 };
    let above = |k: usize| levels[k - 1] - slope * off(k);
    above(multiple) - beside.iter().map(|&k| above(k)).fold(f64::NEG_INFINITY, f64::max)
}

/// Distance of a multiple from the nearest multiple of the teeth.
fn remainder(multiple: usize, teeth: usize) -> usize {
    (multiple % teeth).min(teeth - multiple % teeth)
}

/// Multiples that the mesh mixes waves to.
fn mixed(multiple: usize, teeth: usize) -> impl Iterator<Item = usize> {
    let rest = multiple % teeth;
    (0..=MIXED)
        .flat_map(move |h| [Some(h * teeth + rest), (h * teeth).checked_sub(rest)])
        .flatten()
        .filter(move |m| *m > 1 && *m != multiple)
}

fn candidate(q: &Question<'_>, combs: &[Comb], shaft: usize, multiple: usize, reach: f64) -> Option<Candidate> {
    let comb = &combs[shaft];
    let (mut lead, mut least) = comb.lead(multiple)?;
    // Where the line may lie on another shaft's multiple as well, it must lead there too, and be
    // none of the low orders that ripples make.
    for other in combs.iter().enumerate().filter(|(j, _)| *j != shaft).map(|(_, c)| c) {
        let near = (multiple as f64 * comb.order / other.order).round() as usize;
        let one = near >= 1 && (near as f64 * other.order - multiple as f64 * comb.order).abs() < reach;
        if one && other.level.get(near - 1).is_some_and(|l| *l > comb.level[multiple - 1] - OFF) {
            let (there, least_there) = other.lead(near).filter(|_| near >= FEWEST)?;
            lead = lead.min(there);
            least = least.min(least_there);
        }
    }
    if lead <= comb.needed || least <= 0.5 * comb.needed {
        return None;
    }
    if comb.at_all_speeds(multiple)? - comb.highest_beside(multiple) < LONE {
        return None;
    }
    let bearer = |gear: String| {
        let teeth = teeth_of(q, &gear)? as usize;
        let mixed = mixed(multiple, teeth).filter_map(|m| comb.at_all_speeds(m)).fold(f64::NEG_INFINITY, f64::max);
        let fits = remainder(multiple, teeth) >= LOW && multiple < (MIXED + 1) * teeth;
        fits.then_some(Bearer { gear, mixed })
    };
    let bearers: Vec<Bearer> = gears_on(q.bench, shaft).into_iter().filter_map(bearer).collect();
    (!bearers.is_empty()).then(|| Candidate { shaft, multiple, lead, level: comb.level[multiple - 1], bearers })
}

/// The multiple of one shaft that leads its neighbours, where one does.
///
/// None that lies on a multiple of a bearing's passages (`passage`, order of the input shaft): its
/// impacts light that line.
pub fn ghost(q: &Question<'_>, passage: Option<f64>, steps: &mut Vec<String>) -> Option<Finding> {
    let reach = q.recordings.iter().map(|r| ONE_BINS / r.revolutions).fold(0.0, f64::max);
    let revolutions = q.recordings.iter().map(|r| r.revolutions).fold(f64::INFINITY, f64::min);
    let combs: Vec<Comb> = (0..q.train.shafts.len()).map(|j| comb(q, j, reach)).collect();
    let mut all: Vec<Candidate> = Vec::new();
    for (j, comb) in combs.iter().enumerate() {
        let of_bearing = |m: &usize| passage.is_some_and(|p| passes_at(p, *m as f64 * comb.order, revolutions));
        let multiples = (FEWEST..=comb.lead.len()).filter(|m| !of_bearing(m));
        all.extend(multiples.filter_map(|m| candidate(q, &combs, j, m, reach)));
    }
    let highest = all.iter().max_by(|a, b| a.lead.total_cmp(&b.lead))?;
    // Multiples of two shafts that are one line: the one that it lies on.
    let order = |c: &Candidate| c.multiple as f64 * combs[c.shaft].order;
    let at = order(highest);
    let mut all: Vec<Candidate> = all.into_iter().filter(|c| (order(c) - at).abs() < reach).collect();
    all.sort_by(|a, b| b.level.total_cmp(&a.level));
    let top = all[0].level;
    all.retain(|c| top - c.level < OFF);
    // Of two gears, the one whose teeth mix the waves more.
    let strongest = all.iter().flat_map(|c| &c.bearers).map(|b| b.mixed).fold(f64::NEG_INFINITY, f64::max);
    let mut shares: Vec<(f64, &Candidate, &Bearer)> = all
        .iter()
        .flat_map(|c| c.bearers.iter().map(move |b| (((b.mixed - strongest) / MIXED_SCALE).exp(), c, b)))
        .collect();
    let sum: f64 = shares.iter().map(|s| s.0).sum();
    shares.sort_by(|a, b| b.0.total_cmp(&a.0));
    let (share, own, bearer) = *shares.first()?;
    steps.push(format!(
        "multiple of a shaft that leads its neighbours most: {} of {}, by {:.1} nats; what {} mixes it to by {:.1}",
        own.multiple, q.train.shafts[own.shaft].0, own.lead, bearer.gear, bearer.mixed
    ));
    let new = !q.comparison.pairs.is_empty();
    let sure = match (new, own.lead > SURE_LEAD_OF_CHANGE) {
        (true, true) => 0.93,
        (true, false) => 0.8,
        (false, _) => 0.9,
    };
    let mut f = Finding::new("ghost_component", bearer.gear.clone(), sure * share / sum).with(
        "order",
        own.multiple as f64,
        0.2,
    );
    // A torque goes with the load, an error of geometry stays.
    let of_brake = own.shaft + 1 == combs.len();
    if let Some(law) = alone::law(q, &powers(q, own.shaft, own.multiple)).filter(|l| of_brake && l.odds > 0.0) {
        f = Finding::new("torque_ripple", "brake", OF_BRAKE).with("order", own.multiple as f64, 0.2);
        f.alternatives.push(("ghost_component", bearer.gear.clone()));
        f.evidence.law = format!("amplitude ∝ torque^{:.2} at one speed", law.exponent);
    }
    let others = shares[1..].iter().filter(|s| s.0 / sum > LEFT_OUT);
    f.alternatives.extend(others.map(|s| ("ghost_component", s.2.gear.clone())));
    f.evidence.place = format!(
        "a {}line at order {} of its shaft, no mesh harmonic and no low sideband",
        if new { "new " } else { "" },
        own.multiple
    );
    f.evidence.support = format!(
        "{:.1} nats above the highest of its neighbours on the comb of the shaft, at every speed; no other multiple leads its own as much",
        own.lead
    );
    Some(f)
}

/// Power of a multiple of a shaft beyond what the reference has, and its noise.
fn powers(q: &Question<'_>, shaft: usize, multiple: usize) -> Powers {
    let at = |c: &ChannelFeatures| c.combs[shaft].get(multiple - 1).map(|l| (l.amplitude.norm_sqr(), l.noise));
    let before = |recording: usize, channel: &str| {
        let pair = q.comparison.pairs.iter().find(|p| p.recording == recording)?;
        at(q.references[pair.reference].channels.iter().find(|c| c.name == channel)?)
    };
    let of = |(i, r): (usize, &RecordingFeatures)| {
        let added = |c: &ChannelFeatures| at(c).map(|(p, n)| (p - before(i, &c.name).map_or(0.0, |b| b.0), n));
        r.channels.iter().map(added).collect()
    };
    q.recordings.iter().enumerate().map(of).collect()
}

/// Teeth of a gear by its place.
fn teeth_of(q: &Question<'_>, gear: &str) -> Option<u32> {
    let (stage, which) = gear.split_once('.')?;
    let stage = q.bench.stages.iter().find(|s| s.name == stage)?;
    Some(if which == "pinion" { stage.pinion.teeth } else { stage.wheel.teeth })
}

/// Whether a line is a ghost's own or one that the meshes of its shaft mix it to.
pub fn explains(q: &Question<'_>, ghost: &Finding, order: f64) -> bool {
    let shaft = (0..q.train.shafts.len()).find(|j| gears_on(q.bench, *j).contains(&ghost.place));
    let (Some(shaft), Some(waves)) = (shaft, ghost.parameters.get("order")) else { return false };
    let multiple = order / q.train.shafts[shaft].1;
    gears_on(q.bench, shaft).iter().filter_map(|g| teeth_of(q, g)).any(|teeth| {
        let teeth = f64::from(teeth);
        let off = |x: f64| (x - (x / teeth).round() * teeth).abs();
        off(multiple - waves.value) < WHOLE || off(multiple + waves.value) < WHOLE
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Neighbours that rise by half a nat from one to the next: a multiple that is two nats above
    /// their line leads by those two. With neighbours on one side only it leads the highest itself.
    #[test]
    fn analytic_a_flank_of_a_resonance_is_no_lead() {
        let mut levels: Vec<f64> = (1..=9).map(|k| 0.5 * f64::from(k)).collect();
        levels[4] += 2.0;
        let beside = [1, 2, 3, 4, 6, 7, 8, 9];
        assert!((over_neighbours(&levels, 5, &beside) - 2.0).abs() < 1e-12);
        assert!((over_neighbours(&levels, 5, &[1, 2, 3, 4]) - 2.5).abs() < 1e-12);
    }

    /// 34 teeth, 43 waves: 43, 43 + 34 h and 34 h − 43 leave 9 from either side.
    #[test]
    fn analytic_mixed_lines_leave_one_remainder() {
        let lines: Vec<usize> = mixed(43, 34).collect();
        assert_eq!(lines, [9, 25, 77, 59, 111, 93]);
        assert!(lines.iter().all(|m| remainder(*m, 34) == 9));
        assert_ne!(remainder(44, 34), 9);
    }
}
