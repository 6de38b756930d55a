//! Links between the pages of the project.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// The anchor that Markdown viewers give a heading: lower case, blanks as hyphens, punctuation left out.
fn anchor(heading: &str) -> String {
    let kept = heading.trim().chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.collect::<String>().to_lowercase().replace(' ', "-")
}

fn anchors(text: &str) -> BTreeSet<String> {
    text.lines().filter(|line| line.starts_with('#')).map(|line| anchor(line.trim_start_matches('#'))).collect()
}

fn pages(root: &Path) -> Vec<PathBuf> {
    let folder = |path: &Path| std::fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path()).collect::<Vec<_>>();
    let mut out: Vec<PathBuf> = [root.to_path_buf(), root.join("docs")].iter().flat_map(|path| folder(path)).collect();
    out.retain(|path| path.extension().is_some_and(|extension| extension == "md"));
    out.sort();
    out
}

/// Every relative link of README, CONTRIBUTING and docs leads to a file that is there, and its anchor to a heading.
#[test]
fn conform_links_between_pages_lead_somewhere() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let (mut broken, mut seen) = (Vec::new(), 0);
    for page in pages(&root) {
        let text = std::fs::read_to_string(&page).unwrap();
        for target in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            if target.contains("://") || target.contains(' ') || target.is_empty() {
                continue;
            }
            seen += 1;
            let (file, heading) = target.split_once('#').unwrap_or((target, ""));
            let to = if file.is_empty() { page.clone() } else { page.parent().unwrap().join(file) };
            let there = match heading.is_empty() {
                true => to.exists(),
                false => std::fs::read_to_string(&to).is_ok_and(|text| anchors(&text).contains(heading)),
            };
            if !there {
                broken.push(format!("{}: {target}", page.file_name().unwrap().to_string_lossy()));
            }
        }
    }
    assert!(seen > 30, "only {seen} links were found");
    assert!(broken.is_empty(), "{broken:#?}");
}
