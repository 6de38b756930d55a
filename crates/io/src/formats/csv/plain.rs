//! Rows that are written plainly, such as `0.25,-3,1e-4`: read from the bytes where they lie. What
//! is written otherwise is left to the careful reading, which says what is wrong with it; where
//! both read a row, they read the same numbers.

use super::dialect::Dialect;

/// How plain rows are written.
#[derive(Debug)]
pub(super) struct Plain {
    delimiter: u8,
    /// Several delimiters in a row are one.
    blanks: bool,
    decimal_comma: bool,
    numeric: Vec<bool>,
}

impl Plain {
    /// Absent where the delimiter is not a sign of one byte, or may be part of a number.
    pub(super) fn new(dialect: &Dialect) -> Option<Self> {
        let delimiter = u8::try_from(dialect.delimiter).ok().filter(u8::is_ascii)?;
        let apart =
            !(delimiter.is_ascii_alphanumeric() || matches!(delimiter, b'.' | b'+' | b'-' | b'"' | b'\r' | b'\n'));
        let decimal_comma = dialect.decimal_comma && delimiter != b',';
        let same = decimal_comma == dialect.decimal_comma;
        (apart && same).then(|| Self {
            delimiter,
            blanks: delimiter == b' ',
            decimal_comma,
            numeric: dialect.numeric.clone(),
        })
    }

    /// Reads the row at the beginning of `bytes` into `row` (one value for each column; those of
    /// other columns stay) and returns its bytes with the end of its line. Absent where the row is
    /// not plain or its end is not there.
    pub(super) fn row(&self, bytes: &[u8], row: &mut [f64]) -> Option<usize> {
        let mut at = 0;
        let last = row.len().checked_sub(1)?;
        for (i, (value, &numeric)) in row.iter_mut().zip(&self.numeric).enumerate() {
            while bytes.get(at) == Some(&b' ') {
                at += 1;
            }
            let end = if numeric {
                let (number, length) = self.number(&bytes[at..])?;
                *value = number;
                at + length
            } else {
                let length = bytes[at..].iter().position(|&b| b == self.delimiter || b == b'\n' || b == b'\r')?;
                at + length
            };
            at = end;
            if i == last {
                while self.blanks && bytes.get(at) == Some(&b' ') {
                    at += 1;
                }
                at += usize::from(bytes.get(at) == Some(&b'\r'));
                return (bytes.get(at) == Some(&b'\n')).then_some(at + 1);
            }
            if bytes.get(at) != Some(&self.delimiter) {
                return None;
            }
            at += 1;
        }
        None
    }

    /// The decimal number at the beginning of `bytes`, and its bytes.
    fn number(&self, bytes: &[u8]) -> Option<(f64, usize)> {
        let negative = bytes.first() == Some(&b'-');
        let mut at = usize::from(negative);
        let mut digits = 0_u64;
        let from = at;
        at = take_digits(bytes, at, &mut digits);
        let mut count = at - from;
        if count == 0 {
            return None;
        }
        let mut fraction = 0;
        let point = bytes.get(at).copied();
        if point == Some(b'.') || (self.decimal_comma && point == Some(b',')) {
            let from = at + 1;
            at = take_digits(bytes, from, &mut digits);
            fraction = at - from;
            if fraction == 0 {
                return None;
            }
            count += fraction;
        }
        let mut exponent = -i64::try_from(fraction).ok()?;
        if matches!(bytes.get(at), Some(b'e' | b'E')) {
            let sign = bytes.get(at + 1).copied();
            let from = at + 1 + usize::from(matches!(sign, Some(b'+' | b'-')));
            let mut power = 0;
            at = take_digits(bytes, from, &mut power);
            if !(1..=4).contains(&(at - from)) {
                return None;
            }
            exponent += if sign == Some(b'-') { -(power as i64) } else { power as i64 };
        }
        // What comes next is looked at by the caller; the end of the bytes may cut a number.
        bytes.get(at)?;
        let value = match scaled(digits, count, exponent) {
            Some(value) if negative => -value,
            Some(value) => value,
            None => {
                let text = std::str::from_utf8(&bytes[..at]).ok()?;
                if self.decimal_comma { text.replacen(',', ".", 1).parse().ok()? } else { text.parse().ok()? }
            }
        };
        Some((value, at))
    }
}

/// Appends the digits from `at` on to a number, and returns where they end; more than 19 digits
/// overflow, which [`scaled`] refuses.
fn take_digits(bytes: &[u8], mut at: usize, number: &mut u64) -> usize {
    while let Some(digit) = bytes.get(at).map(|b| b.wrapping_sub(b'0')).filter(|&digit| digit < 10) {
        *number = number.wrapping_mul(10).wrapping_add(u64::from(digit));
        at += 1;
    }
    at
}

/// `digits × 10^exponent` where one operation on exact operands gives it, which rounds it
/// correctly: Clinger, "How to read floating point numbers accurately" (PLDI 1990),
/// section 4. Others are left to the standard library, which rounds correctly too.
fn scaled(digits: u64, count: usize, exponent: i64) -> Option<f64> {
    /// All powers of ten that are exact.
    const TENS: [f64; 23] = [
        1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19,
        1e20, 1e21, 1e22,
    ];
    const EXACT: u64 = 1 << f64::MANTISSA_DIGITS;
    if count > 19 || digits > EXACT {
        return None;
    }
    let tens = TENS.get(usize::try_from(exponent.unsigned_abs()).ok()?)?;
    let digits = digits as f64;
    Some(if exponent < 0 { digits / tens } else { digits * tens })
}

#[cfg(test)]
mod tests {
    use super::super::dialect::number;
    use super::*;

    fn plain(delimiter: u8, decimal_comma: bool, columns: usize) -> Plain {
        Plain { delimiter, blanks: delimiter == b' ', decimal_comma, numeric: vec![true; columns] }
    }

    /// Numbers drawn digit by digit: where the plain reading reads one, the standard library reads
    /// the same, bit by bit.
    #[test]
    fn oracle_numbers_are_those_of_the_standard_library() {
        let mut state = 7_u64;
        let mut draw = |below: u64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) % below
        };
        let mut read = 0;
        for case in 0..200_000 {
            let mut text = String::new();
            if draw(2) == 0 {
                text.push('-');
            }
            let (whole, fraction) = (draw(12), draw(16));
            (0..whole).for_each(|_| text.push(char::from(b'0' + draw(10) as u8)));
            let comma = case % 2 == 1;
            if draw(4) > 0 {
                text.push(if comma { ',' } else { '.' });
                (0..fraction).for_each(|_| text.push(char::from(b'0' + draw(10) as u8)));
            }
            if draw(3) == 0 {
                text.push_str(["e", "E-", "e+", "e-"][draw(4) as usize]);
                (0..draw(4)).for_each(|_| text.push(char::from(b'0' + draw(10) as u8)));
            }
            let line = format!("{text}\n");
            let mut row = [f64::NAN];
            if let Some(length) = plain(b';', comma, 1).row(line.as_bytes(), &mut row) {
                assert_eq!(length, line.len());
                assert_eq!(number(&text, comma).map(f64::to_bits), Some(row[0].to_bits()), "{text}");
                read += 1;
            }
        }
        assert!(read > 100_000, "{read}");
    }

    /// What the careful reading refuses, or reads in another way, is not plain.
    #[test]
    fn analytic_what_is_not_plain_is_left() {
        let comma = plain(b',', false, 2);
        let mut row = [0.0; 2];
        for line in [
            "1\n",
            "1,\n",
            "1,2,3\n",
            "1,2",
            "1,2\r",
            ",2\n",
            "1,x\n",
            "1,2x\n",
            "1,.\n",
            "1,-\n",
            "1,2e\n",
            "\n",
            "",
            "1,\"2\"\n",
        ] {
            assert_eq!(comma.row(line.as_bytes(), &mut row), None, "{line:?}");
        }
        assert_eq!(comma.row(b"-0, 2.5\r\n7,8\n", &mut row), Some(9));
        assert_eq!(row.map(f64::to_bits), [(-0.0_f64).to_bits(), 2.5_f64.to_bits()]);
        assert_eq!(plain(b';', true, 2).row(b"1,5;2,\n", &mut row), None);
        assert_eq!(plain(b';', true, 2).row(b"1,5;2.25\n", &mut row), Some(9));
        assert_eq!(row, [1.5, 2.25]);
        assert_eq!(plain(b' ', false, 2).row(b"  1   2  \n", &mut row), Some(10));
        assert_eq!(row, [1.0, 2.0]);
    }
}
