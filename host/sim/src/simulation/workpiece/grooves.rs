//! V grooves: two plates side by side, both bevelled or one, straight or along an S with a crown.

use super::{Draw, Request, TrueSeam, TrueStation, Viewpoint, Views, Workpiece};
use crate::simulation::rotation::{from_columns, sin_cos, sin_cos_deg};
use crate::simulation::solid::{Convex, Solid};
use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use std::f64::consts::PI;

/// Cross-section of a groove, mm.
struct Groove {
    thick: f64,
    gap: f64,
    root_face: f64,
    /// Tangent of half the included angle.
    slope: f64,
    /// Normals of the two bevels in (y, z): at +y, at -y.
    faces: [Vector3<f64>; 2],
}

impl Groove {
    fn draw(draw: &mut Draw, included_deg: f64, opening_mm: Option<f64>, thickness_mm: Option<f64>) -> Self {
        let thick = draw.between_or("T", [8.0, 10.0], thickness_mm);
        let drawn = draw.between("gap", 1.2, 1.8);
        let gap = draw.given("gap", opening_mm.unwrap_or(drawn));
        let root_face = draw.between("root_face", 0.6, 1.0);
        let (sin, cos) = sin_cos_deg(0.5 * draw.given("included", included_deg));
        let faces = [Vector3::new(0.0, -cos, sin), Vector3::new(0.0, cos, sin)];
        Self { thick, gap, root_face, slope: sin / cos, faces }
    }

    /// Height of the line where the bevels would meet.
    fn apex(&self) -> f64 {
        self.root_face - self.root()
    }

    /// Height of the root opening above the apex.
    fn root(&self) -> f64 {
        0.5 * self.gap / self.slope
    }

    /// Outline in (y, z) of the plate at +y, out to `reach`; `heights` are measured from `below` zero.
    fn plate(&self, reach: f64, zero: f64) -> [[f64; 2]; 5] {
        let (root, lip) = (0.5 * self.gap, self.slope * (self.thick - self.apex()));
        let (bottom, land, top) = (-zero, self.root_face - zero, self.thick - zero);
        [[root, bottom], [reach, bottom], [reach, top], [lip, top], [root, land]]
    }

    fn mirrored(outline: [[f64; 2]; 5]) -> [[f64; 2]; 5] {
        let mut other = outline.map(|[y, z]| [-y, z]);
        other.reverse();
        other
    }
}

/// Two bevelled plates, at 60 degrees between the bevels unless told otherwise.
pub(super) fn butt_v(draw: &mut Draw, request: &Request) -> Workpiece {
    let groove =
        Groove::draw(draw, request.angle_deg.unwrap_or(60.0), request.root_opening_mm, request.thickness_mm);
    let half = 0.5 * request.length_mm.unwrap_or(500.0);
    let outline = groove.plate(75.0, 0.0);
    let solids = [outline, Groove::mirrored(outline)].map(|o| Convex::prism(&o, -half, half).into());
    let end = |x| Point3::new(x, 0.0, groove.apex());
    let seam =
        TrueSeam::straight("groove", end(-half), end(half), groove.faces, true).with_root(groove.root());
    let far = 420.0_f64.min(200.0 + half);
    let view = |along: f64, azimuth_deg, elevation_deg| Viewpoint {
        azimuth_deg,
        elevation_deg,
        distance_mm: far,
        target: Point3::new(along * half, 0.0, groove.thick),
    };
    let viewpoints = vec![
        view(-0.5, 20.0, 82.0),
        view(0.0, -100.0, 86.0),
        view(0.5, 160.0, 82.0),
        view(-0.2, -75.0, 70.0),
        view(0.2, 105.0, 68.0),
        view(0.1, 15.0, 70.0),
    ];
    Workpiece::new(solids.to_vec(), vec![seam], Views::List(viewpoints))
}

/// A bevelled plate on the camera's side, at 50 degrees to the square edge of the other unless told otherwise.
pub(super) fn half_v(draw: &mut Draw, request: &Request) -> Workpiece {
    let thick = draw.between_or("T", [8.0, 10.0], request.thickness_mm);
    let gap = draw.between_or("gap", [1.2, 1.8], request.root_opening_mm);
    let land = draw.between("root_face", 0.6, 1.0);
    let (sin, cos) = sin_cos_deg(draw.given("included", request.angle_deg.unwrap_or(50.0)));
    let half = 0.5 * request.length_mm.unwrap_or(500.0);
    let lip = gap + (thick - land) * sin / cos;
    let bevelled = [[-75.0, 0.0], [-gap, 0.0], [-gap, land], [-lip, thick], [-75.0, thick]];
    let solids = vec![
        Convex::prism(&bevelled, -half, half).into(),
        Convex::cuboid([-half, 0.0, 0.0], [half, 75.0, thick]).into(),
    ];
    // Where the bevel, drawn on, meets the square edge; the opening is between it and the bevel's foot.
    let apex = land - gap * cos / sin;
    let end = |x| Point3::new(x, 0.0, apex);
    let faces = [Vector3::new(0.0, cos, sin), -Vector3::y()];
    let opening = 2.0 * Vector3::new(0.0, -0.5 * gap, land - apex);
    let seam = TrueSeam::straight("groove", end(-half), end(half), faces, true).with_opening(opening);
    let far = 420.0_f64.min(200.0 + half);
    let view = |along: f64, azimuth_deg, elevation_deg| Viewpoint {
        azimuth_deg,
        elevation_deg,
        distance_mm: far,
        target: Point3::new(along * half, 0.0, thick),
    };
    // About the middle of the groove's opening, as steep as its walls allow.
    let viewpoints = vec![
        view(-0.5, -80.0, 66.0),
        view(0.0, -95.0, 63.0),
        view(0.5, -100.0, 66.0),
        view(-0.2, -75.0, 69.0),
        view(0.2, -105.0, 62.0),
        view(0.1, -88.0, 68.0),
    ];
    Workpiece::new(solids, vec![seam], Views::List(viewpoints))
}

/// Length of the S along x, mm.
const SPAN: f64 = 300.0;

/// A groove along an S whose plates have a crown.
pub(super) fn scurve(draw: &mut Draw, included_deg: f64) -> Workpiece {
    let groove = Groove::draw(draw, included_deg, None, None);
    let swing = draw.between("A", 11.0, 14.0);
    let crown = draw.between("B", 7.0, 10.0);
    let at = |x: f64| frame(x, swing, crown);
    let reach = 55.0;
    let outline = groove.plate(reach, groove.apex());
    let mut solids = Vec::new();
    // Chords of 1.5 mm leave the curve by less than 3 micrometres at its radius of 150 mm.
    let cells = 200;
    let place = |i: i32| at(SPAN * (f64::from(i) / f64::from(cells) - 0.5));
    for i in 0..cells {
        for profile in [outline, Groove::mirrored(outline)] {
            solids.push(cell(&profile, &place(i), &place(i + 1)));
        }
    }
    let seam = resampled(&groove, &at);
    let view = |along: f64, azimuth_deg, elevation_deg| Viewpoint {
        azimuth_deg,
        elevation_deg,
        distance_mm: 380.0,
        target: Point3::new(along, 0.0, groove.thick),
    };
    let viewpoints = vec![
        view(-15.0, 30.0, 84.0),
        view(20.0, 5.0, 76.0),
        view(0.0, 170.0, 76.0),
        view(-30.0, -75.0, 68.0),
        view(30.0, 110.0, 70.0),
    ];
    Workpiece::new(solids, vec![seam], Views::List(viewpoints))
}

/// Frame of the S at `x`: origin on the apex line, x along it, z up out of the plates.
fn frame(x: f64, swing: f64, crown: f64) -> Isometry3<f64> {
    let (sin, cos) = sin_cos(2.0 * PI * x / SPAN);
    let (sin_half, cos_half) = sin_cos(PI * x / SPAN);
    let origin = Vector3::new(x, swing * sin, crown * cos_half * cos_half);
    let rate = PI / SPAN;
    let slope = Vector3::new(1.0, 2.0 * rate * swing * cos, -2.0 * rate * crown * cos_half * sin_half);
    let along = slope.normalize();
    let across = Vector3::z().cross(&along).normalize();
    let rotation = from_columns(along, across, along.cross(&across));
    Isometry3::from_parts(Translation3::from(origin), rotation)
}

/// The plate between two frames, extruded along their chord and cut where the frames' cross-sections are.
fn cell(profile: &[[f64; 2]; 5], a: &Isometry3<f64>, b: &Isometry3<f64>) -> Solid {
    let (from, to) = (Point3::from(a.translation.vector), Point3::from(b.translation.vector));
    let along = (to - from).normalize();
    let across = Vector3::z().cross(&along).normalize();
    let chord = Isometry3::from_parts(
        Translation3::from(from.coords),
        from_columns(along, across, along.cross(&across)),
    );
    let length = (to - from).norm();
    let normal = |frame: &Isometry3<f64>| frame.rotation * Vector3::x();
    Convex::prism(profile, -length, 2.0 * length)
        .moved(&chord)
        .clipped(from, -normal(a))
        .clipped(to, normal(b))
        .into()
}

/// The apex line with a station every millimetre or so.
fn resampled(groove: &Groove, at: &impl Fn(f64) -> Isometry3<f64>) -> TrueSeam {
    let fine: Vec<Isometry3<f64>> = (0..=6000).map(|i| at(SPAN * (f64::from(i) / 6000.0 - 0.5))).collect();
    let mut lengths = vec![0.0];
    for pair in fine.windows(2) {
        let step = (pair[1].translation.vector - pair[0].translation.vector).norm();
        lengths.push(lengths[lengths.len() - 1] + step);
    }
    let total = lengths[lengths.len() - 1];
    let count = total.round();
    let station = |i: usize| {
        let s = total * i as f64 / count;
        let frame = &fine[lengths.partition_point(|l| *l < s).min(fine.len() - 1)];
        let apex = Point3::from(frame.translation.vector);
        let faces = groove.faces.map(|n| frame.rotation * n);
        let up = frame.rotation * Vector3::z();
        TrueStation { apex, root: apex + up * groove.root(), tangent: frame.rotation * Vector3::x(), faces }
    };
    let stations = (0..=count as usize).map(station).collect();
    TrueSeam { name: "sgroove".into(), closed: false, required: true, stations }
}
