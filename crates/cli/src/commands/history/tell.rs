//! A history as a table, CSV or columns.

use std::io::Write;

use gearwatch_core::estimate::Estimate;
use gearwatch_core::rank::RankConfig;
use gearwatch_core::verdict::{HARMONICS, published};
use gearwatch_history::time::iso;
use gearwatch_history::{History, STATES, Span, indicator_names};

use crate::terminal;

/// Events that a table shows; CSV of events is not needed for more.
const SHOWN: usize = 200;

/// Share of a window's samples that the next does not have: the default hop.
const OWN_SHARE: f64 = 0.5;

/// Rank of a mean deviation by the usual steps; `?` where it is less probable than not, `-` where
/// nothing is known.
fn rank(deviation: Estimate) -> &'static str {
    let steps = RankConfig::default();
    match (deviation.is_known(), steps.rank_probability(deviation) > 0.5) {
        (false, _) => "-",
        (true, false) => "?",
        (true, true) => steps.rank_of(deviation.value).code(),
    }
}

/// Mean of an indicator; not known where no window has any.
fn indicator(span: &Span, i: usize) -> Estimate {
    span.indicators.get(i).map_or(Estimate::UNKNOWN, |mean| mean.estimate(OWN_SHARE))
}

/// Names and values of the numbers of a row, the same names for every row.
fn numbers(span: &Span) -> Vec<(String, f64)> {
    let mut out: Vec<(String, f64)> =
        vec![("windows".into(), span.windows as f64), ("not_ok".into(), span.not_ok as f64)];
    for (name, count) in STATES.iter().zip(span.states) {
        out.push(((*name).to_owned(), count as f64));
    }
    let mut estimate = |name: &str, sigma: &str, x: Estimate| {
        out.push((name.to_owned(), x.value));
        out.push((sigma.to_owned(), x.sigma));
    };
    estimate("input_speed_hz", "input_speed_sigma_hz", span.speed.estimate(OWN_SHARE));
    estimate("brake_torque_nm", "brake_torque_sigma_nm", span.torque.estimate(OWN_SHARE));
    for h in 0..HARMONICS {
        let k = h + 1;
        let (deviation, amplitude) = (span.deviations[h].estimate(OWN_SHARE), span.amplitudes[h].estimate(OWN_SHARE));
        estimate(&format!("dev_{k}x_percent"), &format!("dev_sigma_{k}x_percent"), deviation);
        estimate(&format!("amp_{k}x"), &format!("sigma_{k}x"), amplitude);
    }
    for (i, name) in indicator_names().enumerate() {
        estimate(name, &format!("{name}_sigma"), indicator(span, i));
    }
    for h in 0..HARMONICS {
        out.push((format!("level_{}x", h + 1), f64::from(span.levels[h])));
    }
    out
}

/// Texts and numbers by column.
#[allow(clippy::type_complexity, reason = "two lists of columns")]
pub(super) fn columns(history: &History) -> (Vec<(String, Vec<String>)>, Vec<(String, Vec<f64>)>) {
    let mut texts: Vec<(String, Vec<String>)> =
        ["from", "bench", "stage", "channel", "unit", "machine"].map(|name| (name.to_owned(), Vec::new())).into();
    let mut columns: Vec<(String, Vec<f64>)> = Vec::new();
    for (key, at, span) in history.rows() {
        let unit = history.units.get(key).map_or("", String::as_str);
        let values = [iso(at), key.0.clone(), key.1.clone(), key.2.clone(), unit.to_owned(), span.state().0.to_owned()];
        texts.iter_mut().zip(values).for_each(|((_, column), value)| column.push(value));
        let row = numbers(span);
        if columns.is_empty() {
            columns = row.iter().map(|(name, _)| (name.clone(), Vec::new())).collect();
        }
        columns.iter_mut().zip(row).for_each(|((_, column), (_, value))| column.push(published(value)));
    }
    (texts, columns)
}

/// A header line and a line a row; what is not known is an empty field.
pub(super) fn csv(out: &mut impl Write, history: &History) -> anyhow::Result<()> {
    let (texts, numbers) = columns(history);
    let mut writer = csv::Writer::from_writer(out);
    writer.write_record(texts.iter().map(|(name, _)| name).chain(numbers.iter().map(|(name, _)| name)))?;
    for i in 0..texts.first().map_or(0, |(_, column)| column.len()) {
        let texts = texts.iter().map(|(_, column)| column[i].clone());
        let numbers = numbers.iter().map(|(_, column)| match column[i] {
            x if x.is_finite() => x.to_string(),
            _ => String::new(),
        });
        writer.write_record(texts.chain(numbers))?;
    }
    Ok(writer.flush()?)
}

/// For people: a block for each bench, stage and channel, then what happened.
pub(super) fn table(out: &mut impl Write, history: &History) -> anyhow::Result<()> {
    for ((bench, stage, channel), spans) in history.groups() {
        let bench = if bench.is_empty() { String::new() } else { format!("{bench}  ") };
        writeln!(out, "{}", terminal::plain(&format!("{bench}{stage} at {channel}")))?;
        writeln!(
            out,
            "  {:<20}  {:>7}  {:<22}  {:<14}  {:>15}  {:>15}  {:>10}  {:>8}",
            "from (UTC)", "windows", "gravest state", "mean ranks", "dev 1x (%)", "dev 2x (%)", "speed (Hz)", "N m"
        )?;
        for (&at, span) in spans {
            let (state, count) = span.state();
            let not_ok = if span.not_ok > 0 { format!(", {} not ok", span.not_ok) } else { String::new() };
            let ranks = span.deviations.map(|deviation| rank(deviation.estimate(OWN_SHARE)));
            let deviation = |h: usize| {
                let x = span.deviations[h].estimate(OWN_SHARE);
                if x.is_known() { format!("{:+.2} ± {:.2}", x.value, x.sigma) } else { "-".to_owned() }
            };
            let number = |x: f64, places: usize| if x.is_finite() { format!("{x:.places$}") } else { "-".to_owned() };
            writeln!(
                out,
                "  {:<20}  {:>7}  {:<22}  {:<14}  {:>15}  {:>15}  {:>10}  {:>8}",
                iso(at),
                span.windows,
                format!("{state} ({count}){not_ok}"),
                ranks.join(" "),
                deviation(0),
                deviation(1),
                number(span.speed.estimate(OWN_SHARE).value, 3),
                number(span.torque.estimate(OWN_SHARE).value, 1)
            )?;
        }
    }
    if history.events.is_empty() {
        return Ok(());
    }
    writeln!(out, "events")?;
    let hidden = history.events.len().saturating_sub(SHOWN);
    if hidden > 0 {
        writeln!(out, "  {hidden} earlier ones are not shown; --from and --to narrow the time")?;
    }
    for event in &history.events[hidden..] {
        writeln!(out, "  {}  {:<12}  {}", iso(event.t_ns), event.kind, terminal::plain(&event.text))?;
    }
    if history.left_out > 0 {
        writeln!(out, "  and {} that were too many to keep", history.left_out)?;
    }
    Ok(())
}
