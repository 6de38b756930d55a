//! The fields of a verdict have one table in the code. The reference page is made from it; the
//! page, the layouts, the examples and the Python package name no field that is not in it.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use gearwatch_core::verdict::{FIELDS, Field, Holds, Part, field};

use crate::page;

const PAGE: &str = "docs/verdict.md";
const BEGIN: &str = "<!-- fields: made by the test of crates/cli/tests/documents/fields.rs -->\n";
const END: &str = "<!-- end of fields -->\n";

fn kind(holds: Holds) -> &'static str {
    match holds {
        Holds::Text => "text",
        Holds::Code(_) => "code",
        Holds::Time => "integer (time)",
        Holds::Count | Holds::Level => "integer",
        Holds::Flag => "true or false",
        Holds::Number => "number or null",
    }
}

fn table(out: &mut String, fields: &[&Field], name: impl Fn(&Field) -> String, meaning: impl Fn(&Field) -> String) {
    out.push_str("| field | type | unit | meaning |\n|---|---|---|---|\n");
    for field in fields {
        let unit = if field.unit == "channel" { "`unit`" } else { field.unit };
        writeln!(out, "| `{}` | {} | {unit} | {} |", name(field), kind(field.holds), meaning(field)).unwrap();
    }
    out.push('\n');
}

/// The generated part of the reference page.
fn reference() -> String {
    let of = |part: Part| FIELDS.iter().filter(|field| field.part == part).collect::<Vec<_>>();
    let mut out = String::from("## The window\n\n");
    table(&mut out, &of(Part::Window), |f| f.name.clone(), |f| f.meaning.clone());
    out.push_str("## Each harmonic\n\nFor `N` from 1 to 5, the first five mesh harmonics.\n\n");
    table(&mut out, &of(Part::Harmonic(1)), |f| f.name.replace("1x", "Nx"), |f| f.meaning.replace("1x", "Nx"));
    out.push_str("## Nearest states\n\nFor `N` from 1 to 3, where a signature table was compared.\n\n");
    table(&mut out, &of(Part::State(1)), |f| f.name.replace("_1", "_N"), |f| f.meaning.replace("state 1", "state N"));
    out.push_str("## Condition indicators\n\n");
    let indicators: Vec<_> = of(Part::Indicator);
    let values: Vec<_> = indicators
        .iter()
        .copied()
        .filter(|f| !(f.name.ends_with("_sigma") || f.name.ends_with("_base") || f.name.ends_with("_percent")))
        .collect();
    out.push_str("Each value `X` has four companions: `X_sigma`, `X_base`, `X_dev_percent` and `X_dev_sigma_percent`. Those of the baseline are left out where it does not know `X`.\n\n");
    table(
        &mut out,
        &values,
        |f| f.name.clone(),
        |f| f.meaning.replace("(docs/indicators.md)", "([definition](indicators.md))"),
    );
    out.push_str("## Codes\n\n");
    for field in FIELDS.iter().filter(|f| matches!(f.part, Part::Window | Part::Harmonic(1))) {
        let Holds::Code(codes) = field.holds else { continue };
        writeln!(out, "### {}\n\n| code | meaning |\n|---|---|", field.name.replace("1x", "Nx")).unwrap();
        for (code, meaning) in codes() {
            let code = if code.is_empty() { "(empty)".into() } else { format!("`{code}`") };
            writeln!(out, "| {code} | {} |", meaning.replace('|', "\\|")).unwrap();
        }
        out.push('\n');
    }
    out
}

/// `GEARWATCH_WRITE=1` writes the table into the page.
#[test]
fn conform_the_reference_of_the_verdict_is_that_of_the_code() {
    let text = page(PAGE);
    let from = text.find(BEGIN).expect("the page has a place for the table") + BEGIN.len();
    let to = text.find(END).expect("the table has an end");
    let made = format!("{}\n{}{}", &text[..from], reference(), &text[to..]);
    if std::env::var_os("GEARWATCH_WRITE").is_some() {
        std::fs::write(Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(PAGE), &made).unwrap();
    }
    assert!(
        text == made,
        "{PAGE} is not that of the code; GEARWATCH_WRITE=1 cargo test -p gearwatch --test documents fields"
    );
}

fn files(folder: &str, extensions: &[&str]) -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(folder);
    let mut out = Vec::new();
    let mut folders = vec![root];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| extensions.iter().any(|x| e == *x)) {
                out.push(path);
            }
        }
    }
    out
}

/// Words that look like a field of a harmonic: `rank_1x`, `dev_sigma_${h}x_percent`, with `1` in
/// place of what a template puts there.
fn harmonic_fields(text: &str) -> BTreeSet<String> {
    let mut plain = text.to_owned();
    for template in ["${h}", "${k}", "${view.harmonic}", "{h}", "{k}", "{name}"] {
        plain = plain.replace(template, "1");
    }
    let word = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let words = plain.split(|c| !word(c));
    let begins = ["rank_", "level_", "p_", "dev_", "amp_", "sigma_", "floor_", "base_"];
    let harmonic = |w: &&str| ["_1x", "_2x", "_3x", "_4x", "_5x"].iter().any(|h| w.contains(h));
    words.filter(harmonic).filter(|w| begins.iter().any(|b| w.starts_with(b))).map(str::to_owned).collect()
}

#[test]
fn conform_page_examples_and_python_name_fields_that_are_there() {
    let mut seen = BTreeSet::new();
    let all = files("crates/daemon/src/web/assets", &["js"])
        .into_iter()
        .chain(files("examples", &["py"]))
        .chain(files("crates/python/python", &["py", "pyi"]))
        .chain(files("docs", &["md"]));
    for path in all {
        for name in harmonic_fields(&std::fs::read_to_string(&path).unwrap()) {
            // The phase is of `amplitudes` in Python, whose rows are no verdicts; the rest of its
            // names are the same.
            let of_verdict = field(&name).is_some();
            assert!(of_verdict || name.starts_with("phase"), "{}: no verdict has {name:?}", path.display());
            seen.insert(name);
        }
    }
    assert!(seen.len() > 8, "only {seen:?}");
    assert!(harmonic_fields("v[`lvl_${h}x`] dev_${h}x_percent devx_1x").contains("dev_1x_percent"));
}

/// What the layouts of viewers draw is what a verdict has.
#[test]
fn conform_layouts_draw_fields_that_are_there() {
    let folder = tempfile::tempdir().unwrap();
    let run = |args: &[&str]| {
        let done =
            Command::new(env!("CARGO_BIN_EXE_gearwatch")).args(args).current_dir(folder.path()).output().unwrap();
        assert!(done.status.success(), "{args:?}: {}", String::from_utf8_lossy(&done.stderr));
        String::from_utf8(done.stdout).unwrap()
    };
    std::fs::write(folder.path().join("bench.toml"), run(&["config", "bench", "single-pair"])).unwrap();
    for viewer in ["foxglove", "plotjuggler"] {
        let text = run(&["layout", "bench.toml", "--viewer", viewer]);
        let drawn: BTreeSet<&str> = text
            .split("/rank")
            .skip(1)
            .filter_map(|rest| rest.trim_start_matches(|c| c != '.' && c != '/').get(1..))
            .filter_map(|rest| rest.split(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).next())
            .collect();
        assert!(drawn.len() > 9, "{viewer}: {drawn:?}");
        for name in drawn {
            assert!(field(name).is_some(), "{viewer} draws {name:?}");
        }
    }
}
