//! `weldpath-manifest.json`: which files of a folder weldpath wrote, and what they held then.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::File;

/// Name of the manifest in its folder.
pub const NAME: &str = "weldpath-manifest.json";

const FORMAT: &str = "weldpath-manifest";
const VERSION: u32 = 1;

/// The files that runs wrote to one folder.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Manifest {
    files: BTreeMap<String, Content>,
}

#[derive(Serialize, Deserialize)]
struct Stored {
    format: String,
    version: u32,
    files: BTreeMap<String, Content>,
}

/// Enough to see that somebody changed a file; no guard against one who wants to hide it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Content {
    bytes: u64,
    fnv1a: String,
}

impl Content {
    /// FNV-1a of 64 bits, <http://www.isthe.com/chongo/tech/comp/fnv/>.
    fn of(bytes: &[u8]) -> Self {
        let hash = bytes.iter().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
        });
        Self { bytes: bytes.len() as u64, fnv1a: format!("{hash:016x}") }
    }
}

impl Manifest {
    /// That of `directory`; empty if there is none that can be read.
    pub fn read(directory: &Path) -> Self {
        let stored =
            std::fs::read(directory.join(NAME)).ok().and_then(|b| serde_json::from_slice::<Stored>(&b).ok());
        let stored = stored.filter(|stored| stored.format == FORMAT && stored.version == VERSION);
        Self { files: stored.map(|stored| stored.files).unwrap_or_default() }
    }

    /// Whether `directory` holds a file of the manifest's name that is none of ours.
    pub(crate) fn is_foreign(directory: &Path) -> bool {
        let path = directory.join(NAME);
        let ours = || std::fs::read(&path).ok().and_then(|b| serde_json::from_slice::<Stored>(&b).ok());
        path.symlink_metadata().is_ok() && ours().is_none_or(|stored| stored.format != FORMAT)
    }

    /// As a file.
    pub fn to_json(&self) -> String {
        let stored = Stored { format: FORMAT.into(), version: VERSION, files: self.files.clone() };
        serde_json::to_string_pretty(&stored).map(|text| text + "\n").unwrap_or_default()
    }

    /// With `files`, and without what is no longer in `directory`.
    #[must_use]
    pub fn with(&self, directory: &Path, files: &[File]) -> Self {
        let there = |(name, _): &(&String, &Content)| directory.join(name).symlink_metadata().is_ok();
        let mut all: BTreeMap<String, Content> =
            self.files.iter().filter(there).map(|(name, content)| (name.clone(), content.clone())).collect();
        all.extend(files.iter().map(|file| (file.name.clone(), Content::of(&file.bytes))));
        Self { files: all }
    }

    /// Files that it names and that are in `directory`, sorted.
    pub fn names_in(&self, directory: &Path) -> Vec<String> {
        self.files.keys().filter(|name| directory.join(name).is_file()).cloned().collect()
    }

    /// Why the file of this name must not be replaced by one with the content `new`; `None` if it may, or is not there.
    pub fn claim(&self, directory: &Path, name: &str, new: Option<&[u8]>) -> Option<&'static str> {
        let path = directory.join(name);
        let there = path.symlink_metadata().ok()?;
        if there.is_dir() {
            return None; // told by the system in its own words
        }
        let Some(written) = self.files.get(name) else {
            let same =
                there.is_file() && new.is_some_and(|new| std::fs::read(&path).is_ok_and(|old| old == new));
            return (!same).then_some("not written by weldpath");
        };
        let unchanged = there.is_file()
            && there.len() == written.bytes
            && std::fs::read(&path)
                .is_ok_and(|old| Content::of(&old) == *written || new == Some(old.as_slice()));
        (!unchanged).then_some("changed since weldpath wrote it")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_is_that_of_its_authors() {
        // Test vectors of FNV-1a 64.
        assert_eq!(Content::of(b"").fnv1a, "cbf29ce484222325");
        assert_eq!(Content::of(b"a").fnv1a, "af63dc4c8601ec8c");
        assert_eq!(Content::of(b"foobar").fnv1a, "85944171f73967e8");
    }

    #[test]
    fn a_manifest_of_another_kind_or_version_claims_nothing_as_ours() {
        let home = tempfile::tempdir().unwrap();
        std::fs::write(home.path().join("a"), "1").unwrap();
        for text in ["", "{", "{\"format\":\"x\",\"version\":1,\"files\":{}}", "[1,2]"] {
            std::fs::write(home.path().join(NAME), text).unwrap();
            assert_eq!(Manifest::read(home.path()), Manifest::default());
            assert!(Manifest::read(home.path()).claim(home.path(), "a", None).is_some());
        }
        let ours = Manifest::default().with(home.path(), &[File::new("a", "1")]);
        std::fs::write(home.path().join(NAME), ours.to_json()).unwrap();
        assert_eq!(Manifest::read(home.path()), ours);
        assert_eq!(ours.claim(home.path(), "a", None), None);
    }
}
