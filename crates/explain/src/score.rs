//! One table of hypotheses, one score: which physics, at which place, accounts for what changed against the reference.
//!
//! [`changes`] tables the likelihood of all changes, [`paths`] that of a changed path, [`table`] lists what may have happened, [`posterior`] weighs it, [`search`] asks for one effect
//! and then for a second beside it, [`twins`] says how often an unchanged bench gains as much. What was learned stands in [`calibration`].

pub mod calibration;
pub mod changes;
pub mod entry;
pub mod evidence;
pub mod paths;
pub mod posterior;
pub mod relation;
pub mod search;
pub mod table;
pub mod twins;
