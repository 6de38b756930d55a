//! The engine: packets in, verdicts out, in order, whatever the number of workers.
//!
//! ```text
//!  packets ─► gw-cut  ──jobs──►  gw-fft-0 … gw-fft-n  ──done──►  gw-rank  ─► events
//!            (assemble)          (spectra, any order)           (reorder, judge)
//!                ▲                                                  │
//!                └──────────────── empty carriers ◄─────────────────┘
//! ```
//!
//! A [`Pool`] of named threads does the spectra of all benches; each bench has a [`Lane`] with a
//! thread that cuts windows and one that judges them in the order in which they were cut. Windows
//! travel in a fixed number of carriers, which makes every queue of the engine bounded. When all
//! carriers are under way, a lane of patient sources waits; a lane with a live source waits while
//! there is room for its packets, and then sheds whole windows, counts them and says which. All
//! threads are apart from tokio, so that nothing that waits for a network can hold up ranks.

mod lane;
mod load;
mod pool;

pub use lane::{Lane, LaneCounters, LaneDied, LaneHandle, Overloaded, Shed, Told};
pub use load::{Load, Measured};
pub use pool::Pool;
