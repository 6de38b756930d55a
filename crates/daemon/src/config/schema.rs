//! JSON schema of the configuration, for editors and for `gearwatch config schema`.

use gearwatch_runtime::kinds::Kind;
use gearwatch_runtime::queue::WhenFull;
use gearwatch_sources::{DATA_DEADLINE_SECS, KINDS};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde_json::{Map, Value, json};

use super::File;
use crate::sink;

/// JSON schema (draft 2020-12) of the configuration file.
pub fn schema() -> Value {
    SchemaGenerator::default().into_root_schema_for::<File>().to_value()
}

/// Stands for a source of any kind.
pub(super) struct SourceKeys;

impl JsonSchema for SourceKeys {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Source".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let common = [
            ("name", json!({ "type": "string", "description": "Unique within its bench; the kind where left out." })),
            (
                "data_deadline_secs",
                json!({ "type": "number", "exclusiveMinimum": 0, "default": DATA_DEADLINE_SECS,
                        "description": "Without a packet for so long a live source counts as silent (s)." }),
            ),
        ];
        one_of(KINDS, &common, generator)
    }
}

/// Stands for a sink of any kind.
pub(super) struct SinkKeys;

impl JsonSchema for SinkKeys {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Sink".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let when_full = generator.subschema_for::<WhenFull>().to_value();
        let common = [
            ("name", json!({ "type": "string", "description": "Unique; the kind where left out." })),
            (
                "queue",
                json!({ "type": "integer", "minimum": 1, "maximum": 1 << 20, "default": super::entry::SINK_QUEUE,
                        "description": "Events that may wait for it." }),
            ),
            ("when_full", when_full),
        ];
        one_of(sink::KINDS, &common, generator)
    }
}

/// A table of one of the kinds: its own keys beside `kind` and the common ones.
fn one_of<C: ?Sized>(kinds: &[Kind<C>], common: &[(&str, Value)], generator: &mut SchemaGenerator) -> Schema {
    let alternatives: Vec<Value> = kinds
        .iter()
        .map(|kind| {
            let mut own = kind.schema(generator).to_value();
            let Some(object) = own.as_object_mut() else { return own };
            object.insert("description".to_owned(), json!(kind.help));
            let properties = object.entry("properties").or_insert_with(|| Value::Object(Map::new()));
            if let Some(properties) = properties.as_object_mut() {
                properties.insert("kind".to_owned(), json!({ "const": kind.name }));
                for (name, value) in common {
                    properties.insert((*name).to_owned(), value.clone());
                }
            }
            let required = object.entry("required").or_insert_with(|| json!([]));
            if let Some(required) = required.as_array_mut() {
                required.insert(0, json!("kind"));
            }
            own
        })
        .collect();
    json_schema!({ "oneOf": alternatives })
}
