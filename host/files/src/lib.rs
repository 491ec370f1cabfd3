//! Writes the files of a run: all of them, or none, whenever the program is killed.
//!
//! Everything is first written and synced in a hidden folder inside the target ([`STAGING`]), so a full disk or a
//! missing permission is met before anything is replaced. Then a `journal` is renamed into place, which is the
//! switch: before it nothing in the target has changed, after it every file is renamed to its name. A run that is killed
//! leaves its journal, and the next one, or a reader that calls [`settle`], finishes or undoes what it says.
//!
//! Only files that the [`manifest`] of an earlier run names, and that nobody has changed since, are replaced.
#![forbid(unsafe_code)]

pub mod entries;
pub mod interrupt;
mod journal;
pub mod manifest;
pub mod reading;

use std::fmt::Write as _;
use std::io;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

pub use journal::{STAGING, settle};
use manifest::Manifest;

/// Why nothing was written.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The system refuses.
    #[error("cannot write {}: {source}; nothing was changed there", path.display())]
    System {
        /// The file or folder that refused.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Files stand in the way that are not ours to replace.
    #[error("{} holds {}; nothing was changed there", directory.display(), list(names))]
    NotOurs {
        /// The folder.
        directory: PathBuf,
        /// Each with what it is.
        names: Vec<String>,
    },
    /// Another run is writing there at this moment.
    #[error("another run is writing to {}; nothing was changed there", directory.display())]
    Busy {
        /// The folder.
        directory: PathBuf,
    },
    /// Ctrl-C, or another signal that ends a program.
    #[error("interrupted while writing to {}; everything there is as it was", directory.display())]
    Interrupted {
        /// The folder.
        directory: PathBuf,
    },
}

impl Error {
    pub(crate) fn at(path: impl Into<PathBuf>) -> impl FnOnce(io::Error) -> Self {
        let path = path.into();
        |source| Self::System { path, source: plain(source) }
    }
}

/// Without the name of a temporary file, which tells nobody anything.
fn plain(error: io::Error) -> io::Error {
    if error.raw_os_error().is_some() { error } else { error.kind().into() }
}

/// At most this many names are told.
const MOST_NAMES: usize = 5;

fn list(names: &[String]) -> String {
    let mut text = names.iter().take(MOST_NAMES).map(String::as_str).collect::<Vec<_>>().join(", ");
    if names.len() > MOST_NAMES {
        // Writing to a String cannot fail.
        let _ = write!(text, " and {} more", names.len() - MOST_NAMES);
    }
    text
}

/// One file of a run.
#[derive(Debug, Clone)]
pub struct File {
    /// Relative to the folder; may have a folder of its own.
    pub name: String,
    /// Its content.
    pub bytes: Vec<u8>,
}

impl File {
    /// A file with this name and content.
    pub fn new(name: impl Into<String>, bytes: impl Into<Vec<u8>>) -> Self {
        Self { name: name.into(), bytes: bytes.into() }
    }
}

/// One step of a writer that changes something on the disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Operation<'a> {
    /// A folder is made.
    MakeFolder(&'a Path),
    /// A new file is written to the hidden folder, and synced.
    Stage(&'a Path),
    /// A file that will be replaced gets a second name in the hidden folder.
    Keep(&'a Path),
    /// The switch: the journal comes into force.
    Commit,
    /// A file gets its name.
    Install(&'a Path),
    /// A folder is synced.
    Sync(&'a Path),
    /// The journal is turned back.
    Undo,
    /// A file gets its old content back.
    PutBack(&'a Path),
    /// The journal is done with.
    Forget,
    /// The hidden folder is removed.
    Clean,
}

/// Called before every [`Operation`]; an error makes the writer put everything back.
pub type Before<'a> = dyn Fn(Operation<'_>) -> io::Result<()> + Sync + 'a;

/// What a dead run had left in a folder, and what became of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Left {
    /// It had not got to replace anything.
    Removed,
    /// Its files are all in place now.
    Finished,
    /// All is as it was before it.
    Undone,
}

impl Left {
    /// For people.
    pub fn words(self) -> &'static str {
        match self {
            Self::Removed => "a run that was killed had begun to write; its temporary files are removed",
            Self::Finished => "a run was killed while it put its files in place; they are all in place now",
            Self::Undone => "a run was killed while it put old files back; they are all back now",
        }
    }
}

/// Writes files into a folder.
#[derive(Clone, Copy)]
pub struct Writer<'a> {
    directory: &'a Path,
    overwrite: bool,
    given: Option<&'a Path>,
    before: &'a Before<'a>,
}

impl<'a> Writer<'a> {
    /// One that replaces only what an earlier run wrote.
    pub fn new(directory: &'a Path) -> Self {
        Self { directory, overwrite: false, given: None, before: &|_| Ok(()) }
    }

    /// Replaces whatever stands in the way, if `overwrite`.
    #[must_use]
    pub fn overwrite(self, overwrite: bool) -> Self {
        Self { overwrite, ..self }
    }

    /// This file may be replaced though it was changed: the run was told by it what to do, and writes it anew.
    #[must_use]
    pub fn given(self, given: Option<&'a Path>) -> Self {
        Self { given, ..self }
    }

    /// Is called before everything that changes the disk.
    #[must_use]
    pub fn watched(self, before: &'a Before<'a>) -> Self {
        Self { before, ..self }
    }

    /// Writes all `files`, or none; the folder is made if it is missing, and other files there stay as they are. What a
    /// dead run had left is settled first.
    ///
    /// # Errors
    /// Names what stands in the way, and has changed nothing.
    pub fn write(&self, files: &[File]) -> Result<Option<Left>, Error> {
        let signals = interrupt::hold();
        let stop_on_signal = |operation: Operation<'_>| {
            (self.before)(operation)?;
            if signals.asked() { Err(io::Error::from(io::ErrorKind::Interrupted)) } else { Ok(()) }
        };
        let made = missing_root(self.directory);
        let result = self.write_held(files, &stop_on_signal);
        if let (Err(_), Some(made)) = (&result, made) {
            // Only if it is empty: what else came there in the meantime stays.
            remove_empty(&made, self.directory);
        }
        match result {
            Err(_) if signals.asked() => Err(Error::Interrupted { directory: self.directory.into() }),
            result => result,
        }
    }

    fn write_held(&self, files: &[File], before: &Before<'_>) -> Result<Option<Left>, Error> {
        before(Operation::MakeFolder(self.directory)).map_err(Error::at(self.directory))?;
        std::fs::create_dir_all(self.directory).map_err(Error::at(self.directory))?;
        let left = settle(self.directory)?;
        let staging = journal::Staging::make(self.directory, before)?;
        let result = self.stage_and_install(&staging, files);
        staging.clean();
        result.map(|()| left)
    }

    fn stage_and_install(&self, staging: &journal::Staging<'_>, files: &[File]) -> Result<(), Error> {
        let earlier = Manifest::read(self.directory);
        self.refuse_foreign(&earlier, files)?;
        let manifest = File::new(manifest::NAME, earlier.with(self.directory, files).to_json());
        files.par_iter().chain([&manifest]).try_for_each(|file| staging.stage(file))?;
        let names: Vec<&str> = files.iter().chain([&manifest]).map(|file| file.name.as_str()).collect();
        staging.install(&names)
    }

    fn refuse_foreign(&self, earlier: &Manifest, files: &[File]) -> Result<(), Error> {
        if self.overwrite {
            return Ok(());
        }
        let given = self.given.and_then(|path| path.canonicalize().ok());
        let is_given = |name: &str| given.is_some() && self.directory.join(name).canonicalize().ok() == given;
        let foreign = |file: &File| {
            let claim = earlier.claim(self.directory, &file.name, Some(&file.bytes));
            claim.filter(|_| !is_given(&file.name)).map(|why| format!("{} ({why})", file.name))
        };
        let mut names: Vec<String> = files.iter().filter_map(foreign).collect();
        if Manifest::is_foreign(self.directory) {
            names.push(format!("{} (not written by weldpath)", manifest::NAME));
        }
        if names.is_empty() {
            Ok(())
        } else {
            Err(Error::NotOurs { directory: self.directory.into(), names })
        }
    }
}

/// Writes all `files` into `directory` as a [`Writer`] does that replaces only what an earlier run wrote.
///
/// ```
/// use weldpath_files::{File, write};
///
/// let folder = tempfile::tempdir()?;
/// write(folder.path(), &[File::new("a.txt", "one"), File::new("b.txt", "two")]).expect("all of them or none");
/// assert_eq!(std::fs::read_to_string(folder.path().join("b.txt"))?, "two");
/// # Ok::<(), std::io::Error>(())
/// ```
///
/// # Errors
/// Names what stands in the way, and has changed nothing.
pub fn write(directory: &Path, files: &[File]) -> Result<(), Error> {
    Writer::new(directory).write(files).map(drop)
}

/// Files in `directory` that an earlier run wrote and that are not among `files`, sorted: they follow another plan.
pub fn of_earlier_runs(directory: &Path, files: &[File]) -> Vec<String> {
    let names = Manifest::read(directory).names_in(directory);
    names.into_iter().filter(|name| files.iter().all(|file| file.name != *name)).collect()
}

/// Whether a [`Writer`] may put files there, `certain` ones among them, asked before the work that makes them. Changes
/// nothing but what a dead run left.
///
/// # Errors
/// As [`Writer::write`].
pub fn check(directory: &Path, certain: &[&str], overwrite: bool) -> Result<Option<Left>, Error> {
    let named = directory.ancestors().filter(|a| !a.as_os_str().is_empty());
    let nearest = named.chain([Path::new(".")]).find(|a| a.exists()).unwrap_or(directory);
    // A file without a name: nothing can be left of it.
    tempfile::tempfile_in(nearest).map_err(Error::at(directory))?;
    let left = settle(directory)?;
    let earlier = Manifest::read(directory);
    let foreign = |name: &&str| earlier.claim(directory, name, None).map(|why| format!("{name} ({why})"));
    let names: Vec<String> = certain.iter().filter_map(foreign).collect();
    if overwrite || names.is_empty() {
        Ok(left)
    } else {
        Err(Error::NotOurs { directory: directory.into(), names })
    }
}

/// The topmost folder that has to be made for `directory`.
fn missing_root(directory: &Path) -> Option<PathBuf> {
    let missing = directory.ancestors().take_while(|a| !a.as_os_str().is_empty() && !a.exists()).last();
    missing.map(Path::to_path_buf)
}

/// Removes `directory` and the folders above it up to `root`, as long as they are empty.
fn remove_empty(root: &Path, directory: &Path) {
    for folder in directory.ancestors().take_while(|a| a.starts_with(root)) {
        if std::fs::remove_dir(folder).is_err() && folder.exists() {
            return;
        }
    }
}

#[cfg(test)]
mod tests;
