//! Which effect accounts for the changes, and whether a second does beside it.

use super::calibration::{CALIBRATION, Calibration};
use super::changes::{self, Change, Tables};
use super::entry::Entry;
use super::evidence;
use super::posterior::{self, Scored};
use super::table::{self, Hypothesis, Moves};
use super::twins;
use crate::change::locate::{Cell, Place};
use crate::fit::shape::Ranked;
use crate::fit::sizes;
use crate::name::classes::together;
use crate::name::ghost;
use crate::name::path::Form;
use crate::name::strange::Strange;
use crate::name::subname;
use crate::name::{Finding, Question};

/// Effects that are asked for, one beside the other.
const MOST: usize = 2;
/// Names that stand in a set, and the least probability of one.
const IN_SET: usize = 5;
const LEAST_IN_SET: f64 = 0.04;
/// Least probability of a name.
const LEAST_NAMED: f64 = 0.1;

/// What a search came to.
pub struct Outcome {
    /// Effects with a name.
    pub findings: Vec<Finding>,
    /// Something changed that has none.
    pub unexplained: bool,
    /// Share of twins of the case in which any hypothesis gains as much.
    pub p_null: f64,
}

/// All that a round of the search stands on.
struct Round<'a> {
    q: &'a Question<'a>,
    cells: &'a [Cell],
    changes: Vec<Change>,
    tables: Tables,
    hypotheses: Vec<Hypothesis>,
    teeth: &'a [(f64, String)],
    bursts: (f64, f64),
    fixed_lines: f64,
}

/// Asks what changed against the reference.
pub fn search(
    q: &Question<'_>,
    cells: &[Cell],
    strange: &Strange,
    ghost: Option<&Finding>,
    steps: &mut Vec<String>,
) -> Outcome {
    let c = &CALIBRATION;
    let mut changes = changes::changes(q.comparison, c);
    if let Some(f) = ghost {
        let input_hz = |x: &Change| q.recordings[q.comparison.pairs[x.pair].recording].input_hz;
        changes.retain(|x| x.family.is_none() || !ghost::explains(q, f, x.frequency_hz / input_hz(x)));
    }
    let teeth = evidence::one_tooth(q, c);
    steps.extend(teeth.iter().map(|t| t.1.clone()));
    let fixed_lines = evidence::fixed_lines(q, strange, c);
    let bursts = strange.bursts.as_ref().map_or((0.0, 0.0), |b| {
        steps.push(b.describe(&q.comparison.channels));
        let (all, heavy) = (b.nats(c.bursts).max(0.0), b.nats_at_heavy_load(c.bursts).clamp(0.0, f64::INFINITY));
        (heavy.min(all), (all - heavy).max(0.0))
    });
    let mut out = Outcome { findings: Vec::new(), unexplained: false, p_null: 1.0 };
    for round in usize::from(ghost.is_some())..MOST {
        let mut tabled = changes.clone();
        changes::without_session(&mut tabled, q.comparison.channels.len(), c);
        let tables = Tables::new(&tabled, c);
        let mut hypotheses = table::table(q, &tables.classes);
        if round > 0 {
            let known: Vec<Finding> = ghost.into_iter().chain(&out.findings).cloned().collect();
            second(&mut hypotheses, &known, &shafts(q), c);
        }
        let asked =
            Round { q, cells, changes: changes.clone(), tables, hypotheses, teeth: &teeth, bursts, fixed_lines };
        let scored = asked.scored(c);
        let nothing: f64 = share(&scored, &asked.hypotheses, &|h| h.moves == Moves::Nothing);
        let something: f64 = share(&scored, &asked.hypotheses, &|h| h.moves == Moves::Something);
        report(&asked, &scored, round, steps);
        if out.findings.is_empty() {
            out.p_null = twins::p_null(&tabled, &asked.tables, &asked.hypotheses, c);
        }
        let Some(best) = scored.iter().find(|s| !asked.hypotheses[s.at].effect.is_empty()) else { break };
        let named = 1.0 - nothing - something;
        if nothing > named.max(something) {
            break;
        }
        if something > named {
            out.unexplained = true;
            break;
        }
        let mut finding = asked.finding(&scored, best, c);
        if !out.findings.is_empty() {
            finding.probability *= c.second_sure;
            finding.entry *= c.second_sure;
        }
        if finding.probability < LEAST_NAMED {
            out.unexplained = round == 0;
            break;
        }
        changes = posterior::explained(&changes, &asked.tables, &asked.hypotheses[best.at], best.best, c);
        out.findings.push(finding);
    }
    out
}

fn share(scored: &[Scored], table: &[Hypothesis], of: &dyn Fn(&Hypothesis) -> bool) -> f64 {
    scored.iter().filter(|s| of(&table[s.at])).map(|s| s.probability).sum()
}

/// Priors of a second effect: beside one that is known another is rare, and never the same again.
fn second(all: &mut [Hypothesis], known: &[Finding], places: &[(String, usize)], c: &Calibration) {
    let usual = (1.0 - c.nothing - c.something).ln();
    for h in all.iter_mut() {
        h.prior = match h.moves {
            Moves::Nothing => (1.0 - c.second).ln(),
            // What an effect leaves of its own lines is no second one without a name.
            Moves::Something => f64::NEG_INFINITY,
            _ => h.prior - usual + c.second.ln(),
        };
        // Run-out and errors of the teeth make orders of their shaft; one that stands out among them is no ripple.
        let on_shaft =
            |f: &Finding| places.iter().any(|p| p.0 == f.place && h.order.is_some_and(|o| o.0.unwrap_or(0) == p.1));
        // What an effect does to its own shafts and stages beyond its profile is no second one; unbalance, which moves one line, may be.
        let parts = |place: &str| places.iter().filter(|p| p.0 == place).map(|p| p.1).collect::<Vec<usize>>();
        let beside = |f: &Finding| {
            let own = parts(&f.place);
            h.effect != "unbalance" && parts(&h.place).iter().any(|p| own.contains(p))
        };
        if known.iter().any(|f| f.place == h.place || together(f.effect, h.effect) || on_shaft(f) || beside(f)) {
            h.prior = f64::NEG_INFINITY;
        }
    }
}

/// Places of the machine and the shafts that they are part of.
fn shafts(q: &Question<'_>) -> Vec<(String, usize)> {
    let of = |(i, s): (usize, &gearwatch_core::train::StageKinematics)| {
        [
            (format!("{}.pinion", s.name), i),
            (format!("{}.wheel", s.name), i + 1),
            (s.name.clone(), i),
            (s.name.clone(), i + 1),
        ]
    };
    let own = q.train.shafts.iter().enumerate().map(|(j, s)| (s.0.clone(), j));
    q.train.stages.iter().enumerate().flat_map(of).chain(own).collect()
}

fn report(asked: &Round<'_>, scored: &[Scored], round: usize, steps: &mut Vec<String>) {
    let nothing = scored.iter().find(|s| asked.hypotheses[s.at].moves == Moves::Nothing);
    let level = nothing.map_or(0.0, |s| s.log_likelihood);
    let of = |s: &Scored| {
        let h = &asked.hypotheses[s.at];
        let name = match &h.moves {
            Moves::Nothing => "nothing".to_owned(),
            Moves::Something => "something without a name".to_owned(),
            _ => match h.order {
                Some((_, k)) => format!("{} {k}x at {}", h.effect, h.place),
                None => format!("{} at {}", h.effect, h.place),
            },
        };
        format!("{name} {:+.1} nats ({:.3})", s.log_likelihood - level, s.probability)
    };
    let best: Vec<String> = scored.iter().take(6).map(of).collect();
    let what = if round == 0 { "hypotheses" } else { "hypotheses beside it" };
    steps.push(format!("{} {what} over {} changes: {}", asked.hypotheses.len(), asked.changes.len(), best.join(", ")));
}

impl Round<'_> {
    /// All hypotheses, the simulator's prediction and the form of a path asked for where they can decide.
    fn scored(&self, c: &Calibration) -> Vec<Scored> {
        let tooth = |h: &Hypothesis| match (h.effect, &h.moves) {
            ("tooth_breakage", _) => self.shaft_of(&h.place).map_or(0.0, |j| self.teeth[j].0),
            // Teeth that part do so where the load is light.
            ("backlash", _) if self.bursts.1 <= 0.0 => f64::NEG_INFINITY,
            ("backlash", _) => self.bursts.1,
            (_, Moves::Something) => self.bursts.0 + self.fixed_lines,
            _ => 0.0,
        };
        let nats: Vec<f64> = self.hypotheses.iter().map(tooth).collect();
        let mut session = self.changes.clone();
        changes::without_session(&mut session, self.q.comparison.channels.len(), c);
        let mut scored = posterior::score(&self.changes, &self.tables, &self.hypotheses, &nats, c);
        let likely = |of: &dyn Fn(&Hypothesis) -> bool| share(&scored, &self.hypotheses, of) > LEAST_IN_SET;
        let simulated = likely(&evidence::is_simulated);
        let channels: Vec<usize> = (0..self.q.comparison.channels.len())
            .filter(|k| likely(&|h: &Hypothesis| h.moves == Moves::Paths(vec![*k]) || h.moves == Moves::Factor(*k)))
            .collect();
        let ranked: Vec<Ranked> = if simulated { evidence::shape(self.q, self.cells) } else { Vec::new() };
        let forms: Vec<(usize, Vec<Form>)> =
            channels.iter().map(|&k| (k, evidence::path_forms(self.cells, k))).collect();
        for s in &mut scored {
            let h = &self.hypotheses[s.at];
            if !ranked.is_empty() && evidence::is_simulated(h) {
                let own = ranked.iter().find(|r| r.effect == h.effect && r.place == h.place);
                let even = 1.0 / ranked.len() as f64;
                s.log_likelihood += c.shape * own.map_or(0.0, |r| (r.probability.max(1e-4) / even).ln());
            }
            match &h.moves {
                Moves::Paths(one) if one.len() == 1 => {
                    let form =
                        forms.iter().find(|f| f.0 == one[0]).and_then(|f| f.1.iter().find(|x| x.effect == h.effect));
                    s.log_likelihood += form.map_or(0.0, |f| f.nats);
                }
                Moves::Paths(all) => {
                    let way = evidence::one_way(&self.changes, all, s.best, c);
                    let sign = if h.effect == "damping" { 1.0 } else { -1.0 };
                    s.log_likelihood += sign * ONE_WAY.1 * (way - ONE_WAY.0);
                }
                _ => {}
            }
        }
        posterior::normalise(&mut scored, &self.hypotheses);
        scored
    }

    fn shaft_of(&self, gear: &str) -> Option<usize> {
        shafts(self.q).into_iter().find(|g| g.0 == gear).map(|g| g.1)
    }

    /// The name of the most probable effect, with what cannot be told from it.
    fn finding(&self, scored: &[Scored], best: &Scored, c: &Calibration) -> Finding {
        let h = &self.hypotheses[best.at];
        let named = |s: &&Scored| !self.hypotheses[s.at].effect.is_empty();
        let own = |s: &&Scored| {
            let other = &self.hypotheses[s.at];
            other.place == h.place && other.order == h.order && together(other.effect, h.effect)
        };
        let probability: f64 = scored.iter().filter(named).filter(own).map(|s| s.probability).sum();
        let mut f = match h.order {
            Some((shaft, multiple)) => {
                let exponent = subname::load_exponent(self.q, Place::ShaftOrder(shaft.unwrap_or(0), multiple), true);
                match shaft {
                    Some(j) => subname::ripple(self.q, j, multiple, exponent),
                    None => Finding::new("torque_ripple", "motor", 0.0).with("order", f64::from(multiple), 0.2),
                }
            }
            None => Finding::new(h.effect, h.place.clone(), 0.0),
        };
        f.probability = c.surest * probability;
        let kind = Entry::of(f.effect);
        let enters =
            |s: &&Scored| self.hypotheses[s.at].place == h.place && Entry::of(self.hypotheses[s.at].effect) == kind;
        let entry: f64 = scored.iter().filter(named).filter(enters).map(|s| s.probability).sum();
        f.entry = c.surest * entry.max(probability);
        for s in scored.iter().filter(named).filter(|s| s.at != best.at && s.probability > LEAST_IN_SET) {
            let other = &self.hypotheses[s.at];
            let name = (other.effect, other.place.clone());
            if other.order.is_none() && f.alternatives.len() < IN_SET && !f.alternatives.contains(&name) {
                f.alternatives.push(name);
            }
        }
        if h.effect == "tooth_breakage" {
            for other in ["root_crack", "pitting"] {
                f.alternatives.insert(0, (other, h.place.clone()));
            }
        }
        if let Some(mask) = subname::mask_of(self.q, &f)
            && let Some((parameter, size)) = sizes::estimate(self.q, f.effect, &f.place, &f.parameters, mask)
        {
            f.parameters.insert(parameter.to_owned(), size);
        }
        let channel = match &h.moves {
            Moves::Paths(one) if one.len() == 1 => Some(one[0]),
            Moves::Factor(one) => Some(*one),
            _ => None,
        };
        if let Some(k) = channel
            && let Some(form) = evidence::path_forms(self.cells, k).into_iter().find(|x| x.effect == h.effect)
        {
            f.parameters.extend(form.parameters);
        }
        if evidence::is_simulated(h)
            && let Some(r) =
                evidence::shape(self.q, self.cells).into_iter().find(|r| r.effect == h.effect && r.place == h.place)
        {
            f.parameters.extend(r.parameters);
        }
        if let Some((_, multiple)) = h.order {
            f.evidence.support = format!("order {multiple} changes, the other orders of its row stay");
        }
        let second = scored.iter().find(|s| s.at != best.at && !own(s));
        f.evidence.place = format!(
            "its lines change by up to {:.2} (ln), all others by no more than repetition; of {} hypotheses it has the largest share",
            best.best.0,
            self.hypotheses.len()
        );
        if let Some(s) = second {
            let other = &self.hypotheses[s.at];
            let name = match other.moves {
                Moves::Nothing => "no change".to_owned(),
                Moves::Something => "something without a name".to_owned(),
                _ => format!("{} at {}", other.effect, other.place),
            };
            f.evidence.shape = format!(
                "{:.1} nats before the next, {name}",
                best.log_likelihood + h.prior - s.log_likelihood - other.prior
            );
        }
        f
    }
}

/// Share of the change one way at which damping and a resonance are as likely, and nats over the whole range.
const ONE_WAY: (f64, f64) = (0.6, 6.0);
