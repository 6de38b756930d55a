//! One row per window, channel and stage: the columns of a part.

use std::sync::Arc;

use arrow_array::builder::{BooleanBuilder, Float64Builder, Int8Builder, Int64Builder, StringBuilder, UInt64Builder};
use arrow_array::{ArrayRef, RecordBatch};
use arrow_schema::{ArrowError, DataType, Field, Schema, SchemaRef};
use gearwatch_core::indicators::{CHANNEL_INDICATORS, GEAR_INDICATORS};
use gearwatch_core::verdict::{CHANNEL_NAMES, GEAR_NAMES, HARMONICS, TURNS_NAMES, Verdict, published};

use crate::part::Table;

/// Columns of each harmonic, in order: number outside a rank's meaning is `null`, level −1 is unknown.
const PER_HARMONIC: [&str; 7] =
    ["dev_{}x_percent", "dev_sigma_{}x_percent", "amp_{}x", "sigma_{}x", "floor_{}x", "base_{}x", "p_{}x"];

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

/// The table of a part.
pub fn table() -> Table {
    Table { schema: schema(), keys: 3 }
}

fn schema() -> SchemaRef {
    let mut fields = vec![
        Field::new("file", DataType::Utf8, false),
        Field::new("file_sha256", DataType::Utf8, false),
        Field::new("sidecar_sha256", DataType::Utf8, false),
        Field::new("baseline_sha256", DataType::Utf8, false),
        Field::new("version", DataType::Utf8, false),
        Field::new("stage", DataType::Utf8, false),
        Field::new("channel", DataType::Utf8, false),
        Field::new("window", DataType::UInt64, false),
        Field::new("t0_ns", DataType::Int64, false),
        Field::new("first_sample_index", DataType::UInt64, false),
        Field::new("unit", DataType::Utf8, false),
        Field::new("machine", DataType::Utf8, false),
        Field::new("instrument", DataType::Utf8, false),
        Field::new("reason", DataType::Utf8, false),
        Field::new("cell", DataType::Utf8, false),
        Field::new("state_fit", DataType::Utf8, false),
        Field::new("state", DataType::Utf8, false),
        Field::new("doubts", DataType::Utf8, false),
        Field::new("resolvable", DataType::Boolean, false),
        Field::new("state_probability", DataType::Float64, true),
        Field::new("sample_rate_hz", DataType::Float64, true),
        Field::new("input_speed_hz", DataType::Float64, true),
        Field::new("input_speed_sigma_hz", DataType::Float64, true),
        Field::new("mesh_hz", DataType::Float64, true),
        Field::new("brake_torque_nm", DataType::Float64, true),
    ];
    for h in 1..=HARMONICS {
        fields.push(Field::new(format!("rank_{h}x"), DataType::Utf8, false));
        fields.push(Field::new(format!("level_{h}x"), DataType::Int8, false));
        for name in PER_HARMONIC {
            fields.push(Field::new(name.replace("{}", &h.to_string()), DataType::Float64, true));
        }
    }
    fields.extend(indicator_names().map(|name| Field::new(name, DataType::Float64, true)));
    Arc::new(Schema::new(fields))
}

/// Columns of the condition indicators: revolutions averaged; value, sigma, baseline, deviation and its sigma of each.
const INDICATORS: usize = 2 + 5 * (CHANNEL_INDICATORS + 2 * GEAR_INDICATORS);

fn indicator_names() -> impl Iterator<Item = &'static str> {
    TURNS_NAMES.into_iter().chain(CHANNEL_NAMES.into_iter().chain(GEAR_NAMES.into_iter().flatten()).flatten())
}

/// In the order of the names; `NaN` where the verdict has none.
fn indicator_values(verdict: &Verdict) -> Vec<f64> {
    let mut out = Vec::with_capacity(INDICATORS);
    if let Some(indicators) = &verdict.indicators {
        out.extend(indicators.gears.map(|gear| f64::from(gear.revolutions)));
        indicators.numbers(|x| out.push(x));
    }
    out.resize(INDICATORS, f64::NAN);
    out
}

/// Rows on their way to a part.
#[derive(Debug, Default)]
pub struct Rows {
    texts: [StringBuilder; 15],
    window: UInt64Builder,
    t0_ns: Int64Builder,
    first_sample_index: UInt64Builder,
    resolvable: BooleanBuilder,
    numbers: [Float64Builder; 6],
    ranks: [StringBuilder; HARMONICS],
    levels: [Int8Builder; HARMONICS],
    harmonics: [[Float64Builder; PER_HARMONIC.len()]; HARMONICS],
    indicators: IndicatorColumns,
    len: usize,
}

#[derive(Debug)]
struct IndicatorColumns([Float64Builder; INDICATORS]);

impl Default for IndicatorColumns {
    fn default() -> Self {
        Self(std::array::from_fn(|_| Float64Builder::new()))
    }
}

/// Unknown numbers are `null` in a table, as in the JSON lines.
fn number(builder: &mut Float64Builder, value: f64) {
    builder.append_option(value.is_finite().then(|| published(value)));
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
    pub fn push(&mut self, origin: &Origin, sample_rate_hz: f64, v: &Verdict) {
        let nearest = v.states.first();
        let texts: [&str; 15] = [
            &origin.file,
            &origin.file_sha256,
            &origin.sidecar_sha256,
            &origin.baseline_sha256,
            env!("CARGO_PKG_VERSION"),
            &v.stage,
            &v.channel,
            &v.unit,
            v.machine.code(),
            v.instrument.code(),
            v.reason.code(),
            &v.cell,
            v.state_fit.code(),
            nearest.map_or("", |state| &*state.name),
            &v.doubts,
        ];
        for (builder, text) in self.texts.iter_mut().zip(texts) {
            builder.append_value(text);
        }
        self.window.append_value(v.window);
        self.t0_ns.append_value(v.t0);
        self.first_sample_index.append_value(v.first_sample_index);
        self.resolvable.append_value(v.resolvable);
        let probability = nearest.map_or(f64::NAN, |state| state.probability);
        let speed = v.input_speed_hz;
        let numbers = [probability, sample_rate_hz, speed.value, speed.sigma, v.mesh_hz, v.brake_torque_nm];
        for (builder, value) in self.numbers.iter_mut().zip(numbers) {
            number(builder, value);
        }
        for (i, h) in v.harmonics.iter().enumerate() {
            self.ranks[i].append_value(h.rank.code());
            self.levels[i].append_value(h.rank.level());
            let (d, a) = (h.deviation_percent, h.amplitude);
            let values = [d.value, d.sigma, a.value, a.sigma, h.floor, h.baseline, h.rank_probability];
            for (builder, value) in self.harmonics[i].iter_mut().zip(values) {
                number(builder, value);
            }
        }
        for (builder, value) in self.indicators.0.iter_mut().zip(indicator_values(v)) {
            number(builder, value);
        }
        self.len += 1;
    }

    /// Takes the rows out as a batch; afterwards there are none.
    ///
    /// # Errors
    /// Never for rows that came in by [`Self::push`]; the type is that of the library.
    pub fn take(&mut self) -> Result<RecordBatch, ArrowError> {
        self.len = 0;
        let mut columns: Vec<ArrayRef> = Vec::with_capacity(schema().fields().len());
        // In the order of `schema`: seven texts, three counts, eight texts, and so on.
        let (identity, states) = self.texts.split_at_mut(7);
        columns.extend(identity.iter_mut().map(|b| Arc::new(b.finish()) as ArrayRef));
        columns.push(Arc::new(self.window.finish()));
        columns.push(Arc::new(self.t0_ns.finish()));
        columns.push(Arc::new(self.first_sample_index.finish()));
        columns.extend(states.iter_mut().map(|b| Arc::new(b.finish()) as ArrayRef));
        columns.push(Arc::new(self.resolvable.finish()));
        columns.extend(self.numbers.iter_mut().map(|b| Arc::new(b.finish()) as ArrayRef));
        for i in 0..HARMONICS {
            columns.push(Arc::new(self.ranks[i].finish()));
            columns.push(Arc::new(self.levels[i].finish()));
            columns.extend(self.harmonics[i].iter_mut().map(|b| Arc::new(b.finish()) as ArrayRef));
        }
        columns.extend(self.indicators.0.iter_mut().map(|b| Arc::new(b.finish()) as ArrayRef));
        RecordBatch::try_new(schema(), columns)
    }
}
