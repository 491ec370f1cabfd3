//! The fast path: little-endian records of one fixed size, as binary PLY and PCD mostly are.
//!
//! The bytes become points piece by piece, as they are read: no work per field that is not x, y or z, and nothing as
//! large as the file is held beside its points. The headers are read by the library crates; every other variant of the
//! two formats goes to them as a whole. A test holds both to the same points.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use super::format::{self, Reader};
use super::memory::Limit;
use super::raw::Raw;
use super::records::{Records, append, normals};

/// Bytes in which a header is expected to end.
const HEAD: usize = 1 << 14;
/// Bytes that are read at a time: few enough to stay in the caches until they are points.
const PIECE: usize = 1 << 17;

/// Reads a file of such records; `None` for any other, and where something is amiss: [`super::parse`] tells what.
pub(super) fn read(path: &Path, limit: Limit) -> Option<Raw> {
    // Asked before it is opened: opening a pipe would block.
    let length: usize = std::fs::metadata(path).ok().filter(|m| m.is_file())?.len().try_into().ok()?;
    limit.hold_file(path, length as u64).ok()?;
    let mut file = File::open(path).ok()?;
    let mut head = vec![0; HEAD.min(length)];
    file.read_exact(&mut head).ok()?;
    let Reader::Points { records: Some(records), .. } = format::of(&head, path)?.reader else { return None };
    let Records { layout, count, begin, mut raw } = records(&head, length, path)?;
    // A line that the head cuts off may go on: `DATA binary` as `DATA binary_compressed`.
    head[..begin].ends_with(b"\n").then_some(())?;
    file.seek(SeekFrom::Start(begin as u64)).ok()?;
    raw.positions = layout.room_for(count)?;
    let most = PIECE / layout.stride;
    // No format has records longer than a piece.
    (most > 0).then_some(())?;
    let mut piece = vec![0; most.min(count) * layout.stride];
    for first in (0..count).step_by(most) {
        let piece = &mut piece[..most.min(count - first) * layout.stride];
        file.read_exact(piece).ok()?;
        append(&mut raw.positions, piece, layout);
        raw.normals.extend(normals(piece, layout));
    }
    Some(raw)
}

#[cfg(all(test, feature = "pcd"))]
mod tests {
    use super::*;

    #[test]
    fn a_file_gives_the_points_that_its_bytes_give_and_a_short_one_is_left_to_its_reader() {
        let folder = tempfile::tempdir().unwrap();
        let points = 3 * PIECE / 15 + 7;
        let record =
            |i: usize| [&[1, 2, 3][..], &[i as f32, -0.5, 2e-3].map(f32::to_le_bytes).concat()].concat();
        let records: Vec<u8> = (0..points).flat_map(record).collect();
        let property = |name: &str| format!("property {name}\n");
        let fields =
            ["uchar r", "uchar g", "uchar b", "float x", "float y", "float z"].map(property).concat();
        let ply =
            format!("ply\nformat binary_little_endian 1.0\nelement vertex {points}\n{fields}end_header\n");
        let pcd = format!(
            "VERSION .7\nFIELDS _ x y z\nSIZE 1 4 4 4\nTYPE U F F F\nCOUNT 3 1 1 1\nWIDTH {points}\nHEIGHT 1\n\
             VIEWPOINT 1 2 3 1 0 0 0\nPOINTS {points}\nDATA binary\n"
        );
        for (name, header) in [("a.ply", ply), ("a.pcd", pcd)] {
            let path = folder.path().join(name);
            let bytes = [header.as_bytes(), &records, b"beyond"].concat();
            std::fs::write(&path, &bytes).unwrap();
            let format = format::of(&bytes, &path).unwrap();
            let (file, memory) = (
                read(&path, Limit::default()).unwrap(),
                super::super::parse(bytes.clone(), format, &path, Limit::default()).unwrap(),
            );
            assert_eq!((file.positions.len(), &file.positions), (points, &memory.positions));
            assert_eq!((file.viewpoint, file.notes), (memory.viewpoint, memory.notes));
            std::fs::write(&path, &bytes[..header.len() + records.len() - 1]).unwrap();
            assert!(read(&path, Limit::default()).is_none());
        }
    }

    #[test]
    fn a_header_that_goes_on_beyond_the_head_is_left_to_its_reader() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.pcd");
        let fields = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nHEIGHT 1\nPOINTS 1\n";
        let last = "DATA binary";
        let comment = "#".repeat(HEAD - fields.len() - last.len() - 1);
        for rest in ["_compressed\n", "\n"] {
            let text = format!("{comment}\n{fields}{last}{rest}{}", "0".repeat(20));
            // Its head alone could be taken for plain binary.
            assert!(super::super::pcd::records(&text.as_bytes()[..HEAD], text.len(), &path).is_some());
            std::fs::write(&path, &text).unwrap();
            assert!(read(&path, Limit::default()).is_none());
            // One byte less, and the line ends within the head.
            std::fs::write(&path, &text[1..]).unwrap();
            assert_eq!(read(&path, Limit::default()).is_some(), rest == "\n");
        }
    }
}
