//! `gearwatch paper` with its figures, as users run it.

use std::process::Command;

/// Figures 3 to 8: 45 points, findings that the points bear out, and a picture of each. What the
/// paper claims of severity holds under load at 30 Hz; what its figure 7 shows does not hold on
/// this bench.
#[test]
fn conform_figures_of_the_paper() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_gearwatch"));
    let output = command
        .args(["paper", "--plot", "figures.html", "--format", "json"])
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let all: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let figures = &all["figures"];
    let points = figures["points"].as_array().unwrap();
    assert_eq!(points.len(), 5 * 3 * 3);
    let value = |state: &str, hz: f64, nm: f64, key: &str| {
        let is =
            |p: &&serde_json::Value| p["state"] == state && p["motor_speed_hz"] == hz && p["brake_torque_nm"] == nm;
        points.iter().find(is).unwrap()[key].as_f64().unwrap()
    };
    let states = ["normal", "compound_1", "compound_2", "compound_3", "compound_4"];
    for pair in states.windows(2) {
        let [before, after] = [pair[0], pair[1]].map(|state| value(state, 30.0, 202.0, "peak_to_peak_m_per_s2"));
        assert!(after > before, "{pair:?}: {before} {after}");
    }
    for state in states {
        let [least, most] = [10.0, 20.0].map(|hz| value(state, hz, 202.0, "rms_m_per_s2"));
        assert!(most > least, "{state}: {least} {most}");
        let [slow, fast] = [20.0, 30.0].map(|hz| value(state, hz, 202.0, "rms_m_per_s2"));
        assert!(fast < slow, "{state}: {slow} {fast}");
    }
    let finding = |code: &str| {
        let found = figures["findings"].as_array().unwrap().iter().find(|finding| finding["code"] == code).unwrap();
        (found["holds"].as_u64().unwrap(), found["of"].as_u64().unwrap())
    };
    // As docs/paper.md says.
    let said = ["severity", "severity_idle", "load", "speed", "rms_speed", "ranks"].map(finding);
    assert_eq!(said, [(22, 24), (6, 12), (27, 30), (24, 30), (0, 5), (10, 65)]);
    let sentences: Vec<&str> =
        figures["findings"].as_array().unwrap().iter().filter_map(|f| f["sentence"].as_str()).collect();
    assert!(sentences[3].contains("14 of 15") && sentences[3].contains("10 of 15"), "{sentences:?}");
    let pits = |of: &str| {
        figures["figure_8"][of].as_array().unwrap()[6..9]
            .iter()
            .flat_map(|row| row["levels"].as_array().unwrap().clone())
            .collect::<Vec<_>>()
    };
    assert!(pits("bench").iter().all(|level| level == 0) && pits("paper").iter().any(|level| level == 5));
    let page = std::fs::read_to_string(folder.path().join("figures.html")).unwrap();
    assert_eq!(page.matches("<svg").count(), 5 + 3);
}
