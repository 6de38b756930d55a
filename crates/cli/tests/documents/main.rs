//! The pages that a new user follows: every command of them, in their order, in an empty folder.

mod fields;
mod links;
mod security;
mod words;

use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use gearwatch_sim::effects::{self, EntryPoint};

fn page(name: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(name)).unwrap()
}

/// The shell blocks of a page as one script that stops where an exit code is not the stated one:
/// `# exit N` behind a command, else 0.
fn script(text: &str) -> String {
    let mut out = String::from("set -u\n");
    for block in text.split("```sh\n").skip(1).filter_map(|rest| rest.split("\n```").next()) {
        let mut lines = block.lines();
        while let Some(line) = lines.next() {
            if line.trim().is_empty() || line.starts_with("cargo ") {
                continue;
            }
            let (command, comment) = line.split_once(" #").unwrap_or((line, ""));
            let code = comment.trim().strip_prefix("exit ").map_or(0, |code| code.trim().parse::<i32>().unwrap());
            out.push_str(command);
            if line.contains("<<'END'") {
                for text in lines.by_ref() {
                    write!(out, "\n{text}").unwrap();
                    if text == "END" {
                        break;
                    }
                }
            }
            let shown = command.trim().replace('\'', "'\\''");
            writeln!(
                out,
                "\ncode=$?; [ $code = {code} ] || {{ echo 'exit '$code', not {code}: {shown}' >&2; exit 1; }}"
            )
            .unwrap();
        }
    }
    out
}

/// Runs a page's commands in a new folder, which is given back; `files` are what must be there
/// afterwards.
fn follow(name: &str, least: usize, files: &[&str]) -> tempfile::TempDir {
    let script = script(&page(name));
    let commands = script.lines().filter(|line| line.starts_with("gearwatch ")).count();
    assert!(commands >= least, "{name}: only {commands} commands were found");
    let folder = tempfile::tempdir().unwrap();
    let binary = Path::new(env!("CARGO_BIN_EXE_gearwatch"));
    let path = std::env::join_paths(
        std::iter::once(binary.parent().unwrap().to_path_buf())
            .chain(std::env::split_paths(&std::env::var_os("PATH").unwrap())),
    )
    .unwrap();
    // Another service may hold the page's usual port on this machine.
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let script = script.replace("127.0.0.1:8650\"", &format!("127.0.0.1:{port}\""));
    let done =
        Command::new("bash").args(["-c", &script]).current_dir(folder.path()).env("PATH", path).output().unwrap();
    let said = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(done.status.success(), "{name}: {}\n{}", said(&done.stderr), said(&done.stdout));
    for file in files {
        assert!(folder.path().join(file).metadata().is_ok_and(|m| m.len() > 0), "{name}: {file} was not written");
    }
    folder
}

#[test]
fn conform_a_day_of_the_readme_runs_as_written() {
    follow("README.md", 8, &["normal.json", "sweep.html", "ranks/part-00001-of-00001.parquet"]);
}

#[test]
fn conform_get_started_runs_as_written() {
    let files = ["today.html", "ranks.jsonl", "ranks/part-00001-of-00001.parquet"];
    follow("docs/get-started.md", 15, &files);
}

#[test]
fn conform_helical_and_planetary_benches_run_as_written() {
    follow("docs/gearboxes.md", 8, &["monday.mcap", "normal.json"]);
}

/// A law that no effect has, concealed in a rig that differs from its sheet: place and law are
/// found, its sizes within 20 %, it predicts what was held out better than the name that comes
/// nearest, and the bench file that is written has it, alone.
#[test]
fn conform_physics_without_a_name_is_located_and_modelled() {
    let folder = follow("docs/free-terms.md", 3, &["answer/bench.toml", "again.mcap"]);
    let answer = std::fs::read_to_string(folder.path().join("answer/explanation.json")).unwrap();
    let answer: serde_json::Value = serde_json::from_str(&answer).unwrap();
    assert_eq!(answer["status"], "unexplained");
    let found = &answer["effects"][0];
    assert!(found["effect"].is_null(), "{found}");
    assert_eq!((&found["where"], &found["term"]["expression"]), (&"input.torsion".into(), &"dead_zone(u)".into()));
    assert_eq!(found["entry_point"]["kind"], "clearance");
    let near = |value: &serde_json::Value, truth: f64| (value.as_f64().unwrap() / truth - 1.0).abs() < 0.2;
    assert!(near(&found["term"]["parameters"]["nm_per_rad"], 9000.0), "{found}");
    assert!(near(&found["term"]["parameters"]["gap_rad"], 0.0025), "{found}");
    let fit = &answer["fit"];
    let after = fit["held_out_after"].as_f64().unwrap();
    for rival in fit["beside"].as_array().unwrap() {
        assert!(after < rival["held_out"].as_f64().unwrap(), "{fit}");
    }
    let bench = gearwatch_io::bench_file::read(&folder.path().join("answer/bench.toml")).unwrap();
    let laws: Vec<&str> = bench.terms.iter().map(|t| t.expression.as_str()).filter(|e| *e != "e(theta)").collect();
    assert_eq!(laws, ["dead_zone(u)"]);
}

/// A command that fails, or does not fail as stated, must be noticed: the check itself can fail.
#[test]
fn conform_a_wrong_exit_code_of_a_page_is_noticed() {
    for (page, good) in [("```sh\ntrue\n```", true), ("```sh\nfalse\n```", false), ("```sh\nfalse # exit 1\n```", true)]
    {
        let done = Command::new("bash").args(["-c", &script(page)]).output().unwrap();
        assert_eq!(done.status.success(), good, "{page}");
    }
}

/// The table of entry points holds every effect of the library, at the kind that the library says.
#[test]
fn conform_the_table_of_entry_points_is_that_of_the_library() {
    let text = page("docs/explain.md");
    for kind in EntryPoint::ALL {
        let mut own: Vec<&str> = effects::ALL.iter().filter(|e| e.entry_point() == kind).map(|e| e.id()).collect();
        own.sort_unstable();
        let row = text.lines().find(|line| line.starts_with(&format!("| {} |", kind.code()))).unwrap_or_default();
        assert!(row.ends_with(&format!("| {} |", own.join(", "))), "{}: {row}", kind.code());
    }
}
