//! The table of recording formats: one file a format, one line here.

use crate::open::{Input, OpenOptions, Reader};
use crate::problem::Problem;

mod csv;
mod mat;
mod mcap;
mod tdms;
mod uff;
mod wav;

/// A format of recordings.
pub trait Format: Sync {
    /// As shown to the user.
    fn name(&self) -> &'static str;

    /// Usual ends of file names, without the dot, in lower case.
    fn extensions(&self) -> &'static [&'static str];

    /// One sentence: what is read, and which options it takes.
    fn help(&self) -> &'static str;

    /// The first bytes (up to 4096) belong to this format. A format that cannot be told from its
    /// bytes says no.
    fn sniff(&self, head: &[u8]) -> bool;

    /// A reader over the bytes from the first one.
    ///
    /// # Errors
    /// When the file is damaged, holds nothing that can be read, or needs options that were not
    /// given.
    fn open(&self, input: Input, options: &OpenOptions) -> Result<Box<dyn Reader>, Problem>;
}

/// All formats, in the order in which they are tried.
pub const FORMATS: &[&dyn Format] = &[&mcap::Mcap, &wav::Wav, &uff::Uff, &mat::Mat, &tdms::Tdms, &csv::Csv];
