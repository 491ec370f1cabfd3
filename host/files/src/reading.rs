//! Reads files that people write by hand or that weldpath wrote: never more of them than such a file can be.

use std::fs;
use std::io::{self, Read};
use std::path::Path;

/// The most that a job file may be, bytes.
pub const MOST_JOB: u64 = 1 << 20;
/// The most that a program, a truth, a saved model or a page may be, bytes.
pub const MOST_RESULT: u64 = 1 << 30;

/// The bytes of a file or a pipe, at most `most` of them.
///
/// # Errors
/// What the system says, or that there are more.
pub fn bytes(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    fs::File::open(path)?.take(most + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most {
        return Err(io::Error::other(format!("it is larger than {} MB, which no such file is", most >> 20)));
    }
    Ok(bytes)
}

/// Bytes of a file that are handed over at a time.
const PIECE_BYTES: usize = 1 << 17;

/// Hands the bytes of a regular file over, piece by piece; whether it is there.
///
/// # Errors
/// What the system says, or that it is no regular file: a pipe would block, and could not be read again.
pub fn pieces(path: &Path, mut take: impl FnMut(&[u8])) -> io::Result<bool> {
    // Asked before it is opened: opening a pipe would block.
    match fs::metadata(path) {
        Ok(there) if there.is_file() => {}
        Ok(_) => return Err(io::ErrorKind::InvalidInput.into()),
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(false),
        Err(error) => return Err(error),
    }
    let mut file = fs::File::open(path)?;
    let mut piece = vec![0; PIECE_BYTES];
    loop {
        match file.read(&mut piece) {
            Ok(0) => return Ok(true),
            Ok(read) => take(&piece[..read]),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
}

/// The text of a file or a pipe, at most `most` bytes of it.
///
/// # Errors
/// As [`bytes`], or that it is no text.
pub fn text(path: &Path, most: u64) -> io::Result<String> {
    String::from_utf8(bytes(path, most)?).map_err(|error| {
        io::Error::other(format!("byte {} is no text (UTF-8)", error.utf8_error().valid_up_to()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_endless_file_is_refused_and_a_small_one_is_read() {
        let endless = text(Path::new("/dev/zero"), MOST_JOB);
        assert!(endless.is_err_and(
            |e| e.to_string().contains("larger than 1 MB") || e.kind() == io::ErrorKind::NotFound
        ));
        let home = tempfile::tempdir().unwrap();
        let file = home.path().join("a");
        fs::write(&file, "abc").unwrap();
        assert_eq!(text(&file, 3).unwrap(), "abc");
        assert!(text(&file, 2).is_err());
        fs::write(&file, b"ab\xff").unwrap();
        assert!(text(&file, 9).unwrap_err().to_string().contains("byte 2 is no text"));
    }
}
