//! A verdict as one flat JSON object, written and read by the table of fields.

use std::fmt;

use serde::de::{self, Deserialize, Deserializer, IgnoredAny, MapAccess, Visitor};
use serde::ser::{Serialize, SerializeMap, Serializer};

use crate::verdict::{Datum, FIELDS, Verdict, field, published};

/// The flat JSON object of stdout and of the topics `/gear/…/rank`: scalars only, so that any
/// viewer can plot each field. Numbers that are not known are `null`.
impl Serialize for Verdict {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        for field in FIELDS.iter() {
            let name = field.name.as_str();
            match field.read(self) {
                Datum::Text(text) => map.serialize_entry(name, text)?,
                Datum::Count(x) => map.serialize_entry(name, &x)?,
                Datum::Integer(x) => map.serialize_entry(name, &x)?,
                Datum::Flag(x) => map.serialize_entry(name, &x)?,
                Datum::Number(x) => map.serialize_entry(name, &published(x))?,
                Datum::Absent => {}
            }
        }
        map.end()
    }
}

/// Without these an object is no verdict.
const REQUIRED: [&str; 4] = ["stage", "channel", "machine", "instrument"];

/// Reads what [`Serialize`] writes. Other keys are passed over (the service adds `bench`, brokers
/// add more); a field that an older version did not write stays unknown. A code that this version
/// does not know is an error.
impl<'de> Deserialize<'de> for Verdict {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_map(Object)
    }
}

struct Object;

impl<'de> Visitor<'de> for Object {
    type Value = Verdict;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a verdict")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Verdict, A::Error> {
        let mut verdict = Verdict::blank();
        let mut seen = [false; REQUIRED.len()];
        while let Some(name) = map.next_key::<String>()? {
            let Some(field) = field(&name) else {
                map.next_value::<IgnoredAny>()?;
                continue;
            };
            let scalar: Scalar = map.next_value()?;
            if !field.write(&mut verdict, &scalar.datum()) {
                return Err(de::Error::custom(format!("{name}: {scalar:?}; expected {}", field.expected())));
            }
            if let Some(i) = REQUIRED.iter().position(|&required| required == name) {
                seen[i] = true;
            }
        }
        match seen.iter().position(|&seen| !seen) {
            Some(missing) => Err(de::Error::missing_field(REQUIRED[missing])),
            None => Ok(verdict),
        }
    }
}

#[derive(Debug)]
enum Scalar {
    Text(String),
    Count(u64),
    Integer(i64),
    Flag(bool),
    Number(f64),
}

impl Scalar {
    fn datum(&self) -> Datum<'_> {
        match *self {
            Self::Text(ref text) => Datum::Text(text),
            Self::Count(x) => Datum::Count(x),
            Self::Integer(x) => Datum::Integer(x),
            Self::Flag(x) => Datum::Flag(x),
            Self::Number(x) => Datum::Number(x),
        }
    }
}

impl<'de> Deserialize<'de> for Scalar {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct One;
        impl Visitor<'_> for One {
            type Value = Scalar;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a text, a number, true, false or null")
            }

            fn visit_str<E: de::Error>(self, x: &str) -> Result<Scalar, E> {
                Ok(Scalar::Text(x.to_owned()))
            }

            fn visit_u64<E: de::Error>(self, x: u64) -> Result<Scalar, E> {
                Ok(Scalar::Count(x))
            }

            fn visit_i64<E: de::Error>(self, x: i64) -> Result<Scalar, E> {
                Ok(Scalar::Integer(x))
            }

            fn visit_bool<E: de::Error>(self, x: bool) -> Result<Scalar, E> {
                Ok(Scalar::Flag(x))
            }

            fn visit_f64<E: de::Error>(self, x: f64) -> Result<Scalar, E> {
                Ok(Scalar::Number(x))
            }

            fn visit_unit<E: de::Error>(self) -> Result<Scalar, E> {
                Ok(Scalar::Number(f64::NAN))
            }
        }
        deserializer.deserialize_any(One)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verdict::{
        Code, Holds, InstrumentState, MachineState, NearState, Rank, Reason, StageIndicators, StateFit,
    };

    /// A number for every field, no two alike; `known` of each is finite.
    fn filled(known: bool) -> Verdict {
        let mut verdict = Verdict::blank();
        verdict.indicators = Some(StageIndicators::UNKNOWN);
        verdict.states = vec![NearState { name: "".into(), probability: 0.0, goodness: 0.0 }; 3];
        for (i, field) in FIELDS.iter().enumerate() {
            let text = format!("text {i}");
            let datum = match field.holds {
                Holds::Text if field.name == "shared" => Datum::Text("2x 5x"),
                Holds::Text => Datum::Text(&text),
                Holds::Code(codes) => Datum::Text(codes()[i % codes().len()].0),
                Holds::Time => Datum::Integer(-1_795_228_800_000_000_123),
                Holds::Count => Datum::Count(i as u64),
                Holds::Level => continue,
                Holds::Flag => Datum::Flag(true),
                Holds::Number => Datum::Number(if known { 0.5 * i as f64 } else { f64::NAN }),
            };
            assert!(field.write(&mut verdict, &datum), "{} takes {datum:?}", field.name);
        }
        verdict
    }

    /// Written, read and written again: the same bytes, whatever is known.
    #[test]
    fn conform_a_verdict_is_read_as_it_was_written() {
        for verdict in [filled(true), filled(false)] {
            let line = serde_json::to_string(&verdict).unwrap();
            let again: Verdict = serde_json::from_str(&line).unwrap();
            assert_eq!(serde_json::to_string(&again).unwrap(), line);
        }
        let verdict = filled(true);
        let again: Verdict = serde_json::from_str(&serde_json::to_string(&verdict).unwrap()).unwrap();
        // Nine digits are written, and all numbers here have fewer.
        assert_eq!(format!("{again:?}"), format!("{verdict:?}"));
    }

    #[test]
    fn conform_names_are_given_once() {
        let mut names: Vec<_> = FIELDS.iter().map(|field| field.name.as_str()).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), FIELDS.len());
        assert!(REQUIRED.iter().all(|name| field(name).is_some()));
    }

    #[test]
    fn conform_codes_come_back() {
        fn of<C: Code + std::fmt::Debug>() {
            for &code in C::ALL {
                assert_eq!(C::of_code(Code::code(code)), Some(code));
                assert!(code.meaning().ends_with(['.', '%']), "{code:?}: {}", code.meaning());
            }
        }
        of::<Rank>();
        of::<MachineState>();
        of::<InstrumentState>();
        of::<Reason>();
        of::<StateFit>();
    }

    /// What is missing or not understood is never read as good.
    #[test]
    fn conform_what_is_no_verdict_is_refused() {
        let refused = |text: &str, why: &str| {
            let error = serde_json::from_str::<Verdict>(text).unwrap_err().to_string();
            assert!(error.contains(why), "{error}");
        };
        let rest = "\"stage\":\"s\",\"channel\":\"c\",\"machine\":\"normal\"";
        refused(&format!("{{{rest}}}"), "missing field `instrument`");
        refused(&format!("{{{rest},\"instrument\":\"fine\"}}"), "instrument: Text(\"fine\"); expected one of \"ok\"");
        refused(
            &format!("{{{rest},\"instrument\":\"ok\",\"window\":-1}}"),
            "window: Integer(-1); expected a whole number from 0",
        );
        refused(&format!("{{{rest},\"instrument\":\"ok\",\"level_1x\":7}}"), "level_1x");
        refused("[]", "a verdict");
        let old: Verdict = serde_json::from_str(&format!("{{\"bench\":\"b\",{rest},\"instrument\":\"ok\"}}")).unwrap();
        assert!(old.harmonics.iter().all(|h| h.rank == Rank::Unknown) && old.mesh_hz.is_nan());
    }
}
