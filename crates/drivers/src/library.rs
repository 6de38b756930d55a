//! Finds a library and its functions.

use std::mem::ManuallyDrop;
use std::path::{Path, PathBuf};

use libloading::Library;

/// A library that stays loaded until the program ends: those of instruments have threads of their
/// own, which run on after the last handle is closed.
pub(crate) type Loaded = ManuallyDrop<Library>;

/// Why a library cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("{what} cannot be used: {}; {remedy}", tried.join("; "))]
pub struct LoadError {
    what: &'static str,
    tried: Vec<String>,
    remedy: &'static str,
}

/// A library that is found by name.
pub(crate) struct Wanted {
    /// As people call it.
    pub what: &'static str,
    /// Names of its file, by preference.
    pub files: &'static [&'static str],
    /// What to do where it is missing.
    pub remedy: &'static str,
}

impl Wanted {
    /// Loads the library at `path`, or by its usual names.
    pub(crate) fn load(&self, path: Option<&Path>) -> Result<Loaded, LoadError> {
        let files: Vec<PathBuf> = match path {
            Some(path) => vec![path.to_owned()],
            None => self.files.iter().map(PathBuf::from).collect(),
        };
        let mut tried = Vec::new();
        for file in files {
            // SAFETY: what a library does when it is loaded is its own; the administrator of the
            // machine has chosen it.
            match unsafe { Library::new(&file) } {
                Ok(library) => return Ok(ManuallyDrop::new(library)),
                Err(e) => tried.push(e.to_string()),
            }
        }
        Err(self.error(tried))
    }

    fn error(&self, tried: Vec<String>) -> LoadError {
        LoadError { what: self.what, tried, remedy: self.remedy }
    }

    /// A function of the library.
    ///
    /// # Safety
    /// `F` is the type of the function of this name.
    pub(crate) unsafe fn function<F: Copy>(&self, library: &Loaded, name: &str) -> Result<F, LoadError> {
        // SAFETY: the caller vouches for the type.
        let symbol = unsafe { library.get::<F>(name.as_bytes()) };
        symbol.map(|symbol| *symbol).map_err(|e| self.error(vec![e.to_string()]))
    }
}

/// Declares the functions of a library, and loads all of them.
macro_rules! functions {
    ($wanted:ident, $abi:literal, { $($field:ident = $name:literal: fn($($argument:ty),*) -> $result:ty;)* }) => {
        struct Functions {
            $($field: unsafe extern $abi fn($($argument),*) -> $result,)*
        }

        impl Functions {
            fn load(path: Option<&std::path::Path>) -> Result<Self, $crate::LoadError> {
                let library = $wanted.load(path)?;
                // SAFETY: the types are those of the library's header; the library is never
                // unloaded.
                unsafe { Ok(Self { $($field: $wanted.function(&library, $name)?,)* }) }
            }
        }
    };
}
pub(crate) use functions;
