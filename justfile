# Commands for contributors: `just` lists them. Users need none of these.

default:
    @just --list

# All that must pass before a change lands
ci:
    .ci/run

# The tests, as in the README
test:
    cargo test --workspace

# The benchmarks: figures are ratios within one run
bench:
    cargo bench --workspace

# The SpectraQuest recordings (../shared): a baseline of first halves judges second halves and the broken tooth
spectraquest:
    cargo test -p gearwatch-tests --test spectraquest_baseline -- --nocapture

# All campaigns of the service: kills, stops, full disk, power cuts, overload, soak, brokers, fuzzing (docs/reliability.md)
campaign: campaign-kills campaign-network campaign-soak campaign-overload campaign-time campaign-fuzz

# 300 kill -9, 100 stops, a full disk and 100 power cuts (the last two need root) against the release build
campaign-kills:
    GEARWATCH_ROUNDS=300 cargo test --release -p gearwatch --test campaign -- --nocapture kills disk_full
    GEARWATCH_ROUNDS=100 cargo test --release -p gearwatch --test campaign -- --nocapture --test-threads=1 stops power_cut

# 200 seeds of network trouble, 1000 reconnects and a bad network beside a good one, against an emulated instrument
campaign-network:
    cargo test -p gearwatch-daemon --test network -- --nocapture --include-ignored
