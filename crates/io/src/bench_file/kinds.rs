//! Tests of stages that are no external spur pairs.

use super::tests::error;
use super::*;

const PLANETARY: &str = r#"format = "gearwatch-bench/1"
name = "planetary"

[motor]
speed_hz = 30.0

[[shaft]]
name = "input"
[[shaft]]
name = "output"

[[stage]]
name = "epi"
kind = "planetary"
sun = { teeth = 28 }
planet = { teeth = 36, count = 4 }
ring = { teeth = 100 }
"#;

const HELICAL: &str = r#"format = "gearwatch-bench/1"
name = "helical"

[motor]
speed_hz = 30.0

[[shaft]]
name = "input"
[[shaft]]
name = "output"

[[stage]]
name = "fast"
kind = "helical"
helix_angle_deg = 15.0
pinion = { teeth = 23, hand = "left" }
wheel = { teeth = 67, hand = "right" }
"#;

fn read(text: &str) -> Bench {
    parse(text, Path::new("b.toml")).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

#[test]
fn conform_every_kind_survives_being_written() {
    let internal = HELICAL.replace("teeth = 67, hand = \"right\"", "teeth = 67, internal = true, hand = \"left\"");
    let idlers = HELICAL
        .replace("hand = \"right\" }", "hand = \"left\" }\nidlers = [{ teeth = 31 }, { teeth = 33, mass_kg = 1.5 }]")
        .replace("teeth = 67, hand = \"left\"", "teeth = 67, hand = \"right\"");
    let placed = PLANETARY.replace("count = 4", "count = 4, positions_deg = [0.0, 90.0, 180.0, 270.0], mass_kg = 0.2");
    let other = PLANETARY.replace("kind", "in = \"ring\"\nfixed = \"sun\"\nhelix_angle_deg = 10.0\nkind");
    let shifted = PLANETARY.replace("teeth = 36", "teeth = 35").replace("kind", "profile_shifted = true\nkind");
    let coefficients = HELICAL
        .replace("teeth = 23", "teeth = 14, profile_shift = 0.5, tip_diameter_mm = 51.0")
        .replace("kind", "centre_distance_mm = 127.5\nkind");
    let planets = PLANETARY.replace("teeth = 36", "teeth = 35, profile_shift = 0.3, tip_diameter_mm = 112.0");
    let rings = planets.replace("teeth = 100", "teeth = 100, profile_shift = -0.25");
    for text in [PLANETARY, HELICAL, &internal, &idlers, &placed, &other, &shifted, &coefficients, &planets, &rings] {
        let bench = read(text);
        let written = to_toml(&bench).unwrap();
        assert_eq!(read(&written), bench, "{written}");
    }
}

/// What the file leaves out is what is usual: the ring stands still, the sun drives, the carrier is
/// driven; with another member fixed the others follow.
#[test]
fn conform_members_follow_from_what_is_said() {
    use gearwatch_core::bench::Member::{Carrier, Ring, Sun};
    for (said, members) in [
        ("", (Ring, Sun, Carrier)),
        ("fixed = \"sun\"", (Sun, Ring, Carrier)),
        ("fixed = \"carrier\"", (Carrier, Sun, Ring)),
        ("in = \"carrier\"", (Ring, Carrier, Sun)),
        ("out = \"ring\"\nin = \"sun\"", (Carrier, Sun, Ring)),
        ("fixed = \"ring\"\nout = \"sun\"", (Ring, Carrier, Sun)),
    ] {
        let bench = read(&PLANETARY.replace("kind", &format!("{said}\nkind")));
        let set = bench.stages[0].gearing.planetary.as_ref().expect("planetary");
        assert_eq!((set.fixed, set.input, set.output), members, "{said}");
    }
    let text = error(&PLANETARY.replace("kind", "in = \"ring\"\nfixed = \"ring\"\nkind"));
    assert!(
        text.contains("line 12, under [[stage]]") && text.contains("each of \"sun\", \"carrier\" and \"ring\" once"),
        "{text}"
    );
}

/// A spur bench writes no key of another kind, so that what was written before is written again,
/// letter by letter.
#[test]
fn regress_a_spur_stage_is_written_as_before() {
    let bench = read(
        &HELICAL
            .replace("kind = \"helical\"\nhelix_angle_deg = 15.0\n", "")
            .replace(", hand = \"left\"", "")
            .replace(", hand = \"right\"", ""),
    );
    let text = to_toml(&bench).unwrap();
    let stage = text.split("[[stage]]").nth(1).and_then(|rest| rest.split("[gear_material]").next()).unwrap();
    let expected = "\nname = \"fast\"\nmodule_mm = 3.0\npressure_angle_deg = 20.0\nface_width_mm = 20.0\nbacklash_um = 80.0\nmesh_damping_ratio = 0.06\nline_of_centres_deg = 0.0\n\n[stage.pinion]\nteeth = 23\n\n[stage.wheel]\nteeth = 67\n\n";
    assert_eq!(stage, expected);
}

/// What cannot be built says which number is wrong and what would be right.
#[test]
fn conform_a_planetary_stage_that_cannot_be_built_is_refused() {
    for (from, to, says) in [
        ("count = 4", "count = 5", "(sun 28 + ring 100) / 5 = 25.600 is not whole (2, 4, 8 planets would fit)"),
        ("count = 4", "count = 0", "planet.count is 0; expected 1 to 24"),
        (
            "ring = { teeth = 100",
            "ring = { teeth = 102",
            "ring.teeth is 102; sun 28 and planet 36 turn about one axis with a ring of 100",
        ),
        (
            "count = 4",
            "count = 8",
            "planets 1 and 2 collide: their centres are 73.5 mm apart and their tips 114.0 mm across; at most 4 equally",
        ),
        (
            "count = 4",
            "count = 4, positions_deg = [0.0, 91.0, 180.0, 270.0]",
            "positions_deg holds 91: between the teeth, where the planet cannot be assembled; 90.0000 would fit",
        ),
        ("count = 4", "count = 4, positions_deg = [0.0, 90.0, 180.0]", "has 3 positions and planet.count is 4"),
        ("count = 4", "count = 4, positions_deg = [0.0, 180.0, 90.0, 270.0]", "expected rising angles within one turn"),
        (
            "sun = { teeth = 28 }\nplanet = { teeth = 36",
            "sun = { teeth = 12 }\nplanet = { teeth = 44",
            "sun.teeth is 12: below 17.1 teeth the root is undercut; expected 17 or more, or profile_shifted = true",
        ),
        ("ring = { teeth = 100 }\n", "", "kind = \"planetary\" has no \"ring\"; expected ring = { teeth = 100 }"),
        (
            "ring = { teeth = 100 }\n",
            "ring = { teeth = 100 }\nwheel = { teeth = 100 }\n",
            "kind = \"planetary\" takes no \"wheel\"",
        ),
        ("count = 4", "number = 4", "unknown key \"number\""),
    ] {
        assert!(PLANETARY.contains(from), "{from}");
        let text = error(&PLANETARY.replace(from, to));
        assert!(text.contains(says), "{says}: {text}");
    }
}

/// Sun 27, planets 35, ring 99, the teeth of the Bell 206 helicopter: four planets cannot be
/// equally spaced, (27 + 99)/4 being 31.5; 32 and 31 steps of 360°/126 by turns, 91.43° and 88.57°,
/// hold them.
#[test]
fn analytic_planets_that_equal_spacing_cannot_hold() {
    let teeth = PLANETARY
        .replace("teeth = 28", "teeth = 27")
        .replace("teeth = 36", "teeth = 35")
        .replace("teeth = 100", "teeth = 99");
    // Their ring has two teeth more than sun and planets without profile shift leave room for.
    let text = error(&teeth);
    assert!(text.contains("with a ring of 97 (sun + 2 planet)"), "{text}");
    let teeth = teeth.replace("kind", "profile_shifted = true\nkind");
    let text = error(&teeth);
    assert!(text.contains("(sun 27 + ring 99) / 4 = 31.500 is not whole"), "{text}");
    read(&teeth.replace("count = 4", "count = 4, positions_deg = [0.0, 91.43, 180.0, 271.43]"));
}

#[test]
fn conform_a_helical_pair_that_cannot_be_built_is_refused() {
    for (from, to, says) in [
        (
            "hand = \"right\"",
            "hand = \"left\"",
            "hands do not match: pinion \"left\", wheel \"left\"; an external helical pair has opposite hands: wheel.hand = \"right\"",
        ),
        (
            "teeth = 67",
            "teeth = 67, internal = true",
            "an internal helical pair has the same hand: wheel.hand = \"left\"",
        ),
        ("helix_angle_deg = 15.0", "helix_angle_deg = -15.0", "helix_angle_deg is -15; expected above 0 to 45 degrees"),
        ("helix_angle_deg = 15.0\n", "", "has no \"helix_angle_deg\"; expected helix_angle_deg = 15.0"),
        ("teeth = 23", "teeth = 14", "pinion.teeth is 14: below 15.5 teeth the root is undercut; expected 15 or more"),
        (
            "kind = \"helical\"\n",
            "",
            "kind = \"spur\" takes no \"helix_angle_deg\"; that is a key of kind = \"helical\"",
        ),
        ("kind = \"helical\"", "kind = \"worm\"", "expected one of `spur`, `helical`, `planetary`"),
        ("teeth = 67", "teeth = 19, internal = true", "the internal wheel has 19 teeth and the pinion 23"),
        ("teeth = 23", "teeth = 23, internal = true", "only the wheel can be an internal gear"),
    ] {
        assert!(HELICAL.contains(from), "{from}");
        let text = error(&HELICAL.replace(from, to));
        assert!(text.contains(says), "{says}: {text}");
    }
    read(&HELICAL.replace("teeth = 23", "teeth = 14").replace("kind", "profile_shifted = true\nkind"));
}

/// Coefficients and the centre distance that contradict each other are refused with place, number
/// and what would be right; a planetary stage has no distance of pinion and wheel.
#[test]
fn conform_profile_shift_that_cannot_be_is_refused() {
    let free = HELICAL
        .replace("kind = \"helical\"\nhelix_angle_deg = 15.0\n", "")
        .replace(", hand = \"left\"", ", profile_shift = 0.4")
        .replace(", hand = \"right\"", ", profile_shift = 0.3");
    let placed = free.replace("name = \"fast\"\n", "name = \"fast\"\ncentre_distance_mm = 137.2\n");
    // 135 mm without shift, 136.9941 mm with 0.7 of 3 mm in sum.
    let shift = read(&placed).stages[0].pair_shift().unwrap();
    assert!(shift.wider && shift.centre_distance_mm == 137.2 && (shift.play_free_mm - 136.9941).abs() < 1e-4);
    for (text, from, to, says) in [
        (&placed, "137.2", "136.5", "stage \"fast\": centre_distance_mm is 136.5; the teeth jam below 136.994 mm"),
        (&placed, "137.2", "110.0", "centre_distance_mm is 110; involutes touch only beyond 126.859 mm"),
        (&placed, "137.2", "nan", "centre_distance_mm is NaN"),
        (&placed, "137.2", "1e9", "centre_distance_mm is 1e9; expected 0.1 to 100000 mm"),
        (&placed, "[[stage]]\n", "[[stage]]\nidlers = [{ teeth = 30 }]\n", "with idlers between them leave it out"),
        (&free, "profile_shift = 0.4", "profile_shift = 2.5", "pinion.profile_shift is 2.5; expected -2 to 2"),
        (&free, "profile_shift = 0.4", "profile_shift = 1e300", "pinion.profile_shift is 1"),
        (&free, "profile_shift = 0.4", "tip_diameter_mm = -3.0", "pinion.tip_diameter_mm is -3; expected 0.1 to"),
        (
            &free,
            "profile_shift = 0.4",
            "addendum_modification = 0.4",
            "profile shift is profile_shift in pinion and wheel",
        ),
    ] {
        assert!(text.contains(from), "{from}");
        let text = error(&text.replace(from, to));
        assert!(text.contains(says) && text.starts_with("b.toml: "), "{says}: {text}");
    }
    let text = error(&PLANETARY.replace("kind", "centre_distance_mm = 96.0\nkind"));
    assert!(text.contains("kind = \"planetary\" takes no \"centre_distance_mm\""), "{text}");
}
