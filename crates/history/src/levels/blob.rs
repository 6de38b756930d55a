//! A span as bytes: counts whole, means in single precision, of which a screen and a report show a
//! few digits.

use std::collections::HashMap;

use gearwatch_core::indicators::columns::Mean;
use gearwatch_core::verdict::HARMONICS;

use crate::span::Span;
use crate::verdict_line::indicator_names;

const VERSION: u8 = 1;
/// Means before those of the indicators: deviations, amplitudes, speed, torque.
const PLAIN: usize = 2 * HARMONICS + 2;
/// In front of each mean.
const NONE: u8 = 0;
const OF_ALL_WINDOWS: u8 = 1;
const OF_SOME: u8 = 2;

/// Where indicators stand in the bytes, by their places among those that this version knows.
#[derive(Debug)]
pub(super) struct Places(Vec<Option<usize>>);

impl Places {
    pub(super) fn new(stored: &[String]) -> Self {
        let known: HashMap<&str, usize> = indicator_names().enumerate().map(|(i, name)| (name, i)).collect();
        Self(stored.iter().map(|name| known.get(name.as_str()).copied()).collect())
    }
}

pub(super) fn encode(span: &Span, places: &Places) -> Vec<u8> {
    let mut out = vec![VERSION];
    let count = |n: u64| u32::try_from(n).unwrap_or(u32::MAX).to_le_bytes();
    for n in [span.windows].into_iter().chain(span.states).chain([span.not_ok]) {
        out.extend_from_slice(&count(n));
    }
    out.extend(span.levels.map(|level| level as u8));
    let empty = Mean::default();
    let indicators = places.0.iter().map(|place| place.and_then(|i| span.indicators.get(i)).unwrap_or(&empty));
    for mean in span.means().take(PLAIN).chain(indicators) {
        let [n, value, squares, variance] = mean.parts();
        if n < 1.0 {
            out.push(NONE);
            continue;
        }
        if n == span.windows as f64 {
            out.push(OF_ALL_WINDOWS);
        } else {
            out.push(OF_SOME);
            out.extend_from_slice(&count(n as u64));
        }
        [value, squares, variance].iter().for_each(|&x| out.extend_from_slice(&(x as f32).to_le_bytes()));
    }
    out
}

/// None where these are no such bytes.
pub(super) fn decode(bytes: &[u8], places: &Places) -> Option<Span> {
    let mut rest = bytes;
    (take::<1>(&mut rest)? == [VERSION]).then_some(())?;
    let mut span = Span::new();
    span.windows = number(&mut rest)?;
    for state in &mut span.states {
        *state = number(&mut rest)?;
    }
    span.not_ok = number(&mut rest)?;
    span.levels = take::<HARMONICS>(&mut rest)?.map(|level| level as i8);
    let windows = span.windows;
    for mean in span.means_mut() {
        *mean = read(&mut rest, windows)?;
    }
    let mut indicators = vec![Mean::default(); indicator_names().count()];
    let mut any = false;
    for place in &places.0 {
        // Of an older version, which knew fewer.
        if rest.is_empty() {
            break;
        }
        let mean = read(&mut rest, windows)?;
        if let Some(known) = place.and_then(|i| indicators.get_mut(i)) {
            any |= mean.count() > 0;
            *known = mean;
        }
    }
    if any {
        span.indicators = indicators;
    }
    Some(span)
}

fn take<const N: usize>(rest: &mut &[u8]) -> Option<[u8; N]> {
    let (head, tail) = rest.split_first_chunk::<N>()?;
    *rest = tail;
    Some(*head)
}

fn number(rest: &mut &[u8]) -> Option<u64> {
    take::<4>(rest).map(|bytes| u64::from(u32::from_le_bytes(bytes)))
}

fn read(rest: &mut &[u8], windows: u64) -> Option<Mean> {
    let n = match take::<1>(rest)? {
        [NONE] => return Some(Mean::default()),
        [OF_ALL_WINDOWS] => windows,
        [OF_SOME] => number(rest)?,
        _ => return None,
    };
    let mut single = || take::<4>(rest).map(|bytes| f64::from(f32::from_le_bytes(bytes)));
    let parts = [n as f64, single()?, single()?, single()?];
    Some(Mean::from_parts(parts))
}
