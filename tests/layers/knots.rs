//! Imports within a crate: two files may import each other, three or more are a knot of which no
//! part can be read alone. A module and those below it count as one subject.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Which modules of the crate a module imports.
type Graph = BTreeMap<String, BTreeSet<String>>;

/// The paths of an import, without braces: `a::{b, c::d}` is `a::b` and `a::c::d`.
fn paths(import: &str) -> Vec<String> {
    let Some((head, rest)) = import.split_once('{') else { return vec![import.to_owned()] };
    let body = rest.rsplit_once('}').map_or(rest, |(body, _)| body);
    let (mut depth, mut from, mut parts) = (0, 0, Vec::new());
    for (at, c) in body.char_indices() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                parts.push(&body[from..at]);
                from = at + 1;
            }
            _ => {}
        }
    }
    parts.push(&body[from..]);
    parts.into_iter().filter(|part| !part.is_empty()).flat_map(|part| paths(&format!("{head}{part}"))).collect()
}

/// What code names by its path into the crate.
fn named(code: &str) -> impl Iterator<Item = String> {
    let of_path = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
    let into_crate = |path: &&str| ["crate::", "super::"].iter().any(|start| path.starts_with(start));
    code.split(move |c| !of_path(c)).filter(into_crate).map(str::to_owned)
}

/// What a file imports or names by its path, but for its unit tests.
fn imports(text: &str) -> Vec<String> {
    let code = text.split("#[cfg(test)]").next().unwrap_or_default();
    let lines: Vec<&str> = code.lines().map(str::trim).filter(|line| !line.starts_with("//")).collect();
    let begins = |line: &&str| {
        let word = line.strip_prefix("pub").map_or(*line, |rest| rest.trim_start_matches(|c| c != ' ').trim_start());
        word.starts_with("use ")
    };
    let of = |statement: &str| {
        let lines: Vec<&str> = statement.lines().collect();
        let (code, import) = lines.split_at(lines.iter().rposition(begins).unwrap_or(lines.len()));
        let import = import.concat();
        let import = import.split_once("use ").map(|(_, path)| path.split_whitespace().collect::<String>());
        let imported = import.map(|path| paths(&path)).unwrap_or_default();
        imported.into_iter().chain(named(&code.join("\n"))).collect::<Vec<_>>()
    };
    lines.join("\n").split(';').flat_map(of).collect()
}

/// The module of an imported path, where it is one of the crate.
fn module<'a>(modules: &'a BTreeMap<String, String>, own: &str, path: &str) -> Option<&'a str> {
    let mut parts: Vec<&str> = own.split("::").collect();
    let mut rest = path.split("::").peekable();
    match rest.next()? {
        "crate" => parts.clear(),
        "super" => {
            parts.pop();
            while rest.next_if_eq(&"super").is_some() {
                parts.pop();
            }
        }
        _ => return None,
    }
    parts.extend(rest);
    let known = |count: usize| modules.get_key_value(&parts[..count].join("::")).map(|(name, _)| name.as_str());
    (1..=parts.len()).rev().find_map(known)
}

fn graph(folder: &Path) -> Graph {
    let (mut modules, mut folders) = (BTreeMap::new(), vec![folder.to_owned()]);
    while let Some(below) = folders.pop() {
        for entry in std::fs::read_dir(below).expect("source folder") {
            let path = entry.expect("entry").path();
            let name = path.strip_prefix(folder).expect("below").with_extension("");
            let name = name.iter().map(|part| part.to_string_lossy()).collect::<Vec<_>>().join("::");
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") && !name.ends_with("tests") && name != "lib" {
                modules.insert(name, std::fs::read_to_string(&path).expect("source file"));
            }
        }
    }
    let imported = |name: &String, text: &String| {
        let all = imports(text);
        let of_crate = all.iter().filter_map(|path| module(&modules, name, path));
        let below = |a: &str, b: &str| a.strip_prefix(b).is_some_and(|rest| rest.is_empty() || rest.starts_with("::"));
        of_crate.filter(|other| !below(other, name) && !below(name, other)).map(str::to_owned).collect()
    };
    modules.iter().map(|(name, text)| (name.clone(), imported(name, text))).collect()
}

/// All modules that a module reaches by imports of imports.
fn reached(graph: &Graph, from: &str) -> BTreeSet<String> {
    let (mut out, mut next) = (BTreeSet::new(), vec![from.to_owned()]);
    while let Some(name) = next.pop() {
        next.extend(graph[&name].iter().filter(|other| out.insert((*other).clone())).cloned());
    }
    out
}

/// Modules that reach each other, two at least.
fn knots(graph: &Graph) -> BTreeSet<Vec<String>> {
    let reached: BTreeMap<&String, _> = graph.keys().map(|name| (name, reached(graph, name))).collect();
    let with = |name: &String| {
        let others = reached[name].iter().filter(|other| reached[other].contains(name));
        others.cloned().collect::<Vec<_>>()
    };
    graph.keys().map(with).filter(|knot| knot.len() > 1).collect()
}

#[test]
fn conform_no_more_than_two_files_of_a_crate_import_each_other() {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("workspace root").join("crates");
    let mut seen = 0;
    for entry in std::fs::read_dir(crates).expect("crates") {
        let folder = entry.expect("entry").path();
        let name = folder.file_name().expect("a name").to_string_lossy().into_owned();
        let graph = graph(&folder.join("src"));
        seen += graph.values().map(BTreeSet::len).sum::<usize>();
        let knots = knots(&graph).into_iter().filter(|knot| knot.len() > 2).collect::<Vec<_>>();
        assert!(knots.is_empty(), "{name}: {knots:#?}");
    }
    assert!(seen > 500, "only {seen} imports were found");
}

#[test]
fn analytic_imports_are_read_and_knots_found() {
    assert_eq!(paths("a::{b,c::{d,e}}"), ["a::b", "a::c::d", "a::c::e"]);
    let text = "//! use x::y;\npub(crate) use super::{\n    a::B,\n    c,\n};\nfn f() -> super::g::H {\n    crate::i::j()\n}\nuse crate::d::E;\n#[cfg(test)]\nuse crate::t;\n";
    assert_eq!(imports(text), ["super::a::B", "super::c", "crate::d::E", "super::g::H", "crate::i::j"]);
    let edge = |from: &str, to: &[&str]| (from.to_owned(), to.iter().map(|name| (*name).to_owned()).collect());
    let graph = Graph::from([edge("a", &["b"]), edge("b", &["c"]), edge("c", &["a", "d"]), edge("d", &[])]);
    assert_eq!(knots(&graph), BTreeSet::from([["a", "b", "c"].map(str::to_owned).to_vec()]));
}
