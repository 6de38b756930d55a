//! Real recordings of a gearbox simulator: `../shared/data/gfd_spectraquest` beside the checkout.
//! Skips where it is missing.

#![allow(clippy::print_stderr, reason = "the measured figures are shown with --nocapture")]

mod recordings;
mod speed_and_spread;
