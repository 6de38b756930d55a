//! Growth of wear, cracks and pits: against closed forms, published figures, and themselves.

mod helical;
mod laws;
mod runs;
