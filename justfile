# Commands for contributors: `just` lists them. Users need none of these.

default:
    @just --list

# All that must pass before a change lands
ci:
    .ci/run

# The tests, as in the README
test:
    cargo test --workspace

# Bill of materials of the program and its dependencies, CycloneDX 1.5 JSON (cargo install cargo-cyclonedx)
sbom:
    packaging/sbom.sh target/release-files/gearwatch.cdx.json

# The program as it is released: it holds the list of its dependencies (cargo install cargo-auditable; read it with `cargo audit bin` or `rust-audit-info`)
auditable *args:
    packaging/build.sh {{args}}

# The last commit built twice, in two folders: the same bytes, or exit 1
reproducible *args:
    packaging/reproducible.sh {{args}}

# Signs the checksums of a release (SECURITY.md): KEY is an SSH key
sign key:
    packaging/sign.sh {{key}}

# The benchmarks: figures are ratios within one run
bench:
    cargo bench --workspace

# The table of docs/performance.md: speed beside peers (pip install numpy mcap h5py npTDMS pyarrow pyfftw scipy mkl_fft matplotlib; `--only reading` for one part)
bench-table *args:
    python3 tests/peers/table.py {{args}}

# The SpectraQuest recordings, where they lie beside the repository: a baseline of first halves judges second halves and the broken tooth
spectraquest:
    cargo test -p gearwatch-tests --test spectraquest_baseline -- --nocapture

# The documentation as a searchable site in target/book (cargo install mdbook)
book:
    packaging/book.sh

# All campaigns of the service (docs/reliability-evidence.md)
campaign: campaign-kills campaign-worlds campaign-failures campaign-sensors campaign-network campaign-soak campaign-hour campaign-overload campaign-fleet campaign-fuzz

# 300 kill -9, 100 stops, a full disk and 100 power cuts (the last two need root) against the release build
campaign-kills:
    GEARWATCH_ROUNDS=300 cargo test --release -p gearwatch --test campaign -- --nocapture kills disk_full
    GEARWATCH_ROUNDS=100 cargo test --release -p gearwatch --test campaign -- --nocapture --test-threads=1 stops power_cut

# Worlds of 500 s each, made by seeds: clock, disk, network, workers and people against the service's own parts (docs/reliability-evidence.md); a failing seed is printed
campaign-worlds worlds="2000":
    GEARWATCH_ROUNDS={{worlds}} cargo test -p gearwatch-daemon --test simulation -- --nocapture no_world

# 200 seeds of network trouble, 1000 reconnects and a bad network beside a good one, against an emulated instrument
campaign-network:
    cargo test -p gearwatch-sources --test network -- --nocapture --include-ignored
    cargo test -p gearwatch-daemon --test acquisition -- --nocapture --ignored neighbour

# Every task killed once, clocks
campaign-failures:
    cargo test -p gearwatch --test campaign -- --nocapture failures time

# Faults of sensors and wiring, and 100 000 clean windows
campaign-sensors:
    GEARWATCH_ROUNDS=1 cargo test --release -p gearwatch --test campaign -- --nocapture sensor_faults

# Pairs of random tooth numbers: right sheets that are doubted, wrong ones that are not
campaign-teeth:
    cargo test -p gearwatch-check -- --ignored --nocapture campaign_of_random_tooth_numbers

# What the model of a changed path leaves of held-out recordings, in drawn benches
campaign-paths:
    cargo test --release -p gearwatch-explain --lib -- --ignored --nocapture campaign_error_of_a_paths_model

# By how much first orders lead where teeth alone changed (minutes)
campaign-first-order:
    cargo test --release -p gearwatch-explain --lib -- --ignored --nocapture campaign_first_orders_of_pitch_errors

# By how much sidebands of sound pinions lead those of their wheels (minutes)
campaign-mates:
    cargo test --release -p gearwatch-explain --lib -- --ignored --nocapture campaign_sidebands_of_sound_mates

# What the change of a damaged tooth does over the torque, in drawn benches
campaign-damaged-teeth:
    cargo test --release -p gearwatch-explain --lib -- --ignored --nocapture campaign_damaged_teeth_give_way

# Whether teeth that change pass for a function of frequency, in drawn benches
campaign-frequency:
    cargo test --release -p gearwatch-explain --lib -- --ignored --nocapture campaign_evidence_of_a_function_of_frequency

# Changes of the instrument in real recordings, and the table in docs/instrument-faults.md
campaign-drill:
    GEARWATCH_WRITE=1 cargo test --release -p gearwatch-explain --test drill -- --ignored --nocapture campaign_table

# Laws that no effect has, concealed in simulated recordings: the table in docs/free-terms.md
campaign-laws:
    cargo test --release -p gearwatch --test explain -- --ignored --nocapture campaign_laws

# A day in ten minutes: memory, descriptors, threads, windows
campaign-soak:
    cargo test --release -p gearwatch --test campaign -- --ignored --nocapture soak

# A week in 70 minutes with a disk that hangs, is slow, full and fails, clock steps, reloads, files taken away (cc; GEARWATCH_SOAK_SECS makes it shorter)
campaign-week:
    cargo test --release -p gearwatch --test campaign -- --ignored --nocapture week

# The systemd unit started, reloaded, killed, stalled and stopped, under a systemd of its own in namespaces (root)
campaign-systemd:
    cargo build --release --package gearwatch
    packaging/systemd-test.sh target/release/gearwatch --watchdog

# An hour of the simulated bench at full speed: memory, ranks, the delay until a broken tooth is found
campaign-hour:
    cargo test --release -p gearwatch --test campaign -- --ignored --nocapture hour

# Four weeks of a growing fault, a part of each day: found, acknowledged, reported; log size, query times, memory (GEARWATCH_MONTH=folder keeps all of it)
campaign-month:
    cargo test --release -p gearwatch --test campaign -- --ignored --nocapture month

# A year of 64 channels in the log: into the levels of detail, out of them onto the page, memory (Chromium)
campaign-year:
    cargo test --release -p gearwatch --test page -- --ignored --nocapture a_year

# One to ten times real time, what lies beyond that, all on one core of the machine too; latency from the last sample to the line, alone and with stopped ends
campaign-overload:
    cargo test --release -p gearwatch --test campaign -- --ignored --nocapture --test-threads=1 overload
    taskset -c 0 cargo test --release -p gearwatch --test campaign -- --ignored --nocapture many_channels

# Twenty benches, the server killed, a cable out for a minute; brokers
campaign-fleet:
    GEARWATCH_ROUNDS=1 cargo test --release -p gearwatch --test brokers -- --nocapture

# Property tests over cases never drawn before, a million of each
campaign-properties cases="1000000":
    PROPTEST_CASES={{cases}} PROPTEST_RNG_SEED="$(od -An -N4 -tu4 /dev/urandom | tr -d ' ')" cargo test -p gearwatch-io --test streams -- analytic_

# An hour of eight channels on the live page, in a Chromium: first paint and long tasks
page:
    cargo test --release -p gearwatch --test page -- --ignored --nocapture an_hour

# The alert rules, against Prometheus' own checker (Debian: prometheus)
prometheus:
    promtool check rules packaging/prometheus-alerts.yml
    promtool test rules packaging/prometheus-alerts-test.yml

# Every query of the Grafana dashboard and the alert rules, by a Prometheus that scrapes a service with a fault (Debian: prometheus, python3)
grafana:
    cargo build --release --package gearwatch
    packaging/grafana-test.py target/release/gearwatch

# Known faults of dependencies (fetches RustSec's database)
advisories:
    cargo deny check advisories

# Memory of batch and diagnose with a recording of 4 GiB beside one of 100 MB
campaign-memory mib="4096":
    GEARWATCH_MEMORY_MIB={{mib}} cargo test --release -p gearwatch --test batch -- --ignored --nocapture memory

# A job array under Slurm: packages of Debian unpacked into a folder (crates/cli/tests/batch/slurm.rs says how), or installed
campaign-slurm folder="/":
    GEARWATCH_SLURM={{folder}} cargo test -p gearwatch --test batch -- --nocapture slurm

# Batch on one thread and on all, beside the bare reading of the same files
bench-batch:
    cargo test --release -p gearwatch --test batch -- --ignored --nocapture throughput

# A client of Foxglove's protocol beside the log
campaign-live-view:
    cargo test -p gearwatch --features foxglove --test brokers -- --nocapture live_view

# A sound card that PulseAudio plays, in real time (pulseaudio, libasound2-plugins, libasound2-dev)
campaign-sound-card:
    cargo test -p gearwatch --features sound-card --test campaign -- --nocapture sound_card

# A minute of changed bytes for each parser
campaign-fuzz:
    GEARWATCH_FUZZ_SECS=60 cargo test --release -p gearwatch --test fuzz -- --nocapture

# The same led by coverage (nightly toolchain, `cargo install cargo-fuzz`)
campaign-fuzz-coverage secs="60":
    GEARWATCH_FUZZ_CORPUS="$PWD/fuzz/corpus" cargo test -p gearwatch --test fuzz -- --ignored written_for_a_fuzzer
    for parser in $(ls fuzz/corpus); do \
        GEARWATCH_PARSER=$parser cargo +nightly fuzz run parser "fuzz/corpus/$parser" -- -max_total_time={{secs}} -timeout=10 -rss_limit_mb=2048 -max_len=65536 -print_final_stats=1 || exit 1; \
    done

# Concealed cases drawn by seed, explained and judged
prove cases="200" seed="20261":
    cargo run --release -p gearwatch -- prove --cases {{cases}} --seed {{seed}} --list

# Each effect of the library concealed and sought: the table of docs/effects-found.md
campaign-effects cases="3" seed="2026112101":
    GEARWATCH_CASES={{cases}} GEARWATCH_SEED={{seed}} cargo test --release -p gearwatch-explain --test effects -- --ignored --nocapture

# Where the time of a build from empty goes: `target/cargo-timings/`
build-times *args:
    cargo build --timings {{args}}

# The Python wheel, into target/wheels (pip install maturin)
wheel *args:
    packaging/wheel.sh {{args}}

# The Python package in an empty environment: beside the command line and SciPy
python-test:
    packaging/python-test.sh

# The same, and the notebooks run from their first cell to their last
notebooks:
    packaging/python-test.sh notebooks

# The Debian package, into target/release-files
deb:
    cargo build --release --locked --package gearwatch --features full
    packaging/deb.sh target/release/gearwatch target/release-files
    packaging/deb-test.sh target/release-files/gearwatch_*.deb

# One file that runs on any x86-64 Linux (musl-tools)
static:
    packaging/static.sh

# All files of a release with their checksums, into target/release-files
release:
    packaging/release.sh
