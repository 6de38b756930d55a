//! Bounded queues with a named policy for the moment when they are full, and counters of what that
//! cost.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What happens when a bounded queue is full.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum WhenFull {
    /// Whoever puts in waits: nothing is lost, and the slowest part sets the pace.
    Block,
    /// What would be put in is dropped and counted.
    DropNewest,
    /// What waits longest is dropped and counted.
    DropOldest,
}

/// What went through a queue. `entered = taken + dropped + waiting` holds at any time, to within
/// the items in hand.
#[derive(Debug, Default)]
pub struct QueueCounters {
    entered: AtomicU64,
    dropped: AtomicU64,
}

impl QueueCounters {
    /// Items offered to the queue so far.
    pub fn entered(&self) -> u64 {
        self.entered.load(Ordering::Relaxed)
    }

    /// Items that the policy dropped so far.
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }

    /// An item was taken out and could not be used.
    pub fn count_dropped(&self) {
        self.dropped.fetch_add(1, Ordering::Relaxed);
    }
}

/// Learns of each item that a policy drops.
type OnDrop<T> = Arc<dyn Fn(&T) + Send + Sync>;

/// The end where items are put in.
pub struct Outlet<T> {
    sender: async_channel::Sender<T>,
    when_full: WhenFull,
    counters: Arc<QueueCounters>,
    on_drop: Option<OnDrop<T>>,
}

impl<T> std::fmt::Debug for Outlet<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Outlet").field("when_full", &self.when_full).finish_non_exhaustive()
    }
}

impl<T> Clone for Outlet<T> {
    fn clone(&self) -> Self {
        let on_drop = self.on_drop.clone();
        Self { sender: self.sender.clone(), when_full: self.when_full, counters: self.counters.clone(), on_drop }
    }
}

/// The end where items are taken out: `recv().await` in a task, `recv_blocking()` in a thread.
pub type Inlet<T> = async_channel::Receiver<T>;

/// Nobody takes items out any more.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the queue is closed")]
pub struct Closed;

/// A queue of at most `capacity` items (at least 1).
pub fn bounded<T>(capacity: usize, when_full: WhenFull) -> (Outlet<T>, Inlet<T>) {
    let (sender, receiver) = async_channel::bounded(capacity.max(1));
    (Outlet { sender, when_full, counters: Arc::default(), on_drop: None }, receiver)
}

impl<T> Outlet<T> {
    /// Tells `on_drop` of each item that the policy drops.
    pub fn telling_drops(mut self, on_drop: impl Fn(&T) + Send + Sync + 'static) -> Self {
        self.on_drop = Some(Arc::new(on_drop));
        self
    }

    /// Puts an item in from a thread; waits only under [`WhenFull::Block`].
    ///
    /// # Errors
    /// When the other end is gone.
    pub fn put_blocking(&self, item: T) -> Result<(), Closed> {
        match self.offer(item)? {
            None => Ok(()),
            Some(item) => self.sender.send_blocking(item).map_err(|_| self.closed()),
        }
    }

    /// Puts an item in from a task; waits only under [`WhenFull::Block`].
    ///
    /// # Errors
    /// When the other end is gone.
    pub async fn put(&self, item: T) -> Result<(), Closed> {
        match self.offer(item)? {
            None => Ok(()),
            Some(item) => self.sender.send(item).await.map_err(|_| self.closed()),
        }
    }

    /// Puts an item in if there is room; what does not go in was never offered.
    pub fn put_if_room(&self, item: T) {
        if self.sender.try_send(item).is_ok() {
            self.counters.entered.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Applies the policy; hands the item back where the policy is to wait.
    fn offer(&self, item: T) -> Result<Option<T>, Closed> {
        use async_channel::TrySendError::{Closed as Shut, Full};
        self.counters.entered.fetch_add(1, Ordering::Relaxed);
        let dropped = match self.when_full {
            WhenFull::DropOldest => match self.sender.force_send(item) {
                Ok(oldest) => oldest,
                Err(_) => return Err(self.closed()),
            },
            WhenFull::Block | WhenFull::DropNewest => match self.sender.try_send(item) {
                Ok(()) => None,
                Err(Shut(_)) => return Err(self.closed()),
                Err(Full(item)) if self.when_full == WhenFull::Block => return Ok(Some(item)),
                Err(Full(item)) => Some(item),
            },
        };
        if let Some(item) = dropped {
            if let Some(tell) = &self.on_drop {
                tell(&item);
            }
            self.counters.dropped.fetch_add(1, Ordering::Relaxed);
        }
        Ok(None)
    }

    /// What nobody takes any more is lost, and counted like all else that is lost.
    fn closed(&self) -> Closed {
        self.counters.dropped.fetch_add(1, Ordering::Relaxed);
        Closed
    }

    /// Another end into the same queue, with a policy and counters of its own.
    pub fn branch(&self, when_full: WhenFull) -> Self {
        Self { sender: self.sender.clone(), when_full, counters: Arc::default(), on_drop: None }
    }

    /// Closes the queue: nothing more goes in, what is in it can still be taken out.
    pub fn close(&self) {
        self.sender.close();
    }

    /// Items waiting now.
    pub fn waiting(&self) -> usize {
        self.sender.len()
    }

    /// The counters, which live on when both ends are gone.
    pub fn counters(&self) -> &Arc<QueueCounters> {
        &self.counters
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drain(inlet: &Inlet<u32>) -> Vec<u32> {
        std::iter::from_fn(|| inlet.try_recv().ok()).collect()
    }

    /// Ten items into a queue of three: by policy, which three stay and how many are counted as
    /// dropped.
    #[test]
    fn analytic_each_policy_keeps_what_it_says_and_counts_the_rest() {
        for (when_full, kept) in [(WhenFull::DropNewest, vec![0, 1, 2]), (WhenFull::DropOldest, vec![7, 8, 9])] {
            let (outlet, inlet) = bounded(3, when_full);
            for i in 0..10 {
                outlet.put_blocking(i).unwrap();
            }
            assert_eq!(drain(&inlet), kept);
            assert_eq!((outlet.counters().entered(), outlet.counters().dropped()), (10, 7));
        }
    }

    #[test]
    fn analytic_a_blocking_queue_loses_nothing() {
        let (outlet, inlet) = bounded(2, WhenFull::Block);
        let writer = std::thread::spawn(move || {
            for i in 0..1000 {
                outlet.put_blocking(i).unwrap();
            }
            outlet.counters().dropped()
        });
        let mut taken = Vec::new();
        while let Ok(i) = inlet.recv_blocking() {
            taken.push(i);
        }
        assert_eq!(taken, (0..1000).collect::<Vec<u32>>());
        assert_eq!(writer.join().unwrap(), 0);
    }

    #[test]
    fn analytic_a_queue_without_taker_is_closed() {
        let (outlet, inlet) = bounded(2, WhenFull::Block);
        drop(inlet);
        assert_eq!(outlet.put_blocking(1_u32), Err(Closed));
    }
}
