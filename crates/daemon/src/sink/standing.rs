//! How a sink stands, in its own words and figures: asked for whenever somebody looks, so that it is never stale.

use std::sync::{Arc, Mutex, PoisonError};

/// How a sink stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Standing {
    /// What it is given arrives where it belongs, or will arrive.
    pub ok: bool,
    /// In its own words.
    pub detail: String,
    /// Figures for the metrics, by name.
    pub figures: Vec<(&'static str, f64)>,
}

impl Default for Standing {
    /// A sink that says nothing has nothing to complain of.
    fn default() -> Self {
        Self { ok: true, detail: String::new(), figures: Vec::new() }
    }
}

/// Says how the sink stands.
type Say = Box<dyn Fn() -> Standing + Send>;

/// What a sink answers with when it is asked how it stands.
#[derive(Clone, Default)]
pub struct Voice(Arc<Mutex<Option<Say>>>);

impl std::fmt::Debug for Voice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Voice")
    }
}

impl Voice {
    /// From now on the sink answers with `say`.
    pub fn answer_with(&self, say: impl Fn() -> Standing + Send + 'static) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(Box::new(say));
    }

    /// Asks the sink.
    pub fn ask(&self) -> Standing {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).as_ref().map_or_else(Standing::default, |say| say())
    }
}
