//! Teeth that are not evenly spaced.

use gearwatch_core::bench::Bench;

use super::{Change, Effect, EffectError, EntryPoint, Law, Parameter, PlaceKind, Signature, SpeedLaw, Values};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::gear::{GearAt, nominal_mesh_force_n};
use crate::setup::SimSetup;

/// Cumulative pitch error of a gear.
pub struct PitchError;

impl Effect for PitchError {
    fn id(&self) -> &'static str {
        "pitch_error"
    }

    fn help(&self) -> &'static str {
        "The teeth of a gear are not evenly spaced: an irregular comb of shaft orders and sidebands that repeats every revolution. While neighbouring teeth differ by less than they deflect the load does not change the shaft orders; the sidebands it does. What the gear has already is added to, tooth by tooth."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Gear]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Geometry
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "total_um", unit: "µm", min: 0.0, typical: 20.0, max: 500.0 },
            Parameter { name: "pattern", unit: "1", min: 0.0, typical: 1.0, max: 1000000.0 },
        ]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        if let Some(gear) = GearAt::of(values) {
            let teeth = gear.teeth(&setup.bench);
            let errors = pattern(teeth, values.get("pattern") as u64, 1e-6 * values.get("total_um"));
            gear.modifications(setup).add_pitch_errors(&errors);
        }
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        let Some(gear) = GearAt::of(values) else { return Signature::nothing() };
        Signature {
            lines: gear.once_per_revolution(bench, 4),
            change: Change::Rises,
            load: if self.largest_step_m(gear, values, bench) < deflection_m(gear, bench) {
                Law::ShaftOrders
            } else {
                Law::Mixed
            },
            speed: SpeedLaw::Resonances,
        }
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["eccentricity", "tooth_breakage", "root_crack"]
    }
}

impl PitchError {
    /// Largest difference between neighbouring teeth (m).
    fn largest_step_m(&self, gear: GearAt, values: &Values, bench: &Bench) -> f64 {
        let errors = pattern(gear.teeth(bench), values.get("pattern") as u64, 1e-6 * values.get("total_um"));
        let next = errors.iter().cycle().skip(1);
        errors.iter().zip(next).fold(0.0_f64, |w, (a, b)| w.max((a - b).abs()))
    }
}

/// Single stiffness of a pair of steel teeth per width (N/m²): 14 N/(mm µm), ISO 6336-1.
const STIFFNESS_PER_WIDTH: f64 = 14e9;

/// Deflection of one pair under the whole nominal load (m). A tooth that lags by more carries
/// nothing where two pairs should share; then the load decides how many teeth touch, and no law of
/// load holds.
fn deflection_m(gear: GearAt, bench: &Bench) -> f64 {
    let width_m = 1e-3 * bench.stages[gear.stage].face_width_mm;
    let stiffness = STIFFNESS_PER_WIDTH * bench.gear_material.youngs_modulus_pa / 206e9;
    nominal_mesh_force_n(bench, gear.stage) / (stiffness * width_m)
}

/// A cumulative pitch error by tooth (m): independent steps from tooth to tooth that close over the
/// revolution, scaled to the peak to peak value. The pattern number chooses among repeatable
/// patterns.
fn pattern(teeth: u32, number: u64, total_m: f64) -> Vec<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(number);
    let steps: Vec<f64> = (0..teeth).map(|_| random.random_range(-1.0..1.0)).collect();
    let mean = steps.iter().sum::<f64>() / f64::from(teeth);
    let mut sum = 0.0;
    let mut out: Vec<f64> = steps
        .iter()
        .map(|step| {
            sum += step - mean;
            sum
        })
        .collect();
    let (low, high) = out.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), &x| (l.min(x), h.max(x)));
    for value in &mut out {
        *value = (*value - 0.5 * (low + high)) * total_m / (high - low);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::pattern;

    #[test]
    fn analytic_the_pattern_spans_its_total() {
        for (teeth, number) in [(5, 0), (34, 1), (100, 77)] {
            let errors = pattern(teeth, number, 20e-6);
            let high = errors.iter().copied().fold(f64::MIN, f64::max);
            let low = errors.iter().copied().fold(f64::MAX, f64::min);
            assert!((high - low - 20e-6).abs() < 1e-18);
            assert_eq!(errors, pattern(teeth, number, 20e-6), "repeatable");
        }
        assert_ne!(pattern(34, 1, 1.0), pattern(34, 2, 1.0));
    }
}
