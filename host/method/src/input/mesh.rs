//! Meshes: triangles become points spread evenly over their area, with the normals of their facets.
//!
//! Points follow the R2 low-discrepancy sequence (Roberts 2018: plastic number), so that the same file gives the same
//! cloud and no clump is mistaken for an edge.

use std::path::Path;
use std::sync::Arc;

use nalgebra::{Point3, Vector3};

use super::extent::Extent;
use super::raw::{FARTHEST, Positions, Raw};
use super::{Error, memory, name_of, translation, whole_mm};
use crate::geometry::cloud::View;
use crate::geometry::mesh::Mesh;

/// Points that a mesh becomes at most: somewhat more than one VGA depth image.
const MOST_POINTS: f64 = 400_000.0;
/// Spacing as a share of the mesh's diagonal, where its own vertices are no denser.
const SPACING_SHARE: f64 = 1.0 / 350.0;

/// Reads an OBJ file; normals, textures, materials, lines and loose points are left.
pub(super) fn parse_obj(bytes: &[u8], path: &Path) -> Result<Raw, Error> {
    let options = tobj::LoadOptions {
        triangulate: true,
        ignore_points: true,
        ignore_lines: true,
        ..tobj::LoadOptions::default()
    };
    let mut geometry = obj_geometry(bytes);
    hold_faces(&geometry, bytes.len(), path)?;
    let no_materials = |_: &Path| Ok((Vec::new(), Default::default()));
    let (models, _) = tobj::load_obj_buf(&mut geometry.as_slice(), &options, no_materials).map_err(|e| {
        let help = "Export the mesh again, as OBJ or as STL";
        Error::malformed(path, "a vertex or face line", e.to_string(), help)
    })?;
    geometry.clear();
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for tobj::Model { mesh, .. } in &models {
        let first = vertices.len();
        vertices.extend(mesh.positions.chunks_exact(3).map(|p| Point3::new(p[0], p[1], p[2])));
        let corner = |i: u32| first + i as usize;
        triangles.extend(mesh.indices.chunks_exact(3).map(|t| [corner(t[0]), corner(t[1]), corner(t[2])]));
    }
    from_triangles(vertices, triangles, path)
}

/// The `v` and `f` lines with nothing but positions: what else an OBJ holds cannot fail to be read.
fn obj_geometry(bytes: &[u8]) -> Vec<u8> {
    let mut geometry = Vec::with_capacity(bytes.len());
    for line in bytes.split(|b| *b == b'\n').map(<[u8]>::trim_ascii) {
        let words = || line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        let kept = match words().next() {
            Some(b"v") => 4,
            Some(b"f") => usize::MAX,
            _ => continue,
        };
        for word in words().take(kept) {
            geometry.extend(word.split(|b| *b == b'/').next().unwrap_or_default());
            geometry.push(b' ');
        }
        geometry.push(b'\n');
    }
    geometry
}

/// Bytes that the library and [`Raw`] take for a corner of a polygon, which is a triangle of its fan as well.
const CORNER_BYTES: u64 = 24 + 12 + 24;

/// Refuses polygons of so many corners that their fans would take far more than the file.
fn hold_faces(geometry: &[u8], file_bytes: usize, path: &Path) -> Result<(), Error> {
    let faces = geometry.split(|b| *b == b'\n').filter(|line| line.starts_with(b"f "));
    let corners: usize = faces.map(|line| line.iter().filter(|b| **b == b' ').count() - 1).sum();
    memory::hold(path, file_bytes, "corners of faces", corners as u64, CORNER_BYTES)
}

/// A mesh with at least one triangle.
pub(super) fn from_triangles(
    vertices: Vec<Point3<f64>>,
    triangles: Vec<[usize; 3]>,
    path: &Path,
) -> Result<Raw, Error> {
    if triangles.is_empty() {
        return Err(Error::empty(path, "the mesh has no triangle"));
    }
    let mut raw = Raw::from(Positions::Double(vertices));
    raw.triangles = triangles;
    Ok(raw)
}

/// Adds a polygon as a fan of triangles; refuses a corner that is no vertex.
#[cfg(feature = "ply")]
pub(super) fn add_fan(
    corners: impl Iterator<Item = usize> + Clone,
    vertices: usize,
    triangles: &mut Vec<[usize; 3]>,
) -> Result<(), String> {
    if let Some(wrong) = corners.clone().find(|corner| *corner >= vertices) {
        return Err(format!("it refers to vertex {wrong} of {vertices}"));
    }
    let mut rest = corners;
    if let (Some(first), Some(mut previous)) = (rest.next(), rest.next()) {
        for corner in rest {
            triangles.push([first, previous, corner]);
            previous = corner;
        }
    }
    Ok(())
}

/// One facet that has an area, mm, relative to the view's origin.
struct Facet {
    corner: Vector3<f64>,
    sides: [Vector3<f64>; 2],
    normal: Vector3<f64>,
    area: f64,
}

/// Spreads points over a mesh.
pub(super) fn sample(
    raw: &Raw,
    extent: &Extent,
    mm_per_unit: f64,
    path: &Path,
    notes: &mut Vec<String>,
) -> Result<View, Error> {
    let origin = whole_mm(extent.middle, mm_per_unit);
    let facets: Vec<Facet> =
        raw.triangles.iter().filter_map(|t| facet(raw, *t, origin, mm_per_unit)).collect();
    let area: f64 = facets.iter().map(|facet| facet.area).sum();
    if !(area > 0.0 && area.is_finite()) {
        return Err(Error::empty(path, "no triangle of the mesh has a finite area above 0"));
    }
    let flat = raw.triangles.len() - facets.len();
    if flat > 0 {
        notes.push(format!("left {flat} triangles without area or with a corner that is not finite"));
    }
    let coarse = extent.diagonal * mm_per_unit * SPACING_SHARE;
    let own = (area / raw.positions.len().max(1) as f64).sqrt();
    let spacing = coarse.min(own).max((area / MOST_POINTS).sqrt());
    let count = (area / spacing.powi(2)).round().max(1.0) as usize;
    notes
        .push(format!("mesh of {} triangles sampled to {count} points, {spacing:.3} mm apart", facets.len()));
    let (points_mm, normals) = spread(&facets, area, count);
    let base_from_camera = translation(origin * mm_per_unit);
    let mesh = exact(raw, origin, mm_per_unit).map(Arc::new);
    Ok(View { name: name_of(path), points_mm, normals, base_from_camera, camera_known: false, mesh })
}

/// The mesh itself, relative to `origin`.
fn exact(raw: &Raw, origin: Vector3<f64>, mm_per_unit: f64) -> Option<Mesh> {
    let used = |t: &[usize; 3]| t.iter().all(|&i| raw.positions.at(i).iter().all(|c| c.abs() <= FARTHEST));
    let triangles: Vec<[usize; 3]> = raw.triangles.iter().copied().filter(used).collect();
    let mut largest = 0.0_f64;
    let mut corner = |i: usize| {
        let at = raw.positions.at(i);
        // Corners that no facet uses may be anything.
        if at.iter().any(|c| c.is_nan() || c.abs() > FARTHEST) {
            return Point3::origin();
        }
        largest = at.amax().max(largest);
        Point3::from((at - origin) * mm_per_unit)
    };
    let corners: Vec<Point3<f64>> = (0..raw.positions.len()).map(&mut corner).collect();
    // STL and most PLY hold single precision, whatever they are read into.
    let rounding_mm = largest * f64::from(f32::EPSILON) * mm_per_unit;
    Mesh::weld(&corners, &triangles, rounding_mm)
}

fn facet(raw: &Raw, corners: [usize; 3], origin: Vector3<f64>, mm_per_unit: f64) -> Option<Facet> {
    let usable = |i: &usize| raw.positions.at(*i).iter().all(|c| c.abs() <= FARTHEST);
    if !corners.iter().all(usable) {
        return None;
    }
    let [a, b, c] = corners.map(|i| (raw.positions.at(i) - origin) * mm_per_unit);
    let sides = [b - a, c - a];
    let across = sides[0].cross(&sides[1]);
    let twice = across.norm();
    (twice > 0.0 && twice.is_finite()).then(|| Facet {
        corner: a,
        sides,
        normal: across / twice,
        area: twice / 2.0,
    })
}

/// `count` points: the k-th lies in the facet that covers the share (k + 1/2) / count of the area.
fn spread(facets: &[Facet], area: f64, count: usize) -> (Vec<Point3<f32>>, Vec<Vector3<f32>>) {
    let mut points = Vec::with_capacity(count);
    let mut normals = Vec::with_capacity(count);
    let mut covered = 0.0;
    for facet in facets {
        covered += facet.area / area;
        let until = ((covered * count as f64 + 0.5).floor() as usize).min(count);
        for k in points.len()..until {
            points.push(Point3::from(in_facet(facet, k).cast::<f32>()));
            normals.push(facet.normal.cast::<f32>());
        }
    }
    (points, normals)
}

/// The k-th point of the R2 sequence, folded from the unit square into the triangle.
fn in_facet(facet: &Facet, k: usize) -> Vector3<f64> {
    const PLASTIC: f64 = 1.324_717_957_244_746;
    let along = |step: f64| (0.5 + step * (k + 1) as f64).fract();
    let (u, v) = (along(1.0 / PLASTIC), along(1.0 / (PLASTIC * PLASTIC)));
    let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
    facet.corner + facet.sides[0] * u + facet.sides[1] * v
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plate of 2 x 1 m in z = 1, wound so that it faces up, and a triangle without area.
    const PLATE: &str = "mtllib none.mtl\no plate\nv 0 0 1\nv 2 0 1\nv 2 1 1\nv 0 1 1\nvt 0 0\nusemtl x\n\
                         f 1/1 2/1 3/1 4/1\nf 1 1 -1\n";

    fn sampled(text: &str) -> (View, Vec<String>) {
        let raw = parse_obj(text.as_bytes(), Path::new("plate.obj")).unwrap();
        let mut notes = Vec::new();
        (sample(&raw, &raw.extent(), 1000.0, Path::new("plate.obj"), &mut notes).unwrap(), notes)
    }

    #[test]
    fn points_lie_on_the_facets_and_normals_follow_the_winding() {
        let (view, notes) = sampled(PLATE);
        assert!(view.points_mm.len() > 10_000 && view.points_mm.len() == view.normals.len());
        for (point, normal) in view.points_mm.iter().zip(&view.normals) {
            let base = view.base_from_camera * point.cast::<f64>();
            assert!(
                (base.z - 1000.0).abs() < 1e-3
                    && (0.0..=2000.0).contains(&base.x)
                    && (0.0..=1000.0).contains(&base.y)
            );
            assert_eq!(*normal, Vector3::z());
        }
        assert!(notes[0].contains("1 triangles without area") && notes[1].contains("mm apart"), "{notes:?}");
    }

    #[test]
    fn equal_areas_hold_equal_numbers_of_points() {
        let (view, _) = sampled(PLATE);
        let mut cells = [[0usize; 10]; 20];
        for point in &view.points_mm {
            let base = view.base_from_camera * point.cast::<f64>();
            cells[((base.x / 100.0) as usize).min(19)][((base.y / 100.0) as usize).min(9)] += 1;
        }
        let mean = view.points_mm.len() as f64 / 200.0;
        let worst = cells.iter().flatten().map(|n| (*n as f64 - mean).abs() / mean).fold(0.0, f64::max);
        assert!(worst < 0.1, "{worst}");
    }

    #[test]
    fn a_mesh_without_faces_and_a_wrong_index_are_refused() {
        assert!(matches!(parse_obj(b"v 1 2 3\n", Path::new("a.obj")), Err(Error::Empty { .. })));
        let error = parse_obj(b"v 1 2 3\nf 1 2 9\n", Path::new("a.obj")).unwrap_err().to_string();
        assert!(error.contains("a.obj") && error.contains("bounds"), "{error}");
    }
}
