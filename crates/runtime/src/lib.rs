//! What every part of the service stands on, and no part owns.
//!
//! ```text
//! sources ─┐
//! log      ├─► stop     one signal to end, for threads and tasks
//! history  │   queue    bounded queues: what happens when they are full, and what it cost
//! fleet    │   backoff  how long to wait before the next try
//! sinks    │   clock    the wall clock, for stamps
//! page     ┘   kinds    tables of kinds: name, help, keys and their schema
//!              secret   what must not be printed
//!              tls      whose certificates are believed
//!              fail     points at which a test lets the real program fail
//! ```
//!
//! A queue says what it did with each item:
//!
//! ```
//! use gearwatch_runtime::queue::{WhenFull, bounded};
//!
//! let (outlet, inlet) = bounded(1, WhenFull::DropNewest);
//! outlet.put_blocking('a')?;
//! outlet.put_blocking('b')?;
//! assert_eq!(inlet.try_recv(), Ok('a'));
//! assert_eq!((outlet.counters().entered(), outlet.counters().dropped()), (2, 1));
//! # Ok::<(), gearwatch_runtime::queue::Closed>(())
//! ```

pub mod backoff;
pub mod clock;
pub mod fail;
pub mod kinds;
pub mod queue;
pub mod secret;
pub mod stop;
#[cfg(feature = "tls")]
pub mod tls;
