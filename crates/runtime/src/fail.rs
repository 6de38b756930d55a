//! Points at which a test lets a task of the real binary panic. Builds without debug assertions
//! have none.
//!
//! `GEARWATCH_FAIL=<point>=<file>` in the environment: the task panics when it comes to the point
//! while the file is there, and removes it before, so that it happens once.

/// Panics if a test asks for it.
#[cfg(not(debug_assertions))]
#[inline(always)]
pub fn point(_: &str) {}

/// Panics if a test asks for it.
#[cfg(debug_assertions)]
pub fn point(name: &str) {
    use std::path::PathBuf;
    use std::sync::OnceLock;
    static ASKED: OnceLock<Option<(String, PathBuf)>> = OnceLock::new();
    let asked = ASKED.get_or_init(|| {
        let text = std::env::var("GEARWATCH_FAIL").ok()?;
        text.split_once('=').map(|(point, file)| (point.to_owned(), PathBuf::from(file)))
    });
    if let Some((point, file)) = asked
        && point == name
        && std::fs::remove_file(file).is_ok()
    {
        panic!("a test asked for a failure at {name}");
    }
}

/// A task that does nothing but to panic if a test asks for it.
pub async fn watch(name: &str) {
    if cfg!(debug_assertions) {
        loop {
            tokio::time::sleep(std::time::Duration::from_millis(50)).await;
            point(name);
        }
    }
    std::future::pending().await
}
