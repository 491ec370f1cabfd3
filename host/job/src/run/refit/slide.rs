//! Motions that surfaces hardly hinder, such as along a straight groove: followed step by step, and decided by what faces
//! along them, or said to be unknown.

use nalgebra::{Isometry3, SymmetricEigen, Vector6};
use rayon::prelude::*;

use super::alignment::{about, size_mm, step};
use super::part::{Part, Patch, strided};
use super::search::apart_mm;
use super::target::{Target, fit, share};
use super::{Error, FOUND_MM, NEARLY, RANGE_MM, SLACK, is_near};
use weldpath_method::geometry::point_to_plane::row_at_size;

/// Share of information, of a motion that every pair sees in full, below which a motion is examined step by step.
const HARDLY_SEEN: f64 = 0.05;
/// Stride of a weld point along a motion that is examined, mm.
const STRIDE_MM: f64 = 1.5;
const TRAIL_POINTS: usize = 1000;
/// Least part of a patch's normal along a motion for which it counts as facing along it.
const FACING: f64 = 0.5;
/// Fewer patches than this do not decide where the part is, nor patches of which less than this share fits.
const LEAST_FACING: usize = 40;
const LEAST_FIT: f64 = 0.35;
/// Places whose fit is this share of the best one's are possible too.
const RIVAL: f64 = 0.8;
/// Possible places this near to each other are one, mm at a weld point.
const ONE_PLACE_MM: f64 = 5.0;

/// Motions, as [`step`] has them, that the surfaces hardly hinder, the freest last.
pub(super) fn hardly_seen(part: &Part, target: &Target, pose: &Isometry3<f64>) -> Vec<Vector6<f64>> {
    let (some, middle) = (strided(&part.surface, TRAIL_POINTS), pose * part.centre);
    let size_mm = size_mm(&some, &part.centre);
    let Some((_, information)) = step(&some, target, pose, &middle, size_mm, 2.5, None) else {
        return vec![];
    };
    let eigen = SymmetricEigen::new(information);
    let axes = eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter());
    let mut free: Vec<_> = axes.filter(|(seen, _)| **seen < HARDLY_SEEN).collect();
    free.sort_by(|a, b| b.0.total_cmp(a.0));
    free.into_iter().map(|(_, axis)| axis.into_owned()).collect()
}

/// Where along a motion the part is.
pub(super) struct Settled {
    pub(super) pose: Isometry3<f64>,
    pub(super) known: bool,
    pub(super) warning: Option<String>,
}

/// Decides how far the part went along `axis`, of the places before and after `pose`.
pub(super) fn settle(
    part: &Part,
    target: &Target,
    pose: &Isometry3<f64>,
    axis: &Vector6<f64>,
) -> Result<Settled, Error> {
    let some = strided(&part.surface, TRAIL_POINTS);
    let ends = facing(part, pose, axis);
    let mut poses = trail(&some, part, target, pose, axis);
    poses.extend(trail(&some, part, target, pose, &-axis));
    poses.push(*pose);
    let fits: Vec<f64> = poses.par_iter().map(|pose| fit(&ends, target, pose)).collect();
    let peak = fits.iter().copied().fold(0.0, f64::max);
    let decisive = ends.len() >= LEAST_FACING && peak >= LEAST_FIT;
    let qualities: Vec<f64> = match decisive {
        true => fits.iter().map(|fit| fit / peak).collect(),
        false => poses.par_iter().map(|pose| share(&some, target, pose, FOUND_MM)).collect(),
    };
    let best = qualities.iter().copied().fold(0.0, f64::max);
    let least = if decisive { RIVAL } else { best - NEARLY };
    let rated = qualities.iter().copied().zip(poses.iter().copied());
    let rivals: Vec<(f64, Isometry3<f64>)> = rated.filter(|(quality, _)| *quality >= least).collect();
    let top = rivals.iter().max_by(|a, b| a.0.total_cmp(&b.0)).map_or(*pose, |rival| rival.1);
    let rival_poses = || rivals.iter().map(|rival| &rival.1);
    let from_top_mm = rival_poses().map(|rival| apart_mm(rival, &top, &part.welds)).fold(0.0, f64::max);
    let motion = in_words(axis);
    if from_top_mm <= ONE_PLACE_MM {
        let warning = || {
            format!(
                "only the ends of the part show how far it moved in one direction ({motion}): check where \
                 the welds begin and end"
            )
        };
        return Ok(Settled { pose: top, known: true, warning: decisive.then(warning) });
    }
    let still = Isometry3::identity();
    let moved_mm = |pose: &Isometry3<f64>| apart_mm(pose, &still, &part.welds);
    let pose = *rival_poses().min_by(|a, b| moved_mm(a).total_cmp(&moved_mm(b))).unwrap_or(&top);
    let spread_mm = rival_poses().map(|rival| apart_mm(rival, &pose, &part.welds)).fold(0.0, f64::max);
    let least_mm = poses.iter().map(moved_mm).fold(f64::INFINITY, f64::min);
    if moved_mm(&pose) > least_mm + ONE_PLACE_MM {
        return Err(Error::Ambiguous { motion, spread_mm });
    }
    let warning = format!(
        "UNKNOWN: the scan does not show how far the part moved in one direction ({motion}): weld points may \
         be {spread_mm:.0} mm off along it. The smallest motion was taken; check where the welds begin and \
         end before the program is run"
    );
    Ok(Settled { pose, known: false, warning: Some(warning) })
}

fn in_words(axis: &Vector6<f64>) -> String {
    let (turn, shift) = (axis.fixed_rows::<3>(0), axis.fixed_rows::<3>(3));
    let (what, v) = if turn.norm() > shift.norm() { ("turn about", turn) } else { ("move along", shift) };
    let v = v.normalize();
    format!("{what} ({:.2}, {:.2}, {:.2})", v.x, v.y, v.z)
}

/// Poses along a motion, one stride after another, held against the surfaces in all other directions.
fn trail(
    some: &[Patch],
    part: &Part,
    target: &Target,
    pose: &Isometry3<f64>,
    axis: &Vector6<f64>,
) -> Vec<Isometry3<f64>> {
    let size_mm = size_mm(some, &part.centre);
    let moved = |pose: &Isometry3<f64>, by: &Vector6<f64>| {
        let turn = by.fixed_rows::<3>(0) / size_mm;
        about(&(pose * part.centre), &turn, &by.fixed_rows::<3>(3).into_owned()) * pose
    };
    let held = |pose: Isometry3<f64>| {
        let step = step(some, target, &pose, &(pose * part.centre), size_mm, 4.0, Some(axis));
        step.map_or(pose, |(step, _)| moved(&pose, &step))
    };
    let next = |pose: &Isometry3<f64>| Some(held(held(moved(pose, &(axis * STRIDE_MM)))));
    // Twice the range and its slack: the pose to start from may lie at one end of it.
    let most = (4.0 * SLACK * RANGE_MM / STRIDE_MM) as usize;
    let poses = std::iter::successors(next(pose), next).take(most);
    poses.take_while(|pose| is_near(pose, &part.centre)).collect()
}

/// Surfaces and edges that face along a motion.
fn facing(part: &Part, pose: &Isometry3<f64>, axis: &Vector6<f64>) -> Vec<Patch> {
    let (middle, size_mm) = (pose * part.centre, size_mm(&part.surface, &part.centre));
    let faces = |(p, n): &&Patch| {
        let (arm, normal) = (pose * p - middle, pose.rotation * n);
        row_at_size(&arm, &normal, size_mm).dot(axis).abs() > FACING
    };
    let all: Vec<Patch> = part.surface.iter().chain(&part.edges).filter(faces).copied().collect();
    strided(&all, TRAIL_POINTS)
}
