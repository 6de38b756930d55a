//! The train does not turn evenly.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use super::signature::{rate_line, sidebands};
use super::{
    Change, Effect, EffectError, EntryPoint, Law, Line, Parameter, Place, PlaceKind, Signature, SpeedLaw, Values,
};
use crate::setup::{self, Rate, SimSetup};

/// Uneven rotation.
pub struct SpeedFluctuation;

impl Effect for SpeedFluctuation {
    fn id(&self) -> &'static str {
        "speed_fluctuation"
    }

    fn help(&self) -> &'static str {
        "The whole train turns unevenly, at an order of a shaft or at a fixed frequency: frequency modulation of all orders, and the torque that accelerates the inertias."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Shaft]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Clock
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "order", unit: "1/rev", min: 0.01, typical: 1.0, max: 50.0 },
            Parameter { name: "frequency_hz", unit: "Hz", min: 0.01, typical: 1.0, max: 1000.0 },
            Parameter { name: "depth_percent", unit: "%", min: 0.0, typical: 0.05, max: 20.0 },
        ]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        if values.given("order").is_some() && values.given("frequency_hz").is_some() {
            return Err(
                values.unsuitable("both order and frequency_hz are given; give the one that the fluctuation follows")
            );
        }
        setup
            .speed_fluctuations
            .push(setup::SpeedFluctuation { rate: rate(values), depth: 1e-2 * values.get("depth_percent") });
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        let train = Train::new(bench);
        let line = rate_line(&train, rate(values));
        let mut lines = vec![line];
        let spacing = match line {
            Line::Order(order) => order,
            Line::Hertz(hz) => hz / train.nominal_input_hz,
        };
        for stage in 0..train.stages.len() {
            lines.extend(sidebands(&train, stage, spacing, 2));
        }
        Signature { lines, change: Change::Rises, load: Law::Mixed, speed: SpeedLaw::Resonances }
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["eccentricity", "torque_ripple", "belt_slip"]
    }
}

fn rate(values: &Values) -> Rate {
    match (values.given("frequency_hz"), values.place()) {
        (Some(hz), _) => Rate::Hertz(hz),
        (None, Place::Shaft(shaft)) => Rate::PerRevolution { shaft: Some(shaft), order: values.get("order") },
        (None, _) => Rate::PerRevolution { shaft: None, order: values.get("order") },
    }
}
