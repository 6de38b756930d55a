//! Indicators as a table, JSON lines or CSV.

use std::io::Write;

use gearwatch_core::bench::IndicatorSettings;
use gearwatch_core::estimate::Estimate;
use gearwatch_core::indicators::columns::Mean;
use gearwatch_core::verdict::published;
use serde_json::{Value, json};

use crate::terminal;

/// Standard errors beyond which a number is marked: by chance 6 of 100 000 are, of the hundred of a small bench one in 160 tables.
const MARKED: f64 = 4.0;

/// One number.
pub(super) struct Row {
    pub(super) recording: String,
    pub(super) channel: String,
    /// Empty for the channel.
    pub(super) place: String,
    pub(super) indicator: String,
    pub(super) unit: String,
    pub(super) value: Estimate,
    pub(super) windows: u64,
    pub(super) revolutions: u32,
    pub(super) speed_hz: Estimate,
    /// Of the healthy recordings.
    pub(super) normal: Estimate,
}

/// Mean of healthy recordings. Sigma: from the scatter between them where there are several, at least what they state themselves; it is that of one
/// further recording.
pub(super) fn normal(recordings: impl Iterator<Item = Mean>) -> Estimate {
    let mut mean = Mean::default();
    let mut stated: f64 = 0.0;
    for recording in recordings {
        let estimate = recording.estimate(0.5);
        mean.push(estimate);
        stated = stated.max(estimate.sigma);
    }
    let Estimate { value, .. } = mean.estimate(1.0);
    let count = mean.count() as f64;
    let scatter = mean.scatter();
    let sigma = if scatter.is_finite() { scatter * (1.0 + 1.0 / count).sqrt() } else { 0.0 };
    Estimate::new(value, sigma.max(stated))
}

impl Row {
    fn is_known(&self) -> bool {
        self.value.is_known()
    }

    /// Difference from normal, in percent of normal, and its sigma.
    fn deviation(&self) -> Estimate {
        let percent = 100.0 / self.normal.value.abs();
        let difference = self.value.value - self.normal.value;
        Estimate::new(percent * difference, percent * self.value.sigma.hypot(self.normal.sigma))
    }

    /// Difference from normal in standard errors.
    fn z(&self) -> f64 {
        (self.value.value - self.normal.value) / self.value.sigma.hypot(self.normal.sigma)
    }

    fn fields(&self) -> [(&'static str, Value); 15] {
        let number = |x: f64| json!(published(x));
        let deviation = self.deviation();
        [
            ("recording", json!(self.recording)),
            ("channel", json!(self.channel)),
            ("place", json!(self.place)),
            ("indicator", json!(self.indicator)),
            ("unit", json!(self.unit)),
            ("value", number(self.value.value)),
            ("sigma", number(self.value.sigma)),
            ("windows", json!(self.windows)),
            ("revolutions", json!(self.revolutions)),
            ("input_speed_hz", number(self.speed_hz.value)),
            ("baseline", number(self.normal.value)),
            ("baseline_sigma", number(self.normal.sigma)),
            ("dev_percent", number(deviation.value)),
            ("dev_sigma_percent", number(deviation.sigma)),
            ("z", number(self.z())),
        ]
    }
}

/// One object a line; numbers that are not known are `null`.
pub(super) fn json(out: &mut impl Write, rows: &[Row]) -> anyhow::Result<()> {
    for row in rows {
        let object: serde_json::Map<String, Value> =
            row.fields().into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
        serde_json::to_writer(&mut *out, &object)?;
        writeln!(out)?;
    }
    Ok(())
}

/// A header line and a line a number; what is not known is an empty field.
pub(super) fn csv(out: &mut impl Write, rows: &[Row]) -> anyhow::Result<()> {
    let mut writer = csv::Writer::from_writer(out);
    let Some(first) = rows.first() else { return Ok(()) };
    writer.write_record(first.fields().iter().map(|(name, _)| *name))?;
    for row in rows {
        writer.write_record(row.fields().iter().map(|(_, value)| match value {
            Value::Null => String::new(),
            Value::String(text) => text.clone(),
            other => other.to_string(),
        }))?;
    }
    Ok(writer.flush()?)
}

/// For people: a block a channel, a line a number.
pub(super) fn table(out: &mut impl Write, rows: &[Row], settings: &IndicatorSettings) -> anyhow::Result<()> {
    let compared = rows.iter().any(|row| row.normal.is_known());
    let mut block = (String::new(), String::new());
    let mut place = String::new();
    for row in rows {
        if block != (row.recording.clone(), row.channel.clone()) {
            block = (row.recording.clone(), row.channel.clone());
            place.clear();
            writeln!(
                out,
                "{}  {}  {} windows at {:.3} Hz",
                terminal::plain(&row.recording),
                terminal::plain(&row.channel),
                row.windows,
                row.speed_hz.value
            )?;
        }
        if row.place != place {
            place.clone_from(&row.place);
            let turns =
                if row.revolutions > 0 { format!(" ({} turns a window)", row.revolutions) } else { String::new() };
            writeln!(out, "  {}{turns}", terminal::plain(&place))?;
        }
        let indent = if place.is_empty() { "  " } else { "    " };
        if !row.is_known() {
            // NA4* without healthy recordings is not worth a line.
            if !row.indicator.ends_with("_star") {
                writeln!(out, "{indent}{:<20} unknown", row.indicator)?;
            }
            continue;
        }
        let unit = if row.unit == "1" { "" } else { row.unit.as_str() };
        let text = format!("{} {unit}", figure(row.value));
        write!(out, "{indent}{:<20} {text:<28}", row.indicator)?;
        if compared && row.normal.is_known() {
            let deviation = row.deviation();
            let mark = if row.z().abs() >= MARKED { "  !" } else { "" };
            let sign = if deviation.value > 0.0 { "+" } else { "" };
            write!(out, " {:>22} %{mark}", format!("{sign}{}", figure(deviation)))?;
        }
        if row.indicator == "velocity_rms"
            && let Some(zone) = settings.zone(row.value.value)
        {
            write!(out, "  zone {zone}")?;
        }
        writeln!(out)?;
    }
    if compared {
        writeln!(out, "! beyond {MARKED} standard errors of what healthy recordings have")?;
    }
    Ok(())
}

/// A value and its sigma, both to two digits of the sigma and at most six of the value.
fn figure(x: Estimate) -> String {
    let digits = |x: f64| if x > 0.0 { x.log10().floor() as i32 } else { -12 };
    let last = 1 - digits(x.sigma).max(digits(x.value.abs()) - 4);
    if (0..=8).contains(&last) {
        let places = last as usize;
        format!("{:.places$} ± {:.places$}", x.value, x.sigma)
    } else if last < 0 && x.value.abs() < 1e7 {
        format!("{:.0} ± {:.0}", x.value, x.sigma)
    } else {
        format!("{:.3e} ± {:.1e}", x.value, x.sigma)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conform_figures_end_where_their_sigma_does() {
        let text = |value, sigma| figure(Estimate::new(value, sigma));
        assert_eq!(text(2.34567, 0.012), "2.346 ± 0.012");
        assert_eq!(text(1234.6, 32.0), "1235 ± 32");
        assert_eq!(text(0.5, 0.0), "0.500000 ± 0.000000");
        assert_eq!(text(1.5e-12, 1e-14), "1.500e-12 ± 1.0e-14");
    }

    /// Three healthy recordings of 1, 2 and 3: a further one scatters by `1 · sqrt(1 + 1/3)` about 2.
    #[test]
    fn analytic_scatter_of_a_further_recording() {
        let one = |value: f64| {
            let mut mean = Mean::default();
            mean.push(Estimate::new(value, 1e-6));
            mean
        };
        let found = normal([1.0, 2.0, 3.0].map(one).into_iter());
        assert!((found.value - 2.0).abs() < 1e-12);
        assert!((found.sigma - (4.0f64 / 3.0).sqrt()).abs() < 1e-12);
    }
}
