//! What the stages of a plan found, kept under [`Key`]s of all that they hang on: for the next plan that is given the same.
//!
//! Nothing is kept by a list of what may change. A key is made of the whole of what a stage is given, as the stage takes it,
//! and of the program itself; so what is kept is either what the stage would find again, or is not found.

pub(crate) mod content;
mod key;

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

pub(crate) use key::Digest;
pub use key::Key;

use content::of_files;

/// Results that are kept of each stage in memory, the last used ones: the two sides of an edit and of its undoing, with
/// something beside. One of a plan takes some 20 MB.
const MOST_IN_MEMORY: usize = 4;

/// Results of one stage.
#[derive(Debug)]
pub struct Shelf<T> {
    /// The last used one behind.
    recent: Mutex<Vec<(Key, Arc<T>)>>,
}

impl<T> Default for Shelf<T> {
    fn default() -> Self {
        Self { recent: Mutex::default() }
    }
}

impl<T> Shelf<T> {
    /// What was found from the same.
    pub fn get(&self, key: Key) -> Option<Arc<T>> {
        // A list that a thread left when it died is whole: each change of it is one call.
        let mut recent = self.recent.lock().unwrap_or_else(PoisonError::into_inner);
        let at = recent.iter().position(|(own, _)| *own == key)?;
        let kept = recent.remove(at);
        let result = Arc::clone(&kept.1);
        recent.push(kept);
        Some(result)
    }

    /// Keeps what was found, and lets go of what was not used for longest.
    pub fn put(&self, key: Key, result: &Arc<T>) {
        let mut recent = self.recent.lock().unwrap_or_else(PoisonError::into_inner);
        recent.retain(|(own, _)| *own != key);
        recent.push((key, Arc::clone(result)));
        let many = recent.len().saturating_sub(MOST_IN_MEMORY);
        recent.drain(..many);
    }
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
        let shelf = Shelf::default();
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
        let shelf = Shelf::default();
        shelf.put(key(1), &Arc::new("old"));
        shelf.put(key(1), &Arc::new("new"));
        assert_eq!(shelf.get(key(1)).as_deref(), Some(&"new"));
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
