//! Free-form terms of a bench file ([`gearwatch_core::bench::Term`]) where they enter the
//! simulator.

use gearwatch_core::bench::Term;
use gearwatch_core::bench::term::{Entry, Flanks, Growth, Harmonic, ResolvedTerm};

use crate::effects::problem::EffectError;
use crate::faults::{ToothModifications, Wave};
use crate::model::problem::ModelError;
use crate::rotation::Profile;
use crate::setup::{ModalFilter, SimSetup};

#[cfg(test)]
mod tests;

/// Least share of the reference load or speed at which a negative power is taken: a term never
/// grows beyond all bounds at rest.
const LEAST_SHARE: f64 = 0.01;

/// Adds a term to a setup.
///
/// # Errors
/// As [`Term::resolve`].
pub fn apply(term: &Term, setup: &mut SimSetup) -> Result<(), EffectError> {
    let resolved = term.resolve(&setup.bench)?;
    match &resolved.entry {
        Entry::Path { sensor, direct, modes } => {
            setup.sensors[*sensor].modal_filters.push(ModalFilter { direct: *direct, modes: modes.clone() });
        }
        _ => setup.terms.push(resolved),
    }
    Ok(())
}

/// How the size of a term follows load, speed, time and temperature.
#[derive(Clone, Debug)]
pub(crate) struct Scale {
    load_exponent: f64,
    speed_exponent: f64,
    growth: Growth,
    reference_nm: f64,
    reference_hz: f64,
}

impl Scale {
    pub(crate) fn new(term: &ResolvedTerm, setup: &SimSetup) -> Self {
        let growth = match term.entry {
            Entry::Spring { growth, .. } => growth,
            _ => Growth::default(),
        };
        let torque = setup.bench.brake.torque_nm;
        Self {
            load_exponent: term.load_exponent,
            speed_exponent: term.speed_exponent,
            growth,
            reference_nm: if torque > 0.0 { torque } else { 1.0 },
            reference_hz: setup.bench.motor.speed_hz,
        }
    }

    /// A factor of 1.
    pub(crate) fn fixed(setup: &SimSetup) -> Self {
        Self {
            load_exponent: 0.0,
            speed_exponent: 0.0,
            growth: Growth::default(),
            reference_nm: 1.0,
            reference_hz: setup.bench.motor.speed_hz,
        }
    }

    /// Factor on the term at a torque (N m), a motor speed (Hz), a temperature (°C) and a time
    /// since the start (s).
    pub(crate) fn at(&self, torque_nm: f64, motor_hz: f64, temperature_c: f64, t: f64) -> f64 {
        let mut out = power(torque_nm / self.reference_nm, self.load_exponent)
            * power(motor_hz / self.reference_hz, self.speed_exponent);
        if self.growth.rise_s > 0.0 {
            out *= 1.0 - (-t.max(0.0) / self.growth.rise_s).exp();
        }
        if let Some([from, to]) = self.growth.between_c {
            out *= (temperature_c - from) / (to - from);
        }
        out
    }

    /// The factor never changes in a run with these profiles.
    pub(crate) fn is_constant(&self, torque_nm: &Profile, motor_hz: &Profile, temperature_c: &Profile) -> bool {
        (self.load_exponent == 0.0 || torque_nm.is_constant())
            && (self.speed_exponent == 0.0 || motor_hz.is_constant())
            && (self.growth.between_c.is_none() || temperature_c.is_constant())
            && self.growth.rise_s == 0.0
    }
}

fn power(share: f64, exponent: f64) -> f64 {
    match exponent {
        0.0 => 1.0,
        e if e < 0.0 => share.max(LEAST_SHARE).powf(e),
        e => share.max(0.0).powf(e),
    }
}

/// `Σ cos · cos(order θ) + sin · sin(order θ)`.
pub(crate) fn series(harmonics: &[Harmonic], theta: f64) -> f64 {
    let of = |h: &Harmonic| {
        let (sin, cos) = (h.order * theta).sin_cos();
        h.cos * cos + h.sin * sin
    };
    harmonics.iter().map(of).sum()
}

/// The teeth of a stage with the geometry and stiffness terms of the setup at an operating point.
///
/// # Errors
/// Where such a term follows a load or speed that changes in the run: teeth are laid out once.
pub(crate) fn teeth_with_terms(
    setup: &SimSetup,
    stage: usize,
    torque_nm: &Profile,
    motor_hz: &Profile,
) -> Result<ToothModifications, ModelError> {
    let mut teeth = setup.teeth.get(stage).cloned().unwrap_or_default();
    for term in &setup.terms {
        let (flanks, harmonics, stiffness) = match &term.entry {
            Entry::Geometry(flanks, harmonics) => (flanks, harmonics, false),
            Entry::Stiffness(flanks, harmonics) => (flanks, harmonics, true),
            _ => continue,
        };
        let (Flanks::Mesh(at) | Flanks::Gear { stage: at, .. }) = *flanks;
        if at != stage {
            continue;
        }
        let scale = Scale::new(term, setup);
        if !scale.is_constant(torque_nm, motor_hz, &setup.temperature_c) {
            return Err(ModelError::Bench(format!(
                "a term on the teeth of stage {:?} follows a load or speed that changes during the run; simulate constant points, or set \
                 its load_exponent and speed_exponent to 0",
                setup.bench.stages[stage].name
            )));
        }
        let factor = scale.at(torque_nm.at(0.0), motor_hz.at(0.0), setup.temperature_c.at(0.0), 0.0);
        let scaled = harmonics.iter().map(|h| Harmonic { order: h.order, cos: factor * h.cos, sin: factor * h.sin });
        add_series(&mut teeth, *flanks, scaled.collect(), stiffness, setup.bench.stages[stage].pinion.teeth);
    }
    Ok(teeth)
}

fn add_series(teeth: &mut ToothModifications, flanks: Flanks, harmonics: Vec<Harmonic>, stiffness: bool, z1: u32) {
    if stiffness {
        match flanks {
            Flanks::Mesh(_) => teeth.pair.stiffness_waves.extend(harmonics),
            Flanks::Gear { wheel: false, .. } => teeth.pinion.stiffness_waves.extend(harmonics),
            Flanks::Gear { wheel: true, .. } => teeth.wheel.stiffness_waves.extend(harmonics),
        }
        return;
    }
    for h in harmonics {
        let (amplitude_m, phase_rad) = (h.cos.hypot(h.sin), (-h.sin).atan2(h.cos));
        match flanks {
            Flanks::Mesh(_) if h.order.fract() == 0.0 => {
                let at = h.order as usize - 1;
                let errors = &mut teeth.pair.profile_error;
                errors.resize(errors.len().max(at + 1), (0.0, 0.0));
                let (a, phase) = errors[at];
                let (re, im) = (a * phase.cos() + h.cos, a * phase.sin() - h.sin);
                errors[at] = (re.hypot(im), im.atan2(re));
            }
            // A part of the mesh cycle's order repeats with no gear's turn; as a wave on the pinion
            // it is any period.
            Flanks::Mesh(_) => {
                teeth.pinion.waves.push(Wave { order: h.order * f64::from(z1), amplitude_m, phase_rad });
            }
            Flanks::Gear { wheel, .. } => {
                let gear = if wheel { &mut teeth.wheel } else { &mut teeth.pinion };
                gear.waves.push(Wave { order: h.order, amplitude_m, phase_rad });
            }
        }
    }
}
