//! `gearwatch prove`: the finder's own concealed benchmark.

use std::io::{IsTerminal, Write};

use anyhow::Context;
use clap::Args;
use gearwatch_explain::prove::{self, Scored};
use gearwatch_explain::report::Status;

use super::Run;
use crate::exit::Exit;

/// Draw concealed cases by seed, explain them, and say how often that was right
#[derive(Args)]
#[command(after_help = "Examples:
  gearwatch prove --cases 40 --seed 7
  gearwatch prove --cases 200 --seed 20261121 > prove.txt

A quarter of the cases conceal nothing; one in eight conceals an effect that was taken out of the library for it. The
simulator that makes the cases is configured otherwise than the one that explains them. The same seed gives the same table.")]
pub struct Prove {
    /// How many cases
    #[arg(long, default_value_t = 40, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    cases: u64,
    /// Seed of the first
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print every case
    #[arg(long)]
    list: bool,
}

impl Run for Prove {
    const NAME: &'static str = "prove";

    fn run(self) -> anyhow::Result<Exit> {
        let talk = std::io::stderr().is_terminal();
        let mut scored: Vec<Scored> = Vec::new();
        let mut skipped = 0u64;
        for index in 0..self.cases {
            if talk {
                // Progress is a courtesy; a closed terminal is not an error.
                let _ = write!(std::io::stderr(), "\r  case {} of {}", index + 1, self.cases);
            }
            match prove::prove(self.seed, index) {
                Some(case) => scored.push(case),
                None => skipped += 1,
            }
        }
        if talk {
            let _ = writeln!(std::io::stderr());
        }
        let mut out = std::io::stdout().lock();
        table(&mut out, &scored, skipped, self.list).context("stdout")?;
        Ok(Exit::Ok)
    }
}

fn share(part: usize, whole: usize) -> String {
    if whole == 0 { "-".into() } else { format!("{part}/{whole} = {:.0} %", 100.0 * part as f64 / whole as f64) }
}

fn table(out: &mut dyn Write, all: &[Scored], skipped: u64, list: bool) -> std::io::Result<()> {
    let nulls: Vec<&Scored> = all.iter().filter(|s| s.truth.effect.is_none()).collect();
    let outside: Vec<&Scored> = all.iter().filter(|s| s.truth.outside).collect();
    let single: Vec<&Scored> = all.iter().filter(|s| s.truth.effect.is_some() && !s.truth.outside).collect();
    writeln!(out, "{} cases, {skipped} without a steady state and left out", all.len())?;
    for (what, with) in [("with a reference", true), ("without", false)] {
        let of: Vec<&&Scored> = single.iter().filter(|s| s.truth.reference == with).collect();
        writeln!(
            out,
            "effects, {what}: named first {}, within the named set {}, said nothing {}",
            share(of.iter().filter(|s| s.first).count(), of.len()),
            share(of.iter().filter(|s| s.in_set).count(), of.len()),
            share(of.iter().filter(|s| s.status == Status::Consistent).count(), of.len())
        )?;
    }
    let named = |of: &[&Scored]| of.iter().filter(|s| !s.named.is_empty()).count();
    writeln!(out, "nothing concealed: named something {}", share(named(&nulls), nulls.len()))?;
    writeln!(
        out,
        "outside the library: named something {}, unexplained {}",
        share(named(&outside), outside.len()),
        share(outside.iter().filter(|s| s.status == Status::Unexplained).count(), outside.len())
    )?;
    let mut errors: Vec<f64> = single.iter().flat_map(|s| s.errors.iter().map(|e| e.1)).collect();
    errors.sort_by(f64::total_cmp);
    let covered = single.iter().flat_map(|s| &s.errors).filter(|e| e.2.abs() <= 2.0).count();
    writeln!(
        out,
        "parameters: median relative error {}, inside 2 sigma {}",
        errors.get(errors.len() / 2).map_or("-".into(), |e| format!("{e:.3}")),
        share(covered, errors.len())
    )?;
    let mut gains: Vec<f64> =
        single.iter().filter_map(|s| s.held_out).filter(|h| h.0 > 0.0).map(|h| 1.0 - h.1 / h.0).collect();
    gains.sort_by(f64::total_cmp);
    writeln!(
        out,
        "held-out recordings: median misfit taken away {} of {}",
        gains.get(gains.len() / 2).map_or("-".into(), |g| format!("{:.0} %", 100.0 * g)),
        gains.len()
    )?;
    let mut ids: Vec<&str> = single.iter().filter_map(|s| s.truth.effect.as_ref().map(|e| e.effect.as_str())).collect();
    ids.sort_unstable();
    ids.dedup();
    writeln!(out, "by effect (named first, within the set):")?;
    for id in ids {
        let of: Vec<&&Scored> =
            single.iter().filter(|s| s.truth.effect.as_ref().is_some_and(|e| e.effect == id)).collect();
        writeln!(
            out,
            "  {id:<26} {:>2} / {:>2} of {:>2}",
            of.iter().filter(|s| s.first).count(),
            of.iter().filter(|s| s.in_set).count(),
            of.len()
        )?;
    }
    if list {
        for s in all {
            let truth = s.truth.effect.as_ref().map_or("nothing".into(), |e| format!("{} at {}", e.effect, e.place));
            let named: Vec<String> = s.named.iter().map(|n| format!("{} at {} ({:.2})", n.0, n.1, n.2)).collect();
            writeln!(
                out,
                "{:>4} {}{}{truth}: {} {}",
                s.index,
                if s.first || (s.truth.effect.is_none() && s.named.is_empty()) { "right  " } else { "       " },
                if s.truth.outside { "outside " } else { "" },
                s.status.code(),
                named.join(", ")
            )?;
        }
    }
    Ok(())
}
