//! The fitted model as a bench file holds it.
//!
//! Shafts, bearings and damping are numbers of the file. Stiffness and coupling of tooth pairs have
//! effects of the library, the profile error that every pair has is a `[[term]]` over the mesh
//! cycle. The scatter of tooth spacing is not written: it is a mean over teeth that nobody
//! measured, and no form of theirs. So the bench of the file has the pitch errors of the sheet, and
//! its other numbers are those that fit the lines best beside them.

use std::collections::BTreeMap;

use gearwatch_core::bench::term::{Expression, Harmonic};
use gearwatch_core::bench::{Bench, EffectSpec, Term};
use nalgebra::DVector;

use super::problem::{CHANGED, COUPLING_RANGE, Number, Problem};
use super::sheet;

impl Problem<'_> {
    /// The bench's own numbers that fit best where teeth are spaced as the sheet says, beside what
    /// was named; as they are where no fit gets there.
    fn as_spaced(&mut self, fitted: &DVector<f64>) -> DVector<f64> {
        let mut x = fitted.clone();
        let stated = sheet::spacing_um(self.q.bench);
        for (number, um) in self.numbers.iter().zip(x.iter_mut()) {
            if let Number::Spacing(i) = number {
                *um = stated[*i];
            }
        }
        let own =
            |n: &Number| !matches!(n, Number::Spacing(_) | Number::Effect(..) | Number::Changed(..) | Number::Term);
        let iterations = self.effort.iterations;
        let found = self.approach(x, &own, iterations);
        found.map_or_else(|| fitted.clone(), |(_, x)| x)
    }

    /// The sheet with the numbers as fitted; what was named is not in it. A profile error that was
    /// named holds what every pair has in its harmonics.
    pub fn written(&mut self, fitted: &DVector<f64>) -> Bench {
        let x = self.as_spaced(fitted);
        let mut bench = self.bench(&x);
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
            // The sine of a harmonic is that of the angle, the quadrature of a profile error is of
            // its phase.
            let harmonics: Vec<Harmonic> =
                own.map(|((_, h), [cos, sin])| Harmonic { order: (h + 1) as f64, cos: *cos, sin: -sin }).collect();
            if harmonics.iter().any(|h| h.cos != 0.0 || h.sin != 0.0) {
                bench.terms.push(Term::series(Expression::Geometry, &stage.name, &harmonics));
            }
        }
        bench
    }
}
