//! Asks the linker for packed relocations where linker and system take them, which a small program
//! shows: the table of addresses that are set at the start shrinks from 0.9 MB to some kB.
//!
//! The C library must be glibc 2.36 or later then. `GEARWATCH_PORTABLE` leaves it out, for a
//! program that is to start on other machines too.

use std::path::Path;
use std::process::Command;
use std::{env, fs};

const FLAG: &str = "-Wl,-z,pack-relative-relocs";

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=GEARWATCH_PORTABLE");
    let target = env::var("TARGET").unwrap_or_default();
    let here = env::var("HOST").is_ok_and(|host| host == target) && target.ends_with("-linux-gnu");
    if here && env::var_os("GEARWATCH_PORTABLE").is_none() && starts().unwrap_or(false) {
        println!("cargo::rustc-link-arg-bins={FLAG}");
    }
}

/// Whether a program that is linked so starts here; none where it cannot be tried.
fn starts() -> Option<bool> {
    let folder = env::var_os("OUT_DIR")?;
    let (source, program) = (Path::new(&folder).join("trial.rs"), Path::new(&folder).join("trial"));
    fs::write(&source, "fn main() {}\n").ok()?;
    let mut rustc = Command::new(env::var_os("RUSTC")?);
    rustc.arg("-C").arg(format!("link-arg={FLAG}")).arg("-o").arg(&program).arg(&source);
    if let Some(linker) = env::var_os("RUSTC_LINKER") {
        let mut setting = std::ffi::OsString::from("linker=");
        setting.push(linker);
        rustc.arg("-C").arg(setting);
    }
    // What the linker says of a flag that it does not know is nobody's concern.
    let linked = rustc.output().ok()?.status.success();
    Some(linked && Command::new(&program).status().ok()?.success())
}
