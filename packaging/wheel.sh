#!/usr/bin/env bash
# Builds the Python wheel into target/wheels: packaging/wheel.sh [further arguments of maturin]
set -euo pipefail
cd "$(dirname "$0")/.."
exec maturin build --release --locked --manifest-path crates/python/Cargo.toml --target-dir target/python --out target/wheels "$@"
