//! NumPy's `.npy`: points in rows (N x 3 and more columns), or an image of points (H x W x 3).
//!
//! Three columns after x, y, z that are unit vectors are normals; others, such as colours, are left.

use std::path::Path;

use nalgebra::{Point3, Vector3};

use super::memory::Limit;
use super::raw::{Positions, Raw};
use super::{Error, records};

pub(super) const MARK: &[u8] = b"\x93NUMPY";
const HELP: &str =
    "Save the points as numpy.save(\"cloud.npy\", points), an array N x 3 or H x W x 3 of numbers";

/// Reads an array of points.
pub(super) fn parse(bytes: &[u8], path: &Path, limit: Limit) -> Result<Raw, Error> {
    let array = Array::of(bytes, path, limit)?;
    let (points, columns) = array.shape_of_points().map_err(|problem| bad(path, problem))?;
    let value = |k: usize| array.number(k);
    let at = |point: usize, column: usize| match array.fortran {
        false => value(point * columns + column),
        true => value(array.in_columns(point) + column * points),
    };
    let point = |i: usize| Point3::new(at(i, 0), at(i, 1), at(i, 2));
    let mut raw = Raw::from(Positions::Double((0..points).map(point).collect()));
    if columns >= 6 {
        let normal = |i: usize| Vector3::new(at(i, 3), at(i, 4), at(i, 5)).cast::<f32>();
        let normals: Vec<Vector3<f32>> = (0..points).map(normal).collect();
        let is_unit = |n: &&Vector3<f32>| (n.norm() - 1.0).abs() < 0.01;
        if points > 0 && normals.iter().filter(is_unit).count() * 100 >= points * 95 {
            raw.normals = normals;
        }
    }
    raw.notes.push(format!("x, y, z are columns 1, 2, 3 of {columns} of a NumPy array"));
    Ok(raw)
}

fn bad(path: &Path, problem: impl Into<String>) -> Error {
    Error::malformed(path, "header of the array", problem, HELP)
}

/// The numbers of a file and how they lie there.
struct Array<'a> {
    data: &'a [u8],
    kind: Kind,
    big_endian: bool,
    fortran: bool,
    shape: Vec<usize>,
}

#[derive(Clone, Copy)]
enum Kind {
    Float(usize),
    Signed(usize),
    Unsigned(usize),
}

impl Kind {
    fn bytes(self) -> usize {
        match self {
            Self::Float(bytes) | Self::Signed(bytes) | Self::Unsigned(bytes) => bytes,
        }
    }
}

impl<'a> Array<'a> {
    fn of(bytes: &'a [u8], path: &Path, limit: Limit) -> Result<Self, Error> {
        let short = || bad(path, "the file ends within it");
        let version = *bytes.get(6).ok_or_else(short)?;
        let (length, begin) = match version {
            1 => (
                usize::from(u16::from_le_bytes(
                    *bytes.get(8..10).and_then(|b| b.first_chunk()).ok_or_else(short)?,
                )),
                10,
            ),
            2 | 3 => (
                u32::from_le_bytes(*bytes.get(8..12).and_then(|b| b.first_chunk()).ok_or_else(short)?)
                    as usize,
                12,
            ),
            other => return Err(bad(path, format!("version {other} of the format is not known"))),
        };
        let end = length.checked_add(begin).filter(|end| *end <= bytes.len()).ok_or_else(short)?;
        let header = std::str::from_utf8(&bytes[begin..end]).map_err(|_| bad(path, "it is no text"))?;
        let after = |key: &str| header.split_once(key).map(|(_, rest)| rest.trim_start_matches([' ', ':']));
        let missing = |key: &str| bad(path, format!("{key} is missing"));
        let descr = after("'descr'").ok_or_else(|| missing("descr"))?;
        let descr = descr.strip_prefix('\'').and_then(|d| d.split_once('\'')).map(|(d, _)| d);
        let descr = descr.ok_or_else(|| bad(path, "its elements are records, not numbers"))?;
        let fortran = after("'fortran_order'").ok_or_else(|| missing("fortran_order"))?.starts_with("True");
        let shape = after("'shape'")
            .and_then(|s| s.strip_prefix('(')?.split_once(')'))
            .ok_or_else(|| missing("shape"))?
            .0;
        let sizes = shape.split(',').map(str::trim).filter(|size| !size.is_empty());
        let shape: Vec<usize> = sizes
            .map(str::parse)
            .collect::<Result<_, _>>()
            .map_err(|_| bad(path, format!("its shape is ({shape})")))?;
        let (order, kind) = descr.split_at_checked(1).unwrap_or(("", descr));
        let kind = match kind {
            "f4" => Kind::Float(4),
            "f8" => Kind::Float(8),
            "i2" => Kind::Signed(2),
            "i4" => Kind::Signed(4),
            "i8" => Kind::Signed(8),
            "u1" => Kind::Unsigned(1),
            "u2" => Kind::Unsigned(2),
            "u4" => Kind::Unsigned(4),
            _ => {
                return Err(bad(
                    path,
                    format!("its elements are of the type {descr:?}, not f4, f8 or whole numbers"),
                ));
            }
        };
        let elements = shape.iter().try_fold(1u64, |all, size| all.checked_mul(*size as u64));
        let elements = elements.ok_or_else(|| bad(path, "its shape is too large for any file"))?;
        let data = &bytes[end..];
        records::check_count(elements, kind.bytes() as u64, data.len(), "numbers", "shape", path)?;
        limit.hold(path, bytes.len(), "numbers", elements, 8)?;
        Ok(Self { data, kind, big_endian: order == ">", fortran, shape })
    }

    /// Points, and numbers of each.
    fn shape_of_points(&self) -> Result<(usize, usize), String> {
        match *self.shape {
            [points, columns] if (3..=16).contains(&columns) => Ok((points, columns)),
            [rows, columns, numbers] if (3..=16).contains(&numbers) => Ok((rows * columns, numbers)),
            [rows, columns] => Err(format!(
                "it is {rows} x {columns}: that may be a depth image, which is read as a 16-bit PNG with its camera"
            )),
            _ => Err(format!("its shape is {:?}, not N x 3 or H x W x 3", self.shape)),
        }
    }

    /// In an array that lies column by column, where the first number of a point is.
    fn in_columns(&self, point: usize) -> usize {
        match *self.shape {
            [rows, columns, _] => point / columns + point % columns * rows,
            _ => point,
        }
    }

    fn number(&self, k: usize) -> f64 {
        let bytes = self.kind.bytes();
        let mut eight = [0u8; 8];
        let own = &self.data[k * bytes..(k + 1) * bytes];
        eight[..bytes].copy_from_slice(own);
        if self.big_endian {
            eight[..bytes].reverse();
        }
        let whole = u64::from_le_bytes(eight);
        match self.kind {
            Kind::Float(4) => f64::from(f32::from_bits(whole as u32)),
            Kind::Float(_) => f64::from_bits(whole),
            Kind::Signed(bytes) => {
                let unused = 64 - 8 * bytes as u32;
                ((whole << unused) as i64 >> unused) as f64
            }
            Kind::Unsigned(_) => whole as f64,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn npy(descr: &str, fortran: bool, shape: &str, data: &[u8]) -> Vec<u8> {
        let order = if fortran { "True" } else { "False" };
        let header = format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': ({shape}), }}");
        let padded = format!("{header:<117}\n");
        [MARK, &[1, 0], &(padded.len() as u16).to_le_bytes(), padded.as_bytes(), data].concat()
    }

    fn read(bytes: &[u8]) -> Result<Raw, Error> {
        parse(bytes, Path::new("a.npy"), Limit::default())
    }

    fn points(bytes: &[u8]) -> Vec<[f64; 3]> {
        let raw = read(bytes).unwrap();
        (0..raw.positions.len()).map(|i| raw.positions.at(i).into()).collect()
    }

    #[test]
    fn rows_and_images_in_either_order_give_the_same_points() {
        let rows = [1.0f64, 2.0, 3.0, -4.0, 5.0, 6.5];
        let little: Vec<u8> = rows.iter().flat_map(|v| v.to_le_bytes()).collect();
        let single: Vec<u8> = rows.iter().flat_map(|v| (*v as f32).to_be_bytes()).collect();
        let columns: Vec<u8> =
            [0, 3, 1, 4, 2, 5].iter().flat_map(|k| rows[*k as usize].to_le_bytes()).collect();
        let want = [[1.0, 2.0, 3.0], [-4.0, 5.0, 6.5]];
        assert_eq!(points(&npy("<f8", false, "2, 3", &little)), want);
        assert_eq!(points(&npy(">f4", false, "2, 3", &single)), want);
        assert_eq!(points(&npy("<f8", true, "2, 3", &columns)), want);
        assert_eq!(points(&npy("<f8", false, "1, 2, 3", &little)), want);
        assert_eq!(points(&npy("<f8", true, "1, 2, 3", &columns)), want);
        let whole: Vec<u8> = [1i16, -2, 3].iter().flat_map(|v| v.to_le_bytes()).collect();
        assert_eq!(points(&npy("<i2", false, "1, 3", &whole)), [[1.0, -2.0, 3.0]]);
    }

    #[test]
    fn three_more_columns_are_normals_where_they_are_of_length_one() {
        let bytes = |row: [f64; 6]| row.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
        let with = |row| read(&npy("<f8", false, "1, 6", &bytes(row))).unwrap().normals;
        assert_eq!(with([1.0, 2.0, 3.0, 0.0, 0.6, 0.8]), [Vector3::new(0.0, 0.6, 0.8)]);
        assert!(with([1.0, 2.0, 3.0, 255.0, 255.0, 0.0]).is_empty());
    }

    #[test]
    fn what_is_no_cloud_is_refused_with_its_shape() {
        for (bytes, part) in [
            (npy("<u2", false, "480, 640", &[]), "numbers"),
            (npy("<u2", false, "2, 2", &[0; 8]), "depth image"),
            (npy("<f8", false, "4000000000, 3", &[0; 24]), "12000000000"),
            (npy("<f8", false, "99999999999, 99999999999, 3", &[0; 24]), "too large"),
            (npy("|O", false, "1, 3", &[0; 24]), "|O"),
            (npy("\u{796}8", false, "1, 3", &[0; 24]), "\u{796}8"),
            (npy("", false, "1, 3", &[0; 24]), "of the type"),
            (MARK.to_vec(), "ends within"),
        ] {
            let error = read(&bytes).unwrap_err().to_string();
            assert!(error.contains("a.npy") && error.contains(part), "{error}");
        }
    }
}
