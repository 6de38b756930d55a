//! One signal to stop, for threads and tasks alike.

use std::time::{Duration, Instant};

use tokio_util::sync::CancellationToken;

/// How often a sleeping thread looks whether it should stop.
const LOOK: Duration = Duration::from_millis(20);

/// Tells all parts of the service to come to an end. Clones are the same signal; children end with
/// their parent.
#[derive(Clone, Debug, Default)]
pub struct Stop(CancellationToken);

impl Stop {
    /// A signal that ends with this one, and can be given on its own.
    pub fn child(&self) -> Self {
        Self(self.0.child_token())
    }

    /// Gives the signal.
    pub fn now(&self) {
        self.0.cancel();
    }

    /// It was given.
    pub fn is_given(&self) -> bool {
        self.0.is_cancelled()
    }

    /// Waits in a task until it is given.
    pub async fn given(&self) {
        self.0.cancelled().await;
    }

    /// Sleeps in a thread; `false` when the signal came meanwhile.
    pub fn sleep(&self, duration: Duration) -> bool {
        let end = Instant::now() + duration;
        loop {
            if self.is_given() {
                return false;
            }
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return true;
            }
            std::thread::sleep(left.min(LOOK));
        }
    }
}
