//! `gearwatch prove`: the finder's own concealed benchmark.

use std::io::Write;

use anyhow::Context;
use clap::Args;
use gearwatch_core::bench::EffectSpec;
use gearwatch_explain::error::ExplainError;
use gearwatch_explain::judge::report::Status;
use gearwatch_explain::prove::score::{Scored, score};
use gearwatch_explain::prove::{self, Kind, Truth};
use rayon::prelude::*;

use super::Run;
use super::explain::summary;
use crate::exit::Exit;
use crate::progress::Progress;
use crate::terminal;

/// Draw concealed cases by seed, explain them, and say how often that was right
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch prove --cases 40 --seed 7
  gearwatch prove --cases 200 --seed 20261121 --list > prove.txt
  gearwatch prove --seed 20261121 --only 17,42          the whole answers of two of them
  gearwatch prove --cases 20 --effect tooth_wear        this effect in each

A quarter of the cases conceal nothing; one in sixteen conceals an effect that was taken out of the library for it, one in sixteen \
physics that no library holds, one in sixteen two effects. The simulator that makes the cases is configured otherwise than the one \
that explains them. The same seed gives the same table. A case takes some seconds of one core.")]
pub struct Prove {
    /// How many cases
    #[arg(long, default_value_t = 40, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    cases: u32,
    /// Seed of the first
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Conceal this effect in every case
    #[arg(long, value_name = "ID")]
    effect: Option<String>,
    /// Print every case
    #[arg(long)]
    list: bool,
    /// Only these numbers of the seed: what each conceals, and its whole answer with all steps
    #[arg(long, value_name = "N,…", value_delimiter = ',', conflicts_with_all = ["cases", "list"])]
    only: Vec<u64>,
}

/// The number of a case and its judged answer, or why it was refused.
type Judged = (u64, Result<Scored, ExplainError>);

impl Run for Prove {
    const NAME: &'static str = "prove";
    const COMPUTES: bool = true;

    fn run(self) -> anyhow::Result<Exit> {
        if let Some(id) = &self.effect {
            gearwatch_sim::effects::find(id)?;
        }
        let mut out = terminal::out();
        if !self.only.is_empty() {
            for &index in &self.only {
                self.tell(&mut out, index).context("stdout")?;
            }
            return Ok(Exit::Ok);
        }
        let judged = self.all();
        let skipped = u64::from(self.cases) - judged.len() as u64;
        let mut scored = Vec::new();
        for (index, answer) in judged {
            match answer {
                Ok(one) => scored.push(one),
                Err(refusal) => {
                    writeln!(out, "case {index} is refused and counts nowhere: {refusal}").context("stdout")?
                }
            }
        }
        table(&mut out, &scored, skipped, self.list).context("stdout")?;
        Ok(Exit::Ok)
    }
}

impl Prove {
    /// All cases, on all cores; each stands for itself, so the order of work does not matter. One
    /// takes a second or a hundred: a core takes them one by one.
    fn all(&self) -> Vec<Judged> {
        let progress = Progress::new("cases", u64::from(self.cases));
        let one = |index: u32| {
            let index = u64::from(index);
            let answer = prove::prove(self.seed, index, self.effect.as_deref());
            progress.finished("");
            Some((index, answer?))
        };
        (0..self.cases).into_par_iter().with_max_len(1).filter_map(one).collect()
    }

    /// What a case conceals, and its whole answer.
    fn tell(&self, out: &mut dyn Write, index: u64) -> std::io::Result<()> {
        let Some(case) = prove::case(self.seed, index, self.effect.as_deref()) else {
            return writeln!(out, "case {index}: left out, without a steady state or a visible effect\n");
        };
        let truth = &case.truth;
        let reference = if truth.reference { "" } else { ", no reference" };
        writeln!(out, "case {index}: {:?}{reference}, conceals {}", truth.kind, in_words(truth, true))?;
        if let Some(times) = truth.visibility {
            writeln!(out, "  its best group of lines changes {times:.1} times as much as repetition")?;
        }
        match prove::answer(&case) {
            Ok(answer) => {
                let scored = score(index, truth, &answer.explanation);
                if !truth.effects.is_empty() {
                    writeln!(
                        out,
                        "  named first {}, within the named set {}",
                        share(scored.first.iter().sum(), scored.first.len()),
                        share(scored.in_set.iter().filter(|x| **x).count() as f64, scored.in_set.len())
                    )?;
                }
                writeln!(out)?;
                summary::print(out, &case.bench.name, &answer.explanation, true)?;
            }
            Err(refusal) => writeln!(out, "  refused: {refusal}")?,
        }
        writeln!(out)
    }
}

/// What a case conceals; with `sizes` also how large it is.
fn in_words(truth: &Truth, sizes: bool) -> String {
    let effect = |e: &EffectSpec| {
        let named = format!("{} at {}", e.effect, e.place);
        let size = |(name, value): (&String, &f64)| {
            // Four digits.
            let decimals = summary::decimals(0.01 * value.abs());
            format!("{name} = {value:.decimals$}")
        };
        let sizes: Vec<String> = e.parameters.iter().filter(|_| sizes).map(size).collect();
        if sizes.is_empty() { named } else { format!("{named} ({})", sizes.join(", ")) }
    };
    let mut all: Vec<String> = truth.effects.iter().map(effect).collect();
    all.extend(truth.alien.iter().map(|a| a.kind.to_owned()));
    if all.is_empty() { "nothing".into() } else { all.join(", ") }
}

/// Strata of concealed effects by how much more than repetition they change their best group of
/// lines.
const STRATA: [(&str, f64, f64); 3] =
    [("concealed", 0.0, 8.0), ("moderate", 8.0, 20.0), ("plain", 20.0, f64::INFINITY)];

/// Named first and within the set, by strength; what enters the signal has none.
fn by_strength(out: &mut dyn Write, concealed: &[&Scored]) -> std::io::Result<()> {
    let row = |out: &mut dyn Write, what: &str, of: &[&&Scored]| {
        let effects: usize = of.iter().map(|s| s.first.len()).sum();
        if effects == 0 {
            return Ok(());
        }
        writeln!(
            out,
            "  {what}: named first {}, within the named set {}",
            share(of.iter().flat_map(|s| &s.first).sum(), effects),
            share(of.iter().flat_map(|s| &s.in_set).filter(|x| **x).count() as f64, effects)
        )
    };
    writeln!(out, "by strength of the fainter effect (change of its best group of lines over repetition):")?;
    for (name, low, high) in STRATA {
        let inside = |s: &&&Scored| s.truth.visibility.is_some_and(|v| v >= low && v < high);
        let of: Vec<&&Scored> = concealed.iter().filter(inside).collect();
        row(out, &format!("{name}, {low} to {high} times"), &of)?;
    }
    row(
        out,
        "in the signal, not the machine",
        &concealed.iter().filter(|s| s.truth.visibility.is_none()).collect::<Vec<_>>(),
    )
}

/// Largest distance between the distribution of p values and the even one, and the probability that
/// as many even values lie as far (Kolmogorov; Stephens 1970 for small numbers).
fn kolmogorov(sorted: &[f64]) -> (f64, f64) {
    let n = sorted.len() as f64;
    let distance = sorted
        .iter()
        .enumerate()
        .map(|(i, p)| ((i + 1) as f64 / n - p).abs().max((p - i as f64 / n).abs()))
        .fold(0.0, f64::max);
    let t = (n.sqrt() + 0.12 + 0.11 / n.sqrt()) * distance;
    let tail: f64 = (1..=50).map(f64::from).map(|k| 2.0 * (-1.0f64).powf(k - 1.0) * (-2.0 * k * k * t * t).exp()).sum();
    (distance, if t < 0.3 { 1.0 } else { tail.clamp(0.0, 1.0) })
}

fn share(part: f64, whole: usize) -> String {
    if whole == 0 { "-".into() } else { format!("{part} of {whole} = {:.0} %", 100.0 * part / whole as f64) }
}

fn count<'a>(of: &[&'a Scored], which: impl Fn(&'a Scored) -> bool) -> f64 {
    of.iter().filter(|s| which(s)).count() as f64
}

fn table(out: &mut dyn Write, all: &[Scored], skipped: u64, list: bool) -> std::io::Result<()> {
    let of = |kinds: &[Kind]| -> Vec<&Scored> { all.iter().filter(|s| kinds.contains(&s.truth.kind)).collect() };
    let (nulls, removed, alien) = (of(&[Kind::Null]), of(&[Kind::Removed]), of(&[Kind::Alien]));
    let concealed = of(&[Kind::Single, Kind::Double]);
    writeln!(out, "{} cases; {skipped} numbers without a steady state or a visible effect are left out", all.len())?;
    for (what, with) in [("with a reference", true), ("without", false)] {
        let of: Vec<&Scored> = concealed.iter().copied().filter(|s| s.truth.reference == with).collect();
        let identified = |of: &[&Scored]| {
            let effects = of.iter().map(|s| s.first.len()).sum();
            let first = share(of.iter().flat_map(|s| &s.first).sum(), effects);
            let in_set = of.iter().flat_map(|s| &s.in_set).filter(|x| **x).count() as f64;
            format!("named first {first}, within the named set {}", share(in_set, effects))
        };
        let silent = share(count(&of, |s| s.status == Status::Consistent), of.len());
        writeln!(out, "concealed effects, {what}: {}; said nothing {silent}", identified(&of))?;
        let alone: Vec<&Scored> = of.into_iter().filter(|s| s.truth.kind == Kind::Single).collect();
        writeln!(out, "  alone in their case: {}", identified(&alone))?;
    }
    by_strength(out, &concealed)?;
    let named_something: Vec<&&Scored> = concealed.iter().filter(|s| !s.named.is_empty()).collect();
    writeln!(
        out,
        "candidates listed where something is named: {:.1} a case",
        named_something.iter().map(|s| s.candidates).sum::<usize>() as f64 / named_something.len().max(1) as f64
    )?;
    without_effect(out, &nulls, &removed, &alien)?;
    probabilities(out, &concealed, all)?;
    sizes(out, &concealed)?;
    levels(out, &nulls)?;
    by_effect(out, &concealed)?;
    if list { cases(out, all) } else { Ok(()) }
}

/// What is answered where no effect of the library is concealed.
fn without_effect(
    out: &mut dyn Write,
    nulls: &[&Scored],
    removed: &[&Scored],
    alien: &[&Scored],
) -> std::io::Result<()> {
    let named = |of: &[&Scored]| share(count(of, |s| !s.named.is_empty()), of.len());
    let unexplained = |of: &[&Scored]| share(count(of, |s| s.status == Status::Unexplained), of.len());
    writeln!(out, "nothing concealed: named something {}, unexplained {}", named(nulls), unexplained(nulls))?;
    writeln!(out, "physics of no library: named something {}, unexplained {}", named(alien), unexplained(alien))?;
    writeln!(
        out,
        "effect taken out of the library: named another {}, unexplained {}",
        named(removed),
        unexplained(removed)
    )?;
    Ok(())
}

/// How often names are right, and how that agrees with the probabilities that are stated.
fn probabilities(out: &mut dyn Write, concealed: &[&Scored], all: &[Scored]) -> std::io::Result<()> {
    let names: Vec<&(String, String, f64, bool)> = concealed.iter().flat_map(|s| &s.named).collect();
    let right = names.iter().filter(|n| n.3).count();
    let brier = names.iter().map(|n| (n.2 - f64::from(u8::from(n.3))).powi(2)).sum::<f64>() / names.len().max(1) as f64;
    writeln!(
        out,
        "names given where something is concealed: right {}, Brier score {brier:.3}",
        share(right as f64, names.len())
    )?;
    for (low, high) in [(0.0, 0.4), (0.4, 0.6), (0.6, 0.8), (0.8, 0.9), (0.9, 1.01)] {
        let bin: Vec<_> = all.iter().flat_map(|s| &s.named).filter(|n| n.2 >= low && n.2 < high).collect();
        if !bin.is_empty() {
            let stated = bin.iter().map(|n| n.2).sum::<f64>() / bin.len() as f64;
            writeln!(
                out,
                "  probability {stated:.2} stated, right {}",
                share(bin.iter().filter(|n| n.3).count() as f64, bin.len())
            )?;
        }
    }
    Ok(())
}

/// Parameters against the truth, and what the models predict of held-out recordings.
fn sizes(out: &mut dyn Write, concealed: &[&Scored]) -> std::io::Result<()> {
    let mut errors: Vec<f64> = concealed.iter().flat_map(|s| s.errors.iter().map(|e| e.1)).collect();
    errors.sort_by(f64::total_cmp);
    let covered = concealed.iter().flat_map(|s| &s.errors).filter(|e| e.2.abs() <= 2.0).count();
    writeln!(
        out,
        "parameters: median relative error {}, inside 2 sigma {}",
        errors.get(errors.len() / 2).map_or("-".into(), |e| format!("{e:.3}")),
        share(covered as f64, errors.len())
    )?;
    let mut gains: Vec<f64> =
        concealed.iter().filter_map(|s| s.held_out).filter(|h| h.0 > 0.0).map(|h| 1.0 - h.1 / h.0).collect();
    gains.sort_by(f64::total_cmp);
    writeln!(
        out,
        "held-out recordings: median misfit taken away {} of {}",
        gains.get(gains.len() / 2).map_or("-".into(), |g| format!("{:.0} %", 100.0 * g)),
        gains.len()
    )?;
    Ok(())
}

/// Whether the probability of nothing is even where nothing is concealed.
fn levels(out: &mut dyn Write, nulls: &[&Scored]) -> std::io::Result<()> {
    let mut p: Vec<f64> = nulls.iter().filter_map(|s| s.p_null).collect();
    p.sort_by(f64::total_cmp);
    let below = |level: f64| share(p.iter().filter(|p| **p <= level).count() as f64, p.len());
    writeln!(
        out,
        "p of nothing, where nothing is concealed (even: as many as the level): below 0.05 {}, 0.1 {}, 0.25 {}, 0.5 {}, 0.75 {}",
        below(0.05),
        below(0.1),
        below(0.25),
        below(0.5),
        below(0.75)
    )?;
    if !p.is_empty() {
        let (distance, chance) = kolmogorov(&p);
        writeln!(out, "  largest distance from even {distance:.2}; as far by chance with probability {chance:.2}")?;
    }
    Ok(())
}

fn by_effect(out: &mut dyn Write, concealed: &[&Scored]) -> std::io::Result<()> {
    let mut ids: Vec<&str> = concealed.iter().flat_map(|s| &s.truth.effects).map(|e| e.effect.as_str()).collect();
    ids.sort_unstable();
    ids.dedup();
    writeln!(out, "by effect (named first, within the set):")?;
    for id in ids {
        let (mut first, mut set, mut n) = (0.0, 0usize, 0usize);
        for s in concealed {
            for (i, _) in s.truth.effects.iter().enumerate().filter(|(_, e)| e.effect == id) {
                first += s.first[i];
                set += usize::from(s.in_set[i]);
                n += 1;
            }
        }
        writeln!(out, "  {id:<26} {first:>4} / {set:>2} of {n:>2}")?;
    }
    Ok(())
}

/// A line a case.
fn cases(out: &mut dyn Write, all: &[Scored]) -> std::io::Result<()> {
    for s in all {
        let named: Vec<String> = s.named.iter().map(|n| format!("{} at {} ({:.2})", n.0, n.1, n.2)).collect();
        writeln!(
            out,
            "{:>4} {:?}{} [{}]: {} {}",
            s.index,
            s.truth.kind,
            if s.truth.reference { "" } else { ", no reference" },
            in_words(&s.truth, false),
            s.status.code(),
            named.join(", ")
        )?;
    }
    Ok(())
}
