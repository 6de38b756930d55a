//! The fitted model as a bench file holds it.
//!
//! Shafts, bearings and damping are numbers of the file. Stiffness and coupling of tooth pairs have effects of the library, the profile error that every pair has is a `[[term]]` over the mesh
//! cycle. The scatter of tooth spacing is not written: it is a mean over teeth that nobody measured, and no form of theirs.

use std::collections::BTreeMap;

use gearwatch_core::bench::term::{Expression, Harmonic};
use gearwatch_core::bench::{Bench, EffectSpec, Term};
use nalgebra::DVector;

use super::problem::{CHANGED, COUPLING_RANGE, Number, Problem};
use super::sheet;

impl Problem<'_> {
    /// The sheet with the numbers as fitted; what was named is not in it. A profile error that was named holds what every pair has in its harmonics.
    pub fn written(&self, x: &DVector<f64>) -> Bench {
        let mut bench = self.bench(x);
        sheet::drop_profile(&mut bench);
        let named = |stage: &str| self.specs.iter().any(|s| s.effect == "profile_error" && s.place == stage);
        let mut errors: BTreeMap<(usize, usize), [f64; 2]> = BTreeMap::new();
        for (number, value) in self.numbers.iter().zip(x.iter()) {
            let factor = |effect: &str, stage: usize, factor: f64| EffectSpec {
                effect: effect.to_owned(),
                place: self.q.bench.stages[stage].name.clone(),
                parameters: BTreeMap::from([("factor".to_owned(), factor)]),
            };
            match number {
                Number::Stiffness(i) => bench.effects.push(factor("mesh_stiffness", *i, value.exp())),
                Number::Coupling(i) => {
                    let value = value.clamp(COUPLING_RANGE.0, COUPLING_RANGE.1);
                    bench.effects.push(factor("body_coupling", *i, value));
                }
                Number::Error(i, h, part) => errors.entry((*i, *h)).or_default()[*part] += 1e-6 * value,
                _ => {}
            }
        }
        for (i, stage) in self.q.bench.stages.iter().enumerate() {
            let own = errors.range((i, 0)..(i + 1, 0)).filter(|((_, h), _)| *h >= CHANGED || !named(&stage.name));
            // The sine of a harmonic is that of the angle, the quadrature of a profile error is of its phase.
            let harmonics: Vec<Harmonic> =
                own.map(|((_, h), [cos, sin])| Harmonic { order: (h + 1) as f64, cos: *cos, sin: -sin }).collect();
            if harmonics.iter().any(|h| h.cos != 0.0 || h.sin != 0.0) {
                bench.terms.push(Term::series(Expression::Geometry, &stage.name, &harmonics));
            }
        }
        bench
    }
}
