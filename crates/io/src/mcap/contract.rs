//! The recording contract, protobuf package `gearwatch.v1`: messages, and the schema that travels
//! with every file.
//!
//! Field numbers are fixed. A later version adds fields and never renumbers one.

use prost::Message;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet, Timestamp};

/// Profile in the header of a recording.
pub const PROFILE: &str = "gearwatch";
/// Library in the header of a log of the service begins so.
pub const LOG_LIBRARY: &str = "gearwatch-log ";
/// Message and schema encoding.
pub const PROTOBUF: &str = "protobuf";
/// Schema of `/vib/<sensor>`.
pub const VIBRATION_SCHEMA: &str = "gearwatch.v1.VibrationBlock";
/// Schema of `/tacho/<shaft>`.
pub const TACHO_SCHEMA: &str = "gearwatch.v1.TachoBlock";
/// Schema of [`OPERATING_POINT_TOPIC`].
pub const OPERATING_POINT_SCHEMA: &str = "gearwatch.v1.OperatingPoint";
/// Topics of sensors begin so.
pub const VIBRATION_PREFIX: &str = "/vib/";
/// Topics of tachometers begin so.
pub const TACHO_PREFIX: &str = "/tacho/";
/// Topic of the operating point.
pub const OPERATING_POINT_TOPIC: &str = "/operating_point";

/// Consecutive samples of one sensor.
#[derive(Clone, PartialEq, Message)]
pub struct VibrationBlock {
    /// Time of the first sample.
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    /// Samples per second.
    #[prost(double, tag = "2")]
    pub sample_rate_hz: f64,
    /// Counts every sample that the source produced since it started.
    #[prost(uint64, tag = "3")]
    pub first_sample_index: u64,
    /// `m/s^2`, `g`, `mm/s`, `V` or `1`.
    #[prost(string, tag = "4")]
    pub unit: String,
    /// physical = counts × scale + offset.
    #[prost(double, tag = "5")]
    pub scale: f64,
    /// physical = counts × scale + offset.
    #[prost(double, tag = "6")]
    pub offset: f64,
    /// Raw converter counts; either this or `samples`.
    #[prost(sint32, repeated, tag = "7")]
    pub counts: Vec<i32>,
    /// Physical values.
    #[prost(float, repeated, tag = "8")]
    pub samples: Vec<f32>,
    /// Bits of [`gearwatch_core::block::Quality`].
    #[prost(uint32, tag = "9")]
    pub quality: u32,
}

/// Rising edges of one tachometer or encoder.
#[derive(Clone, PartialEq, Message)]
pub struct TachoBlock {
    /// Start of the block.
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    /// Pulses per revolution of the shaft.
    #[prost(double, tag = "2")]
    pub pulses_per_rev: f64,
    /// Absolute time of each rising edge (ns since the epoch).
    #[prost(fixed64, repeated, tag = "3")]
    pub pulse_time_ns: Vec<u64>,
    /// Bits of [`gearwatch_core::block::Quality`].
    #[prost(uint32, tag = "4")]
    pub quality: u32,
}

/// What is known of the operating point.
#[derive(Clone, PartialEq, Message)]
pub struct OperatingPoint {
    /// When it was read.
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    /// 0 where unknown (Hz).
    #[prost(double, tag = "2")]
    pub motor_speed_hz: f64,
    /// At the brake; 0 where unknown (N m).
    #[prost(double, tag = "3")]
    pub brake_torque_nm: f64,
    /// NaN where unknown (°C).
    #[prost(double, tag = "4")]
    pub temperature_c: f64,
}

/// The serialised `FileDescriptorSet` of the three messages with their import: the schema data of
/// every channel.
pub fn descriptor_set() -> Vec<u8> {
    const STAMP: &str = ".google.protobuf.Timestamp";
    let timestamp = FileDescriptorProto {
        name: Some("google/protobuf/timestamp.proto".into()),
        package: Some("google.protobuf".into()),
        message_type: vec![message(
            "Timestamp",
            &[("seconds", Type::Int64, Label::Optional, ""), ("nanos", Type::Int32, Label::Optional, "")],
        )],
        syntax: Some("proto3".into()),
        ..FileDescriptorProto::default()
    };
    let (one, many) = (Label::Optional, Label::Repeated);
    let recording = FileDescriptorProto {
        name: Some("gearwatch/v1/recording.proto".into()),
        package: Some("gearwatch.v1".into()),
        dependency: vec!["google/protobuf/timestamp.proto".into()],
        message_type: vec![
            message(
                "VibrationBlock",
                &[
                    ("timestamp", Type::Message, one, STAMP),
                    ("sample_rate_hz", Type::Double, one, ""),
                    ("first_sample_index", Type::Uint64, one, ""),
                    ("unit", Type::String, one, ""),
                    ("scale", Type::Double, one, ""),
                    ("offset", Type::Double, one, ""),
                    ("counts", Type::Sint32, many, ""),
                    ("samples", Type::Float, many, ""),
                    ("quality", Type::Uint32, one, ""),
                ],
            ),
            message(
                "TachoBlock",
                &[
                    ("timestamp", Type::Message, one, STAMP),
                    ("pulses_per_rev", Type::Double, one, ""),
                    ("pulse_time_ns", Type::Fixed64, many, ""),
                    ("quality", Type::Uint32, one, ""),
                ],
            ),
            message(
                "OperatingPoint",
                &[
                    ("timestamp", Type::Message, one, STAMP),
                    ("motor_speed_hz", Type::Double, one, ""),
                    ("brake_torque_nm", Type::Double, one, ""),
                    ("temperature_c", Type::Double, one, ""),
                ],
            ),
        ],
        syntax: Some("proto3".into()),
        ..FileDescriptorProto::default()
    };
    FileDescriptorSet { file: vec![timestamp, recording] }.encode_to_vec()
}

/// A message descriptor with fields numbered from 1 in order. In proto3 repeated numbers are packed
/// by default.
fn message(name: &str, fields: &[(&str, Type, Label, &str)]) -> DescriptorProto {
    DescriptorProto {
        name: Some(name.into()),
        field: fields
            .iter()
            .zip(1..)
            .map(|(&(name, kind, label, type_name), number)| FieldDescriptorProto {
                name: Some(name.into()),
                number: Some(number),
                label: Some(label.into()),
                r#type: Some(kind.into()),
                type_name: (!type_name.is_empty()).then(|| type_name.to_owned()),
                ..FieldDescriptorProto::default()
            })
            .collect(),
        ..DescriptorProto::default()
    }
}
