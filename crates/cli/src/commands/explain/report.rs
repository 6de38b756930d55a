//! An explanation to be handed on: one HTML file.

use std::collections::BTreeMap;
use std::path::PathBuf;

use gearwatch_explain::judge::report::LatentForce;
use gearwatch_explain::judge::report::{Explanation, Fit, Mismatch, NamedEffect, Status};
use gearwatch_report::{Bars, Cell, Chart, Lines, Part, Report, Section, Series, Table, Tone};

/// Lines of the mismatch table; the picture has all.
const MOST_LINES: usize = 40;

/// The page. `files` are named with their SHA-256.
pub(super) fn page(bench: &str, e: &Explanation, files: &[(String, PathBuf)]) -> anyhow::Result<String> {
    let mut sections = vec![effects(e)];
    sections.extend(e.latent_force.as_ref().map(latent));
    if !e.limits.is_empty() {
        sections.push(Section { heading: "Limits of the judgement".into(), parts: vec![Part::List(e.limits.clone())] });
    }
    sections.extend(e.fit.as_ref().map(fit));
    sections.push(mismatch(&e.mismatch));
    let advice =
        if e.advice.is_empty() { Part::Text("Nothing more is needed.".into()) } else { Part::List(e.advice.clone()) };
    sections.push(Section { heading: "What to record next".into(), parts: vec![advice] });
    let mut provenance = vec![("gearwatch".to_owned(), env!("CARGO_PKG_VERSION").to_owned())];
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    provenance.push(("command".into(), format!("gearwatch {}", arguments.join(" "))));
    for (what, path) in files {
        let sha256 = crate::input::sha256_of(path)?;
        provenance.push((what.clone(), format!("{}, SHA-256 {sha256}", path.display())));
    }
    let tone = match e.status {
        Status::Consistent => Tone::Good,
        Status::Explained | Status::Ambiguous => Tone::Warning,
        Status::Unexplained => Tone::Unknown,
    };
    let title = format!("{bench}: what the model leaves out");
    Ok(gearwatch_report::render(&Report {
        title,
        verdict: sentence(e),
        tone,
        sections,
        appendix: appendix(e),
        provenance,
    }))
}

/// Evidence and steps, in the words of the method.
fn appendix(e: &Explanation) -> Vec<Section> {
    let evidence = e.effects.iter().filter_map(|effect| {
        let lines = evidence(effect);
        let heading = format!("Evidence for {} at {}", effect.effect.replace('_', " "), effect.place);
        (!lines.is_empty()).then(|| Section { heading, parts: vec![Part::List(lines)] })
    });
    let steps = Section { heading: "Steps".into(), parts: vec![Part::List(e.steps.clone())] };
    evidence.chain([steps]).collect()
}

fn sentence(e: &Explanation) -> String {
    let words = |all: &[NamedEffect]| -> String {
        let one = |effect: &NamedEffect| {
            format!("{} at {} ({:.0} %)", effect.effect.replace('_', " "), effect.place, 100.0 * effect.probability)
        };
        all.iter().map(one).collect::<Vec<_>>().join("; ")
    };
    let named = words(&e.effects);
    let better = e.fit.as_ref().map_or_else(String::new, |fit| {
        let (before, after, floor) = (fit.held_out_before, fit.held_out_after, fit.noise_floor);
        match after < before {
            true => format!(
                " On recordings that were not fitted the misfit goes from {before:.2} to {after:.2}; repetition alone gives {floor:.2}."
            ),
            false => format!(
                " It does not describe recordings that were not fitted: their misfit is {before:.2} without it and {after:.2} with it, where repetition alone gives {floor:.2}. Take the sizes for unconfirmed."
            ),
        }
    });
    let confirmed = e.fit.as_ref().is_none_or(|fit| fit.held_out_after < fit.held_out_before);
    match e.status {
        Status::Consistent => {
            "Nothing is missing: recordings and model agree within noise, repetition and the usual tolerances.".into()
        }
        Status::Explained if confirmed => format!("Left out: {named}.{better}"),
        Status::Explained => format!("Named, but not confirmed: {named}.{better}"),
        Status::Ambiguous => {
            format!("One of several, which these recordings cannot tell apart: {named}.{better}")
        }
        Status::Unexplained => match &e.free_term {
            Some(free) => format!(
                "No effect of the library accounts for it; a law {} at {} does.{better}",
                free.term.expression, free.place
            ),
            None if e.nearest.is_empty() => "There is a mismatch, and nothing in the library accounts for it.".into(),
            None => format!(
                "There is a mismatch, and nothing in the library accounts for it. What comes nearest: {}.",
                words(&e.nearest)
            ),
        },
    }
}

fn effects(e: &Explanation) -> Section {
    let mut parts: Vec<Part> = e.effects.iter().flat_map(effect).collect();
    if parts.is_empty() {
        parts.push(Part::Text("No effect is named.".into()));
    }
    if let Some(free) = &e.free_term {
        let sizes =
            free.parameters.iter().map(|(name, p)| format!("{name} {}", super::summary::size(p.value(), p.sigma())));
        parts.push(Part::Text(format!(
            "A law that no effect has accounts for it: {} at {}, {}; probability {:.2} among the laws that were tried. It stands as [[term]] in the bench file, and simulate runs it.",
            free.term.expression,
            free.place,
            sizes.collect::<Vec<_>>().join(", "),
            free.probability
        )));
    }
    if let Some(p) = e.p_null {
        parts.push(Part::Text(format!(
            "An unchanged bench misfits its reference as much as this with probability {p:.3}."
        )));
    }
    Section { heading: "Hypotheses and their evidence".into(), parts }
}

/// What speaks for an effect.
fn evidence(effect: &NamedEffect) -> Vec<String> {
    let of = &effect.evidence;
    let all = [("where", &of.place), ("law", &of.law), ("support", &of.support), ("shape", &of.shape)];
    all.into_iter().filter(|(_, text)| !text.is_empty()).map(|(kind, text)| format!("{kind}: {text}")).collect()
}

fn effect(effect: &NamedEffect) -> Vec<Part> {
    let entry = &effect.entry_point;
    let mut lines =
        vec![format!("enters as {} at {} with probability {:.2}", entry.kind.words(), entry.place, entry.probability)];
    lines.extend(
        effect
            .indistinguishable_from
            .iter()
            .map(|other| format!("not told apart from {} at {}", other.effect, other.place)),
    );
    let rows = effect.parameters.iter().map(|(name, p)| {
        let (value, sigma) = match super::summary::is_determined(p.value(), p.sigma()) {
            false => (super::summary::size(p.value(), p.sigma()), String::new()),
            true => super::summary::rounded(p.value(), p.sigma()),
        };
        vec![Cell::from(name.as_str()), Cell::from(value), Cell::from(sigma)]
    });
    vec![
        Part::Table(Table {
            caption: format!("{} at {}, probability {:.0} %", effect.effect, effect.place, 100.0 * effect.probability),
            head: ["parameter", "estimate", "one standard deviation"].map(str::to_owned).to_vec(),
            rows: rows.collect(),
        }),
        Part::List(lines),
    ]
}

fn fit(fit: &Fit) -> Section {
    Section { heading: "Before and after".into(), parts: vec![Part::Chart(fit_chart(fit))] }
}

/// Misfit without and with what was named.
pub(super) fn fit_chart(fit: &Fit) -> Chart {
    let no_sigma = |value: f64| (value, f64::NAN);
    Chart::Bars(Bars {
        caption: format!("{}. Held out: {}", fit.metric, fit.held_out.join(", ")),
        y_label: "misfit".into(),
        groups: vec!["fitted".into(), "held out".into()],
        series: vec![
            ("before".into(), vec![no_sigma(fit.train_before), no_sigma(fit.held_out_before)]),
            ("after".into(), vec![no_sigma(fit.train_after), no_sigma(fit.held_out_after)]),
            ("repetition alone".into(), vec![no_sigma(fit.noise_floor), no_sigma(fit.noise_floor)]),
        ],
        limits: Vec::new(),
    })
}

/// The force that nobody named, over its turn.
fn latent(f: &LatentForce) -> Section {
    let curve = |name: &str, by: f64| Series {
        name: name.to_owned(),
        points: f.turn.iter().zip(&f.force).zip(&f.sigma).map(|((t, v), s)| (*t, v + by * s)).collect(),
    };
    let chart = Chart::Lines(Lines {
        caption: format!(
            "The force that accounts for what has no name, over {:.4} revolutions of the input shaft, with two standard deviations ({})",
            f.period_rev, f.recording
        ),
        x_label: "position in its period (1)".into(),
        y_label: format!("force ({})", f.unit),
        log_y: false,
        series: vec![curve("mean", 0.0), curve("+2 sigma", 2.0), curve("−2 sigma", -2.0)],
        marks: Vec::new(),
    });
    let mut list: Vec<String> = f.period_of.iter().map(|what| format!("with this period: {what}")).collect();
    for (what, exponent) in [("torque", f.load_exponent), ("speed", f.speed_exponent)] {
        list.extend(exponent.map(|p| format!("its amplitude goes with {what} to the power {p:.2}")));
    }
    Section { heading: "What is left".into(), parts: vec![Part::Chart(chart), Part::List(list)] }
}

/// Where the lines differ, by frequency.
pub(super) fn mismatch_chart(all: &[Mismatch]) -> Chart {
    // A stem a line: up to its height and back.
    let mut stems: BTreeMap<&str, Vec<&Mismatch>> = BTreeMap::new();
    for line in all {
        stems.entry(&line.channel).or_default().push(line);
    }
    let series = stems.into_iter().map(|(channel, mut lines)| {
        lines.sort_by(|a, b| a.frequency_hz.total_cmp(&b.frequency_hz));
        let points = lines.iter().flat_map(|m| [(m.frequency_hz, 0.0), (m.frequency_hz, m.z), (m.frequency_hz, 0.0)]);
        Series { name: channel.to_owned(), points: points.collect() }
    });
    Chart::Lines(Lines {
        caption: "Measured minus modelled, in standard deviations, all recordings".into(),
        x_label: "frequency (Hz)".into(),
        y_label: "difference / sigma".into(),
        log_y: false,
        series: series.collect(),
        marks: Vec::new(),
    })
}

fn mismatch(all: &[Mismatch]) -> Section {
    if all.is_empty() {
        let text = "No line differs beyond noise and calibration.";
        return Section { heading: "Where they differ".into(), parts: vec![Part::Text(text.into())] };
    }
    let rows = all.iter().take(MOST_LINES).map(|m| {
        vec![
            Cell::from(m.recording.as_str()),
            m.channel.as_str().into(),
            m.what.as_str().into(),
            format!("{:.2}", m.order).into(),
            format!("{:.1}", m.frequency_hz).into(),
            format!("{:.4}", m.measured).into(),
            format!("{:.4} ± {:.4}", m.modelled, m.sigma).into(),
            Cell::toned(format!("{:+.1}", m.z), if m.z.abs() >= 5.0 { Tone::Bad } else { Tone::Warning }),
            format!("{:.1}", 100.0 * m.share).into(),
        ]
    });
    let head =
        ["recording", "channel", "line", "order", "Hz", "measured", "modelled", "difference / sigma", "share (%)"];
    let table = Table {
        caption: format!("The {} largest of {} lines", MOST_LINES.min(all.len()), all.len()),
        head: head.map(str::to_owned).to_vec(),
        rows: rows.collect(),
    };
    Section { heading: "Where they differ".into(), parts: vec![Part::Chart(mismatch_chart(all)), Part::Table(table)] }
}

#[cfg(test)]
mod tests {
    use gearwatch_core::estimate::Estimate;
    use gearwatch_explain::judge::report::{Entry, Evidence, FORMAT};

    use super::*;

    /// A softer bearing was named; without it the misfit of what was held out is 3.12.
    fn named(status: Status, held_out_after: f64) -> Explanation {
        let effect = NamedEffect {
            effect: "bearing_compliance".into(),
            place: "input".into(),
            probability: 0.95,
            parameters: [("factor".to_owned(), Estimate::new(0.7, 0.02).into())].into(),
            indistinguishable_from: Vec::new(),
            entry_point: Entry::of("bearing_compliance", "input", 0.95, &[]),
            evidence: Evidence::default(),
        };
        let fit = Fit {
            metric: "misfit".into(),
            train_before: 3.0,
            train_after: 1.5,
            held_out_before: 3.12,
            held_out_after,
            noise_floor: 1.0,
            held_out: vec!["30-60.mcap".into()],
            beside: Vec::new(),
            sham: None,
        };
        Explanation {
            format: FORMAT,
            status,
            effects: vec![effect],
            nearest: Vec::new(),
            free_term: None,
            mismatch: Vec::new(),
            fit: Some(fit),
            p_null: None,
            latent_force: None,
            advice: Vec::new(),
            limits: Vec::new(),
            steps: Vec::new(),
        }
    }

    fn text(e: &Explanation) -> String {
        let mut out = Vec::new();
        super::super::summary::print(&mut out, "bench", e, false).unwrap();
        String::from_utf8(out).unwrap().split_whitespace().collect::<Vec<_>>().join(" ")
    }

    /// What comes nearest is a lead: the terminal, the report and JSON show it as such, and not as
    /// a finding.
    #[test]
    fn conform_what_comes_nearest_is_no_finding() {
        let mut e = named(Status::Unexplained, 1.2);
        e.nearest = std::mem::take(&mut e.effects);
        assert!(sentence(&e).ends_with("What comes nearest: bearing compliance at input (95 %)."), "{}", sentence(&e));
        let shown = text(&e);
        assert!(shown.contains("nearest bearing_compliance at input (95 %)") && !shown.contains("how sure"), "{shown}");
        let json = serde_json::to_value(&e).unwrap();
        assert_eq!(json["effects"][0]["nearest"], true);
        assert_eq!(json["effects"][0]["where"], "input");
        let finding = serde_json::to_value(named(Status::Explained, 1.2)).unwrap();
        assert!(finding["effects"][0].get("nearest").is_none());
    }

    /// A change that describes held-out recordings worse is no success, neither at the head of the
    /// report nor on the terminal; one that describes them better is.
    #[test]
    fn regress_a_worse_misfit_is_no_success() {
        for after in [3.67, 3.12, f64::NAN] {
            for status in [Status::Explained, Status::Ambiguous] {
                let e = named(status, after);
                let head = sentence(&e);
                assert!(!head.contains("Left out:") && !head.contains("goes from"), "{head}");
                assert!(head.contains("does not describe recordings that were not fitted"), "{head}");
                assert!(text(&e).contains("with, no better"), "{}", text(&e));
            }
            assert!(text(&named(Status::Explained, after)).contains("does not describe what was held out"));
        }
        let better = named(Status::Explained, 1.2);
        assert!(sentence(&better).starts_with("Left out: bearing compliance at input (95 %). On recordings"));
        assert!(text(&better).contains("this accounts for it") && text(&better).contains("62 % less"));
    }
}
