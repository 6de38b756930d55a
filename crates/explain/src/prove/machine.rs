//! The real bench behind a sheet, and the housing that the sheet does not know.

use gearwatch_core::bench::{Bench, EffectSpec};
use gearwatch_sim::effects;
use gearwatch_sim::mesh::MeshOptions;
use gearwatch_sim::setup::SimSetup;
use num_complex::Complex64;

use super::draw::{Draw, spec};

/// Modes of the unknown housing.
const MODES: usize = 6;

/// The real bench behind a sheet; `errors` is the share of the usual tooth errors that it has.
pub fn real(d: &mut Draw, sheet: &Bench, errors: f64) -> SimSetup {
    let mut bench = sheet.clone();
    for s in &mut bench.shafts {
        s.bearing_n_per_m = d.near(s.bearing_n_per_m, 0.12);
        s.torsion_nm_per_rad = d.near(s.torsion_nm_per_rad, 0.12);
        s.bearing_damping_n_s_per_m = d.near(s.bearing_damping_n_s_per_m, 0.3);
        s.inertia_kg_m2 = d.near(s.inertia_kg_m2, 0.03);
    }
    for s in &mut bench.stages {
        s.mesh_damping_ratio = d.near(s.mesh_damping_ratio, 0.3);
    }
    let mut setup = SimSetup::nominal(&bench);
    setup.mesh = MeshOptions { body_coupling: None, ..MeshOptions::classical() };
    // The steady state needs tooth pairs that take up load gradually.
    setup.mesh.corner_contact = true;
    let names: Vec<String> = bench.stages.iter().map(|s| s.name.clone()).collect();
    for (i, name) in names.iter().enumerate() {
        let mut usual = vec![spec(
            "profile_error",
            name.clone(),
            &[
                ("e1_um", d.uniform(0.2, 1.0)),
                ("e2_um", d.uniform(0.1, 0.5)),
                ("e3_um", d.uniform(0.05, 0.3)),
                ("phase1_deg", d.uniform(0.0, 360.0)),
                ("phase2_deg", d.uniform(0.0, 360.0)),
            ],
        )];
        for which in ["pinion", "wheel"] {
            let place = format!("{name}.{which}");
            usual.push(spec(
                "pitch_error",
                place.clone(),
                &[("total_um", errors * d.uniform(8.0, 16.0)), ("pattern", f64::from(d.whole(1000, 9000)))],
            ));
            usual.push(spec(
                "eccentricity",
                place,
                &[("runout_um", errors * d.uniform(4.0, 9.0)), ("phase_deg", d.uniform(0.0, 360.0))],
            ));
        }
        for u in usual {
            // A usual error that does not suit a drawn gear is left out, as a better gear would.
            let _ = effects::apply(&u, &mut setup);
        }
        if let Some(teeth) = setup.teeth.get_mut(i) {
            teeth.pair.stiffness_factor = d.near(1.0, 0.12);
        }
    }
    // A little unbalance of every shaft and a little ripple of the brake.
    let mut usual: Vec<EffectSpec> = bench
        .shafts
        .iter()
        .map(|s| spec("unbalance", s.name.clone(), &[("amount_kg_m", d.uniform(1e-5, 6e-5))]))
        .collect();
    usual.push(spec("torque_ripple", "brake".into(), &[("order", 1.0), ("depth_percent", d.uniform(0.2, 0.8))]));
    for u in usual {
        let _ = effects::apply(&u, &mut setup);
    }
    setup
}

/// Response of the unknown housing between bearing and sensor.
pub struct Housing(pub Vec<(f64, f64, Complex64)>);

impl Housing {
    /// Modes between 300 Hz and 6 kHz.
    pub fn draw(d: &mut Draw) -> Self {
        let mut modes = Vec::new();
        for i in 0..MODES {
            let hz = 300.0 * (6000.0f64 / 300.0).powf((i as f64 + d.uniform(0.0, 1.0)) / MODES as f64);
            modes.push((hz, d.uniform(0.012, 0.03), Complex64::new(d.normal(), 0.0) * 0.15));
        }
        Self(modes)
    }

    /// Response at a frequency.
    pub fn at(&self, hz: f64) -> Complex64 {
        self.0.iter().fold(Complex64::new(1.0, 0.0), |sum, (f, zeta, size)| {
            let r = hz / f;
            sum + size * r * r / Complex64::new(1.0 - r * r, 2.0 * zeta * r)
        })
    }
}

/// What the sensor and its chain do to a spectrum by an effect at this place.
pub fn sensor_factor(effects: &[EffectSpec], sensor: &str, hz: f64) -> Complex64 {
    let one = Complex64::new(1.0, 0.0);
    effects.iter().filter(|e| e.place == sensor).fold(one, |product, e| product * factor(e, hz))
}

fn factor(e: &EffectSpec, hz: f64) -> Complex64 {
    let one = Complex64::new(1.0, 0.0);
    let value = |k: &str| e.parameters.get(k).copied().unwrap_or(1.0);
    match e.effect.as_str() {
        "scaling" => one * value("factor"),
        "sensor_mounting" => {
            let r = hz / value("frequency_hz");
            value("gain") / Complex64::new(1.0 - r * r, 0.12 * r)
        }
        "structural_resonance" => {
            let r = hz / value("frequency_hz");
            one + value("gain") * r * r / Complex64::new(1.0 - r * r, 2.0 * value("damping_ratio") * r)
        }
        _ => one,
    }
}
