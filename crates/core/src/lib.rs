//! The signal path of gearwatch: from samples to rank codes, without files, sockets, threads or
//! clocks.
//!
//! ```text
//! Packet ─► assemble ─► Window ─► speed ─► order spectrum ─► harmonics ─► deviation ─► rank ─► Verdict
//!           (gaps, hop)           (tacho or refined)         (amplitude, sigma, floor)
//! ```
//!
//! Each stage is *config → plan → state*: `XConfig` is what a user may write, `X` is the immutable
//! plan that is made once from it, `XState` is what processing changes. The caller owns the
//! buffers, and the hot call does not allocate, lock, log or read a clock.
//!
//! Ranks come from the size of a deviation; its sign stays beside it:
//!
//! ```
//! use gearwatch_core::estimate::Estimate;
//! use gearwatch_core::rank::RankConfig;
//! use gearwatch_core::verdict::Rank;
//!
//! let ranks = RankConfig::default();
//! let fallen = Estimate { value: -5.0, sigma: 0.5 };
//! assert_eq!(ranks.rank_of(fallen.value), Rank::II);
//! // Rank II is 4 to 7 %; the nearer step is two sigma away.
//! assert!((ranks.probability_of(Rank::II, fallen) - 0.977).abs() < 1e-3);
//! ```

pub mod aggregate;
pub mod analysis;
pub mod assemble;
pub mod baseline;
pub mod bench;
pub mod block;
pub mod calendar;
pub mod deviation;
pub mod doubts;
pub mod estimate;
pub mod fourier;
pub mod health;
pub mod indicators;
pub mod judge;
pub mod one_shot;
pub mod order_spectrum;
pub mod pipeline;
mod pulses;
pub mod rank;
pub mod recording;
pub mod robust;
pub mod signature;
pub mod source;
pub mod spectral;
pub mod speed;
pub mod state;
pub mod train;
pub mod verdict;
pub mod window;

#[cfg(test)]
mod testing;
