//! What a gear pair may be given: each number's range, in a sentence.

use super::{MeshOptions, MeshProblem};
use crate::faults::ToothModifications;
use crate::hertz::Material;

pub(super) fn check(
    material: &Material,
    options: &MeshOptions,
    teeth: &ToothModifications,
    backlash_m: f64,
) -> Result<(), MeshProblem> {
    let within = |name: &'static str, found: f64, low: f64, high: f64, unit: &'static str| {
        if found >= low && found <= high {
            Ok(())
        } else {
            Err(MeshProblem::OutOfRange { name, found, low, high, unit })
        }
    };
    within("Young's modulus", material.youngs_modulus_pa, 1e8, 1e13, " Pa")?;
    within("Poisson's ratio", material.poisson_ratio, 0.0, 0.499, "")?;
    within("the backlash", backlash_m, 0.0, 0.01, " m")?;
    let pair = &teeth.pair;
    within("the stiffness factor", pair.stiffness_factor, 0.01, 100.0, "")?;
    within("the misalignment", pair.misalignment_rad, -0.02, 0.02, " rad")?;
    within("the body coupling", options.body_coupling.unwrap_or(0.0) * pair.coupling_factor, 0.0, 0.95, "")?;
    within("the load exponent", pair.load_exponent, 0.0, 0.5, "")?;
    within("the reference load", pair.reference_load_n, crate::hertz::LEAST_LOAD_N, 1e7, " N")?;
    within("the coefficient of friction", pair.friction, 0.0, 0.5, "")?;
    within("the alternating pitch", pair.alternating_m, 0.0, 1e-3, " m")?;
    within("the offset of the flanks", pair.offset_m, -1e-3, 1e-3, " m")?;
    within("the wear depth", pair.wear_m, 0.0, 1e-3, " m")?;
    within("the wear beyond the pitch point over that before it", pair.recess_wear, 0.0, 100.0, "")?;
    for waves in [&pair.stiffness_waves, &teeth.pinion.stiffness_waves, &teeth.wheel.stiffness_waves] {
        let sum: f64 = waves.iter().map(|h| h.cos.hypot(h.sin)).sum();
        within("the sum of the stiffness terms' amplitudes", sum, 0.0, 0.9, "")?;
    }
    for (amplitude, angle) in &pair.profile_error {
        within("a profile error's amplitude", *amplitude, -1e-3, 1e-3, " m")?;
        within("a profile error's phase", *angle, -1e3, 1e3, " rad")?;
    }
    for gear in [&teeth.pinion, &teeth.wheel] {
        within("the eccentricity", gear.eccentricity_m, 0.0, 1e-3, " m")?;
        within("the eccentricity's phase", gear.eccentricity_phase_rad, -1e3, 1e3, " rad")?;
        for error in &gear.pitch_error_m {
            within("a pitch error", *error, -1e-3, 1e-3, " m")?;
        }
        for depth in gear.worn_m.iter().chain(gear.worn_bands_m.iter().flatten()) {
            within("a worn depth", *depth, 0.0, 1e-3, " m")?;
        }
        for wave in &gear.waves {
            within("a wave's order", wave.order, 1e-6, 1e5, "")?;
            within("a wave's amplitude", wave.amplitude_m, 0.0, 1e-3, " m")?;
            within("a wave's phase", wave.phase_rad, -1e3, 1e3, " rad")?;
        }
        if let Some(relief) = gear.tip_relief {
            within("the tip relief's depth", relief.depth_m, 0.0, 1e-3, " m")?;
            within("the tip relief's length / base pitch", relief.length_fraction, 1e-3, 1.0, "")?;
            within("the tip relief's power", f64::from(relief.power), 1.0, 4.0, "")?;
        }
    }
    Ok(())
}
