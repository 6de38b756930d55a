//! The command `gearwatch`.

use std::process::ExitCode;

/// The system's allocator gives every thread an arena of its own out of sixteen and more, and keeps
/// there what the thread has freed: with each reload other threads leave their peaks in other
/// arenas, and resident memory creeps up although no more is in use. This one gives back at once
/// what is free (`.cargo/config.toml`). Commands that compute and end keep it (`memory.rs`).
#[cfg(all(feature = "jemalloc", target_os = "linux", target_env = "gnu"))]
#[global_allocator]
static ALLOCATOR: tikv_jemallocator::Jemalloc = tikv_jemallocator::Jemalloc;

fn main() -> ExitCode {
    gearwatch::dispatch(std::env::args_os())
}
