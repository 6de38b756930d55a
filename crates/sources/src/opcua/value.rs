//! What a server sends of a node becomes a physical value.

use opcua_types::{DataValue, StatusCode, Variant};

use crate::readings::Linear;

/// Characters of a text that a message shows.
const SHOWN: usize = 40;

/// What a node held last.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Held {
    /// A value (Hz, N m or °C) that is good or uncertain.
    Number { value: f64, status: StatusCode },
    /// There is no value now, and why.
    Nothing(String),
    /// The node holds something else than a number, and what.
    NoNumber(String),
}

impl Held {
    /// Reads a value; a status that is missing means good (OPC 10000-4, 7.11).
    pub(super) fn read(data: &DataValue, linear: Linear) -> Self {
        let status = data.status.unwrap_or(StatusCode::Good);
        if status.is_bad() {
            return Self::Nothing(format!("the server gives it the status {status}"));
        }
        let number = match &data.value {
            Some(Variant::Double(v)) => *v,
            Some(Variant::Float(v)) => f64::from(*v),
            Some(Variant::SByte(v)) => f64::from(*v),
            Some(Variant::Byte(v)) => f64::from(*v),
            Some(Variant::Int16(v)) => f64::from(*v),
            Some(Variant::UInt16(v)) => f64::from(*v),
            Some(Variant::Int32(v)) => f64::from(*v),
            Some(Variant::UInt32(v)) => f64::from(*v),
            Some(Variant::Int64(v)) => *v as f64,
            Some(Variant::UInt64(v)) => *v as f64,
            Some(Variant::Empty) | None => return Self::Nothing("it has no value".to_owned()),
            Some(other) => return Self::NoNumber(describe(other)),
        };
        let value = linear.of(number);
        if value.is_finite() {
            Self::Number { value, status }
        } else {
            Self::Nothing(format!("its value is {number}, which is not finite"))
        }
    }
}

/// Type and content, in short.
fn describe(value: &Variant) -> String {
    match value {
        Variant::Boolean(v) => format!("the Boolean {v}"),
        Variant::String(text) => format!("the text {:?}", text.as_ref().chars().take(SHOWN).collect::<String>()),
        Variant::Array(array) => format!("an array of {} values", array.values.len()),
        other => format!("a value of type {:?}", other.type_id()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn held(value: impl Into<Variant>, status: Option<StatusCode>) -> Held {
        let data = DataValue { value: Some(value.into()), status, ..DataValue::default() };
        Held::read(&data, Linear { scale: 0.5, offset: 1.0 })
    }

    #[test]
    fn analytic_numbers_of_every_type_become_physical_values() {
        let good = |value| Held::Number { value, status: StatusCode::Good };
        assert_eq!(held(20.5_f64, None), good(11.25));
        assert_eq!(held(20.5_f32, Some(StatusCode::Good)), good(11.25));
        assert_eq!(held(-2_i8, None), good(0.0));
        assert_eq!(held(255_u8, None), good(128.5));
        assert_eq!(held(i16::MIN, None), good(-16_383.0));
        assert_eq!(held(u16::MAX, None), good(32_768.5));
        assert_eq!(held(-2_i32, None), good(0.0));
        assert_eq!(held(4_u32, None), good(3.0));
        assert_eq!(held(-4_i64, None), good(-1.0));
        assert_eq!(held(4_u64, None), good(3.0));
    }

    #[test]
    fn conform_what_is_bad_or_no_number_is_not_taken() {
        let bad = held(1.0_f64, Some(StatusCode::BadSensorFailure));
        assert_eq!(bad, Held::Nothing("the server gives it the status BadSensorFailure".to_owned()));
        let uncertain = Some(StatusCode::UncertainLastUsableValue);
        assert!(matches!(held(1.0_f64, uncertain), Held::Number { status, .. } if status.is_uncertain()));
        assert!(matches!(held(f64::NAN, None), Held::Nothing(why) if why.contains("NaN")));
        assert!(matches!(held(f64::MAX, None), Held::Number { .. }));
        assert_eq!(
            Held::read(&DataValue::default(), Linear { scale: 1.0, offset: 0.0 }),
            Held::Nothing("it has no value".to_owned())
        );
        assert_eq!(held(true, None), Held::NoNumber("the Boolean true".to_owned()));
        let long = "x".repeat(1000);
        assert_eq!(held(long.as_str(), None), Held::NoNumber(format!("the text {:?}", "x".repeat(SHOWN))));
        assert_eq!(held(vec![1.0_f64, 2.0], None), Held::NoNumber("an array of 2 values".to_owned()));
    }
}
