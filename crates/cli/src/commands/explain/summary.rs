//! The answer for a person at a terminal: what, where, how sure, how much better, what to record
//! next.

use std::io::{self, Write};

use gearwatch_explain::judge::report::LatentForce;
use gearwatch_explain::judge::report::{Explanation, Fit, FreeTerm, Mismatch, NamedEffect, Status};

use crate::format::wrapped;

/// Widest line.
const WIDTH: usize = 110;
/// Column at which texts begin.
const INDENT: usize = 12;
/// Lines that differ most, listed.
const LISTED: usize = 5;

/// Prints the answer; with `steps` also how it was found.
pub fn print(out: &mut dyn Write, bench: &str, e: &Explanation, steps: bool) -> io::Result<()> {
    writeln!(out, "{bench}: {}", e.status.code())?;
    let sentence = match e.status {
        Status::Consistent => "nothing is missing beyond noise, repetition and the usual tolerances",
        Status::Explained if e.fit.as_ref().is_none_or(|fit| fit.held_out_after < fit.held_out_before) => {
            "recordings and model differ, and this accounts for it"
        }
        Status::Explained => "recordings and model differ; this is named, and does not describe what was held out",
        Status::Ambiguous => "recordings and model differ; these recordings leave several explanations",
        Status::Unexplained if e.free_term.is_some() => {
            "recordings and model differ; no effect of the library accounts for it, and this law does"
        }
        Status::Unexplained => "recordings and model differ, and nothing in the library accounts for it",
    };
    entry(out, "", sentence)?;
    for limit in &e.limits {
        entry(out, "limit", limit)?;
    }
    for named in &e.effects {
        writeln!(out)?;
        effect(out, named)?;
    }
    if !e.nearest.is_empty() {
        writeln!(out)?;
        let near: Vec<String> =
            e.nearest.iter().map(|n| format!("{} at {} ({:.0} %)", n.effect, n.place, 100.0 * n.probability)).collect();
        entry(out, "nearest", &near.join(", "))?;
    }
    if let Some(term) = &e.free_term {
        writeln!(out)?;
        law(out, term)?;
    }
    if let Some(f) = &e.latent_force {
        writeln!(out)?;
        latent(out, f)?;
    }
    if let Some(fit) = &e.fit {
        writeln!(out)?;
        entry(out, "held out", &held_out(fit))?;
        let rivals: Vec<String> = fit.beside.iter().map(|b| format!("{} {:.2}", b.what, b.held_out)).collect();
        if !rivals.is_empty() {
            entry(out, "beside it", &rivals.join(", "))?;
        }
    }
    if !e.mismatch.is_empty() {
        writeln!(out)?;
        differences(out, &e.mismatch)?;
    }
    if !e.advice.is_empty() {
        writeln!(out)?;
        for (n, text) in e.advice.iter().enumerate() {
            entry(out, if n == 0 { "next" } else { "" }, text)?;
        }
    }
    if steps {
        writeln!(out)?;
        for (n, text) in e.steps.iter().enumerate() {
            entry(out, if n == 0 { "steps" } else { "" }, text)?;
        }
    }
    Ok(())
}

/// A name and a text beside it, broken into lines.
fn entry(out: &mut dyn Write, name: &str, text: &str) -> io::Result<()> {
    for (n, line) in wrapped(text, WIDTH - INDENT).iter().enumerate() {
        writeln!(out, "  {:<width$}{line}", if n == 0 { name } else { "" }, width = INDENT - 2)?;
    }
    Ok(())
}

fn effect(out: &mut dyn Write, named: &NamedEffect) -> io::Result<()> {
    entry(out, "what", &format!("{} at {}", named.effect, named.place))?;
    let others: Vec<String> =
        named.indistinguishable_from.iter().map(|other| format!("{} at {}", other.effect, other.place)).collect();
    let apart = if others.is_empty() { String::new() } else { format!("; not told apart from {}", others.join(", ")) };
    entry(out, "how sure", &format!("{:.0} %{apart}", 100.0 * named.probability))?;
    let at = &named.entry_point;
    entry(out, "enters as", &format!("{} at {} ({:.0} %)", at.kind.words(), at.place, 100.0 * at.probability))?;
    let sizes: Vec<String> =
        named.parameters.iter().map(|(name, p)| format!("{name} {}", size(p.value(), p.sigma()))).collect();
    let evidence = &named.evidence;
    for (kind, text) in [
        ("size", sizes.join(", ").as_str()),
        ("where", &evidence.place),
        ("law", &evidence.law),
        ("support", &evidence.support),
        ("shape", &evidence.shape),
    ] {
        if !text.is_empty() {
            entry(out, kind, text)?;
        }
    }
    Ok(())
}

/// A law without a name.
fn law(out: &mut dyn Write, free: &FreeTerm) -> io::Result<()> {
    entry(out, "what", &format!("a law {} at {}", free.term.expression, free.place))?;
    entry(out, "how sure", &format!("{:.0} % of the laws that were tried", 100.0 * free.probability))?;
    let at = &free.entry_point;
    entry(out, "enters as", &format!("{} at {} ({:.0} %)", at.kind.words(), at.place, 100.0 * at.probability))?;
    let fitted = free.parameters.iter().map(|(name, p)| format!("{name} {}", size(p.value(), p.sigma())));
    let fixed = free.term.parameters.iter().filter(|(name, _)| !free.parameters.contains_key(*name));
    let sizes: Vec<String> =
        fitted.chain(fixed.map(|(name, value)| format!("{name} = {value:.4e} (tried, not fitted)"))).collect();
    entry(out, "size", &sizes.join(", "))?;
    entry(out, "model", "it stands as [[term]] in the bench file, and simulate runs it")
}

/// The force that nobody named.
fn latent(out: &mut dyn Write, f: &LatentForce) -> io::Result<()> {
    let largest = f.force.iter().map(|v| v.abs()).fold(0.0, f64::max);
    let sigma = f.sigma.first().copied().unwrap_or(f64::NAN);
    let (largest, sigma) = rounded(largest, sigma);
    let text = format!(
        "a force of up to {largest} ± {sigma} {} that repeats every {:.4} revolutions of the input shaft accounts for it ({})",
        f.unit, f.period_rev, f.recording
    );
    entry(out, "left over", &text)?;
    for (what, exponent) in [("torque", f.load_exponent), ("speed", f.speed_exponent)] {
        if let Some(p) = exponent {
            entry(out, "", &format!("amplitude ∝ {what}^{p:.2}"))?;
        }
    }
    entry(out, "", &format!("with this period: {}", f.period_of.join("; ")))
}

/// A number and its standard deviation as text: two digits of its uncertainty say all that is
/// known.
pub fn rounded(value: f64, sigma: f64) -> (String, String) {
    if !(sigma > 0.0 && sigma.is_finite()) {
        return (format!("{value:.3}"), format!("{sigma:.3}"));
    }
    // Beyond six decimals a fixed point shows zeros only.
    if sigma < 1e-5 {
        let more = (value.abs() / sigma).max(1.0).log10().floor() as usize + 1;
        return (format!("{value:.more$e}"), format!("{sigma:.1e}"));
    }
    let decimals = decimals(sigma);
    (format!("{value:.decimals$}"), format!("{sigma:.decimals$}"))
}

/// Decimals that show two digits of a number's uncertainty.
pub fn decimals(sigma: f64) -> usize {
    if sigma > 0.0 { (1.0 - sigma.log10().floor()).clamp(0.0, 6.0) as usize } else { 3 }
}

/// The standard deviation is below the number itself, in the digits that are shown too.
pub fn is_determined(value: f64, sigma: f64) -> bool {
    let (shown, uncertain) = rounded(value.abs(), sigma);
    sigma == 0.0 || (sigma < value.abs() && shown != uncertain)
}

/// `= 3.1 ± 0.2`; where the standard deviation is the larger of the two nothing is estimated, and
/// what is left is a bound.
pub fn size(value: f64, sigma: f64) -> String {
    if !is_determined(value, sigma) {
        let (bound, _) = rounded(value.abs() + 2.0 * sigma, sigma);
        return format!("not determined (below {bound} with 95 %)");
    }
    let (value, sigma) = rounded(value, sigma);
    format!("= {value} ± {sigma}")
}

fn held_out(fit: &Fit) -> String {
    let (before, after) = (fit.held_out_before, fit.held_out_after);
    let gain =
        if after < before { format!("{:.0} % less", 100.0 * (1.0 - after / before)) } else { "no better".into() };
    format!(
        "misfit of {}, which took no part in it: {before:.2} without, {after:.2} with, {gain} (repetition alone: {:.2})",
        fit.held_out.join(", "),
        fit.noise_floor
    )
}

fn differences(out: &mut dyn Write, all: &[Mismatch]) -> io::Result<()> {
    let places: Vec<String> =
        all.iter().take(LISTED).map(|m| format!("{} {} {}", m.recording, m.channel, m.what)).collect();
    let width = places.iter().map(|p| p.chars().count()).max().unwrap_or(0);
    writeln!(
        out,
        "  {:<width$}  {:>9} {:>10} {:>10} {:>8}",
        "they differ most at", "Hz", "measured", "before", "sigma"
    )?;
    for (place, m) in places.iter().zip(all) {
        writeln!(
            out,
            "  {place:<width$}  {:>9.1} {:>10.4} {:>10.4} {:>+8.1}",
            m.frequency_hz, m.measured, m.modelled, m.z
        )?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An estimate below its standard deviation is a bound; a small one is no row of zeros.
    #[test]
    fn regress_what_is_not_known_is_not_shown_as_a_size() {
        assert_eq!(size(352.0, 447.0), "not determined (below 1246 with 95 %)");
        assert_eq!(size(0.0, 0.0), "= 0.000 ± 0.000");
        assert_eq!(size(-0.352, 0.348), "not determined (below 1.05 with 95 %)");
        assert_eq!(size(0.36, 0.35), "= 0.36 ± 0.35");
        assert_eq!(size(22.14, 1.4), "= 22.1 ± 1.4");
        assert_eq!(size(3.2e-9, 4.0e-10), "= 3.2e-9 ± 4.0e-10");
    }
}
