//! `docs/walk-through.md` as a reader follows it: every command of the page, in its order.

use gearwatch_explain::read::dsp::Transforms;
use gearwatch_explain::read::plain;
use gearwatch_io::OpenOptions;
use gearwatch_io::open::read_recording;

use crate::fixture::{Folder, stderr, stdout};

/// The commands of the page: lines of its shell blocks, with the exit code that a comment states.
fn commands(page: &str) -> Vec<(Vec<String>, i32)> {
    let blocks = page.split("```sh\n").skip(1).filter_map(|rest| rest.split("```").next());
    let text = blocks.collect::<String>().replace("\\\n", " ");
    let all = text.lines().filter_map(|line| line.trim().strip_prefix("gearwatch "));
    all.map(|line| {
        let (command, comment) = line.split_once('#').unwrap_or((line, ""));
        let code = comment.trim().strip_prefix("exit ").map_or(0, |code| code.trim().parse().unwrap());
        (command.split_whitespace().map(str::to_owned).collect(), code)
    })
    .collect()
}

/// Misfit per line against the reference, as the steps say.
fn misfit(explanation: &str) -> f64 {
    let json: serde_json::Value = serde_json::from_str(explanation).unwrap();
    let steps = json["steps"].as_array().unwrap();
    let said = steps.iter().find_map(|s| s.as_str().unwrap().split_once("lines, misfit ").map(|x| x.1)).unwrap();
    said.split_whitespace().next().unwrap().parse().unwrap()
}

/// Lines of the plain spectrum that its reference has not, but for mesh harmonics: 10 dB up, and 10
/// dB above the median beside.
fn new_lines(folder: &Folder, name: &str, mesh_hz: f64) -> Vec<f64> {
    let read =
        |session: &str| read_recording(&folder.path(&format!("{session}/{name}")), &OpenOptions::default()).unwrap();
    let (now, before) = (read("now"), read("before"));
    let mut transforms = Transforms::default();
    let mut out = Vec::new();
    for channel in now.channels.keys() {
        let mut of = |r| plain::spectrum(&mut transforms, r, channel).unwrap();
        let (a, b) = (of(&now), of(&before));
        for k in 30..a.amplitudes.len() - 30 {
            let mut beside = b.amplitudes[k - 30..k + 30].to_vec();
            beside.sort_by(f64::total_cmp);
            // A line of the reference reaches its neighbours through the window.
            let known = b.amplitudes[k - 2..=k + 2].iter().fold(0.0, |m: f64, x| m.max(*x)) > 3.16 * beside[30];
            let hz = k as f64 * a.hz_per_bin;
            let known = known || (hz - (hz / mesh_hz).round() * mesh_hz).abs() < 2.5;
            if !known && a.amplitudes[k] > 3.16 * b.amplitudes[k] && a.amplitudes[k] > 3.16 * beside[30] {
                out.push(hz);
            }
        }
    }
    out
}

/// The page's claims: nothing new stands in the plain spectrum, the concealed effect is named, and
/// the model with it predicts a load that took no part in the fit, which the sheet does not.
#[test]
fn conform_the_walk_through_can_be_walked() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
    let page = std::fs::read_to_string(format!("{root}/docs/walk-through.md")).unwrap();
    let folder = Folder::new();
    folder.write("bench.toml", &std::fs::read_to_string(format!("{root}/examples/walk-through/bench.toml")).unwrap());
    for name in ["before", "now", "later", "sheet", "model"] {
        std::fs::create_dir(folder.path(name)).unwrap();
    }
    let commands = commands(&page);
    assert!(commands.len() > 10, "{commands:?}");
    for (command, code) in commands {
        let args: Vec<&str> = command.iter().map(String::as_str).collect();
        let done = folder.run(&args);
        assert_eq!(done.status.code(), Some(code), "{args:?}: {}{}", stdout(&done), stderr(&done));
    }
    for (name, input_hz) in [("30hz-80nm.mcap", 30.0), ("18hz-40nm.mcap", 18.0)] {
        let new = new_lines(&folder, name, 29.0 * input_hz);
        assert!(new.is_empty(), "{name}: new lines at {new:?} Hz");
    }
    let answer: serde_json::Value = serde_json::from_str(&folder.read("answer/explanation.json")).unwrap();
    let first = &answer["effects"][0];
    assert_eq!((&first["effect"], &first["where"]), (&"bearing_compliance".into(), &"input".into()), "{answer}");
    let factor = |key: &str| first["parameters"]["factor"][key].as_f64().unwrap();
    assert!((factor("value") - 0.7).abs() < 2.0 * factor("sigma"), "{first}");
    let (sheet, model) =
        (misfit(&folder.read("by-sheet/explanation.json")), misfit(&folder.read("by-model/explanation.json")));
    assert!(model < 0.4 * sheet, "misfit per line {sheet} by the sheet, {model} by the model");
    let status = |name: &str| folder.read(name).contains("\"status\": \"consistent\"");
    assert!(status("by-model/explanation.json") && !status("by-sheet/explanation.json"));
}
