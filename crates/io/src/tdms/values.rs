//! Values of channels, taken from the bytes of chunks a column at a time: plain copies where the
//! bytes allow it.

use gearwatch_core::block::Samples;

use super::meta::{Objects, RawType};
use crate::budget::Budget;
use crate::problem::Problem;

/// Values as they are stored.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// Stored in up to 32 bits with sign.
    Integer(Vec<i32>),
    /// Stored as floats of 32 bits.
    Single(Vec<f32>),
    /// Stored as floats of 64 bits or wider integers, or in more than one type.
    Real(Vec<f64>),
}

impl Default for Values {
    fn default() -> Self {
        Self::Integer(Vec::new())
    }
}

impl Values {
    /// Number of values.
    pub fn len(&self) -> usize {
        match self {
            Self::Integer(values) => values.len(),
            Self::Single(values) => values.len(),
            Self::Real(values) => values.len(),
        }
    }

    /// There is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// As samples: physical = stored × scale + offset.
    pub(crate) fn into_samples(self, scale: f64, offset: f64) -> Samples {
        match self {
            Self::Integer(counts) => Samples::Counts { counts, scale, offset },
            Self::Single(values) if scale == 1.0 && offset == 0.0 => Samples::Physical(values),
            Self::Single(mut values) => {
                values.iter_mut().for_each(|v| *v = (f64::from(*v) * scale + offset) as f32);
                Samples::Physical(values)
            }
            Self::Real(values) => Samples::Physical(values.iter().map(|v| (v * scale + offset) as f32).collect()),
        }
    }

    /// The list for values that are kept as `T`; a list that holds values of another type becomes
    /// one of reals.
    fn prepare(&mut self, fits: bool, empty: Self) {
        if fits {
            return;
        }
        *self = match std::mem::take(self) {
            Self::Real(list) => Self::Real(list),
            list if list.is_empty() => empty,
            Self::Integer(list) => Self::Real(list.iter().map(|&v| f64::from(v)).collect()),
            Self::Single(list) => Self::Real(list.iter().map(|&v| f64::from(v)).collect()),
        };
    }

    fn integers<const N: usize>(&mut self, column: Column<'_>, value: impl Fn([u8; N]) -> i32) {
        self.prepare(matches!(self, Self::Integer(_)), Self::Integer(Vec::new()));
        match self {
            Self::Integer(list) => column.append(list, value),
            Self::Real(list) => column.append(list, |bytes| f64::from(value(bytes))),
            Self::Single(_) => {}
        }
    }

    fn singles(&mut self, column: Column<'_>) {
        self.prepare(matches!(self, Self::Single(_)), Self::Single(Vec::new()));
        match self {
            Self::Single(list) => column.append(list, f32::from_le_bytes),
            Self::Real(list) => column.append(list, |bytes| f64::from(f32::from_le_bytes(bytes))),
            Self::Integer(_) => {}
        }
    }

    fn reals<const N: usize>(&mut self, column: Column<'_>, value: impl Fn([u8; N]) -> f64) {
        self.prepare(matches!(self, Self::Real(_)), Self::Real(Vec::new()));
        if let Self::Real(list) = self {
            column.append(list, value);
        }
    }
}

/// Where the values of one channel stand in a piece of a chunk: one in each whole row, at `offset`
/// of its bytes.
#[derive(Clone, Copy)]
pub(super) struct Column<'a> {
    pub piece: &'a [u8],
    pub row: usize,
    pub offset: usize,
    pub big_endian: bool,
}

impl Column<'_> {
    /// Rows that hold a value of `size` bytes.
    fn count(&self, size: usize) -> usize {
        let fits = self.offset.checked_add(size).is_some_and(|end| end <= self.row);
        if fits { self.piece.len() / self.row.max(1) } else { 0 }
    }

    /// Appends the value of each row, which is given in the byte order of small machines.
    fn append<const N: usize, T>(self, list: &mut Vec<T>, value: impl Fn([u8; N]) -> T) {
        if self.count(N) == 0 {
            return;
        }
        let turned = |mut bytes: [u8; N]| {
            bytes.reverse();
            value(bytes)
        };
        let in_row = |row: &[u8]| row.get(self.offset..).and_then(|rest| rest.first_chunk()).copied().unwrap_or([0; N]);
        match (self.row == N, self.big_endian) {
            (true, false) => list.extend(self.piece.as_chunks().0.iter().map(|&bytes| value(bytes))),
            (true, true) => list.extend(self.piece.as_chunks().0.iter().map(|&bytes| turned(bytes))),
            (false, false) => list.extend(self.piece.chunks_exact(self.row).map(|row| value(in_row(row)))),
            (false, true) => list.extend(self.piece.chunks_exact(self.row).map(|row| turned(in_row(row)))),
        }
    }
}

impl RawType {
    /// Appends the values of a column.
    pub(super) fn append(self, column: Column<'_>, values: &mut Values) {
        match self {
            Self::I8 => values.integers(column, |bytes: [u8; 1]| i32::from(i8::from_le_bytes(bytes))),
            Self::U8 => values.integers(column, |bytes: [u8; 1]| i32::from(bytes[0])),
            Self::I16 => values.integers(column, |bytes| i32::from(i16::from_le_bytes(bytes))),
            Self::U16 => values.integers(column, |bytes| i32::from(u16::from_le_bytes(bytes))),
            Self::I32 => values.integers(column, i32::from_le_bytes),
            Self::U32 => values.reals(column, |bytes| f64::from(u32::from_le_bytes(bytes))),
            Self::I64 => values.reals(column, |bytes| i64::from_le_bytes(bytes) as f64),
            Self::U64 => values.reals(column, |bytes| u64::from_le_bytes(bytes) as f64),
            Self::F32 => values.singles(column),
            Self::F64 => values.reals(column, f64::from_le_bytes),
            Self::Other(_) => {}
        }
    }

    /// One value of `size()` bytes as a number; absent for what is none.
    pub(super) fn number(self, cell: &[u8], big_endian: bool) -> Option<f64> {
        let mut one = Values::Real(Vec::new());
        self.append(Column { piece: cell, row: cell.len(), offset: 0, big_endian }, &mut one);
        if let Values::Real(list) = one { list.first().copied() } else { None }
    }
}

/// Where values go, within the budget.
pub(super) struct Sink<'a, 'b> {
    pub objects: &'a mut Objects,
    pub budget: &'b mut Budget,
    pub place: &'a str,
}

impl Sink<'_, '_> {
    /// Takes a column of an object.
    pub(super) fn take(&mut self, object: usize, kind: RawType, column: Column<'_>) -> Result<(), Problem> {
        if kind.is_number() {
            self.budget.keep(kind.kept().saturating_mul(column.count(kind.size()) as u64), self.place)?;
            kind.append(column, &mut self.objects.all[object].values);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of three bytes with a 16-bit number in the last two, 0x0102 × k: taken in both byte
    /// orders; the rest of a row that was cut is left.
    #[test]
    fn analytic_a_column_of_rows_is_taken_in_both_byte_orders() {
        let piece = [9, 1, 2, 9, 3, 4, 9];
        for (big_endian, wanted) in [(false, vec![0x0201, 0x0403]), (true, vec![0x0102, 0x0304])] {
            let mut values = Values::default();
            RawType::I16.append(Column { piece: &piece, row: 3, offset: 1, big_endian }, &mut values);
            assert_eq!(values, Values::Integer(wanted));
        }
    }

    /// A column that would reach beyond its row has no values.
    #[test]
    fn analytic_a_column_beyond_its_row_is_empty() {
        let mut values = Values::default();
        for offset in [2, 3, usize::MAX] {
            RawType::I16.append(Column { piece: &[0; 9], row: 3, offset, big_endian: false }, &mut values);
        }
        assert!(values.is_empty());
    }

    /// Integers, then floats of 32 bits, then of 64: all are kept as reals, in their order.
    #[test]
    fn analytic_a_channel_that_changes_its_type_becomes_real() {
        let append = |values: &mut Values, kind: RawType, cell: &[u8]| {
            kind.append(Column { piece: cell, row: cell.len(), offset: 0, big_endian: false }, values);
        };
        let mut values = Values::default();
        append(&mut values, RawType::I16, &[7, 0]);
        append(&mut values, RawType::F32, &0.5_f32.to_le_bytes());
        append(&mut values, RawType::F64, &(-2.25_f64).to_le_bytes());
        assert_eq!(values, Values::Real(vec![7.0, 0.5, -2.25]));
        let mut single = Values::default();
        append(&mut single, RawType::F32, &0.5_f32.to_le_bytes());
        assert_eq!(single, Values::Single(vec![0.5]));
        append(&mut single, RawType::U8, &[3]);
        assert_eq!(single, Values::Real(vec![0.5, 3.0]));
    }
}
