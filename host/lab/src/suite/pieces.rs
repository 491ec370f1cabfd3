//! What lies below a folder: scans, meshes and clouds, each with its truth where there is one beside it.

use serde::Serialize;
use std::io;
use std::path::{Path, PathBuf};
use weldpath_method::input;
use weldpath_sim::evaluation::Truth;
use weldpath_sim::simulation::{ListedWeld, mesh_truth};

/// What a piece is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum PieceKind {
    /// A folder with `scan.json`.
    Scan,
    /// An STL or OBJ file.
    Mesh,
    /// Any other cloud.
    Cloud,
}

/// Something to plan.
#[derive(Debug, Clone)]
pub struct Piece {
    /// Path below the folder of the suite.
    pub name: String,
    /// What it is.
    pub kind: PieceKind,
    /// What to give to `weldpath plan`.
    pub input: PathBuf,
    truth: Option<PathBuf>,
}

/// All pieces below `folder`, by name. A scan's truth is `truth.json` in its folder or `truth/NAME.json` beside it; that
/// of a mesh is `weld_vectors.json` beside it, that of a cloud `truth.json` beside it, in the cloud's frame.
///
/// # Errors
/// What the system says of a folder that cannot be read.
pub fn pieces(folder: &Path) -> io::Result<Vec<Piece>> {
    let mut found = Vec::new();
    collect(folder, folder, &mut found)?;
    found.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(found)
}

fn collect(root: &Path, folder: &Path, found: &mut Vec<Piece>) -> io::Result<()> {
    let name = |path: &Path| path.strip_prefix(root).unwrap_or(path).display().to_string();
    if folder.join("scan.json").is_file() {
        let own = folder.file_name().unwrap_or_default().to_string_lossy();
        let beside = folder.with_file_name("truth").join(format!("{own}.json"));
        let truth = [folder.join("truth.json"), beside].into_iter().find(|file| file.is_file());
        found.push(Piece { name: name(folder), kind: PieceKind::Scan, input: folder.into(), truth });
        return Ok(());
    }
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            collect(root, &path, found)?;
        } else if let Some(kind) = kind(&path) {
            let beside = if kind == PieceKind::Mesh { "weld_vectors.json" } else { "truth.json" };
            let truth = Some(path.with_file_name(beside)).filter(|file| file.is_file());
            found.push(Piece { name: name(&path), kind, input: path, truth });
        }
    }
    Ok(())
}

fn kind(path: &Path) -> Option<PieceKind> {
    let extension = path.extension()?.to_ascii_lowercase();
    match extension.to_str()? {
        "stl" | "obj" => Some(PieceKind::Mesh),
        "ply" | "pcd" | "xyz" => Some(PieceKind::Cloud),
        _ => None,
    }
}

impl Piece {
    /// The truth, if there is one.
    pub(super) fn truth(&self) -> Result<Option<Truth>, String> {
        let Some(file) = &self.truth else { return Ok(None) };
        if self.kind != PieceKind::Mesh {
            return Truth::read(file).map(Some).map_err(|error| error.to_string());
        }
        let bytes = std::fs::read(file).map_err(|error| format!("{}: {error}", file.display()))?;
        let welds = ListedWeld::list(&bytes).map_err(|error| format!("{}: {error}", file.display()))?;
        let triangles = input::triangles(&self.input, &input::Options::default());
        Ok(Some(mesh_truth(&triangles.map_err(|error| error.to_string())?, &welds)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scans_meshes_and_clouds_are_found_with_their_truths() {
        let root = std::env::temp_dir().join(format!("weldpath-suite-{}", std::process::id()));
        let file = |name: &str| {
            let path = root.join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        };
        let names = [
            "a/scan.json",
            "a/view_000.ply",
            "a/truth.json",
            "b_s1.5/scan.json",
            "truth/b_s1.5.json",
            "c/part.STL",
            "c/weld_vectors.json",
            "d/part.obj",
            "e.pcd",
            "notes.txt",
        ];
        names.iter().for_each(|name| file(name));
        let found = pieces(&root).unwrap();
        std::fs::remove_dir_all(&root).unwrap();
        let rows: Vec<(&str, PieceKind, bool)> =
            found.iter().map(|p| (p.name.as_str(), p.kind, p.truth.is_some())).collect();
        let expected = [
            ("a", PieceKind::Scan, true),
            ("b_s1.5", PieceKind::Scan, true),
            ("c/part.STL", PieceKind::Mesh, true),
            ("d/part.obj", PieceKind::Mesh, false),
            ("e.pcd", PieceKind::Cloud, false),
        ];
        assert_eq!(rows, expected);
    }
}
