//! What the answer is worth and what is said: controls, held-out recordings, what is left over, the
//! report.

pub mod added;
pub mod controls;
pub mod free_term;
pub mod held_out;
pub mod latent;
pub mod left_out;
pub mod limits;
pub mod misfit;
pub mod own_lines;
pub mod predict;
pub mod publish;
pub mod report;
pub mod twins;
