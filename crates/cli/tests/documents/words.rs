//! The language of the pages: short sentences, and programs that are not persons
//! (docs/contributing.md, "Words").

use std::path::{Path, PathBuf};

/// A longer sentence is two.
const MOST_WORDS: usize = 35;
/// Words of persons, or of this project's own making, for which the field has better ones.
const AVOIDED: [&str; 8] = ["whoever", "speaks", "hears", "told", "nobody", "owns up", "cries out", "good news"];
/// Field terms in other spellings than the pages use: British, as in the codes of the instrument.
const SPELLED: [(&str, &str); 15] = [
    ("runout", "run-out"),
    ("runouts", "run-outs"),
    ("side band", "sideband"),
    ("side bands", "sidebands"),
    ("gear box", "gearbox"),
    ("gear boxes", "gearboxes"),
    ("meshing frequency", "mesh frequency"),
    ("tooth mesh frequency", "mesh frequency"),
    ("sampling rate", "sample rate"),
    ("modeled", "modelled"),
    ("behavior", "behaviour"),
    ("color", "colour"),
    ("analyzer", "analyser"),
    ("quantization", "quantisation"),
    ("center distance", "centre distance"),
];

fn pages() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let docs = std::fs::read_dir(root.join("docs")).unwrap().map(|entry| entry.unwrap().path());
    let mut out: Vec<PathBuf> = docs.filter(|path| path.extension().is_some_and(|e| e == "md")).collect();
    out.push(root.join("README.md"));
    out.sort();
    out
}

/// A line that begins a paragraph of its own: a list item or a heading, without its mark.
fn item(line: &str) -> Option<&str> {
    let (mark, rest) = line.split_once(' ')?;
    let number = mark.strip_suffix('.').is_some_and(|n| !n.is_empty() && n.chars().all(|c| c.is_ascii_digit()));
    (number || ["-", "*"].contains(&mark) || mark.chars().all(|c| c == '#')).then_some(rest)
}

/// Paragraphs, list items and cells of tables, without fenced blocks and comments.
fn paragraphs(text: &str) -> Vec<String> {
    let (mut out, mut current, mut fenced) = (Vec::new(), String::new(), false);
    for line in text.lines().map(str::trim) {
        let fence = line.starts_with("```");
        fenced ^= fence;
        if fence || line.is_empty() || line.starts_with("<!--") {
            out.push(std::mem::take(&mut current));
        } else if fenced {
            continue;
        } else if line.starts_with('|') {
            out.extend(line.split('|').map(str::to_owned));
        } else if let Some(rest) = item(line) {
            out.push(std::mem::replace(&mut current, rest.to_owned()));
        } else {
            current = format!("{current} {line}");
        }
    }
    out.push(current);
    out
}

/// Without the targets of links.
fn plain(paragraph: &str) -> String {
    let mut parts = paragraph.split("](");
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |out, part| out + part.split_once(')').map_or("", |(_, rest)| rest))
}

/// Sentences end with a full stop, a question mark, an exclamation mark or a colon, unless the stop
/// follows an initial.
fn sentences(paragraph: &str) -> Vec<Vec<&str>> {
    let mut out = vec![Vec::new()];
    for word in paragraph.split_whitespace() {
        if word.chars().any(char::is_alphanumeric) {
            out.last_mut().expect("there is always one").push(word);
        }
        let initial = word.len() == 2 && word.starts_with(|c: char| c.is_uppercase());
        let ends = word.trim_end_matches(['*', ')', '"', '`']).ends_with(['.', '?', '!', ':']);
        if ends && !initial {
            out.push(Vec::new());
        }
    }
    out
}

/// What is wrong with the words of a text.
fn troubles(text: &str) -> Vec<String> {
    let mut out = Vec::new();
    for paragraph in paragraphs(text).iter().map(|paragraph| plain(paragraph)) {
        for sentence in sentences(&paragraph) {
            if sentence.len() > MOST_WORDS {
                out.push(format!("{} words: {} …", sentence.len(), sentence[..8].join(" ")));
            }
        }
        // Names of fields and commands are what they are.
        let prose: String = paragraph.split('`').step_by(2).collect::<Vec<_>>().join(" ").to_lowercase();
        let spaced = format!(" {} ", prose.replace(|c: char| !(c.is_alphanumeric() || c == '_'), " "));
        let misspelt = SPELLED.iter().filter(|(wrong, _)| spaced.contains(&format!(" {wrong} ")));
        out.extend(misspelt.map(|(wrong, right)| format!("{wrong:?}, which is {right:?} here")));
        out.extend(
            AVOIDED
                .iter()
                .filter(|word| spaced.contains(&format!(" {word} ")))
                .map(|word| format!("{word:?}: {}", paragraph.trim().chars().take(80).collect::<String>())),
        );
    }
    out
}

#[test]
fn conform_pages_are_written_in_short_plain_sentences() {
    let mut all = Vec::new();
    for page in pages() {
        let name = page.file_name().unwrap().to_string_lossy().into_owned();
        let text = std::fs::read_to_string(&page).unwrap();
        all.extend(troubles(&text).into_iter().map(|trouble| format!("{name}: {trouble}")));
    }
    assert!(all.is_empty(), "{all:#?}");
}

/// The check itself can fail.
#[test]
fn conform_long_sentences_and_persons_are_noticed() {
    let long = "word ".repeat(36);
    assert_eq!(troubles(&long).len(), 1);
    assert_eq!(troubles(&format!("- {}\n- {}", "word ".repeat(20), "word ".repeat(20))), Vec::<String>::new());
    assert_eq!(
        troubles(&format!("```\n{long}\n```\n| {} | {} |", "a ".repeat(20), "b ".repeat(20))),
        Vec::<String>::new()
    );
    assert_eq!(troubles(&format!("{}. {}", "word ".repeat(20).trim(), "word ".repeat(20))), Vec::<String>::new());
    assert_eq!(troubles("Nobody is told.").len(), 2);
    assert_eq!(troubles("A run-out of 5 µm: the runout is `runout_um`."), ["\"runout\", which is \"run-out\" here"]);
    assert_eq!(troubles("Field `nobody` of [it](told.md)."), Vec::<String>::new());
}
