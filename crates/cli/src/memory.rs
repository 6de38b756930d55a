//! What the allocator does with memory that is free.
//!
//! The service gives it back at once, so that its resident memory stays that of its use over weeks
//! (`.cargo/config.toml`). A command that computes and ends would only fetch it again: the system
//! clears each page anew, and threads wait for the one that holds their arena.

/// From now on, free memory is kept for ten seconds, and threads keep a little of their own.
///
/// Of threads this holds for the one that calls and for those of rayon's common pool. Threads of
/// other pools call [`keep_in_this_thread`].
#[cfg(all(feature = "jemalloc", target_os = "linux", target_env = "gnu"))]
pub fn keep_what_is_free() {
    use tikv_jemalloc_ctl::{Access, AsName};
    /// jemalloc's own default (ms).
    const KEPT_MS: isize = 10_000;
    // Arenas that are made later, and those that there may be. One that is not made yet refuses,
    // and takes the first setting then.
    for name in ["arenas.dirty_decay_ms\0", "arena.0.dirty_decay_ms\0", "arena.1.dirty_decay_ms\0"] {
        let _ = name.name().write(KEPT_MS);
    }
    keep_in_this_thread();
    // Where the pool is there already, its threads go on as they are.
    let _ = rayon::ThreadPoolBuilder::new().start_handler(|_| keep_in_this_thread()).build_global();
}

/// From now on, this thread keeps some of what it frees.
#[cfg(all(feature = "jemalloc", target_os = "linux", target_env = "gnu"))]
pub fn keep_in_this_thread() {
    use tikv_jemalloc_ctl::{Access, AsName};
    let _ = "thread.tcache.enabled\0".name().write(true);
}

/// Nothing: the system's allocator keeps what is free.
#[cfg(not(all(feature = "jemalloc", target_os = "linux", target_env = "gnu")))]
pub fn keep_what_is_free() {}

/// Nothing: the system's allocator keeps what is free.
#[cfg(all(feature = "batch", not(all(feature = "jemalloc", target_os = "linux", target_env = "gnu"))))]
pub fn keep_in_this_thread() {}

#[cfg(all(test, feature = "jemalloc", target_os = "linux", target_env = "gnu"))]
mod tests {
    use tikv_jemalloc_ctl::{Access, AsName};

    /// The names are those that this jemalloc knows: a wrong one would be passed over in silence.
    #[test]
    fn conform_the_allocator_takes_the_settings() {
        super::keep_what_is_free();
        for name in ["arenas.dirty_decay_ms\0", "arena.0.dirty_decay_ms\0"] {
            let kept: isize = name.name().read().unwrap();
            assert_eq!(kept, 10_000, "{name}");
        }
        let caches: bool = "thread.tcache.enabled\0".name().read().unwrap();
        assert!(caches);
    }
}
