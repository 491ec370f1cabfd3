//! PLY: binary little-endian records take the fast path, other binary files go to the library, which reads every header.
//!
//! Rows of ASCII files are read here: the library's grammar has no `nan`, no `.5` and no empty line, and scans have them.
//! A file with faces is a mesh. Which point a normal belongs to is known, which side it faces is not: normals are left.

use std::path::Path;

use nalgebra::{Point3, Vector3};
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType,
};

use super::Error;
use super::memory::Limit;
use super::mesh;
use super::raw::{Positions, Raw};
use super::records::{self, Layout, Records, Width};
use super::units::Unit;

const EXPORT: &str = "Export the cloud again as PLY with x, y and z per vertex";
const CUT_OFF: &str = "The file is cut off or damaged here: copy or export it again";

/// Reads a PLY file.
pub(super) fn parse(bytes: &[u8], path: &Path, limit: Limit) -> Result<Raw, Error> {
    let Begin { header, lines, bytes: begin, points, layout } = Begin::of(bytes, bytes.len(), path)?;
    if layout.is_none() {
        hold_rows(&header, bytes.len(), path, limit)?;
    }
    let data = &bytes[begin..];
    let raw = match layout {
        Some(layout) => {
            let normals = records::normals(&data[..points * layout.stride], layout).collect();
            Raw { normals, ..Raw::from(records::positions(data, layout, points)) }
        }
        None if header.encoding == Encoding::Ascii => {
            from_rows(&ascii_rows(data, lines, &header, path)?, bytes.len(), path, limit)?
        }
        None => from_rows(&binary_rows(data, &header, path)?, bytes.len(), path, limit)?,
    };
    Ok(Raw { unit: stated_unit(&header), ..raw })
}

/// The records of a file of `length` bytes that begins with `head`; `None` where the fast path does not take it.
pub(super) fn records(head: &[u8], length: usize, path: &Path) -> Option<Records> {
    let Begin { header, bytes: begin, points: count, layout, .. } = Begin::of(head, length, path).ok()?;
    let raw = Raw { unit: stated_unit(&header), ..Raw::from(Positions::Single(Vec::new())) };
    Some(Records { layout: layout?, count, begin, raw })
}

/// A header that was held against the size of its file.
struct Begin {
    header: Header,
    /// Its lines and bytes.
    lines: usize,
    bytes: usize,
    /// Vertices.
    points: usize,
    /// For the fast path, which takes clouds of records of one size.
    layout: Option<Layout>,
}

impl Begin {
    fn of(head: &[u8], length: usize, path: &Path) -> Result<Self, Error> {
        let mut reader = Reader::new(head);
        let header = Parser::<Row>::new().read_header(&mut reader).map_err(|e| bad_header(&e, head, path))?;
        let lines = reader.line().saturating_sub(1);
        let bytes = head.len() - reader.into_inner().len();
        check_names(&header, &head[..bytes], path)?;
        check_elements(&header, length - bytes, path)?;
        let vertex = vertex_of(&header, path)?;
        let faces = header.elements.get("face").filter(|face| face.count > 0 && indices_of(face).is_some());
        let layout = fast_layout(&header, vertex).filter(|_| faces.is_none() && !has_camera(&header));
        let points = vertex.count;
        Ok(Self { header, lines, bytes, points, layout })
    }
}

fn vertex_of<'a>(header: &'a Header, path: &Path) -> Result<&'a ElementDef, Error> {
    let missing = |problem: String| Error::malformed(path, "header, element vertex", problem, EXPORT);
    let vertex = header.elements.get("vertex").ok_or_else(|| missing("it is missing".into()))?;
    for axis in ["x", "y", "z"] {
        match vertex.properties.get(axis).map(|p| &p.data_type) {
            Some(PropertyType::Scalar(_)) => {}
            Some(PropertyType::List(..)) => return Err(missing(format!("property {axis} is a list"))),
            None => return Err(missing(format!("property {axis} is missing"))),
        }
    }
    Ok(vertex)
}

/// The library keeps the last of two properties with one name, so records would be read at wrong places.
fn check_names(header: &Header, text: &[u8], path: &Path) -> Result<(), Error> {
    let lines = |word: &[u8]| text.split(|b| *b == b'\n').filter(|line| line.starts_with(word)).count();
    let properties: usize = header.elements.values().map(|element| element.properties.len()).sum();
    if lines(b"property ") == properties && lines(b"element ") == header.elements.len() {
        return Ok(());
    }
    Err(Error::malformed(path, "header", "an element or a property occurs twice", EXPORT))
}

/// Holds the counts of all elements against the bytes after the header.
fn check_elements(header: &Header, available: usize, path: &Path) -> Result<(), Error> {
    let mut left = available;
    for element in header.elements.values() {
        let place = format!("header, element {}", element.name);
        if element.properties.is_empty() && element.count > 0 {
            return Err(Error::malformed(path, place, "it has no properties", EXPORT));
        }
        let row = least_bytes(element, header.encoding);
        // The last line of a text may lack its end.
        let slack = usize::from(header.encoding == Encoding::Ascii);
        records::check_count(element.count as u64, row as u64, left + slack, "rows", place, path)?;
        left = left.saturating_sub(element.count * row);
    }
    Ok(())
}

/// Refuses rows that would take far more than the file: an empty list is one byte there.
fn hold_rows(header: &Header, file_bytes: usize, path: &Path, limit: Limit) -> Result<(), Error> {
    let rows: usize = header.elements.values().take(needed(header)).map(|element| element.count).sum();
    limit.hold(path, file_bytes, "rows", rows as u64, (size_of::<Row>() + size_of::<Point3<f64>>()) as u64)
}

/// Least size of a row: in ASCII a digit and a separator per number, in binary every list empty, but that of a face: with
/// fewer than three corners it is none.
fn least_bytes(element: &ElementDef, encoding: Encoding) -> usize {
    let of = |data_type: &PropertyType| match (encoding, data_type) {
        (Encoding::Ascii, _) => 2,
        (_, PropertyType::Scalar(scalar) | PropertyType::List(scalar, _)) => size(scalar),
    };
    let list =
        indices_of(element).filter(|_| element.name == "face").and_then(|name| element.properties.get(name));
    let corner = match (encoding, list.map(|list| &list.data_type)) {
        (Encoding::Ascii, Some(_)) => 2,
        (_, Some(PropertyType::List(_, content))) => size(content),
        _ => 0,
    };
    element.properties.values().map(|p| of(&p.data_type)).sum::<usize>() + 3 * corner
}

fn size(scalar: &ScalarType) -> usize {
    match scalar {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    }
}

/// The layout of the vertices, if they come first, little-endian, in records of one size, with x, y, z of one width.
fn fast_layout(header: &Header, vertex: &ElementDef) -> Option<Layout> {
    let first = header.elements.values().next()?;
    if header.encoding != Encoding::BinaryLittleEndian || first.name != vertex.name {
        return None;
    }
    let (mut stride, mut fields, mut normal) = (0, [None; 3], [None; 3]);
    for (name, property) in &vertex.properties {
        let PropertyType::Scalar(scalar) = &property.data_type else { return None };
        if let Some(k) = axis(name) {
            fields[k] = Some((stride, width(scalar)?));
        }
        if let (Some(k), ScalarType::Float) = (normal_axis(name), scalar) {
            normal[k] = Some(stride);
        }
        stride += size(scalar);
    }
    let [Some((x, width)), Some((y, y_width)), Some((z, z_width))] = fields else { return None };
    let normal = match normal {
        [Some(x), Some(y), Some(z)] => Some([x, y, z]),
        _ => None,
    };
    (width == y_width && width == z_width).then_some(Layout { stride, offsets: [x, y, z], width, normal })
}

fn width(scalar: &ScalarType) -> Option<Width> {
    match scalar {
        ScalarType::Float => Some(Width::Single),
        ScalarType::Double => Some(Width::Double),
        _ => None,
    }
}

fn axis(name: &str) -> Option<usize> {
    ["x", "y", "z"].iter().position(|axis| *axis == name)
}

fn normal_axis(name: &str) -> Option<usize> {
    ["nx", "ny", "nz"].iter().position(|axis| *axis == name)
}

fn view_axis(name: &str) -> Option<usize> {
    VIEWPOINT.iter().position(|axis| *axis == name)
}

/// Where the camera stood, as PCL writes it.
const VIEWPOINT: [&str; 3] = ["view_px", "view_py", "view_pz"];
const CAMERA: &str = "camera";

fn has_camera(header: &Header) -> bool {
    let camera = header.elements.get(CAMERA).filter(|camera| camera.count > 0);
    camera.is_some_and(|camera| VIEWPOINT.iter().all(|name| camera.properties.contains_key(*name)))
}

const INDICES: [&str; 2] = ["vertex_indices", "vertex_index"];

fn indices_of(face: &ElementDef) -> Option<&str> {
    INDICES.into_iter().find(|name| {
        matches!(face.properties.get(*name).map(|p| &p.data_type), Some(PropertyType::List(_, content))
            if !matches!(content, ScalarType::Float | ScalarType::Double))
    })
}

/// One vertex or one face; what it is follows from the element that it was read for.
#[derive(Debug, Default)]
struct Row {
    xyz: [f64; 3],
    normal: [Option<f64>; 3],
    viewpoint: [f64; 3],
    indices: Vec<u32>,
}

/// The elements that are used; others are read past.
#[derive(Debug, Default)]
struct Rows {
    vertices: Vec<Row>,
    faces: Vec<Row>,
    cameras: Vec<Row>,
}

impl Rows {
    fn put(&mut self, element: &str, rows: Vec<Row>) {
        match element {
            "vertex" => self.vertices = rows,
            "face" => self.faces = rows,
            CAMERA => self.cameras = rows,
            _ => {}
        }
    }
}

impl PropertyAccess for Row {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if let (Some(k), Some(value)) = (axis(name), scalar(&property)) {
            self.xyz[k] = value;
        } else if let Some(k) = normal_axis(name) {
            self.normal[k] = scalar(&property);
        } else if let (Some(k), Some(value)) = (view_axis(name), scalar(&property)) {
            self.viewpoint[k] = value;
        } else if INDICES.contains(&name) {
            match property.to_u32_list() {
                Some(indices) => self.indices = indices,
                None => return PropertyAccessResult::UnsupportedType,
            }
        }
        PropertyAccessResult::Ignored
    }
}

fn scalar(property: &Property) -> Option<f64> {
    match property {
        Property::Char(v) => Some(f64::from(*v)),
        Property::UChar(v) => Some(f64::from(*v)),
        Property::Short(v) => Some(f64::from(*v)),
        Property::UShort(v) => Some(f64::from(*v)),
        Property::Int(v) => Some(f64::from(*v)),
        Property::UInt(v) => Some(f64::from(*v)),
        Property::Float(v) => Some(f64::from(*v)),
        Property::Double(v) => Some(*v),
        _ => None,
    }
}

fn binary_rows(data: &[u8], header: &Header, path: &Path) -> Result<Rows, Error> {
    let parser = Parser::<Row>::new();
    let mut reader = Reader::new(data);
    let mut rows = Rows::default();
    for element in header.elements.values().take(needed(header)) {
        let read = parser
            .read_payload_for_element(&mut reader, element, header)
            .map_err(|e| damaged(&e, &format!("element {}", element.name), path))?;
        rows.put(&element.name, read);
    }
    Ok(rows)
}

/// Number of elements up to the last one that is used: damage after it does no harm.
fn needed(header: &Header) -> usize {
    let used = |name: &String| name == "vertex" || name == "face" || name == CAMERA && has_camera(header);
    header.elements.keys().rposition(used).map_or(0, |last| last + 1)
}

fn ascii_rows(data: &[u8], header_lines: usize, header: &Header, path: &Path) -> Result<Rows, Error> {
    let mut lines = data
        .split(|b| *b == b'\n')
        .enumerate()
        .map(|(i, line)| (header_lines + i + 1, line.trim_ascii()))
        .filter(|(_, line)| !line.is_empty());
    let mut rows = Rows::default();
    for element in header.elements.values().take(needed(header)) {
        let mut read = Vec::with_capacity(element.count);
        for i in 0..element.count {
            let (number, line) = lines.next().ok_or_else(|| {
                let problem = format!("the file ends after {i} of {} rows", element.count);
                Error::malformed(path, format!("element {}", element.name), problem, CUT_OFF)
            })?;
            let row = ascii_row(line, element)
                .map_err(|problem| Error::malformed(path, format!("line {number}"), problem, EXPORT))?;
            read.push(row);
        }
        rows.put(&element.name, read);
    }
    Ok(rows)
}

fn ascii_row(line: &[u8], element: &ElementDef) -> Result<Row, String> {
    let line = std::str::from_utf8(line).map_err(|_| "the line is not text".to_string())?;
    let mut words = line.split_ascii_whitespace();
    let mut row = Row::default();
    for (name, property) in &element.properties {
        let word = words.next().ok_or_else(|| format!("{name} is missing"))?;
        match &property.data_type {
            PropertyType::Scalar(_) => {
                if let Some(k) = axis(name) {
                    row.xyz[k] = word.parse().map_err(|_| format!("{name} is {word:?}, not a number"))?;
                } else if let Some(k) = normal_axis(name) {
                    row.normal[k] = word.parse().ok();
                } else if let Some(k) = view_axis(name) {
                    row.viewpoint[k] =
                        word.parse().map_err(|_| format!("{name} is {word:?}, not a number"))?;
                }
            }
            PropertyType::List(..) => {
                let count: usize = word.parse().map_err(|_| format!("the length of {name} is {word:?}"))?;
                for i in 0..count {
                    let word = words.next().ok_or_else(|| format!("{name} has {i} of {count} entries"))?;
                    if INDICES.contains(&name.as_str()) {
                        row.indices.push(word.parse().map_err(|_| format!("{name} holds {word:?}"))?);
                    }
                }
            }
        }
    }
    Ok(row)
}

fn from_rows(rows: &Rows, file_bytes: usize, path: &Path, limit: Limit) -> Result<Raw, Error> {
    let corners: usize = rows.faces.iter().map(|face| face.indices.len()).sum();
    limit.hold(path, file_bytes, "corners of faces", corners as u64, size_of::<[usize; 3]>() as u64)?;
    let vertices: Vec<_> = rows.vertices.iter().map(|row| Point3::from(row.xyz)).collect();
    let mut triangles = Vec::new();
    for (i, face) in rows.faces.iter().enumerate() {
        let corners = face.indices.iter().map(|index| *index as usize);
        mesh::add_fan(corners, vertices.len(), &mut triangles).map_err(|problem| {
            Error::malformed(path, format!("face {i}"), problem, "Export the mesh again")
        })?;
    }
    let mut raw = Raw::from(Positions::Double(vertices));
    let normal = |row: &Row| Some(Vector3::new(row.normal[0]?, row.normal[1]?, row.normal[2]?).cast());
    raw.normals = rows.vertices.iter().map(normal).collect::<Option<_>>().unwrap_or_default();
    raw.triangles = triangles;
    raw.names_camera = !rows.cameras.is_empty();
    raw.viewpoint = rows.cameras.first().map(|camera| Vector3::from(camera.viewpoint));
    Ok(raw)
}

/// A comment such as `length unit = meters`.
fn stated_unit(header: &Header) -> Option<Unit> {
    header.comments.iter().chain(&header.obj_infos).find_map(|comment| {
        let comment = comment.to_ascii_lowercase();
        let words = || comment.split(|c: char| !c.is_ascii_alphanumeric());
        words().any(|word| word == "unit" || word == "units").then(|| words().find_map(Unit::named)).flatten()
    })
}

/// What is wrong with a header, in words of the format, and whether bytes are missing.
fn bad_header(error: &ParseError, head: &[u8], path: &Path) -> Error {
    let lines: Vec<&[u8]> = head.split(|b| *b == b'\n').map(<[u8]>::trim_ascii).collect();
    let ends = |line: &&[u8]| *line == b"end_header";
    let text = |line: &[u8]| String::from_utf8_lossy(&line[..line.len().min(LONGEST_QUOTE)]).into_owned();
    let Some(number) = error.line().filter(|number| (1..=lines.len()).contains(number)) else {
        let problem = "the file ends within its header";
        return Error::malformed(path, "header", problem, CUT_OFF);
    };
    let line = lines[number - 1];
    let place = format!("header, line {number}");
    let is_last = number == lines.len() || lines[number..].iter().all(|line| line.is_empty());
    if is_last && !lines.iter().any(ends) && !line.starts_with(b"end") {
        return Error::malformed(path, place, "the file ends within its header", CUT_OFF);
    }
    let expected = match line.split(u8::is_ascii_whitespace).next().unwrap_or_default() {
        b"end" | b"endheader" => "end_header",
        b"format" => "format with ascii, binary_little_endian or binary_big_endian, and 1.0",
        b"element" => "element with a name and a count",
        b"property" => "property with a type and a name, or property list with two types and a name",
        _ => "format, element, property, comment, obj_info or end_header",
    };
    Error::malformed(path, place, format!("it is {:?} where {expected} is expected", text(line)), HEADER)
}

const HEADER: &str = "Put the line right in the file, or export it again as PLY with x, y and z per vertex";
/// Bytes of a wrong line that are shown.
const LONGEST_QUOTE: usize = 60;

fn damaged(error: &ParseError, place: &str, path: &Path) -> Error {
    let place = error.line().map_or_else(|| place.to_string(), |line| format!("{place}, line {line}"));
    Error::malformed(path, place, error.to_string().replace(['\n', '\t'], " "), CUT_OFF)
}

#[cfg(test)]
mod tests {
    use super::*;

    const POINTS: [[f32; 3]; 3] = [[0.5, -1.25, 300.0], [f32::NAN, 2.0, 3.0], [1e-3, 0.0, -7.0]];

    fn header(format: &str, properties: &str, count: usize) -> Vec<u8> {
        format!("ply\nformat {format} 1.0\nelement vertex {count}\n{properties}\nend_header\n").into_bytes()
    }

    fn read(bytes: &[u8]) -> Vec<[f64; 3]> {
        let raw = parse(bytes, Path::new("a.ply"), Limit::default()).unwrap();
        (0..raw.positions.len()).map(|i| raw.positions.at(i).into()).collect()
    }

    fn same(read: &[[f64; 3]]) {
        let bits = |points: &[[f64; 3]]| points.iter().flatten().map(|c| c.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(read), bits(&POINTS.map(|p| p.map(f64::from))));
    }

    #[test]
    fn every_encoding_gives_the_same_points() {
        let xyz = "property float x\nproperty uchar red\nproperty float y\nproperty float z";
        let with_list = &format!("{xyz}\nproperty list uchar int tags");
        let mut little = header("binary_little_endian", xyz, 3);
        let mut big = header("binary_big_endian", xyz, 3);
        let mut list = header("binary_little_endian", with_list, 3);
        let mut ascii = header("ascii", xyz, 3);
        for [x, y, z] in POINTS {
            let row = |f: fn(f32) -> [u8; 4]| [&f(x)[..], &[200], &f(y)[..], &f(z)[..]].concat();
            little.extend(row(f32::to_le_bytes));
            big.extend(row(f32::to_be_bytes));
            list.extend([row(f32::to_le_bytes), vec![1, 7, 0, 0, 0]].concat());
            ascii.extend(format!("{x} 200 {y} {z}\r\n\n").bytes());
        }
        for bytes in [&little, &big, &list] {
            same(&read(bytes));
        }
        let close = read(&ascii);
        assert_eq!(close[0], [0.5, -1.25, 300.0]);
        assert!(close[1][0].is_nan() && close[2] == [1e-3, 0.0, -7.0]);
    }

    #[test]
    fn the_fast_path_agrees_with_the_library() {
        for (kind, offsets) in [("float", [4usize, 8, 0]), ("double", [8, 16, 0])] {
            let properties =
                format!("property {kind} z\nproperty {kind} x\nproperty {kind} y\nproperty short i");
            let mut bytes = header("binary_little_endian", &properties, 3);
            let data = bytes.len();
            for [x, y, z] in POINTS {
                for c in [z, x, y] {
                    match kind {
                        "float" => bytes.extend(c.to_le_bytes()),
                        _ => bytes.extend(f64::from(c).to_le_bytes()),
                    }
                }
                bytes.extend([1, 2]);
            }
            let header = Parser::<Row>::new().read_header(&mut Reader::new(&bytes[..])).unwrap();
            let layout = fast_layout(&header, &header.elements["vertex"]).unwrap();
            assert_eq!(layout.offsets, offsets);
            same(&read(&bytes));
            let rows = binary_rows(&bytes[data..], &header, Path::new("a.ply")).unwrap();
            same(&rows.vertices.iter().map(|row| row.xyz).collect::<Vec<_>>());
        }
    }

    #[test]
    fn faces_make_a_mesh_and_a_comment_states_the_unit() {
        let text = "ply\nformat ascii 1.0\ncomment made by X, length unit = meters\nelement vertex 4\n\
                    property float x\nproperty float y\nproperty float z\nelement face 1\n\
                    property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n.0 1. 0\n4 0 1 2 3\n";
        let raw = parse(text.as_bytes(), Path::new("a.ply"), Limit::default()).unwrap();
        assert_eq!((raw.triangles, raw.unit), (vec![[0, 1, 2], [0, 2, 3]], Some(Unit::Metre)));
        let wrong = text.replace("4 0 1 2 3", "4 0 1 2 4");
        let error = parse(wrong.as_bytes(), Path::new("a.ply"), Limit::default()).unwrap_err().to_string();
        assert!(error.contains("face 0") && error.contains("vertex 4 of 4"), "{error}");
    }

    #[test]
    fn errors_name_the_place() {
        let xyz = "property float x\nproperty float y\nproperty float z";
        let refused = |bytes: Vec<u8>, place: &str| {
            let error = parse(&bytes, Path::new("a.ply"), Limit::default()).unwrap_err().to_string();
            assert!(error.contains("a.ply") && error.contains(place), "{error}");
        };
        refused([header("ascii", xyz, 2), b"1 2 3\n1 two 3\n".to_vec()].concat(), "line 9");
        refused([header("ascii", xyz, 2), b"1 2 3\n         ".to_vec()].concat(), "after 1 of 2");
        refused([header("binary_little_endian", xyz, 4_000_000_000), vec![0; 24]].concat(), "4000000000");
        refused(header("ascii", "property float x", 0), "property y is missing");
        refused(b"ply\nformat ascii 1.0\nelement face 0\nend_header\n".to_vec(), "vertex");
        refused(header("ascii", &format!("{xyz}\nproperty double x"), 0), "twice");
        refused(b"ply\nnonsense\n".to_vec(), "line 2");
    }
}
