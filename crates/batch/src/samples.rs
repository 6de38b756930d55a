//! A recording as one Parquet table: a row a sample instant, a column a channel.
//!
//! | column | type | |
//! |---|---|---|
//! | `time` | timestamp in ns, UTC | of the sample; since the first sample where the recording has no date |
//! | a sensor's name | float where single precision holds every value, else double | in the unit that its metadata says; null where this channel has a gap |
//! | `motor_speed_hz`, `brake_torque_nm`, `temperature_c` | double | the last one that was told before; only those that are known |
//!
//! Where no channel has a sample there is no row, so that gaps stay visible in `time`. The field's
//! metadata hold `unit` and `sample_rate_hz`.

use std::collections::HashMap;
use std::io::Write;
use std::sync::Arc;

use arrow_array::{ArrayRef, Float32Array, Float64Array, RecordBatch, TimestampNanosecondArray};
use arrow_schema::{DataType, Field, Schema, TimeUnit};
use gearwatch_core::block::{OperatingPoint, Quality, UnixNanos};
use gearwatch_core::recording::{Channel, Recording};
use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, ZstdLevel};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;

/// Rows that are put together at once.
const ROWS: usize = 1 << 16;
/// Rows of a group, which a reader takes whole: some megabytes.
const GROUP_ROWS: usize = 1 << 20;
/// Columns that are not channels.
const RESERVED: [&str; 4] = ["time", "motor_speed_hz", "brake_torque_nm", "temperature_c"];

/// Why a recording cannot be a table.
#[derive(Debug, thiserror::Error)]
pub enum SamplesError {
    /// There is nothing to write.
    #[error("the recording has no sample")]
    Empty,
    /// A table has one row for all channels.
    #[error("{0} has {1} Hz and {2} {3} Hz; a Parquet table has one sample rate")]
    Rates(String, f64, String, f64),
    /// A name that a column of another meaning has.
    #[error(
        "a channel is called {0:?}, which is another column of the table; call it otherwise with --channel NAME={0}"
    )]
    Name(String),
    /// The file cannot be written.
    #[error("cannot be written: {0}")]
    Write(#[from] ParquetError),
}

/// Where the samples of a channel lie among the rows of all: first row of a piece, and the piece.
struct Column<'a> {
    name: &'a str,
    single: bool,
    pieces: Vec<(u64, &'a [f64])>,
}

impl<'a> Column<'a> {
    fn new(name: &'a str, channel: &'a Channel, start: UnixNanos) -> Self {
        let mut pieces: Vec<(u64, &[f64])> = Vec::new();
        for segment in &channel.segments {
            let late_s = (i128::from(segment.t0) - i128::from(start)) as f64 * 1e-9;
            let end = pieces.last().map_or(0, |(first, values)| first + values.len() as u64);
            // Clocks that run backwards: what comes later follows.
            pieces.push((((late_s * channel.sample_rate_hz).round() as u64).max(end), &segment.samples));
        }
        // A value that is no number is one in either precision.
        let single = pieces.iter().flat_map(|(_, values)| *values).all(|&v| f64::from(v as f32) == v || v.is_nan());
        Self { name, single, pieces }
    }

    fn value(&self, row: u64) -> Option<f64> {
        let at = self.pieces.partition_point(|(first, _)| *first <= row).checked_sub(1)?;
        let (first, values) = self.pieces[at];
        values.get(usize::try_from(row - first).ok()?).copied()
    }

    fn array(&self, rows: &[u64]) -> ArrayRef {
        let values = rows.iter().map(|&row| self.value(row));
        match self.single {
            true => Arc::new(values.map(|v| v.map(|v| v as f32)).collect::<Float32Array>()),
            false => Arc::new(values.collect::<Float64Array>()),
        }
    }
}

/// Runs of rows in which any channel has a sample: first, and one behind the last.
fn runs(columns: &[Column<'_>]) -> Vec<(u64, u64)> {
    let pieces = columns.iter().flat_map(|column| &column.pieces);
    let mut all: Vec<(u64, u64)> = pieces.map(|(first, values)| (*first, first + values.len() as u64)).collect();
    all.sort_unstable();
    let mut out: Vec<(u64, u64)> = Vec::new();
    for (first, end) in all {
        match out.last_mut() {
            Some(last) if first <= last.1 => last.1 = last.1.max(end),
            _ => out.push((first, end)),
        }
    }
    out
}

type PointColumn = (&'static str, fn(&OperatingPoint) -> f64);

/// Writes a recording; what the table does not hold is returned, a sentence each.
///
/// # Errors
/// When there is no sample, channels have different rates, a name has another meaning, or the bytes
/// cannot be written.
pub fn write_parquet(recording: &Recording, out: impl Write + Send) -> Result<Vec<String>, SamplesError> {
    let channels = || recording.channels.iter().filter(|(_, channel)| !channel.is_empty());
    let (first_name, first) = channels().next().ok_or(SamplesError::Empty)?;
    let rate_hz = first.sample_rate_hz;
    for (name, channel) in channels() {
        if channel.sample_rate_hz != rate_hz {
            let (a, b) = (first_name.clone(), name.clone());
            return Err(SamplesError::Rates(a, rate_hz, b, channel.sample_rate_hz));
        }
        if RESERVED.contains(&name.as_str()) {
            return Err(SamplesError::Name(name.clone()));
        }
    }
    let start = channels().flat_map(|(_, channel)| &channel.segments).map(|segment| segment.t0).min().unwrap_or(0);
    let columns: Vec<Column<'_>> = channels().map(|(name, channel)| Column::new(name, channel, start)).collect();
    let points: [PointColumn; 3] = [
        ("motor_speed_hz", |point| point.motor_speed_hz),
        ("brake_torque_nm", |point| point.brake_torque_nm),
        ("temperature_c", |point| point.temperature_c),
    ];
    let known: Vec<PointColumn> = points
        .into_iter()
        .filter(|(_, of)| recording.operating_points.iter().any(|point| of(point).is_finite()))
        .collect();

    let mut fields = vec![Field::new("time", DataType::Timestamp(TimeUnit::Nanosecond, Some("UTC".into())), false)];
    for (column, (_, channel)) in columns.iter().zip(channels()) {
        let kind = if column.single { DataType::Float32 } else { DataType::Float64 };
        fields.push(Field::new(column.name, kind, true).with_metadata(HashMap::from([
            ("unit".to_owned(), channel.unit.to_string()),
            ("sample_rate_hz".to_owned(), rate_hz.to_string()),
        ])));
    }
    fields.extend(known.iter().map(|(name, _)| Field::new(*name, DataType::Float64, true)));
    let schema = Arc::new(Schema::new(fields));
    let properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(3)?))
        .set_max_row_group_row_count(Some(GROUP_ROWS))
        .set_created_by(concat!("gearwatch ", env!("CARGO_PKG_VERSION")).to_owned())
        .build();
    let mut writer = ArrowWriter::try_new(out, schema.clone(), Some(properties))?;
    let mut write = |rows: &[u64]| -> Result<(), SamplesError> {
        let times: Vec<i64> =
            rows.iter().map(|&row| start.saturating_add((row as f64 / rate_hz * 1e9).round() as i64)).collect();
        let mut arrays: Vec<ArrayRef> = columns.iter().map(|column| column.array(rows)).collect();
        for (_, of) in &known {
            let told = times.iter().map(|&t| {
                let points = &recording.operating_points;
                let at = points.partition_point(|point| point.t <= t).checked_sub(1)?;
                Some(of(&points[at])).filter(|value| value.is_finite())
            });
            arrays.push(Arc::new(told.collect::<Float64Array>()));
        }
        arrays.insert(0, Arc::new(TimestampNanosecondArray::from(times).with_timezone("UTC")));
        let batch = RecordBatch::try_new(schema.clone(), arrays).map_err(ParquetError::from)?;
        Ok(writer.write(&batch)?)
    };
    let mut rows = Vec::with_capacity(ROWS);
    for (first, end) in runs(&columns) {
        for row in first..end {
            rows.push(row);
            if rows.len() == ROWS {
                write(&rows)?;
                rows.clear();
            }
        }
    }
    write(&rows)?;
    writer.close()?;
    Ok(left_out(recording))
}

fn left_out(recording: &Recording) -> Vec<String> {
    let tachos = recording
        .tachos
        .iter()
        .map(|(shaft, tacho)| format!("the tacho of shaft {shaft}, {} pulses, is left out", tacho.pulse_times.len()));
    let marked = recording.channels.iter().filter(|(_, channel)| {
        channel.segments.iter().any(|segment| ![Quality::GOOD, Quality::GAP_BEFORE].contains(&segment.quality))
    });
    tachos.chain(marked.map(|(name, _)| format!("{name}: the quality marks of its blocks are left out"))).collect()
}

#[cfg(test)]
mod tests {
    use arrow_array::Array;
    use arrow_array::cast::AsArray;
    use arrow_array::types::{Float32Type, Float64Type, TimestampNanosecondType};
    use gearwatch_core::recording::Segment;
    use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;

    use super::*;

    const T0: i64 = 1_767_225_600_000_000_000;

    fn channel(pieces: &[(i64, &[f64])]) -> Channel {
        let segment = |(t0, samples): &(i64, &[f64])| Segment {
            t0: *t0,
            first_sample_index: 0,
            samples: samples.to_vec(),
            quality: Quality::GOOD,
        };
        Channel { sample_rate_hz: 1000.0, unit: "g".into(), segments: pieces.iter().map(segment).collect() }
    }

    /// Two channels, one of which loses three samples that the other has, and both two more: the
    /// rows of the first loss are null, those of the second are not there.
    #[test]
    fn analytic_gaps_are_nulls_or_missing_rows() {
        let mut recording = Recording::default();
        let ms = 1_000_000;
        recording.channels.insert("a".into(), channel(&[(T0, &[1.0, 2.0, 3.0, 4.0, 5.0]), (T0 + 7 * ms, &[8.0])]));
        recording.channels.insert("b".into(), channel(&[(T0 + ms, &[0.1]), (T0 + 7 * ms, &[0.8])]));
        recording.operating_points.push(OperatingPoint {
            t: T0 + 2 * ms,
            motor_speed_hz: 25.0,
            brake_torque_nm: f64::NAN,
            temperature_c: f64::NAN,
        });
        let mut file = tempfile::tempfile().unwrap();
        assert_eq!(write_parquet(&recording, &mut file).unwrap(), Vec::<String>::new());
        let mut reader = ParquetRecordBatchReaderBuilder::try_new(file).unwrap().build().unwrap();
        let batch = reader.next().unwrap().unwrap();
        let names: Vec<_> = batch.schema().fields().iter().map(|field| field.name().clone()).collect();
        assert_eq!(names, ["time", "a", "b", "motor_speed_hz"]);
        assert_eq!(batch.schema().field(1).metadata()["unit"], "g");
        let times = batch.column(0).as_primitive::<TimestampNanosecondType>();
        assert_eq!(times.values().iter().map(|t| (t - T0) / ms).collect::<Vec<_>>(), [0, 1, 2, 3, 4, 7]);
        let a = batch.column(1).as_primitive::<Float32Type>();
        assert_eq!(a.values().to_vec(), [1.0, 2.0, 3.0, 4.0, 5.0, 8.0]);
        // 0.1 is not single.
        let b = batch.column(2).as_primitive::<Float64Type>();
        assert_eq!(b.iter().collect::<Vec<_>>(), [None, Some(0.1), None, None, None, Some(0.8)]);
        let speed = batch.column(3).as_primitive::<Float64Type>();
        assert_eq!(speed.null_count(), 2);
        assert_eq!(speed.value(5), 25.0);
    }

    #[test]
    fn conform_what_is_no_table_is_refused() {
        let mut recording = Recording::default();
        assert!(matches!(write_parquet(&recording, Vec::new()), Err(SamplesError::Empty)));
        recording.channels.insert("a".into(), channel(&[(T0, &[1.0])]));
        recording.channels.insert("b".into(), Channel { sample_rate_hz: 500.0, ..channel(&[(T0, &[1.0])]) });
        assert!(matches!(write_parquet(&recording, Vec::new()), Err(SamplesError::Rates(..))));
        recording.channels.remove("b");
        recording.channels.insert("time".into(), channel(&[(T0, &[1.0])]));
        assert!(matches!(write_parquet(&recording, Vec::new()), Err(SamplesError::Name(_))));
    }
}
