//! Plans built by hand, with seams whose geometry is known exactly.

use std::f64::consts::{FRAC_PI_4, TAU};

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};
use weldpath::evaluation::{Truth, TruthSeam};
use weldpath::geometry::cloud::PointCloud;
use weldpath::pipeline::{Derivation, Parameter, Plan, Remarks, ViewReport};
use weldpath::seam::{ErrorParts, Joint, Seam, Station};
use weldpath::weld::{PathPoint, Process, SeamPath};

/// Corner of the bent seam, mm.
pub const CORNER_MM: [f64; 3] = [60.3, 200.0, 0.0];

/// Seam 1: a pipe of 40 mm diameter on a plate, torch at 45 degrees, all the way round. Seam 2: a fillet that bends by
/// 90 degrees at [`CORNER_MM`]. Both in the plane `z = 0`; the pipe stands 80 mm high.
pub fn pipe_and_bend() -> Plan {
    of_paths(vec![pipe(), bend()])
}

/// A perfect plan: every seam of `truth`, station for station.
pub fn of_truth(truth: &Truth) -> Plan {
    let vector = |v: &[f64; 3]| Vector3::from(*v);
    let path = |(i, seam): (usize, &TruthSeam)| {
        let ends = if seam.closed { seam.p.len() + 1 } else { seam.p.len() };
        let at = |k: usize| {
            let k = k % seam.p.len();
            pose(0.0, Point3::from(seam.p[k]), vector(&seam.n[k]), vector(&seam.t[k]))
        };
        SeamPath { seam: i + 1, points: (0..ends).map(at).collect() }
    };
    of_paths(truth.seams.iter().enumerate().map(path).collect())
}

/// Length of the seam, width of the base plate, height of the upright plate of [`corner_of_plates`], mm.
pub const PLATES_MM: [f64; 3] = [100.0, 40.0, 30.0];

/// A fillet along +x where an upright plate (`y = 0`) stands on a base plate (`z = 0`), torch at 45 degrees; `bent`: it
/// goes on along -y, along another upright plate.
pub fn corner_of_plates(bent: bool) -> Plan {
    let [length_mm, width_mm, _] = PLATES_MM;
    let mut points: Vec<PathPoint> = (0..=2 * length_mm as i32)
        .map(|i| f64::from(i) / 2.0)
        .map(|x| pose(x, Point3::new(x, 0.0, 0.0), Vector3::new(0.0, -1.0, 1.0), Vector3::x()))
        .collect();
    if bent {
        let on = (1..=2 * width_mm as i32).map(|i| f64::from(i) / 2.0).map(|y| {
            let corner = Point3::new(length_mm, -y, 0.0);
            pose(length_mm + y, corner, Vector3::new(-1.0, 0.0, 1.0), -Vector3::y())
        });
        points.extend(on);
    }
    let mut plan = of_paths(vec![SeamPath { seam: 1, points }]);
    plan.seams[0].joint = Joint::Fillet;
    plan.seams[0].closed = false;
    plan
}

fn of_paths(paths: Vec<SeamPath>) -> Plan {
    let seams = paths.iter().map(seam).collect();
    let parameters =
        vec![Parameter { name: "voxel_mm".into(), value: 0.8, how: "twice the mean spacing".into() }];
    Plan {
        model: model(),
        seams,
        paths,
        derived: Derivation {
            views: vec![view()],
            parameters,
            stage_s: vec![("normals".into(), 0.25), ("seam".into(), 1.5)],
            ..Derivation::default()
        },
        said: Remarks { warnings: vec!["view 2 sees little".into()], ..Remarks::default() },
        ..Plan::default()
    }
}

/// A pose at `p` with torch axis `n` and travel near `m`.
fn pose(s_mm: f64, position_mm: Point3<f64>, n: Vector3<f64>, m: Vector3<f64>) -> PathPoint {
    let n = n.normalize();
    let m = (m - n * n.dot(&m)).normalize();
    let columns = Matrix3::from_columns(&[m.cross(&n), m, n]);
    let base_from_torch = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(columns));
    PathPoint { s_mm, position_mm, base_from_torch, process: Process::default() }
}

fn pipe() -> SeamPath {
    let at = |i: i32| {
        let angle = TAU * f64::from(i) / 360.0;
        let radial = Vector3::new(angle.cos(), angle.sin(), 0.0);
        let n = radial * FRAC_PI_4.cos() + Vector3::z() * FRAC_PI_4.sin();
        let m = Vector3::new(-angle.sin(), angle.cos(), 0.0);
        pose(20.0 * angle, Point3::from(radial * 20.0), n, m)
    };
    SeamPath { seam: 1, points: (0..=360).map(at).collect() }
}

fn bend() -> SeamPath {
    let corner = Point3::from(CORNER_MM);
    let n = Vector3::new(-1.0, 1.0, 1.0);
    let before = (0..=120).map(|i| corner - Vector3::x() * (60.0 - 0.5 * f64::from(i)));
    let mut points: Vec<PathPoint> = before.map(|p| pose(0.0, p, n, Vector3::x())).collect();
    points.extend((1..=80).map(|i| pose(0.0, corner + Vector3::y() * (0.5 * f64::from(i)), n, Vector3::y())));
    SeamPath { seam: 2, points }
}

fn seam(path: &SeamPath) -> Seam {
    let closed = path.seam == 1;
    let station = |point: &PathPoint| Station {
        position_mm: point.position_mm,
        tangent: point.base_from_torch * Vector3::y(),
        faces: [point.out_of_work(); 2],
    };
    let count = path.points.len() - usize::from(closed);
    Seam {
        id: path.seam,
        joint: if closed { Joint::Pipe } else { Joint::Fillet },
        reason: "built by hand".into(),
        stations: path.points[..count].iter().map(station).collect(),
        closed,
        confidence: 0.9,
        expected_error_mm: 0.05,
        relative_error_mm: 0.05,
        fit_error: weldpath::seam::FitError::default(),
        error_parts: ErrorParts {
            noise_mm: 0.05,
            registration_mm: 0.0,
            calibration_mm: 0.296,
            corner_mm: 0.0,
            touch_mm: 0.0,
        },
        expected_error_deg: 0.4,
        base_error_mm: 0.3,
        base_error_deg: 0.5,
        contact: None,
        drawn: false,
        dimensions: vec![],
        warnings: vec![],
    }
}

fn model() -> PointCloud {
    let plate =
        (0..400).map(|i| Point3::new((i % 20) as f32 * 10.0 - 60.0, (i / 20) as f32 * 15.0 - 40.0, 0.0));
    let mut points_mm: Vec<Point3<f32>> = plate.collect();
    points_mm.push(Point3::new(0.0, 20.0, 80.0));
    let normals = vec![Vector3::z(); points_mm.len()];
    PointCloud { origin_mm: Point3::origin(), points_mm, normals }
}

fn view() -> ViewReport {
    ViewReport {
        name: "view_000.png".into(),
        misfit: None,
        left_out: None,
        complaint: None,
        base_from_camera: Isometry3::translation(300.0, -20.0, 450.0),
        reported: Isometry3::translation(300.0, -21.2, 450.0),
        fitness_before: 0.7,
        fitness_after: 0.99,
        fitness_per_iteration: vec![0.7, 0.9, 0.99],
        moved_mm: 1.2,
        moved_deg: 0.4,
        uncertainty_mm: f64::INFINITY,
        uncertainty_deg: 0.05,
    }
}
