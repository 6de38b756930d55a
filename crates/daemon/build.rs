//! Lists the files of the live page, so that a script in their folder is served without a line
//! elsewhere.

use std::path::Path;
use std::{env, fs};

const FOLDER: &str = "src/web/assets";

fn main() {
    println!("cargo::rerun-if-changed={FOLDER}");
    let root = env::var("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR");
    let folder = Path::new(&root).join(FOLDER);
    let entries = fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut names: Vec<String> =
        entries.map(|entry| entry.expect("an entry").file_name().into_string().expect("a name in UTF-8")).collect();
    names.sort_unstable();
    let lines: String = names.iter().filter_map(|name| line(name)).collect();
    let out = Path::new(&env::var("OUT_DIR").expect("cargo sets OUT_DIR")).join("assets.rs");
    fs::write(&out, format!("&[\n{lines}]\n")).unwrap_or_else(|error| panic!("{}: {error}", out.display()));
}

/// Path, media type and bytes; none for what is not served, such as a licence. The folder is that
/// of the build that reads the list: a clone that was moved has a list from before.
fn line(name: &str) -> Option<String> {
    let media = match Path::new(name).extension()?.to_str()? {
        "html" => "text/html; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "js" => "text/javascript; charset=utf-8",
        "svg" => "image/svg+xml",
        _ => return None,
    };
    let path = if name == "index.html" { "/".to_owned() } else { format!("/assets/{name}") };
    let file = format!("/{FOLDER}/{name}");
    Some(format!("    ({path:?}, {media:?}, include_bytes!(concat!(env!(\"CARGO_MANIFEST_DIR\"), {file:?}))),\n"))
}
