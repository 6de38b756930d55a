//! Indicators as a table, JSON lines or CSV.

use std::io::Write;

use gearwatch_core::bench::IndicatorSettings;
use gearwatch_core::estimate::Estimate;
use gearwatch_core::indicators::table::Row;
use serde_json::Value;

use crate::terminal;

/// Standard errors beyond which a number is marked: by chance 6 of 100 000 are, of the hundred of a
/// small bench one in 160 tables.
const MARKED: f64 = 4.0;

/// One object a line; numbers that are not known are `null`.
pub(super) fn json(out: &mut impl Write, rows: &[Row]) -> anyhow::Result<()> {
    for row in rows {
        serde_json::to_writer(&mut *out, row)?;
        writeln!(out)?;
    }
    Ok(())
}

/// A header line and a line a number; what is not known is an empty field.
pub(super) fn csv(out: &mut impl Write, rows: &[Row]) -> anyhow::Result<()> {
    let mut writer = csv::Writer::from_writer(out);
    for (at, row) in rows.iter().enumerate() {
        let Value::Object(fields) = serde_json::to_value(row)? else { continue };
        if at == 0 {
            writer.write_record(fields.keys())?;
        }
        writer.write_record(fields.values().map(|value| match value {
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
        if !row.value.is_known() {
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
            let deviation = row.deviation_percent();
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
}
