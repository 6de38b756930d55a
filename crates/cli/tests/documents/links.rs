//! Links between the pages of the project, and the site that is built from them.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Where the repository is published: links that leave the folder of the site begin with it.
const PUBLISHED: &str = "https://github.com/gearwatch/gearwatch/blob/main/";

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// A page without its fenced blocks, in which `#` and brackets mean other things.
fn prose(text: &str) -> String {
    let mut fenced = false;
    let mut out = String::new();
    for line in text.lines() {
        let fence = line.trim_start().starts_with("```");
        fenced ^= fence;
        if !fenced && !fence {
            out.push_str(line);
            out.push('\n');
        }
    }
    out
}

/// The anchor that GitHub and mdBook give a heading: lower case, blanks as hyphens, punctuation
/// left out.
fn anchor(heading: &str) -> String {
    let kept = heading.trim().chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.collect::<String>().to_lowercase().replace(' ', "-")
}

fn anchors(text: &str) -> BTreeSet<String> {
    prose(text).lines().filter(|line| line.starts_with('#')).map(|line| anchor(line.trim_start_matches('#'))).collect()
}

fn pages(root: &Path) -> Vec<PathBuf> {
    let folder = |path: &Path| std::fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path()).collect::<Vec<_>>();
    let folders = [root.to_path_buf(), root.join("docs"), root.join("crates/python")];
    let mut out: Vec<PathBuf> = folders.iter().flat_map(|path| folder(path)).collect();
    out.retain(|path| path.extension().is_some_and(|extension| extension == "md"));
    out.sort();
    out
}

fn targets(text: &str) -> Vec<String> {
    prose(text).split("](").skip(1).filter_map(|rest| rest.split(')').next()).map(str::to_owned).collect()
}

/// What is wrong with a link of a page.
fn trouble(root: &Path, page: &Path, target: &str) -> Option<&'static str> {
    let (file, heading) = target.split_once('#').unwrap_or((target, ""));
    let to = match (file.strip_prefix(PUBLISHED), file) {
        (Some(path), _) => root.join(path),
        (None, "") => page.to_path_buf(),
        (None, file) => page.parent().unwrap().join(file),
    };
    let in_site =
        |path: &Path| path.canonicalize().is_ok_and(|path| path.starts_with(root.join("docs").canonicalize().unwrap()));
    match heading {
        _ if !to.exists() => Some("there is no such file"),
        _ if in_site(page) && !file.contains("://") && !in_site(&to) => {
            Some("it leaves the site; begin it with the published address")
        }
        "" => None,
        heading => {
            let there = std::fs::read_to_string(&to).is_ok_and(|text| anchors(&text).contains(heading));
            (!there).then_some("the page has no such heading")
        }
    }
}

/// Every relative link of all pages leads to a file that is there, and its anchor to a heading;
/// links of the site stay in it.
#[test]
fn conform_links_between_pages_lead_somewhere() {
    let root = root();
    let (mut broken, mut seen) = (Vec::new(), 0);
    for page in pages(&root) {
        for target in targets(&std::fs::read_to_string(&page).unwrap()) {
            let elsewhere = target.contains("://") && !target.starts_with(PUBLISHED);
            if elsewhere || target.contains(' ') || target.is_empty() {
                continue;
            }
            seen += 1;
            if let Some(why) = trouble(&root, &page, &target) {
                broken.push(format!("{}: {target}: {why}", page.file_name().unwrap().to_string_lossy()));
            }
        }
    }
    assert!(seen > 100, "only {seen} links were found");
    assert!(broken.is_empty(), "{broken:#?}");
}

/// A link that leads nowhere is noticed: the check itself can fail.
#[test]
fn conform_a_broken_link_is_noticed() {
    let root = root();
    let page = root.join("docs/alarms.md");
    for good in ["service.md", "#exit-codes", "page.md", &format!("{PUBLISHED}SECURITY.md")] {
        assert_eq!(trouble(&root, &page, good), None, "{good}");
    }
    for bad in ["servce.md", "#exit-code", "service.md#nowhere", "../README.md", &format!("{PUBLISHED}SECURTY.md")] {
        assert!(trouble(&root, &page, bad).is_some(), "{bad}");
    }
    assert!(
        targets("```\n[a](b)\n```\n[c](d)") == ["d"] && anchors("```sh\n# no\n```\n# Yes, it is").contains("yes-it-is")
    );
}

/// Every page of the folder is in the contents of the site, once.
#[test]
fn conform_every_page_is_in_the_contents() {
    let docs = root().join("docs");
    let mut listed = targets(&std::fs::read_to_string(docs.join("SUMMARY.md")).unwrap());
    listed.sort();
    let mut there: Vec<String> = std::fs::read_dir(&docs)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| name.ends_with(".md") && name != "SUMMARY.md")
        .collect();
    there.sort();
    assert_eq!(listed, there);
}
