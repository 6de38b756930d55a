//! Sources with a network: against emulated instruments that behave, and that do not.

mod lanxi;
mod support;
