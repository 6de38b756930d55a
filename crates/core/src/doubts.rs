//! What is doubtful about sheet, recording or baseline, as verdicts carry it: found out once,
//! before the first verdict or soon after.

use std::sync::{Arc, OnceLock};

/// Words of findings with a space between. Clones share it, and reading takes no lock.
#[derive(Clone, Debug)]
pub struct Doubts {
    none: Arc<str>,
    known: Arc<OnceLock<Arc<str>>>,
}

impl Default for Doubts {
    fn default() -> Self {
        Self { none: Arc::from(""), known: Arc::default() }
    }
}

impl Doubts {
    /// These are the doubts from now on. Said twice, the first holds.
    pub fn set(&self, words: &str) {
        // Whoever was first has said it.
        let _ = self.known.set(Arc::from(words));
    }

    /// What is known of them; empty as long as nothing is.
    pub fn words(&self) -> &Arc<str> {
        self.known.get().unwrap_or(&self.none)
    }
}
