//! Peers that mean harm: what they say, and for how long, must not take more than a bounded amount
//! of memory.

#![expect(clippy::print_stdout, reason = "campaigns tell figures")]

mod nats;
