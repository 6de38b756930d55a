//! One row per window, channel and stage: where it comes from, and the fields of the verdict as
//! columns.
//!
//! Names, types, units and descriptions of the columns are those of the table of fields
//! (`core::verdict::FIELDS`); unit and description stand in the metadata of each column.

use std::collections::HashMap;
use std::sync::{Arc, LazyLock};

use arrow_array::builder::{
    BooleanBuilder, Float64Builder, Int8Builder, StringBuilder, TimestampNanosecondBuilder, UInt64Builder,
};
use arrow_array::{ArrayRef, RecordBatch};
use arrow_schema::{ArrowError, DataType, Field, Schema, SchemaRef, TimeUnit};
use gearwatch_core::verdict::{Datum, FIELDS, Field as VerdictField, Holds, Part, Verdict, published};

use crate::part::Table;

/// Where rows come from.
#[derive(Clone, Debug, Default)]
pub struct Origin {
    /// Name in the work list.
    pub file: String,
    /// SHA-256 of the recording.
    pub file_sha256: String,
    /// SHA-256 of the sidecar file beside it, empty where there is none.
    pub sidecar_sha256: String,
    /// SHA-256 of the baseline file, empty where there is none.
    pub baseline_sha256: String,
}

/// Columns that say where a row comes from, with their descriptions; the first three are its
/// identity.
const ORIGIN: [(&str, &str); 5] = [
    ("file", "Recording, as named in the list of work."),
    ("file_sha256", "SHA-256 of the recording."),
    ("sidecar_sha256", "SHA-256 of the sidecar file; empty where there is none."),
    ("baseline_sha256", "SHA-256 of the baseline file; empty where there is none."),
    ("version", "Version of gearwatch that made the row."),
];
const SAMPLE_RATE: &str = "sample_rate_hz";
/// Times are UTC.
const ZONE: &str = "UTC";

/// The table of a part.
pub fn table() -> Table {
    Table { schema: SCHEMA.clone(), keys: 3 }
}

static SCHEMA: LazyLock<SchemaRef> = LazyLock::new(|| {
    let described = |field: Field, unit: &str, meaning: &str| {
        let unit = if unit == "channel" { "unit of the channel (column unit)" } else { unit };
        let mut metadata = HashMap::from([("description".to_owned(), meaning.to_owned())]);
        if !unit.is_empty() {
            metadata.insert("unit".to_owned(), unit.to_owned());
        }
        field.with_metadata(metadata)
    };
    let mut fields: Vec<Field> =
        ORIGIN.iter().map(|(name, meaning)| described(Field::new(*name, DataType::Utf8, false), "", meaning)).collect();
    let rate = Field::new(SAMPLE_RATE, DataType::Float64, true);
    fields.push(described(rate, "Hz", "Sample rate of the window."));
    fields.extend(FIELDS.iter().map(|field| {
        let column = Field::new(&field.name, kind(field.holds), optional(field));
        described(column, if matches!(field.holds, Holds::Time) { "" } else { field.unit }, &field.meaning)
    }));
    Arc::new(Schema::new(fields))
});

fn kind(holds: Holds) -> DataType {
    match holds {
        Holds::Text | Holds::Code(_) => DataType::Utf8,
        Holds::Time => DataType::Timestamp(TimeUnit::Nanosecond, Some(ZONE.into())),
        Holds::Count => DataType::UInt64,
        Holds::Level => DataType::Int8,
        Holds::Flag => DataType::Boolean,
        Holds::Number => DataType::Float64,
    }
}

/// A row may have no value there.
fn optional(field: &VerdictField) -> bool {
    matches!(field.holds, Holds::Number) || matches!(field.part, Part::State(_) | Part::Indicator)
}

#[derive(Debug)]
enum Column {
    Text(StringBuilder),
    Time(TimestampNanosecondBuilder),
    Count(UInt64Builder),
    Level(Int8Builder),
    Flag(BooleanBuilder),
    Number(Float64Builder),
}

impl Column {
    fn new(holds: Holds) -> Self {
        match holds {
            Holds::Text | Holds::Code(_) => Self::Text(StringBuilder::new()),
            Holds::Time => Self::Time(TimestampNanosecondBuilder::new().with_timezone(ZONE)),
            Holds::Count => Self::Count(UInt64Builder::new()),
            Holds::Level => Self::Level(Int8Builder::new()),
            Holds::Flag => Self::Flag(BooleanBuilder::new()),
            Holds::Number => Self::Number(Float64Builder::new()),
        }
    }

    /// Appends one value; what is absent, unknown or of another type becomes null.
    fn push(&mut self, datum: Datum<'_>) {
        match (self, datum) {
            (Self::Text(column), Datum::Text(text)) => column.append_value(text),
            (Self::Text(column), _) => column.append_null(),
            (Self::Time(column), Datum::Integer(t)) => column.append_value(t),
            (Self::Time(column), _) => column.append_null(),
            (Self::Count(column), Datum::Count(x)) => column.append_value(x),
            (Self::Count(column), _) => column.append_null(),
            (Self::Level(column), Datum::Integer(x)) => column.append_option(i8::try_from(x).ok()),
            (Self::Level(column), _) => column.append_null(),
            (Self::Flag(column), Datum::Flag(x)) => column.append_value(x),
            (Self::Flag(column), _) => column.append_null(),
            (Self::Number(column), Datum::Number(x)) => {
                column.append_option(x.is_finite().then(|| published(x)));
            }
            (Self::Number(column), _) => column.append_null(),
        }
    }

    fn finish(&mut self) -> ArrayRef {
        match self {
            Self::Text(column) => Arc::new(column.finish()),
            Self::Time(column) => Arc::new(column.finish()),
            Self::Count(column) => Arc::new(column.finish()),
            Self::Level(column) => Arc::new(column.finish()),
            Self::Flag(column) => Arc::new(column.finish()),
            Self::Number(column) => Arc::new(column.finish()),
        }
    }
}

/// Rows on their way to a part.
#[derive(Debug)]
pub struct Rows {
    origin: [StringBuilder; ORIGIN.len()],
    sample_rate_hz: Float64Builder,
    verdict: Vec<Column>,
    len: usize,
}

impl Default for Rows {
    fn default() -> Self {
        Self {
            origin: Default::default(),
            sample_rate_hz: Float64Builder::new(),
            verdict: FIELDS.iter().map(|field| Column::new(field.holds)).collect(),
            len: 0,
        }
    }
}

impl Rows {
    /// Number of rows.
    pub fn len(&self) -> usize {
        self.len
    }

    /// There is no row.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Adds a verdict on a window that was sampled at `sample_rate_hz`.
    pub fn push(&mut self, origin: &Origin, sample_rate_hz: f64, verdict: &Verdict) {
        let version = env!("CARGO_PKG_VERSION");
        let texts =
            [&origin.file, &origin.file_sha256, &origin.sidecar_sha256, &origin.baseline_sha256].map(String::as_str);
        for (column, text) in self.origin.iter_mut().zip(texts.into_iter().chain([version])) {
            column.append_value(text);
        }
        self.sample_rate_hz.append_option(sample_rate_hz.is_finite().then(|| published(sample_rate_hz)));
        for (column, field) in self.verdict.iter_mut().zip(FIELDS.iter()) {
            column.push(field.read(verdict));
        }
        self.len += 1;
    }

    /// Takes the rows out as a batch; afterwards there are none.
    ///
    /// # Errors
    /// Never for rows that came in by [`Self::push`]; the type is that of the library.
    pub fn take(&mut self) -> Result<RecordBatch, ArrowError> {
        self.len = 0;
        let origin = self.origin.iter_mut().map(|column| Arc::new(column.finish()) as ArrayRef);
        let mut columns: Vec<ArrayRef> = origin.collect();
        columns.push(Arc::new(self.sample_rate_hz.finish()));
        columns.extend(self.verdict.iter_mut().map(Column::finish));
        RecordBatch::try_new(SCHEMA.clone(), columns)
    }
}
