//! MATLAB files: version 5 (to 7) by a reader of its own, version 7.3 as HDF5.

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
}

impl Numbers {
    /// Number of values.
    pub fn len(&self) -> usize {
        match self {
            Self::Integer(values) => values.len(),
            Self::Real(values) => values.len(),
        }
    }

    /// There is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// One value.
    pub fn get(&self, at: usize) -> Option<f64> {
        match self {
            Self::Integer(values) => values.get(at).map(|&v| f64::from(v)),
            Self::Real(values) => values.get(at).copied(),
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

impl Parsed {
    /// Adds a variable. MATLAB itself keeps the last of two with one name.
    fn add(&mut self, variable: Variable) {
        match self.variables.iter_mut().find(|v| v.path == variable.path) {
            Some(before) => {
                self.warnings.push(format!("{} is there twice; the last one counts", variable.path));
                *before = variable;
            }
            None => self.variables.push(variable),
        }
    }
}
