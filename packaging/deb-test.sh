#!/usr/bin/env bash
# Installs a Debian package into an empty root, runs what it installed, and removes it again: packaging/deb-test.sh FILE.deb
# Nothing of this machine is touched; the maintainer scripts see DPKG_ROOT and leave systemd alone.
set -euo pipefail
deb=$(readlink -f "${1:?FILE.deb}")
root=$(mktemp -d)
trap 'rm -rf "$root"' EXIT
mkdir -p "$root"/var/lib/dpkg/{info,updates} "$root/var/lib/gearwatch" "$root/run/gearwatch"
touch "$root/var/lib/dpkg/status" "$root/var/log.dpkg"
dpkg() { command dpkg --root="$root" --log="$root/var/log.dpkg" --force-not-root --force-depends --force-script-chrootless "$@"; }
fail() { echo "deb-test: $*" >&2; exit 1; }

dpkg --install "$deb" >/dev/null 2>&1 || fail "it cannot be installed"
gearwatch=$root/usr/bin/gearwatch
"$gearwatch" --version
# The configuration as the unit checks it, with its folders inside the root.
sed -i "s|/run/gearwatch|$root/run/gearwatch|; s|/var/lib/gearwatch|$root/var/lib/gearwatch|; s|127.0.0.1:8650|127.0.0.1:18650|" "$root/etc/gearwatch/service.toml"
"$gearwatch" config check "$root/etc/gearwatch/service.toml" >/dev/null || fail "the configuration that comes along is refused"
bash -n "$root/usr/share/bash-completion/completions/gearwatch" || fail "the completions of bash are no script"
gunzip -c "$root/usr/share/man/man1/gearwatch-run.1.gz" | grep -q '^\.TH' || fail "there is no manual page of run"
if command -v systemd-analyze >/dev/null; then
  sed "s|/usr/bin/gearwatch|$gearwatch|" "$root/usr/lib/systemd/system/gearwatch.service" > "$root/gearwatch.service"
  systemd-analyze verify --man=no "$root/gearwatch.service" || fail "the unit is refused"
  rm "$root/gearwatch.service"
fi
"$gearwatch" run --config "$root/etc/gearwatch/service.toml" >/dev/null 2>"$root/talk" &
service=$!
for _ in $(seq 600); do
  "$gearwatch" status --socket "$root/run/gearwatch/status.sock" >/dev/null 2>&1 && break
  [ $? -le 3 ] && [ -S "$root/run/gearwatch/status.sock" ] && break
  kill -0 "$service" 2>/dev/null || fail "the service has ended: $(cat "$root/talk")"
  sleep 0.2
done
[ -S "$root/run/gearwatch/status.sock" ] || fail "the service does not answer: $(cat "$root/talk")"
sleep 2
kill -TERM "$service"
wait "$service" || fail "it did not stop in order: $(cat "$root/talk")"
ls "$root"/var/lib/gearwatch/*.mcap >/dev/null || fail "there is no log"

dpkg --purge gearwatch >/dev/null 2>&1 || fail "it cannot be removed"
left=$(find "$root" -type f ! -path "$root/var/lib/*" ! -path "$root/talk" ! -path "$root/var/log.dpkg")
[ -z "$left" ] || fail "left behind: $left"
ls "$root"/var/lib/gearwatch/*.mcap >/dev/null || fail "the recordings are gone"
echo "installed, run, removed; the log stays"
