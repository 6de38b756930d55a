//! The mismatch finder in Python.

use std::sync::Arc;

use gearwatch_core::recording::Recording as Whole;
use gearwatch_explain::explain::Input;
use pyo3::prelude::*;

use crate::bench::Bench;
use crate::failure::Failure;
use crate::recording::Recording;
use crate::work::interruptible;

/// Where the simulation of a bench and its recordings differ, and which physics was left out:
/// explanation.json as text, and the bench with the named effects in it.
#[pyfunction]
#[pyo3(signature = (bench, recordings, reference=None, *, progress=None))]
pub fn explain(
    py: Python<'_>,
    bench: &Bench,
    recordings: Vec<Bound<'_, Recording>>,
    reference: Option<Vec<Bound<'_, Recording>>>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<(String, Bench)> {
    // Which recording is held out must not depend on the order in which they are named.
    let whole = |mut all: Vec<(String, Arc<Whole>)>| {
        all.sort_by(|a, b| a.0.cmp(&b.0));
        all.into_iter().map(|(_, whole)| Whole::clone(&whole)).collect::<Vec<_>>()
    };
    let take = |all: &[Bound<'_, Recording>]| {
        all.iter().map(|one| (one.get().label.clone(), one.get().whole().clone())).collect::<Vec<_>>()
    };
    let (recordings, reference) = (take(&recordings), take(&reference.unwrap_or_default()));
    let (inner, path) = (bench.inner.clone(), bench.path.clone());
    let (json, bench) = interruptible(py, progress, move |control| {
        for spec in &inner.effects {
            gearwatch_sim::effects::resolve(spec, &inner)?;
        }
        let reference: Vec<Whole> = reference.into_iter().map(|(_, whole)| Whole::clone(&whole)).collect();
        let recordings = whole(recordings);
        let input = Input { bench: &inner, recordings: &recordings, reference: &reference, without: &[] };
        let answer = gearwatch_explain::explain::explain(&input, &mut |step| control.step(step))?;
        let mut json = serde_json::to_string_pretty(&answer.explanation).map_err(Failure::from)?;
        json.push('\n');
        Ok((json, answer.bench))
    })?;
    Ok((json, Bench::of(bench, &path)))
}
