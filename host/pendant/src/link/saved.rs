//! What a later host needs to go on with a path: kept beside the plan before anything moves.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::Former;

/// Name of the file.
pub const FILE: &str = "stream.session.json";

/// A session and its path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Saved {
    nonce: u32,
    path: u16,
    digest: u32,
}

/// Where it is kept for a program: in its folder.
pub fn place(program: &Path) -> PathBuf {
    let folder = if program.is_dir() { program } else { program.parent().unwrap_or(Path::new("")) };
    folder.join(FILE)
}

/// Keeps it, whole or not at all.
pub fn keep(place: &Path, former: &Former) -> io::Result<()> {
    let Former { nonce, path, digest } = *former;
    let text = serde_json::to_string_pretty(&Saved { nonce, path, digest })?;
    let beside = place.with_extension("new");
    fs::write(&beside, text + "\n")?;
    fs::rename(beside, place)
}

/// As it was kept.
pub fn read(place: &Path) -> io::Result<Former> {
    let Saved { nonce, path, digest } = serde_json::from_str(&fs::read_to_string(place)?)?;
    Ok(Former { nonce, path, digest })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_session_is_read_as_it_was_kept() {
        let folder = tempfile::tempdir().unwrap();
        let place = place(&folder.path().join("path.json"));
        assert_eq!(place, folder.path().join(FILE));
        let former = Former { nonce: 0xCAFE_F00D, path: 1, digest: 7 };
        keep(&place, &former).unwrap();
        assert_eq!(read(&place).unwrap(), former);
        assert!(read(&folder.path().join("none")).is_err());
    }
}
