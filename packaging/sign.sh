#!/usr/bin/env bash
# Signs the checksums of a release with an SSH key, or checks them:
#   packaging/sign.sh KEY [FOLDER]             writes SHA256SUMS.sig; KEY is a private key, or a public one whose private half an agent or a token holds
#   packaging/sign.sh --check SIGNERS [FOLDER] SIGNERS names who may sign (ssh-keygen(1), ALLOWED SIGNERS); every file must be as it was signed
# FOLDER is target/release-files where left out. SECURITY.md says whose keys count.
set -euo pipefail
namespace=gearwatch-release
if [ "${1:-}" = --check ]; then
  signers=$(readlink -f "${2:?SIGNERS}")
  cd "${3:-target/release-files}"
  [ -f SHA256SUMS.sig ] || { echo "there is no SHA256SUMS.sig: this release is not signed" >&2; exit 1; }
  who=$(ssh-keygen -Y find-principals -f "$signers" -s SHA256SUMS.sig) || { echo "nobody whom $signers names has signed this" >&2; exit 1; }
  ssh-keygen -Y verify -f "$signers" -I "$who" -n $namespace -s SHA256SUMS.sig < SHA256SUMS
  sha256sum --check --strict --quiet SHA256SUMS
  # A file that nobody has signed is none of this release.
  for file in *; do
    case $file in SHA256SUMS | SHA256SUMS.sig) continue ;; esac
    awk '{ sub(/^\*/, "", $2); print $2 }' SHA256SUMS | grep -qxF "$file" || { echo "$file is not in SHA256SUMS" >&2; exit 1; }
  done
  echo "all files are as $who has signed them"
else
  key=$(readlink -f "${1:?KEY}")
  cd "${2:-target/release-files}"
  sha256sum --check --strict --quiet SHA256SUMS
  rm -f SHA256SUMS.sig
  ssh-keygen -Y sign -q -f "$key" -n $namespace SHA256SUMS
  echo "$PWD/SHA256SUMS.sig"
fi
