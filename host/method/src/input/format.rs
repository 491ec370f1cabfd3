//! The formats that are read here, as a table: how each is known, by its content first and by its extension where the
//! content has no mark, and what reads it. A new format is a file beside this one, its `mod`, and its entry in [`FORMATS`].

use std::path::Path;

use super::memory::Limit;
use super::raw::Raw;
use super::records::Records;
use super::{Error, Options, Scan, depth, mesh, npy, stl, text, vtk};

/// How a file is known, and what reads it.
#[derive(Clone, Copy)]
pub(super) struct Format {
    /// As users know it.
    pub name: &'static str,
    /// In lower case; asked where no mark is found.
    extensions: &'static [&'static str],
    /// Whether a file begins like this one.
    mark: fn(&[u8]) -> bool,
    /// Whether the words of the first line that is no comment are of such a file; asked last.
    first_line: fn(&[&str]) -> bool,
    /// What reads it.
    pub reader: Reader,
}

/// Reads the head of a file of some length, for the fast path; `None` where that does not take it.
type Header = fn(&[u8], usize, &Path) -> Option<Records>;

/// What reads a format.
#[derive(Clone, Copy)]
pub(super) enum Reader {
    /// Points or a mesh in the file's own unit and frame.
    Points {
        /// The whole file.
        parse: fn(Vec<u8>, &Path, Limit) -> Result<Raw, Error>,
        /// Where the fast path takes some of these files.
        records: Option<Header>,
    },
    /// Views of its own: only as INPUT itself.
    Views {
        /// The whole file.
        read: fn(Vec<u8>, &Path, &Options) -> Result<Scan, Error>,
        /// A way out where a cloud is needed instead.
        elsewhere: &'static str,
    },
    /// `scan.json` under any name: it needs the files beside it.
    Manifest,
    /// Builds with this feature read it.
    #[cfg_attr(
        all(feature = "ply", feature = "pcd", feature = "e57", feature = "las"),
        expect(dead_code, reason = "this build has every reader")
    )]
    LeftOut(&'static str),
}

const CLOUD_NEEDED: &str = "Give a depth image as `depth`, a cloud as `cloud`.";

/// Every format; where several marks fit, the first.
const FORMATS: &[Format] = &[
    Format {
        name: "PLY",
        extensions: &["ply"],
        mark: |head| [&b"ply\n"[..], b"ply\r", b"ply "].iter().any(|mark| head.starts_with(mark)),
        first_line: never,
        #[cfg(feature = "ply")]
        reader: Reader::Points {
            parse: |bytes, path, limit| super::ply::parse(&bytes, path, limit),
            records: Some(super::ply::records),
        },
        #[cfg(not(feature = "ply"))]
        reader: Reader::LeftOut("ply"),
    },
    Format {
        name: "PNG",
        extensions: &["png"],
        mark: |head| head.starts_with(b"\x89PNG\r\n\x1a\n"),
        first_line: never,
        reader: Reader::Views {
            read: |bytes, path, options| depth::read_single(&bytes, path, options),
            elsewhere: CLOUD_NEEDED,
        },
    },
    Format {
        name: "E57",
        extensions: &[],
        mark: |head| head.starts_with(b"ASTM-E57"),
        first_line: never,
        #[cfg(feature = "e57")]
        reader: Reader::Views {
            read: super::e57::read,
            elsewhere: "Give an E57 itself as INPUT; or export it as PLY or PCD, for instance with CloudCompare",
        },
        #[cfg(not(feature = "e57"))]
        reader: Reader::LeftOut("e57"),
    },
    Format {
        name: "LAS",
        extensions: &[],
        mark: |head| head.starts_with(b"LASF"),
        first_line: never,
        #[cfg(feature = "las")]
        reader: Reader::Points { parse: super::las::parse, records: None },
        #[cfg(not(feature = "las"))]
        reader: Reader::LeftOut("las"),
    },
    Format {
        name: "PCD",
        extensions: &["pcd"],
        mark: |head| head.starts_with(b"# .PCD") || has_line(head, b"FIELDS ") && has_line(head, b"SIZE "),
        first_line: never,
        #[cfg(feature = "pcd")]
        reader: Reader::Points {
            parse: |bytes, path, limit| super::pcd::parse(&bytes, path, limit),
            records: Some(super::pcd::records),
        },
        #[cfg(not(feature = "pcd"))]
        reader: Reader::LeftOut("pcd"),
    },
    Format {
        name: "NumPy",
        extensions: &["npy"],
        mark: |head| head.starts_with(npy::MARK),
        first_line: never,
        reader: Reader::Points { parse: |bytes, path, limit| npy::parse(&bytes, path, limit), records: None },
    },
    Format {
        name: "VTK",
        extensions: &["vtk"],
        mark: |head| head.starts_with(vtk::MARK),
        first_line: never,
        reader: Reader::Points { parse: |bytes, path, limit| vtk::parse(&bytes, path, limit), records: None },
    },
    Format {
        name: "STL",
        extensions: &["stl"],
        mark: |bytes| stl::is_binary(bytes) || stl::is_text(bytes),
        first_line: never,
        reader: Reader::Points { parse: |bytes, path, _| stl::parse(bytes, path), records: None },
    },
    Format {
        name: "scan.json",
        extensions: &["json"],
        mark: |bytes| head(bytes).trim_ascii_start().starts_with(b"{"),
        first_line: never,
        reader: Reader::Manifest,
    },
    Format {
        name: "OBJ",
        extensions: &["obj"],
        mark: |_| false,
        first_line: |words| match words {
            ["v" | "vn" | "vt", rest @ ..] => rest.iter().all(is_number),
            ["mtllib" | "o" | "g" | "usemtl", _, ..] => true,
            _ => false,
        },
        reader: Reader::Points {
            parse: |bytes, path, limit| mesh::parse_obj(&bytes, path, limit),
            records: None,
        },
    },
    Format {
        name: "XYZ/CSV",
        extensions: &["xyz", "txt", "csv", "tsv", "asc", "pts"],
        mark: |_| false,
        first_line: |words| words.len() >= 3 && words.iter().all(is_number),
        reader: Reader::Points { parse: |bytes, path, _| text::parse(&bytes, path), records: None },
    },
];

/// Bytes that are looked at for marks of text.
const HEAD: usize = 2048;

fn head(bytes: &[u8]) -> &[u8] {
    &bytes[..bytes.len().min(HEAD)]
}

fn has_line(bytes: &[u8], word: &[u8]) -> bool {
    head(bytes).split(|b| *b == b'\n').any(|line| line.trim_ascii_start().starts_with(word))
}

fn is_number(word: &&str) -> bool {
    word.parse::<f64>().is_ok()
}

fn never(_: &[&str]) -> bool {
    false
}

/// The format of a file with these bytes; `None` if no reader takes it.
pub(super) fn of(bytes: &[u8], path: &Path) -> Option<&'static Format> {
    let first = |fits: &dyn Fn(&Format) -> bool| FORMATS.iter().find(|format| fits(format));
    first(&|format| (format.mark)(bytes))
        .or_else(|| {
            let extension = path.extension()?.to_str()?.to_ascii_lowercase();
            first(&|format| format.extensions.contains(&extension.as_str()))
        })
        .or_else(|| {
            let words = first_words(bytes)?;
            first(&|format| (format.first_line)(&words))
        })
}

/// Words of the first line that is neither empty nor a comment.
fn first_words(bytes: &[u8]) -> Option<Vec<&str>> {
    let mut lines = head(bytes).split(|b| *b == b'\n').map(|line| line.trim_ascii());
    let line = std::str::from_utf8(lines.find(|line| !line.is_empty() && !line.starts_with(b"#"))?).ok()?;
    Some(line.split([' ', '\t', ',', ';']).filter(|word| !word.is_empty()).collect())
}

/// A way out for a file that no reader takes.
pub(super) fn help(path: &Path) -> &'static str {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    match extension.as_str() {
        "las" | "laz" | "e57" => "It does not begin as such a file does: export it again, or as PLY or PCD.",
        _ => {
            "Read are PLY, PCD, XYZ/CSV, STL, OBJ, legacy VTK, .npy, 16-bit depth PNG, or a folder with scan.json."
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn format(bytes: &[u8], name: &str) -> Option<&'static str> {
        of(bytes, Path::new(name)).map(|format| format.name)
    }

    #[test]
    fn content_outweighs_the_extension() {
        assert_eq!(format(b"ply\nformat ascii 1.0\n", "cloud.pcd"), Some("PLY"));
        assert_eq!(format(b"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\n", "cloud.ply"), Some("PCD"));
        assert_eq!(format(b"\x89PNG\r\n\x1a\n", "depth"), Some("PNG"));
        assert_eq!(format(b"solid a\n facet normal 0 0 1\n", "part.txt"), Some("STL"));
    }

    #[test]
    fn extensions_count_in_any_case() {
        assert_eq!(format(b"broken", "A.PLY"), Some("PLY"));
        assert_eq!(format(b"x,y,z\n1,2,3\n", "A.Csv"), Some("XYZ/CSV"));
    }

    #[test]
    fn a_file_without_extension_is_known_by_its_first_line() {
        assert_eq!(format(b"# made by hand\n1 2 3\n", "cloud"), Some("XYZ/CSV"));
        assert_eq!(format(b"# made by hand\nv 1 2 3\n", "cloud"), Some("OBJ"));
        assert_eq!(format(b"\x00\x01\x02", "cloud.las"), None);
    }
}
