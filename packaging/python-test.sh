#!/usr/bin/env bash
# Builds the wheel, installs it into an empty environment, tests it against the command line, and with `notebooks` runs the notebooks too:
# packaging/python-test.sh [--dev] [notebooks]. GEARWATCH_BINARY names a built command; without it one is built. With --dev the package is built in
# the development profile beside the workspace's own crates: quick to build, slow to run.
set -euo pipefail
cd "$(dirname "$0")/.."
environment=target/python/environment
wheels=target/wheels
if [ "${1:-}" = --dev ]; then
  shift
  wheels=target/python/dev-wheels
  rm -rf "$wheels"
  maturin build --quiet --locked --manifest-path crates/python/Cargo.toml --target-dir "${CARGO_TARGET_DIR:-target}" --out "$wheels"
else
  packaging/wheel.sh
fi
if [ -z "${GEARWATCH_BINARY:-}" ]; then
  cargo build --quiet --workspace --bin gearwatch
  GEARWATCH_BINARY=${CARGO_TARGET_DIR:-$PWD/target}/debug/gearwatch
fi
export GEARWATCH_BINARY
rm -rf "$environment"
python3 -m venv "$environment"
wheel=$(ls -t "$wheels"/gearwatch-*.whl | head -1)
"$environment/bin/pip" install --quiet "$wheel[test]"
"$environment/bin/python" -m pytest -q crates/python/tests
if [ "${1:-}" = notebooks ]; then
  "$environment/bin/pip" install --quiet "$wheel[notebooks]"
  "$environment/bin/python" crates/python/notebooks/run.py target/python/notebooks
fi
