//! How far each path point is from the seam it belongs to.

use super::seam_score::BEYOND_MM;
use super::{CORNER_MM, Nearest, Options, PathSet, Truth, projection};
use serde::Serialize;

/// One path point against the nearest true seam.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Deviation {
    /// Distance across the seam, mm; none where the point belongs to no seam or lies beyond its end.
    pub lateral_mm: Option<f64>,
    /// Angle between the torch axis and the true one, degrees; none as above, between two seams, or where the path has no orientation.
    pub axis_deg: Option<f64>,
}

/// One deviation per path point, in order.
pub fn deviations(paths: &PathSet, truth: &Truth, options: &Options) -> Vec<Deviation> {
    let points = paths.without_standoff(options.standoff_mm);
    let lines: Vec<&[[f64; 3]]> = truth.seams.iter().map(|seam| seam.line(options.target)).collect();
    let none = Deviation { lateral_mm: None, axis_deg: None };
    let of = |i: usize| {
        let nearest = Nearest::of(&points[i], &lines);
        let Some(seam) = truth.seams.get(nearest.seam).filter(|_| nearest.distance_mm <= options.near_mm)
        else {
            return none.clone();
        };
        let foot = projection::foot(seam, lines[nearest.seam], &points[i]);
        let gap = points[i] - foot.point;
        let along_mm = gap.dot(&foot.frame.column(1));
        if along_mm.abs() > BEYOND_MM {
            return none.clone();
        }
        let frames = paths.frames.as_ref().filter(|_| nearest.second_mm > CORNER_MM);
        let axis = frames.map(|frames| frames[i].column(2).dot(&foot.frame.column(2)));
        let lateral_mm = (gap.norm_squared() - along_mm * along_mm).max(0.0).sqrt();
        Deviation {
            lateral_mm: Some(lateral_mm),
            axis_deg: axis.map(|c| c.clamp(-1.0, 1.0).acos().to_degrees()),
        }
    };
    (0..points.len()).map(of).collect()
}
