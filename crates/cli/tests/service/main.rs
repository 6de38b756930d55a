//! The binary as a user meets it: ranks that do not depend on the way, exit codes, signals, bad
//! input, help.

#![expect(clippy::print_stderr, reason = "tests tell what was skipped")]

mod bad_input;
mod checks;
mod exit_codes;
mod fixture;
mod hardening;
mod help;
mod identity;
mod operation;
mod own_log;
mod signals;
