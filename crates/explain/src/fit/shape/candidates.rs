//! The effects that share a mask, over grids of their sizes.

use std::collections::BTreeMap;

use gearwatch_core::bench::EffectSpec;

use crate::question::Question;

/// How an effect enters.
#[derive(Clone, Debug)]
pub enum Action {
    /// By the simulator's own effect.
    Simulated(EffectSpec),
    /// A geometric deviation of unknown form, this large in the first harmonic (m), the same at any
    /// load.
    Geometry(f64),
    /// A deviation of unknown form in proportion to the load: this share of the mean deflection.
    Stiffness(f64),
}

/// An effect at one size.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// Effect id.
    pub effect: &'static str,
    /// Place.
    pub place: String,
    /// Stage whose mesh it alters.
    pub stage: Option<usize>,
    /// By name.
    pub parameters: BTreeMap<String, f64>,
    /// How it enters.
    pub action: Action,
}

/// All candidates of a bench.
pub fn grid(q: &Question<'_>) -> Vec<Candidate> {
    let mut out = Vec::new();
    let mut simulated = |effect: &'static str, place: &str, stage: Option<usize>, values: &[(&str, f64)]| {
        let parameters: BTreeMap<String, f64> = values.iter().map(|(k, v)| ((*k).to_owned(), *v)).collect();
        out.push(Candidate {
            effect,
            place: place.to_owned(),
            stage,
            action: Action::Simulated(EffectSpec {
                effect: effect.to_owned(),
                place: place.to_owned(),
                parameters: parameters.clone(),
            }),
            parameters,
        });
    };
    for (i, stage) in q.train.stages.iter().enumerate() {
        let (name, at) = (stage.name.as_str(), Some(i));
        for depth in [3.0, 6.0, 10.0, 16.0, 25.0, 40.0] {
            for length in [0.15, 0.22, 0.3, 0.4] {
                simulated("tip_relief", name, at, &[("depth_um", depth), ("length_fraction", length)]);
            }
        }
        for depth in [5.0, 10.0, 20.0, 40.0, 80.0] {
            simulated("tooth_wear", name, at, &[("depth_um", depth)]);
        }
        for angle in [0.15, 0.3, 0.6, 1.2, 2.5] {
            simulated("misalignment", name, at, &[("angle_mrad", angle)]);
        }
        for exponent in [0.05, 0.1, 0.2, 0.35, 0.6] {
            simulated("load_dependent_stiffness", name, at, &[("exponent", exponent)]);
        }
        for factor in [0.45, 0.6, 0.75, 0.85, 0.93, 1.08, 1.18, 1.35, 1.6] {
            simulated("mesh_stiffness", name, at, &[("factor", factor)]);
        }
        for factor in [0.0, 0.3, 0.6, 1.3] {
            simulated("body_coupling", name, at, &[("factor", factor)]);
        }
        for factor in [0.25, 0.4, 0.6, 1.7, 2.5, 4.0] {
            simulated("damping", name, at, &[("factor", factor)]);
        }
    }
    for (shaft, _) in &q.train.shafts {
        for factor in [0.3, 0.45, 0.6, 0.75, 0.88, 1.15, 1.35, 1.8] {
            simulated("bearing_compliance", shaft, None, &[("factor", factor)]);
        }
        for factor in [0.25, 0.4, 0.6, 0.8, 0.9, 1.2, 1.6] {
            simulated("shaft_torsion", shaft, None, &[("factor", factor)]);
        }
        for factor in [0.25, 0.5, 2.0, 4.0] {
            simulated("damping", shaft, None, &[("factor", factor)]);
        }
    }
    for (i, stage) in q.train.stages.iter().enumerate() {
        for size_um in [1.0, 2.0, 4.0, 8.0] {
            out.push(Candidate {
                effect: "profile_error",
                place: stage.name.clone(),
                stage: Some(i),
                parameters: BTreeMap::from([("e1_um".to_owned(), size_um)]),
                action: Action::Geometry(size_um * 1e-6),
            });
        }
        for coefficient in [0.05, 0.1, 0.2] {
            out.push(Candidate {
                effect: "tooth_friction",
                place: stage.name.clone(),
                stage: Some(i),
                parameters: BTreeMap::from([("coefficient".to_owned(), coefficient)]),
                action: Action::Stiffness(coefficient),
            });
        }
    }
    out
}
