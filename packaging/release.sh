#!/usr/bin/env bash
# Makes all files of a release in target/release-files, with their checksums: packaging/release.sh
# What this machine cannot build is said and left out; the workflow of the host builds it elsewhere.
set -euo pipefail
cd "$(dirname "$0")/.."
out=$PWD/target/release-files
version=$(sed -n '/^\[workspace.package\]/,/^\[/s/^version = "\(.*\)"/\1/p' Cargo.toml)
rm -rf "$out" && mkdir -p "$out"
SOURCE_DATE_EPOCH=$(git log -1 --format=%ct)
export SOURCE_DATE_EPOCH
packaging/build.sh --features full
packaging/sbom.sh "$out/gearwatch-$version.cdx.json"
packaging/deb.sh target/release/gearwatch "$out"

bundle() {
  local name=gearwatch-$version-$1 binary=$2
  local folder=target/$name
  rm -rf "$folder" && mkdir -p "$folder"
  cp "$binary" README.md CHANGELOG.md LICENSE-MIT LICENSE-APACHE packaging/gearwatch.service packaging/service.toml "$folder"
  tar --sort=name --mtime="@$SOURCE_DATE_EPOCH" --owner=0 --group=0 --numeric-owner -C target -cf - "$name" | gzip -9n > "$out/$name.tar.gz"
}
bundle x86_64-linux target/release/gearwatch
if command -v musl-gcc >/dev/null && rustc --print target-libdir --target x86_64-unknown-linux-musl 2>/dev/null | xargs ls >/dev/null 2>&1; then
  packaging/static.sh
  bundle x86_64-linux-static target/x86_64-unknown-linux-musl/release/gearwatch
else
  echo "left out: the static build (musl-tools, rustup target add x86_64-unknown-linux-musl)"
fi
(cd "$out" && sha256sum -- * > SHA256SUMS)
cat "$out/SHA256SUMS"
