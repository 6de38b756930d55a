//! Help, completions, manual pages, lists, and the shipped configuration.

use super::fixture::{Bench, gearwatch, output, stderr, stdout, text};

/// Names of all commands, from the help itself.
fn commands() -> Vec<String> {
    let help = stdout(&output(&["--help"]));
    let list = help.split("Commands:\n").nth(1).and_then(|rest| rest.split("\n\n").next()).unwrap().to_owned();
    let names = list.lines().filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    names.filter_map(|line| line.split_whitespace().next()).filter(|name| *name != "help").map(str::to_owned).collect()
}

#[test]
fn conform_every_command_has_help_with_examples() {
    let names = commands();
    assert!(names.len() >= 8, "{names:?}");
    for name in names {
        let help = output(&[&name, "--help"]);
        assert_eq!(help.status.code(), Some(0));
        let help = stdout(&help);
        assert!(help.contains("Example"), "{name} has no example:\n{help}");
        assert!(help.contains(&format!("gearwatch {name}")), "{name} is not in its examples:\n{help}");
    }
}

#[test]
fn conform_the_built_in_configuration_can_be_shown_checked_and_used() {
    let bench = Bench::new();
    let shown = output(&["config", "show"]);
    let path = bench.write("shown.toml", &stdout(&shown));
    // What is shown is a configuration, and shows itself again unchanged.
    assert_eq!(stdout(&output(&["config", "show", text(&path)])), stdout(&shown));
    let schema: serde_json::Value = serde_json::from_slice(&output(&["config", "schema"]).stdout).unwrap();
    assert_eq!(schema["properties"]["bench"]["type"], "array");
    let check = output(&["config", "check", text(&path)]);
    assert_eq!(check.status.code(), Some(0), "{}", stderr(&check));
}

/// Each bench that comes with the program can be written down, and is a bench file as it stands.
#[test]
fn conform_a_bench_file_to_start_from() {
    let bench = Bench::new();
    for shipped in gearwatch_sim::shipped::BENCHES {
        let path = bench.write("start.toml", &stdout(&output(&["config", "bench", shipped.name])));
        let told = output(&["info", text(&path)]);
        assert_eq!(told.status.code(), Some(0), "{}", stderr(&told));
        assert!(stdout(&told).contains(shipped.name), "{}", stdout(&told));
    }
    // The least that a bench file may be, as the documentation has it.
    let page = include_str!("../../../../docs/bench.md");
    let least = page.split("```toml\n").nth(1).and_then(|rest| rest.split("```").next()).unwrap();
    let told = output(&["info", text(&bench.write("least.toml", least))]);
    assert_eq!(told.status.code(), Some(0), "{}", stderr(&told));
    let unknown = output(&["config", "bench", "lathe"]);
    assert_eq!(unknown.status.code(), Some(3));
    assert!(stderr(&unknown).contains("single-pair"), "{}", stderr(&unknown));
}

#[test]
fn conform_lists_completions_and_manual() {
    let list = stdout(&output(&["list"]));
    for word in ["Sources", "test_signal", "pipe", "Sinks", "stdout", "Formats", "MCAP", "Effects", "eccentricity"] {
        assert!(list.contains(word), "{word}: {list}");
    }
    assert!(stdout(&output(&["list", "sources"])).contains("kind = \"growing_file\""));
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        assert!(stdout(&output(&["completions", shell])).contains("diagnose"), "{shell}");
    }
    assert!(stdout(&output(&["man"])).starts_with(".ie"));
    let bench = Bench::new();
    let folder = bench.path("share/man1");
    assert_eq!(output(&["man", "--folder", text(&folder)]).status.code(), Some(0));
    for name in commands() {
        assert!(folder.join(format!("gearwatch-{name}.1")).exists(), "{name}");
    }
}

/// A reader that leaves early is no error of a file command.
#[test]
fn conform_a_closed_pipe_is_no_error() {
    for args in [&["list"][..], &["config", "schema"], &["completions", "bash"]] {
        let mut child =
            gearwatch(args).stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        assert!(stderr(&output).is_empty(), "{args:?}: {}", stderr(&output));
    }
}
