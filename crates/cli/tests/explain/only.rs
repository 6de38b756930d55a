//! `gearwatch prove --only`: what single numbers of a seed conceal, and their whole answers.

use gearwatch_explain::prove;

use crate::fixture::{Folder, stderr, stdout};

const SEED: u64 = 3;
const EFFECT: &str = "clipping";

/// The case of the seed is told as it was drawn, then answered as `explain --steps` answers.
#[test]
fn conform_one_number_is_told_and_answered_in_full() {
    let (number, case) = (0..20).find_map(|n| Some((n, prove::case(SEED, n, Some(EFFECT))?))).expect("one of twenty");
    let folder = Folder::new();
    let (seed, only) = (SEED.to_string(), number.to_string());
    let done = folder.run(&["prove", "--seed", &seed, "--effect", EFFECT, "--only", &only]);
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    let said = stdout(&done);
    let effect = &case.truth.effects[0];
    let head = format!("case {number}: Single, conceals {EFFECT} at {} (", effect.place);
    assert!(said.starts_with(&head), "{head:?} is not the head of:\n{said}");
    let answer = prove::answer(&case).unwrap().explanation;
    for part in [&format!("{}: {}\n", case.bench.name, answer.status.code()), "  named first ", "  steps "] {
        assert!(said.contains(part), "{part:?} is not in:\n{said}");
    }
    for named in &answer.effects {
        assert!(said.contains(&format!("{} at {}\n", named.effect, named.place)), "{said}");
    }
}

#[test]
fn conform_single_numbers_make_no_table() {
    let folder = Folder::new();
    for other in ["--list", "--cases=4"] {
        let done = folder.run(&["prove", "--only", "0", other]);
        assert_eq!(done.status.code(), Some(3), "{other}");
        assert!(stderr(&done).contains("--only"), "{}", stderr(&done));
    }
}
