//! The rows of a sweep as text.

use std::io::Write;

use gearwatch_batch::sweep::{Mean, Row, numbers};

use crate::terminal::{self, cell};

/// One line a row for people; `--out` has all columns.
pub(super) fn print(rows: &[Row]) -> anyhow::Result<()> {
    let mut out = std::io::BufWriter::new(terminal::out());
    let width = |of: fn(&Row) -> &str| rows.iter().map(|row| cell(of(row)).chars().count()).max().unwrap_or(0).max(7);
    let (case, channel, stage) = (width(|r| &r.case), width(|r| &r.channel), width(|r| &r.stage));
    write!(out, "{:case$} {:channel$} {:stage$} {:>8} {:>8}", "case", "channel", "stage", "Hz", "N m")?;
    for name in ["p-p", "RMS", "1x", "2x", "3x", "4x", "5x", "pinion s.", "wheel s."] {
        write!(out, " {name:>10}")?;
    }
    writeln!(out)?;
    for row in rows {
        let torque = if row.brake_torque_nm.is_finite() { format!("{:.1}", row.brake_torque_nm) } else { "-".into() };
        write!(
            out,
            "{:case$} {:channel$} {:stage$} {:>8.3} {torque:>8}",
            cell(&row.case),
            cell(&row.channel),
            cell(&row.stage),
            row.input_speed_hz
        )?;
        let first = [&row.peak_to_peak, &row.rms];
        let sidebands = [&row.pinion_sidebands[0], &row.wheel_sidebands[0]];
        for mean in first.into_iter().chain(&row.harmonics).chain(sidebands) {
            write!(out, " {:>10}", figure(mean))?;
        }
        writeln!(out)?;
    }
    let unit = rows.first().map_or("", |row| row.unit.as_str());
    writeln!(out, "amplitudes in {unit}; sidebands ±1…±3 about 1x, root of the sum of squares; Hz: input shaft")?;
    out.flush()?;
    Ok(())
}

fn figure(mean: &Mean) -> String {
    let value = mean.value();
    if value.is_finite() { format!("{value:.4}") } else { "-".into() }
}

/// All columns; unknown numbers are empty.
pub(super) fn write_csv(out: impl Write, rows: &[Row]) -> anyhow::Result<()> {
    let mut out = csv::Writer::from_writer(out);
    let mut head: Vec<String> =
        ["case", "recording", "channel", "unit", "stage", "windows"].map(str::to_owned).to_vec();
    head.extend(rows.iter().take(1).flat_map(numbers).map(|(name, _)| name));
    out.write_record(&head)?;
    for row in rows {
        let mut line =
            vec![row.case.clone(), row.recording.clone(), row.channel.clone(), row.unit.clone(), row.stage.clone()];
        line.push(row.windows.to_string());
        let text = |value: f64| if value.is_finite() { value.to_string() } else { String::new() };
        line.extend(numbers(row).into_iter().map(|(_, value)| text(value)));
        out.write_record(&line)?;
    }
    Ok(out.flush()?)
}
