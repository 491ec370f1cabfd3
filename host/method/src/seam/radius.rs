//! Corners that turn over a radius, where others of the same scan are sharp (ours): the inside radii of rolled and bent sections, and
//! finished beads. Nobody welds them, and their faces beyond the radius meet in as good a line as those of a joint.
//!
//! A camera rounds corners too, but all of them: a radius is told only from the sharper corners of the same scan.

use super::input::SurfaceModel;
use super::{Contact, Found, WhyUnwelded};
use crate::geometry::statistics::median;
use nalgebra::{Point3, Vector3};

/// How far from a corner the surface between its faces is sought, voxels.
const REACH_VOXELS: f32 = 8.0;
/// Cosine between the way to the surface and the middle of the faces: along a face of a right angle it is .71, at the middle of a radius 1.
const BETWEEN: f64 = 0.85;
/// Distance between arc and corner in radii where faces meet at 150 degrees: flatter ones are bends.
const LEAST_SHARE: f64 = 0.035;
/// Corners of which this share of the length is at least as sharp show what the camera makes of a sharp one.
const SHARPEST: f64 = 0.25;
/// A radius is more than so many times as large as what the camera makes of a sharp corner: views that see corners at a slant, or from
/// farther away, round them so many times as much. And what a model of voxels leaves unknown, voxels.
const TIMES: f64 = 2.0;
const UNSURE_VOXELS: f64 = 0.5;

/// A corner as it is rounded.
struct Rounded {
    length_mm: f64,
    /// Of the arc that would leave as much between itself and the corner.
    radius_mm: f64,
    /// Distance between arc and corner in radii.
    share: f64,
    /// Whether the arc was seen along most of it, and not only that the faces were not seen any nearer.
    is_seen: bool,
}

impl Rounded {
    /// Of places and the air there; none where nothing was seen near it.
    fn of(
        places: impl Iterator<Item = (Point3<f64>, Vector3<f64>)>,
        length_mm: f64,
        model: &SurfaceModel,
    ) -> Option<Self> {
        let (mut depths_mm, mut shares, mut between) = (Vec::new(), Vec::new(), 0);
        for (place, air) in places {
            let about = Point3::from((place - model.cloud.origin_mm).cast::<f32>());
            let Some((slot, _)) = model.index.nearest(&about, REACH_VOXELS * model.voxel_mm(), |_| true)
            else {
                continue;
            };
            let depth_mm = (model.index.point(slot) - about).norm();
            let is_between = |slot: usize| {
                let off = (model.index.point(slot) - about).cast::<f64>();
                off.dot(&air) > BETWEEN * off.norm() * air.norm()
            };
            between +=
                usize::from(model.index.nearest(&about, depth_mm + model.voxel_mm(), is_between).is_some());
            depths_mm.push(f64::from(depth_mm));
            // The air is twice as long as the sine of half the included angle.
            shares.push(2.0 / air.norm() - 1.0);
        }
        let (share, depth_mm) = (median(&mut shares), median(&mut depths_mm));
        let is_seen = 2 * between > depths_mm.len();
        (share > LEAST_SHARE).then(|| Self { length_mm, radius_mm: depth_mm / share, share, is_seen })
    }
}

impl Found {
    /// Marks the seams that turn over a radius, where other corners are sharp.
    pub(crate) fn mark_radii(&mut self, model: &SurfaceModel) {
        let seams: Vec<Option<Rounded>> =
            self.seams.iter().map(|seam| Rounded::of(seam.places(), seam.length_mm(), model)).collect();
        let on_table = self.unwelded.iter().filter(|line| line.reason == WhyUnwelded::Table);
        let lines: Vec<Rounded> =
            on_table.filter_map(|line| Rounded::of(line.places(), line.length_mm(), model)).collect();
        let mut all: Vec<&Rounded> = seams.iter().flatten().chain(&lines).collect();
        all.sort_by(|a, b| a.radius_mm.total_cmp(&b.radius_mm));
        let mut left_mm = SHARPEST * all.iter().map(|corner| corner.length_mm).sum::<f64>();
        let sharpest = all.iter().find(|corner| {
            left_mm -= corner.length_mm;
            left_mm <= 0.0
        });
        let Some(camera_mm) = sharpest.map(|corner| corner.radius_mm) else { return };
        let unsure_mm = UNSURE_VOXELS * f64::from(model.voxel_mm());
        for (seam, rounded) in self.seams.iter_mut().zip(&seams) {
            let is_radius = rounded.as_ref().is_some_and(|corner| {
                corner.is_seen
                    && corner.radius_mm * corner.share > TIMES * camera_mm * corner.share + unsure_mm
            });
            if is_radius && seam.contact.is_none() {
                seam.mark_contact(Contact::Radius);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::cloud::PointCloud;
    use crate::geometry::grid::Grid;
    use crate::model::downsampling::Voxels;
    use crate::seam::{Seam, Station};

    /// A level face and an upright one of 30 mm, 100 mm long, that meet at y = `at_mm` in an arc of this radius; nothing is seen nearer to
    /// their corner than `lost_mm`.
    fn corner(at_mm: f32, radius_mm: f32, lost_mm: f32) -> Vec<Point3<f32>> {
        let from = radius_mm.max(lost_mm);
        let flat = |k: i32| from + 0.5 * k as f32;
        let arc = |k: i32| {
            let (sin, cos) = (0.05 * k as f32).sin_cos();
            [radius_mm * (1.0 - cos), radius_mm * (1.0 - sin)]
        };
        let profile = (0..40).map(|k| [flat(k), 0.0]).chain((0..40).map(|k| [0.0, flat(k)]));
        let arc = (0..=31).map(arc).filter(|_| radius_mm > lost_mm);
        let profile: Vec<[f32; 2]> = profile.chain(arc).collect();
        (0..=100)
            .flat_map(|x| profile.iter().map(move |[y, z]| Point3::new(x as f32, at_mm + y, *z)))
            .collect()
    }

    /// What seams in the corners of some such profiles are, one beside the other.
    fn contacts(profiles: &[[f32; 2]]) -> Vec<Option<Contact>> {
        let at_mm = |k: usize| 60.0 * k as f32;
        let points_mm: Vec<_> = profiles
            .iter()
            .enumerate()
            .flat_map(|(k, [radius, lost])| corner(at_mm(k), *radius, *lost))
            .collect();
        let index = Grid::new(&points_mm, 4.0);
        let normals = vec![Vector3::z(); points_mm.len()];
        let cloud = PointCloud { points_mm, normals, ..PointCloud::default() };
        let voxels = Voxels { cloud, edge_mm: 1.0, ..Voxels::default() };
        let model = SurfaceModel { voxels: &voxels, cloud: &voxels.cloud, index: &index, asymmetries: &[] };
        let seam = |k: usize| {
            let station = |x: i32| Station {
                position_mm: Point3::new(f64::from(x), at_mm(k).into(), 0.0),
                tangent: Vector3::x(),
                faces: [Vector3::z(), Vector3::y()],
            };
            Seam::through((0..=100).step_by(2).map(station).collect())
        };
        let mut found = Found { seams: (0..profiles.len()).map(seam).collect(), ..Found::default() };
        found.mark_radii(&model);
        found.seams.iter().map(|seam| seam.contact).collect()
    }

    #[test]
    fn a_radius_is_told_from_sharp_corners_beside_it() {
        assert_eq!(contacts(&[[0.0, 0.0], [8.0, 0.0]]), [None, Some(Contact::Radius)]);
        assert_eq!(contacts(&[[0.5, 0.0], [1.5, 0.0]]), [None, None], "what a camera may do to one of both");
    }

    #[test]
    fn what_is_as_round_everywhere_is_the_camera_and_what_is_lost_is_no_radius() {
        assert_eq!(contacts(&[[8.0, 0.0], [7.0, 0.0]]), [None, None]);
        assert_eq!(contacts(&[[8.0, 0.0]]), [None]);
        assert_eq!(contacts(&[[0.0, 0.0], [0.0, 5.0]]), [None, None]);
    }
}
