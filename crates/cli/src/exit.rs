//! Exit codes. One meaning each, the same for all commands.

/// How a command ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Exit {
    /// Done; within limits.
    Ok = 0,
    /// Warning: a resolved deviation of rank I to III. Of file commands: failed.
    Warning = 1,
    /// Critical: a resolved deviation of rank IV or V.
    Critical = 2,
    /// Unknown, usage error, bad input, or finished with loss.
    Unknown = 3,
    /// The service cannot go on by itself and must be started anew (`EX_SOFTWARE`).
    Broken = 70,
}
