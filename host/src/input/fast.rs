//! The fast path: little-endian records of one fixed size, as binary PLY and PCD mostly are.
//!
//! The bytes become points piece by piece, as they are read: no work per field that is not x, y or z, and nothing as
//! large as the file is held beside its points. The headers are read by the library crates; every other variant of the
//! two formats goes to them as a whole. A test holds both to the same points.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use nalgebra::Point3;

use super::Error;
use super::format::{self, Reader};
use super::raw::{Positions, Raw};

/// Bytes in which a header is expected to end.
const HEAD: usize = 1 << 14;
/// Bytes that are read at a time: few enough to stay in the caches until they are points.
const PIECE: usize = 1 << 17;

/// Where x, y and z are in a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Layout {
    /// Bytes per record, at least 1.
    pub stride: usize,
    /// Byte offset of x, y and z in the record.
    pub offsets: [usize; 3],
    /// Bytes per coordinate: 4 or 8.
    pub width: Width,
}

/// Precision of a coordinate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Width {
    Single,
    Double,
}

/// Refuses a count that the bytes after the header cannot hold, before anything is allocated for it.
/// `place` is the field of the header, `record` the least number of bytes for one.
pub(super) fn check_count(
    claimed: u64,
    record: u64,
    available: usize,
    what: &'static str,
    place: impl Into<String>,
    path: &Path,
) -> Result<usize, Error> {
    let available = available as u64;
    let possible = available / record.max(1);
    match usize::try_from(claimed) {
        Ok(count) if claimed <= possible => Ok(count),
        _ => Err(Error::Oversized {
            path: path.into(),
            place: place.into(),
            what,
            claimed,
            available,
            possible,
        }),
    }
}

/// Where the records of a file begin, how many there are, and what else the header tells.
pub(super) struct Records {
    pub layout: Layout,
    pub count: usize,
    /// Bytes before the first of them.
    pub begin: usize,
    /// Still without points.
    pub raw: Raw,
}

/// Reads a file of such records; `None` for any other, and where something is amiss: [`super::parse`] tells what.
pub(super) fn read(path: &Path) -> Option<Raw> {
    // Before it is opened: a pipe would make us wait.
    let length = std::fs::metadata(path).ok().filter(|m| m.is_file())?.len().try_into().ok()?;
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
    // Records longer than a piece are nobody's.
    (most > 0).then_some(())?;
    let mut piece = vec![0; most.min(count) * layout.stride];
    for first in (0..count).step_by(most) {
        let piece = &mut piece[..most.min(count - first) * layout.stride];
        file.read_exact(piece).ok()?;
        append(&mut raw.positions, piece, layout);
    }
    Some(raw)
}

/// The first `count` records of `data`, which [`check_count`] has seen.
pub(super) fn positions(data: &[u8], layout: Layout, count: usize) -> Positions {
    let mut positions = layout.none();
    append(&mut positions, &data[..count * layout.stride], layout);
    positions
}

impl Layout {
    fn none(&self) -> Positions {
        match self.width {
            Width::Single => Positions::Single(Vec::new()),
            Width::Double => Positions::Double(Vec::new()),
        }
    }

    /// No positions yet; `None` where the memory does not hold so many.
    fn room_for(&self, count: usize) -> Option<Positions> {
        let mut positions = self.none();
        match &mut positions {
            Positions::Single(points) => points.try_reserve_exact(count).ok()?,
            Positions::Double(points) => points.try_reserve_exact(count).ok()?,
        }
        Some(positions)
    }
}

/// Adds the points of whole records.
fn append(to: &mut Positions, data: &[u8], layout: Layout) {
    let records = data.chunks_exact(layout.stride);
    let [x, y, z] = layout.offsets;
    match to {
        Positions::Single(points) if y == x + 4 && z == y + 4 => {
            points.extend(records.map(|r| three_singles(&r[x..x + 12])));
        }
        Positions::Single(points) => {
            points.extend(records.map(|r| Point3::new(single(r, x), single(r, y), single(r, z))));
        }
        Positions::Double(points) => {
            points.extend(records.map(|r| Point3::new(double(r, x), double(r, y), double(r, z))));
        }
    }
}

#[inline]
fn three_singles(bytes: &[u8]) -> Point3<f32> {
    Point3::new(single(bytes, 0), single(bytes, 4), single(bytes, 8))
}

#[inline]
fn single(record: &[u8], at: usize) -> f32 {
    let mut bytes = [0; 4];
    bytes.copy_from_slice(&record[at..at + 4]);
    f32::from_le_bytes(bytes)
}

#[inline]
fn double(record: &[u8], at: usize) -> f64 {
    let mut bytes = [0; 8];
    bytes.copy_from_slice(&record[at..at + 8]);
    f64::from_le_bytes(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_found_at_their_offsets_in_any_order() {
        let mut record = vec![9u8];
        for v in [3.0f32, 1.0, 2.0] {
            record.extend(v.to_le_bytes());
        }
        let layout = Layout { stride: 13, offsets: [5, 9, 1], width: Width::Single };
        let two = [record.clone(), record].concat();
        let point = Point3::new(1.0, 2.0, 3.0);
        assert_eq!(positions(&two, layout, 2), Positions::Single(vec![point, point]));
    }

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
            let (file, memory) =
                (read(&path).unwrap(), super::super::parse(bytes.clone(), format, &path).unwrap());
            assert_eq!((file.positions.len(), &file.positions), (points, &memory.positions));
            assert_eq!((file.viewpoint, file.notes), (memory.viewpoint, memory.notes));
            std::fs::write(&path, &bytes[..header.len() + records.len() - 1]).unwrap();
            assert!(read(&path).is_none());
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
            assert!(read(&path).is_none());
            // One byte less, and the line ends within the head.
            std::fs::write(&path, &text[1..]).unwrap();
            assert_eq!(read(&path).is_some(), rest == "\n");
        }
    }

    #[test]
    fn a_count_beyond_the_file_is_refused_with_both_numbers() {
        let error = check_count(4_000_000_000, 12, 1000, "points", "POINTS", Path::new("a.pcd")).unwrap_err();
        let text = error.to_string();
        assert!(text.contains("4000000000") && text.contains("83") && text.contains("a.pcd"), "{text}");
    }
}
