//! MATLAB files: version 5 (to 7) by a reader of its own, version 7.3 as HDF5.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use crate::budget::{Budget, Notes};
use crate::problem::Problem;

#[cfg(feature = "hdf5")]
pub(crate) mod stored;
pub mod v5;
#[cfg(feature = "hdf5")]
pub mod v73;

/// A numeric array of a file, wherever in structs it lies.
#[derive(Clone, Debug, PartialEq)]
pub struct Variable {
    /// Name with the structs that it lies in, such as `bearing.gs`.
    pub path: String,
    /// Rows and columns; further dimensions are counted as columns.
    pub rows: usize,
    /// See `rows`.
    pub columns: usize,
    /// Column after column.
    pub numbers: Numbers,
}

/// Values as they are stored.
#[derive(Clone, Debug, PartialEq)]
pub enum Numbers {
    /// Stored as integers that fit 32 bits.
    Integer(Vec<i32>),
    /// Stored as floats, or as wider integers.
    Real(Vec<f64>),
    /// Left in the file.
    Stored {
        /// Number among the vectors that were left there.
        vector: usize,
        /// How many values there are.
        count: usize,
    },
}

impl Numbers {
    /// Number of values.
    pub fn len(&self) -> usize {
        match self {
            Self::Integer(values) => values.len(),
            Self::Real(values) => values.len(),
            Self::Stored { count, .. } => *count,
        }
    }

    /// There is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// One value that is in memory.
    pub fn get(&self, at: usize) -> Option<f64> {
        match self {
            Self::Integer(values) => values.get(at).map(|&v| f64::from(v)),
            Self::Real(values) => values.get(at).copied(),
            Self::Stored { .. } => None,
        }
    }
}

/// The numeric arrays of a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parsed {
    /// In the order of the file, each name once.
    pub variables: Vec<Variable>,
    /// What was passed over, and why.
    pub warnings: Vec<String>,
}

/// Nesting of structs and cells; real files stay below ten.
const DEEPEST: usize = 32;
/// Arrays in a file, empty ones and fields of structs counted.
const MOST_ARRAYS: usize = 100_000;

/// Characters of a variable's name with the structs that it lies in; MATLAB allows 63 for each.
const LONGEST_PATH: usize = 1024;
/// Bytes of all names together.
const MOST_NAME_BYTES: usize = 16 << 20;

/// Collects the arrays of a file, within what the file may ask for.
struct Collected<'a> {
    variables: Vec<Variable>,
    by_path: HashMap<String, usize>,
    name_bytes: usize,
    arrays: usize,
    notes: Notes,
    budget: &'a mut Budget,
}

impl<'a> Collected<'a> {
    fn new(budget: &'a mut Budget) -> Self {
        Self {
            variables: Vec::new(),
            by_path: HashMap::new(),
            name_bytes: 0,
            arrays: 0,
            notes: Notes::default(),
            budget,
        }
    }

    /// Counts an array with its name.
    fn count(&mut self, path: &str, depth: usize, place: &dyn Fn() -> String) -> Result<(), Problem> {
        self.arrays += 1;
        if self.arrays > MOST_ARRAYS || depth > DEEPEST {
            return Err(Problem::limit(
                place(),
                "the number or nesting of arrays",
                format_args!("{MOST_ARRAYS} arrays, {DEEPEST} levels"),
            ));
        }
        self.check_name(path, place)
    }

    fn check_name(&mut self, path: &str, place: &dyn Fn() -> String) -> Result<(), Problem> {
        self.name_bytes += path.len();
        if path.len() > LONGEST_PATH || self.name_bytes > MOST_NAME_BYTES {
            return Err(Problem::limit(
                place(),
                "the length of names",
                format_args!("{LONGEST_PATH} bytes a name, {} MiB together", MOST_NAME_BYTES >> 20),
            ));
        }
        Ok(())
    }

    /// Adds a variable. MATLAB itself keeps the last of two with one name.
    fn add(&mut self, variable: Variable) {
        match self.by_path.entry(variable.path.clone()) {
            Entry::Occupied(before) => {
                self.notes.push(format_args!("{} is there twice; the last one counts", variable.path));
                self.variables[*before.get()] = variable;
            }
            Entry::Vacant(new) => {
                new.insert(self.variables.len());
                self.variables.push(variable);
            }
        }
    }

    fn finish(self) -> Parsed {
        Parsed { variables: self.variables, warnings: self.notes.finish() }
    }
}
