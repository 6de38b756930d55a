#!/usr/bin/env bash
# Builds the Debian package from a finished build with all features: packaging/deb.sh BINARY FOLDER
# The package has the command, its manual pages and completions, the unit, an example configuration, and makes no user: the unit runs as a dynamic one.
set -euo pipefail
binary=${1:?BINARY} out=${2:?FOLDER}
here=$(cd "$(dirname "$0")" && pwd)
version=$(sed -n '/^\[workspace.package\]/,/^\[/s/^version = "\(.*\)"/\1/p' "$here/../Cargo.toml")
architecture=$(dpkg --print-architecture)
# The same source gives the same bytes: times are those of the last commit.
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git -C "$here" log -1 --format=%ct)}
export SOURCE_DATE_EPOCH
root=$(mktemp -d)
trap 'rm -rf "$root"' EXIT
chmod 755 "$root"

install -Dm755 "$binary" "$root/usr/bin/gearwatch"
install -d "$root/usr/share/man/man1"
"$binary" man --folder "$root/usr/share/man/man1"
gzip -9n "$root"/usr/share/man/man1/*.1
install -d "$root/usr/share/bash-completion/completions" "$root/usr/share/zsh/vendor-completions" "$root/usr/share/fish/vendor_completions.d"
"$binary" completions bash > "$root/usr/share/bash-completion/completions/gearwatch"
"$binary" completions zsh > "$root/usr/share/zsh/vendor-completions/_gearwatch"
"$binary" completions fish > "$root/usr/share/fish/vendor_completions.d/gearwatch.fish"
install -d "$root/usr/lib/systemd/system"
sed 's|/usr/local/bin|/usr/bin|' "$here/gearwatch.service" > "$root/usr/lib/systemd/system/gearwatch.service"
install -Dm644 "$here/service.toml" "$root/etc/gearwatch/service.toml"
"$binary" config bench single-pair > "$root/etc/gearwatch/bench.toml"
doc=$root/usr/share/doc/gearwatch
install -Dm644 "$here/copyright" "$doc/copyright"
install -Dm644 "$here/../README.md" "$doc/README.md"
gzip -9nc "$here/../CHANGELOG.md" > "$doc/changelog.gz"
find "$root/usr" "$root/etc" -type f ! -path "$root/usr/bin/*" -exec chmod 644 {} +

install -d "$root/DEBIAN"
install -m755 "$here/postinst" "$here/prerm" "$here/postrm" "$root/DEBIAN/"
printf '/etc/gearwatch/service.toml\n/etc/gearwatch/bench.toml\n' > "$root/DEBIAN/conffiles"
# The oldest C library with the symbols that the binary asks for.
libc=$(objdump -T "$binary" 2>/dev/null | grep -o 'GLIBC_[0-9.]*' | sort -Vu | tail -1 | cut -d_ -f2 || true)
cat > "$root/DEBIAN/control" <<CONTROL
Package: gearwatch
Version: $version
Architecture: $architecture
Maintainer: The gearwatch authors <gearwatch@users.noreply.github.com>
Installed-Size: $(du -ks --exclude=DEBIAN "$root" | cut -f1)
Depends: libc6 (>= ${libc:-2.34}), libgcc-s1
Section: science
Priority: optional
Homepage: https://github.com/gearwatch/gearwatch
Description: watches, diagnoses, simulates and explains gear test benches
 Turns the vibration of a running gear train into the amplitudes of the first
 five mesh harmonics, compares them with a stored normal state, and gives each
 a rank code with the probability that it is right: as a service, from
 recordings, and from the command line.
CONTROL
find "$root" -exec touch --no-dereference --date="@$SOURCE_DATE_EPOCH" {} +
mkdir -p "$out"
dpkg-deb -Zgzip --root-owner-group --build "$root" "$out/gearwatch_${version}_${architecture}.deb"
