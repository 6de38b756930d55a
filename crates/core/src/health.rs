//! What the samples of a window say of the instrument.
//!
//! Each fault is told by what it is: [`clipping`] by the samples that pile up at the ends, [`held`]
//! by how seldom and in what rhythm the value changes and how few values there are, [`repeats`] by
//! blocks that come twice. None of these asks what the machine does.

use crate::block::Quality;
use crate::verdict::InstrumentState;
use crate::window::Window;

pub mod clipping;
pub mod held;
pub mod repeats;

use clipping::Range;
use held::Hold;

/// What is wrong with a window. The worst comes first: values that are not numbers, what the source
/// says, what the values show. An offset of more than `largest_offset` standard deviations is a
/// wrong bias.
pub fn instrument_state(window: &Window, largest_offset: f64) -> InstrumentState {
    use InstrumentState as State;
    let has = |bits| window.quality.contains(bits);
    match sample_state(&window.samples, largest_offset) {
        State::NotFinite => State::NotFinite,
        _ if has(Quality::SENSOR_FAULT) || has(Quality::INVALID) => State::SensorFault,
        held @ (State::ChannelDead | State::FlatLine | State::SamplesRepeated) => held,
        _ if has(Quality::OVERLOAD) => State::Overload,
        State::Ok if has(Quality::SETTLING) => State::Settling,
        State::Ok if window.clock_trouble => State::ClockTrouble,
        shown => shown,
    }
}

/// What the samples of a window, some ten thousand at most, show by themselves.
pub fn sample_state(samples: &[f64], largest_offset: f64) -> InstrumentState {
    let Some(range) = Range::of(samples) else { return InstrumentState::NotFinite };
    match held::hold(samples) {
        Some(Hold::Dead) => InstrumentState::ChannelDead,
        Some(Hold::Stuck) => InstrumentState::FlatLine,
        Some(Hold::Staircase) => InstrumentState::SamplesRepeated,
        None if repeats::repeated_block(samples).is_some() => InstrumentState::SamplesRepeated,
        None if range.is_clipped(samples) => InstrumentState::Overload,
        None if held::is_coarse(samples) => InstrumentState::QuantisationCoarse,
        None if range.is_far_from_zero(samples, largest_offset) => InstrumentState::Bias,
        None => InstrumentState::Ok,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(n: usize) -> Vec<f64> {
        // Sum of twelve uniform numbers less six: nearly normal, sigma 1.
        let mut state = 1u64;
        let mut uniform = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..n).map(|_| (0..12).map(|_| uniform()).sum::<f64>() - 6.0).collect()
    }

    fn state_of(samples: Vec<f64>) -> InstrumentState {
        let mut window = Window::empty();
        window.samples = samples;
        instrument_state(&window, 10.0)
    }

    #[test]
    fn analytic_clipped_noise_is_overload_and_clean_noise_is_not() {
        assert_eq!(state_of(noise(16_384)), InstrumentState::Ok);
        for limit in [1.0, 2.0, 2.5] {
            let clipped = noise(16_384).into_iter().map(|x| x.clamp(-limit, limit)).collect();
            assert_eq!(state_of(clipped), InstrumentState::Overload, "{limit}");
            let one_sided = noise(16_384).into_iter().map(|x| x.min(limit)).collect();
            assert_eq!(state_of(one_sided), InstrumentState::Overload, "{limit}, one side");
        }
    }

    /// One sample in a thousand lies at the limits of noise that is clipped at 3.29 sigma: about
    /// eight at each of them in 16 384 samples.
    #[test]
    fn analytic_one_sample_in_a_thousand_that_is_clipped_is_overload() {
        let all = noise(20 * 16_384);
        let flagged = all.chunks(16_384).filter(|window| {
            let clipped = window.iter().map(|x| x.clamp(-3.2, 3.2)).collect();
            state_of(clipped) == InstrumentState::Overload
        });
        // Sums of twelve uniform numbers have thinner tails than a normal variable: 3.2 of theirs
        // are its 3.29.
        assert!(flagged.count() >= 19);
        assert!(all.chunks(16_384).all(|window| state_of(window.to_vec()) == InstrumentState::Ok));
    }

    /// Twelve sigma from zero is a wrong bias, nine are not; which side does not matter.
    #[test]
    fn analytic_an_offset_beyond_all_that_moves_is_bias() {
        let offset = |by: f64| noise(4096).into_iter().map(|x| x + by).collect();
        for (by, expected) in
            [(12.0, InstrumentState::Bias), (-12.0, InstrumentState::Bias), (9.0, InstrumentState::Ok)]
        {
            assert_eq!(state_of(offset(by)), expected, "{by}");
        }
    }

    /// Quantised sines and noise pile up at their extremes by nature.
    #[test]
    fn analytic_coarse_counts_are_not_overload() {
        for counts in [3.0, 5.0, 30.0, 100.0, 1000.0, 30_000.0] {
            let sine = (0..16_384).map(|i| (counts * (0.0115 * f64::from(i)).sin()).round());
            assert_eq!(state_of(sine.collect()), InstrumentState::Ok, "sine of {counts} counts");
            let rough = noise(16_384).into_iter().map(|x| (counts / 4.0 * x).round()).collect();
            assert_eq!(state_of(rough), InstrumentState::Ok, "noise of {counts} counts");
        }
    }

    #[test]
    fn analytic_flat_stuck_and_not_finite() {
        assert_eq!(state_of(vec![0.25; 4096]), InstrumentState::ChannelDead);
        let mut stuck = noise(4096);
        stuck[1000..1600].fill(0.3);
        assert_eq!(state_of(stuck), InstrumentState::FlatLine);
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut samples = noise(4096);
            samples[17] = bad;
            assert_eq!(state_of(samples), InstrumentState::NotFinite);
        }
    }
}
