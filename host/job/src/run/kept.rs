//! What the stages of a plan found, kept under [`Key`]s of all that they hang on: for the next plan that is given the same.
//!
//! Nothing is kept by a list of what may change. A key is made of the whole of what a stage is given, as the stage takes it,
//! and of the program itself; so what is kept is either what the stage would find again, or is not found.

pub(crate) mod content;
mod key;

use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use serde::Serialize;
use serde::de::DeserializeOwned;

use weldpath_files::entries::Entries;

pub(crate) use key::Digest;
pub use key::Key;

use content::of_files;

/// Results that are kept of each stage in memory, the last used ones: the two sides of an edit and of its undoing, with
/// something beside. One of a plan takes some 20 MB.
const MOST_IN_MEMORY: usize = 4;

#[derive(Debug)]
struct Recent<T> {
    /// The last used one behind.
    results: Vec<(Key, Arc<T>)>,
    /// Of those that are not on the disk yet.
    unsaved: Vec<Key>,
}

/// Results of one stage.
#[derive(Debug)]
pub struct Shelf<T> {
    recent: Mutex<Recent<T>>,
    most: usize,
    /// Where they outlive the program, and the ending of their names there.
    disk: Option<(Entries, &'static str)>,
}

impl<T> Shelf<T> {
    /// One that is forgotten with the program.
    pub fn in_memory() -> Self {
        Self::of_the_last(MOST_IN_MEMORY)
    }

    /// One that is forgotten with the program, and keeps so many of the last used results.
    pub(crate) fn of_the_last(most: usize) -> Self {
        let recent = Recent { results: Vec::new(), unsaved: Vec::new() };
        Self { recent: Mutex::new(recent), most, disk: None }
    }

    /// One that outlives it, in a folder of results, under names that end with `stage`. In memory alone where the system does
    /// not tell which program this is: then a later one cannot tell either whether it would find the same.
    pub fn within(results: &Path, stage: &'static str) -> Self {
        let disk = program().map(|_| (Entries::within(results), stage));
        Self { disk, ..Self::in_memory() }
    }

    fn lock(&self) -> MutexGuard<'_, Recent<T>> {
        // Lists that a thread left when it died are whole: each change of them is one call.
        self.recent.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What was found from the same, if it is in memory.
    pub(crate) fn recent(&self, key: Key) -> Option<Arc<T>> {
        let results = &mut self.lock().results;
        let at = results.iter().position(|(own, _)| *own == key)?;
        let kept = results.remove(at);
        let result = Arc::clone(&kept.1);
        results.push(kept);
        Some(result)
    }

    /// Keeps what was found in memory alone.
    pub(crate) fn remember(&self, key: Key, result: &Arc<T>) {
        let results = &mut self.lock().results;
        results.retain(|(own, _)| *own != key);
        results.push((key, Arc::clone(result)));
        let many = results.len().saturating_sub(self.most);
        results.drain(..many);
    }

    /// Keeps what was found, and lets go of what was not used for longest.
    pub fn put(&self, key: Key, result: &Arc<T>) {
        self.remember(key, result);
        self.lock().unsaved.push(key);
    }
}

impl<T: Serialize + DeserializeOwned> Shelf<T> {
    /// What was found from the same. An entry on the disk that is damaged is none.
    pub fn get(&self, key: Key) -> Option<Arc<T>> {
        let from_disk = || {
            let (entries, stage) = self.disk.as_ref()?;
            let bytes = entries.read(&format!("{key}.{stage}"))?;
            let (seal, body) = bytes.split_at_checked(SEAL_BYTES)?;
            let result = Arc::new(postcard::from_bytes(body).ok().filter(|_| seal == self::seal(key, body))?);
            self.remember(key, &result);
            Some(result)
        };
        self.recent(key).or_else(from_disk)
    }

    /// Puts on the disk what is not there yet. Nothing of it is written before: a run that comes to nothing leaves nothing.
    pub fn save(&self) {
        let unsaved = std::mem::take(&mut self.lock().unsaved);
        let Some((entries, stage)) = &self.disk else { return };
        for key in unsaved {
            let Some(result) = self.recent(key) else { continue };
            // A path that is no text cannot be written down; then it is found again the next time.
            let Ok(body) = postcard::to_stdvec(&*result) else { continue };
            entries.write(&format!("{key}.{stage}"), &[&seal(key, &body), &body]);
        }
    }
}

/// Bytes before those of a result on the disk.
const SEAL_BYTES: usize = 32;

/// What shows that all bytes of a result are there, and that they are those of this key: its digest in digits.
fn seal(key: Key, body: &[u8]) -> [u8; SEAL_BYTES] {
    let mut digest = Digest::default();
    digest.key(key);
    digest.bytes(body);
    let mut seal = [0; SEAL_BYTES];
    seal.iter_mut().zip(digest.end().to_string().bytes()).for_each(|(to, from)| *to = from);
    seal
}

/// The program: its version, and all of its bytes, since what is built anew from other sources has the same version. None
/// where the system does not tell where it lies.
pub(crate) fn program() -> Option<Key> {
    static PROGRAM: OnceLock<Option<Key>> = OnceLock::new();
    *PROGRAM.get_or_init(|| {
        let file = of_files(&[std::env::current_exe().ok().filter(|file| file.is_file())?])?;
        let mut digest = Digest::default();
        digest.text(env!("CARGO_PKG_VERSION"));
        digest.key(file);
        Some(digest.end())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(of: u32) -> Key {
        let mut digest = Digest::default();
        digest.shown(&of);
        digest.end()
    }

    #[test]
    fn what_was_not_used_for_longest_is_let_go() {
        let shelf = Shelf::in_memory();
        let most = MOST_IN_MEMORY as u32;
        (0..most).for_each(|k| shelf.put(key(k), &Arc::new(k)));
        assert_eq!(shelf.get(key(0)).as_deref(), Some(&0));
        shelf.put(key(most), &Arc::new(most));
        assert_eq!(shelf.get(key(1)), None);
        for k in [0, 2, most] {
            assert_eq!(shelf.get(key(k)).as_deref(), Some(&k));
        }
    }

    #[test]
    fn the_same_key_holds_the_last_result() {
        let shelf = Shelf::in_memory();
        shelf.put(key(1), &Arc::new("old".to_owned()));
        shelf.put(key(1), &Arc::new("new".to_owned()));
        assert_eq!(shelf.get(key(1)).unwrap().as_str(), "new");
    }

    #[test]
    fn what_is_on_the_disk_is_found_by_its_key_alone_and_not_if_a_byte_of_it_is_another() {
        let home = tempfile::tempdir().unwrap();
        let shelf = || Shelf::<Vec<f64>>::within(home.path(), "test");
        let result = vec![1.5, -0.0, f64::NAN];
        let writer = shelf();
        writer.put(key(1), &Arc::new(result.clone()));
        assert_eq!(shelf().get(key(1)), None, "not before it is saved");
        writer.save();
        let read = shelf().get(key(1)).expect("another program of the same bytes finds it");
        let bits = |numbers: &[f64]| numbers.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&read), bits(&result));
        assert_eq!(shelf().get(key(2)), None);
        assert_eq!(Shelf::<Vec<f64>>::within(home.path(), "other").get(key(1)), None);

        let folder = home.path().join(weldpath_files::entries::KEPT);
        let file = folder.join(format!("{}.test", key(1)));
        let bytes = std::fs::read(&file).unwrap();
        for at in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 1;
            std::fs::write(&file, &damaged).unwrap();
            assert_eq!(shelf().get(key(1)), None, "byte {at}");
            std::fs::write(&file, &bytes[..at]).unwrap();
            assert_eq!(shelf().get(key(1)), None, "cut off at {at}");
        }
        std::fs::write(&file, &bytes).unwrap();
        assert!(shelf().get(key(1)).is_some());
        // Under the name of another key it is not that one's.
        std::fs::rename(&file, folder.join(format!("{}.test", key(2)))).unwrap();
        assert_eq!(shelf().get(key(2)), None);
    }

    #[test]
    fn the_program_is_known_by_its_bytes() {
        let program = program().expect("a test knows where it lies");
        assert_ne!(
            program,
            of_files(&[std::env::current_exe().unwrap()]).unwrap(),
            "its version is in it, too"
        );
    }
}
