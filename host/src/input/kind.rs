//! What kind of file this is: by its content first, by its extension where the content has no mark.

use std::path::Path;

/// A kind of file that some reader here takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Ply,
    Pcd,
    /// XYZ, CSV and other columns of numbers.
    Text,
    Stl,
    Obj,
    Png,
    E57,
    /// LAS and LAZ.
    Las,
    /// `scan.json` under any name.
    Json,
}

/// Bytes that are looked at.
const HEAD: usize = 2048;

/// The kind of a file with these bytes; `None` if no reader takes it.
pub(super) fn of(bytes: &[u8], path: &Path) -> Option<Kind> {
    by_mark(bytes).or_else(|| by_extension(path)).or_else(|| by_first_line(bytes))
}

fn by_mark(bytes: &[u8]) -> Option<Kind> {
    let head = &bytes[..bytes.len().min(HEAD)];
    let starts = |mark: &[u8]| head.starts_with(mark);
    let has_line =
        |word: &[u8]| head.split(|b| *b == b'\n').any(|line| line.trim_ascii_start().starts_with(word));
    if starts(b"ply\n") || starts(b"ply\r") || starts(b"ply ") {
        Some(Kind::Ply)
    } else if starts(b"\x89PNG\r\n\x1a\n") {
        Some(Kind::Png)
    } else if starts(b"ASTM-E57") {
        Some(Kind::E57)
    } else if starts(b"LASF") {
        Some(Kind::Las)
    } else if starts(b"# .PCD") || has_line(b"FIELDS ") && has_line(b"SIZE ") {
        Some(Kind::Pcd)
    } else if super::stl::is_binary(bytes) || super::stl::is_text(bytes) {
        Some(Kind::Stl)
    } else if head.trim_ascii_start().starts_with(b"{") {
        Some(Kind::Json)
    } else {
        None
    }
}

fn by_extension(path: &Path) -> Option<Kind> {
    match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
        "ply" => Some(Kind::Ply),
        "pcd" => Some(Kind::Pcd),
        "xyz" | "txt" | "csv" | "tsv" | "asc" | "pts" => Some(Kind::Text),
        "stl" => Some(Kind::Stl),
        "obj" => Some(Kind::Obj),
        "png" => Some(Kind::Png),
        "json" => Some(Kind::Json),
        _ => None,
    }
}

/// A file of unknown name whose first line that is no comment is a vertex of an OBJ or a row of numbers.
fn by_first_line(bytes: &[u8]) -> Option<Kind> {
    let head = &bytes[..bytes.len().min(HEAD)];
    let mut lines = head.split(|b| *b == b'\n').map(|line| line.trim_ascii());
    let line = std::str::from_utf8(lines.find(|line| !line.is_empty() && !line.starts_with(b"#"))?).ok()?;
    let number = |word: &str| word.parse::<f64>().is_ok();
    let words: Vec<&str> = line.split([' ', '\t', ',', ';']).filter(|word| !word.is_empty()).collect();
    match words.as_slice() {
        ["v" | "vn" | "vt", rest @ ..] if rest.iter().copied().all(number) => Some(Kind::Obj),
        ["mtllib" | "o" | "g" | "usemtl", _, ..] => Some(Kind::Obj),
        [_, _, _, ..] if words.iter().copied().all(number) => Some(Kind::Text),
        _ => None,
    }
}

/// A way out for a file that no reader takes.
pub(super) fn help(path: &Path) -> &'static str {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    match extension.as_str() {
        "las" | "laz" | "e57" => "It does not begin as such a file does: export it again, or as PLY or PCD.",
        "step" | "stp" | "iges" | "igs" | "3mf" | "glb" | "gltf" => "Export the mesh as STL or OBJ.",
        "jpg" | "jpeg" | "tif" | "tiff" | "exr" => "Depth images are read as 16-bit greyscale PNG.",
        _ => "Read are PLY, PCD, XYZ/CSV, STL, OBJ, 16-bit depth PNG, or a folder with scan.json.",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kind(bytes: &[u8], name: &str) -> Option<Kind> {
        of(bytes, Path::new(name))
    }

    #[test]
    fn content_outweighs_the_extension() {
        assert_eq!(kind(b"ply\nformat ascii 1.0\n", "cloud.pcd"), Some(Kind::Ply));
        assert_eq!(kind(b"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\n", "cloud.ply"), Some(Kind::Pcd));
        assert_eq!(kind(b"\x89PNG\r\n\x1a\n", "depth"), Some(Kind::Png));
        assert_eq!(kind(b"solid a\n facet normal 0 0 1\n", "part.txt"), Some(Kind::Stl));
    }

    #[test]
    fn extensions_count_in_any_case() {
        assert_eq!(kind(b"broken", "A.PLY"), Some(Kind::Ply));
        assert_eq!(kind(b"x,y,z\n1,2,3\n", "A.Csv"), Some(Kind::Text));
    }

    #[test]
    fn a_file_without_extension_is_known_by_its_first_line() {
        assert_eq!(kind(b"# made by hand\n1 2 3\n", "cloud"), Some(Kind::Text));
        assert_eq!(kind(b"# made by hand\nv 1 2 3\n", "cloud"), Some(Kind::Obj));
        assert_eq!(kind(b"\x00\x01\x02", "cloud.las"), None);
    }
}
