//! The systemd unit has no rights that it does not need, and does what it is for under a real
//! systemd.

use std::process::Command;

/// It is started again for ever, has descriptors for its connections and files, and cannot take all
/// memory of the machine.
#[test]
fn regress_the_unit_has_its_limits() {
    let unit = include_str!("../../../../packaging/gearwatch.service");
    for line in [
        "StartLimitIntervalSec=0",
        "LimitNOFILE=4096",
        "MemoryMax=1G",
        "TasksMax=512",
        "Restart=on-failure",
        "StandardError=journal",
    ] {
        assert!(unit.lines().any(|found| found == line), "{line}");
    }
    // It hides /proc/sys, and with it the identity of the boot: kills were counted with 32 770
    // results each, whatever they took.
    assert!(!unit.lines().any(|line| line.starts_with("ProcSubset=")));
}

#[test]
fn conform_the_unit_is_hardened() {
    let unit = concat!(env!("CARGO_MANIFEST_DIR"), "/../../packaging/gearwatch.service");
    // The threshold is ten times the exposure: 2.0 at most.
    let analysed = Command::new("systemd-analyze").args(["security", "--offline=yes", "--threshold=20", unit]).output();
    let Ok(output) = analysed else {
        eprintln!("skipped: systemd-analyze is not installed");
        return;
    };
    let said = String::from_utf8_lossy(&output.stdout);
    println!("{}", said.lines().last().unwrap_or_default());
    assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
}

/// Every key is one that systemd knows, with a value that it takes.
#[test]
fn conform_the_unit_has_no_key_that_systemd_does_not_know() {
    let unit = concat!(env!("CARGO_MANIFEST_DIR"), "/../../packaging/gearwatch.service");
    let Ok(output) = Command::new("systemd-analyze").args(["verify", "--man=no", unit]).output() else {
        eprintln!("skipped: systemd-analyze is not installed");
        return;
    };
    let said = String::from_utf8_lossy(&output.stderr);
    // The program need not be installed on the machine that tests.
    let wrong: Vec<&str> =
        said.lines().filter(|line| line.contains("gearwatch") && !line.contains("is not executable")).collect();
    assert!(wrong.is_empty(), "{wrong:?}");
}

/// Start, reload, a wrong configuration, kills and a stop, under a systemd that the script starts
/// beside whatever runs the machine. The journal was empty once: what a unit says goes the way of
/// its standard output where nothing else is said.
#[test]
fn regress_the_unit_runs_under_a_real_systemd() {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../../packaging/systemd-test.sh");
    let output = Command::new(script).arg(env!("CARGO_BIN_EXE_gearwatch")).output().expect("bash runs the script");
    let said = String::from_utf8_lossy(&output.stdout);
    match output.status.code() {
        Some(77) => eprintln!("{said}"),
        Some(0) => println!("{said}"),
        _ => panic!("{said}{}", String::from_utf8_lossy(&output.stderr)),
    }
}
