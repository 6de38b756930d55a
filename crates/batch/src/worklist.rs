//! The list of recordings or cases: from a manifest or from folders, sorted, each once.

use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use gearwatch_io::text::read_text;

/// Why there is no work list.
#[derive(Debug, thiserror::Error)]
pub enum WorkListError {
    /// A file or folder cannot be read.
    #[error("{path}: cannot be read: {cause}")]
    Read {
        /// Which.
        path: PathBuf,
        /// What the system said.
        cause: io::Error,
    },
    /// Lines of a manifest name files that are not there.
    #[error("{manifest}: {} of {total} {what} are not there; the first are {}", missing.len(), first_few(missing))]
    Missing {
        /// The manifest.
        manifest: PathBuf,
        /// What was looked for.
        what: &'static str,
        /// Line number and name of each.
        missing: Vec<(usize, PathBuf)>,
        /// Lines with a name.
        total: usize,
    },
    /// Two lines of a manifest name the same file.
    #[error("{manifest}: line {again} names {path} a second time (first in line {first}); each is to be listed once")]
    Twice {
        /// The manifest.
        manifest: PathBuf,
        /// The file.
        path: PathBuf,
        /// Line of its first mention.
        first: usize,
        /// Line of its second mention.
        again: usize,
    },
    /// Nothing was found.
    #[error("{0}: there is no recording in it; expected files that end in {1}")]
    Empty(PathBuf, String),
    /// No case was found.
    #[error("{0}: there is no case in it; expected folders with a file {CASE_BENCH}")]
    NoCase(PathBuf),
}

fn first_few(missing: &[(usize, PathBuf)]) -> String {
    let names: Vec<_> =
        missing.iter().take(5).map(|(line, path)| format!("{} (line {line})", path.display())).collect();
    names.join(", ")
}

/// What a list holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Items {
    /// Files.
    Recordings,
    /// Folders with a bench file.
    Cases,
}

/// The bench file of a case.
pub const CASE_BENCH: &str = "bench.toml";

impl Items {
    /// In words.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Recordings => "recordings",
            Self::Cases => "cases",
        }
    }

    fn is(self, path: &Path) -> bool {
        match self {
            Self::Recordings => path.is_file(),
            Self::Cases => path.join(CASE_BENCH).is_file(),
        }
    }
}

/// The list of a manifest: one path a line, relative to the manifest's folder; empty lines and
/// lines that begin with `#` count for nothing.
///
/// # Errors
/// When the manifest cannot be read, names what is not there, or names one item twice.
pub fn from_manifest(manifest: &Path, kind: Items) -> Result<Vec<PathBuf>, WorkListError> {
    let text = read_text(manifest).map_err(|cause| WorkListError::Read { path: manifest.to_owned(), cause })?;
    let folder = manifest.parent().unwrap_or(Path::new(""));
    let mut found: Vec<(PathBuf, usize)> = Vec::new();
    let mut missing = Vec::new();
    let mut total = 0;
    for (number, line) in text.lines().enumerate().map(|(i, line)| (i + 1, line.trim())) {
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        total += 1;
        let path = folder.join(line);
        if kind.is(&path) {
            found.push((path, number));
        } else {
            missing.push((number, path));
        }
    }
    if !missing.is_empty() {
        return Err(WorkListError::Missing { manifest: manifest.to_owned(), what: kind.name(), missing, total });
    }
    // Two spellings of one file are the same recording.
    let mut seen = std::collections::BTreeMap::new();
    for (path, line) in &found {
        let whole = fs::canonicalize(path).map_err(|cause| WorkListError::Read { path: path.clone(), cause })?;
        if let Some(first) = seen.insert(whole, *line) {
            let (manifest, path) = (manifest.to_owned(), path.clone());
            return Err(WorkListError::Twice { manifest, path, first, again: *line });
        }
    }
    let mut paths: Vec<_> = found.into_iter().map(|(path, _)| path).collect();
    paths.sort();
    Ok(paths)
}

/// Recordings below folders (and files named directly), by the endings of their names, without the
/// dot.
///
/// # Errors
/// When a folder cannot be read or nothing is found in it.
pub fn from_folders(places: &[PathBuf], endings: &[&str]) -> Result<Vec<PathBuf>, WorkListError> {
    let mut found = BTreeSet::new();
    for place in places {
        if place.is_dir() {
            let mut here = BTreeSet::new();
            walk(place, endings, &mut here)?;
            if here.is_empty() {
                return Err(WorkListError::Empty(place.clone(), endings.join(", ")));
            }
            found.append(&mut here);
        } else {
            fs::metadata(place).map_err(|cause| WorkListError::Read { path: place.clone(), cause })?;
            found.insert(place.clone());
        }
    }
    each_once(found)
}

/// Folders that are cases, or hold cases.
///
/// # Errors
/// When a folder cannot be read or no case is found in it.
pub fn cases(places: &[PathBuf]) -> Result<Vec<PathBuf>, WorkListError> {
    let mut found = BTreeSet::new();
    for place in places {
        if Items::Cases.is(place) {
            found.insert(place.clone());
            continue;
        }
        let mut here = BTreeSet::new();
        let read = |cause| WorkListError::Read { path: place.clone(), cause };
        for entry in fs::read_dir(place).map_err(read)? {
            here.extend(Some(entry.map_err(read)?.path()).filter(|path| Items::Cases.is(path)));
        }
        if here.is_empty() {
            return Err(WorkListError::NoCase(place.clone()));
        }
        found.append(&mut here);
    }
    each_once(found)
}

/// What two of the places lead to is taken once, under the name that sorts first.
fn each_once(found: BTreeSet<PathBuf>) -> Result<Vec<PathBuf>, WorkListError> {
    let mut seen = BTreeSet::new();
    let mut out = Vec::with_capacity(found.len());
    for path in found {
        let whole = fs::canonicalize(&path).map_err(|cause| WorkListError::Read { path: path.clone(), cause })?;
        if seen.insert(whole) {
            out.push(path);
        }
    }
    Ok(out)
}

fn walk(folder: &Path, endings: &[&str], found: &mut BTreeSet<PathBuf>) -> Result<(), WorkListError> {
    let read = |cause| WorkListError::Read { path: folder.to_owned(), cause };
    for entry in fs::read_dir(folder).map_err(read)? {
        let entry = entry.map_err(read)?;
        let path = entry.path();
        // Links are not followed into folders: a loop would never end.
        if entry.file_type().map_err(read)?.is_dir() {
            walk(&path, endings, found)?;
        } else if path.is_file() && has_ending(&path, endings) {
            found.insert(path);
        }
    }
    Ok(())
}

fn has_ending(path: &Path, endings: &[&str]) -> bool {
    let name = path.file_name().map(|name| name.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    endings.iter().any(|ending| name.strip_suffix(ending).is_some_and(|stem| stem.ends_with('.')))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conform_manifest_errors_name_their_lines() {
        let folder = tempfile::tempdir().unwrap();
        let manifest = folder.path().join("list.txt");
        fs::write(folder.path().join("a.mcap"), "x").unwrap();
        fs::write(folder.path().join("b.mcap"), "x").unwrap();
        fs::write(&manifest, "# recordings\nb.mcap\n\na.mcap\n").unwrap();
        let names: Vec<_> = from_manifest(&manifest, Items::Recordings)
            .unwrap()
            .iter()
            .map(|p| p.file_name().unwrap().to_owned())
            .collect();
        assert_eq!(names, ["a.mcap", "b.mcap"]);

        fs::write(&manifest, "a.mcap\nc.mcap\n").unwrap();
        let error = from_manifest(&manifest, Items::Recordings).unwrap_err().to_string();
        assert!(error.contains("1 of 2") && error.contains("c.mcap (line 2)"), "{error}");

        fs::write(&manifest, "a.mcap\n./a.mcap\n").unwrap();
        let error = from_manifest(&manifest, Items::Recordings).unwrap_err().to_string();
        assert!(error.contains("line 2") && error.contains("line 1"), "{error}");
    }

    #[test]
    fn conform_folders_are_walked_and_empty_ones_said() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("sub")).unwrap();
        fs::write(folder.path().join("sub/b.CSV.GZ"), "x").unwrap();
        fs::write(folder.path().join("a.mcap"), "x").unwrap();
        fs::write(folder.path().join("notes.txt"), "x").unwrap();
        let found = from_folders(&[folder.path().to_owned()], &["mcap", "csv.gz"]).unwrap();
        assert_eq!(found.len(), 2);
        let sub = folder.path().join("sub").join("..").join("sub");
        let twice = from_folders(&[folder.path().to_owned(), sub], &["mcap", "csv.gz"]).unwrap();
        assert_eq!(twice.len(), 2, "{twice:?}");
        assert!(from_folders(&[folder.path().to_owned()], &["wav"]).is_err());

        assert!(cases(&[folder.path().to_owned()]).is_err());
        fs::write(folder.path().join("sub").join(CASE_BENCH), "").unwrap();
        let sub = folder.path().join("sub");
        assert_eq!(cases(&[folder.path().to_owned(), sub.clone()]).unwrap(), [sub]);
    }
}
