//! The fast path: little-endian records of one fixed size, as binary PLY and PCD mostly are.
//!
//! One pass over the bytes, one allocation, no work per field that is not x, y or z. The headers are read by the
//! library crates; every other variant of the two formats goes to them as a whole. A test holds both to the same points.

use std::path::Path;

use nalgebra::Point3;
use rayon::prelude::*;

use super::Error;
use super::raw::Positions;

/// Records that a thread takes at a time.
const SHARE: usize = 1 << 16;

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

/// The first `count` records of `data`, which [`check_count`] has seen.
pub(super) fn positions(data: &[u8], layout: Layout, count: usize) -> Positions {
    let records = data.par_chunks_exact(layout.stride).take(count).with_min_len(SHARE);
    let [x, y, z] = layout.offsets;
    let in_a_row = |width: usize| y == x + width && z == y + width;
    match layout.width {
        Width::Single if in_a_row(4) => {
            Positions::Single(records.map(|r| three_singles(&r[x..x + 12])).collect())
        }
        Width::Single => Positions::Single(
            records.map(|r| Point3::new(single(r, x), single(r, y), single(r, z))).collect(),
        ),
        Width::Double => Positions::Double(
            records.map(|r| Point3::new(double(r, x), double(r, y), double(r, z))).collect(),
        ),
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
    fn a_count_beyond_the_file_is_refused_with_both_numbers() {
        let error = check_count(4_000_000_000, 12, 1000, "points", "POINTS", Path::new("a.pcd")).unwrap_err();
        let text = error.to_string();
        assert!(text.contains("4000000000") && text.contains("83") && text.contains("a.pcd"), "{text}");
    }
}
