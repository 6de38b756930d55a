//! Teeth that part at light load: what the background shows at light loads alone.
//!
//! Under load the teeth of a mesh stay on one flank, and the clearance between the others is never
//! felt. Where the load is so light that they part, they hammer, and each impact depends on the one
//! before: the motion has no period, and what it adds is background rather than lines (Kahraman &
//! Singh 1990, gear pair with clearance). The width of the clearance decides how they hammer. So a
//! background that changed at the light loads, at every speed, and is what it was at the heavy
//! ones, is that of a clearance. Noise of another source, a path and a bearing change it at all
//! loads.

use crate::change::locate::{Cell, floor_misfit};
use crate::finding::Finding;
use crate::name::BACKGROUND;
use crate::question::Question;

/// Torques within this ratio of the lightest are light, and those within the next of the heaviest
/// heavy.
const LIGHT: f64 = 1.1;
const HEAVY: f64 = 1.5;
/// Least ratio of heavy and light torque.
const APART: f64 = 3.0;
/// Misfit per band of background below which a pair is what it was: of 58 pairs of unchanged
/// benches of another generator 57 stay below it, one comes to 1.35.
const UNCHANGED: f64 = 1.25;
/// What is believed: a clearance of a bearing seat is felt at light loads too.
const CLEARANCE: f64 = 0.7;

/// Misfit per band of background at the light and at the heavy loads, each the value that speaks
/// most against a clearance; `None` without such loads.
fn by_load(cells: &[Cell], torques: &[f64]) -> Option<(f64, f64)> {
    let (least, most) = torques.iter().fold((f64::INFINITY, 0.0f64), |(a, b), t| (a.min(*t), b.max(*t)));
    if most.is_nan() || least.is_nan() || most < APART * least {
        return None;
    }
    let misfits = |wanted: &dyn Fn(f64) -> bool| -> Vec<f64> {
        let pairs = (0..torques.len()).filter(|p| wanted(torques[*p]));
        pairs.filter_map(|p| floor_misfit(cells, Some(p))).collect()
    };
    let (light, heavy) = (misfits(&|t| t <= LIGHT * least), misfits(&|t| HEAVY * t >= most));
    if light.is_empty() || heavy.is_empty() {
        return None;
    }
    let lowest = light.into_iter().fold(f64::INFINITY, f64::min);
    Some((lowest, heavy.into_iter().fold(0.0, f64::max)))
}

/// The clearance of a mesh, where the background changed at light loads alone.
pub fn clearance(q: &Question<'_>, cells: &[Cell], steps: &mut Vec<String>) -> Option<Finding> {
    let torques: Vec<f64> = q.comparison.pairs.iter().map(|p| p.torque_nm).collect();
    let (light, heavy) = by_load(cells, &torques)?;
    if light < BACKGROUND || heavy > UNCHANGED {
        return None;
    }
    let support = format!(
        "the background changed at the light loads ({light:.1} per band at least) and not at the heavy ones ({heavy:.1} at most)"
    );
    steps.push(format!("teeth that part: {support}"));
    // Forces that part the teeth are alike along the train; the mesh that the least force holds
    // together parts first.
    let mut stages: Vec<(f64, &str)> = Vec::new();
    let mut torque = 1.0;
    for (sheet, stage) in q.bench.stages.iter().zip(&q.train.stages) {
        stages.push((torque / (sheet.module_mm * f64::from(sheet.pinion.teeth)), &stage.name));
        torque *= f64::from(stage.wheel_teeth) / f64::from(stage.pinion_teeth);
    }
    stages.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (first, others) = stages.split_first()?;
    let mut f = Finding::new("backlash", first.1, CLEARANCE);
    f.alternatives.extend(others.iter().map(|s| ("backlash", s.1.to_owned())));
    f.alternatives.extend(q.train.shafts.iter().map(|s| ("looseness", s.0.clone())));
    f.evidence.place = "background of all sensors".into();
    f.evidence.law = "at light loads alone, where teeth part".into();
    f.evidence.support = support;
    Some(f)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Forty bands of background in a pair for each torque, which changed by so many standard
    /// deviations.
    fn cells(changes: &[f64]) -> Vec<Cell> {
        let of = |(pair, z): (usize, &f64)| {
            let band = |k: u8| Cell {
                pair,
                channel: 0,
                family: None,
                frequency_hz: 100.0 * f64::from(k + 1),
                change: 0.1 * z,
                turn: None,
                variance: 0.01,
                noise: 0.0,
                repetition: 0.01,
                differs: 1.0,
            };
            (0..40).map(band).collect::<Vec<_>>()
        };
        changes.iter().enumerate().flat_map(of).collect()
    }

    /// The square of the least change at the light loads and of the largest at the heavy ones;
    /// nothing where the loads are alike, and what lies between them has no say.
    #[test]
    fn analytic_light_and_heavy_loads_speak_for_themselves() {
        let torques = [2.0, 2.0, 20.0, 30.0, 30.0];
        let (light, heavy) = by_load(&cells(&[3.0, 2.0, 0.5, 1.0, 0.8]), &torques).unwrap();
        assert!((light - 4.0).abs() < 1e-9 && (heavy - 1.0).abs() < 1e-9, "{light} {heavy}");
        let (_, between) = by_load(&cells(&[3.0, 2.0, 5.0, 1.0, 0.8]), &[2.0, 2.0, 10.0, 30.0, 30.0]).unwrap();
        assert!((between - 1.0).abs() < 1e-9);
        assert_eq!(by_load(&cells(&[3.0, 2.0]), &[20.0, 30.0]), None);
        assert_eq!(by_load(&[], &[2.0, 30.0]), None);
    }
}
