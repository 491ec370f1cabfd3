//! STL, binary and ASCII, through the library; what it takes for granted is checked here first.
//!
//! A binary header that begins with `solid`, an ASCII file with several solids and a solid without a name all occur.

use std::io::Cursor;
use std::path::Path;

use nalgebra::Point3;

use super::raw::Raw;
use super::{Error, mesh, records};

const HEADER: usize = 84;
const FACET: usize = 50;
/// The line that begins a solid, with a name.
const NAMED: &[u8] = b"solid named\n";
const HELP: &str = "The file is cut off or damaged here: export the mesh again";

/// Whether the length is exactly that of a binary STL with the count that stands after its 80-byte header.
pub(super) fn is_binary(bytes: &[u8]) -> bool {
    claimed(bytes).is_some_and(|count| (bytes.len() - HEADER) as u64 == u64::from(count) * FACET as u64)
}

fn claimed(bytes: &[u8]) -> Option<u32> {
    bytes.get(80..HEADER)?.first_chunk().map(|count| u32::from_le_bytes(*count))
}

/// Whether this is an ASCII STL: many a binary header begins with `solid`, too, but has no facets in words.
pub(super) fn is_text(bytes: &[u8]) -> bool {
    let head = &bytes[..bytes.len().min(2048)];
    head.trim_ascii_start().starts_with(b"solid")
        && head.split(|b| *b == b'\n').any(|line| line.trim_ascii_start().starts_with(b"facet"))
}

/// Reads an STL file.
pub(super) fn parse(mut bytes: Vec<u8>, path: &Path) -> Result<Raw, Error> {
    let text = !is_binary(&bytes) && is_text(&bytes);
    let mut corners = Vec::new();
    if text {
        for solid in solids(&bytes) {
            read_facets(&mut Cursor::new(solid), &mut corners, path)?;
        }
    } else {
        let Some(count) = claimed(&bytes) else {
            return Err(Error::malformed(
                path,
                "byte 80",
                "the file ends before the number of triangles",
                HELP,
            ));
        };
        records::check_count(count.into(), FACET as u64, bytes.len() - HEADER, "triangles", "byte 80", path)?;
        // The library would take a header that begins with `solid` for text.
        bytes[..5].fill(b' ');
        read_facets(&mut Cursor::new(bytes), &mut corners, path)?;
    }
    let triangles = (0..corners.len() / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    mesh::from_triangles(corners, triangles, path)
}

/// The solids of an ASCII file, each with a name, as the library wants them.
fn solids(bytes: &[u8]) -> Vec<Vec<u8>> {
    let mut solids: Vec<Vec<u8>> = Vec::new();
    for line in bytes.split(|b| *b == b'\n').map(<[u8]>::trim_ascii) {
        if line.starts_with(b"solid") {
            // One after the other without a facet between them are one: each would take more than its line.
            if solids.last().is_some_and(|solid| solid == NAMED) {
                continue;
            }
            solids.push(NAMED.to_vec());
        } else if let Some(solid) = solids.last_mut() {
            solid.extend_from_slice(line);
            solid.push(b'\n');
        }
    }
    solids
}

fn read_facets(
    source: &mut Cursor<Vec<u8>>,
    corners: &mut Vec<Point3<f64>>,
    path: &Path,
) -> Result<(), Error> {
    let bad = |facet: usize, e: std::io::Error| {
        Error::malformed(path, format!("facet {facet}"), e.to_string(), HELP)
    };
    let reader = stl_io::create_stl_reader(source).map_err(|e| bad(0, e))?;
    for facet in reader {
        let facet = facet.map_err(|e| bad(corners.len() / 3, e))?;
        corners.extend(facet.vertices.iter().map(|v| Point3::from(v.0.map(f64::from))));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::raw::Positions;
    use super::*;

    const FACE: &str =
        "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";

    fn binary(count: u32, facets: usize) -> Vec<u8> {
        let mut bytes = b"solid but binary".to_vec();
        bytes.resize(80, b' ');
        bytes.extend(count.to_le_bytes());
        for _ in 0..facets {
            bytes.extend(
                [0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0].into_iter().flat_map(|v| (v as f32).to_le_bytes()),
            );
            bytes.extend([0, 0]);
        }
        bytes
    }

    fn read(bytes: Vec<u8>) -> Raw {
        parse(bytes, Path::new("a.stl")).unwrap()
    }

    #[test]
    fn binary_and_text_give_the_same_triangle() {
        let text = format!("solid\n{FACE}endsolid\n");
        let (a, b) = (read(binary(1, 1)), read(text.into()));
        assert_eq!((a.positions.clone(), a.triangles), (b.positions, b.triangles));
        let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(Point3::from);
        assert_eq!(a.positions, Positions::Double(corners.to_vec()));
    }

    #[test]
    fn all_solids_of_a_file_are_read() {
        let text = format!("solid plate\n{FACE}endsolid plate\nsolid tube\n{FACE}{FACE}endsolid tube\n");
        assert_eq!(read(text.into()).triangles.len(), 3);
    }

    #[test]
    fn a_wrong_count_and_a_cut_file_are_refused() {
        for (bytes, place) in [
            (binary(4_000_000_000, 1), "4000000000 triangles"),
            (binary(1, 1)[..82].to_vec(), "byte 80"),
            (format!("solid a\n{FACE}facet normal 0 0 1\nouter").into_bytes(), "facet 1"),
        ] {
            let error = parse(bytes, Path::new("a.stl")).unwrap_err().to_string();
            assert!(error.contains("a.stl") && error.contains(place), "{error}");
        }
    }
}
