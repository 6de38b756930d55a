//! A span in short form, as many of which are kept as a page looks at.

use gearwatch_core::estimate::Estimate;
use gearwatch_core::indicators::columns::Mean;
use gearwatch_core::verdict::HARMONICS;

use crate::span::Span;

/// Share of a window's samples that the next does not have: the default hop.
const OWN_SHARE: f64 = 0.5;

/// Mean and its standard error.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Short {
    pub(super) value: f32,
    pub(super) sigma: f32,
}

impl Short {
    pub(super) const UNKNOWN: Self = Self { value: f32::NAN, sigma: f32::NAN };

    fn of(x: Estimate) -> Self {
        Self { value: x.value as f32, sigma: x.sigma as f32 }
    }

    /// Of two parts of one span, by their windows.
    pub(super) fn with(self, weight: f32, other: Self, of_other: f32) -> Self {
        match (self.value.is_finite(), other.value.is_finite()) {
            (false, _) => other,
            (_, false) => self,
            _ => {
                let all = weight + of_other;
                let value = (weight * self.value + of_other * other.value) / all;
                Self { value, sigma: (weight * self.sigma).hypot(of_other * other.sigma) / all }
            }
        }
    }
}

/// A span in short form.
#[derive(Clone, Debug)]
pub(super) struct ShortSpan {
    pub(super) windows: u32,
    pub(super) states: [u32; 5],
    pub(super) not_ok: u32,
    pub(super) levels: [i8; HARMONICS],
    pub(super) deviations: [Short; HARMONICS],
    pub(super) amplitudes: [Short; HARMONICS],
    pub(super) speed: Short,
    pub(super) torque: Short,
    /// The one that is wanted.
    pub(super) indicator: Short,
}

impl ShortSpan {
    /// `place`: of the wanted one among the indicators of the span.
    pub(super) fn of(span: &Span, place: Option<usize>) -> Self {
        let short = |mean: &Mean| Short::of(mean.estimate(OWN_SHARE));
        let count = |n: u64| u32::try_from(n).unwrap_or(u32::MAX);
        Self {
            windows: count(span.windows),
            states: span.states.map(count),
            not_ok: count(span.not_ok),
            levels: span.levels,
            deviations: std::array::from_fn(|h| short(&span.deviations[h])),
            amplitudes: std::array::from_fn(|h| short(&span.amplitudes[h])),
            speed: short(&span.speed),
            torque: short(&span.torque),
            indicator: place.and_then(|i| span.indicators.get(i)).map_or(Short::UNKNOWN, short),
        }
    }

    /// Takes in the part of the same span that stands in another file.
    pub(super) fn add(&mut self, other: &Self) {
        let (a, b) = (self.windows as f32, other.windows as f32);
        let merge = |x: &mut Short, y: &Short| *x = x.with(a, *y, b);
        self.deviations.iter_mut().zip(&other.deviations).for_each(|(x, y)| merge(x, y));
        self.amplitudes.iter_mut().zip(&other.amplitudes).for_each(|(x, y)| merge(x, y));
        merge(&mut self.speed, &other.speed);
        merge(&mut self.torque, &other.torque);
        merge(&mut self.indicator, &other.indicator);
        self.windows = self.windows.saturating_add(other.windows);
        self.not_ok = self.not_ok.saturating_add(other.not_ok);
        self.states.iter_mut().zip(other.states).for_each(|(x, y)| *x = x.saturating_add(y));
        self.levels.iter_mut().zip(other.levels).for_each(|(x, y)| *x = (*x).max(y));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two parts of a span, 30 and 10 windows: (30·2 + 10·6)/40 = 3; sigma
    /// √((30·0.1)² + (10·0.4)²)/40 = 0.125.
    #[test]
    fn analytic_parts_of_a_span_are_put_together_by_their_windows() {
        let merged = Short { value: 2.0, sigma: 0.1 }.with(30.0, Short { value: 6.0, sigma: 0.4 }, 10.0);
        assert!((merged.value - 3.0).abs() < 1e-6 && (merged.sigma - 0.125).abs() < 1e-6, "{merged:?}");
        let known = Short { value: 6.0, sigma: 0.4 };
        assert!((Short::UNKNOWN.with(30.0, known, 10.0).value - 6.0).abs() < 1e-6);
        assert!((known.with(10.0, Short::UNKNOWN, 30.0).value - 6.0).abs() < 1e-6);
    }
}
