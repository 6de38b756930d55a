//! Each effect of the library, concealed in simulated recordings by a simulator that is configured
//! otherwise than the finder's.
//!
//! Always: a few effects, one of each kind of evidence. As a campaign (`just campaign-effects`):
//! all of them, three cases each, as a table for the documentation. Which effects count as one is
//! said in one place, `prove::score::is_right`, with the reason in `docs/effects-found.md`.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "the campaign prints its table, and how far it is")]

use std::collections::BTreeMap;

use gearwatch_explain::judge::report::Status;
use gearwatch_explain::prove::score::Scored;
use gearwatch_explain::prove::{draw, prove};
use gearwatch_sim::effects;
use rayon::prelude::*;

/// The first cases of an effect under a seed that conceal it at a size that shows; fewer where the
/// numbers run out.
fn cases(seed: u64, effect: &str, count: usize, most: u64) -> Vec<Scored> {
    let answers = (0..most).filter_map(|index| prove(seed, index, Some(effect)));
    answers.map(|answer| answer.unwrap_or_else(|refusal| panic!("{effect}: {refusal}"))).take(count).collect()
}

/// What gears, sensors and speeds show: found, and the name or its set holds the truth.
#[test]
fn conform_effects_of_each_kind_are_found() {
    for effect in ["eccentricity", "structural_resonance", "belt_slip"] {
        let found = cases(2_026_112_101, effect, 1, 12);
        let one = found.first().unwrap_or_else(|| panic!("{effect}: no case of twelve numbers"));
        assert_ne!(one.status, Status::Consistent, "{effect}: overlooked, {:?}", one.truth.effects);
        assert!(one.in_set.iter().all(|x| *x), "{effect}: {:?} named for {:?}", one.named, one.truth.effects);
    }
}

/// The benchmark draws every effect of the library but the one that has no lines while the teeth
/// are loaded.
#[test]
fn conform_every_effect_is_drawn() {
    let missing: Vec<&str> = effects::ALL
        .iter()
        .map(|e| e.id())
        .filter(|id| !draw::EFFECTS.contains(id) && *id != "wrong_tooth_count" && *id != "backlash")
        .collect();
    assert!(missing.is_empty(), "{missing:?}");
}

#[test]
#[ignore = "minutes: just campaign-effects"]
fn campaign_each_effect_is_concealed_and_sought() {
    let number = |name: &str, usual: u64| std::env::var(name).ok().and_then(|v| v.parse().ok()).unwrap_or(usual);
    let (seed, count) = (number("GEARWATCH_SEED", 2_026_112_101), number("GEARWATCH_CASES", 3) as usize);
    let tried: Vec<(&str, Vec<Scored>)> = effects::ALL
        .par_iter()
        .map(|effect| {
            let found = cases(seed, effect.id(), count, 6 * count as u64);
            eprintln!("{}: {} cases", effect.id(), found.len());
            (effect.id(), found)
        })
        .collect();
    println!("| effect | cases | first | in the set | overlooked | else named | parameters inside 2 sigma |");
    println!("|---|---|---|---|---|---|---|");
    let (mut all, mut first, mut set) = (0, 0.0, 0);
    for (effect, found) in tried {
        let mut others: BTreeMap<String, usize> = BTreeMap::new();
        for named in found.iter().flat_map(|s| &s.named).filter(|n| !n.3) {
            *others.entry(named.0.clone()).or_default() += 1;
        }
        let others: Vec<String> = others.into_iter().map(|(id, n)| format!("{id} {n}")).collect();
        // The empty sum is -0.
        let firsts = 0.0 + found.iter().flat_map(|s| &s.first).sum::<f64>();
        let sets = found.iter().flat_map(|s| &s.in_set).filter(|x| **x).count();
        let overlooked = found.iter().filter(|s| s.status == Status::Consistent).count();
        let sizes: Vec<bool> = found.iter().flat_map(|s| s.errors.iter().map(|e| e.2.abs() <= 2.0)).collect();
        println!(
            "| {effect} | {} | {firsts} | {sets} | {overlooked} | {} | {} |",
            found.len(),
            others.join(", "),
            if sizes.is_empty() {
                String::new()
            } else {
                format!("{} of {}", sizes.iter().filter(|x| **x).count(), sizes.len())
            }
        );
        (all, first, set) = (all + found.len(), first + firsts, set + sets);
    }
    println!("| all | {all} | {first} | {set} | | | |");
}
