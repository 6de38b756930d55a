//! The checksums of a release are signed and checked by `packaging/sign.sh`, with keys that this
//! test makes and throws away.

use std::path::Path;
use std::process::Command;

use crate::fixture::{Bench, text};

fn script(args: &[&str]) -> (bool, String) {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../../packaging/sign.sh");
    let output = Command::new(script).args(args).output().expect("bash runs the script");
    (output.status.success(), String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned())
}

fn key(path: &Path) -> bool {
    let made =
        Command::new("ssh-keygen").args(["-q", "-t", "ed25519", "-N", "", "-C", "test", "-f", text(path)]).status();
    made.is_ok_and(|status| status.success())
}

#[test]
fn conform_a_release_is_what_was_signed() {
    let bench = Bench::new();
    let (ours, theirs) = (bench.path("ours"), bench.path("theirs"));
    if !key(&ours) || !key(&theirs) {
        return eprintln!("skipped: ssh-keygen is not installed");
    }
    let public = std::fs::read_to_string(bench.path("ours.pub")).unwrap();
    let signers = bench.write("allowed_signers", &format!("release@example namespaces=\"gearwatch-release\" {public}"));
    let folder = bench.path("files");
    std::fs::create_dir(&folder).unwrap();
    let write = |name: &str, content: &str| std::fs::write(folder.join(name), content).unwrap();
    write("program", "1");
    let sums = Command::new("sha256sum").arg("program").current_dir(&folder).output().unwrap().stdout;
    std::fs::write(folder.join("SHA256SUMS"), sums).unwrap();
    let check = || script(&["--check", text(&signers), text(&folder)]);
    let refused = |with: &str| {
        let (good, said) = check();
        assert!(!good && said.contains(with), "{said}");
    };
    refused("not signed");
    let (signed, said) = script(&[text(&ours), text(&folder)]);
    assert!(signed, "{said}");
    let (good, said) = check();
    assert!(good && said.contains("release@example"), "{said}");
    // Another program, one more file, other checksums, another key.
    write("program", "2");
    refused("program: FAILED");
    assert!(!script(&[text(&ours), text(&folder)]).0, "what does not fit its checksums is not signed");
    write("program", "1");
    write("more", "");
    refused("more is not in SHA256SUMS");
    std::fs::remove_file(folder.join("more")).unwrap();
    let (signed, said) = script(&[text(&theirs), text(&folder)]);
    assert!(signed, "{said}");
    refused("nobody");
    assert!(script(&[text(&ours), text(&folder)]).0);
    let sums = std::fs::read_to_string(folder.join("SHA256SUMS")).unwrap();
    write("SHA256SUMS", &format!("{sums}\n"));
    assert!(!check().0, "checksums are not those that were signed");
}
