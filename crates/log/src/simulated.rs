//! A disk that fails on command, for tests: it can lose power at any call, tear unsynced writes,
//! lose names that were not made durable, fill up, and report errors.
//!
//! What the model promises is what a journalling file system promises and no more: after
//! [`Simulated::power_cut`] a file holds what it held at its last `sync`, plus an arbitrary part of
//! the sectors written since; the folder holds the names of the last `sync_dir`, plus an arbitrary
//! first part of the changes since.

use std::collections::BTreeMap;
use std::io::{self, ErrorKind};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::storage::{Marker, Storage, StorageFile};

/// Bytes that a disk writes whole or not at all.
const SECTOR: usize = 512;

/// What goes wrong at a call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The machine stops before the call takes effect; every later call fails too.
    CrashBefore,
    /// The machine stops in the middle: of an append a first part is there.
    CrashDuring,
    /// The machine stops after the call took effect, before anybody learns of it.
    CrashAfter,
    /// The call fails with an I/O error; an append leaves a first part behind, a sync drops what
    /// was not durable.
    Io,
    /// The disk says that it is full; an append leaves a first part behind.
    Full,
}

/// When something goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Counts all calls from 1.
    pub call: u64,
    /// What goes wrong then.
    pub fault: Fault,
    /// It goes wrong at every later call too.
    pub for_good: bool,
}

#[derive(Clone, Default)]
struct File {
    current: Vec<u8>,
    durable: Vec<u8>,
    /// Lowest offset that was written or cut since the last sync.
    dirty_from: Option<usize>,
    /// A failed sync: from this offset on the disk holds these bytes, and no later sync changes
    /// that.
    poison: Option<(usize, Vec<u8>)>,
}

impl File {
    fn of(content: Vec<u8>) -> Self {
        Self { current: content.clone(), durable: content, dirty_from: None, poison: None }
    }

    /// A sync that succeeds. Linux marks the pages of a failed sync clean: they stay readable, and
    /// never reach the disk.
    fn sync(&mut self) {
        self.durable.clone_from(&self.current);
        if let Some((from, held)) = &self.poison {
            let end = (from + held.len()).min(self.durable.len());
            self.durable[*from..end].copy_from_slice(&held[..end - from]);
        }
        self.dirty_from = None;
    }
}

#[derive(Clone)]
enum NameChange {
    Set(String, u64),
    Rename(String, String),
    Remove(String),
}

#[derive(Default)]
struct Inner {
    files: BTreeMap<u64, File>,
    names: BTreeMap<String, u64>,
    durable_names: BTreeMap<String, u64>,
    name_changes: Vec<NameChange>,
    next_file: u64,
    calls: u64,
    plan: Option<Plan>,
    crashed: bool,
    capacity: Option<u64>,
    random: u64,
    meanwhile: Option<Meanwhile>,
    /// In the memory of the machine.
    marked: Option<u64>,
    witness: Witness,
}

/// What happens elsewhere while the disk is at work.
type Meanwhile = Arc<dyn Fn() + Send + Sync>;

/// What the disk itself saw of faults, whoever asked for them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Witness {
    /// Calls that ended with an I/O error.
    pub io_errors: u64,
    /// Calls that found the disk full.
    pub found_full: u64,
    /// Bytes that were in a file before a power cut and not after it, or other ones.
    pub torn_bytes: u64,
    /// Files that somebody removed or cut behind the service's back.
    pub taken: u64,
}

/// The disk. Clones are the same disk; it outlives the service that crashed.
#[derive(Clone, Default)]
pub struct Simulated(Arc<Mutex<Inner>>);

impl Simulated {
    /// An empty disk whose arbitrary choices follow from `seed`.
    pub fn new(seed: u64) -> Self {
        let disk = Self::default();
        disk.lock().random = seed ^ 0x9e37_79b9_7f4a_7c15;
        disk
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets what goes wrong, with calls counted from now on.
    pub fn plan(&self, plan: Option<Plan>) {
        let mut inner = self.lock();
        inner.plan = plan;
        inner.calls = 0;
    }

    /// While the disk makes something durable, `meanwhile` happens: time passes, others go on.
    pub fn set_meanwhile(&self, meanwhile: impl Fn() + Send + Sync + 'static) {
        self.lock().meanwhile = Some(Arc::new(meanwhile));
    }

    /// What the disk itself saw of faults.
    pub fn witness(&self) -> Witness {
        self.lock().witness
    }

    /// Calls since the last [`Simulated::plan`].
    pub fn calls(&self) -> u64 {
        self.lock().calls
    }

    /// The machine has stopped.
    pub fn crashed(&self) -> bool {
        self.lock().crashed
    }

    /// Bytes that all files together may take; `None` for no limit.
    pub fn set_capacity(&self, bytes: Option<u64>) {
        self.lock().capacity = bytes;
    }

    /// The process was killed, the machine goes on: everything written is there.
    pub fn restart(&self) {
        let mut inner = self.lock();
        inner.crashed = false;
        inner.plan = None;
    }

    /// The power was cut: only what was made durable is sure to be there.
    pub fn power_cut(&self) {
        let mut inner = self.lock();
        inner.crashed = false;
        inner.plan = None;
        inner.marked = None;
        let changes = std::mem::take(&mut inner.name_changes);
        let kept = inner.below(changes.len() + 1);
        let mut names = inner.durable_names.clone();
        changes.into_iter().take(kept).for_each(|change| apply(&mut names, change));
        inner.names.clone_from(&names);
        inner.durable_names = names;
        let ids: Vec<u64> = inner.files.keys().copied().collect();
        for id in ids {
            let Some(file) = inner.files.get(&id).cloned() else { continue };
            let torn = inner.tear(&file);
            let kept = torn.iter().zip(&file.current).filter(|(after, before)| after == before).count();
            inner.witness.torn_bytes += file.current.len().saturating_sub(kept) as u64;
            inner.files.insert(id, File::of(torn));
        }
    }

    /// All files as they are now.
    pub fn contents(&self) -> BTreeMap<String, Vec<u8>> {
        let inner = self.lock();
        let content = |id: &u64| inner.files.get(id).map_or_else(Vec::new, |file| file.current.clone());
        inner.names.iter().map(|(name, id)| (name.clone(), content(id))).collect()
    }

    /// Somebody removes a file while the service runs, and syncs the folder.
    pub fn take_away(&self, name: &str) {
        let mut inner = self.lock();
        inner.witness.taken += u64::from(inner.names.remove(name).is_some());
        inner.durable_names = inner.names.clone();
        inner.name_changes.clear();
    }

    /// Somebody cuts a file while the service runs; what is appended later follows there.
    pub fn cut(&self, name: &str, length: usize) {
        let mut inner = self.lock();
        if let Some(id) = inner.names.get(name).copied()
            && let Some(file) = inner.files.get_mut(&id)
        {
            let shorter = file.current.len() > length;
            file.current.truncate(length);
            *file = File::of(std::mem::take(&mut file.current));
            inner.witness.taken += u64::from(shorter);
        }
    }

    /// Changes a file behind everybody's back.
    pub fn overwrite(&self, name: &str, content: Vec<u8>) {
        let mut inner = self.lock();
        if let Some(id) = inner.names.get(name).copied() {
            inner.files.insert(id, File::of(content));
        }
    }
}

fn apply(names: &mut BTreeMap<String, u64>, change: NameChange) {
    match change {
        NameChange::Set(name, id) => drop(names.insert(name, id)),
        NameChange::Rename(from, to) => {
            if let Some(id) = names.remove(&from) {
                names.insert(to, id);
            }
        }
        NameChange::Remove(name) => drop(names.remove(&name)),
    }
}

fn crash() -> io::Error {
    io::Error::new(ErrorKind::BrokenPipe, "the simulated machine has stopped")
}

fn missing(name: &str) -> io::Error {
    io::Error::new(ErrorKind::NotFound, format!("{name}: no such file"))
}

impl Inner {
    /// A number below `bound` (xorshift64*, Vigna 2016; any generator would do).
    fn below(&mut self, bound: usize) -> usize {
        self.random ^= self.random >> 12;
        self.random ^= self.random << 25;
        self.random ^= self.random >> 27;
        (self.random.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) as usize % bound.max(1)
    }

    /// Counts a call and says what goes wrong with it.
    fn call(&mut self) -> io::Result<Option<Fault>> {
        if self.crashed {
            return Err(crash());
        }
        self.calls += 1;
        let hit = self.plan.filter(|plan| plan.call == self.calls || (plan.for_good && self.calls > plan.call));
        match hit.map(|plan| plan.fault) {
            Some(Fault::Io) => self.witness.io_errors += 1,
            Some(Fault::Full) => self.witness.found_full += 1,
            _ => {}
        }
        match hit.map(|plan| plan.fault) {
            Some(Fault::CrashBefore) => {
                self.crashed = true;
                Err(crash())
            }
            other => Ok(other),
        }
    }

    /// The outcome of a call that has no parts, after it took effect.
    fn after(&mut self, fault: Option<Fault>) -> io::Result<()> {
        match fault {
            Some(Fault::CrashAfter | Fault::CrashDuring) => {
                self.crashed = true;
                Err(crash())
            }
            _ => Ok(()),
        }
    }

    /// Refuses a call that has no parts.
    fn refuse(fault: Option<Fault>) -> io::Result<()> {
        match fault {
            Some(Fault::Io) => Err(io::Error::other("simulated I/O error")),
            Some(Fault::Full) => Err(ErrorKind::StorageFull.into()),
            _ => Ok(()),
        }
    }

    fn used(&self) -> u64 {
        self.names.values().filter_map(|id| self.files.get(id)).map(|file| file.current.len() as u64).sum()
    }

    /// What the platters hold after a power cut.
    fn tear(&mut self, file: &File) -> Vec<u8> {
        let Some(dirty) = file.dirty_from else { return file.durable.clone() };
        // The length is a number in the inode: any that the file had meanwhile, in steps of a
        // sector.
        let (low, high) = (file.durable.len().min(file.current.len()), file.durable.len().max(file.current.len()));
        let length = if self.below(3) == 0 { high } else { low + self.below(high - low + 1) };
        let mut torn = vec![0; length];
        let kept = length.min(file.durable.len());
        torn[..kept].copy_from_slice(&file.durable[..kept]);
        let mut at = dirty;
        while at < length {
            let end = ((at / SECTOR + 1) * SECTOR).min(length).min(file.current.len().max(at));
            if end <= at {
                break;
            }
            if self.below(2) == 0 {
                torn[at..end].copy_from_slice(&file.current[at..end]);
            }
            at = end;
        }
        torn
    }

    fn append(&mut self, id: u64, bytes: &[u8]) -> io::Result<()> {
        let fault = self.call()?;
        let room = self.capacity.map(|capacity| capacity.saturating_sub(self.used()));
        let full = room.is_some_and(|room| (bytes.len() as u64) > room);
        let part = match fault {
            Some(Fault::CrashDuring | Fault::Io | Fault::Full) => self.below(bytes.len() + 1),
            // Less than `bytes.len()`, so it fits.
            _ if full => room.unwrap_or(0) as usize,
            _ => bytes.len(),
        };
        if let Some(file) = self.files.get_mut(&id) {
            let at = file.current.len();
            file.dirty_from = Some(file.dirty_from.map_or(at, |dirty| dirty.min(at)));
            file.current.extend_from_slice(&bytes[..part]);
        }
        Self::refuse(fault)?;
        self.after(fault)?;
        self.witness.found_full += u64::from(full);
        if full { Err(ErrorKind::StorageFull.into()) } else { Ok(()) }
    }

    fn sync(&mut self, id: u64) -> io::Result<()> {
        let fault = self.call()?;
        if let Some(mut file) = self.files.remove(&id) {
            match fault {
                // Half of it has reached the disk; the rest is still waiting to be written.
                Some(Fault::CrashDuring) => file.durable = self.tear(&file),
                Some(Fault::Io | Fault::Full) => {
                    let from = file.dirty_from.unwrap_or(file.current.len());
                    let mut held = self.tear(&file);
                    held.resize(file.current.len().max(from), 0);
                    file.poison = Some((from, held.split_off(from)));
                    file.sync();
                }
                _ => file.sync(),
            }
            self.files.insert(id, file);
        }
        Self::refuse(fault)?;
        self.after(fault)
    }

    fn length(&mut self, id: u64) -> io::Result<Option<u64>> {
        let fault = self.call()?;
        Self::refuse(fault.filter(|fault| *fault == Fault::Io))?;
        self.after(fault)?;
        let named = self.names.values().any(|named| *named == id);
        Ok(self.files.get(&id).filter(|_| named).map(|file| file.current.len() as u64))
    }

    fn overwrite(&mut self, id: u64, from: u64, bytes: &[u8]) -> io::Result<()> {
        let fault = self.call()?;
        Self::refuse(fault)?;
        if let Some(file) = self.files.get_mut(&id) {
            let (from, end) = (from as usize, from as usize + bytes.len());
            if let Some(there) = file.current.get_mut(from..end) {
                there.copy_from_slice(bytes);
                file.dirty_from = Some(file.dirty_from.map_or(from, |dirty| dirty.min(from)));
                // What lay there is waiting to be written again.
                file.poison = file.poison.take().filter(|(at, _)| *at < from).map(|(at, mut held)| {
                    held.truncate(from - at);
                    (at, held)
                });
            }
        }
        self.after(fault)
    }

    fn truncate(&mut self, id: u64, length: u64) -> io::Result<()> {
        let fault = self.call()?;
        Self::refuse(fault)?;
        if let Some(file) = self.files.get_mut(&id) {
            let length = usize::try_from(length).unwrap_or(usize::MAX);
            if length < file.current.len() {
                file.current.truncate(length);
                file.poison = file.poison.take().filter(|(from, _)| *from < length);
                file.dirty_from = Some(file.dirty_from.map_or(length, |dirty| dirty.min(length)));
            }
        }
        self.after(fault)
    }
}

impl Storage for Simulated {
    fn create(&mut self, name: &str) -> io::Result<Box<dyn StorageFile>> {
        let mut inner = self.lock();
        let fault = inner.call()?;
        Inner::refuse(fault)?;
        if inner.names.contains_key(name) {
            return Err(io::Error::new(ErrorKind::AlreadyExists, format!("{name} exists")));
        }
        let id = inner.next_file;
        inner.next_file += 1;
        inner.files.insert(id, File::default());
        inner.names.insert(name.into(), id);
        inner.name_changes.push(NameChange::Set(name.into(), id));
        inner.after(fault)?;
        Ok(Box::new(SimulatedFile { disk: self.clone(), id }))
    }

    fn open(&mut self, name: &str) -> io::Result<Box<dyn StorageFile>> {
        let mut inner = self.lock();
        let fault = inner.call()?;
        Inner::refuse(fault)?;
        let id = inner.names.get(name).copied().ok_or_else(|| missing(name))?;
        inner.after(fault)?;
        Ok(Box::new(SimulatedFile { disk: self.clone(), id }))
    }

    fn read(&mut self, name: &str) -> io::Result<Vec<u8>> {
        let mut inner = self.lock();
        let fault = inner.call()?;
        Inner::refuse(fault.filter(|fault| *fault == Fault::Io))?;
        inner.after(fault)?;
        let id = inner.names.get(name).ok_or_else(|| missing(name))?;
        Ok(inner.files.get(id).map_or_else(Vec::new, |file| file.current.clone()))
    }

    fn read_end(&mut self, name: &str, count: usize) -> io::Result<Vec<u8>> {
        let all = self.read(name)?;
        Ok(all[all.len().saturating_sub(count)..].to_vec())
    }

    fn rename(&mut self, from: &str, to: &str) -> io::Result<()> {
        let mut inner = self.lock();
        let fault = inner.call()?;
        Inner::refuse(fault)?;
        if !inner.names.contains_key(from) {
            return Err(missing(from));
        }
        let change = NameChange::Rename(from.into(), to.into());
        apply(&mut inner.names, change.clone());
        inner.name_changes.push(change);
        inner.after(fault)
    }

    fn remove(&mut self, name: &str) -> io::Result<()> {
        let mut inner = self.lock();
        let fault = inner.call()?;
        Inner::refuse(fault.filter(|fault| *fault == Fault::Io))?;
        if inner.names.remove(name).is_none() {
            return Err(missing(name));
        }
        inner.name_changes.push(NameChange::Remove(name.into()));
        inner.after(fault)
    }

    fn sync_dir(&mut self) -> io::Result<()> {
        let mut inner = self.lock();
        let fault = inner.call()?;
        Inner::refuse(fault)?;
        inner.durable_names = inner.names.clone();
        inner.name_changes.clear();
        inner.after(fault)
    }

    fn list(&mut self) -> io::Result<Vec<(String, u64)>> {
        let mut inner = self.lock();
        let fault = inner.call()?;
        Inner::refuse(fault.filter(|fault| *fault == Fault::Io))?;
        inner.after(fault)?;
        let length = |id: &u64| inner.files.get(id).map_or(0, |file| file.current.len() as u64);
        Ok(inner.names.iter().map(|(name, id)| (name.clone(), length(id))).collect())
    }

    fn marker(&mut self) -> Box<dyn Marker> {
        Box::new(self.clone())
    }

    fn marked(&mut self) -> Option<u64> {
        self.lock().marked
    }

    fn free_space(&mut self) -> io::Result<u64> {
        let mut inner = self.lock();
        let fault = inner.call()?;
        Inner::refuse(fault.filter(|fault| *fault == Fault::Io))?;
        inner.after(fault)?;
        let used = inner.used();
        Ok(inner.capacity.map_or(u64::MAX, |capacity| capacity.saturating_sub(used)))
    }
}

impl Marker for Simulated {
    fn mark(&mut self, seq: u64) {
        let mut inner = self.lock();
        if !inner.crashed {
            inner.marked = Some(seq);
        }
    }
}

struct SimulatedFile {
    disk: Simulated,
    id: u64,
}

impl StorageFile for SimulatedFile {
    fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.disk.lock().append(self.id, bytes)
    }

    fn sync(&mut self) -> io::Result<()> {
        let meanwhile = self.disk.lock().meanwhile.clone();
        if let Some(meanwhile) = meanwhile {
            meanwhile();
        }
        self.disk.lock().sync(self.id)
    }

    fn length(&mut self) -> io::Result<Option<u64>> {
        self.disk.lock().length(self.id)
    }

    fn overwrite(&mut self, from: u64, bytes: &[u8]) -> io::Result<()> {
        self.disk.lock().overwrite(self.id, from, bytes)
    }

    fn truncate(&mut self, length: u64) -> io::Result<()> {
        self.disk.lock().truncate(self.id, length)
    }
}
