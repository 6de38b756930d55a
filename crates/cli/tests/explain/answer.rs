//! What is written: the same bytes for the same files, pictures, a bench file that `simulate` runs,
//! a summary for people.

use crate::fixture::{Folder, stderr, stdout};

const WRITTEN: [&str; 5] = ["explanation.json", "bench.toml", "spectrum.svg", "mismatch.svg", "fit.svg"];

/// Two runs, in two folders with other names and other numbers of threads, write the same bytes; so
/// does the standard output.
#[test]
fn conform_the_same_files_give_the_same_bytes() {
    let folder = Folder::new();
    folder.session("bench.toml", "before", 1, &[]);
    folder.session("bench.toml", "now", 2, &["--effect", "bearing_compliance@input:factor=0.6"]);
    let run = |threads: &str, out: &str| {
        let done = std::process::Command::new(env!("CARGO_BIN_EXE_gearwatch"))
            .current_dir(folder.path(""))
            .args(["explain", "bench.toml", "now", "--reference", "before", "--out", out])
            .envs([("RAYON_NUM_THREADS", threads), ("TOKIO_WORKER_THREADS", threads)])
            .output()
            .unwrap();
        assert_eq!(done.status.code(), Some(1), "{}", stderr(&done));
        stdout(&done).replace(out, "answer")
    };
    assert_eq!(run("1", "first"), run("7", "second"));
    for name in WRITTEN {
        let read =
            |out: &str| std::fs::read(folder.path(out).join(name)).unwrap_or_else(|e| panic!("{out}/{name}: {e}"));
        assert!(read("first") == read("second"), "{name} differs");
    }
    // The order in which files are named is no matter either.
    let names = ["now/30hz-80nm.mcap", "now/18hz-40nm.mcap", "now/30hz-40nm.mcap", "now/18hz-80nm.mcap"];
    let args = [&["explain", "bench.toml"], &names[..], &["--reference", "before", "--out", "third"]].concat();
    assert_eq!(folder.run(&args).status.code(), Some(1));
    assert!(
        folder.read("third/explanation.json") == folder.read("first/explanation.json"),
        "the order of files matters"
    );
}

/// What is written can be used: the bench file simulates, the pictures are SVG, the summary answers
/// what, where, how sure, how much better and what next before anything else, and a later answer
/// without a mismatch leaves no picture of this one.
#[test]
fn conform_an_answer_can_be_used() {
    let folder = Folder::new();
    folder.session("bench.toml", "before", 1, &[]);
    folder.session("bench.toml", "again", 3, &[]);
    folder.session("bench.toml", "now", 2, &["--effect", "bearing_compliance@input:factor=0.6"]);
    let answer = folder.explain(&["bench.toml", "now", "--reference", "before", "--report", "page.html"]);
    assert_eq!(answer.code, Some(1), "{}", answer.said);
    let (_, written) = answer.said.split_once("  written ").unwrap_or_else(|| panic!("{}", answer.said));
    for name in WRITTEN.map(|name| format!("answer/{name}")).iter().map(String::as_str).chain(["page.html"]) {
        assert!(written.contains(name) && folder.path(name).exists(), "{name} is not in:\n{}", answer.said);
    }
    assert!(!answer.named().is_empty(), "{}", answer.said);
    for heading in ["  what ", "  how sure ", "  where ", "  held out ", "they differ most at", "  written "] {
        assert!(answer.said.contains(heading), "{heading:?} is not in:\n{}", answer.said);
    }
    assert!(!answer.said.contains("steps"), "{}", answer.said);
    assert!(answer.said.lines().all(|line| line.chars().count() <= 130), "{}", answer.said);
    for name in &WRITTEN[2..] {
        let svg = folder.read(&format!("answer/{name}"));
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>") && svg.len() < 200_000, "{name}");
    }
    let model = folder.run(&["simulate", "answer/bench.toml", "--duration", "0.5", "-o", "model.mcap"]);
    assert_eq!(model.status.code(), Some(0), "{}", stderr(&model));
    let told = folder.run(&["explain", "bench.toml", "now", "--reference", "before", "--steps"]);
    assert!(stderr(&told).contains("steps") && stdout(&told).starts_with('{'), "{}", stderr(&told));

    let nothing = folder.explain(&["bench.toml", "again", "--reference", "before"]);
    assert_eq!((nothing.status(), nothing.code), ("consistent", Some(0)), "{}", nothing.said);
    assert!(!folder.path("answer/mismatch.svg").exists() && !folder.path("answer/fit.svg").exists());
    assert!(folder.read("answer/spectrum.svg").contains("</svg>"));
}

/// `--blind-spots` with recordings takes their settings, without any the usual ones; each effect of
/// the library is spoken of.
#[test]
fn conform_blind_spots_speak_of_every_effect() {
    let folder = Folder::new();
    folder.simulate("bench.toml", "now/a.mcap", (30.0, 80.0), 2, &[]);
    let ask = |args: &[&str]| {
        let done = folder.run(&[&["explain", "--blind-spots", "bench.toml"], args].concat());
        assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
        stdout(&done)
    };
    let (one, usual) = (ask(&["now"]), ask(&[]));
    assert!(one.contains("recorded at 30.0 Hz 80 N m\n"), "{one}");
    assert!(usual.contains("18.0 Hz 32 N m, 18.0 Hz 80 N m, 30.0 Hz 32 N m, 30.0 Hz 80 N m\n"), "{usual}");
    for effect in gearwatch_sim::effects::ALL.iter().filter(|e| e.id() != "belt_slip") {
        for said in [&one, &usual] {
            assert!(said.contains(&format!("  {} at ", effect.id())), "{} is not in:\n{said}", effect.id());
        }
    }
    // One operating point cannot do without a reference, and asks for a second speed and load.
    assert!(one.contains("one load: invisible without a reference") && !usual.contains("one load:"), "{one}");
    assert!(one.contains("record a second speed") && one.contains("record a second load"), "{one}");
    assert!(!usual.contains("record a second"), "{usual}");
}
