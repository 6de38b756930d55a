//! Where recordings differ from their reference: line by line, by masks of lines, within one turn
//! of a gear.

pub mod align;
pub mod comb;
pub mod compare;
pub mod frequency;
pub mod locate;
pub mod masks;
pub mod one_gear;
pub mod pulse;
