//! The hidden folder in which a run prepares its files, and the journal by which they come into force.
//!
//! `lock` is held by the run that lives. `new/` are files still to be put in place, `old/` second names of what they
//! replace. `journal` lists the names: where it exists, `new/` has to be put in place; where it has become `undo`, `old/`
//! has to be put back; where there is neither, nothing outside the folder was touched. Each step may be done twice.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::{Before, Error, File, Left, Operation};

/// Name of the hidden folder in the target.
pub const STAGING: &str = ".weldpath-run";

const LOCK: &str = "lock";
const JOURNAL: &str = "journal";
const UNDO: &str = "undo";

/// One name and whether a file of it was there before.
#[derive(Debug, Serialize, Deserialize)]
struct Entry {
    name: String,
    replaces: bool,
}

/// The hidden folder of a run that lives.
pub(super) struct Staging<'a> {
    target: &'a Path,
    folder: PathBuf,
    before: &'a Before<'a>,
    _lock: fs::File,
}

/// Finishes or undoes what a dead run left in `directory`, and removes its hidden folder.
///
/// # Errors
/// [`Error::Busy`] if that run lives; else what the system said.
pub fn settle(directory: &Path) -> Result<Option<Left>, Error> {
    let folder = directory.join(STAGING);
    if !folder.is_dir() {
        return Ok(None);
    }
    let staging =
        Staging { _lock: lock(directory, &folder)?, target: directory, folder, before: &|_| Ok(()) };
    let left = if let Some(entries) = staging.listed(UNDO)? {
        staging.put_back(&entries)?;
        Left::Undone
    } else if let Some(entries) = staging.listed(JOURNAL)? {
        staging.put_in_place(&entries)?;
        staging.forget(JOURNAL)?;
        Left::Finished
    } else {
        Left::Removed
    };
    fs::remove_dir_all(&staging.folder).map_err(Error::at(&staging.folder))?;
    Ok(Some(left))
}

/// The lock of the run that owns `folder`.
fn lock(target: &Path, folder: &Path) -> Result<fs::File, Error> {
    let path = folder.join(LOCK);
    let file =
        fs::File::options().create(true).truncate(false).write(true).open(&path).map_err(Error::at(&path))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(fs::TryLockError::WouldBlock) => Err(Error::Busy { directory: target.into() }),
        // A file system without locks: then nobody holds one.
        Err(fs::TryLockError::Error(_)) => Ok(file),
    }
}

impl<'a> Staging<'a> {
    /// Makes the hidden folder, and holds its lock.
    pub(super) fn make(target: &'a Path, before: &'a Before<'a>) -> Result<Self, Error> {
        let folder = target.join(STAGING);
        before(Operation::MakeFolder(&folder)).map_err(Error::at(target))?;
        match fs::create_dir(&folder) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
                return Err(Error::Busy { directory: target.into() });
            }
            made => made.map_err(Error::at(target))?,
        }
        let lock = lock(target, &folder)?;
        Ok(Self { target, folder, before, _lock: lock })
    }

    /// Writes a new file, and a second name for the one that it replaces; both are on the disk then.
    pub(super) fn stage(&self, file: &File) -> Result<(), Error> {
        let (new, target) = (self.folder.join("new").join(&file.name), self.target.join(&file.name));
        (self.before)(Operation::Stage(&new)).map_err(Error::at(&target))?;
        make_parent(&new)?;
        write_synced(&new, &file.bytes).map_err(Error::at(&target))?;
        if target.is_dir() {
            return Err(Error::at(target)(io::Error::from(io::ErrorKind::IsADirectory)));
        }
        if target.symlink_metadata().is_ok() {
            let old = self.folder.join("old").join(&file.name);
            (self.before)(Operation::Keep(&old)).map_err(Error::at(&target))?;
            make_parent(&old)?;
            // Some file systems know no second names.
            fs::hard_link(&target, &old)
                .or_else(|_| fs::read(&target).and_then(|bytes| write_synced(&old, &bytes)))
                .map_err(Error::at(&target))?;
        }
        Ok(())
    }

    /// Puts the staged files in place; if one of them cannot be, everything is put back.
    pub(super) fn install(&self, names: &[&str]) -> Result<(), Error> {
        let replaces = |name: &str| self.folder.join("old").join(name).symlink_metadata().is_ok();
        let entries: Vec<Entry> =
            names.iter().map(|name| Entry { name: (*name).into(), replaces: replaces(name) }).collect();
        self.commit(&entries)?;
        let Err(error) = self.put_in_place(&entries) else { return self.forget(JOURNAL) };
        // From here on a signal or a watcher no longer stops it: half way back is no place to be.
        let _ = (self.before)(Operation::Undo);
        let (journal, undo) = (self.folder.join(JOURNAL), self.folder.join(UNDO));
        fs::rename(&journal, &undo).map_err(Error::at(&journal))?;
        sync_folder(&self.folder);
        self.put_back(&entries)?;
        Err(error)
    }

    fn commit(&self, entries: &[Entry]) -> Result<(), Error> {
        for folder in ["new", "old"].map(|name| self.folder.join(name)) {
            self.sync(&folder)?;
        }
        let (part, journal) = (self.folder.join("journal.part"), self.folder.join(JOURNAL));
        let text = serde_json::to_vec(entries).map_err(|error| Error::at(self.target)(error.into()))?;
        write_synced(&part, &text).map_err(Error::at(self.target))?;
        (self.before)(Operation::Commit).map_err(Error::at(self.target))?;
        fs::rename(&part, &journal).map_err(Error::at(self.target))?;
        sync_folder(&self.folder);
        Ok(())
    }

    fn put_in_place(&self, entries: &[Entry]) -> Result<(), Error> {
        for entry in entries {
            let (new, target) = (self.folder.join("new").join(&entry.name), self.target.join(&entry.name));
            if new.symlink_metadata().is_ok() {
                (self.before)(Operation::Install(&target)).map_err(Error::at(&target))?;
                make_parent(&target)?;
                fs::rename(&new, &target).map_err(Error::at(&target))?;
            }
        }
        self.sync_targets(entries)
    }

    fn put_back(&self, entries: &[Entry]) -> Result<(), Error> {
        for entry in entries {
            let (old, target) = (self.folder.join("old").join(&entry.name), self.target.join(&entry.name));
            let _ = (self.before)(Operation::PutBack(&target));
            if entry.replaces && old.symlink_metadata().is_ok() {
                fs::rename(&old, &target).map_err(Error::at(&target))?;
            } else if !entry.replaces && target.is_file() {
                fs::remove_file(&target).map_err(Error::at(&target))?;
            }
        }
        // A watcher has no say in going back.
        let _ = self.sync_targets(entries);
        self.forget(UNDO)
    }

    fn sync_targets(&self, entries: &[Entry]) -> Result<(), Error> {
        let mut folders: Vec<PathBuf> =
            entries.iter().filter_map(|entry| Some(self.target.join(&entry.name).parent()?.into())).collect();
        folders.sort();
        folders.dedup();
        folders.iter().try_for_each(|folder| self.sync(folder))
    }

    fn sync(&self, folder: &Path) -> Result<(), Error> {
        (self.before)(Operation::Sync(folder)).map_err(Error::at(folder))?;
        sync_folder(folder);
        Ok(())
    }

    fn forget(&self, journal: &str) -> Result<(), Error> {
        let _ = (self.before)(Operation::Forget);
        let path = self.folder.join(journal);
        fs::remove_file(&path).map_err(Error::at(&path))
    }

    /// Removes the hidden folder, unless a journal in it is still to be followed.
    pub(super) fn clean(&self) {
        if [JOURNAL, UNDO].iter().any(|name| self.folder.join(name).exists()) {
            return;
        }
        let _ = (self.before)(Operation::Clean);
        // What stays is removed by the next run.
        let _ = fs::remove_dir_all(&self.folder);
    }

    fn listed(&self, journal: &str) -> Result<Option<Vec<Entry>>, Error> {
        let path = self.folder.join(journal);
        match fs::read(&path) {
            Ok(bytes) => {
                let entries: Vec<Entry> =
                    serde_json::from_slice(&bytes).map_err(|error| Error::at(&path)(error.into()))?;
                let inside = |entry: &Entry| {
                    Path::new(&entry.name).components().all(|c| matches!(c, std::path::Component::Normal(_)))
                };
                let all = entries.iter().all(inside);
                let foreign = || io::Error::new(io::ErrorKind::InvalidData, "names outside the folder");
                if all { Ok(Some(entries)) } else { Err(Error::at(&path)(foreign())) }
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(Error::at(&path)(error)),
        }
    }
}

fn make_parent(path: &Path) -> Result<(), Error> {
    path.parent().map_or(Ok(()), |parent| fs::create_dir_all(parent).map_err(Error::at(parent)))
}

fn write_synced(path: &Path, bytes: &[u8]) -> io::Result<()> {
    use io::Write;
    let mut file = fs::File::create(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

/// Brings the names in a folder to the disk, where the system can do that: some open no folders, some sync none, and the
/// order of a journalled file system holds there.
fn sync_folder(folder: &Path) {
    let _ = fs::File::open(folder).and_then(|folder| folder.sync_all());
}
