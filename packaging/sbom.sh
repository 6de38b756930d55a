#!/usr/bin/env bash
# Writes the bill of materials of the program as it is released, CycloneDX 1.5 JSON: packaging/sbom.sh FILE
set -euo pipefail
cd "$(dirname "$0")/.."
file=${1:?FILE}
if ! command -v cargo-cyclonedx >/dev/null; then
  echo "left out: the bill of materials (cargo install cargo-cyclonedx)"
  exit 0
fi
cargo cyclonedx --quiet --manifest-path crates/cli/Cargo.toml --features full --format json --spec-version 1.5 --describe binaries
mkdir -p "$(dirname "$file")"
# Names of crates of this workspace carry its path.
sed "s|path+file://$PWD|path+file://.|g" crates/cli/gearwatch_bin.cdx.json > "$file"
rm crates/cli/gearwatch_bin.cdx.json
echo "$file"
