//! Formats that come over a network: byte vectors, any split, any bit flip.

mod frames;
mod lanxi;
