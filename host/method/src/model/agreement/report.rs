//! What became of each view: where it was put, how far that is from where the robot reported it, and how well it is known.

use super::{Agreement, Misfit};
use crate::geometry::cloud::View;
use crate::model::normals::Patches;
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

/// How one view was registered, or why it was left out.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ViewReport {
    /// [`View::name`].
    pub name: String,
    /// Why nothing of it is used; none of a view that fits.
    pub misfit: Option<Misfit>,
    /// The same in words, after the view's name.
    pub left_out: Option<String>,
    /// What is wrong with a view that is used all the same, after its name.
    pub complaint: Option<String>,
    /// Registered pose, mm; of a view that is left out the reported one.
    pub base_from_camera: Isometry3<f64>,
    /// The pose that the robot reported, mm.
    pub reported: Isometry3<f64>,
    /// Share of the overlapping points with a neighbour nearer than 2 mm, at the kinematic pose.
    pub fitness_before: f64,
    /// The same after registration.
    pub fitness_after: f64,
    /// The same after each iteration.
    pub fitness_per_iteration: Vec<f64>,
    /// How far the view was moved: mm at its centroid, degrees.
    pub moved_mm: f64,
    /// Rotation of the correction, degrees.
    pub moved_deg: f64,
    /// One standard deviation of its position at the work that remains against the first view that fits, mm, in the worst
    /// direction.
    pub uncertainty_mm: f64,
    /// The same of its orientation, about the worst axis, degrees.
    pub uncertainty_deg: f64,
}

impl Agreement {
    /// One report per view that was read, in their order.
    pub fn report(&self, views: &[View], patches: &[Patches]) -> Vec<ViewReport> {
        let names: Vec<&str> = views.iter().map(|view| view.name.as_str()).collect();
        let one = |k: usize| match self.kept.iter().position(|&kept| kept == k) {
            Some(place) => self.kept_report(place, &views[k], patches[k].cloud.len()),
            None => self.left_out_report(k, &views[k], &names),
        };
        (0..views.len()).map(one).collect()
    }

    fn kept_report(&self, place: usize, view: &View, patches: usize) -> ViewReport {
        let found = &self.registration;
        let done = found.base_from_camera[place] * view.base_from_camera.inverse();
        let fitness = &found.fitness[place];
        ViewReport {
            name: view.name.clone(),
            misfit: None,
            left_out: None,
            complaint: found.complaint(place, patches),
            base_from_camera: found.base_from_camera[place],
            reported: view.base_from_camera,
            fitness_before: fitness.first().copied().unwrap_or(0.0),
            fitness_after: fitness.last().copied().unwrap_or(0.0),
            fitness_per_iteration: fitness.clone(),
            moved_mm: (done * found.centre_mm - found.centre_mm).norm(),
            moved_deg: done.rotation.angle().to_degrees(),
            uncertainty_mm: found.loosest(place).0,
            uncertainty_deg: found.loosest_turn_rad(place).to_degrees(),
        }
    }

    /// What the registration knew of it before it was left out went with it.
    fn left_out_report(&self, k: usize, view: &View, names: &[&str]) -> ViewReport {
        let misfit = self.left_out.iter().find(|left| left.view == k).map(|left| left.misfit);
        ViewReport {
            name: view.name.clone(),
            misfit,
            left_out: misfit.map(|misfit| misfit.words(names)),
            complaint: None,
            base_from_camera: view.base_from_camera,
            reported: view.base_from_camera,
            fitness_before: f64::NAN,
            fitness_after: f64::NAN,
            fitness_per_iteration: Vec::new(),
            moved_mm: f64::NAN,
            moved_deg: f64::NAN,
            uncertainty_mm: f64::INFINITY,
            uncertainty_deg: f64::INFINITY,
        }
    }

    /// What the user should know about the views: which are left out, and what is wrong with the others.
    pub fn warnings(&self, views: &[View], patches: &[Patches]) -> Vec<String> {
        let names: Vec<&str> = views.iter().map(|view| view.name.as_str()).collect();
        let left_out = |left: &super::LeftOut| {
            format!("{} is left out: it {}", names[left.view], left.misfit.words(&names))
        };
        let mut warnings: Vec<String> = self.left_out.iter().map(left_out).collect();
        warnings.extend(self.registration.warnings(&self.of(views), &self.of(patches)));
        warnings
    }
}
