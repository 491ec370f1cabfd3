//! PCD: ascii, binary, binary_compressed, any field order, padding fields. The library reads the header and every
//! variant but plain binary, which takes the fast path.

use std::path::Path;

use nalgebra::{Point3, Vector3};
use pcd_rs::DynReader;
use pcd_rs::metas::{DataKind, PcdMeta, Schema, ValueKind};
use pcd_rs::record::{DynRecord, Field};

use super::Error;
use super::fast::{self, Layout, Width};
use super::raw::{Positions, Raw};

/// LZF writes at most 264 bytes for 3: nothing grows by more.
const LZF_GROWTH: u64 = 88;

/// Reads a PCD file.
pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<Raw, Error> {
    let mut data = bytes;
    let meta = PcdMeta::from_reader(&mut data).map_err(|e| bad_header(&e, path))?;
    let columns = Columns::of(&meta.field_defs, path)?;
    let count = check_size(&meta, &columns, data, path)?;
    let positions = match (meta.data, columns.layout) {
        _ if count == 0 => Positions::Single(Vec::new()),
        (DataKind::Binary, Some(layout)) => fast::positions(data, layout, count),
        _ => by_library(bytes, bytes.len() - data.len(), &columns, count, path)?,
    };
    let mut raw = Raw::from(positions);
    raw.viewpoint = viewpoint(&meta, path)?;
    if meta.width.checked_mul(meta.height) != Some(meta.num_points) {
        raw.notes.push(format!(
            "POINTS {} differs from WIDTH {} x HEIGHT {}; POINTS is used",
            meta.num_points, meta.width, meta.height
        ));
    }
    Ok(raw)
}

/// Where x, y and z are.
struct Columns {
    /// Index among the fields that are not padding.
    index: [usize; 3],
    /// Numbers per record, padding included.
    numbers: u64,
    /// Bytes per record in binary.
    record: u64,
    double: bool,
    /// For the fast path, if x, y and z are floating-point numbers of one width.
    layout: Option<Layout>,
}

impl Columns {
    fn of(schema: &Schema, path: &Path) -> Result<Self, Error> {
        let mut found = [None; 3];
        let (mut index, mut numbers, mut record) = (0, 0u64, 0u64);
        for field in schema {
            if let Some(axis) = ["x", "y", "z"].iter().position(|name| field.name.eq_ignore_ascii_case(name))
            {
                found[axis] = Some((index, record as usize, field.kind, field.count));
            }
            index += usize::from(!field.is_padding());
            let too_long = || Error::malformed(path, "COUNT", "the record is too long", EXPORT);
            numbers = numbers.checked_add(field.count).ok_or_else(too_long)?;
            let bytes = field.count.checked_mul(field.kind.byte_size() as u64).ok_or_else(too_long)?;
            record = record.checked_add(bytes).filter(|r| u32::try_from(*r).is_ok()).ok_or_else(too_long)?;
        }
        let [Some(x), Some(y), Some(z)] = found else {
            let names: Vec<&str> = schema.iter().map(|field| field.name.as_str()).collect();
            return Err(Error::malformed(
                path,
                "FIELDS",
                format!("x, y, z are not all in {names:?}"),
                EXPORT,
            ));
        };
        if [x, y, z].iter().any(|field| field.3 != 1) {
            return Err(Error::malformed(path, "COUNT", "x, y and z need a count of 1 each", EXPORT));
        }
        let kinds = [x.2, y.2, z.2];
        let width = match kinds {
            [ValueKind::F32, ValueKind::F32, ValueKind::F32] => Some(Width::Single),
            [ValueKind::F64, ValueKind::F64, ValueKind::F64] => Some(Width::Double),
            _ => None,
        };
        let layout = width.map(|width| Layout { stride: record as usize, offsets: [x.1, y.1, z.1], width });
        let double = width != Some(Width::Single);
        Ok(Self { index: [x.0, y.0, z.0], numbers, record, double, layout })
    }
}

const EXPORT: &str = "Export the cloud again with the fields x y z";

/// Holds every count of the header against the bytes after it.
fn check_size(meta: &PcdMeta, columns: &Columns, data: &[u8], path: &Path) -> Result<usize, Error> {
    let claimed = meta.num_points;
    match meta.data {
        DataKind::Binary => fast::check_count(claimed, columns.record, data.len(), "points", "POINTS", path),
        // A digit and a separator for each number; the last line may lack its separator.
        DataKind::Ascii => fast::check_count(
            claimed,
            columns.numbers.saturating_mul(2),
            data.len() + 1,
            "points",
            "POINTS",
            path,
        ),
        DataKind::BinaryCompressed => check_compressed(claimed, columns.record, data, path),
    }
}

/// The two sizes before the compressed block, which the library trusts.
fn check_compressed(claimed: u64, record: u64, data: &[u8], path: &Path) -> Result<usize, Error> {
    let place = "the sizes before the compressed data";
    let Some((sizes, block)) = data.split_first_chunk::<8>() else {
        return match claimed {
            0 => Ok(0),
            _ => fast::check_count(claimed, record, 0, "points", "POINTS", path),
        };
    };
    let [a, b, c, d, e, f, g, h] = *sizes;
    let compressed = u64::from(u32::from_le_bytes([a, b, c, d]));
    let unpacked = u64::from(u32::from_le_bytes([e, f, g, h]));
    fast::check_count(compressed, 1, block.len(), "compressed bytes", place, path)?;
    fast::check_count(unpacked, 1, (compressed * LZF_GROWTH) as usize, "unpacked bytes", place, path)?;
    if claimed.checked_mul(record) != Some(unpacked) {
        return Err(Error::malformed(
            path,
            place,
            format!("{claimed} points of {record} bytes do not make {unpacked} unpacked bytes"),
            "Export the cloud again",
        ));
    }
    Ok(claimed as usize)
}

/// Every variant that is not plain binary of floats.
fn by_library(
    bytes: &[u8],
    header: usize,
    columns: &Columns,
    count: usize,
    path: &Path,
) -> Result<Positions, Error> {
    let header_lines = bytes[..header].iter().filter(|b| **b == b'\n').count();
    let place = |i: usize| format!("point {i} (line {} if ascii)", header_lines + i + 1);
    let bad = |i: usize, problem: String| Error::malformed(path, place(i), problem, CUT_OFF);
    let reader = DynReader::from_bytes(bytes).map_err(|e| bad(0, e.to_string()))?;
    let mut points = Vec::with_capacity(count);
    for (i, record) in reader.enumerate() {
        let record = record.map_err(|e| bad(i, e.to_string()))?;
        points.push(xyz(&record, columns).ok_or_else(|| bad(i, "x, y or z is missing".into()))?);
    }
    Ok(match columns.double {
        true => Positions::Double(points),
        false => Positions::Single(points.iter().map(|p| p.cast::<f32>()).collect()),
    })
}

const CUT_OFF: &str = "The file is cut off or damaged here: copy or export it again";

fn xyz(record: &DynRecord, columns: &Columns) -> Option<Point3<f64>> {
    let [x, y, z] = columns.index.map(|i| record.0.get(i).and_then(number));
    Some(Point3::new(x?, y?, z?))
}

fn number(field: &Field) -> Option<f64> {
    match field {
        Field::I8(v) => v.first().map(|v| f64::from(*v)),
        Field::I16(v) => v.first().map(|v| f64::from(*v)),
        Field::I32(v) => v.first().map(|v| f64::from(*v)),
        Field::I64(v) => v.first().map(|v| *v as f64),
        Field::U8(v) => v.first().map(|v| f64::from(*v)),
        Field::U16(v) => v.first().map(|v| f64::from(*v)),
        Field::U32(v) => v.first().map(|v| f64::from(*v)),
        Field::U64(v) => v.first().map(|v| *v as f64),
        Field::F32(v) => v.first().map(|v| f64::from(*v)),
        Field::F64(v) => v.first().copied(),
    }
}

/// Where the camera stood, if the header says more than the default.
fn viewpoint(meta: &PcdMeta, path: &Path) -> Result<Option<Vector3<f64>>, Error> {
    let v = &meta.viewpoint;
    let rotation = [v.qw, v.qx, v.qy, v.qz];
    let at = Vector3::new(v.tx, v.ty, v.tz);
    if rotation.iter().chain(at.iter()).any(|c| !c.is_finite()) {
        let help = "Write VIEWPOINT 0 0 0 1 0 0 0 if the camera's place is unknown";
        return Err(Error::malformed(path, "VIEWPOINT", "a number is not finite", help));
    }
    Ok((rotation != [1.0, 0.0, 0.0, 0.0] || at != Vector3::zeros()).then_some(at))
}

fn bad_header(error: &pcd_rs::error::Error, path: &Path) -> Error {
    let (place, problem) = match error {
        pcd_rs::error::Error::ParseError { line, desc } => (format!("header, line {line}"), desc.clone()),
        other => ("header".into(), other.to_string()),
    };
    Error::malformed(path, place, problem, "Export the cloud again as PCD 0.7 or as PLY")
}
