//! RIFF WAVE with floats (format 3). Values stand as they are, not as a share of full scale. The
//! rate is the nearest whole number; the sidecar file has it exactly.

use std::io::Write;

use super::{Column, Trouble};

/// Bytes from the beginning of the file to the first sample.
const HEAD: u64 = 12 + 8 + 18 + 8 + 4 + 8;

pub(super) fn write(columns: &[Column<'_>], rate_hz: f64, out: &mut impl Write) -> Result<(), Trouble> {
    let single = columns.iter().all(Column::is_single);
    let width: u64 = if single { 4 } else { 8 };
    let frames = columns.first().map_or(0, |column| column.segment.samples.len());
    let data = width * columns.len() as u64 * frames as u64;
    let size = u32::try_from(data + HEAD - 8).map_err(|_| Trouble::Unfit(format!("{data} bytes of samples")))?;
    let channels = u16::try_from(columns.len()).map_err(|_| Trouble::Unfit(format!("{} channels", columns.len())))?;
    let rate = rate_hz.round();
    let frame = width as u32 * u32::from(channels);
    let (Some(frame_u16), true) = (u16::try_from(frame).ok(), (1.0..=f64::from(u32::MAX)).contains(&rate)) else {
        return Err(Trouble::Unfit(format!("{channels} channels at {rate_hz} Hz")));
    };
    let rate = rate as u32;
    out.write_all(b"RIFF")?;
    out.write_all(&size.to_le_bytes())?;
    out.write_all(b"WAVEfmt ")?;
    out.write_all(&18_u32.to_le_bytes())?;
    out.write_all(&3_u16.to_le_bytes())?;
    out.write_all(&channels.to_le_bytes())?;
    out.write_all(&rate.to_le_bytes())?;
    out.write_all(&rate.saturating_mul(frame).to_le_bytes())?;
    out.write_all(&frame_u16.to_le_bytes())?;
    out.write_all(&(8 * width as u16).to_le_bytes())?;
    out.write_all(&0_u16.to_le_bytes())?;
    out.write_all(b"fact")?;
    out.write_all(&4_u32.to_le_bytes())?;
    out.write_all(&(frames as u32).to_le_bytes())?;
    out.write_all(b"data")?;
    out.write_all(&(data as u32).to_le_bytes())?;
    for k in 0..frames {
        for column in columns {
            let value = column.segment.samples[k];
            match single {
                true => out.write_all(&(value as f32).to_le_bytes())?,
                false => out.write_all(&value.to_le_bytes())?,
            }
        }
    }
    Ok(())
}
