//! `path.csv`: the seam points alone, one row each, for spreadsheets and scoring.

use std::fmt::Write;

use super::frame::PathFrame;
use weldpath_method::weld::SeamPath;

/// First line of the file; [`FRAME`] follows where the coordinates are those of a camera.
pub const HEADER: &str = "seam,index,s_mm,x_mm,y_mm,z_mm,qw,qx,qy,qz";

/// Name of the column that says whose frame the coordinates are in.
pub const FRAME: &str = "frame";

/// The welded points of `paths`, passes one after the other; `index` counts from 0 in each pass. The coordinates are those of
/// `frame`; `q` is `base_from_torch`.
///
/// ```
/// use nalgebra::{Point3, UnitQuaternion};
/// use weldpath_method::weld::{PathPoint, Process, SeamPath};
/// use weldpath_job::output::{csv, frame::PathFrame};
///
/// let at = |x_mm: f64| PathPoint {
///     s_mm: x_mm,
///     position_mm: Point3::new(x_mm, 0.0, 0.0),
///     base_from_torch: UnitQuaternion::identity(),
///     process: Process::default(),
/// };
/// let path = SeamPath { seam: 1, points: vec![at(0.0), at(30.0)] };
/// assert_eq!(csv::write(&[path], PathFrame::Base).lines().next(), Some(csv::HEADER));
/// ```
pub fn write(paths: &[SeamPath], frame: PathFrame) -> String {
    let [title, cell] = match frame {
        PathFrame::Camera => [FRAME, frame.name()].map(|name| format!(",{name}")),
        PathFrame::Base | PathFrame::Unknown => [String::new(), String::new()],
    };
    let mut text = format!("{HEADER}{title}\n");
    for path in paths {
        for (index, point) in path.points.iter().filter(|point| point.process.weld).enumerate() {
            let (p, q) = (point.position_mm, point.base_from_torch);
            // Writing to a String cannot fail.
            let _ = writeln!(
                text,
                "{},{index},{:.5},{:.5},{:.5},{:.5},{:.9},{:.9},{:.9},{:.9}{cell}",
                path.seam, point.s_mm, p.x, p.y, p.z, q.w, q.i, q.j, q.k
            );
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, UnitQuaternion, Vector3};
    use weldpath_method::weld::{PathPoint, Process};

    #[test]
    fn every_row_has_a_number_for_every_column() {
        let base_from_torch = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 1.0);
        let (position_mm, process) = (Point3::new(-1.0, 2000.125, 1e-7), Process::default());
        let point = PathPoint { s_mm: 1.5, position_mm, base_from_torch, process };
        let path = |seam| SeamPath { seam, points: vec![point; 3] };
        let text = write(&[path(1), path(4)], PathFrame::Base);
        let mut lines = text.lines();
        assert_eq!(lines.next(), Some(HEADER));
        let rows: Vec<Vec<f64>> =
            lines.map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect()).collect();
        assert_eq!(rows.len(), 6);
        assert!(rows.iter().all(|row| row.len() == HEADER.split(',').count()));
        assert_eq!(rows[4][..6], [4.0, 1.0, 1.5, -1.0, 2000.125, 0.0]);
        assert!((rows[0][6] - 0.5f64.cos()).abs() < 1e-9 && (rows[0][7] - 0.5f64.sin()).abs() < 1e-9);
    }

    #[test]
    fn every_row_in_the_cameras_frame_says_so() {
        let (position_mm, process) = (Point3::origin(), Process::default());
        let point =
            PathPoint { s_mm: 0.0, position_mm, base_from_torch: UnitQuaternion::identity(), process };
        let text = write(&[SeamPath { seam: 1, points: vec![point; 2] }], PathFrame::Camera);
        let last = |line: &str| line.rsplit(',').next().map(str::to_owned);
        assert_eq!(text.lines().filter_map(last).collect::<Vec<_>>(), [FRAME, "camera", "camera"]);
    }
}
