#!/usr/bin/env bash
# Starts, breaks and stops packaging/gearwatch.service under a systemd of its own: packaging/systemd-test.sh BINARY [--watchdog]
# That systemd is the first process of namespaces of its own, with its own /etc, /run and /var/lib: nothing of this machine is touched, whether it runs
# systemd or not. Needs root, systemd and unshare; exit code 77 where they are missing. --watchdog waits for what becomes of a service that stands still.
set -euo pipefail

# The first process: covers the folders that the unit uses, and becomes systemd.
if [ "${1:-}" = --inside ]; then
  here=$2 binary=$3
  mount --make-rprivate /
  mount -t tmpfs tmpfs /run
  mkdir -p /run/systemd/system /run/lock
  mount -t tmpfs tmpfs /var/lib
  mount --bind "$here/etc" /etc
  mount --bind "$binary" "$here/bin/gearwatch"
  mount --rbind "$here/bin" /usr/local/bin
  # Systemd raises limits of the whole machine otherwise.
  mount --bind /proc/sys /proc/sys
  mount -o remount,ro,bind /proc/sys
  umount -R /sys/fs/cgroup
  mount -t cgroup2 cgroup2 /sys/fs/cgroup
  exec env -i container=gearwatch PATH="$PATH" SYSTEMD_UNIT_PATH="$here/units" SYSTEMD_LOG_TARGET=console /lib/systemd/systemd --system --unit=basic.target
fi

skip() { echo "skipped: $*"; exit 77; }
binary=$(readlink -f "${1:?BINARY}")
packaging=$(dirname "$(readlink -f "$0")")
[ "$(id -u)" = 0 ] || skip "this needs root"
[ -x /lib/systemd/systemd ] && command -v systemctl journalctl unshare nsenter >/dev/null || skip "systemd, unshare or nsenter is not installed"
case $(stat -fc %T /sys/fs/cgroup) in
  cgroup2fs) cgroup=/sys/fs/cgroup/gearwatch-test-$$ ;;
  *) cgroup=/sys/fs/cgroup/unified/gearwatch-test-$$ ;;
esac
mkdir "$cgroup" 2>/dev/null || skip "there are no control groups of version 2 that can be written"

here=$(mktemp -d)
talk=$here/talk
first=
end() {
  # Nothing outlives the first process of its namespace.
  [ -z "$first" ] || kill -KILL "$first" 2>/dev/null || true
  wait 2>/dev/null || true
  for _ in $(seq 50); do
    find "$cgroup" -depth -type d -exec rmdir {} + 2>/dev/null && break
    sleep 0.1
  done
  rm -rf "$here"
}
trap end EXIT
fail() {
  echo "systemd-test: $*" >&2
  in_it systemctl --no-pager --lines=0 status gearwatch.service >&2 || true
  in_it journalctl --no-pager -u gearwatch.service -n 20 -o cat >&2 || true
  tail -n 20 "$talk" >&2
  exit 1
}

chmod 755 "$here"
mkdir "$here/bin" "$here/units"
touch "$here/bin/gearwatch"
cp -a /etc "$here/etc"
mkdir -p "$here/etc/gearwatch" "$here/etc/systemd/journald.conf.d"
# A baseline of ten seconds does here: a debug build works for 13 s on the thirty of the shipped file, at every start.
sed 's/duration_secs = 30.0/duration_secs = 10.0/' "$packaging/service.toml" > "$here/etc/gearwatch/service.toml"
grep -q 'duration_secs = 10.0' "$here/etc/gearwatch/service.toml" || fail "service.toml learns from something else"
"$binary" config bench single-pair > "$here/etc/gearwatch/bench.toml"
printf '[Journal]\nStorage=volatile\nReadKMsg=no\nAudit=no\n' > "$here/etc/systemd/journald.conf.d/test.conf"
cp "$packaging/gearwatch.service" "$here/units/"
cp /lib/systemd/system/systemd-journald.service /lib/systemd/system/systemd-journald.socket "$here/units/"
# The rest of a machine is not started: targets that hold nothing stand for it.
for target in sysinit basic shutdown network-online multi-user; do
  printf '[Unit]\nDefaultDependencies=no\n' > "$here/units/$target.target"
done

(echo "$BASHPID" > "$cgroup/cgroup.procs"
  exec unshare --pid --fork --kill-child --mount --mount-proc --cgroup --uts --ipc --net "$0" --inside "$here" "$binary") >"$talk" 2>&1 &
outer=$!
in_it() { nsenter --target "$first" --pid --mount --cgroup --uts --ipc --net -- env -i PATH="$PATH" "$@"; }
# wait_for SECONDS COMMAND…: until it succeeds
wait_for() {
  local limit=$((SECONDS + $1))
  shift
  until "$@" >/dev/null 2>&1; do
    [ $SECONDS -lt $limit ] || return 1
    sleep 0.1
  done
}
born() { first=$(pgrep -P "$outer") && [ "$(tr '\0' ' ' < "/proc/$first/cmdline" | cut -d' ' -f1)" = /lib/systemd/systemd ]; }
wait_for 10 born || { cat "$talk" >&2; first=; skip "systemd does not start in namespaces of its own"; }
wait_for 20 in_it systemctl is-active basic.target || fail "systemd does not answer"

unit() { in_it systemctl show gearwatch.service --property "$1" --value; }
answers() { in_it /usr/local/bin/gearwatch status --socket /run/gearwatch/status.sock --json > "$here/answer" || true; [ -s "$here/answer" ]; }
running() { [ "$(unit ActiveState)" = active ] && answers; }
restarts_from() { [ "$(unit NRestarts)" -ge "$1" ]; }
running_again() { restarts_from "$1" && running; }
uptime_secs() { answers; grep -o '"uptime_secs": *[0-9]*' "$here/answer" | grep -o '[0-9]*$'; }
now_ms() { date +%s%3N; }

in_it systemctl start systemd-journald.service || fail "there is no journal"
begin=$(now_ms)
in_it systemctl start gearwatch.service || fail "the unit does not start"
[ "$(unit ActiveState)/$(unit SubState)" = active/running ] || fail "started, and not active"
echo "started, and said that it is ready, after $(($(now_ms) - begin)) ms"
wait_for 10 running || fail "the service does not answer"

pid=$(unit MainPID)
has() { in_it grep -Eq "$2" "/proc/$pid/$1" || fail "/proc/$pid/$1 of the service has no $2"; }
has status '^CapEff:\s0+$'
has status '^CapBnd:\s0+$'
has status '^NoNewPrivs:\s1$'
has status '^Seccomp:\s2$'
has limits '^Max open files +4096 +4096 '
if in_it grep -Eq '^Uid:\s0' "/proc/$pid/status"; then fail "the service is root"; fi
case $(in_it readlink "/proc/$pid/fd/2") in
  socket:*) ;;
  *) fail "what the service says does not go to the journal, but to $(in_it readlink "/proc/$pid/fd/2")" ;;
esac
group=/sys/fs/cgroup$(unit ControlGroup)
if in_it test -e "$group/memory.max"; then
  [ "$(in_it cat "$group/memory.max")" = 1073741824 ] || fail "memory has no limit"
  echo "no rights, 4096 descriptors, 1 GiB of memory"
else
  echo "no rights, 4096 descriptors; memory is not limited here: this machine has that controller in control groups of version 1"
fi

sleep 3
begin=$(now_ms)
before=$(uptime_secs)
in_it systemctl reload gearwatch.service || fail "no reload"
anew() { [ "$(uptime_secs)" -lt "$before" ]; }
wait_for 20 anew || fail "the reload begins nothing anew"
[ "$(unit MainPID)" = "$pid" ] || fail "a reload made another process"
echo "reloaded within $(($(now_ms) - begin)) ms, same process"

mv "$here/etc/gearwatch/service.toml" "$here/right.toml"
echo 'format = "nonsense"' > "$here/etc/gearwatch/service.toml"
in_it systemctl reload gearwatch.service || true
sleep 2
running && [ "$(unit MainPID)" = "$pid" ] || fail "a reload of a wrong configuration ends the service"
in_it journalctl --no-pager -u gearwatch.service -o cat | grep -q nonsense || fail "the journal does not say what is wrong with the configuration"
echo "a wrong configuration is told in the journal, and the service goes on"

# Systemd gives up after five starts in ten seconds where a unit does not say otherwise.
in_it systemctl kill --signal=KILL --kill-who=main gearwatch.service
wait_for 60 restarts_from 8 || fail "it is not tried again: $(unit NRestarts) times"
[ "$(unit ActiveState)" != failed ] || fail "systemd has given up"
echo "killed, with a wrong configuration: tried $(unit NRestarts) times, and not given up"
cp "$here/right.toml" "$here/etc/gearwatch/service.toml"
tried=$(unit NRestarts)
begin=$(now_ms)
wait_for 20 running || fail "it does not run with the right configuration"
echo "right configuration: runs after $(($(now_ms) - begin)) ms"

tried=$(unit NRestarts)
begin=$(now_ms)
in_it systemctl kill --signal=KILL --kill-who=main gearwatch.service
wait_for 20 running_again $((tried + 1)) || fail "it is not back after a kill"
echo "killed: back and answering after $(($(now_ms) - begin)) ms (RestartSec is 1 s)"

if [ "${2:-}" = --watchdog ]; then
  tried=$(unit NRestarts)
  begin=$(now_ms)
  in_it systemctl kill --signal=STOP --kill-who=main gearwatch.service
  wait_for 60 running_again $((tried + 1)) || fail "the watchdog does not end a service that stands still"
  in_it journalctl --no-pager _PID=1 -o cat 2>/dev/null | grep -i watchdog | tail -n 1 || true
  echo "stood still: back after $(($(now_ms) - begin)) ms (watchdog 20 s, then 10 s to end)"
fi

sleep 2
begin=$(now_ms)
in_it systemctl stop gearwatch.service || fail "it does not stop"
took=$(($(now_ms) - begin))
[ "$(unit ActiveState)/$(unit Result)/$(unit ExecMainStatus)" = inactive/success/0 ] \
  || fail "stopped as $(unit ActiveState)/$(unit Result)/$(unit ExecMainStatus)"
echo "stopped with exit code 0 after $took ms"
code=0
in_it /usr/local/bin/gearwatch doctor /var/lib/gearwatch > "$here/doctor" 2>&1 || code=$?
cat "$here/doctor"
# The kills left tails, which doctor tells with 3; anything else is damage.
[ $code = 0 ] || [ $code = 3 ] || fail "doctor says $code"
# A kill takes what a group holds. Thousands are what a log says that cannot tell.
missing=$(grep -o 'unclean_end: at most [0-9]* missing' "$here/doctor" | grep -o '[0-9]*')
[ "${missing:-0}" -lt 1000 ] || fail "the log cannot tell how much the kills took: $missing"
if in_it test -e /run/gearwatch; then fail "the folder of the socket stays"; fi
echo "the unit starts, is reloaded, comes back and stops"
