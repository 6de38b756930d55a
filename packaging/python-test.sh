#!/usr/bin/env bash
# Builds the wheel, installs it into an empty environment, tests it against the command line, and with `notebooks` runs the notebooks too:
# packaging/python-test.sh [notebooks]. GEARWATCH_BINARY names a built command; without it one is built.
set -euo pipefail
cd "$(dirname "$0")/.."
packaging/wheel.sh
if [ -z "${GEARWATCH_BINARY:-}" ]; then
  cargo build --quiet --package gearwatch
  GEARWATCH_BINARY=$PWD/target/debug/gearwatch
fi
export GEARWATCH_BINARY
environment=target/python/environment
rm -rf "$environment"
python3 -m venv "$environment"
wheel=$(ls -t target/wheels/gearwatch-*.whl | head -1)
"$environment/bin/pip" install --quiet "$wheel[test]"
"$environment/bin/python" -m pytest -q crates/python/tests
if [ "${1:-}" = notebooks ]; then
  "$environment/bin/pip" install --quiet "$wheel[notebooks]"
  "$environment/bin/python" crates/python/notebooks/run.py target/python/notebooks
fi
