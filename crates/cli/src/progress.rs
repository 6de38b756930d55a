//! How far work of many parts has come: a bar where stderr is a terminal, elsewhere a line every
//! tenth, as a log wants it.

use std::io::Write;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use crate::terminal;

/// What is over within this time needs no lines.
const WORTH_A_LINE: Duration = Duration::from_secs(10);

/// Counts finished parts, from any thread.
pub struct Progress {
    what: String,
    total: u64,
    done: AtomicU64,
    begin: Instant,
    bar: ProgressBar,
}

impl Progress {
    /// Of so many parts; `what` they are, such as `cases`.
    pub fn new(what: impl Into<String>, total: u64) -> Self {
        let (what, bar) = (what.into(), ProgressBar::new(total));
        if let Ok(style) = ProgressStyle::with_template("{prefix} {wide_bar} {pos}/{len} {eta}  {msg}") {
            bar.set_style(style);
        }
        bar.set_prefix(what.clone());
        Self { what, total, done: AtomicU64::new(0), begin: Instant::now(), bar }
    }

    /// One more part is finished; `name` of it, where it has one.
    pub fn finished(&self, name: &str) {
        let done = 1 + self.done.fetch_add(1, Ordering::Relaxed);
        if !self.bar.is_hidden() {
            self.bar.set_message(terminal::plain(name).into_owned());
            self.bar.inc(1);
        } else if is_tenth(done, self.total) && self.begin.elapsed() > WORTH_A_LINE {
            // Progress is a courtesy; a closed stderr is not an error.
            let _ = writeln!(terminal::err(), "{}: {done} of {}", self.what, self.total);
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// Whether this part completes another tenth of the whole.
fn is_tenth(done: u64, total: u64) -> bool {
    10 * done / total > 10 * (done - 1) / total
}

#[cfg(test)]
mod tests {
    use super::is_tenth;

    #[test]
    fn analytic_ten_lines_or_one_a_part() {
        for (total, lines) in [(1, 1), (4, 4), (10, 10), (25, 10), (200, 10), (100_000, 10)] {
            assert_eq!((1..=total).filter(|&done| is_tenth(done, total)).count(), lines, "{total}");
            assert!(is_tenth(total, total));
        }
    }
}
