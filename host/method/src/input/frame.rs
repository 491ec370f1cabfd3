//! Whose frame does a single cloud live in: that of a camera at its origin, or another?
//!
//! A camera sees along each ray once. So: all points in front of the origin within a field of view, almost no two points on
//! one ray at clearly different depths, at the angular spacing of the cloud itself, and in its picture a grid of pixels or what
//! is left of one. The last is what tells a camera's picture from several views of a sheet, which has one depth from anywhere.

use std::collections::HashMap;

use nalgebra::Vector3;

use super::Picture;
use super::extent::Extent;
use super::raster::{self, Shot};
use super::raw::Raw;

/// Points that stand alone where a picture ends may be the next one's: no more than this share.
const STRAYS: f64 = 1e-3;
/// Half of the widest field of view, as a cosine: 50 degrees.
const LEAST_COSINE: f64 = 0.642_787_609_686_539_3;
/// Points that are looked at.
const SAMPLE: usize = 30_000;
/// Share of points that may break a rule: silhouettes and flying pixels do.
const TOLERATED: f64 = 0.05;
/// Evenness of the points in the picture of one camera at least: halfway from points without order to a grid that was thinned.
const LEAST_EVEN: f64 = 0.5;
/// Fewer points prove nothing.
const FEWEST: usize = 50;

/// Where the camera stood, in the cloud's own coordinates and unit, if the cloud bears it out.
pub(super) fn camera_of(raw: &Raw, extent: &Extent, notes: &mut Vec<String>) -> Option<Vector3<f64>> {
    let origin = Vector3::zeros();
    among(raw.viewpoint.into_iter().filter(|at| *at != origin).chain([origin]), raw, extent, notes)
}

/// The pictures that a cloud is made of, where the order of its points tells them and each picture
/// bears its camera out; the cloud itself where not.
pub(super) fn shots_of(
    raw: Raw,
    mm_per_unit: f64,
    notes: &mut Vec<String>,
) -> Result<Vec<Picture>, Box<Raw>> {
    let Some(shots) = raster::shots(&raw.positions) else { return Err(raw.into()) };
    let parts: Vec<Raw> = shots.iter().map(|shot| raw.part(&shot.points)).collect();
    let bears_out = |(part, shot): (&Raw, &Shot)| {
        let axis = (part.extent().middle - shot.camera).try_normalize(0.0);
        axis.is_some_and(|axis| evidence_along(part, shot.camera, &axis, STRAYS).is_ok())
    };
    if !parts.iter().zip(&shots).all(bears_out) {
        return Err(raw.into());
    }
    let place = |shot: &Shot| {
        let at = shot.camera * mm_per_unit;
        format!("{:.0}, {:.0}, {:.0}", at.x, at.y, at.z)
    };
    let places: Vec<String> = shots.iter().map(place).collect();
    let camera = if places.len() == 1 { "a camera" } else { "cameras" };
    notes.push(format!("frame: {camera} at {} mm (where the rows of its pixels lead)", places.join("; ")));
    Ok(parts.into_iter().zip(shots).map(|(part, shot)| (part, shot.camera)).collect())
}

/// Whether a cloud of unknown frame may yet be in that of its camera.
pub(super) enum Suspicion {
    None,
    /// Its user is asked.
    May(&'static str),
    /// Its pixels are those of a camera at the origin that faces along x, as ROS turns cameras.
    Is,
}

/// What no camera that faces along z explains.
pub(super) fn suspicion(raw: &Raw) -> Suspicion {
    let origin = Vector3::zeros();
    let ahead = || raw.positions.sample(SAMPLE).iter().all(|p| p.x > 0.0);
    if raw.positions.len() >= FEWEST && ahead() && evidence_along(raw, origin, &Vector3::x(), 0.0).is_ok() {
        let rays = raw.positions.sample(LATTICE_SAMPLE);
        return if is_lattice(&pictured(&rays, &Vector3::x()), raw.positions.len()) {
            Suspicion::Is
        } else {
            Suspicion::May(
                "it could be what a camera at the origin sees that faces along x, as ROS turns cameras",
            )
        };
    }
    match raw.names_camera && raw.viewpoint == Some(origin) {
        true => Suspicion::May("its file names a camera at the origin"),
        false => Suspicion::None,
    }
}

/// Points whose pixels are sought.
const LATTICE_SAMPLE: usize = 3000;

/// Whether the points of a picture lie in rows and columns of one width, as pixels do. A picture that was taken from elsewhere has
/// its own rows, of another width at each place.
fn is_lattice(image: &[[f64; 3]], points: usize) -> bool {
    /// Pixels of the picture may be missing: their width is sought in this range about the mean spacing.
    const RANGE: [f64; 2] = [0.4, 1.3];
    /// Share of a pixel by which the last of a thousand columns may be off.
    const OFF: f64 = 0.2;
    const COLUMNS: f64 = 1000.0;
    /// Mean resultant of the places within a pixel: 1 on a lattice, 1/50 at random, and not above 1/10 at any of 6000 widths.
    const CLEAR: f64 = 0.5;
    let spacing = angular_spacing(image) * (image.len() as f64 / points as f64).sqrt();
    let concentrated = |axis: usize| {
        let resultant = |width: f64| {
            let turn = |p: &[f64; 3]| std::f64::consts::TAU * p[axis] / width;
            let (cos, sin) = image.iter().map(turn).fold((0.0, 0.0), |(c, s), a| (c + a.cos(), s + a.sin()));
            f64::hypot(cos, sin) / image.len() as f64
        };
        let mut width = RANGE[0] * spacing;
        while width < RANGE[1] * spacing {
            if resultant(width) > CLEAR {
                return true;
            }
            width *= 1.0 + OFF / COLUMNS;
        }
        false
    };
    spacing > 0.0 && spacing.is_finite() && concentrated(0) && concentrated(1)
}

/// The same of a cloud in the base frame of a robot: no camera stands in the robot's foot.
pub(super) fn camera_in_base(raw: &Raw, extent: &Extent, notes: &mut Vec<String>) -> Option<Vector3<f64>> {
    among(raw.viewpoint.into_iter().filter(|at| *at != Vector3::zeros()), raw, extent, notes)
}

fn among(
    candidates: impl Iterator<Item = Vector3<f64>>,
    raw: &Raw,
    extent: &Extent,
    notes: &mut Vec<String>,
) -> Option<Vector3<f64>> {
    let origin = Vector3::zeros();
    let mut refusals = Vec::new();
    for at in candidates {
        let name = if at == origin { "the origin".into() } else { format!("VIEWPOINT {:?}", at.as_slice()) };
        match evidence(raw, at, extent) {
            Ok(why) => {
                notes.push(format!("frame: a camera at {name} ({why})"));
                return Some(at);
            }
            Err(why) => refusals.push(format!("no camera at {name}: {why}")),
        }
    }
    let why = if refusals.is_empty() { "the file names none".into() } else { refusals.join("; ") };
    notes.push(format!("frame: unknown camera position ({why})"));
    None
}

/// Why a camera at `at` did, or why it did not, take this cloud.
fn evidence(raw: &Raw, at: Vector3<f64>, extent: &Extent) -> Result<String, String> {
    let n = raw.positions.len();
    if n < FEWEST {
        return Err(format!("{n} points are too few to decide"));
    }
    let rays: Vec<Vector3<f64>> = raw.positions.sample(SAMPLE).iter().map(|p| p - at).collect();
    let axis = optical_axis(&rays, at, extent)?;
    evidence_along(raw, at, &axis, 0.0)
}

/// The same of a camera that faces along `axis`, where this share of the points may be another's.
fn evidence_along(raw: &Raw, at: Vector3<f64>, axis: &Vector3<f64>, strays: f64) -> Result<String, String> {
    let inside = |ray: &Vector3<f64>| ray.dot(axis) > LEAST_COSINE * ray.norm();
    let rays = |most: usize| raw.positions.sample(most).into_iter().map(move |p| p - at);
    let (seen, not_seen): (Vec<_>, Vec<_>) = rays(SAMPLE).partition(inside);
    let outside = not_seen.len() as f64 / (seen.len() + not_seen.len()) as f64;
    if outside > strays {
        return Err(format!(
            "{:.1} % of the points are outside a field of view of 100 degrees",
            100.0 * outside
        ));
    }
    let image = pictured(&seen, axis);
    let hidden = hidden_share(&image);
    if hidden > TOLERATED {
        return Err(format!("{:.1} % of the points would be hidden by others", 100.0 * hidden));
    }
    let all: Vec<Vector3<f64>> = rays(raw.positions.len()).filter(inside).collect();
    match evenness(&pictured(&all, axis)) >= LEAST_EVEN {
        true => Ok(format!("one depth per ray for all but {:.1} % of the points", 100.0 * hidden)),
        false => Err("its picture is no grid of pixels, but several over each other".into()),
    }
}

/// The axis of the frame that the cloud is seen along: +z as usual, -z as in OpenGL.
/// About a VIEWPOINT the axes say nothing, so it is the direction of the cloud's middle.
fn optical_axis(rays: &[Vector3<f64>], at: Vector3<f64>, extent: &Extent) -> Result<Vector3<f64>, String> {
    if at != Vector3::zeros() {
        return (extent.middle - at).try_normalize(0.0).ok_or_else(|| "the cloud surrounds it".into());
    }
    let ahead = share(rays, |ray| ray.z > 0.0);
    match ahead {
        1.0 => Ok(Vector3::z()),
        0.0 => Ok(-Vector3::z()),
        _ => Err(format!("{:.1} % of the points are ahead in z, the others behind", 100.0 * ahead)),
    }
}

fn share(rays: &[Vector3<f64>], holds: impl Fn(&Vector3<f64>) -> bool) -> f64 {
    rays.iter().filter(|ray| holds(ray)).count() as f64 / rays.len() as f64
}

/// Where the points are in a picture with this optical axis, as tangents, and how deep.
fn pictured(rays: &[Vector3<f64>], axis: &Vector3<f64>) -> Vec<[f64; 3]> {
    let right = axis.cross(&least_aligned(axis)).normalize();
    let down = axis.cross(&right);
    let pixel = |ray: &Vector3<f64>| {
        let depth = ray.dot(axis);
        [ray.dot(&right) / depth, ray.dot(&down) / depth, depth]
    };
    rays.iter().map(pixel).collect()
}

/// Share of the points that share their ray with a clearly nearer one.
fn hidden_share(image: &[[f64; 3]]) -> f64 {
    // Four points to a cell: with one, a sample of two layers may well hold one point of either on each ray.
    let pixel = 2.0 * angular_spacing(image);
    let mut nearest = HashMap::with_capacity(image.len());
    for [u, v, depth] in image {
        let seen: &mut f64 = nearest.entry(cell(*u, *v, pixel)).or_insert(f64::INFINITY);
        *seen = seen.min(*depth);
    }
    // A surface seen at 80 degrees from its normal changes its depth by 5.67 cells' widths within a cell.
    let clear = 1.0 + 5.67 * pixel;
    let hidden = image.iter().filter(|[u, v, depth]| *depth > clear * nearest[&cell(*u, *v, pixel)]).count();
    hidden as f64 / image.len() as f64
}

/// How evenly the points lie in the picture: the distance to the nearest other that a tenth of them fall below, as a share of the
/// mean one. Pixels are a grid, and so is what is left of it where some are missing; where several pictures lie over each
/// other, as of points strewn at random, it is 0.37.
fn evenness(image: &[[f64; 3]]) -> f64 {
    const WINDOWS: usize = 9;
    const WINDOW_POINTS: f64 = 200.0;
    // Where all points are at one place, all are in the window.
    const MOST_POINTS: usize = 1000;
    let half = 0.5 * WINDOW_POINTS.sqrt() * angular_spacing(image);
    let window = |k: usize| {
        let [u, v, _] = image[(2 * k + 1) * image.len() / (2 * WINDOWS)];
        let near = image.iter().filter(|p| (p[0] - u).abs() < half && (p[1] - v).abs() < half);
        let near: Vec<[f64; 2]> = near.map(|p| [p[0], p[1]]).take(MOST_POINTS).collect();
        let nearest = |p: &[f64; 2]| {
            let others = near.iter().map(|q| (p[0] - q[0]).hypot(p[1] - q[1])).filter(|apart| *apart > 0.0);
            others.fold(2.0 * half, f64::min)
        };
        let mut apart: Vec<f64> = near.iter().map(nearest).collect();
        apart.sort_unstable_by(f64::total_cmp);
        apart[apart.len() / 10] * apart.len() as f64 / apart.iter().sum::<f64>()
    };
    let mut windows: Vec<f64> = (0..WINDOWS).map(window).collect();
    windows.sort_unstable_by(f64::total_cmp);
    windows[WINDOWS / 2]
}

fn least_aligned(axis: &Vector3<f64>) -> Vector3<f64> {
    let mut basis = Vector3::zeros();
    basis[axis.iamin()] = 1.0;
    basis
}

fn cell(u: f64, v: f64, size: f64) -> (i64, i64) {
    ((u / size).floor() as i64, (v / size).floor() as i64)
}

/// Spacing of the image points: the side of a square that holds one point on average, over the area they cover.
fn angular_spacing(image: &[[f64; 3]]) -> f64 {
    let span = |k: usize| {
        let (low, high) = image
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| (low.min(p[k]), high.max(p[k])));
        high - low
    };
    let whole = (span(0).max(1e-9) * span(1).max(1e-9) / image.len() as f64).sqrt();
    let coarse = 4.0 * whole;
    let covered: std::collections::HashSet<_> = image.iter().map(|[u, v, _]| cell(*u, *v, coarse)).collect();
    coarse * (covered.len() as f64 / image.len() as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::raw::Positions;
    use super::*;
    use nalgebra::Point3;

    /// What a 200 x 150 camera at the origin sees of a box 300 mm wide, 40 mm high, on a table 600 mm away.
    fn box_on_table() -> Vec<Point3<f64>> {
        let ray =
            |i: usize| Vector3::new((i % 200) as f64 / 200.0 - 0.5, (i / 200) as f64 / 200.0 - 0.375, 1.0);
        (0..200 * 150)
            .map(|i| {
                let on_box = ray(i) * 560.0;
                let hits = on_box.x.abs() < 150.0 && on_box.y.abs() < 100.0;
                Point3::from(if hits { on_box } else { ray(i) * 600.0 })
            })
            .collect()
    }

    fn decided(points: Vec<Point3<f64>>, viewpoint: Option<Vector3<f64>>) -> (Option<Vector3<f64>>, String) {
        let mut raw = Raw::from(Positions::Double(points));
        raw.viewpoint = viewpoint;
        let mut notes = Vec::new();
        (camera_of(&raw, &raw.extent(), &mut notes), notes.join("\n"))
    }

    #[test]
    fn what_a_camera_sees_is_known_as_such() {
        assert_eq!(decided(box_on_table(), None).0, Some(Vector3::zeros()));
        let behind = box_on_table().iter().map(|p| Point3::new(p.x, -p.y, -p.z)).collect();
        assert_eq!(decided(behind, None).0, Some(Vector3::zeros()), "OpenGL looks along -z");
    }

    #[test]
    fn a_plate_with_two_sides_was_not_seen_from_the_origin() {
        let both = box_on_table().into_iter().flat_map(|p| [p, p * 1.4]).collect();
        let (camera, note) = decided(both, None);
        assert!(camera.is_none() && note.contains("hidden"), "{note}");
    }

    #[test]
    fn several_views_of_a_sheet_are_no_cameras_picture() {
        // Three cameras look down on a level sheet, each turned about its axis, and one at the origin would have seen as much.
        let views = [0.0, 0.4, 1.1].map(|turn| nalgebra::Rotation3::from_euler_angles(0.0, 0.0, turn));
        let sheet = |view: nalgebra::Rotation3<f64>| {
            (0..200 * 150).map(move |i| {
                let (u, v) = ((i % 200) as f64 / 200.0 - 0.5, (i / 200) as f64 / 200.0 - 0.375);
                view * Point3::new(600.0 * u, 600.0 * v, 700.0)
            })
        };
        assert!(decided(sheet(views[0]).collect(), None).0.is_some());
        let (camera, note) = decided(views.into_iter().flat_map(sheet).collect(), None);
        assert!(camera.is_none() && note.contains("no grid of pixels"), "{note}");
    }

    #[test]
    fn a_workpiece_beside_the_robot_was_not_seen_from_its_base() {
        let beside = box_on_table().iter().map(|p| Point3::new(p.x + 700.0, p.y, 600.0 - p.z)).collect();
        assert!(decided(beside, None).0.is_none());
    }

    #[test]
    fn a_camera_that_faces_along_x_is_known_by_its_pixels_and_a_turned_one_is_not() {
        let judged = |points: Vec<Point3<f64>>| suspicion(&Raw::from(Positions::Double(points)));
        let forward = |p: &Point3<f64>| Point3::new(p.z, -p.x, -p.y);
        assert!(matches!(judged(box_on_table().iter().map(forward).collect()), Suspicion::Is));
        // Of the table beside the robot: rows, but not those of a camera in the robot's foot.
        let tilt = nalgebra::Rotation3::from_euler_angles(0.2, 0.9, 0.1);
        let table =
            |p: &Point3<f64>| tilt * Point3::new(p.x, p.y, 600.0 - p.z) + Vector3::new(700.0, 40.0, -60.0);
        assert!(!matches!(judged(box_on_table().iter().map(table).collect()), Suspicion::Is));
        assert!(matches!(judged(box_on_table()), Suspicion::None));
        let named = Raw {
            names_camera: true,
            viewpoint: Some(Vector3::zeros()),
            ..Raw::from(Positions::Double(box_on_table()))
        };
        assert!(matches!(suspicion(&named), Suspicion::May(_)));
    }

    #[test]
    fn a_viewpoint_is_taken_if_the_cloud_bears_it_out() {
        let at = Vector3::new(900.0, -200.0, 50.0);
        let moved = || box_on_table().iter().map(|p| p + at).collect();
        assert_eq!(decided(moved(), Some(at)).0, Some(at));
        assert_eq!(decided(moved(), Some(at + Vector3::new(0.0, 0.0, 590.0))).0, None);
    }
}
