//! PCD: ascii, binary, binary_compressed, any field order, padding fields. The library reads the header and every
//! variant but plain binary, which takes the fast path.

use std::io::BufRead;
use std::path::Path;

use nalgebra::{Point3, Vector3};
use pcd_rs::Reader;
use pcd_rs::metas::{DataKind, PcdMeta, Schema, ValueKind};
use pcd_rs::record::PcdDeserialize;

use super::Error;
use super::memory::Limit;
use super::raw::{Positions, Raw};
use super::records::{self, Layout, Records, Width};

/// LZF writes at most 264 bytes for 3: nothing grows by more.
const LZF_GROWTH: u64 = 88;

/// Reads a PCD file.
pub(super) fn parse(bytes: &[u8], path: &Path, limit: Limit) -> Result<Raw, Error> {
    let mut data = bytes;
    let meta = PcdMeta::from_reader(&mut data).map_err(|e| bad_header(&e, path))?;
    let columns = Columns::of(&meta.field_defs, path)?;
    let count = check_size(&meta, &columns, data, path)?;
    let (positions, normals) = match (meta.data, columns.layout) {
        _ if count == 0 => (Positions::Single(Vec::new()), Vec::new()),
        (DataKind::Binary, Some(layout)) => {
            let normals = records::normals(&data[..count * layout.stride], layout).collect();
            (records::positions(data, layout, count), normals)
        }
        _ => by_library(bytes, bytes.len() - data.len(), &columns, count, path, limit)?,
    };
    Ok(Raw { normals, ..described(positions, &meta, path)? })
}

/// The records of a file of `length` bytes that begins with `head`; `None` where the fast path does not take it.
pub(super) fn records(head: &[u8], length: usize, path: &Path) -> Option<Records> {
    let mut data = head;
    let meta = PcdMeta::from_reader(&mut data).ok().filter(|meta| meta.data == DataKind::Binary)?;
    let begin = head.len() - data.len();
    let columns = Columns::of(&meta.field_defs, path).ok()?;
    let count = check_binary(&meta, &columns, length - begin, path).ok()?;
    let raw = described(Positions::Single(Vec::new()), &meta, path).ok()?;
    Some(Records { layout: columns.layout?, count, begin, raw })
}

/// The points and what else the header tells.
fn described(positions: Positions, meta: &PcdMeta, path: &Path) -> Result<Raw, Error> {
    let mut raw = Raw { viewpoint: viewpoint(meta, path)?, ..Raw::from(positions) };
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
        let (mut found, mut normal) = ([None; 3], [None; 3]);
        let (mut numbers, mut record) = (0u64, 0u64);
        for field in schema {
            if let Some(axis) = axis(&field.name) {
                found[axis] = Some((record as usize, field.kind, field.count));
            }
            if let (Some(axis), ValueKind::F32, 1) = (normal_axis(&field.name), field.kind, field.count) {
                normal[axis] = Some(record as usize);
            }
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
        if [x, y, z].iter().any(|field| field.2 != 1) {
            return Err(Error::malformed(path, "COUNT", "x, y and z need a count of 1 each", EXPORT));
        }
        let kinds = [x.1, y.1, z.1];
        let width = match kinds {
            [ValueKind::F32, ValueKind::F32, ValueKind::F32] => Some(Width::Single),
            [ValueKind::F64, ValueKind::F64, ValueKind::F64] => Some(Width::Double),
            _ => None,
        };
        let normal = match normal {
            [Some(x), Some(y), Some(z)] => Some([x, y, z]),
            _ => None,
        };
        let offsets = [x.0, y.0, z.0];
        let layout = width.map(|width| Layout { stride: record as usize, offsets, width, normal });
        let double = width != Some(Width::Single);
        Ok(Self { numbers, record, double, layout })
    }
}

const EXPORT: &str = "Export the cloud again with the fields x y z";

/// Holds every count of the header against the bytes after it.
fn check_size(meta: &PcdMeta, columns: &Columns, data: &[u8], path: &Path) -> Result<usize, Error> {
    let claimed = meta.num_points;
    match meta.data {
        DataKind::Binary => check_binary(meta, columns, data.len(), path),
        // A digit and a separator for each number; the last line may lack its separator.
        DataKind::Ascii => records::check_count(
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

fn check_binary(meta: &PcdMeta, columns: &Columns, available: usize, path: &Path) -> Result<usize, Error> {
    records::check_count(meta.num_points, columns.record, available, "points", "POINTS", path)
}

/// The two sizes before the compressed block, which the library trusts.
fn check_compressed(claimed: u64, record: u64, data: &[u8], path: &Path) -> Result<usize, Error> {
    let place = "the sizes before the compressed data";
    let Some((sizes, block)) = data.split_first_chunk::<8>() else {
        return match claimed {
            0 => Ok(0),
            _ => records::check_count(claimed, record, 0, "points", "POINTS", path),
        };
    };
    let [a, b, c, d, e, f, g, h] = *sizes;
    let compressed = u64::from(u32::from_le_bytes([a, b, c, d]));
    let unpacked = u64::from(u32::from_le_bytes([e, f, g, h]));
    records::check_count(compressed, 1, block.len(), "compressed bytes", place, path)?;
    records::check_count(unpacked, 1, (compressed * LZF_GROWTH) as usize, "unpacked bytes", place, path)?;
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

/// A point in double and in single precision.
const POINT_BYTES: u64 = 24 + 12;

/// Every variant that is not plain binary of floats.
fn by_library(
    bytes: &[u8],
    header: usize,
    columns: &Columns,
    count: usize,
    path: &Path,
    limit: Limit,
) -> Result<(Positions, Vec<Vector3<f32>>), Error> {
    let header_lines = bytes[..header].iter().filter(|b| **b == b'\n').count();
    let place = |i: usize| format!("point {i} (line {} if ascii)", header_lines + i + 1);
    let bad = |i: usize, problem: String| Error::malformed(path, place(i), problem, CUT_OFF);
    let reader = Reader::<Xyz, _>::from_reader(bytes).map_err(|e| bad(0, e.to_string()))?;
    limit.hold(path, bytes.len(), "points", count as u64, columns.record + POINT_BYTES)?;
    let mut points = Vec::with_capacity(count);
    let mut normals = Vec::new();
    for (i, record) in reader.enumerate() {
        let Xyz(xyz, normal) = record.map_err(|e| bad(i, e.to_string()))?;
        points.push(Point3::from(xyz));
        normals.extend(normal.map(|n| Vector3::from(n).cast::<f32>()));
    }
    let positions = match columns.double {
        true => Positions::Double(points),
        false => Positions::Single(points.iter().map(|p| p.cast::<f32>()).collect()),
    };
    Ok((positions, normals))
}

const CUT_OFF: &str = "The file is cut off or damaged here: copy or export it again";

/// A record of which x, y and z are kept. The library's own dynamic record allocates for every field of every point.
struct Xyz([f64; 3], Option<[f64; 3]>);

impl PcdDeserialize for Xyz {
    /// The order of the fields is looked up as they are read.
    fn is_dynamic() -> bool {
        true
    }

    /// Not asked of a dynamic record.
    fn read_spec() -> Vec<(Option<String>, ValueKind, Option<usize>)> {
        Vec::new()
    }

    fn read_chunk<R: BufRead>(reader: &mut R, fields: &Schema) -> pcd_rs::Result<Self> {
        let (mut xyz, mut normal) = ([0.0; 3], [None; 3]);
        for field in fields {
            for _ in 0..field.count {
                let mut bytes = [0; 8];
                reader.read_exact(&mut bytes[..field.kind.byte_size()])?;
                if let Some(axis) = axis(&field.name) {
                    xyz[axis] = number(field.kind, bytes);
                } else if let Some(axis) = normal_axis(&field.name) {
                    normal[axis] = Some(number(field.kind, bytes));
                }
            }
        }
        Ok(Self(xyz, whole(normal)))
    }

    fn read_line<R: BufRead>(reader: &mut R, fields: &Schema) -> pcd_rs::Result<Self> {
        let mut line = String::with_capacity(96);
        reader.read_line(&mut line)?;
        let wrong = |desc: String| pcd_rs::error::Error::InvalidArgumentError { desc };
        let mut words = line.split_ascii_whitespace();
        let (mut xyz, mut normal) = ([0.0; 3], [None; 3]);
        for field in fields {
            for _ in 0..field.count {
                let word = words.next().ok_or_else(|| wrong(format!("{} is missing", field.name)))?;
                if let Some(axis) = axis(&field.name) {
                    xyz[axis] = word.parse().map_err(|_| wrong(format!("{} is {word:?}", field.name)))?;
                } else if let Some(axis) = normal_axis(&field.name) {
                    normal[axis] = word.parse().ok();
                }
            }
        }
        match words.next() {
            Some(word) => Err(wrong(format!("{word:?} is more than FIELDS and COUNT say"))),
            None => Ok(Self(xyz, whole(normal))),
        }
    }
}

fn normal_axis(name: &str) -> Option<usize> {
    ["normal_x", "normal_y", "normal_z"].iter().position(|axis| name.eq_ignore_ascii_case(axis))
}

/// A normal of which all three components are there.
fn whole([x, y, z]: [Option<f64>; 3]) -> Option<[f64; 3]> {
    Some([x?, y?, z?])
}

fn axis(name: &str) -> Option<usize> {
    ["x", "y", "z"].iter().position(|axis| name.eq_ignore_ascii_case(axis))
}

/// A little-endian value, followed by zeros up to eight bytes.
fn number(kind: ValueKind, bytes: [u8; 8]) -> f64 {
    let [a, b, c, d, ..] = bytes;
    match kind {
        ValueKind::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
        ValueKind::F64 => f64::from_le_bytes(bytes),
        ValueKind::I8 => f64::from(i8::from_le_bytes([a])),
        ValueKind::I16 => f64::from(i16::from_le_bytes([a, b])),
        ValueKind::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
        ValueKind::I64 => i64::from_le_bytes(bytes) as f64,
        ValueKind::U8 | ValueKind::U16 | ValueKind::U32 | ValueKind::U64 => u64::from_le_bytes(bytes) as f64,
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

#[cfg(test)]
mod tests {
    use super::*;

    /// y, 3 bytes of padding, z, x: in an order that no default has.
    const POINTS: [[f32; 3]; 3] = [[0.5, -1.25, 300.0], [f32::NAN, 2.0, 3.0], [1e-3, 0.0, -7.0]];

    fn header(data: &str, points: usize) -> Vec<u8> {
        format!(
            "# .PCD v.7\nVERSION .7\nFIELDS y _ z x\nSIZE 4 1 4 4\nTYPE F U F F\nCOUNT 1 3 1 1\nWIDTH 1\n\
             HEIGHT {points}\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA {data}\n"
        )
        .into_bytes()
    }

    fn binary() -> Vec<u8> {
        let rows = POINTS.iter().flat_map(|[x, y, z]| {
            [&y.to_le_bytes()[..], &[9, 9, 9], &z.to_le_bytes(), &x.to_le_bytes()].concat()
        });
        header("binary", 3).into_iter().chain(rows).collect()
    }

    /// Column by column, in runs of literals.
    fn compressed() -> Vec<u8> {
        let column = |k: usize| POINTS.iter().flat_map(move |p| p[k].to_le_bytes());
        let columns: Vec<u8> = column(1).chain([9; 9]).chain(column(2)).chain(column(0)).collect();
        let packed: Vec<u8> = columns.chunks(32).flat_map(|c| [&[c.len() as u8 - 1], c].concat()).collect();
        let sizes = [(packed.len() as u32).to_le_bytes(), (columns.len() as u32).to_le_bytes()].concat();
        [header("binary_compressed", 3), sizes, packed].concat()
    }

    fn ascii() -> Vec<u8> {
        let rows = POINTS.iter().flat_map(|[x, y, z]| format!("{y} 9 9 9 {z} {x}\n").into_bytes());
        header("ascii", 3).into_iter().chain(rows).collect()
    }

    fn same(positions: &Positions) {
        let Positions::Single(points) = positions else { panic!("the file is in single precision") };
        let bits = |p: [f32; 3]| p.map(f32::to_bits);
        let read: Vec<_> = points.iter().map(|p| bits([p.x, p.y, p.z])).collect();
        assert_eq!(read, POINTS.map(bits));
    }

    #[test]
    fn every_encoding_gives_the_same_points() {
        for bytes in [binary(), compressed(), ascii()] {
            same(&parse(&bytes, Path::new("a.pcd"), Limit::default()).unwrap().positions);
        }
    }

    #[test]
    fn the_fast_path_agrees_with_the_library() {
        let bytes = binary();
        let meta = PcdMeta::from_reader(&bytes[..]).unwrap();
        let columns = Columns::of(&meta.field_defs, Path::new("a.pcd")).unwrap();
        assert!(columns.layout.is_some());
        same(&by_library(&bytes, 0, &columns, 3, Path::new("a.pcd"), Limit::default()).unwrap().0);
    }

    #[test]
    fn normals_are_read_in_any_order_of_the_fields_and_encoding() {
        let header = |data: &str| {
            format!(
                "VERSION .7\nFIELDS normal_x normal_y normal_z x y z\nSIZE 4 4 4 4 4 4\nTYPE F F F F F F\nWIDTH 2\nHEIGHT 1\n\
                 POINTS 2\nDATA {data}\n"
            )
        };
        let rows = [[0.0f32, 0.6, -0.8, 1.0, 2.0, 3.0], [1.0, 0.0, 0.0, 4.0, 5.0, 6.0]];
        let words = rows.map(|row| row.map(|n| n.to_string()).join(" ")).join("\n");
        let bytes: Vec<u8> = rows.iter().flatten().flat_map(|n| n.to_le_bytes()).collect();
        for file in [
            format!("{}{words}\n", header("ascii")).into_bytes(),
            [header("binary").into_bytes(), bytes].concat(),
        ] {
            let raw = parse(&file, Path::new("a.pcd"), Limit::default()).unwrap();
            assert_eq!(raw.normals, [Vector3::new(0.0, 0.6, -0.8), Vector3::x()]);
            assert_eq!(raw.positions.at(1), Vector3::new(4.0, 5.0, 6.0));
        }
    }

    #[test]
    fn double_precision_and_integers_keep_their_digits() {
        let text = "VERSION .7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\n\
                    1000000.0625 2 3\n";
        let raw = parse(text.as_bytes(), Path::new("a.pcd"), Limit::default()).unwrap();
        assert_eq!(raw.positions.at(0).x, 1_000_000.062_5);
        let whole = text.replace("TYPE F F F", "TYPE I I I").replace(".0625", "");
        assert_eq!(
            parse(whole.as_bytes(), Path::new("a.pcd"), Limit::default()).unwrap().positions.at(0).x,
            1e6
        );
    }

    #[test]
    fn errors_name_the_place() {
        let refused = |bytes: &[u8], place: &str| {
            let error = parse(bytes, Path::new("a.pcd"), Limit::default()).unwrap_err().to_string();
            assert!(error.contains("a.pcd") && error.contains(place), "{error}");
        };
        let text = String::from_utf8(ascii()).unwrap();
        refused(text.replace("-7", "minus").as_bytes(), "line 14");
        refused(text.replace("POINTS 3", "POINTS 4000000000").as_bytes(), "4000000000 points");
        refused(text.replace("FIELDS y _ z x", "FIELDS y _ z u").as_bytes(), "FIELDS");
        refused(text.replace("1 3 1 1", "1 3 1 2").as_bytes(), "COUNT");
        refused(text.replace("1 3 1 1", "1 9999999999999999999 1 1").as_bytes(), "COUNT");
        refused(text.replace("0 0 0 1", "0 0 0 nan").as_bytes(), "VIEWPOINT");
        refused(text.replace("SIZE 4 1", "SIZE 4 x").as_bytes(), "header");
        let bytes = binary();
        refused(&bytes[..bytes.len() - 1], "3 points are claimed");
        let mut bytes = compressed();
        let sizes = bytes.len() - 45 - 2 - 8;
        bytes[sizes + 4] += 1;
        refused(&bytes, "do not make 46");
        bytes[sizes + 7] = 0xff;
        refused(&bytes, "unpacked bytes are claimed");
    }
}
