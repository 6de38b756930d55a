//! MATLAB version 5, after "MAT-File Format" (The MathWorks): column vectors, single where that is
//! exact, not compressed; the rate as the scalar `fs`.

use std::io::Write;

use super::{Column, Trouble};

/// Name of the sample rate (Hz).
pub(super) const RATE: &str = "fs";
/// Longest name of a variable.
const LONGEST: usize = 63;

/// Types of elements.
const INT8: u32 = 1;
const INT32: u32 = 5;
const UINT32: u32 = 6;
const SINGLE: u32 = 7;
const DOUBLE: u32 = 9;
const MATRIX: u32 = 14;
/// Classes of arrays.
const CLASS_DOUBLE: u32 = 6;
const CLASS_SINGLE: u32 = 7;

/// A name that MATLAB takes, unlike those that are `taken`: letters, digits and underscores, a
/// letter first.
pub(super) fn variable(name: &str, taken: impl Fn(&str) -> bool) -> String {
    let mut out: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if !out.starts_with(|c: char| c.is_ascii_alphabetic()) {
        out.insert_str(0, "x_");
    }
    out.truncate(LONGEST - 5);
    let plain = out.clone();
    let mut k = 1;
    while taken(&out) {
        k += 1;
        out = format!("{plain}_{k}");
    }
    out
}

pub(super) fn write(columns: &[Column<'_>], rate_hz: f64, out: &mut impl Write) -> Result<(), Trouble> {
    let text = format!("MATLAB 5.0 MAT-file, written by gearwatch {}", env!("CARGO_PKG_VERSION"));
    write!(out, "{text:<116}")?;
    out.write_all(&[b' '; 8])?;
    out.write_all(&0x0100_u16.to_le_bytes())?;
    out.write_all(b"IM")?;
    vector(out, RATE, &[rate_hz], false)?;
    for column in columns {
        vector(out, &column.called, &column.segment.samples, column.is_single())?;
    }
    Ok(())
}

fn vector(out: &mut impl Write, name: &str, values: &[f64], single: bool) -> Result<(), Trouble> {
    let (class, kind, width) = if single { (CLASS_SINGLE, SINGLE, 4) } else { (CLASS_DOUBLE, DOUBLE, 8) };
    let data = width * values.len() as u64;
    let padded = |bytes: u64| bytes.next_multiple_of(8);
    let size = 16 + 16 + 8 + padded(name.len() as u64) + 8 + padded(data);
    // The format counts with signs.
    let (Ok(_), Ok(count)) = (i32::try_from(size), i32::try_from(values.len())) else {
        return Err(Trouble::Unfit(format!("{name} has {} samples", values.len())));
    };
    let mut tag = |kind: u32, bytes: u64| out.write_all(&[kind.to_le_bytes(), (bytes as u32).to_le_bytes()].concat());
    tag(MATRIX, size)?;
    tag(UINT32, 8)?;
    out.write_all(&u64::from(class).to_le_bytes())?;
    out.write_all(&[INT32.to_le_bytes(), 8_u32.to_le_bytes(), count.to_le_bytes(), 1_i32.to_le_bytes()].concat())?;
    out.write_all(&[INT8.to_le_bytes(), (name.len() as u32).to_le_bytes()].concat())?;
    out.write_all(name.as_bytes())?;
    out.write_all(&vec![0; (padded(name.len() as u64) - name.len() as u64) as usize])?;
    out.write_all(&[kind.to_le_bytes(), (data as u32).to_le_bytes()].concat())?;
    for &value in values {
        match single {
            true => out.write_all(&(value as f32).to_le_bytes())?,
            false => out.write_all(&value.to_le_bytes())?,
        }
    }
    Ok(out.write_all(&vec![0; (padded(data) - data) as usize])?)
}
