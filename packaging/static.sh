#!/usr/bin/env bash
# Builds one file that runs on any x86-64 Linux, without a C library of the system: packaging/static.sh
# Needs musl-tools, and `rustup target add x86_64-unknown-linux-musl`. The allocator of long services is for glibc only.
set -euo pipefail
cd "$(dirname "$0")/.."
features=$(sed -n 's/^full = \[\(.*\)\]$/\1/p' crates/cli/Cargo.toml | tr -d '" ' | tr ',' '\n' | grep -vx jemalloc | paste -sd,)
export CC_x86_64_unknown_linux_musl=musl-gcc
cargo build --release --locked --package gearwatch --features "$features" --target x86_64-unknown-linux-musl
