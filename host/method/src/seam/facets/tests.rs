use super::*;
use nalgebra::{Point3, Translation3, UnitQuaternion, Vector3};
use std::f64::consts::{PI, TAU};

type Soup = Vec<[Point3<f64>; 3]>;

/// A prism over a convex polygon in x and z, from y = `from` to `to`.
fn prism(polygon: &[[f64; 2]], from: f64, to: f64) -> Soup {
    let n = polygon.len() as f64;
    let sum = polygon.iter().fold([0.0, 0.0], |s, p| [s[0] + p[0], s[1] + p[1]]);
    prism_about(polygon, sum.map(|c| c / n), from, to)
}

/// The same over a polygon all of which is seen from `middle`: its caps are fans about that.
fn prism_about(polygon: &[[f64; 2]], middle: [f64; 2], from: f64, to: f64) -> Soup {
    let n = polygon.len();
    let at = |k: usize, y: f64| Point3::new(polygon[k % n][0], y, polygon[k % n][1]);
    let middle = |y: f64| Point3::new(middle[0], y, middle[1]);
    (0..n)
        .flat_map(|k| {
            [
                [at(k, from), at(k + 1, to), at(k + 1, from)],
                [at(k, from), at(k, to), at(k + 1, to)],
                [at(k, from), at(k + 1, from), middle(from)],
                [at(k, to), middle(to), at(k + 1, to)],
            ]
        })
        .collect()
}

fn cuboid(low: [f64; 3], high: [f64; 3]) -> Soup {
    let polygon = [[low[0], low[2]], [high[0], low[2]], [high[0], high[2]], [low[0], high[2]]];
    prism(&polygon, low[1], high[1])
}

/// A rod of `strips` strips, standing on z = `from`, with a corner of its polygon in x.
fn rod(radius: f64, from: f64, to: f64, strips: usize) -> Soup {
    let corner = |k: usize| {
        let (sin, cos) = (TAU * k as f64 / strips as f64).sin_cos();
        [radius * cos, radius * sin]
    };
    let polygon: Vec<[f64; 2]> = (0..strips).map(corner).collect();
    // From x, z and y as a prism has them to x, y and z.
    moved(prism(&polygon, from, to), |p| Point3::new(p.x, p.z, p.y))
}

fn moved(soup: Soup, way: impl Fn(Point3<f64>) -> Point3<f64>) -> Soup {
    soup.into_iter().map(|t| t.map(&way)).collect()
}

/// Base plate 100 x 60 x 10 with its top in z = 0, and a web 8 thick and 40 high on it.
fn tee(gap_mm: f64) -> Soup {
    let web = cuboid([-4.0, 0.0, gap_mm], [4.0, 100.0, 40.0 + gap_mm]);
    [cuboid([-30.0, 0.0, -10.0], [30.0, 100.0, 0.0]), web].concat()
}

fn seams(soup: &Soup) -> Vec<Seam> {
    let corners: Vec<Point3<f64>> = soup.iter().flatten().copied().collect();
    let triangles: Vec<[usize; 3]> = (0..soup.len()).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    let mesh = Mesh::weld(&corners, &triangles, 1e-5).expect("a mesh");
    find(&mesh, &Isometry3::identity()).seams
}

/// A straight seam that must be there: ends and bisector.
type Truth = ([f64; 3], [f64; 3], [f64; 3]);

/// Both feet of the web of [`tee`].
const TEE: [Truth; 2] = [
    ([4.0, 0.0, 0.0], [4.0, 100.0, 0.0], [1.0, 0.0, 1.0]),
    ([-4.0, 0.0, 0.0], [-4.0, 100.0, 0.0], [-1.0, 0.0, 1.0]),
];

/// Exactly these seams are found, `way` moved: ends to 0.05 mm, bisector to 0.1 degrees.
fn assert_found(seams: &[Seam], truth: &[Truth], way: &Isometry3<f64>) {
    let shown = || seams.iter().map(|s| (s.length_mm(), s.stations[0], s.joint)).collect::<Vec<_>>();
    assert_eq!(seams.len(), truth.len(), "{:#?}", shown());
    for (a, b, n) in truth {
        let [a, b] = [a, b].map(|p| way * Point3::from(*p));
        let n = way * Vector3::from(*n).normalize();
        let is_it = |seam: &&Seam| {
            let [first, last] =
                [seam.stations[0].position_mm, seam.stations[seam.stations.len() - 1].position_mm];
            let apart = |p: Point3<f64>, q: Point3<f64>| (first - p).norm().max((last - q).norm());
            let turned =
                |s: &Station| (s.faces[0] + s.faces[1]).normalize().dot(&n) < 0.1f64.to_radians().cos();
            apart(a, b).min(apart(b, a)) < 0.05 && !seam.stations.iter().any(turned)
        };
        assert!(seams.iter().any(|seam| is_it(&seam)), "{a} {b} among {:#?}", shown());
    }
}

use crate::seam::Station;

fn turned() -> Isometry3<f64> {
    let turn = UnitQuaternion::from_euler_angles(0.4, 2.1, -1.3);
    Isometry3::from_parts(Translation3::new(812.0, -333.0, 1204.0), turn)
}

#[test]
fn a_web_on_a_plate_has_a_seam_on_either_side_in_one_body_touching_overlapping_and_with_a_gap() {
    let profile = [
        [-30.0, -10.0],
        [30.0, -10.0],
        [30.0, 0.0],
        [4.0, 0.0],
        [4.0, 40.0],
        [-4.0, 40.0],
        [-4.0, 0.0],
        [-30.0, 0.0],
    ];
    let still = Isometry3::identity();
    assert_found(&seams(&prism_about(&profile, [0.0, -5.0], 0.0, 100.0)), &TEE, &still);
    for gap_mm in [0.0, 0.1, 0.3, 0.49, -0.2, -5.0] {
        assert_found(&seams(&tee(gap_mm)), &TEE, &still);
    }
    assert_eq!(seams(&tee(2.0)).len(), 0, "2 mm apart nothing touches");
}

#[test]
fn the_seams_are_the_same_in_any_frame_and_after_rounding_to_single_precision_in_mm_and_m() {
    for (way, unit) in [(turned(), 1.0), (turned(), 0.001), (turned().inverse(), 0.001)] {
        let rounded = |p: Point3<f64>| (way * p).map(|c| f64::from((c * unit) as f32) / unit);
        assert_found(&seams(&moved(tee(0.0), rounded)), &TEE, &way);
        assert_found(&seams(&moved(tee(0.3), rounded)), &TEE, &way);
    }
}

#[test]
fn facets_may_come_twice_turned_over_and_in_any_order() {
    let still = Isometry3::identity();
    let mut twice = [tee(0.0), tee(0.0)].concat();
    twice.iter_mut().step_by(3).for_each(|t| t.swap(0, 1));
    twice.reverse();
    assert_found(&seams(&twice), &TEE, &still);
    let over: Soup = tee(0.0).into_iter().map(|[a, b, c]| [b, a, c]).collect();
    assert_found(&seams(&over), &TEE, &still);
}

#[test]
fn an_open_shell_and_sheets_without_thickness_have_their_seams_outside() {
    let still = Isometry3::identity();
    // Without the end at y = 100, and facets turned over here and there.
    let mut open: Soup = tee(0.0).into_iter().filter(|t| t.iter().any(|p| p.y < 99.0)).collect();
    open.iter_mut().step_by(4).for_each(|t| t.swap(0, 1));
    assert_found(&seams(&open), &TEE, &still);
    let at = |x: f64, y: f64, z: f64| Point3::new(x, y, z);
    let sheet = |a, b, c, d| vec![[a, b, c], [a, c, d]];
    let base = sheet(at(-30.0, 0.0, 0.0), at(30.0, 0.0, 0.0), at(30.0, 90.0, 0.0), at(-30.0, 90.0, 0.0));
    let web = sheet(at(0.0, 0.0, 0.0), at(0.0, 90.0, 0.0), at(0.0, 90.0, 40.0), at(0.0, 0.0, 40.0));
    let truth = [1.0, -1.0].map(|x| ([0.0, 0.0, 0.0], [0.0, 90.0, 0.0], [x, 0.0, 1.0]));
    assert_found(&seams(&[base, web].concat()), &truth, &still);
}

#[test]
fn an_angle_a_groove_and_a_lap_are_told_apart() {
    let angle = [[0.0, 0.0], [60.0, 0.0], [60.0, 8.0], [8.0, 8.0], [8.0, 60.0], [0.0, 60.0]];
    let found = seams(&prism_about(&angle, [4.0, 4.0], 0.0, 80.0));
    assert_found(&found, &[([8.0, 0.0, 8.0], [8.0, 80.0, 8.0], [1.0, 0.0, 1.0])], &Isometry3::identity());
    // Two plates 12 mm thick, bevelled by 30 degrees each, that touch at the root.
    let run = 12.0 * 30f64.to_radians().tan();
    let right = [[0.0, 0.0], [60.0, 0.0], [60.0, 12.0], [run, 12.0]];
    let left: Vec<[f64; 2]> = right.iter().rev().map(|p| [-p[0], p[1]]).collect();
    let found = seams(&[prism(&right, 0.0, 80.0), prism(&left, 0.0, 80.0)].concat());
    assert_found(&found, &[([0.0, 0.0, 0.0], [0.0, 80.0, 0.0], [0.0, 0.0, 1.0])], &Isometry3::identity());
    assert_eq!(found[0].joint, crate::seam::Joint::ButtV);
    let lap = [cuboid([0.0, 0.0, 0.0], [80.0, 100.0, 6.0]), cuboid([40.0, 0.0, 6.2], [120.0, 100.0, 12.2])]
        .concat();
    let truth = [
        ([40.0, 0.0, 6.0], [40.0, 100.0, 6.0], [-1.0, 0.0, 1.0]),
        ([80.0, 0.0, 6.2], [80.0, 100.0, 6.2], [1.0, 0.0, -1.0]),
    ];
    let found = seams(&lap);
    assert_found(&found, &truth, &Isometry3::identity());
    assert!(found.iter().all(|seam| seam.joint == crate::seam::Joint::Lap), "{:?}", found[0].reason);
}

#[test]
fn a_box_on_a_plate_has_four_seams_and_a_leaning_one_its_bisectors() {
    let still = Isometry3::identity();
    let both =
        [cuboid([-50.0, -50.0, -8.0], [50.0, 50.0, 0.0]), cuboid([-20.0, -15.0, 0.0], [20.0, 15.0, 30.0])]
            .concat();
    let truth = [
        ([-20.0, -15.0, 0.0], [20.0, -15.0, 0.0], [0.0, -1.0, 1.0]),
        ([-20.0, 15.0, 0.0], [20.0, 15.0, 0.0], [0.0, 1.0, 1.0]),
        ([-20.0, -15.0, 0.0], [-20.0, 15.0, 0.0], [-1.0, 0.0, 1.0]),
        ([20.0, -15.0, 0.0], [20.0, 15.0, 0.0], [1.0, 0.0, 1.0]),
    ];
    assert_found(&seams(&both), &truth, &still);
    // A web that leans by 30 degrees to +x: 60 degrees there, 120 on the other side.
    let shear = 30f64.to_radians().tan();
    let lean = |p: Point3<f64>| Point3::new(p.x + shear * p.z, p.y, p.z);
    let web = moved(cuboid([-4.0, 0.0, 0.0], [4.0, 100.0, 40.0]), lean);
    let (sin, cos) = 30f64.to_radians().sin_cos();
    let truth = [
        ([4.0, 0.0, 0.0], [4.0, 100.0, 0.0], [cos, 0.0, 1.0 - sin]),
        ([-4.0, 0.0, 0.0], [-4.0, 100.0, 0.0], [-cos, 0.0, 1.0 + sin]),
    ];
    assert_found(&seams(&[cuboid([-40.0, 0.0, -10.0], [60.0, 100.0, 0.0]), web].concat()), &truth, &still);
}

#[test]
fn a_rod_on_a_plate_has_one_closed_seam_with_a_torch_that_turns_steadily() {
    for strips in [16, 24, 64] {
        for gap_mm in [0.0, 0.3, -1.0] {
            let plate = cuboid([-60.0, -60.0, -8.0], [60.0, 60.0, 0.0]);
            let way = turned();
            let found = seams(&moved([plate, rod(25.0, gap_mm, 60.0, strips)].concat(), |p| way * p));
            let [seam] = found.as_slice() else { panic!("{strips} {gap_mm}: {} seams", found.len()) };
            assert!(
                seam.closed && seam.joint == crate::seam::Joint::Pipe,
                "{strips} {gap_mm} {}",
                seam.reason
            );
            let side = 2.0 * 25.0 * (PI / strips as f64).sin();
            assert!((seam.length_mm() - side * strips as f64).abs() < 0.05, "{}", seam.length_mm());
            for station in &seam.stations {
                let at = way.inverse() * station.position_mm;
                let low = 25.0 * (PI / strips as f64).cos();
                assert!(at.z.abs() < 1e-3 && (low - 1e-3..25.001).contains(&at.coords.xy().norm()), "{at}");
                let bisector = way.inverse() * (station.faces[0] + station.faces[1]).normalize();
                let radial = Vector3::new(at.x, at.y, 0.0).normalize();
                assert!(
                    bisector.dot(&(radial + Vector3::z()).normalize()) > 3f64.to_radians().cos(),
                    "{bisector}"
                );
            }
        }
    }
}

#[test]
fn a_tube_through_a_tube_has_a_saddle_on_either_side() {
    let run = moved(rod(30.0, -80.0, 80.0, 96), |p| Point3::new(p.z, p.y, p.x));
    let branch = rod(15.0, -60.0, 60.0, 72);
    let way = turned();
    let found = seams(&moved([run, branch].concat(), |p| way * p));
    assert_eq!(found.len(), 2, "{:?}", found.iter().map(Seam::length_mm).collect::<Vec<_>>());
    for seam in &found {
        assert!(seam.closed && seam.joint == crate::seam::Joint::Saddle, "{}", seam.reason);
        for station in &seam.stations {
            let at = way.inverse() * station.position_mm;
            // On both cylinders, less the sag of their strips.
            let [of_run, of_branch] = [at.coords.yz().norm() - 30.0, at.coords.xy().norm() - 15.0];
            assert!((-0.03..0.01).contains(&of_run) && (-0.03..0.01).contains(&of_branch), "{at}");
            let faces =
                [Vector3::new(0.0, at.y, at.z).normalize(), Vector3::new(at.x, at.y, 0.0).normalize()];
            let bisector = way.inverse() * (station.faces[0] + station.faces[1]).normalize();
            let cosine = bisector.dot(&(faces[0] + faces[1]).normalize());
            assert!(cosine > 3f64.to_radians().cos(), "{at} {cosine}");
        }
    }
}

#[test]
fn a_square_tube_with_round_corners_has_one_seam_round() {
    let arc = |cx: f64, cz: f64, from: f64| {
        (0..=6).map(move |k| {
            let (sin, cos) = (from + PI / 12.0 * f64::from(k)).sin_cos();
            [cx + 6.0 * cos, cz + 6.0 * sin]
        })
    };
    let polygon: Vec<[f64; 2]> = arc(14.0, 14.0, 0.0)
        .chain(arc(-14.0, 14.0, PI / 2.0))
        .chain(arc(-14.0, -14.0, PI))
        .chain(arc(14.0, -14.0, 1.5 * PI))
        .collect();
    let tube = moved(prism(&polygon, 0.0, 50.0), |p| Point3::new(p.x, p.z, p.y));
    let found = seams(&[cuboid([-50.0, -50.0, -8.0], [50.0, 50.0, 0.0]), tube].concat());
    let [seam] = found.as_slice() else { panic!("{} seams", found.len()) };
    assert!(seam.closed);
    let length = 4.0 * 28.0 + 24.0 * 2.0 * 6.0 * (PI / 24.0).sin();
    assert!((seam.length_mm() - length).abs() < 0.05, "{} {length}", seam.length_mm());
}

#[test]
fn a_box_a_plate_and_a_hollow_tube_have_no_seam() {
    for soup in [cuboid([0.0; 3], [30.0, 40.0, 50.0]), rod(20.0, 0.0, 60.0, 12)] {
        assert_eq!(seams(&soup).len(), 0);
    }
    // A closed box in a closed box: the air between them is seen by nobody.
    let nested = [cuboid([0.0; 3], [60.0; 3]), cuboid([10.0, 10.0, 0.0], [50.0; 3])].concat();
    assert_eq!(seams(&nested).len(), 0);
    // A tube of 12 strips, seen from inside: a coarse curve and no corner.
    let ring = |radius: f64, k: usize, z: f64| {
        let (sin, cos) = (TAU * k as f64 / 12.0).sin_cos();
        Point3::new(radius * cos, radius * sin, z)
    };
    let wall = |k: usize| {
        let quad = |a: [f64; 2], b: [f64; 2]| {
            let at = |[radius, z]: [f64; 2], k| ring(radius, k, z);
            [[at(a, k), at(a, k + 1), at(b, k + 1)], [at(a, k), at(b, k + 1), at(b, k)]]
        };
        let profile = [[25.0, 0.0], [25.0, 60.0], [20.0, 60.0], [20.0, 0.0]];
        (0..4).flat_map(move |i| quad(profile[i], profile[(i + 1) % 4])).collect::<Vec<_>>()
    };
    assert_eq!(seams(&(0..12).flat_map(wall).collect()).len(), 0);
}
