//! MAT-file 7.3, which is HDF5, and plain HDF5 with numeric datasets.

use std::panic::{AssertUnwindSafe, catch_unwind};

use hdf5_pure::{DType, Dataset, File, Group};

use super::{DEEPEST, MOST_ARRAYS, Numbers, Parsed, Variable};
use crate::problem::Problem;

/// Values of all datasets together.
const MOST_VALUES: u64 = 1 << 28;

/// Reads all numeric datasets.
///
/// The library under it is young; a panic in it on a damaged file becomes an error here.
///
/// # Errors
/// When the bytes are no HDF5, are damaged, or ask for more than the limits.
pub fn parse(bytes: Vec<u8>) -> Result<Parsed, Problem> {
    catch_unwind(AssertUnwindSafe(|| read(bytes)))
        .unwrap_or_else(|_| Err(Problem::damaged("the HDF5 structure", "a readable file", "a contradiction")))
}

fn read(bytes: Vec<u8>) -> Result<Parsed, Problem> {
    let file = File::from_bytes(bytes).map_err(|e| damaged("the HDF5 header", e))?;
    let mut walk = Walk { out: Parsed::default(), arrays: 0, values: 0 };
    walk.group(&file.root(), "", 0)?;
    Ok(walk.out)
}

fn damaged(place: &str, error: hdf5_pure::Error) -> Problem {
    Problem::damaged(place, "HDF5", error)
}

struct Walk {
    out: Parsed,
    arrays: usize,
    values: u64,
}

impl Walk {
    fn group(&mut self, group: &Group, path: &str, depth: usize) -> Result<(), Problem> {
        let place = format!("the group /{path}");
        if depth > DEEPEST {
            return Err(Problem::limit(place, "the nesting of groups", DEEPEST));
        }
        for name in group.datasets().map_err(|e| damaged(&place, e))? {
            // What MATLAB hides from the user.
            if name.starts_with('#') {
                continue;
            }
            let dataset = group.dataset(&name).map_err(|e| damaged(&place, e))?;
            self.dataset(&dataset, join(path, &name))?;
        }
        for name in group.groups().map_err(|e| damaged(&place, e))? {
            if name.starts_with('#') {
                continue;
            }
            let inner = group.group(&name).map_err(|e| damaged(&place, e))?;
            self.group(&inner, &join(path, &name), depth + 1)?;
        }
        Ok(())
    }

    fn dataset(&mut self, dataset: &Dataset, path: String) -> Result<(), Problem> {
        let place = format!("the dataset {path}");
        let shape = dataset.shape().map_err(|e| damaged(&place, e))?;
        let count = shape.iter().try_fold(1_u64, |n, &d| n.checked_mul(d));
        self.arrays += 1;
        self.values = count.map_or(u64::MAX, |count| self.values.saturating_add(count));
        if self.values > MOST_VALUES || self.arrays > MOST_ARRAYS {
            return Err(Problem::limit(
                place,
                "the number of values or datasets",
                format_args!("{MOST_VALUES} values, {MOST_ARRAYS} datasets"),
            ));
        }
        let read = |e| damaged(&place, e);
        let integer = |values: Vec<i32>| Numbers::Integer(values);
        let numbers = match dataset.dtype().map_err(read)? {
            DType::F64 | DType::F32 | DType::I64 | DType::U64 | DType::U32 => {
                Numbers::Real(dataset.read_f64().map_err(read)?)
            }
            DType::I32 | DType::I16 | DType::I8 | DType::U8 => integer(dataset.read_i32().map_err(read)?),
            // MATLAB stores text as 16-bit numbers too, and says so in an attribute.
            DType::U16 => {
                let class = dataset.attrs().map_err(read)?.remove("MATLAB_class");
                if class.is_some_and(|class| format!("{class:?}").contains("char")) {
                    return Ok(());
                }
                integer(dataset.read_i32().map_err(read)?)
            }
            other => {
                self.out.warnings.push(format!("{path} holds {other:?}, which is not read"));
                return Ok(());
            }
        };
        if Some(numbers.len() as u64) != count {
            return Err(Problem::damaged(place, format_args!("{count:?} values"), numbers.len()));
        }
        // HDF5 counts the last dimension fastest and MATLAB the first, so MATLAB writes its dimensions in reverse order.
        let rows = shape.last().map_or(1, |&rows| usize::try_from(rows).unwrap_or(usize::MAX));
        let columns = numbers.len() / rows.max(1);
        self.out.add(Variable { path, rows, columns, numbers });
        Ok(())
    }
}

fn join(path: &str, name: &str) -> String {
    if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") }
}
