//! The systemd unit has no rights that it does not need.

use std::process::Command;

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
