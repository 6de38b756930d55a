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
