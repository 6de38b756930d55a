//! Growth of wear, cracks and pits: against closed forms, published figures, and themselves.

mod laws;
mod runs;
