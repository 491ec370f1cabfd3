//! One plane that several seams saw (ours): of a plate through the pipe that stands on it, a camera sees a strip beside the inner
//! foot, too narrow to tell its slope, or its height at the foot. They are those of the same plate beside the outer foot. How sure
//! the seam is stays as it was: what is seen so little of may be off in other ways.

use super::Refined;
use super::expected::{FLOOR_MM, FLOOR_RAD, MEDIAN_OF_RMS, independent};
use super::frame::Frame;
use super::path::{PathPoint, frames};
use super::smooth::Samples;
use crate::geometry::statistics::median;
use crate::seam::trace::Chain;
use nalgebra::{Matrix2, Matrix3, Vector3};

/// Standard deviations within which two normals are of one plane.
const SAME_DEVIATIONS: f64 = 3.0;
/// Farthest that a seam is off the plane of another, voxels: layers that are nearer are not told apart.
const OFF_VOXELS: f64 = 1.0;
/// A face takes slope and height of a plane whose slope is this many times as sure.
const SURER: f64 = 3.0;
/// Least cosine between the normals of a flat face and their mean, and sine between the faces of a seam that is moved along one of
/// them onto the other.
const FLAT: f64 = 0.95;
const CROSSES: f64 = 0.3;
/// Shorter vectors have no direction.
const LEAST_LENGTH: f64 = 1e-6;

/// A flat face along a seam: `height = h + a x + b y` over the mean normal, with x and y from the middle of the seam.
struct Plane {
    middle: Vector3<f64>,
    axes: [Vector3<f64>; 2],
    /// Unit normal.
    normal: Vector3<f64>,
    /// A place on it, mm.
    place: Vector3<f64>,
    /// Of `h, a, b`.
    covariance: Matrix3<f64>,
}

/// Gives the faces of which a strip was seen the plane that they lie in, where other seams show it.
pub fn share(seams: &mut [(Chain, Refined)], voxel_mm: f32) {
    let planes: Vec<[Option<Plane>; 2]> =
        seams.iter().map(|(_, seam)| [0, 1].map(|face| Plane::along(seam, face))).collect();
    for ((_, seam), faces) in seams.iter_mut().zip(&planes) {
        for (face, own) in faces.iter().enumerate() {
            let Some(own) = own else { continue };
            let surer =
                planes.iter().flatten().flatten().filter(|plane| SURER * plane.tilt_rad() < own.tilt_rad());
            let same = surer.filter(|plane| plane.holds(own, seam, voxel_mm));
            if let Some(plane) = same.min_by(|a, b| a.tilt_rad().total_cmp(&b.tilt_rad())) {
                plane.lend(own, seam, face);
            }
        }
    }
}

impl Plane {
    /// A face of a seam, if it is flat.
    fn along(seam: &Refined, face: usize) -> Option<Self> {
        let normals = || seam.frames.iter().map(|f| f.faces[face].cast::<f64>());
        let mean = normals().sum::<Vector3<f64>>().try_normalize(LEAST_LENGTH)?;
        if normals().any(|normal| normal.dot(&mean) < FLAT) {
            return None;
        }
        let side = Vector3::ith_axis(mean.iamin()).cross(&mean).normalize();
        let axes = [side, mean.cross(&side)];
        let places = || seam.frames.iter().map(|f| f.position.coords.cast::<f64>());
        let middle = places().sum::<Vector3<f64>>() / seam.frames.len() as f64;
        let (height_mm, slope_rad) = (own_height_mm(seam), seam.face_tilts_rad[face].hypot(FLOOR_RAD));
        let mut information = Matrix3::zeros();
        let mut pull = Vector3::zeros();
        let mut add = |row: Vector3<f64>, value: f64, deviation: f64| {
            information += row * row.transpose() / deviation.powi(2);
            pull += row * value / deviation.powi(2);
        };
        for ((place, normal), frame) in places().zip(normals()).zip(&seam.frames) {
            let off = place - middle;
            add(Vector3::new(1.0, axes[0].dot(&off), axes[1].dot(&off)), mean.dot(&off), height_mm);
            // Along the seam the slope is that of its places.
            let across = frame.tangent.cast::<f64>().cross(&mean).try_normalize(LEAST_LENGTH)?;
            let slope = -normal.dot(&across) / normal.dot(&mean);
            add(Vector3::new(0.0, axes[0].dot(&across), axes[1].dot(&across)), slope, slope_rad);
        }
        let covariance = information.try_inverse()?;
        let plane = covariance * pull;
        let normal = (mean - axes[0] * plane.y - axes[1] * plane.z).normalize();
        let covariance = covariance * (seam.frames.len() as f64 / independent(seam));
        Some(Self { middle, axes, normal, place: middle + mean * plane.x, covariance })
    }

    /// Standard deviation of the normal where it is least sure, rad.
    fn tilt_rad(&self) -> f64 {
        let slopes: Matrix2<f64> = self.covariance.fixed_view::<2, 2>(1, 1).into();
        slopes.symmetric_eigenvalues().max().sqrt()
    }

    /// Height over it, mm.
    fn height_mm(&self, frame: &Frame) -> f64 {
        self.normal.dot(&(frame.position.coords.cast::<f64>() - self.place))
    }

    /// Variance of that, mm².
    fn height_variance_mm2(&self, frame: &Frame) -> f64 {
        let off = frame.position.coords.cast::<f64>() - self.middle;
        let row = Vector3::new(1.0, self.axes[0].dot(&off), self.axes[1].dot(&off));
        row.dot(&(self.covariance * row))
    }

    /// Whether the face `other` of a seam lies in it, as far as that is known.
    fn holds(&self, other: &Self, seam: &Refined, voxel_mm: f32) -> bool {
        let mut off_mm: Vec<f64> = seam.frames.iter().map(|f| self.height_mm(f).abs()).collect();
        self.normal.dot(&other.normal) > 0.0
            && self.normal.cross(&other.normal).norm()
                < SAME_DEVIATIONS * self.tilt_rad().hypot(other.tilt_rad())
            && median(&mut off_mm) < OFF_VOXELS * f64::from(voxel_mm)
    }

    /// Gives its slope and its height to the face `own` of a seam, each weighed by how sure it is.
    fn lend(&self, own: &Self, seam: &mut Refined, face: usize) {
        let [kept, lent] = [own, self].map(|plane| plane.tilt_rad().powi(-2));
        // The height at the root is that of the strip, and as unsure as its slope from there on.
        let lever_mm = 0.5 * f64::from(seam.reach_mm[face]) * seam.face_tilts_rad[face];
        let own_mm2 = (own_height_mm(seam).powi(2) + lever_mm.powi(2)) / independent(seam);
        let opening = |f: &Frame| f.faces[0].cast::<f64>().angle(&f.faces[1].cast::<f64>());
        let opening = seam.frames.iter().map(opening).sum::<f64>() / seam.frames.len() as f64;
        let point = |frame: &Frame| {
            let along = frame.faces_inward()[1 - face].cast::<f64>();
            let rises = along.dot(&self.normal);
            let share = own_mm2 / (own_mm2 + self.height_variance_mm2(frame));
            let moved_mm = if rises.abs() > CROSSES { -share * self.height_mm(frame) / rises } else { 0.0 };
            let faces = frame.faces.map(|normal| normal.cast::<f64>());
            let flat = (faces[face] * kept + self.normal * lent).normalize();
            // The other face keeps the angle that it has to this one all along.
            let across = (faces[1 - face] - flat * flat.dot(&faces[1 - face])).normalize();
            let other = flat * opening.cos() + across * opening.sin();
            PathPoint {
                position_mm: frame.position.coords.cast() + along * moved_mm,
                faces: if face == 0 { [flat, other] } else { [other, flat] },
            }
        };
        let mut points: Vec<PathPoint> = seam.frames.iter().map(point).collect();
        smooth(&mut points, seam);
        if let Some(frames) = frames(&points, seam.closed) {
            seam.frames = frames;
        }
    }
}

/// Smooths the places of a seam of few stations that share no points: what they share is no bend of it.
fn smooth(points: &mut [PathPoint], seam: &Refined) {
    let places: Vec<[f64; 3]> = points.iter().map(|point| point.position_mm.into()).collect();
    let weights = vec![1.0; places.len()];
    let line =
        Samples { values: &places, weights: &weights, step_mm: f64::from(seam.step_mm), closed: seam.closed };
    let curve = line.stiffest(2.0 * f64::from(seam.window_mm));
    for (point, place) in points.iter_mut().zip(line.smooth(curve)) {
        point.position_mm = place.into();
    }
}

/// Standard deviation of the place of one station, mm.
fn own_height_mm(seam: &Refined) -> f64 {
    (seam.scatter_mm / MEDIAN_OF_RMS).hypot(FLOOR_MM)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLATE_MM: f32 = 50.0;

    /// A seam of a wall on a plate, its stations at these places of it; the plate is seen to be tilted and off by so much.
    fn seam(
        places: impl Iterator<Item = (f32, f32)>,
        tilt_rad: f32,
        off_mm: f32,
        face_tilt_rad: f64,
    ) -> (Chain, Refined) {
        let station = |(x, y): (f32, f32)| PathPoint {
            position_mm: Vector3::new(x, y, PLATE_MM + off_mm).cast(),
            faces: [Vector3::new(0.0, tilt_rad.sin(), tilt_rad.cos()).cast(), -Vector3::y()],
        };
        let points: Vec<PathPoint> = places.map(station).collect();
        let frames = frames(&points, false).expect("a line");
        let refined = Refined {
            step_mm: 2.0,
            closed: false,
            measured: vec![true; frames.len()],
            sigma_mm: 0.3,
            scatter_mm: 0.03,
            tilt_rad: face_tilt_rad,
            face_tilts_rad: [face_tilt_rad, 0.01],
            reach_mm: [12.0; 2],
            lift_unknown_mm: [0.0; 2],
            window_mm: 12.0,
            freedom: 2.0,
            view_share: vec![Default::default(); frames.len()],
            near: Vec::new(),
            frames,
        };
        let chain = Chain { links: Vec::new(), closed: false, support: 0, share: 1.0 };
        (chain, refined)
    }

    fn line(y_mm: f32, count: u8) -> impl Iterator<Item = (f32, f32)> {
        (0..count).map(move |k| (2.0 * f32::from(k), y_mm))
    }

    /// How far the plate beside a seam that saw a strip of it leans after all, and how far off it the seam is, mm.
    fn after(tilt_rad: f32, off_mm: f32) -> (f32, f32) {
        let mut seams = [seam(line(0.0, 100), 0.0, 0.0, 0.005), seam(line(60.0, 20), tilt_rad, off_mm, 0.06)];
        share(&mut seams, 1.2);
        let frame = &seams[1].1.frames[10];
        assert_eq!(seams[0].1.frames[50].faces[0], Vector3::z(), "the surer one lends");
        (frame.faces[0].angle(&Vector3::z()), frame.position.z - PLATE_MM)
    }

    #[test]
    fn a_strip_of_a_plate_takes_the_slope_and_the_height_that_another_seam_shows() {
        let (lean, off_mm) = after(0.05, 0.2);
        assert!(lean < 0.003 && off_mm.abs() < 0.05, "{lean} rad, {off_mm} mm");
    }

    #[test]
    fn another_plate_is_none_of_its_own() {
        let (lean, off_mm) = after(0.05, 2.5);
        assert!(lean > 0.049 && off_mm > 2.4, "a layer above: {lean} rad, {off_mm} mm");
        let (lean, _) = after(0.3, 0.0);
        assert!(lean > 0.29, "a face that leans: {lean} rad");
    }
}
