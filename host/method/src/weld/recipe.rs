//! How one pass is welded: every path modifier in the order in which they are applied.

use super::cornering::{Cornering, corner};
use super::ends::{directions, dwell, extend, lead, reverse};
use super::offset::offset;
use super::resampling::{Sampling, resample};
use super::standoff::standoff;
use super::stitching::{Stitching, stitch};
use super::weave::{Weave, weave};
use super::{SeamPath, angles};

/// Values of all modifiers. What is 0 or none changes nothing.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Recipe {
    /// Uniform spacing; none leaves the points as they are.
    pub sampling: Option<Sampling>,
    /// From end to start.
    pub reverse: bool,
    /// Longer, or shorter if negative, at the start, mm.
    pub extend_start_mm: f64,
    /// The same at the end, mm.
    pub extend_end_mm: f64,
    /// What happens at corners.
    pub corner: Cornering,
    /// Radius of the arc in place of a corner, mm.
    pub corner_radius_mm: f64,
    /// To the right of the direction that the seam has before `reverse`, mm.
    pub across_mm: f64,
    /// Out of the work, mm.
    pub out_mm: f64,
    /// How the tip swings.
    pub weave: Weave,
    /// Toward the right of the travel, rad.
    pub work_angle_rad: f64,
    /// Positive pushes, negative drags, rad.
    pub travel_angle_rad: f64,
    /// About the torch axis, rad.
    pub turn_rad: f64,
    /// Along the torch axis, mm.
    pub standoff_mm: f64,
    /// Which stretches are welded.
    pub stitch: Stitching,
    /// Standing still where an arc is struck, s.
    pub start_dwell_s: f64,
    /// Standing still where it is put out, s.
    pub end_dwell_s: f64,
    /// Before the start, arc off, mm.
    pub lead_in_mm: f64,
    /// Beyond the end, arc off, mm.
    pub lead_out_mm: f64,
}

/// The path of one pass. Empty if shortening leaves nothing.
///
/// First the line: direction, ends, spacing, corners, pass. Then, still in the frame of the seam, the weave; then the torch leans
/// about its tip and is lifted along its own axis; last it is said where the arc burns.
///
/// ```
/// use nalgebra::{Point3, UnitQuaternion};
/// use weldpath_method::weld::{PathPoint, Process, SeamPath};
/// use weldpath_method::weld::recipe::{Recipe, apply};
/// use weldpath_method::weld::resampling::Sampling;
///
/// let at = |x_mm: f64| PathPoint {
///     s_mm: x_mm,
///     position_mm: Point3::new(x_mm, 0.0, 0.0),
///     base_from_torch: UnitQuaternion::identity(),
///     process: Process::default(),
/// };
/// let path = SeamPath { seam: 1, points: vec![at(0.0), at(30.0)] };
/// let sampling = Some(Sampling::SpacingMm(5.0));
/// let recipe = Recipe { sampling, standoff_mm: 12.0, ..Recipe::default() };
/// let pass = apply(&path, &recipe);
/// assert_eq!(pass.points.len(), 7);
/// assert!(pass.points.iter().all(|point| point.position_mm.z == 12.0));
/// ```
pub fn apply(path: &SeamPath, recipe: &Recipe) -> SeamPath {
    let path = if recipe.reverse { reverse(path) } else { path.clone() };
    let path = extend(&path, recipe.extend_start_mm, recipe.extend_end_mm);
    let path = recipe.sampling.map_or_else(|| path.clone(), |sampling| resample(&path, sampling));
    let path = corner(&path, recipe.corner, recipe.corner_radius_mm);
    let across_mm = if recipe.reverse { -recipe.across_mm } else { recipe.across_mm };
    let path = offset(path, across_mm, recipe.out_mm);
    let ends = directions(&path);
    let path = weave(&path, &recipe.weave);
    let path = angles::work_angle(path, recipe.work_angle_rad);
    let path = angles::travel_angle(path, recipe.travel_angle_rad);
    let path = angles::turn(path, recipe.turn_rad);
    let path = standoff(path, recipe.standoff_mm);
    let path = stitch(&path, &recipe.stitch);
    let path = dwell(path, recipe.start_dwell_s, recipe.end_dwell_s);
    ends.map_or_else(|| path.clone(), |ends| lead(&path, &ends, recipe.lead_in_mm, recipe.lead_out_mm))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::weld::weave::Shape;
    use crate::weld::{PathPoint, Process};
    use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};

    /// Along +x on a level table, 40 mm; right of the travel is -y.
    fn line() -> SeamPath {
        let axes = Matrix3::from_columns(&[-Vector3::y(), Vector3::x(), Vector3::z()]);
        let base_from_torch = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        let at = |i: i32| PathPoint {
            s_mm: f64::from(i),
            position_mm: Point3::new(f64::from(i), 0.0, 0.0),
            base_from_torch,
            process: Process::default(),
        };
        SeamPath { seam: 1, points: (0..=40).map(at).collect() }
    }

    #[test]
    fn a_recipe_of_nothing_changes_nothing() {
        assert_eq!(apply(&line(), &Recipe::default()), line());
    }

    #[test]
    fn a_lead_follows_the_line_and_not_the_weave() {
        let weave = Weave {
            shape: Shape::Zigzag,
            amplitude_mm: 3.0,
            wavelength_mm: 4.0,
            height_mm: 0.0,
            dwell_left_s: 0.0,
            dwell_right_s: 0.0,
        };
        let recipe = Recipe { weave, lead_in_mm: 9.0, lead_out_mm: 5.0, ..Recipe::default() };
        let points = apply(&line(), &recipe).points;
        let ends = [points[0].position_mm, points[points.len() - 1].position_mm];
        assert!((ends[0] - Point3::new(-9.0, 0.0, 0.0)).norm() < 1e-9, "{ends:?}");
        assert!((ends[1] - Point3::new(45.0, 0.0, 0.0)).norm() < 1e-9, "{ends:?}");
    }

    #[test]
    fn a_reversed_pass_lies_on_the_same_side_of_the_seam() {
        for reverse in [false, true] {
            let pass = apply(&line(), &Recipe { reverse, across_mm: 4.0, ..Recipe::default() });
            assert!(pass.points.iter().all(|point| (point.position_mm.y + 4.0).abs() < 1e-9));
            assert_eq!(pass.points[0].position_mm.x > 20.0, reverse);
        }
    }
}
