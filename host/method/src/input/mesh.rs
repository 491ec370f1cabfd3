//! Meshes. The triangles of a drawn one become points spread evenly over their area, with the normals of their facets; of a
//! measured one the vertices are a scan.
//!
//! Points follow the R2 low-discrepancy sequence (Roberts 2018: plastic number), so that the same file gives the same
//! cloud and no clump is mistaken for an edge.

use std::path::Path;
use std::sync::Arc;

use nalgebra::{Point3, Vector3};

use super::extent::Extent;
use super::measured::{self, Maker};
use super::memory::Limit;
use super::raw::{FARTHEST, Positions, Raw};
use super::{Doubt, DoubtKind, Error, MeshAs, Options, StatedFrame, frame, name_of, translation, whole_mm};
use crate::geometry::cloud::View;
use crate::geometry::mesh::Mesh;

/// Points that a mesh becomes at most: somewhat more than one VGA depth image.
const MOST_POINTS: f64 = 400_000.0;
/// Spacing as a share of the mesh's diagonal, where its own vertices are no denser.
const SPACING_SHARE: f64 = 1.0 / 350.0;
/// A last digit beyond this share of the diagonal is no rounding: numbers of a drawing are whole.
const FEW_DIGITS: f64 = 1e-4;

/// Reads an OBJ file; normals, textures, materials, lines and loose points are left.
pub(super) fn parse_obj(bytes: &[u8], path: &Path, limit: Limit) -> Result<Raw, Error> {
    let options = tobj::LoadOptions {
        triangulate: true,
        ignore_points: true,
        ignore_lines: true,
        ..tobj::LoadOptions::default()
    };
    let mut geometry = obj_geometry(bytes);
    hold_faces(&geometry, bytes.len(), path, limit)?;
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
fn hold_faces(geometry: &[u8], file_bytes: usize, path: &Path, limit: Limit) -> Result<(), Error> {
    let faces = geometry.split(|b| *b == b'\n').filter(|line| line.starts_with(b"f "));
    let corners: usize = faces.map(|line| line.iter().filter(|b| **b == b' ').count() - 1).sum();
    limit.hold(path, file_bytes, "corners of faces", corners as u64, CORNER_BYTES)
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

/// A file with faces, as it is understood.
pub(super) enum Taken {
    /// Drawn: exact.
    Cad(Box<View>),
    /// Measured: a cloud; with what its data left open.
    Scan(Box<Raw>, Option<Doubt>),
}

/// Tells a drawn mesh from a measured one, unless that is said.
pub(super) fn taken(
    raw: Raw,
    options: &Options,
    extent: &Extent,
    mm_per_unit: f64,
    path: &Path,
    notes: &mut Vec<String>,
) -> Result<Taken, Error> {
    let origin = whole_mm(extent.middle, mm_per_unit);
    let mesh = stitched(&raw, extent, origin, mm_per_unit);
    let pictured = || {
        let camera = frame::camera_of(&raw, extent, &mut Vec::new());
        camera.is_some_and(|at| measured::is_picture(&raw, at))
    };
    let maker = match (options.mesh_as, &mesh) {
        (Some(MeshAs::Cad), _) | (None, None) => Maker::Drawn,
        (Some(MeshAs::Scan), _) => Maker::Measured("as given".into()),
        (None, Some(_)) if pictured() => Maker::Measured("its faces are the pixels of one picture".into()),
        (None, Some((mesh, precision_mm))) => measured::maker(mesh, *precision_mm),
    };
    let mut doubt = None;
    let why = match maker {
        Maker::Drawn => {
            let mesh = mesh.map(|(mesh, _)| Arc::new(mesh.with_faces()));
            let view = sample(&raw, extent, mm_per_unit, path, notes)?;
            return Ok(Taken::Cad(Box::new(View { mesh, ..view })));
        }
        Maker::Measured(why) => why,
        Maker::Unclear(why) => {
            let words = format!(
                "{}: its data do not say whether this mesh was drawn or scanned ({why}): taken as a scan; say --as cad if it is CAD",
                name_of(path)
            );
            doubt = Some(Doubt { kind: DoubtKind::CadOrScan, words });
            why
        }
    };
    notes.push(format!("mesh of {} triangles taken as a scan ({why})", raw.triangles.len()));
    let mesh = mesh.map(|(mesh, _)| mesh);
    let camera_said = options.camera_mm.is_some() || options.frame == Some(StatedFrame::Camera);
    let cloud = cloud(raw, mesh.as_ref(), origin, mm_per_unit, extent, camera_said);
    Ok(Taken::Scan(Box::new(cloud), doubt))
}

/// Of a facet's sides, how many times the shortest the longest may be where a surface is: pixels are square, and seen at 75 degrees
/// from the normal four times as long as wide.
const LEAP: f64 = 4.0;

/// The vertices of a measured mesh. Where no camera is known they have the normals of their facets, and where they are too far
/// apart for the search, points on the facets between them.
fn cloud(
    raw: Raw,
    mesh: Option<&Mesh>,
    origin: Vector3<f64>,
    mm_per_unit: f64,
    extent: &Extent,
    camera_said: bool,
) -> Raw {
    // A soup has each of its vertices several times.
    let is_soup = raw.positions.len() == 3 * raw.triangles.len();
    let vertices = Raw { triangles: Vec::new(), notes: Vec::new(), ..raw };
    let Some(mesh) = mesh else { return vertices };
    let in_file = |p: &Point3<f64>| p / mm_per_unit + origin;
    let camera_known = camera_said
        || frame::camera_of(&vertices, extent, &mut Vec::new()).is_some()
        || matches!(frame::suspicion(&vertices), frame::Suspicion::Is);
    if camera_known {
        let once = || Positions::Double(mesh.vertices.iter().map(in_file).collect());
        return if is_soup { Raw { positions: once(), ..vertices } } else { vertices };
    }
    let (mut points, mut normals) = (mesh.vertices.clone(), vertex_normals(mesh));
    let spacing_mm = finest_mm(extent.diagonal * mm_per_unit);
    let room = (MOST_POINTS as usize).saturating_sub(points.len()).max(1);
    let area: f64 = (0..mesh.facets.len() as u32).map(|f| mesh.area_mm2(f)).sum();
    let spacing_mm = spacing_mm.max((area / room as f64).sqrt());
    for f in 0..mesh.facets.len() as u32 {
        let [a, b, c] = mesh.corners(f);
        let sides_mm = [(b - a).norm(), (c - b).norm(), (a - c).norm()];
        let longest_mm = sides_mm.into_iter().fold(0.0, f64::max);
        // Where a picture leaps from one thing to what is behind it, its facets are long and thin: nothing is there.
        if sides_mm.into_iter().any(|mm| LEAP * mm < longest_mm) {
            continue;
        }
        let parts = (longest_mm / spacing_mm).ceil() as usize;
        let share = |k: usize| k as f64 / parts as f64;
        // Corners are there, and each edge belongs to two facets: half of its points are enough.
        let inside = (1..parts).flat_map(|i| (0..parts - i).map(move |j| (i, j)));
        let added = inside.map(|(i, j)| a + (b - a) * share(i) + (c - a) * share(j));
        points.extend(added);
        normals.resize(points.len(), mesh.normals[f as usize]);
    }
    let positions = Positions::Double(points.iter().map(in_file).collect());
    let known = if is_wound_one_way(mesh) { normals } else { Vec::new() };
    Raw { positions, normals: known.iter().map(|n| n.cast()).collect(), ..vertices }
}

/// Spacing below which points are of no use to the search, mm: its voxels are not smaller, and hold 1.3 spacings.
fn finest_mm(diagonal_mm: f64) -> f64 {
    (diagonal_mm / 120.0).min(1.2) / 1.3
}

/// Mean of the facets' normals at each vertex, by their area.
fn vertex_normals(mesh: &Mesh) -> Vec<Vector3<f64>> {
    let mut normals = vec![Vector3::zeros(); mesh.vertices.len()];
    for (f, corners) in mesh.facets.iter().enumerate() {
        let weighted = mesh.normals[f] * mesh.area_mm2(f as u32);
        corners.iter().for_each(|&v| normals[v as usize] += weighted);
    }
    normals
}

/// Whether neighbours go round their common edge in opposite directions, so that their normals are on one side.
fn is_wound_one_way(mesh: &Mesh) -> bool {
    /// Of the edges; what is beyond is a seam in the file.
    const TOLERATED: f64 = 0.01;
    let forward = |f: u32, [a, b]: [u32; 2]| {
        let corners = mesh.facets[f as usize];
        (0..3).any(|k| (corners[k], corners[(k + 1) % 3]) == (a, b))
    };
    let against = |facets: &[u32], ends| match *facets {
        [f, g] => forward(f, ends) == forward(g, ends),
        _ => false,
    };
    let wrong = mesh.edges.iter().filter(|edge| against(&edge.facets, edge.ends)).count();
    wrong as f64 <= TOLERATED * mesh.edges.len() as f64
}

/// Spreads points over a mesh.
fn sample(
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
    Ok(View {
        name: name_of(path),
        points_mm,
        normals,
        base_from_camera,
        camera_known: false,
        mesh: None,
        picture: None,
    })
}

/// The mesh itself, relative to `origin`, and to what its file's numbers are right, mm.
fn stitched(raw: &Raw, extent: &Extent, origin: Vector3<f64>, mm_per_unit: f64) -> Option<(Mesh, f64)> {
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
    // Text keeps as many digits as its writer was told.
    let written = measured::last_digit(raw);
    let digits_mm = if written < FEW_DIGITS * extent.diagonal { written * mm_per_unit } else { 0.0 };
    let mesh = Mesh::stitched(&corners, &triangles, rounding_mm)?;
    Some((mesh, digits_mm.max(4.0 * rounding_mm)))
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
        let raw = parse_obj(text.as_bytes(), Path::new("plate.obj"), Limit::default()).unwrap();
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
        assert!(matches!(
            parse_obj(b"v 1 2 3\n", Path::new("a.obj"), Limit::default()),
            Err(Error::Empty { .. })
        ));
        let error =
            parse_obj(b"v 1 2 3\nf 1 2 9\n", Path::new("a.obj"), Limit::default()).unwrap_err().to_string();
        assert!(error.contains("a.obj") && error.contains("bounds"), "{error}");
    }
}
