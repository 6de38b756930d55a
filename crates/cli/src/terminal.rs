//! Standard output and standard error without control characters from names and contents.
//!
//! A file name, a sensor's name or a line of a file may hold an escape sequence that a terminal
//! obeys. All that this program prints goes through here: such characters come out as `\u001b`,
//! which is also how JSON writes them.

use std::borrow::Cow;
use std::io::{Result, Stderr, StderrLock, StdoutLock, Write};

/// Standard output.
pub fn out() -> Plain<StdoutLock<'static>> {
    Plain::new(std::io::stdout().lock(), false)
}

/// Standard error.
pub fn err() -> Plain<StderrLock<'static>> {
    Plain::new(std::io::stderr().lock(), false)
}

/// Standard error for log lines with colours, from any thread.
pub fn log() -> Plain<Stderr> {
    Plain::new(std::io::stderr(), true)
}

/// Standard output for text with colours, which are taken out where nobody sees them.
pub fn coloured() -> Plain<anstream::AutoStream<StdoutLock<'static>>> {
    Plain::new(anstream::stdout().lock(), true)
}

/// The text with control characters written out; colours too.
pub fn plain(text: &str) -> Cow<'_, str> {
    if text.chars().any(|c| is_hostile(c) || c.is_control()) {
        Cow::Owned(text.chars().map(|c| if c.is_control() || is_hostile(c) { escaped(c) } else { c.into() }).collect())
    } else {
        Cow::Borrowed(text)
    }
}

/// Characters of the widest column of a table. Formatting cannot pad beyond 65 535, and nobody
/// reads such a column.
const WIDEST_COLUMN: usize = 60;

/// A text for a column of a table: control characters written out, its end cut where it is too
/// long.
pub fn cell(text: &str) -> String {
    let text = plain(text);
    if text.chars().count() <= WIDEST_COLUMN {
        return text.into_owned();
    }
    text.chars().take(WIDEST_COLUMN - 1).chain(['…']).collect()
}

/// Characters that change what a terminal does or the order in which it shows others. Line ends and
/// tabs are of our own.
fn is_hostile(c: char) -> bool {
    let direction =
        matches!(c, '\u{061C}' | '\u{200E}' | '\u{200F}' | '\u{202A}'..='\u{202E}' | '\u{2066}'..='\u{2069}');
    direction || (c.is_control() && !matches!(c, '\n' | '\t'))
}

fn escaped(c: char) -> String {
    format!("\\u{:04x}", u32::from(c))
}

/// A writer of UTF-8 text that writes control characters out.
pub struct Plain<W: Write> {
    inner: W,
    /// Colours of our own (`ESC [ … m`) pass.
    colours: bool,
    /// The beginning of a character or colour that goes on with the next write.
    pending: Vec<u8>,
    text: String,
}

/// Bytes of the longest colour sequence that is waited for.
const LONGEST_COLOUR: usize = 32;

impl<W: Write> Plain<W> {
    fn new(inner: W, colours: bool) -> Self {
        Self { inner, colours, pending: Vec::new(), text: String::new() }
    }

    /// Writes what of `bytes` is whole; the rest is kept.
    fn pass(&mut self, bytes: &[u8]) -> Result<()> {
        let joined;
        let bytes = if self.pending.is_empty() {
            bytes
        } else {
            self.pending.extend_from_slice(bytes);
            joined = std::mem::take(&mut self.pending);
            &joined
        };
        self.text.clear();
        let mut rest = bytes;
        loop {
            let (valid, invalid) = match std::str::from_utf8(rest) {
                Ok(valid) => (valid, None),
                Err(e) => (std::str::from_utf8(&rest[..e.valid_up_to()]).unwrap_or_default(), Some(e.error_len())),
            };
            let whole = self.translate(valid);
            rest = &rest[whole..];
            if whole < valid.len() {
                break;
            }
            match invalid {
                // Not UTF-8, such as the name of a file.
                Some(Some(length)) => {
                    self.text.push(char::REPLACEMENT_CHARACTER);
                    rest = &rest[length..];
                }
                // The character goes on.
                Some(None) => break,
                None => break,
            }
        }
        self.pending.extend_from_slice(rest);
        self.inner.write_all(self.text.as_bytes())
    }

    /// Appends to `self.text`; how many bytes were whole.
    fn translate(&mut self, text: &str) -> usize {
        let mut at = 0;
        while let Some(c) = text[at..].chars().next() {
            if c == '\u{1b}' && self.colours {
                match colour(&text[at..]) {
                    Colour::Whole(length) => {
                        self.text.push_str(&text[at..at + length]);
                        at += length;
                        continue;
                    }
                    Colour::GoesOn => return at,
                    Colour::Other => {}
                }
            }
            if is_hostile(c) {
                self.text.push_str(&escaped(c))
            } else {
                self.text.push(c)
            }
            at += c.len_utf8();
        }
        at
    }
}

enum Colour {
    Whole(usize),
    GoesOn,
    Other,
}

/// The colour sequence at the beginning of a text.
fn colour(text: &str) -> Colour {
    let body = match text.strip_prefix("\u{1b}[") {
        Some(body) => body,
        None if text.len() == 1 => return Colour::GoesOn,
        None => return Colour::Other,
    };
    match body.find(|c: char| !(c.is_ascii_digit() || c == ';')) {
        Some(end) if body[end..].starts_with('m') => Colour::Whole(end + 3),
        None if text.len() < LONGEST_COLOUR => Colour::GoesOn,
        _ => Colour::Other,
    }
}

impl<W: Write> Write for Plain<W> {
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        self.pass(bytes)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> Result<()> {
        self.inner.flush()
    }
}

impl<W: Write> Drop for Plain<W> {
    /// What never became whole is no character.
    fn drop(&mut self) {
        if !self.pending.is_empty() {
            let _ = self.inner.write_all(plain(&String::from_utf8_lossy(&self.pending)).as_bytes());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(pieces: &[&[u8]], colours: bool) -> String {
        let mut bytes = Vec::new();
        let mut out = Plain::new(&mut bytes, colours);
        for piece in pieces {
            out.write_all(piece).unwrap();
        }
        drop(out);
        String::from_utf8(bytes).unwrap()
    }

    /// Window titles, cursor moves, 8-bit sequences and reversed text are shown, not obeyed; text
    /// is left alone.
    #[test]
    fn regress_escape_sequences_are_written_out() {
        assert_eq!(written(&[b"a\x1b]0;owned\x07b\n"], false), "a\\u001b]0;owned\\u0007b\n");
        assert_eq!(written(&["\u{9b}2Jx\u{202e}cba\r\n".as_bytes()], false), "\\u009b2Jx\\u202ecba\\u000d\n");
        assert_eq!(written(&["m/s² µ 漢\tend\n".as_bytes()], false), "m/s² µ 漢\tend\n");
        assert_eq!(written(&[b"\x1b[31mred\x1b[0m"], false), "\\u001b[31mred\\u001b[0m");
    }

    /// Colours of our own pass where they are wanted, also in pieces; every other sequence does
    /// not.
    #[test]
    fn regress_only_colours_pass_where_colours_are_wanted() {
        assert_eq!(written(&[b"\x1b[1;31mred\x1b[0m\x1b[2J"], true), "\x1b[1;31mred\x1b[0m\\u001b[2J");
        assert_eq!(written(&[b"\x1b", b"[3", b"1mred"], true), "\x1b[31mred");
        assert_eq!(written(&[b"end\x1b["], true), "end\\u001b[");
    }

    /// However the bytes are cut, the text is the same; what is not UTF-8 is replaced.
    #[test]
    fn analytic_cuts_between_writes_change_nothing() {
        let text = "a\u{9b}é漢\u{1b}[0m\u{1b}x\n".as_bytes();
        for colours in [false, true] {
            let whole = written(&[text], colours);
            for cut in 0..text.len() {
                assert_eq!(written(&[&text[..cut], &text[cut..]], colours), whole, "{cut}");
            }
        }
        assert_eq!(written(&[b"a\xffb\xc3"], false), "a\u{FFFD}b\u{FFFD}");
    }

    /// Padding to a column of more than 65 535 characters panics; such a name is cut before.
    #[test]
    fn regress_a_name_of_any_length_fits_a_column() {
        for length in [60, 61, 65_535, 65_536, 1_000_000] {
            let text = cell(&"ä".repeat(length));
            assert_eq!(text.chars().count(), 60);
            let width = text.chars().count();
            assert_eq!(format!("{text:width$}"), text);
        }
    }

    /// A name in a coloured table loses colours of its own too, and line ends.
    #[test]
    fn regress_a_name_cannot_colour_a_table() {
        assert_eq!(plain("x\x1b[32mNORMAL\n"), "x\\u001b[32mNORMAL\\u000a");
        assert!(matches!(plain("plain 漢"), Cow::Borrowed(_)));
    }
}
