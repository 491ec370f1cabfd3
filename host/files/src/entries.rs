//! A folder of results that may be made again: bytes under names, as many as fit, the last used ones.
//!
//! Nothing here is an error: what cannot be read is not there, and what cannot be written is made again the next time.

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// The folder within one of results. Hidden, since nobody reads what is in it.
pub const KEPT: &str = ".weldpath-kept";
/// Bytes of all entries together: some ten plans of scans of a few views.
const MOST_BYTES: u64 = 256 << 20;

/// The folder and how much may be in it.
#[derive(Debug, Clone)]
pub struct Entries {
    folder: PathBuf,
    most_bytes: u64,
}

impl Entries {
    /// Those within a folder of results.
    pub fn within(results: &Path) -> Self {
        Self { folder: results.join(KEPT), most_bytes: MOST_BYTES }
    }

    /// What is there under a name; it counts as used.
    pub fn read(&self, name: &str) -> Option<Vec<u8>> {
        let path = self.folder.join(name);
        let is_small = |there: fs::Metadata| there.is_file() && there.len() <= self.most_bytes;
        fs::symlink_metadata(&path).ok().filter(|there| is_small(there.clone()))?;
        let bytes = fs::read(&path).ok()?;
        // Who may not write there still may read.
        let _ =
            File::options().append(true).open(&path).and_then(|file| file.set_modified(SystemTime::now()));
        Some(bytes)
    }

    /// Puts `parts`, one after the other, under a name, and makes room for them.
    ///
    /// It gets its name when it is whole. It is not synced: whoever reads it has to see whether it is damaged in any case.
    pub fn write(&self, name: &str, parts: &[&[u8]]) {
        let bytes: u64 = parts.iter().map(|part| part.len() as u64).sum();
        if bytes > self.most_bytes || fs::create_dir_all(&self.folder).is_err() {
            return;
        }
        self.make_room(bytes);
        let Ok(mut file) = tempfile::NamedTempFile::new_in(&self.folder) else { return };
        if parts.iter().try_for_each(|part| file.write_all(part)).is_ok() {
            // What stays without a name is removed.
            let _ = file.persist(self.folder.join(name));
        }
    }

    /// Removes what was not used for longest, and what a killed run left.
    fn make_room(&self, bytes: u64) {
        let entries = fs::read_dir(&self.folder).into_iter().flatten().filter_map(Result::ok);
        let mut all: Vec<(SystemTime, u64, PathBuf)> = entries
            .filter_map(|entry| {
                let there = entry.metadata().ok().filter(fs::Metadata::is_file)?;
                Some((there.modified().ok()?, there.len(), entry.path()))
            })
            .collect();
        all.sort();
        let mut held: u64 = all.iter().map(|(_, bytes, _)| bytes).sum();
        for (_, own, path) in all {
            if held + bytes <= self.most_bytes {
                return;
            }
            if fs::remove_file(path).is_ok() {
                held -= own;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn what_is_written_is_read_and_what_was_not_used_for_longest_makes_room() {
        let home = tempfile::tempdir().unwrap();
        let entries = Entries { most_bytes: 10, ..Entries::within(home.path()) };
        assert_eq!(entries.read("a"), None);
        for (name, ago_s) in [("a", 30), ("b", 20), ("c", 10)] {
            entries.write(name, &[b"12", b"3"]);
            let file = File::options().append(true).open(home.path().join(KEPT).join(name)).unwrap();
            file.set_modified(SystemTime::now() - Duration::from_secs(ago_s)).unwrap();
        }
        assert_eq!(entries.read("a").as_deref(), Some(&b"123"[..]));
        entries.write("d", &[b"4567"]);
        assert_eq!(entries.read("b"), None, "not used for longest");
        assert!(["a", "c", "d"].iter().all(|name| entries.read(name).is_some()));
        entries.write("e", &[&[0; 11]]);
        assert_eq!(entries.read("e"), None, "it fits in no room");
        assert!(entries.read("d").is_some());
    }

    #[test]
    fn where_nothing_can_be_written_nothing_is_kept() {
        let home = tempfile::tempdir().unwrap();
        fs::write(home.path().join(KEPT), "a file in the way").unwrap();
        let entries = Entries::within(home.path());
        entries.write("a", &[b"1"]);
        assert_eq!(entries.read("a"), None);
    }
}
