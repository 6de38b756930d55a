//! Sources with a network or a C library: against emulated instruments that behave, and that do
//! not.

mod frames;
mod iio;
mod lanxi;
mod nidaqmx;
mod opcua;
mod support;
