//! Whether a seam runs along the rounding of a corner and not in it (ours).
//!
//! A matcher's window rounds a corner, and so does a radius of the work. A neighbourhood that is smaller than the rounding sees two
//! wide corners in it, one on either side: between a face and a ramp. The ramp is told by where it leads: beyond it the surface turns
//! on the same way, up to the other face.

use crate::geometry::statistics::median;
use crate::seam::input::SurfaceModel;
use crate::seam::refine::frame::Frame;
use crate::seam::{Seam, Station};
use std::f32::consts::PI;

/// How far from the seam the surface is looked at, mm: a matcher's window of 15 mm makes a ramp of 11.
const BEYOND_MM: [f32; 2] = [12.0, 20.0];
/// Half width of the sections that are looked at, voxels.
const SECTION_VOXELS: f32 = 2.0;
/// Seen from the seam, what is there stands so high over the face at least, rad: halfway out, a surface that turns by 45 degrees after
/// 11 mm stands at 14 degrees. No face of a seam that is offered leans by as much.
const LEAST_RISE_RAD: f32 = 0.17;
/// A face that goes on as it is stands no higher over itself, rad: what waves and a fit's lean explain.
const MOST_FLAT_RAD: f32 = 0.07;
/// What stands higher than this share of the angle between the faces is of the other.
const OF_OTHER: f32 = 0.75;
/// Points that say so, and share of the stations that have some.
const LEAST_POINTS: usize = 20;
const LEAST_SHARE: f32 = 0.5;
/// A ramp is at a wider angle to a face than this, degrees: half the way from one face to the other of an acute corner.
const LEAST_DEG: f64 = 105.0;

/// Whether one of its faces turns on to a third, toward the air, and the other does not: in the middle of a rounding both do.
pub fn is_ramp(seam: &Seam, model: &SurfaceModel) -> bool {
    if seam.included_deg() < LEAST_DEG {
        return false;
    }
    let [one, other] = rises_rad(seam, model).map(|rise_rad| rise_rad.unwrap_or(0.0));
    one.max(other) > LEAST_RISE_RAD && one.min(other) < MOST_FLAT_RAD
}

/// How high over each face the surface stands beyond it, the median; none where little is seen of it.
fn rises_rad(seam: &Seam, model: &SurfaceModel) -> [Option<f32>; 2] {
    let mut faces = [(); 2].map(|()| Beyond::default());
    for station in &seam.stations {
        let before = faces.each_ref().map(|face| face.rises_rad.len());
        section(station, model, |k, rise_rad| faces[k].rises_rad.push(rise_rad));
        for (face, before) in faces.iter_mut().zip(before) {
            face.shown += usize::from(face.rises_rad.len() > before);
        }
    }
    let least_shown = LEAST_SHARE * seam.stations.len() as f32;
    faces.map(|Beyond { mut rises_rad, shown }| {
        let is_shown = shown as f32 > least_shown && rises_rad.len() >= LEAST_POINTS;
        is_shown.then(|| median(&mut rises_rad))
    })
}

/// What is seen beyond one face.
#[derive(Default)]
struct Beyond {
    rises_rad: Vec<f32>,
    /// Stations that show some of it.
    shown: usize,
}

/// Angles over each face, seen from the seam, of the points beyond what a ramp may be wide, rad.
fn section(station: &Station, model: &SurfaceModel, mut rises: impl FnMut(usize, f32)) {
    let frame = Frame::of(station, &model.cloud.origin_mm);
    let inward = frame.faces_inward();
    let [from_mm, to_mm] = BEYOND_MM;
    let most_mm = SECTION_VOXELS * model.voxel_mm();
    let most_rad = OF_OTHER * (PI - frame.faces[0].angle(&frame.faces[1]));
    model.index.within(&frame.position, to_mm, |slot, squared_mm2| {
        let p = model.index.point(slot) - frame.position;
        if squared_mm2 < from_mm * from_mm || p.dot(&frame.tangent).abs() > most_mm {
            return;
        }
        for (k, (face, inward)) in frame.faces.iter().zip(&inward).enumerate() {
            let rise_rad = p.dot(face).atan2(p.dot(inward));
            if rise_rad.abs() < most_rad {
                rises(k, rise_rad);
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::cloud::PointCloud;
    use crate::geometry::grid::Grid;
    use crate::model::downsampling::Voxels;
    use nalgebra::{Point3, Vector3};

    /// Whether the corner at the origin of a profile of (y, z), which goes along x, is a ramp, between faces with these normals.
    fn is_ramp_of(profile: &[[f32; 2]], faces: [[f64; 2]; 2]) -> bool {
        let mut points = Vec::new();
        for pair in profile.windows(2) {
            let [a, b] = [pair[0], pair[1]];
            let steps = ((b[0] - a[0]).hypot(b[1] - a[1])) as usize;
            for (k, x) in (0..steps).flat_map(|k| (0..100).map(move |x| (k, x as f32))) {
                let t = k as f32 / steps as f32;
                points.push(Point3::new(x, a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])));
            }
        }
        let cloud = PointCloud { points_mm: points, ..PointCloud::default() };
        let voxels = Voxels { edge_mm: 1.0, cloud: cloud.clone(), ..Voxels::default() };
        let index = Grid::new(&cloud.points_mm, 4.0);
        let model = SurfaceModel { voxels: &voxels, cloud: &cloud, index: &index, asymmetries: &[] };
        let faces = faces.map(|[y, z]| Vector3::new(0.0, y, z).normalize());
        let station = |k: i32| Station {
            position_mm: Point3::new(2.0 * f64::from(k), 0.0, 0.0),
            tangent: Vector3::x(),
            faces,
        };
        is_ramp(&Seam::through((0..50).map(station).collect()), &model)
    }

    const LEVEL_AND_SLOPE: [[f64; 2]; 2] = [[0.0, 1.0], [1.0, 1.0]];

    #[test]
    fn the_edge_of_a_rounding_is_a_ramp_and_a_wide_corner_is_none() {
        // A plate, 45 degrees up over 7 mm, and a wall.
        assert!(is_ramp_of(&[[40.0, 0.0], [0.0, 0.0], [-5.0, 5.0], [-5.0, 40.0]], LEVEL_AND_SLOPE));
        assert!(!is_ramp_of(&[[40.0, 0.0], [0.0, 0.0], [-30.0, 30.0]], LEVEL_AND_SLOPE));
        // It ends, and goes on level: a bevel.
        assert!(!is_ramp_of(&[[40.0, 0.0], [0.0, 0.0], [-7.0, 7.0], [-40.0, 7.0]], LEVEL_AND_SLOPE));
    }

    #[test]
    fn the_middle_of_a_rounding_is_no_edge_of_it() {
        // A groove whose root is flattened on both sides alike.
        let half = [[0.0, 0.0], [7.0, 2.5], [20.0, 22.0]];
        let mut profile: Vec<[f32; 2]> = half.iter().rev().map(|[y, z]| [-y, *z]).collect();
        profile.extend(&half[1..]);
        assert!(!is_ramp_of(&profile, [[-2.5, 7.0], [2.5, 7.0]]));
    }
}
