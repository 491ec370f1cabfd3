//! Records of one fixed size, as binary PLY and PCD mostly hold them: where the coordinates are in them, and how many fit.

use std::path::Path;

use nalgebra::{Point3, Vector3};

use super::Error;
use super::raw::{Positions, Raw};

/// Where x, y and z are in a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Layout {
    /// Bytes per record, at least 1.
    pub stride: usize,
    /// Byte offset of x, y and z in the record.
    pub offsets: [usize; 3],
    /// Bytes per coordinate: 4 or 8.
    pub width: Width,
    /// Byte offsets of a normal in single precision, where there is one.
    pub normal: Option<[usize; 3]>,
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

/// The first `count` records of `data`, which [`check_count`] has seen.
pub(super) fn positions(data: &[u8], layout: Layout, count: usize) -> Positions {
    let mut positions = layout.none();
    append(&mut positions, &data[..count * layout.stride], layout);
    positions
}

/// The normals of whole records, where there are some.
pub(super) fn normals(data: &[u8], layout: Layout) -> impl Iterator<Item = Vector3<f32>> + '_ {
    let of = move |offsets: [usize; 3]| {
        let normal = move |record| Vector3::from(offsets.map(|at| single(record, at)));
        data.chunks_exact(layout.stride).map(normal)
    };
    layout.normal.into_iter().flat_map(of)
}

impl Layout {
    fn none(&self) -> Positions {
        match self.width {
            Width::Single => Positions::Single(Vec::new()),
            Width::Double => Positions::Double(Vec::new()),
        }
    }

    /// No positions yet; `None` where the memory does not hold so many.
    pub(super) fn room_for(&self, count: usize) -> Option<Positions> {
        let mut positions = self.none();
        match &mut positions {
            Positions::Single(points) => points.try_reserve_exact(count).ok()?,
            Positions::Double(points) => points.try_reserve_exact(count).ok()?,
        }
        Some(positions)
    }
}

/// Adds the points of whole records.
pub(super) fn append(to: &mut Positions, data: &[u8], layout: Layout) {
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
        let layout = Layout { stride: 13, offsets: [5, 9, 1], width: Width::Single, normal: None };
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
