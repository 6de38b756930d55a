//! ROS 2 messages: a `ros2msg` definition is compiled to the few values that are wanted, which are
//! then picked out of the CDR bytes of each message.
//!
//! CDR frames nothing: a struct is its members one after the other, each aligned to its own size,
//! counted from behind the four bytes that name the byte order. So a definition becomes a flat list
//! of steps.

use std::collections::BTreeMap;

use crate::problem::Problem;

/// Levels of nesting, and steps of a compiled message; real messages stay far below both.
const DEEPEST: usize = 16;
const MOST_STEPS: usize = 10_000;

/// A picker of values from messages of one type.
#[derive(Clone, Debug)]
pub struct Picker {
    steps: Vec<Step>,
    wanted: usize,
}

#[derive(Clone, Debug)]
enum Step {
    /// `count` numbers, passed over.
    Skip { size: usize, count: usize },
    /// One number for this slot.
    Pick { number: Number, slot: usize },
    /// Length and that many bytes.
    Text,
    /// Length and that many times these steps.
    Sequence(Vec<Step>),
}

#[derive(Clone, Copy, Debug)]
enum Number {
    I32,
    U32,
    F32,
    F64,
}

/// One member of a type.
#[derive(Clone, Debug)]
struct Member {
    name: String,
    kind: String,
    count: Count,
}

#[derive(Clone, Copy, Debug)]
enum Count {
    One,
    Fixed(usize),
    Variable,
}

type Types = BTreeMap<String, Vec<Member>>;

impl Picker {
    /// A picker of the members `wanted` (such as `header.stamp.sec`) of the first member of type
    /// `inner` (such as `sensor_msgs/Imu`) in the message type `name`, or of the message itself if
    /// it has that type. `None` where the message has no such member outside of lists.
    ///
    /// # Errors
    /// When the definition cannot be understood, or lacks a wanted member.
    pub fn compile(name: &str, definition: &str, inner: &str, wanted: &[&str]) -> Result<Option<Self>, Problem> {
        let types = parse(name, definition)?;
        let root = short_name(name);
        let Some(prefix) = find(&types, &root, inner, 0) else { return Ok(None) };
        let wanted: Vec<String> = wanted.iter().map(|w| format!("{prefix}{w}")).collect();
        let mut compiler = Compiler { types: &types, wanted: &wanted, found: vec![false; wanted.len()], steps: 0 };
        let mut steps = Vec::new();
        compiler.members(&root, "", 0, false, &mut steps)?;
        if let Some(missing) = compiler.found.iter().position(|found| !found) {
            return Err(Problem::damaged(
                format_args!("the definition of {name}"),
                format_args!("a number {}", wanted[missing]),
                "none",
            ));
        }
        // What stands behind the last wanted value need not be read.
        let last = steps.iter().rposition(|step| matches!(step, Step::Pick { .. })).map_or(0, |i| i + 1);
        steps.truncate(last);
        Ok(Some(Self { steps, wanted: wanted.len() }))
    }

    /// The wanted values of one message, in the order in which they were asked for.
    ///
    /// # Errors
    /// When the message is shorter than its type, or is not plain CDR.
    pub(super) fn pick(&self, message: &[u8]) -> Result<Vec<f64>, CdrError> {
        let big_endian = match message.get(..2) {
            Some([0, 0]) => true,
            Some([0, 1]) => false,
            Some(other) => return Err(CdrError::Encapsulation([other[0], other[1]])),
            None => return Err(CdrError::NoHead),
        };
        let body = message.get(4..).unwrap_or_default();
        let mut reader = Cdr { body, at: 0, big_endian };
        let mut values = vec![f64::NAN; self.wanted];
        reader.run(&self.steps, &mut values)?;
        Ok(values)
    }
}

/// `sensor_msgs/msg/Imu` → `sensor_msgs/Imu`.
fn short_name(name: &str) -> String {
    name.replacen("/msg/", "/", 1)
}

/// All types of a definition: the first has the name of the schema, the others follow behind lines
/// of `=`.
fn parse(name: &str, definition: &str) -> Result<Types, Problem> {
    let mut types = Types::new();
    let mut current = short_name(name);
    types.insert(current.clone(), Vec::new());
    for line in definition.lines() {
        let text = line.split('#').next().unwrap_or("").trim();
        if text.is_empty() || text.starts_with("====") {
            continue;
        }
        if let Some(next) = text.strip_prefix("MSG:") {
            current = short_name(next.trim());
            types.insert(current.clone(), Vec::new());
            continue;
        }
        let mut words = text.split_whitespace();
        let (Some(kind), Some(member)) = (words.next(), words.next()) else {
            return Err(Problem::damaged(
                format_args!("the definition of {name}"),
                "a type and a name in each line",
                format_args!("{text:?}"),
            ));
        };
        // Constants have no place in a message.
        if member.contains('=') || words.next().is_some_and(|w| w.starts_with('=')) {
            continue;
        }
        let (base, count) = match kind.split_once('[') {
            None => (kind, Count::One),
            Some((base, rest)) => {
                let inside = rest.trim_end_matches(']');
                let count = inside.parse().map_or(Count::Variable, Count::Fixed);
                (base, count)
            }
        };
        // `string<=10`: the bound does not change the bytes.
        let base = base.split("<=").next().unwrap_or(base);
        let package = current.split('/').next().unwrap_or("");
        let kind = if base == "Header" {
            "std_msgs/Header".to_owned()
        } else if size_of_number(base).is_some() || base.contains("string") || base.contains('/') {
            short_name(base)
        } else {
            format!("{package}/{base}")
        };
        if let Some(members) = types.get_mut(&current) {
            members.push(Member { name: member.to_owned(), kind, count });
        }
    }
    Ok(types)
}

/// The path to the first member of type `inner`, with a dot behind; empty for the type itself.
fn find(types: &Types, kind: &str, inner: &str, depth: usize) -> Option<String> {
    if kind == inner {
        return Some(String::new());
    }
    if depth > DEEPEST {
        return None;
    }
    types
        .get(kind)?
        .iter()
        .filter(|m| matches!(m.count, Count::One))
        .find_map(|member| find(types, &member.kind, inner, depth + 1).map(|path| format!("{}.{path}", member.name)))
}

fn size_of_number(kind: &str) -> Option<usize> {
    Some(match kind {
        "bool" | "byte" | "char" | "int8" | "uint8" => 1,
        "int16" | "uint16" => 2,
        "int32" | "uint32" | "float32" => 4,
        "int64" | "uint64" | "float64" => 8,
        _ => return None,
    })
}

struct Compiler<'a> {
    types: &'a Types,
    wanted: &'a [String],
    found: Vec<bool>,
    steps: usize,
}

impl Compiler<'_> {
    fn members(
        &mut self,
        kind: &str,
        path: &str,
        depth: usize,
        in_list: bool,
        out: &mut Vec<Step>,
    ) -> Result<(), Problem> {
        let unknown = || Problem::damaged("a ROS 2 definition", format_args!("the type {kind}"), "none of that name");
        let types = self.types;
        let members = types.get(kind).ok_or_else(unknown)?;
        if depth > DEEPEST {
            return Err(Problem::limit("a ROS 2 definition", "its depth", DEEPEST));
        }
        for member in members {
            let path = format!("{path}{}", member.name);
            match member.count {
                Count::One => self.one(&member.kind, &path, depth, in_list, out)?,
                Count::Fixed(count) => match size_of_number(&member.kind) {
                    Some(size) => self.push(Step::Skip { size, count }, out)?,
                    None => {
                        for _ in 0..count {
                            self.one(&member.kind, &path, depth, true, out)?;
                        }
                    }
                },
                Count::Variable => {
                    let mut inner = Vec::new();
                    self.one(&member.kind, &path, depth, true, &mut inner)?;
                    self.push(Step::Sequence(inner), out)?;
                }
            }
        }
        Ok(())
    }

    fn one(&mut self, kind: &str, path: &str, depth: usize, in_list: bool, out: &mut Vec<Step>) -> Result<(), Problem> {
        if kind == "string" {
            return self.push(Step::Text, out);
        }
        if kind == "wstring" {
            return Err(Problem::unsupported("a ROS 2 message with wide text", "its other topics are read"));
        }
        let Some(size) = size_of_number(kind) else {
            return self.members(kind, &format!("{path}."), depth + 1, in_list, out);
        };
        let number = match kind {
            "int32" => Some(Number::I32),
            "uint32" => Some(Number::U32),
            "float32" => Some(Number::F32),
            "float64" => Some(Number::F64),
            _ => None,
        };
        match (number, self.wanted.iter().position(|w| w == path)) {
            (Some(number), Some(slot)) if !in_list => {
                self.found[slot] = true;
                self.push(Step::Pick { number, slot }, out)
            }
            _ => self.push(Step::Skip { size, count: 1 }, out),
        }
    }

    fn push(&mut self, step: Step, out: &mut Vec<Step>) -> Result<(), Problem> {
        self.steps += 1;
        if self.steps > MOST_STEPS {
            return Err(Problem::limit("a ROS 2 definition", "its number of members", MOST_STEPS));
        }
        out.push(step);
        Ok(())
    }
}

/// What a message lacks, as the thing that was expected.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum CdrError {
    #[error("the four bytes that name the byte order")]
    NoHead,
    #[error("plain CDR, found encapsulation {0:02x?}")]
    Encapsulation([u8; 2]),
    #[error("a list of {length} items in {bytes} bytes")]
    List { length: usize, bytes: usize },
    #[error("{count} numbers of {size} bytes at byte {at}")]
    Numbers { count: usize, size: usize, at: usize },
    #[error("{count} more bytes at byte {at}")]
    Bytes { count: usize, at: usize },
}

struct Cdr<'a> {
    body: &'a [u8],
    at: usize,
    big_endian: bool,
}

impl Cdr<'_> {
    fn run(&mut self, steps: &[Step], values: &mut [f64]) -> Result<(), CdrError> {
        for step in steps {
            match step {
                Step::Skip { size, count } => self.skip(*size, *count)?,
                Step::Pick { number, slot } => {
                    let value = match number {
                        Number::I32 => self.take().map(i32::from_le_bytes).map(f64::from)?,
                        Number::U32 => self.take().map(u32::from_le_bytes).map(f64::from)?,
                        Number::F32 => self.take().map(f32::from_le_bytes).map(f64::from)?,
                        Number::F64 => self.take().map(f64::from_le_bytes)?,
                    };
                    if let Some(place) = values.get_mut(*slot) {
                        *place = value;
                    }
                }
                Step::Text => {
                    let length = self.length()?;
                    self.skip(1, length)?;
                }
                Step::Sequence(inner) => {
                    let length = self.length()?;
                    match inner[..] {
                        [Step::Skip { size, count: 1 }] if length > 0 => self.skip(size, length)?,
                        _ => {
                            // Each item takes at least a byte, so a length beyond the rest cannot
                            // be true.
                            if length > self.body.len() - self.at {
                                return Err(CdrError::List { length, bytes: self.body.len() });
                            }
                            for _ in 0..length {
                                self.run(inner, values)?;
                            }
                        }
                    }
                }
            }
        }
        Ok(())
    }

    fn length(&mut self) -> Result<usize, CdrError> {
        self.take().map(|bytes| u32::from_le_bytes(bytes) as usize)
    }

    /// Passes over `count` numbers of `size` bytes.
    fn skip(&mut self, size: usize, count: usize) -> Result<(), CdrError> {
        let end = count.checked_mul(size).and_then(|n| self.at.next_multiple_of(size).checked_add(n));
        match end.filter(|&end| end <= self.body.len()) {
            Some(end) => self.at = end,
            None => return Err(CdrError::Numbers { count, size, at: self.at }),
        }
        Ok(())
    }

    /// The next `N` bytes, aligned, with the low byte first.
    fn take<const N: usize>(&mut self) -> Result<[u8; N], CdrError> {
        let start = self.at.next_multiple_of(N);
        let bytes = self.body.get(start..).and_then(|rest| rest.first_chunk::<N>());
        let mut bytes = *bytes.ok_or(CdrError::Bytes { count: N, at: start })?;
        self.at = start + N;
        if self.big_endian {
            bytes.reverse();
        }
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DEFINITION: &str = "\
uint8 KIND=3
string<=20 label
float64[2] pair
Point[] path # a list
Inner inner
================================================================================
MSG: demo/Point
float64 x
uint8 flag
================================================================================
MSG: demo/Inner
uint16 a 5
float64 wanted
int32 sec
";

    fn align(out: &mut Vec<u8>, n: usize) {
        while !(out.len() - 4).is_multiple_of(n) {
            out.push(0);
        }
    }

    /// Bytes laid out by hand after the CDR rules.
    fn message() -> Vec<u8> {
        let mut out = vec![0, 1, 0, 0];
        out.extend(3_u32.to_le_bytes());
        out.extend(b"ab\0");
        align(&mut out, 8);
        out.extend([1.0_f64, 2.0].iter().flat_map(|v| v.to_le_bytes()));
        out.extend(2_u32.to_le_bytes());
        for x in [7.0_f64, 8.0] {
            align(&mut out, 8);
            out.extend(x.to_le_bytes());
            out.push(1);
        }
        align(&mut out, 2);
        out.extend(5_u16.to_le_bytes());
        align(&mut out, 8);
        out.extend(42.5_f64.to_le_bytes());
        out.extend((-9_i32).to_le_bytes());
        out
    }

    #[test]
    fn conform_values_are_picked_behind_text_lists_and_padding() {
        let picker = Picker::compile("demo/msg/Top", DEFINITION, "demo/Inner", &["sec", "wanted"]).unwrap().unwrap();
        assert_eq!(picker.pick(&message()), Ok(vec![-9.0, 42.5]));
    }

    #[test]
    fn conform_every_cut_message_is_refused() {
        let picker = Picker::compile("demo/msg/Top", DEFINITION, "demo/Inner", &["sec", "wanted"]).unwrap().unwrap();
        let message = message();
        for cut in 0..message.len() {
            assert!(picker.pick(&message[..cut]).is_err(), "{cut}");
        }
        let mut long = message.clone();
        long[4..8].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(picker.pick(&long).is_err());
    }

    #[test]
    fn conform_types_that_contain_themselves_or_nothing_are_refused() {
        let own =
            "Loop again\nfloat64 x\n====\nMSG: demo/Loop\nLoop again\nInner i\n====\nMSG: demo/Inner\nfloat64 x\n";
        assert!(
            Picker::compile("demo/msg/Top", own, "demo/Inner", &["x"]).is_ok_and(|p| p.is_none())
                || Picker::compile("demo/msg/Top", own, "demo/Inner", &["x"]).is_err()
        );
        let wide = "Inner[4000000000] many\nInner i\n====\nMSG: demo/Inner\nfloat64 x\n";
        assert!(Picker::compile("demo/msg/Top", wide, "demo/Inner", &["x"]).is_err());
        assert!(Picker::compile("demo/msg/Top", "float64 x", "demo/Inner", &["x"]).unwrap().is_none());
        assert!(Picker::compile("demo/msg/Top", "Inner i\n", "demo/Inner", &["x"]).is_err());
    }
}
