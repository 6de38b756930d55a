//! Sources with a network: against emulated instruments that behave, and that do not.

mod examples;
mod frames;
mod lanxi;
mod operating_point;
mod several;
mod support;
