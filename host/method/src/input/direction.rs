//! Whether hand-eye transform and poses are given the right way round: by trying the inverse of each, and both.
//!
//! Only what the views say of each other is used: how far the points of one lie from those of another. Where the given way
//! fits, nothing else is tried.

use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;

use crate::geometry::cloud::View;

/// Edge of a cell that a view's points are sorted into, mm.
const CELL_MM: f32 = 8.0;
/// Farther apart counts as this far, mm.
const FAR_MM: f64 = 24.0;
/// Points of a view that are asked, and points that they are held against.
const ASKED: usize = 250;
const HELD: usize = 25_000;
/// Views that are looked at.
const VIEWS: usize = 8;
/// As far apart as this the given way fits: kinematic poses are off by a few mm.
pub(super) const FITS_MM: f64 = 5.0;
/// So many times better another way must be.
const CLEARLY: f64 = 2.5;
/// So many times better, and the given way round is refused: the path would be somewhere else.
pub(super) const REFUSED: f64 = 5.0;
/// Share of a view's points that must lie on the other view, for views that overlap by half.
const QUANTILE: f64 = 0.35;

/// Another way round that fits clearly better.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Better {
    pub invert_hand_eye: bool,
    pub invert_poses: bool,
    /// Distance between the views as given, and with the other way, mm.
    pub given_mm: f64,
    pub better_mm: f64,
}

impl Better {
    pub(super) fn times(&self) -> f64 {
        self.given_mm / self.better_mm.max(0.1)
    }
}

/// Tries the other ways round where the given one does not fit. `base_from_flange` has one pose for each view.
pub(super) fn better(
    views: &[View],
    base_from_flange: &[Isometry3<f64>],
    flange_from_camera: &Isometry3<f64>,
) -> Option<Better> {
    let trial = Trial::new(views, 1.0)?;
    let apart_mm = |invert_hand_eye: bool, invert_poses: bool| {
        let hand_eye = if invert_hand_eye { flange_from_camera.inverse() } else { *flange_from_camera };
        let camera =
            |pose: &Isometry3<f64>| if invert_poses { pose.inverse() * hand_eye } else { pose * hand_eye };
        trial.apart_mm(&base_from_flange.iter().map(camera).collect::<Vec<_>>())
    };
    let given_mm = apart_mm(false, false);
    if given_mm <= FITS_MM {
        return None;
    }
    let other = |(invert_hand_eye, invert_poses)| Better {
        invert_hand_eye,
        invert_poses,
        given_mm,
        better_mm: apart_mm(invert_hand_eye, invert_poses),
    };
    let tried = [(true, false), (false, true), (true, true)].map(other);
    let best = tried.into_iter().min_by(|a, b| a.better_mm.total_cmp(&b.better_mm))?;
    (best.better_mm <= FITS_MM && best.times() >= CLEARLY).then_some(best)
}

/// Views that are held against each other.
pub(super) struct Trial {
    clouds: Vec<Cells>,
    step: usize,
}

impl Trial {
    /// Of views whose points are `scale` times as far from their cameras; none of a single view.
    pub(super) fn new(views: &[View], scale: f32) -> Option<Self> {
        let step = views.len().div_ceil(VIEWS).max(1);
        let clouds: Vec<Cells> = views.par_iter().step_by(step).map(|view| Cells::new(view, scale)).collect();
        (clouds.len() > 1).then_some(Self { clouds, step })
    }

    /// How far the views are apart where their cameras have these poses, one for each view, mm.
    pub(super) fn apart_mm(&self, base_from_camera: &[Isometry3<f64>]) -> f64 {
        let poses: Vec<_> = base_from_camera.iter().step_by(self.step).copied().collect();
        apart_mm(&self.clouds, &poses)
    }
}

/// Median over the pairs of neighbouring views, and of each with the first, of how far the nearer part of one lies from the
/// other, mm.
fn apart_mm(clouds: &[Cells], base_from_camera: &[Isometry3<f64>]) -> f64 {
    let pairs: Vec<(usize, usize)> = (1..clouds.len())
        .flat_map(|i| if i == 1 { vec![(1, 0)] } else { vec![(i, i - 1), (i, 0)] })
        .collect();
    let pair = |&(i, j): &(usize, usize)| {
        let other_from_one = base_from_camera[j].inv_mul(&base_from_camera[i]);
        let (there, back) = (clouds[j].far_mm(&clouds[i].asked, &other_from_one), other_from_one.inverse());
        there.min(clouds[i].far_mm(&clouds[j].asked, &back))
    };
    let mut apart: Vec<f64> = pairs.par_iter().map(pair).collect();
    apart.sort_unstable_by(f64::total_cmp);
    apart.get((apart.len() - 1) / 2).copied().unwrap_or(FAR_MM)
}

/// Points of a view, sorted.
struct Cells {
    grid: crate::geometry::grid::Grid,
    asked: Vec<Point3<f32>>,
}

impl Cells {
    fn new(view: &View, scale: f32) -> Self {
        let every = |count: usize| -> Vec<Point3<f32>> {
            let step = (view.points_mm.len() / count).max(1);
            view.points_mm.iter().step_by(step).map(|p| p * scale).collect()
        };
        Self { grid: crate::geometry::grid::Grid::new(&every(HELD), CELL_MM), asked: every(ASKED) }
    }

    /// Quantile of the distances of `points`, moved into this view's frame, mm.
    fn far_mm(&self, points: &[Point3<f32>], own_from_other: &Isometry3<f64>) -> f64 {
        let far = |p: &Point3<f32>| {
            let moved: Point3<f32> = (own_from_other * p.cast::<f64>()).cast();
            let nearest = self.grid.nearest(&moved, FAR_MM as f32, |_| true);
            nearest.map_or(FAR_MM, |(_, squared)| f64::from(squared).sqrt())
        };
        let mut distances: Vec<f64> = points.iter().map(far).collect();
        distances.sort_unstable_by(f64::total_cmp);
        distances.get((QUANTILE * distances.len() as f64) as usize).copied().unwrap_or(FAR_MM)
    }
}
