//! One parser, chosen by `GEARWATCH_PARSER`, under libFuzzer: all parsers are in one binary, so
//! that it is built once.

#![no_main]

#[path = "../../crates/cli/tests/fuzz/parsers.rs"]
mod parsers;

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;

static PARSE: LazyLock<parsers::Parse> = LazyLock::new(|| {
    let wanted = std::env::var("GEARWATCH_PARSER").unwrap_or_default();
    let found = parsers::PARSERS.iter().find(|(name, _)| *name == wanted);
    let names: Vec<_> = parsers::PARSERS.iter().map(|(name, _)| *name).collect();
    found.unwrap_or_else(|| panic!("GEARWATCH_PARSER is {wanted:?}, expected one of {names:?}")).1
});

fuzz_target!(|bytes: &[u8]| PARSE(bytes));
