//! From an ordered seam to torch poses (paper II-F), and from those to a complete program.
//!
//! The welding vocabulary are path modifiers, `SeamPath -> SeamPath`: [`resampling`], [`ends`], [`cornering`],
//! [`offset`], [`weave`], [`angles`], [`standoff`], [`stitching`]; [`recipe`] applies them in their order. [`ordering`]
//! says which seam comes next and which way; [`program`] adds what a robot needs around the seams: approach, air
//! moves, retract, feeds, weld flags. `docs/welding.md` shows each.

pub mod air;
pub mod angles;
pub mod cornering;
pub mod ends;
pub mod offset;
pub mod ordering;
pub mod pass;
pub mod position;
pub mod program;
pub mod recipe;
pub mod resampling;
pub mod standoff;
pub mod stitching;
pub mod torch;
pub mod weave;

use nalgebra::{Point3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use weldpath_core::path::interpolation::position_between;

/// One pose of the torch on its seam.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PathPoint {
    /// Distance along the seam, mm.
    pub s_mm: f64,
    /// Tip of the wire, mm, base frame.
    pub position_mm: Point3<f64>,
    /// Columns `(o, m, n)`: `n` out of the work, `m` along the travel, `o = m × n`, to the right of it.
    pub base_from_torch: UnitQuaternion<f64>,
    /// What is done here, and on the move that ends here.
    pub process: Process,
}

/// What the torch does at a point of its path, and on the move that ends there.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Process {
    /// Whether the arc burns between this point and a neighbour that says so too.
    pub weld: bool,
    /// How long the torch stands still here, s; 0 stops exactly and goes on, none passes without a stop.
    pub dwell_s: Option<f64>,
    /// Speed of the move that ends here, in multiples of the feed: a weave goes a longer way in the same time.
    pub feed_factor: f64,
}

impl Default for Process {
    fn default() -> Self {
        Self { weld: true, dwell_s: None, feed_factor: 1.0 }
    }
}

impl PathPoint {
    /// `o`, to the right of the travel as seen by one who looks along it with `n` upright, base frame.
    pub(crate) fn right_of_travel(&self) -> Vector3<f64> {
        self.base_from_torch * Vector3::x()
    }

    /// `m`, along the travel, base frame.
    pub(crate) fn along_travel(&self) -> Vector3<f64> {
        self.base_from_torch * Vector3::y()
    }

    /// `n`, the torch axis out of the work, base frame.
    pub fn out_of_work(&self) -> Vector3<f64> {
        self.base_from_torch * Vector3::z()
    }
}

/// The torch path of one seam, as long as the seam; a closed path ends where it began.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SeamPath {
    /// [`crate::seam::Seam::id`].
    pub seam: usize,
    /// In weld order.
    pub points: Vec<PathPoint>,
}

impl SeamPath {
    /// Length of the polyline, mm.
    pub fn length_mm(&self) -> f64 {
        self.points.windows(2).map(|w| (w[1].position_mm - w[0].position_mm).norm()).sum()
    }

    /// Whether the path ends where it began.
    pub(crate) fn is_closed(&self) -> bool {
        match self.points.as_slice() {
            [first, _, .., last] => (first.position_mm - last.position_mm).norm() < SAME_PLACE_MM,
            _ => false,
        }
    }

    /// The same seam with other points.
    fn with(&self, points: Vec<PathPoint>) -> Self {
        Self { seam: self.seam, points }
    }
}

/// Points nearer than this are one place, mm.
const SAME_PLACE_MM: f64 = 1e-6;

/// The pose at `alpha` (0..1) of the move from `a` to `b`: linear, and the shortest way round (paper II-F, in double
/// precision). It belongs to the move that ends at `b`, without a stop.
///
/// The rotation is nalgebra's slerp, which differs from core's by less than 1e-7 rad: the ninth digit of path.csv hangs on it.
fn between(a: &PathPoint, b: &PathPoint, alpha: f64) -> PathPoint {
    let nearer = if alpha < 0.5 { a } else { b };
    let turned = a.base_from_torch.try_slerp(&b.base_from_torch, alpha, 1e-9);
    PathPoint {
        s_mm: a.s_mm + (b.s_mm - a.s_mm) * alpha,
        position_mm: position_between(&a.position_mm, &b.position_mm, alpha),
        base_from_torch: turned.unwrap_or(nearer.base_from_torch),
        process: Process { dwell_s: None, ..b.process },
    }
}

/// The pose at `s_mm` of points whose `s_mm` does not fall; the ends beyond them. None without points.
fn at(points: &[PathPoint], s_mm: f64) -> Option<PathPoint> {
    let next = points.partition_point(|p| p.s_mm <= s_mm);
    match (next.checked_sub(1).and_then(|k| points.get(k)), points.get(next)) {
        (Some(a), Some(b)) => {
            let alpha = (s_mm - a.s_mm) / (b.s_mm - a.s_mm);
            Some(if alpha > 0.0 { between(a, b, alpha) } else { *a })
        }
        (only, other) => only.or(other).copied(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;
    use weldpath_core::rotation::Arc;

    #[test]
    fn the_pose_between_two_is_that_of_core() {
        let point = |turn: [f64; 3]| PathPoint {
            s_mm: 0.0,
            position_mm: Point3::origin(),
            base_from_torch: UnitQuaternion::from_scaled_axis(Vector3::from(turn)),
            process: Process::default(),
        };
        // A torch that points down, a small turn, a turn below what slerp resolves, and the other sign of a quaternion.
        let mut signed = point([0.2, 3.0, 0.1]);
        signed.base_from_torch = UnitQuaternion::new_unchecked(-signed.base_from_torch.into_inner());
        let to = [point([0.1, 3.1, 0.2]), point([0.0, 3.1301, 0.0]), point([0.0, 3.13, 1e-9]), signed];
        let from = point([0.0, 3.13, 0.0]);
        for (to, alpha) in to.iter().flat_map(|to| [0.1, 0.5, 0.93].map(|alpha| (to, alpha))) {
            let core = Arc::between(&from.base_from_torch, &to.base_from_torch).slerp(alpha);
            let turn = (core.inverse() * between(&from, to, alpha).base_from_torch).imag().norm() * 2.0;
            assert!(turn < 1e-7, "{turn} rad at {alpha}");
        }
    }
}
