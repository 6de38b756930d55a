//! A table: a header, `time` (s from the first sample), and a column a channel. Numbers are the
//! shortest that are read back as the same.

use std::io::Write;

use super::Column;

/// Name of the column of times.
pub(super) const TIME: &str = "time";

pub(super) fn write(columns: &[Column<'_>], rate_hz: f64, out: &mut impl Write) -> std::io::Result<()> {
    write!(out, "{TIME}")?;
    for column in columns {
        write!(out, ",{}", column.called)?;
    }
    writeln!(out)?;
    let rows = columns.first().map_or(0, |column| column.segment.samples.len());
    for k in 0..rows {
        write!(out, "{}", k as f64 / rate_hz)?;
        for column in columns {
            write!(out, ",{}", column.segment.samples[k])?;
        }
        writeln!(out)?;
    }
    out.flush()
}
