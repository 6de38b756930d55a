//! Changes bytes in the ways that find faults in parsers: bits, lengths, pieces that are missing,
//! doubled or of another file.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Lengths and counts at which arithmetic goes wrong.
const NUMBERS: [u64; 14] = [
    0,
    1,
    2,
    0x7f,
    0xff,
    0x7fff,
    0xffff,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    0x7fff_ffff_ffff_ffff,
    0x8000_0000_0000_0000,
    0xffff_ffff_ffff_fff7,
    0xffff_ffff_ffff_ffff,
];

/// Texts at which parsers of text go wrong.
const TEXTS: [&str; 14] =
    ["-", "e", ".", "NaN", "inf", "1e999", "-1", "99999999999999999999", "\"", "\n", "\0", "[", "{", "=\u{fffd}"];

pub struct Mutator(ChaCha8Rng);

impl Mutator {
    /// The same changes for the same name.
    pub fn new(name: &str) -> Self {
        let seed =
            name.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3));
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    fn below(&mut self, end: usize) -> usize {
        self.0.random_range(0..end.max(1))
    }

    /// One of the seeds with one to eight changes.
    pub fn change(&mut self, seeds: &[Vec<u8>]) -> Vec<u8> {
        let mut bytes = seeds[self.below(seeds.len())].clone();
        for _ in 0..1 + self.below(8) {
            self.change_once(&mut bytes, seeds);
        }
        bytes
    }

    fn change_once(&mut self, bytes: &mut Vec<u8>, seeds: &[Vec<u8>]) {
        let at = self.below(bytes.len());
        // Heads of files decide more than their middles.
        let at = if self.below(3) == 0 { at % 128.min(bytes.len().max(1)) } else { at };
        match self.below(9) {
            0 => self.flip(bytes, at),
            1 => self.number(bytes, at),
            2 => bytes.truncate(at),
            3 => {
                let end = (at + 1 + self.below(64)).min(bytes.len());
                drop(bytes.drain(at.min(end)..end));
            }
            4 => {
                let end = (at + 1 + self.below(64)).min(bytes.len());
                let piece = bytes[at.min(end)..end].to_vec();
                bytes.splice(at.min(bytes.len())..at.min(bytes.len()), piece);
            }
            5 => {
                let other = &seeds[self.below(seeds.len())];
                let from = self.below(other.len());
                let piece = other[from..(from + 1 + self.below(256)).min(other.len())].to_vec();
                let end = (at + piece.len()).min(bytes.len());
                bytes.splice(at.min(end)..end, piece);
            }
            6 => {
                let text = TEXTS[self.below(TEXTS.len())];
                bytes.splice(at.min(bytes.len())..at.min(bytes.len()), text.bytes());
            }
            7 => {
                if let Some(byte) = bytes.get_mut(at) {
                    *byte = self.0.random();
                }
            }
            _ => self.flip(bytes, at),
        }
    }

    fn flip(&mut self, bytes: &mut [u8], at: usize) {
        let bit = self.below(8);
        if let Some(byte) = bytes.get_mut(at) {
            *byte ^= 1 << bit;
        }
    }

    fn number(&mut self, bytes: &mut [u8], at: usize) {
        let width = [1, 2, 4, 8][self.below(4)];
        let number = NUMBERS[self.below(NUMBERS.len())].wrapping_add(self.below(3) as u64);
        let big = self.below(2) == 0;
        let all = if big { (number << (64 - 8 * width)).to_be_bytes() } else { number.to_le_bytes() };
        for (byte, new) in bytes.iter_mut().skip(at).zip(&all[..width]) {
            *byte = *new;
        }
    }
}
