//! Sources with a network: against emulated instruments that behave, and that do not.

mod examples;
mod frames;
mod iio;
mod lanxi;
mod nidaqmx;
mod operating_point;
mod several;
mod support;
