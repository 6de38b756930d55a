//! How far windows of the healthy bench scatter: the measure of what is a change.

use gearwatch_core::analysis::{Sidebands, StageAnalysis};
use gearwatch_core::one_shot::each_window;
use gearwatch_core::pipeline::{Pipeline, PipelineConfig};
use gearwatch_core::verdict::InstrumentState;

use super::run::{Indicator, LineGroup};
use super::{Duty, GrowthError, Plan};
use crate::scenario::{Course, Scenario};
use crate::setup::metres_per_second2_to;
use crate::source::{SimConfig, Simulator};

/// Standard deviation over the windows of a simulated recording of the bench before anything grows,
/// by indicator (m/s²); 0 where a recording has no two windows.
///
/// # Errors
/// Where the bench cannot be simulated.
pub fn baseline_scatter(plan: &Plan, indicators: &[Indicator], seconds: f64) -> Result<Vec<f64>, GrowthError> {
    let Duty { motor_hz, torque_nm, .. } = plan.measured;
    let scenario = Scenario {
        motor_speed_hz: Some(Course::Constant(motor_hz)),
        brake_torque_nm: Some(Course::Constant(torque_nm)),
        duration_s: Some(seconds),
        ..Scenario::default()
    };
    let bench = plan.bench.clone();
    let pipeline = Pipeline::new(&bench, &PipelineConfig::default(), None)
        .map_err(|error| GrowthError::Unsuitable(error.to_string()))?;
    let mut simulator = Simulator::new(SimConfig { bench, effects: Vec::new(), scenario, seed: plan.seed, t0: 0 })?;
    let mut values: Vec<Vec<f64>> = vec![Vec::new(); indicators.len()];
    each_window::<_, GrowthError>(&pipeline, &mut simulator, &mut |_, analysis| {
        if analysis.instrument != InstrumentState::Ok || !analysis.input_speed_hz.is_known() {
            return Ok(());
        }
        for (indicator, values) in indicators.iter().zip(&mut values) {
            let sensor = &plan.bench.sensors[indicator.sensor];
            if *sensor.name == *analysis.sensor
                && let Some(stage) = analysis.stages.get(indicator.stage)
            {
                let value = of(stage, indicator) / metres_per_second2_to(&sensor.unit);
                if value.is_finite() {
                    values.push(value);
                }
            }
        }
        Ok(())
    })?;
    Ok(values.iter().map(|values| deviation(values)).collect())
}

fn of(stage: &StageAnalysis, indicator: &Indicator) -> f64 {
    let h = indicator.harmonic as usize - 1;
    match indicator.kind {
        LineGroup::Mesh => stage.harmonics[h].amplitude.value,
        LineGroup::PinionSidebands => together(&stage.pinion_sidebands[h]),
        LineGroup::WheelSidebands => together(&stage.wheel_sidebands[h]),
    }
}

/// Root of the sum of squares; unknown where one of them is.
fn together(sidebands: &Sidebands) -> f64 {
    let squares = sidebands.below.iter().chain(&sidebands.above).map(|line| line.amplitude.value.powi(2));
    squares.sum::<f64>().sqrt()
}

fn deviation(values: &[f64]) -> f64 {
    if values.len() < 2 {
        return 0.0;
    }
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0)).sqrt()
}
