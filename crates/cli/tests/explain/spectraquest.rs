//! Real recordings of a public two-stage box, healthy and with a broken tooth (`../shared/data`
//! beside the repository; skipped without them).

use crate::fixture::Folder;

/// All six loads (% of a torque that nobody stated).
const LOADS: [u32; 6] = [0, 10, 30, 50, 70, 90];

/// The shipped bench of that kind with the four sensors of the recordings, whose unit and places
/// nobody stated.
fn bench() -> String {
    let shipped = gearwatch_sim::shipped::BENCHES.iter().find(|b| b.name == "spectraquest-like").unwrap().text;
    let (train, _) = shipped.split_once("[[housing_mode]]").unwrap();
    let sensors: String = [("a1", "input"), ("a2", "intermediate"), ("a3", "output"), ("a4", "output")]
        .map(|(name, shaft)| {
            format!("[[sensor]]\nname = \"{name}\"\nshaft = \"{shaft}\"\ndirection_deg = 90.0\nunit = \"1\"\n\n")
        })
        .concat();
    format!("{train}{sensors}[acquisition]\nsample_rate_hz = 12800.0\n")
}

/// Broken against healthy: the paths of a1 and a2 changed, which their floors show too; on a4,
/// whose path stayed, no tooth fault is invented.
#[test]
#[expect(clippy::print_stderr, reason = "tests tell what was skipped, and the figures are for people")]
fn literature_changed_paths_are_named_and_no_tooth_is_invented() {
    let data = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/gfd_spectraquest");
    if !data.is_dir() {
        eprintln!("skipped: the recordings are not at {}", data.display());
        return;
    }
    let folder = Folder::new();
    folder.write("box.toml", &bench());
    for (from, to) in [("h", "healthy"), ("b", "broken")] {
        std::fs::create_dir(folder.path(to)).unwrap();
        for load in LOADS {
            let source = data.join(format!("{from}30hz{load}.csv.gz"));
            let (name, torque) = (format!("{to}/load{load:02}.mcap"), format!("{load}"));
            // The load stands for a torque nobody stated; the motor runs at 29.6 to 29.8 Hz.
            let args = ["convert", source.to_str().unwrap(), &name, "--sample-rate", "12800", "--unit", "1"];
            let done = folder.run(&[&args[..], &["--motor-speed", "29.7", "--torque", &torque]].concat());
            assert_eq!(done.status.code(), Some(0), "{}", crate::fixture::stderr(&done));
        }
    }
    let answer = folder.explain(&["box.toml", "broken", "--reference", "healthy"]);
    eprintln!("{}", answer.said);
    // With the broken tooth at 10 % the second stage's mesh hardly stands above other combs; all
    // loads are judged all the same.
    let refused: Vec<&str> = answer.limits().into_iter().filter(|limit| limit.contains("not judged")).collect();
    assert!(refused.is_empty(), "{refused:?}");
    let named = answer.named();
    for sensor in ["a1", "a2"] {
        assert!(
            named.iter().any(|(effect, at)| {
                matches!(effect.as_str(), "sensor_mounting" | "structural_resonance") && at == sensor
            }),
            "{sensor}: {named:?}"
        );
    }
    for (effect, at) in &named {
        assert!(
            at != "a4" && !["tooth_breakage", "root_crack", "pitting"].contains(&effect.as_str()),
            "{effect} at {at}"
        );
    }
    // The evidence is that the floor moved and took the lines along.
    for effect in answer.json["effects"].as_array().unwrap().iter().take(2) {
        let law = effect["evidence"]["law"].as_str().unwrap();
        assert!(law.contains("background moved") && law.contains("took the lines along"), "{law}");
    }
}
