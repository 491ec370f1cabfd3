//! VTK's legacy format: the POINTS of any data set, text or big-endian, and the POLYGONS of one that has some.

use std::path::Path;

use nalgebra::Point3;

use super::memory::Limit;
use super::raw::{Positions, Raw};
use super::{Error, mesh, records};

pub(super) const MARK: &[u8] = b"# vtk DataFile Version";
const HELP: &str =
    "Save it again as a legacy VTK file, or as PLY or PCD, for instance with ParaView or CloudCompare";

/// Reads the points, and the polygons where there are any.
pub(super) fn parse(bytes: &[u8], path: &Path, limit: Limit) -> Result<Raw, Error> {
    let mut file = Cursor { rest: bytes, lines: 0, bytes: bytes.len(), path, limit };
    let mut ascii = None;
    let mut points: Option<Vec<Point3<f64>>> = None;
    let mut polygons: Option<Vec<[usize; 3]>> = None;
    while let Some(line) = file.line() {
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match *words {
            ["ASCII"] => ascii = Some(true),
            ["BINARY"] => ascii = Some(false),
            ["POINTS", number, kind] => {
                let none = || file.bad("neither ASCII nor BINARY is stated before it".into());
                let ascii = ascii.ok_or_else(none)?;
                points = Some(file.points(number, kind, ascii)?);
            }
            ["POLYGONS", number, size] if points.is_some() => {
                let corners = points.as_ref().map_or(0, Vec::len);
                polygons = Some(file.polygons([number, size], ascii.unwrap_or(true), corners)?);
            }
            _ => {}
        }
        if points.is_some() && polygons.is_some() {
            break;
        }
    }
    let points = points.ok_or_else(|| Error::malformed(path, "data set", "it has no POINTS", HELP))?;
    match polygons {
        Some(triangles) if !triangles.is_empty() => mesh::from_triangles(points, triangles, path),
        _ => Ok(Raw::from(Positions::Double(points))),
    }
}

/// Triangles of polygons, each of which is its number of corners and these.
fn fans(mut numbers: &[usize], polygons: u64, corners: usize) -> Result<Vec<[usize; 3]>, String> {
    let mut triangles = Vec::new();
    for k in 0..polygons {
        let short = || format!("polygon {k} has too few numbers");
        let (&own, rest) = numbers.split_first().ok_or_else(short)?;
        let (polygon, rest) = rest.split_at_checked(own).ok_or_else(short)?;
        if let Some(wrong) = polygon.iter().find(|corner| **corner >= corners) {
            return Err(format!("polygon {k} refers to point {wrong} of {corners}"));
        }
        triangles.extend(polygon.windows(2).skip(1).map(|two| [polygon[0], two[0], two[1]]));
        numbers = rest;
    }
    Ok(triangles)
}

/// What is left to read.
struct Cursor<'a> {
    rest: &'a [u8],
    lines: usize,
    /// Of the whole file.
    bytes: usize,
    path: &'a Path,
    limit: Limit,
}

impl<'a> Cursor<'a> {
    fn place(&self) -> String {
        format!("line {}", self.lines)
    }

    fn bad(&self, problem: String) -> Error {
        Error::malformed(self.path, self.place(), problem, HELP)
    }

    /// A number of things, of which the rest of the file has room for as many, each of at least so many bytes.
    fn count(&self, word: &str, least: u64, ascii: bool, what: &'static str) -> Result<usize, Error> {
        let claimed = word.parse::<u64>().map_err(|_| self.bad(format!("{word:?} is no count")))?;
        let room = self.rest.len() + usize::from(ascii);
        records::check_count(claimed, least, room, what, self.place(), self.path)
    }

    fn points(&mut self, number: &str, kind: &str, ascii: bool) -> Result<Vec<Point3<f64>>, Error> {
        let width = match kind {
            "float" => 4,
            "double" => 8,
            _ => return Err(self.bad(format!("points are of the type {kind:?}, not float or double"))),
        };
        let number = self.count(number, if ascii { 6 } else { 3 * width as u64 }, ascii, "points")?;
        self.limit.hold(self.path, self.bytes, "points", number as u64, 24)?;
        let mut next = || self.number(ascii, width);
        let read: Option<_> = (0..number).map(|_| Some(Point3::new(next()?, next()?, next()?))).collect();
        read.ok_or_else(|| self.bad("a coordinate is missing or no number".into()))
    }

    /// Their triangles.
    fn polygons(
        &mut self,
        [number, size]: [&str; 2],
        ascii: bool,
        corners: usize,
    ) -> Result<Vec<[usize; 3]>, Error> {
        let number = number.parse().map_err(|_| self.bad(format!("{number:?} is no count")))?;
        let size = self.count(size, if ascii { 2 } else { 4 }, ascii, "numbers")?;
        self.limit.hold(
            self.path,
            self.bytes,
            "corners of faces",
            size as u64,
            size_of::<[usize; 3]>() as u64,
        )?;
        let numbers: Option<Vec<usize>> = (0..size).map(|_| self.whole(ascii)).collect();
        let numbers = numbers.ok_or_else(|| self.bad("an index is missing or no number".into()))?;
        fans(&numbers, number, corners).map_err(|problem| self.bad(problem))
    }

    /// The next line, in whatever code; a keyword stands alone on one.
    fn line(&mut self) -> Option<std::borrow::Cow<'a, str>> {
        if self.rest.is_empty() {
            return None;
        }
        let end = self.rest.iter().position(|b| *b == b'\n').map_or(self.rest.len(), |at| at + 1);
        let (line, rest) = self.rest.split_at(end);
        self.rest = rest;
        self.lines += 1;
        Some(String::from_utf8_lossy(line))
    }

    fn number(&mut self, ascii: bool, width: usize) -> Option<f64> {
        if ascii {
            return self.word()?.parse().ok();
        }
        let (own, rest) = self.rest.split_at_checked(width)?;
        self.rest = rest;
        match width {
            4 => own.first_chunk().map(|bytes| f64::from(f32::from_be_bytes(*bytes))),
            _ => own.first_chunk().map(|bytes| f64::from_be_bytes(*bytes)),
        }
    }

    fn whole(&mut self, ascii: bool) -> Option<usize> {
        if ascii {
            return self.word()?.parse().ok();
        }
        let (own, rest) = self.rest.split_first_chunk()?;
        self.rest = rest;
        usize::try_from(i32::from_be_bytes(*own)).ok()
    }

    /// The next word; lines are counted as they are passed.
    fn word(&mut self) -> Option<&'a str> {
        let begin = self.rest.iter().position(|b| !b.is_ascii_whitespace())?;
        self.lines += self.rest[..begin].iter().filter(|b| **b == b'\n').count();
        let rest = &self.rest[begin..];
        let end = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        self.rest = &rest[end..];
        std::str::from_utf8(&rest[..end]).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(kind: &str, data: &[u8]) -> Vec<u8> {
        let head =
            format!("# vtk DataFile Version 3.0\nmade by hand\n{kind}\nDATASET POLYDATA\nPOINTS 3 float\n");
        [head.as_bytes(), data].concat()
    }

    fn read(bytes: &[u8]) -> Result<Raw, Error> {
        parse(bytes, Path::new("a.vtk"), Limit::default())
    }

    #[test]
    fn text_and_binary_give_the_same_points_and_faces() {
        let xyz = [0.5f32, 1.0, 2.0, -3.0, 4.0, 5.0, 6.0, 7.0, 8.0];
        let binary: Vec<u8> = xyz.iter().flat_map(|v| v.to_be_bytes()).collect();
        let faces: Vec<u8> = [3i32, 0, 1, 2].iter().flat_map(|v| v.to_be_bytes()).collect();
        let text = b"0.5 1 2 -3 4 5\n6 7 8\n";
        let plain = [read(&file("ASCII", text)).unwrap(), read(&file("BINARY", &binary)).unwrap()];
        assert_eq!(plain[0].positions, plain[1].positions);
        assert!(
            plain[0].positions.at(2) == nalgebra::Vector3::new(6.0, 7.0, 8.0)
                && plain[0].triangles.is_empty()
        );
        for bytes in [
            file("ASCII", &[text, &b"\nPOLYGONS 1 4\n3 0 1 2\n"[..]].concat()),
            file("BINARY", &[&binary[..], b"\nPOLYGONS 1 4\n", &faces].concat()),
        ] {
            assert_eq!(read(&bytes).unwrap().triangles, [[0, 1, 2]]);
        }
    }

    #[test]
    fn errors_name_the_line() {
        for (bytes, part) in [
            (file("ASCII", b"0.5 1 two"), "line 5"),
            (file("BINARY", &[0; 4]), "3 points are claimed"),
            (b"# vtk DataFile Version 3.0\n\nASCII\n".to_vec(), "no POINTS"),
            (file("ASCII", b"0 0 0 1 0 0 1 1 0\nPOLYGONS 1 4\n3 0 1 9\n"), "point 9 of 3"),
            (file("ASCII", b"0 0 0 1 0 0 1 1 0\nPOLYGONS 2 4\n3 0 1 2\n"), "too few"),
        ] {
            let error = read(&bytes).unwrap_err().to_string();
            assert!(error.contains("a.vtk") && error.contains(part), "{error}");
        }
    }
}
