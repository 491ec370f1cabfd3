//! Keys of what is read: of files as they lie on the disk, and of a scan as the pipeline takes it.

use std::io;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::key::{Digest, Key};
use weldpath_files::reading;
use weldpath_method::geometry::cloud::View;
use weldpath_method::geometry::mesh::Mesh;
use weldpath_method::input::Scan;

/// The key of files by their names and all of their bytes; none if one of them is no regular file, since a pipe could not be
/// read again. A file that is not there is part of the key, too.
pub(crate) fn of_files(paths: &[PathBuf]) -> Option<Key> {
    let keys: Vec<Key> = paths.par_iter().map(|path| of_file(path)).collect::<io::Result<_>>().ok()?;
    let mut digest = Digest::default();
    digest.count(keys.len());
    keys.into_iter().for_each(|key| digest.key(key));
    Some(digest.end())
}

fn of_file(path: &Path) -> io::Result<Key> {
    let mut digest = Digest::default();
    digest.bytes(path.as_os_str().as_encoded_bytes());
    let mut length = 0;
    let is_there = reading::pieces(path, |piece| {
        digest.piece(piece);
        length += piece.len();
    })?;
    digest.count(length);
    digest.count(usize::from(is_there));
    Ok(digest.end())
}

/// The key of a scan: every point of it, and all that is said of it.
pub(crate) fn of_scan(scan: &Scan) -> Key {
    // A field that is added is asked for here.
    let Scan { views, background, notes, warnings, doubts, frame, inputs } = scan;
    let of_views = |views: &[View]| views.par_iter().map(of_view).collect::<Vec<Key>>();
    let mut digest = Digest::default();
    digest.shown(&(of_views(views), of_views(background)));
    digest.shown(&(notes, warnings, doubts, frame, inputs));
    digest.end()
}

fn of_view(view: &View) -> Key {
    let View { name, points_mm, normals, base_from_camera, camera_known, mesh, picture } = view;
    let mut digest = Digest::default();
    digest.text(name);
    digest.numbers(points_mm.iter().flat_map(|p| [p.x, p.y, p.z].map(f32::to_le_bytes)));
    digest.numbers(normals.iter().flat_map(|n| [n.x, n.y, n.z].map(f32::to_le_bytes)));
    digest.shown(base_from_camera);
    digest.shown(&(camera_known, picture));
    digest.count(usize::from(mesh.is_some()));
    if let Some(mesh) = mesh {
        of_mesh(&mut digest, mesh);
    }
    digest.end()
}

/// What a mesh was welded from and to. Its normals, faces, edges and tree follow from these.
fn of_mesh(digest: &mut Digest, mesh: &Mesh) {
    let Mesh { vertices, facets, sides, weld_mm, normals: _, face_of: _, faces: _, edges: _, tree: _ } = mesh;
    digest.numbers(vertices.iter().flat_map(|p| [p.x, p.y, p.z].map(f64::to_le_bytes)));
    digest.numbers(facets.iter().flatten().map(|corner| corner.to_le_bytes()));
    digest.numbers(sides.iter().map(|side| [*side as u8]));
    digest.shown(weld_mm);
}

#[cfg(test)]
mod tests {
    use super::*;
    use weldpath_method::input::{self, Options, Units};

    #[test]
    fn every_byte_and_every_name_of_the_files_is_in_the_key() {
        let home = tempfile::tempdir().unwrap();
        let [a, b] = ["a", "b"].map(|name| home.path().join(name));
        std::fs::write(&a, "12").unwrap();
        let of = || of_files(&[a.clone(), b.clone()]).unwrap();
        let without_b = of();
        std::fs::write(&b, "").unwrap();
        let with_b = of();
        assert_ne!(without_b, with_b);
        std::fs::write(&a, "13").unwrap();
        assert_ne!(with_b, of());
        std::fs::write(&a, "12").unwrap();
        assert_eq!(with_b, of(), "the same bytes, written anew");
        std::fs::write(&a, "1").unwrap();
        std::fs::write(&b, "2").unwrap();
        assert_ne!(with_b, of(), "the same bytes, in other files");
        assert_eq!(of_files(&[home.path().into()]), None, "a folder is no file");
    }

    #[test]
    fn every_part_of_a_scan_is_in_its_key() {
        let text = "0 0 1\n10 0 1\n0 10 2\n";
        let options = Options { units: Units::Millimetres, ..Options::default() };
        let scan = input::read_bytes(text.into(), Path::new("a.xyz"), &options).unwrap();
        let before = of_scan(&scan);
        assert_eq!(before, of_scan(&scan.clone()));
        let changes: [fn(&mut Scan); 8] = [
            |scan| scan.views[0].points_mm[2].z += 1e-4,
            |scan| scan.views[0].name.push('b'),
            |scan| scan.views[0].base_from_camera.translation.x += 1e-9,
            |scan| scan.views[0].camera_known ^= true,
            |scan| scan.background = scan.views.clone().into(),
            |scan| scan.warnings.push("something".into()),
            |scan| scan.frame = input::CloudFrame::Base,
            |scan| scan.inputs.clear(),
        ];
        for (k, change) in changes.iter().enumerate() {
            let mut other = scan.clone();
            change(&mut other);
            assert_ne!(before, of_scan(&other), "change {k}");
        }
    }
}
