//! Pictures of `docs/welding.md`: what the planner makes of an example on a small workpiece, as SVG.
//!
//! The moves are those of the finished program, so a picture shows what a robot would do. Orange: the arc burns. Blue,
//! dashed: it does not. Grey: the seam and the plates. Dots: the torch stands still. Dark strokes: the torch.

use std::fmt::Write;

use nalgebra::{Point3, Vector3};
use weldpath::run::job::Job;
use weldpath::run::job::quantity::ApproachMm;
use weldpath::run::postprocessing::postprocess;
use weldpath::weld::program::{Kind, Waypoint, segments};

use crate::plans;

/// From where the workpiece is looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum From {
    /// From the front, the right and above.
    Aslant,
    /// Along the travel: the section of the joint.
    Behind,
    /// Square to the travel, along the base plate.
    Side,
    /// Into the work along the torch.
    Torch,
}

/// Longest torch that is drawn, mm.
const TORCH_MM: f64 = 16.0;
/// Travel between two torches that are drawn, mm.
const TORCHES_MM: f64 = 16.0;
/// Approach and retract where the example says nothing of them, mm.
const APPROACH_MM: f64 = 12.0;
/// Pixels in a millimetre.
const SCALE: f64 = 5.0;

/// The picture of a job; `bent` shows a seam that turns a corner.
///
/// # Panics
/// If the job selects a seam that the workpiece does not have.
pub fn picture(job: &Job, bent: bool, from: From) -> String {
    let mut job = job.clone();
    job.path.approach_mm = job.path.approach_mm.or(ApproachMm::try_from(APPROACH_MM).ok());
    let plan = plans::corner_of_plates(bent);
    let waypoints = postprocess(&plan, &job, Default::default()).expect("a seam").program.waypoints;
    let seam: Vec<Point3<f64>> = plan.paths[0].points.iter().map(|point| point.position_mm).collect();
    let mut drawing = Drawing { from, shapes: Vec::new() };
    drawing.plates(bent);
    drawing.line(&seam, "stroke='#999' stroke-width='1.5' fill='none'");
    drawing.moves(&waypoints);
    drawing.torches(&waypoints);
    drawing.stops(&waypoints);
    drawing.svg()
}

struct Drawing {
    from: From,
    shapes: Vec<(Vec<[f64; 2]>, String)>,
}

impl Drawing {
    fn on_paper(&self, p: &Point3<f64>) -> [f64; 2] {
        let along = |a: [f64; 3]| Vector3::from(a).dot(&p.coords) * SCALE;
        let half = std::f64::consts::FRAC_1_SQRT_2;
        match self.from {
            From::Aslant => [along([0.95, 0.35, 0.0]), along([0.12, -0.4, -0.9])],
            From::Behind => [along([0.0, -1.0, 0.0]), along([0.0, 0.0, -1.0])],
            From::Side => [along([1.0, 0.0, 0.0]), along([0.0, 0.0, -1.0])],
            From::Torch => [along([1.0, 0.0, 0.0]), along([0.0, -half, -half])],
        }
    }

    fn line(&mut self, points: &[Point3<f64>], style: &str) {
        let points = points.iter().map(|p| self.on_paper(p)).collect();
        self.shapes.push((points, format!("<polyline points='@' {style}/>")));
    }

    fn face(&mut self, corners: &[[f64; 3]], fill: &str) {
        let points = corners.iter().map(|c| self.on_paper(&Point3::from(*c))).collect();
        self.shapes.push((points, format!("<polygon points='@' fill='{fill}' stroke='#ccc'/>")));
    }

    fn plates(&mut self, bent: bool) {
        let (x, y, z) = (plans::PLATES_MM[0], -plans::PLATES_MM[1], plans::PLATES_MM[2]);
        self.face(&[[0.0, 0.0, 0.0], [x, 0.0, 0.0], [x, y, 0.0], [0.0, y, 0.0]], "#eef0f2");
        self.face(&[[0.0, 0.0, 0.0], [x, 0.0, 0.0], [x, 0.0, z], [0.0, 0.0, z]], "#e2e6ea");
        if bent {
            self.face(&[[x, 0.0, 0.0], [x, y, 0.0], [x, y, z], [x, 0.0, z]], "#d8dde2");
        }
    }

    fn moves(&mut self, waypoints: &[Waypoint]) {
        let (hot, cold) = (
            "stroke='#e2611a' stroke-width='3' fill='none' stroke-linejoin='round'",
            "stroke='#2b6cb0' stroke-width='1.5' stroke-dasharray='5 4' fill='none'",
        );
        let burning: Vec<bool> = segments(waypoints).map(|segment| segment.weld).collect();
        for (pair, weld) in waypoints.windows(2).zip(burning) {
            if pair.iter().all(|waypoint| waypoint.kind != Kind::Air) {
                self.line(&[pair[0].position_mm, pair[1].position_mm], if weld { hot } else { cold });
            }
        }
    }

    fn torches(&mut self, waypoints: &[Waypoint]) {
        let mut last: Option<Point3<f64>> = None;
        for waypoint in waypoints.iter().filter(|waypoint| waypoint.weld) {
            let tip = waypoint.position_mm;
            if last.is_none_or(|last| (tip - last).norm() >= TORCHES_MM) {
                let n = waypoint.base_from_torch * Vector3::z();
                let m = waypoint.base_from_torch * Vector3::y();
                let at = |mm: f64| tip + n * mm;
                self.line(&[at(0.0), at(TORCH_MM)], "stroke='#333' stroke-width='1' fill='none'");
                self.line(&[at(0.3 * TORCH_MM), at(TORCH_MM)], "stroke='#333' stroke-width='4' fill='none'");
                let cable = [at(TORCH_MM), at(TORCH_MM) - m * 3.0];
                self.line(&cable, "stroke='#333' stroke-width='2' fill='none'");
                last = Some(tip);
            }
        }
    }

    fn stops(&mut self, waypoints: &[Waypoint]) {
        for waypoint in waypoints.iter().filter(|waypoint| waypoint.dwell_s.is_some()) {
            let centre = self.on_paper(&waypoint.position_mm);
            self.shapes.push((vec![centre], "<circle cx='@x' cy='@y' r='4' fill='#b00020'/>".into()));
        }
    }

    /// All shapes, moved so that they fill the sheet.
    fn svg(&self) -> String {
        let places = || self.shapes.iter().flat_map(|(points, _)| points);
        let least = |k: usize| places().map(|p| p[k]).fold(f64::INFINITY, f64::min) - 8.0;
        let most = |k: usize| places().map(|p| p[k]).fold(f64::NEG_INFINITY, f64::max) + 8.0;
        let low = [least(0), least(1)];
        let mut svg = format!(
            "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {:.0} {:.0}' width='{0:.0}' height='{1:.0}'>\n\
             <rect width='100%' height='100%' fill='white'/>\n",
            most(0) - low[0],
            most(1) - low[1]
        );
        for (points, shape) in &self.shapes {
            let mut text = String::new();
            for p in points {
                // Writing to a String cannot fail. Plus zero: there is no minus zero on paper.
                let [u, v] = [0, 1].map(|k| ((p[k] - low[k]) * 10.0).round() / 10.0 + 0.0);
                let _ = write!(text, "{u:.1},{v:.1} ");
            }
            let (x, y) = text.trim().split_once(',').unwrap_or_default();
            let _ = writeln!(svg, "{}", shape.replace("@x", x).replace("@y", y).replace('@', text.trim()));
        }
        svg + "</svg>\n"
    }
}
