//! Laws that no effect has, concealed one after the other in a rig that differs from its sheet:
//! what becomes of each (docs/free-terms.md).

use rayon::prelude::*;
use serde_json::Value;

use crate::fixture::Folder;

/// Law, place, coefficient and its size, and the edge of a dead zone (rad).
type Law = (&'static str, &'static str, &'static str, f64, Option<f64>);
const LAWS: [Law; 5] = [
    ("u^3", "input.bearing", "n_per_m3", 1.5e18, None),
    ("|u|u", "output.bearing", "n_per_m2", 1.2e13, None),
    ("|u|u", "stage1", "n_per_m2", 5e13, None),
    ("dead_zone(u)", "input.torsion", "nm_per_rad", 9000.0, Some(0.0025)),
    ("u^3", "output.torsion", "nm_per_rad3", 2e8, None),
];

/// One row of the table: what was concealed, and what is said of it.
fn row(folder: &Folder, k: usize, (law, place, name, size, gap): Law) -> String {
    let gap = gap.map_or(String::new(), |gap| format!(", gap_rad = {gap}"));
    let term =
        format!("\n[[term]]\nexpression = \"{law}\"\nplace = \"{place}\"\nparameters = {{ {name} = {size:e}{gap} }}\n");
    folder.write(&format!("{k}.toml"), &(folder.read("rig.toml") + &term));
    session(folder, &format!("{k}.toml"), &format!("now-{k}"), 100 * (k as u64 + 2));
    let (now, out) = (format!("now-{k}"), format!("answer-{k}"));
    let done = folder.run(&["explain", "sheet.toml", &now, "--reference", "before", "--out", &out]);
    assert_eq!(done.status.code(), Some(1), "{}", String::from_utf8_lossy(&done.stderr));
    let answer: Value = serde_json::from_str(&folder.read(&format!("{out}/explanation.json"))).unwrap();
    let first = &answer["effects"][0];
    let number = |value: &Value, show: fn(f64) -> String| value.as_f64().map_or("–".to_owned(), show);
    let sized = &first["parameters"][name];
    let (what, found) = match (&first["effect"], first["term"]["expression"].as_str()) {
        (Value::Null, Some(term)) => {
            let sizes = [&sized["value"], &sized["sigma"]].map(|value| number(value, |x| format!("{x:.1e}")));
            (term, sizes.join(" ± "))
        }
        (Value::String(effect), _) => (effect.as_str(), "–".to_owned()),
        _ => ("nothing", "–".to_owned()),
    };
    let at = first["where"].as_str().map_or(String::new(), |at| format!(" at {at}"));
    let misfit = ["held_out_before", "held_out_after"].map(|key| number(&answer["fit"][key], |x| format!("{x:.2}")));
    let [before, after] = misfit;
    format!("| {law} at {place} | {size:.1e} | {what}{at} | {found} | {before} | {after} |").replace("|u|", "\\|u\\|")
}

fn session(folder: &Folder, bench: &str, out: &str, seed: u64) {
    let points = [20.0, 28.0].into_iter().flat_map(|hz| [30.0, 60.0, 90.0].map(|nm| (hz, nm)));
    for (n, point) in points.enumerate() {
        let more = ["--background", "0.05", "--duration", "4"];
        folder.simulate(bench, &format!("{out}/{}-{}.mcap", point.0, point.1), point, seed + n as u64, &more);
    }
}

/// The table of docs/free-terms.md.
#[test]
#[ignore = "a minute or two: just campaign-laws"]
#[expect(clippy::print_stdout, reason = "the table is shown with --nocapture")]
fn campaign_laws_without_a_name() {
    let folder = Folder::new();
    let shipped = gearwatch_sim::shipped::BENCHES.iter().find(|b| b.name == "single-pair").unwrap().text;
    let sensor = "\n[[sensor]]\nname = \"acc_2\"\nshaft = \"output\"\ndirection_deg = 60.0\n";
    let sheet = shipped.to_owned() + sensor;
    folder.write("sheet.toml", &sheet);
    let rig = sheet.replace("bearing_n_per_m = 1.2e8", "bearing_n_per_m = 1.3e8");
    let rig = rig.replace("mesh_damping_ratio = 0.06", "mesh_damping_ratio = 0.07");
    let path = "\n[[term]]\nexpression = \"modal_filter\"\nplace = \"acc_1\"\nparameters = { frequency_1_hz = 1900.0, damping_ratio_1 = 0.05, gain_1 = 0.6 }\n";
    folder.write("rig.toml", &(rig + path));
    session(&folder, "rig.toml", "before", 100);
    let rows: Vec<String> = LAWS.par_iter().enumerate().map(|(k, law)| row(&folder, k, *law)).collect();
    println!(
        "| concealed | size | found | size | held out before | after |\n|---|---|---|---|---|---|\n{}",
        rows.join("\n")
    );
}
