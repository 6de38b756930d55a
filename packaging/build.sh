#!/usr/bin/env bash
# Builds the program as it is released: packaging/build.sh [CARGO'S ARGUMENTS], such as --features full
# Two builds of one commit are the same bytes, whatever folder they are made in (packaging/reproducible.sh): no path and no time of the machine
# gets into the program. It holds the list of its dependencies where the tool for that is there.
set -euo pipefail
cd "$(dirname "$0")/.."
target=${CARGO_TARGET_DIR:-$PWD/target}
cargo_home=${CARGO_HOME:-$HOME/.cargo}
sources=$(rustc --print sysroot)/lib/rustlib/src/rust
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct)}
# Where several match, the last one counts.
places=("$PWD=." "$target=target" "$cargo_home=cargo" "$sources=rust")
for place in "${places[@]}"; do
  RUSTFLAGS="${RUSTFLAGS:-} --remap-path-prefix=$place"
  CFLAGS="${CFLAGS:-} -ffile-prefix-map=$place"
done
# It starts on machines with an older C library, too (crates/cli/build.rs).
export GEARWATCH_PORTABLE=1
export SOURCE_DATE_EPOCH RUSTFLAGS CFLAGS CXXFLAGS="${CXXFLAGS:-} $CFLAGS"

build=(cargo build)
if command -v cargo-auditable >/dev/null; then
  build=(cargo auditable build)
else
  echo "left out: the list of dependencies inside the program (cargo install cargo-auditable)"
fi
"${build[@]}" --release --locked --package gearwatch "$@"
