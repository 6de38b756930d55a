#!/usr/bin/env bash
# Builds the last commit twice, in two folders, and compares the bytes: packaging/reproducible.sh [FOLDER] [CARGO'S ARGUMENTS], such as --features full
# Exit code 0 where both builds are the same. FOLDER (a new one under /tmp where left out) keeps what differs.
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:-$(mktemp -d)}
shift || true
mkdir -p "$folder"
SOURCE_DATE_EPOCH=$(git log -1 --format=%ct)
export SOURCE_DATE_EPOCH
built=()
# Names of different lengths: what depends on the path moves everything behind it.
for name in a another-folder-with-a-longer-name; do
  place=$folder/$name
  mkdir -p "$place"
  git archive HEAD | tar -x -C "$place"
  echo "building in $place"
  CARGO_TARGET_DIR=$place/out "$place/packaging/build.sh" "$@" --quiet
  built+=("$place/out/release/gearwatch")
done
sha256sum "${built[@]}"
for binary in "${built[@]}"; do
  for place in "$folder" "${CARGO_HOME:-$HOME/.cargo}/registry"; do
    if grep -aqF "$place" "$binary"; then
      echo "$binary names $place" >&2
      exit 1
    fi
  done
done
if ! cmp "${built[@]}"; then
  echo "two builds of $(git rev-parse --short HEAD) differ" >&2
  exit 1
fi
echo "two builds of $(git rev-parse --short HEAD) are the same $(stat -c %s "${built[0]}") bytes"
