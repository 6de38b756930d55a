//! The pages that a new user follows: every command of them, in their order, in an empty folder.

mod links;
mod security;

use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use gearwatch_sim::effects::{self, EntryPoint};

fn page(name: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(name)).unwrap()
}

/// The shell blocks of a page as one script that stops where an exit code is not the stated one: `# exit N` behind a command, else 0.
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

/// Runs a page's commands; `files` are what must be there afterwards.
fn follow(name: &str, least: usize, files: &[&str]) {
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
