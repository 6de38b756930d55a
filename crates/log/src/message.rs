//! Records as MCAP messages: topic, schema, encoding, time and payload.

use std::sync::LazyLock;

use gearwatch_core::block::UnixNanos;
use gearwatch_core::verdict::{FIELDS, Holds};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use crate::record::{Note, Record};
use crate::spectrum::SpectrumFrame;

/// Topic of the record that opens every chunk.
pub const GROUP_TOPIC: &str = "/log/group";
/// Topic of gap records.
pub const GAP_TOPIC: &str = "/gap";
/// Topic of clock records.
pub const CLOCK_TOPIC: &str = "/clock";
/// Topic of alarms and acknowledgements.
pub const ALARM_TOPIC: &str = "/alarm";
/// Topic of notes.
pub const NOTE_TOPIC: &str = "/log";

/// How the payload of a topic is to be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Schema {
    /// Its name.
    pub name: String,
    /// `jsonschema` or `protobuf`.
    pub encoding: &'static str,
    /// The schema itself.
    pub data: Vec<u8>,
}

impl Schema {
    /// Encoding of the messages that go with it.
    pub fn message_encoding(&self) -> &'static str {
        if self.encoding == "protobuf" { "protobuf" } else { "json" }
    }
}

/// One message, ready to be written.
#[derive(Clone, Debug)]
pub struct Message {
    /// Topic of its channel.
    pub topic: String,
    /// How the payload is to be read.
    pub schema: &'static Schema,
    /// 0 for raw data.
    pub seq: u64,
    /// Time of what it tells (ns since the epoch).
    pub log_time: u64,
    /// When it was written (ns since the epoch).
    pub publish_time: u64,
    /// Payload.
    pub data: Vec<u8>,
}

/// The record that opens every chunk: what the chunk must hold, so that a reader notices when a
/// chunk or a part of one is missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Group {
    /// Counts the groups of the log, over all its files and starts of the service, without a hole.
    pub group: u64,
    /// Sequence number of the first result in it; one more than `seq_last` where there is none.
    pub seq_first: u64,
    /// Sequence number of the last result so far.
    pub seq_last: u64,
    /// At most so many results were on their way when this was written: what a crash can take.
    pub unwritten_max: u64,
    /// Messages in the chunk besides this one.
    pub messages: u64,
    /// Wall clock when it was written (ns since the epoch).
    pub wall_ns: UnixNanos,
    /// Monotonic clock when it was written (ns since the start of the service).
    pub mono_ns: u64,
    /// The log was closed in good order after this group.
    pub end: bool,
}

impl Group {
    pub(crate) fn message(&self) -> Message {
        let time = unsigned(self.wall_ns);
        Message {
            topic: GROUP_TOPIC.into(),
            schema: &GROUP_SCHEMA,
            seq: 0,
            log_time: time,
            publish_time: time,
            data: json_bytes(self),
        }
    }
}

/// The message of a record; `None` for a context, which is no message, and for what cannot be put
/// into a recording.
pub fn encode(seq: u64, record: &Record, now_ns: UnixNanos) -> Option<Message> {
    let (topic, schema, log_ns, data): (String, &'static Schema, UnixNanos, Vec<u8>) = match record {
        Record::Verdict { bench, verdict, line } => {
            let topic = format!("/gear/{}{}/rank", part_of(bench.as_deref()), verdict.stage);
            (topic, &*VERDICT_SCHEMA, verdict.t0, line.as_bytes().to_vec())
        }
        Record::Gap(gap) => (GAP_TOPIC.into(), &*GAP_SCHEMA, gap.t_ns, json_bytes(gap)),
        Record::Clock(clock) => (CLOCK_TOPIC.into(), &*CLOCK_SCHEMA, clock.wall_ns, json_bytes(clock)),
        Record::Note(note) => (NOTE_TOPIC.into(), &*NOTE_SCHEMA, note.t_ns, json_bytes(&foxglove_log(note))),
        Record::Spectrum(frame) => {
            let bench = part_of(frame.several.then_some(frame.bench.as_str()));
            let topic = format!("/spectrum/{bench}{}", frame.channel);
            (topic, &*SPECTRUM_SCHEMA, frame.t0_ns, json_bytes(&Spectrum::of(frame)))
        }
        Record::Alarm(alarm) => {
            let when = alarm.alarm.t_ns.max(alarm.acknowledged_ns);
            (ALARM_TOPIC.into(), &*ALARM_SCHEMA, when, json_bytes(&**alarm))
        }
        Record::Raw(packet) => return crate::raw::encode(packet, now_ns),
        Record::Context(_) => return None,
    };
    Some(Message { topic, schema, seq, log_time: unsigned(log_ns), publish_time: unsigned(now_ns), data })
}

/// The part of a topic that names a bench: nothing where the log has one bench only.
fn part_of(bench: Option<&str>) -> String {
    bench.map_or_else(String::new, |bench| format!("{bench}/"))
}

/// A recording has no place for times before 1970; such a clock is wrong anyway, and the payload
/// still holds what it said.
pub(crate) fn unsigned(time: UnixNanos) -> u64 {
    u64::try_from(time).unwrap_or(0)
}

/// Serialising plain data to memory has no way to fail.
fn json_bytes(value: &impl Serialize) -> Vec<u8> {
    serde_json::to_vec(value).unwrap_or_default()
}

fn foxglove_log(note: &Note) -> Value {
    let time = unsigned(note.t_ns);
    json!({
        "timestamp": { "sec": time / 1_000_000_000, "nsec": time % 1_000_000_000 },
        "level": note.level as u8,
        "message": note.message,
        "name": note.name,
        "file": "",
        "line": 0,
    })
}

/// An order spectrum as viewers draw it: orders beside amplitudes.
#[derive(Serialize)]
struct Spectrum<'a> {
    bench: &'a str,
    channel: &'a str,
    unit: &'a str,
    t0_ns: UnixNanos,
    order: Vec<f64>,
    amplitude: &'a [f32],
}

impl<'a> Spectrum<'a> {
    fn of(frame: &'a SpectrumFrame) -> Self {
        let order = |line: usize| (1e6 * (frame.first_order + line as f64 * frame.order_step)).round() / 1e6;
        Self {
            bench: &frame.bench,
            channel: &frame.channel,
            unit: &frame.unit,
            t0_ns: frame.t0_ns,
            order: (0..frame.amplitude.len()).map(order).collect(),
            amplitude: &frame.amplitude,
        }
    }
}

static SPECTRUM_SCHEMA: LazyLock<Schema> = LazyLock::new(|| {
    let spectrum = Spectrum { bench: "", channel: "", unit: "", t0_ns: 1, order: vec![0.5], amplitude: &[0.5] };
    schema_of("gearwatch.OrderSpectrum", &spectrum)
});
static VERDICT_SCHEMA: LazyLock<Schema> = LazyLock::new(|| Schema {
    name: "gearwatch.Verdict".into(),
    encoding: "jsonschema",
    data: json_bytes(&verdict_schema()),
});
static GROUP_SCHEMA: LazyLock<Schema> = LazyLock::new(|| {
    let group = Group {
        group: 1,
        seq_first: 1,
        seq_last: 1,
        unwritten_max: 1,
        messages: 1,
        wall_ns: 1,
        mono_ns: 1,
        end: false,
    };
    schema_of("gearwatch.LogGroup", &group)
});
static GAP_SCHEMA: LazyLock<Schema> = LazyLock::new(|| {
    let cause = crate::record::Cause::UncleanEnd;
    let gap = crate::record::Gap { channel: String::new(), first: 1, last: 1, count: 1, cause, t_ns: 1 };
    schema_of("gearwatch.Gap", &gap)
});
static CLOCK_SCHEMA: LazyLock<Schema> = LazyLock::new(|| {
    let boot_id = String::new();
    let clock = crate::record::Clock { wall_ns: 1, mono_ns: 1, clock_epoch: 1, step_ns: 1, boot_id };
    schema_of("gearwatch.Clock", &clock)
});
static ALARM_SCHEMA: LazyLock<Schema> = LazyLock::new(|| {
    let alarm = gearwatch_alarm::Alarm {
        id: String::new(),
        stage: String::new(),
        channel: String::new(),
        severity: gearwatch_alarm::Severity::Warning,
        since_ns: 1,
        t_ns: 1,
        active: true,
        acknowledged: false,
        over: false,
        evidence: Some(Box::new(gearwatch_alarm::Evidence {
            harmonic: 1,
            amplitude: 0.5,
            unit: String::new(),
            baseline: Some(0.5),
            deviation_percent: 0.5,
            deviation_sigma_percent: 0.5,
            limit_percent: Some(0.5),
            rank: String::new(),
            window: 1,
            input_speed_hz: Some(0.5),
            mesh_hz: Some(0.5),
            brake_torque_nm: Some(0.5),
        })),
        seen: Some(Box::new(gearwatch_alarm::Acknowledgement { until_ns: Some(1), ..Default::default() })),
        group: Some(Box::new(gearwatch_alarm::Group {
            channels: vec![String::new()],
            severity: gearwatch_alarm::Severity::Warning,
            news: true,
        })),
    };
    schema_of("gearwatch.Alarm", &crate::record::AlarmRecord::new("", &alarm, None))
});
static NOTE_SCHEMA: LazyLock<Schema> = LazyLock::new(|| {
    let note = Note { t_ns: 1, level: crate::record::Level::Info, name: String::new(), message: String::new() };
    schema_of("foxglove.Log", &foxglove_log(&note))
});

/// The schema that a topic of the log always has, for a file whose schema records are damaged.
pub(crate) fn schema_for_topic(topic: &str) -> Option<&'static Schema> {
    match topic {
        GROUP_TOPIC => Some(&GROUP_SCHEMA),
        GAP_TOPIC => Some(&GAP_SCHEMA),
        CLOCK_TOPIC => Some(&CLOCK_SCHEMA),
        NOTE_TOPIC => Some(&NOTE_SCHEMA),
        ALARM_TOPIC => Some(&ALARM_SCHEMA),
        _ if topic.starts_with("/spectrum/") => Some(&SPECTRUM_SCHEMA),
        _ if topic.starts_with("/gear/") && topic.ends_with("/rank") => Some(&VERDICT_SCHEMA),
        _ => crate::raw::schema_for_topic(topic),
    }
}

/// The JSON schema of a verdict, by the table of its fields. A number that is not known is written
/// as `null`; viewers want one type per field, so the schema says `number`.
pub fn verdict_schema() -> Value {
    let property = |field: &gearwatch_core::verdict::Field| {
        let mut property = json!({ "type": match field.holds {
            Holds::Text | Holds::Code(_) => "string",
            Holds::Time | Holds::Count | Holds::Level => "integer",
            Holds::Flag => "boolean",
            Holds::Number => "number",
        }});
        let unit = match field.unit {
            "" => String::new(),
            "channel" => " (unit of the channel, field unit)".into(),
            unit => format!(" ({unit})"),
        };
        property["description"] = json!(format!("{}{unit}", field.meaning));
        if let Holds::Code(codes) = field.holds {
            property["enum"] = codes().iter().map(|(code, _)| json!(code)).collect();
        }
        (field.name.clone(), property)
    };
    let properties: Map<String, Value> = FIELDS.iter().map(property).collect();
    json!({ "type": "object", "properties": properties, "title": "gearwatch.Verdict" })
}

/// The JSON schema of an object, from an example of it: so a field that joins the object joins the
/// schema too.
fn schema_of(name: &str, example: &impl Serialize) -> Schema {
    let value = serde_json::to_value(example).unwrap_or_default();
    let mut root = type_of(&value);
    if let Some(object) = root.as_object_mut() {
        object.insert("title".into(), name.into());
    }
    Schema { name: name.into(), encoding: "jsonschema", data: json_bytes(&root) }
}

fn type_of(value: &Value) -> Value {
    match value {
        Value::Object(fields) => {
            let properties: Map<String, Value> = fields.iter().map(|(k, v)| (k.clone(), type_of(v))).collect();
            json!({ "type": "object", "properties": properties })
        }
        Value::String(_) => json!({ "type": "string" }),
        Value::Bool(_) => json!({ "type": "boolean" }),
        Value::Number(number) if number.is_u64() || number.is_i64() => json!({ "type": "integer" }),
        Value::Number(_) => json!({ "type": "number" }),
        Value::Array(items) => json!({ "type": "array", "items": items.first().map(type_of) }),
        Value::Null => json!({}),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A schema that a reader takes for the whole truth: every line of a verdict fits it.
    #[test]
    fn conform_every_field_of_a_verdict_has_a_type_in_the_schema() {
        let schema: Value = serde_json::from_slice(&VERDICT_SCHEMA.data).unwrap();
        for field in FIELDS.iter() {
            let property = &schema["properties"][&field.name];
            assert!(property["type"].is_string() && property["description"].is_string(), "{}", field.name);
        }
        assert_eq!(schema["properties"]["dev_1x_percent"]["type"], "number");
        assert_eq!(schema["properties"]["window"]["type"], "integer");
        assert_eq!(schema["properties"]["rank_1x"]["type"], "string");
        assert_eq!(schema["properties"]["machine"]["enum"][3], "alarm");
    }
}
