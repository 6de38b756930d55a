//! What the log asks of a disk, so that tests can hand it one that fails on command.

use std::io;

/// A folder of files, flat, with names that the log itself makes up.
pub trait Storage: Send {
    /// Makes a new, empty file. An error if the name is taken. Survives a power cut only after
    /// [`Storage::sync_dir`].
    fn create(&mut self, name: &str) -> io::Result<Box<dyn StorageFile>>;

    /// Opens a file that exists, to append to it.
    fn open(&mut self, name: &str) -> io::Result<Box<dyn StorageFile>>;

    /// The whole content.
    fn read(&mut self, name: &str) -> io::Result<Vec<u8>>;

    /// The last `count` bytes, or all if there are fewer.
    fn read_end(&mut self, name: &str, count: usize) -> io::Result<Vec<u8>>;

    /// Puts `from` in the place of `to`, atomically. Survives a power cut only after
    /// [`Storage::sync_dir`].
    fn rename(&mut self, from: &str, to: &str) -> io::Result<()>;

    /// Removes a file.
    fn remove(&mut self, name: &str) -> io::Result<()>;

    /// Makes names durable: what was created, renamed and removed before.
    fn sync_dir(&mut self) -> io::Result<()>;

    /// All files with their length in bytes, in any order.
    fn list(&mut self) -> io::Result<Vec<(String, u64)>>;

    /// Bytes that can still be written.
    fn free_space(&mut self) -> io::Result<u64>;

    /// Keeps the highest number that may have been given out, where it survives a kill.
    fn marker(&mut self) -> Box<dyn Marker>;

    /// What the last [`Marker`] kept; `None` where nobody can tell, as after a power cut.
    fn marked(&mut self) -> Option<u64>;
}

/// A note of the highest number that may have been given out. It need not survive a power cut, but
/// must not be believed after one.
pub trait Marker: Send {
    /// Numbers up to this one may be given out from now on.
    fn mark(&mut self, seq: u64);
}

/// A file that only grows, or is cut back to what is known to be good.
pub trait StorageFile: Send {
    /// Writes all bytes at the end. After an error an unknown part of them may be there.
    fn append(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// Makes the content durable. After an error nobody knows what of the bytes since the last
    /// success reached the disk, and asking again does not tell (on Linux a second `fsync` reports
    /// success for pages that were dropped): the file must not be trusted with more.
    fn sync(&mut self) -> io::Result<()>;

    /// Writes these bytes over those at `from`, which are the same. After a failed sync they are
    /// readable and on no disk, and nothing but writing them again brings them there; whoever finds
    /// them later cannot tell.
    fn overwrite(&mut self, from: u64, bytes: &[u8]) -> io::Result<()>;

    /// Length of what the file's name stands for (bytes); `None` where the name stands for another
    /// file, or for none. An error where nobody can tell.
    fn length(&mut self) -> io::Result<Option<u64>>;

    /// Cuts the file to `length` bytes; later appends follow there.
    fn truncate(&mut self, length: u64) -> io::Result<()>;
}
