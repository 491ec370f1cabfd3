//! A good scan draws no coverage warning; one that lacks a view does, and the view it proposes makes it good.

use nalgebra::{Isometry3, Matrix3, Point3, Translation3, UnitQuaternion, Vector3};
use std::path::Path;
use weldpath::input::{Options, read};
use weldpath::pipeline::Plan;
use weldpath::seam::measure::coverage::{Fault, Gap};
use weldpath::simulation::{Camera, Noise, Part, Request, captured, stage, write};

use crate::planned;

fn fixture(name: &str) -> Plan {
    planned::plan(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures").join(name)).unwrap()
}

#[test]
fn a_good_scan_draws_no_coverage_warning() {
    for name in ["fillet", "butt-v", "lap"] {
        assert_eq!(fixture(name).coverage, [], "{name}");
    }
}

#[test]
fn the_corner_inside_a_pipe_is_seen_in_part_and_said_to_go_on() {
    let plan = fixture("pipe");
    let open: Vec<usize> = plan.seams.iter().filter(|seam| !seam.closed).map(|seam| seam.id).collect();
    assert!(!plan.coverage.is_empty(), "the truth of the inner ring is hidden for the most part");
    assert!(plan.coverage.iter().all(|gap| open.contains(&gap.seam)), "{:?}", plan.coverage);
}

/// A camera that looks at `target_mm` from the direction `out`, its rows along `along`.
fn looking(
    target_mm: Point3<f64>,
    out: Vector3<f64>,
    distance_mm: f64,
    along: Vector3<f64>,
) -> Isometry3<f64> {
    let forward = -out.normalize();
    let right = (along - forward * along.dot(&forward)).normalize();
    let axes = Matrix3::from_columns(&[right, forward.cross(&right), forward]);
    let turn = UnitQuaternion::from_matrix(&axes);
    Isometry3::from_parts(Translation3::from(target_mm - forward * distance_mm), turn)
}

/// The plan of a scan taken from these poses.
fn taken_from(request: &Request, base_from_camera: &[Isometry3<f64>]) -> Plan {
    let folder = tempfile::tempdir().unwrap();
    write(&captured(request, base_from_camera).unwrap(), folder.path()).unwrap();
    planned::plan_of(&read(folder.path(), &Options::default()).unwrap()).unwrap()
}

/// Warnings of a plan about the face with this normal.
fn of_face<'a>(plan: &'a Plan, normal: &'a Vector3<f64>) -> impl Iterator<Item = &'a Gap> {
    plan.coverage.iter().filter(|gap| gap.face.dot(normal) > 0.95)
}

#[test]
fn a_view_that_was_left_out_is_asked_for_and_the_one_that_is_proposed_serves() {
    let request = Request { noise: Noise::Low, ..Request::new(Part::Fillet, 5) };
    let truth = stage(&request).unwrap().truth;
    let seam = &truth.seams[0];
    let length_mm = (seam.p.len() - 1) as f64;
    let at = |s_mm: usize| Point3::from(seam.p[s_mm]);
    let (up, wall, along) =
        (Vector3::from(seam.normal_a[0]), Vector3::from(seam.normal_b[0]), Vector3::from(seam.t[0]));
    // The web is seen next to the seam's beginning only; the plate all along, by a view that is cut off at the seam.
    let eye = at(150) + 330.0 * (0.87 * up + 0.5 * wall);
    let to_seam = (at(150) + 1.5 * wall - eye).normalize();
    let half_view = UnitQuaternion::rotation_between(&to_seam, &wall)
        .map(|turn| UnitQuaternion::from_scaled_axis(turn.axis().unwrap().into_inner() * 0.5f64 * 0.7598));
    let mut poses = vec![
        looking(at(60), up + wall, 240.0, along),
        looking(at(40), up + 1.4 * wall, 250.0, along),
        looking(eye, -(half_view.unwrap() * to_seam), 0.0, along),
    ];
    let camera = Camera::with_size(request.width, request.height);
    let seen = |s_mm: &usize| {
        let on_web = at(*s_mm) + 5.0 * up;
        poses[..2].iter().any(|pose| camera.project(&pose.inverse_transform_point(&on_web)).is_some())
    };
    let last_seen_mm = (0..seam.p.len()).filter(seen).max().unwrap() as f64;
    assert!((120.0..220.0).contains(&last_seen_mm), "the rest is long enough to be missed: {last_seen_mm}");

    let bad = taken_from(&request, &poses);
    let gaps: Vec<&Gap> = of_face(&bad, &wall).collect();
    let [gap] = gaps.as_slice() else { panic!("{gaps:?} in {:?}", bad.said.warnings) };
    assert_eq!((gap.fault, bad.coverage.len()), (Fault::OpenEnd, 1), "{:?}", bad.coverage);
    // The stretch is told along the planned seam, which may run either way.
    let stations = &bad.seams[0].stations;
    let runs_along = stations[0].tangent.dot(&along) > 0.0;
    let span_mm = [gap.from_mm, gap.to_mm].map(|s_mm| {
        let from_start = (stations[0].position_mm - at(0)).dot(&along);
        if runs_along { from_start + s_mm } else { from_start - s_mm }
    });
    let [from_mm, to_mm] = [span_mm[0].min(span_mm[1]), span_mm[0].max(span_mm[1])];
    assert!((from_mm - last_seen_mm).abs() < 8.0, "from {from_mm:.0}, last seen {last_seen_mm:.0}");
    assert!((to_mm - length_mm).abs() < 8.0 || to_mm - from_mm > 140.0, "to {to_mm:.0} of {length_mm:.0}");
    assert!(bad.said.warnings.contains(&gap.words()));

    poses.push(looking(gap.view.position_mm, -gap.view.direction, 0.0, along));
    let good = taken_from(&request, &poses);
    assert_eq!(good.coverage, [], "{:?}", good.said.warnings);
    assert!((good.seams[0].length_mm() - length_mm).abs() < 5.0, "{:.0}", good.seams[0].length_mm());
}

#[test]
fn a_t_that_was_seen_from_one_side_says_so_until_the_view_that_it_asks_for_is_there() {
    let request = Request { noise: Noise::Low, ..Request::new(Part::Fillet, 5) };
    let truth = stage(&request).unwrap().truth;
    let seam = &truth.seams[0];
    let middle = Point3::from(seam.p[seam.p.len() / 2]);
    let (up, wall, along) =
        (Vector3::from(seam.normal_a[0]), Vector3::from(seam.normal_b[0]), Vector3::from(seam.t[0]));
    let mut poses = vec![looking(middle, up + wall + 0.3 * along, 400.0, along)];
    let one_view = taken_from(&request, &poses);
    let [one] = one_view.one_sided.as_slice() else { panic!("{:?}", one_view.one_sided) };
    assert_eq!(one_view.seams.len(), 1);
    assert!(one.face.dot(&wall) < -0.99 && one.view.direction.dot(&wall) > 0.3, "{one:?}");

    poses.push(looking(one.view.position_mm, -one.view.direction, 0.0, along));
    let both = taken_from(&request, &poses);
    let faces: Vec<f64> = both.seams.iter().flat_map(|s| s.stations[0].faces).map(|n| n.dot(&wall)).collect();
    assert!([-0.99, 0.99].iter().all(|side| faces.iter().any(|n| n * side > 0.98)), "both sides: {faces:?}");
    assert_eq!(both.one_sided, [], "both sides are seams");
}

#[test]
fn one_side_is_said_of_the_upright_plate_of_a_t_and_of_no_lap_groove_or_pipe() {
    for name in ["butt-v", "lap", "pipe"] {
        assert_eq!(fixture(name).one_sided, [], "{name}");
    }
    let plan = fixture("fillet");
    let [one] = plan.one_sided.as_slice() else { panic!("{:?}", plan.one_sided) };
    let upright = plan.seams[0].stations[0].faces.into_iter().min_by(|a, b| a.z.abs().total_cmp(&b.z.abs()));
    assert!(one.face.dot(&upright.unwrap()) < -0.99, "{one:?}");
}
