//! TDMS, after "TDMS File Format Internal Structure" (NI): one closed segment, low byte first, a
//! channel after the other.

use std::io::Write;

use gearwatch_core::block::{OperatingPoint, UnixNanos};

use super::Column;

/// Table of contents: metadata, a new list of objects, raw data.
const CONTENTS: u32 = 1 << 1 | 1 << 2 | 1 << 3;
const VERSION: u32 = 4713;
/// Types of values.
const SINGLE: u32 = 9;
const DOUBLE: u32 = 10;
const TEXT: u32 = 0x20;
const TIME: u32 = 0x44;
/// An object without samples.
const NO_DATA: u32 = u32::MAX;
/// Seconds from 1904-01-01, where TDMS begins, to 1970-01-01.
const TO_1970_S: i64 = 2_082_844_800;
const NANOS: i64 = 1_000_000_000;

pub(super) fn write(columns: &[Column<'_>], points: &[OperatingPoint], out: &mut impl Write) -> std::io::Result<()> {
    let mut meta = Vec::new();
    number(&mut meta, 2 + columns.len() as u32);
    text(&mut meta, "/");
    number(&mut meta, NO_DATA);
    // For people who look into the file; the sidecar file is what is read back.
    let known = points.first().map_or([f64::NAN; 2], |point| [point.motor_speed_hz, point.brake_torque_nm]);
    let known: Vec<(&str, f64)> =
        ["motor_speed_hz", "brake_torque_nm"].into_iter().zip(known).filter(|(_, x)| x.is_finite()).collect();
    number(&mut meta, known.len() as u32);
    known.iter().for_each(|(name, value)| real(&mut meta, name, *value));
    text(&mut meta, "/'gearwatch'");
    number(&mut meta, NO_DATA);
    number(&mut meta, 0);
    let mut bytes = 0;
    for column in columns {
        let count = column.segment.samples.len() as u64;
        let single = column.is_single();
        text(&mut meta, &format!("/'gearwatch'/'{}'", column.called.replace('\'', "''")));
        number(&mut meta, 20);
        number(&mut meta, if single { SINGLE } else { DOUBLE });
        number(&mut meta, 1);
        meta.extend_from_slice(&count.to_le_bytes());
        bytes += count * if single { 4 } else { 8 };
        number(&mut meta, 4);
        text(&mut meta, "unit_string");
        number(&mut meta, TEXT);
        text(&mut meta, &column.channel.unit);
        real(&mut meta, "wf_increment", 1.0 / column.channel.sample_rate_hz);
        real(&mut meta, "wf_start_offset", 0.0);
        text(&mut meta, "wf_start_time");
        number(&mut meta, TIME);
        meta.extend_from_slice(&stamp(column.segment.t0));
    }
    out.write_all(b"TDSm")?;
    out.write_all(&CONTENTS.to_le_bytes())?;
    out.write_all(&VERSION.to_le_bytes())?;
    out.write_all(&(meta.len() as u64 + bytes).to_le_bytes())?;
    out.write_all(&(meta.len() as u64).to_le_bytes())?;
    out.write_all(&meta)?;
    for column in columns {
        let single = column.is_single();
        for &value in &column.segment.samples {
            match single {
                true => out.write_all(&(value as f32).to_le_bytes())?,
                false => out.write_all(&value.to_le_bytes())?,
            }
        }
    }
    Ok(())
}

fn number(meta: &mut Vec<u8>, value: u32) {
    meta.extend_from_slice(&value.to_le_bytes());
}

fn text(meta: &mut Vec<u8>, value: &str) {
    number(meta, value.len() as u32);
    meta.extend_from_slice(value.as_bytes());
}

fn real(meta: &mut Vec<u8>, name: &str, value: f64) {
    text(meta, name);
    number(meta, DOUBLE);
    meta.extend_from_slice(&value.to_le_bytes());
}

/// 2⁻⁶⁴ s, then seconds since 1904. A nanosecond is some 2³⁴ of them; rounded up, it is read back
/// as the same.
fn stamp(t: UnixNanos) -> [u8; 16] {
    let (seconds, nanos) = (t.div_euclid(NANOS) + TO_1970_S, t.rem_euclid(NANOS) as u128);
    let fraction = ((nanos << 64).div_ceil(NANOS as u128)) as u64;
    let mut out = [0; 16];
    out[..8].copy_from_slice(&fraction.to_le_bytes());
    out[8..].copy_from_slice(&seconds.to_le_bytes());
    out
}
