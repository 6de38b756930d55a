//! What a field of a verdict is: name, type, unit, meaning, and how it is read from a verdict and
//! put into one. The rows stand beside the types, in [`super`].

use std::collections::BTreeMap;
use std::sync::LazyLock;

use crate::estimate::Estimate;
use crate::indicators::{CHANNEL_INDICATORS, GEAR_INDICATORS};
use crate::verdict::{
    Code, FromNormal, HARMONIC_ROWS, HARMONICS, HarmonicVerdict, INDICATOR_NAMES, NEAREST_STATES, NearState,
    STATE_FIT_ROW, STATE_ROWS, StageIndicators, Verdict, WINDOW_ROWS,
};

/// The type of a field.
#[derive(Clone, Copy, Debug)]
pub enum Holds {
    /// Free text.
    Text,
    /// One of these codes, each with its meaning.
    Code(fn() -> Vec<(&'static str, &'static str)>),
    /// Nanoseconds since the Unix epoch (UTC).
    Time,
    /// A whole number from 0.
    Count,
    /// A small whole number that may be negative.
    Level,
    /// True or false.
    Flag,
    /// A number; `null` where it is not known.
    Number,
}

/// What a field is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The window as a whole.
    Window,
    /// One mesh harmonic, from 1.
    Harmonic(usize),
    /// One of the nearest states of the signature table, from 1.
    State(usize),
    /// A condition indicator.
    Indicator,
}

/// The content of a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Datum<'a> {
    /// Text or a code.
    Text(&'a str),
    /// A whole number from 0.
    Count(u64),
    /// A whole number.
    Integer(i64),
    /// True or false.
    Flag(bool),
    /// A number, `NaN` where unknown.
    Number(f64),
    /// This verdict does not have the field.
    Absent,
}

/// One field of a verdict.
#[derive(Clone, Debug)]
pub struct Field {
    /// Name in JSON, Parquet and MCAP.
    pub name: String,
    /// Its type.
    pub holds: Holds,
    /// Unit: empty for a pure number or text, `channel` for that of the channel (field `unit`).
    pub unit: &'static str,
    /// What it says, in one sentence.
    pub meaning: String,
    /// What it is about.
    pub part: Part,
    at: At,
}

pub(super) type Read<T> = for<'a> fn(&'a T) -> Datum<'a>;
pub(super) type Write<T> = fn(&mut T, &Datum<'_>) -> bool;

#[derive(Clone, Copy, Debug)]
enum At {
    Window(Read<Verdict>, Write<Verdict>),
    Harmonic(usize, Read<HarmonicVerdict>, Write<HarmonicVerdict>),
    State(usize, Read<NearState>, Write<NearState>),
    Revolutions(usize),
    /// Which indicator, and which of its five numbers.
    Indicator(usize, usize),
}

impl Field {
    /// What a verdict holds there.
    pub fn read<'a>(&self, verdict: &'a Verdict) -> Datum<'a> {
        match self.at {
            At::Window(read, _) => read(verdict),
            At::Harmonic(h, read, _) => read(&verdict.harmonics[h]),
            At::State(i, read, _) => verdict.states.get(i).map_or(Datum::Absent, read),
            At::Revolutions(side) => {
                let of = |x: &StageIndicators| Datum::Count(x.gears[side].revolutions.into());
                verdict.indicators.as_ref().map_or(Datum::Absent, of)
            }
            At::Indicator(which, number) => {
                verdict.indicators.as_ref().map_or(Datum::Absent, |indicators| {
                    let (x, normal) = indicator(indicators, which);
                    let deviation = normal.deviation_percent;
                    match number {
                        0 => Datum::Number(x.value),
                        1 => Datum::Number(x.sigma),
                        // Without a baseline these would be three quarters of the line, all of them
                        // null.
                        _ if !normal.baseline.is_finite() => Datum::Absent,
                        2 => Datum::Number(normal.baseline),
                        3 => Datum::Number(deviation.value),
                        _ => Datum::Number(deviation.sigma),
                    }
                })
            }
        }
    }

    /// Puts a content in; `false` where it does not fit the field.
    pub fn write(&self, verdict: &mut Verdict, datum: &Datum<'_>) -> bool {
        match self.at {
            At::Window(_, write) => write(verdict, datum),
            At::Harmonic(h, _, write) => write(&mut verdict.harmonics[h], datum),
            At::State(i, _, write) => {
                while verdict.states.len() <= i {
                    verdict.states.push(NearState { name: "".into(), probability: f64::NAN, goodness: f64::NAN });
                }
                write(&mut verdict.states[i], datum)
            }
            At::Revolutions(side) => {
                let indicators = verdict.indicators.get_or_insert(StageIndicators::UNKNOWN);
                count(datum).map(|x| indicators.gears[side].revolutions = x).is_some()
            }
            At::Indicator(which, number) => {
                let indicators = verdict.indicators.get_or_insert(StageIndicators::UNKNOWN);
                let (x, normal) = indicator_mut(indicators, which);
                let place = match number {
                    0 => &mut x.value,
                    1 => &mut x.sigma,
                    2 => &mut normal.baseline,
                    3 => &mut normal.deviation_percent.value,
                    _ => &mut normal.deviation_percent.sigma,
                };
                set(place, datum)
            }
        }
    }

    /// What the field expects, for messages.
    pub fn expected(&self) -> String {
        match self.holds {
            Holds::Text => "a text".into(),
            Holds::Code(codes) => {
                let codes: Vec<_> = codes().iter().map(|(code, _)| format!("{code:?}")).collect();
                format!("one of {}", codes.join(", "))
            }
            Holds::Time => "a time in nanoseconds since 1970".into(),
            Holds::Count => "a whole number from 0".into(),
            Holds::Level => "a whole number".into(),
            Holds::Flag => "true or false".into(),
            Holds::Number => "a number or null".into(),
        }
    }
}

fn indicator(of: &StageIndicators, which: usize) -> (&Estimate, &FromNormal) {
    match which.checked_sub(CHANNEL_INDICATORS) {
        None => (&of.channel[which], &of.channel_normal[which]),
        Some(i) => {
            let (side, i) = (i / GEAR_INDICATORS, i % GEAR_INDICATORS);
            (&of.gears[side].values[i], &of.gears_normal[side][i])
        }
    }
}

fn indicator_mut(of: &mut StageIndicators, which: usize) -> (&mut Estimate, &mut FromNormal) {
    match which.checked_sub(CHANNEL_INDICATORS) {
        None => (&mut of.channel[which], &mut of.channel_normal[which]),
        Some(i) => {
            let (side, i) = (i / GEAR_INDICATORS, i % GEAR_INDICATORS);
            (&mut of.gears[side].values[i], &mut of.gears_normal[side][i])
        }
    }
}

pub(super) fn set(place: &mut f64, datum: &Datum<'_>) -> bool {
    let value = match *datum {
        Datum::Number(x) => x,
        Datum::Count(x) => x as f64,
        Datum::Integer(x) => x as f64,
        _ => return false,
    };
    *place = value;
    true
}

pub(super) fn set_text<T: for<'t> From<&'t str>>(place: &mut T, datum: &Datum<'_>) -> bool {
    let Datum::Text(text) = *datum else { return false };
    *place = text.into();
    true
}

pub(super) fn set_code<C: Code>(place: &mut C, datum: &Datum<'_>) -> bool {
    let Datum::Text(text) = *datum else { return false };
    C::of_code(text).map(|code| *place = code).is_some()
}

pub(super) fn count<T: TryFrom<u64>>(datum: &Datum<'_>) -> Option<T> {
    let Datum::Count(x) = *datum else { return None };
    T::try_from(x).ok()
}

pub(super) fn codes<C: Code>() -> Vec<(&'static str, &'static str)> {
    C::ALL.iter().map(|&code| (code.code(), code.meaning())).collect()
}

/// Harmonics that lines of other stages fall on, by their bits.
const SHARED: [&str; 1 << HARMONICS] = [
    "",
    "1x",
    "2x",
    "1x 2x",
    "3x",
    "1x 3x",
    "2x 3x",
    "1x 2x 3x",
    "4x",
    "1x 4x",
    "2x 4x",
    "1x 2x 4x",
    "3x 4x",
    "1x 3x 4x",
    "2x 3x 4x",
    "1x 2x 3x 4x",
    "5x",
    "1x 5x",
    "2x 5x",
    "1x 2x 5x",
    "3x 5x",
    "1x 3x 5x",
    "2x 3x 5x",
    "1x 2x 3x 5x",
    "4x 5x",
    "1x 4x 5x",
    "2x 4x 5x",
    "1x 2x 4x 5x",
    "3x 4x 5x",
    "1x 3x 4x 5x",
    "2x 3x 4x 5x",
    "1x 2x 3x 4x 5x",
];

pub(super) fn shared(verdict: &Verdict) -> &'static str {
    SHARED[verdict.harmonics.iter().enumerate().map(|(k, h)| usize::from(h.shared) << k).sum::<usize>()]
}

pub(super) fn set_shared(verdict: &mut Verdict, datum: &Datum<'_>) -> bool {
    let Datum::Text(text) = *datum else { return false };
    let Some(bits) = SHARED.iter().position(|&known| known == text) else { return false };
    for (k, h) in verdict.harmonics.iter_mut().enumerate() {
        h.shared = bits & (1 << k) != 0;
    }
    true
}

/// A level repeats the rank for viewers that plot numbers; the rank itself decides.
pub(super) fn level_fits(_: &mut HarmonicVerdict, datum: &Datum<'_>) -> bool {
    matches!(datum, Datum::Count(0..=5) | Datum::Integer(-1))
}

/// Name, type, unit, meaning, how to read it, how to write it.
pub(super) type Row<T> = (&'static str, Holds, &'static str, &'static str, Read<T>, Write<T>);

const OF_INDICATOR: [(&str, &str); 5] = [
    ("channel", "Condition indicator `{}` (docs/indicators.md)."),
    ("channel", "Standard uncertainty of `{}`."),
    ("channel", "Normal value of `{}` at this operating point; left out without a baseline."),
    ("%", "Signed deviation of `{}` from its normal value; left out without a baseline."),
    ("%", "Standard uncertainty of that deviation; left out without a baseline."),
];

pub(super) fn time(datum: &Datum<'_>) -> Option<i64> {
    match *datum {
        Datum::Integer(x) => Some(x),
        Datum::Count(x) => i64::try_from(x).ok(),
        _ => None,
    }
}

pub(super) fn flag(datum: &Datum<'_>) -> Option<bool> {
    if let Datum::Flag(x) = *datum { Some(x) } else { None }
}

/// All fields, in the order in which they are written.
pub static FIELDS: LazyLock<Vec<Field>> = LazyLock::new(|| {
    fn named<T>(row: &Row<T>, number: usize, part: Part, at: At) -> Field {
        let &(name, holds, unit, meaning, ..) = row;
        let put = |text: &str| text.replace("{}", &number.to_string());
        Field { name: put(name), holds, unit, meaning: put(meaning), part, at }
    }
    let window = |row: &Row<Verdict>| named(row, 0, Part::Window, At::Window(row.4, row.5));
    let mut out: Vec<Field> = WINDOW_ROWS.iter().map(window).collect();
    for h in 0..HARMONICS {
        let of = |row: &Row<HarmonicVerdict>| named(row, h + 1, Part::Harmonic(h + 1), At::Harmonic(h, row.4, row.5));
        out.extend(HARMONIC_ROWS.iter().map(of));
    }
    out.push(window(&STATE_FIT_ROW));
    for i in 0..NEAREST_STATES {
        let of = |row: &Row<NearState>| named(row, i + 1, Part::State(i + 1), At::State(i, row.4, row.5));
        out.extend(STATE_ROWS.iter().map(of));
    }
    for (which, names) in INDICATOR_NAMES.iter().enumerate() {
        let gear = which.checked_sub(CHANNEL_INDICATORS);
        if let Some(side) = gear.filter(|i| i % GEAR_INDICATORS == 0).map(|i| i / GEAR_INDICATORS) {
            out.push(Field {
                name: ["pinion_revolutions", "wheel_revolutions"][side].into(),
                holds: Holds::Count,
                unit: "",
                meaning: "Revolutions that were averaged for the indicators of this gear; 0 where the window has none."
                    .into(),
                part: Part::Indicator,
                at: At::Revolutions(side),
            });
        }
        for (number, (name, (unit, meaning))) in names.iter().zip(OF_INDICATOR).enumerate() {
            let unit = if unit == "channel" { unit_of(which) } else { unit };
            let meaning = meaning.replace("{}", &names[0]);
            let at = At::Indicator(which, number);
            out.push(Field { name: name.clone(), holds: Holds::Number, unit, meaning, part: Part::Indicator, at });
        }
    }
    out
});

/// Unit of an indicator's value; empty for a ratio.
fn unit_of(which: usize) -> &'static str {
    use crate::indicators::{ChannelIndicator, GearIndicator};
    let unit = match which.checked_sub(CHANNEL_INDICATORS) {
        None => ChannelIndicator::ALL[which].unit("channel"),
        Some(i) => GearIndicator::ALL[i % GEAR_INDICATORS].unit("channel"),
    };
    if unit == "1" { "" } else { unit }
}

static BY_NAME: LazyLock<BTreeMap<&'static str, &'static Field>> =
    LazyLock::new(|| FIELDS.iter().map(|field| (field.name.as_str(), field)).collect());

/// The field of this name.
pub fn field(name: &str) -> Option<&'static Field> {
    BY_NAME.get(name).copied()
}
