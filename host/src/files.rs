//! Writes the files of a run: all of them, or none.
//!
//! Everything is first written to a hidden folder inside the target, so a full disk or a missing permission is met
//! before anything is replaced; then the files are renamed into place, and put back if one of them cannot be.

use rayon::prelude::*;
use std::io;
use std::path::{Path, PathBuf};

/// Why nothing was written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: {source}; nothing was changed there", path.display())]
pub struct Error {
    /// The file or folder that refused.
    pub path: PathBuf,
    /// What the system said.
    pub source: io::Error,
}

impl Error {
    fn at(path: impl Into<PathBuf>) -> impl FnOnce(io::Error) -> Self {
        let path = path.into();
        |source| Self { path, source: plain(source) }
    }
}

/// Without the name of a temporary file, which tells nobody anything.
fn plain(error: io::Error) -> io::Error {
    if error.raw_os_error().is_some() { error } else { error.kind().into() }
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

/// Writes all `files` into `directory`, which is made if it is missing. Other files there stay as they are.
///
/// ```
/// use weldpath::files::{File, write};
///
/// let folder = tempfile::tempdir()?;
/// write(folder.path(), &[File::new("a.txt", "one"), File::new("b.txt", "two")]).expect("all of them or none");
/// assert_eq!(std::fs::read_to_string(folder.path().join("b.txt"))?, "two");
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn write(directory: &Path, files: &[File]) -> Result<(), Error> {
    let made = make(directory)?;
    let result = write_into(directory, files);
    if let (Err(_), Some(made)) = (&result, made) {
        let _ = std::fs::remove_dir_all(made);
    }
    result
}

/// Files in `directory` that an earlier run wrote and that are not among `files`, sorted: they follow another plan.
pub fn of_earlier_runs(directory: &Path, files: &[File]) -> Vec<String> {
    let entries = std::fs::read_dir(directory).into_iter().flatten().flatten();
    let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
    let is_ours = |name: &String| {
        let dialect = [".mod", ".src", ".dat", ".ls"].iter().any(|extension| name.ends_with(extension));
        dialect || RESULTS.contains(&name.as_str())
    };
    let mut left: Vec<String> =
        names.filter(|name| is_ours(name) && files.iter().all(|file| file.name != *name)).collect();
    left.sort();
    left
}

/// What some runs write and others do not, beside the programs that are named by the job.
const RESULTS: [&str; 7] =
    ["path.script", "poses.yaml", "poses.json", "report.html", "report.svg", "feasibility.csv", "refit.json"];

/// Whether [`write()`] may put files there, asked before the work that makes them. Changes nothing.
pub fn check(directory: &Path) -> Result<(), Error> {
    let named = directory.ancestors().filter(|a| !a.as_os_str().is_empty());
    let nearest = named.chain([Path::new(".")]).find(|a| a.exists()).unwrap_or(directory);
    tempfile::Builder::new().prefix(".weldpath-").tempdir_in(nearest).map(drop).map_err(Error::at(directory))
}

/// Makes `directory` and tells the topmost folder that was not there before.
fn make(directory: &Path) -> Result<Option<PathBuf>, Error> {
    let missing = directory.ancestors().take_while(|a| !a.as_os_str().is_empty() && !a.exists()).last();
    let missing = missing.map(Path::to_path_buf);
    std::fs::create_dir_all(directory).map_err(Error::at(directory))?;
    Ok(missing)
}

fn write_into(directory: &Path, files: &[File]) -> Result<(), Error> {
    let staging =
        tempfile::Builder::new().prefix(".weldpath-").tempdir_in(directory).map_err(Error::at(directory))?;
    let (fresh, replaced) = (staging.path().join("new"), staging.path().join("old"));
    files.par_iter().try_for_each(|file| {
        let path = fresh.join(&file.name);
        make_parent(&path)?;
        std::fs::write(&path, &file.bytes).map_err(Error::at(directory.join(&file.name)))
    })?;
    let mut done: Vec<&str> = Vec::new();
    for file in files {
        done.push(&file.name);
        if let Err(error) = exchange(&file.name, directory, &fresh, &replaced) {
            done.iter().for_each(|name| put_back(name, directory, &fresh, &replaced));
            return Err(error);
        }
    }
    Ok(())
}

/// Moves what has this name to `replaced`, and the fresh file to its place.
fn exchange(name: &str, directory: &Path, fresh: &Path, replaced: &Path) -> Result<(), Error> {
    let (target, old) = (directory.join(name), replaced.join(name));
    if target.is_dir() {
        return Err(Error::at(target)(io::Error::from(io::ErrorKind::IsADirectory)));
    }
    make_parent(&target)?;
    if target.symlink_metadata().is_ok() {
        make_parent(&old)?;
        std::fs::rename(&target, &old).map_err(Error::at(&target))?;
    }
    std::fs::rename(fresh.join(name), &target).map_err(Error::at(&target))
}

/// Undoes [`exchange`], however far it came.
fn put_back(name: &str, directory: &Path, fresh: &Path, replaced: &Path) {
    let (target, old) = (directory.join(name), replaced.join(name));
    let arrived = fresh.join(name).symlink_metadata().is_err();
    if arrived {
        let _ = std::fs::remove_file(&target);
    }
    if old.symlink_metadata().is_ok() {
        let _ = std::fs::rename(old, target);
    }
}

fn make_parent(path: &Path) -> Result<(), Error> {
    path.parent().map_or(Ok(()), |parent| std::fs::create_dir_all(parent).map_err(Error::at(parent)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn programs_of_an_earlier_run_are_named() {
        let home = tempfile::tempdir().unwrap();
        let named = |names: &[&str]| names.iter().map(|&name| File::new(name, name)).collect::<Vec<_>>();
        write(home.path(), &named(&["path.script", "weldpath_2.src", "notes.txt", "path.json"])).unwrap();
        let now = named(&["path.json", "weldpath.mod", "path.script"]);
        write(home.path(), &now).unwrap();
        assert_eq!(of_earlier_runs(home.path(), &now), ["weldpath_2.src"]);
        assert_eq!(of_earlier_runs(&home.path().join("none"), &now), [""; 0]);
    }

    fn names(directory: &Path) -> Vec<String> {
        let mut names: Vec<String> = std::fs::read_dir(directory)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn all_files_are_written_and_nothing_else() {
        let home = tempfile::tempdir().unwrap();
        let out = home.path().join("a/b");
        write(&out, &[File::new("one", "1"), File::new("deep/two", "2")]).unwrap();
        assert_eq!(names(&out), ["deep", "one"]);
        write(&out, &[File::new("one", "new")]).unwrap();
        assert_eq!(std::fs::read_to_string(out.join("one")).unwrap(), "new");
        assert_eq!(std::fs::read_to_string(out.join("deep/two")).unwrap(), "2");
    }

    #[test]
    fn a_file_that_cannot_be_replaced_leaves_all_of_them_as_they_were() {
        let home = tempfile::tempdir().unwrap();
        std::fs::write(home.path().join("one"), "old").unwrap();
        std::fs::create_dir(home.path().join("three")).unwrap();
        let files = [File::new("one", "1"), File::new("two", "2"), File::new("three", "3")];
        let error = write(home.path(), &files).unwrap_err();
        assert!(error.path.ends_with("three"), "{error}");
        assert_eq!(names(home.path()), ["one", "three"]);
        assert_eq!(std::fs::read_to_string(home.path().join("one")).unwrap(), "old");
    }

    #[test]
    fn a_folder_that_cannot_be_made_is_named() {
        let home = tempfile::tempdir().unwrap();
        let blocked = home.path().join("file");
        std::fs::write(&blocked, "").unwrap();
        assert!(check(&blocked.join("out")).is_err());
        assert!(check(&home.path().join("a/b")).is_ok());
        let error = write(&blocked.join("out"), &[File::new("one", "1")]).unwrap_err();
        assert!(error.to_string().contains("file"), "{error}");
        assert_eq!(names(home.path()), ["file"]);
    }

    #[test]
    fn a_folder_made_for_a_run_that_fails_is_gone_again() {
        let home = tempfile::tempdir().unwrap();
        let out = home.path().join("a/b");
        let files = [File::new("one", "1"), File::new("one/two", "2")];
        assert!(write(&out, &files).is_err());
        assert!(names(home.path()).is_empty());
    }
}
