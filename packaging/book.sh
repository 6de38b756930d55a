#!/usr/bin/env bash
# The documentation as a searchable site in target/book: the pages of docs/, and the references of commands, effects, sources and sinks, which the
# program prints itself. `packaging/book.sh --pages` makes the pages in target/book-pages and stops there.
set -euo pipefail
cd "$(dirname "$0")/.."

gearwatch=${GEARWATCH_BINARY:-}
if [ -z "$gearwatch" ]; then
  cargo build --quiet --package gearwatch --features full
  gearwatch=target/debug/gearwatch
fi

pages=target/book-pages
rm -rf "$pages"
mkdir -p "$pages"
cp -r docs/. "$pages"

commands=$("$gearwatch" --help | sed -n '/^Commands:/,/^$/s/^  \([a-z][a-z-]*\)  .*/\1/p' | grep -vx help)
{
  printf '# Commands\n\nAs `gearwatch help COMMAND` prints it, version %s.\n' "$("$gearwatch" --version | cut -d' ' -f2)"
  for command in $commands; do
    printf '\n## gearwatch %s\n\n```text\n' "$command"
    COLUMNS=110 "$gearwatch" help "$command"
    printf '```\n'
  done
} > "$pages/commands.md"

reference() {
  printf '# %s\n\nAs `gearwatch list %s` prints it.\n\n```text\n' "$1" "$2"
  "$gearwatch" list "$2"
  printf '```\n'
}
reference 'Effects of the simulator' effects > "$pages/effects.md"
{ reference 'Sources and sinks' sources; printf '\n```text\n'; "$gearwatch" list sinks; printf '```\n'; } > "$pages/sources-and-sinks.md"

sed -i 's|^- \[Security\](security.md)$|&\n- [Commands](commands.md)\n- [Effects of the simulator](effects.md)\n- [Sources and sinks](sources-and-sinks.md)|' "$pages/SUMMARY.md"
sed -i 's|^build-dir = .*|build-dir = "../book"|' "$pages/book.toml"
if [ "${1:-}" = --pages ]; then
  exit
fi
mdbook build "$pages"
