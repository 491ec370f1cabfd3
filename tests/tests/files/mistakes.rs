//! Everyday mistakes in a scan, each made on the committed scans: what the verdict says of it, and that no plan is ready, or
//! checked and false. The table of docs/troubleshooting.md is this one.
//!
//! Two pieces and one seed by default; `cargo test -p weldpath-tests --test files mistakes -- --ignored --nocapture` makes them on
//! all four pieces, with three seeds.

use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Matrix3, Matrix4, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde_json::{Value, json};
use weldpath::evaluation::{Options, PathSet, Score, Truth, score};
use weldpath::input;
use weldpath::output::verdict::{ReasonId, State, Verdict};
use weldpath::run::job::Job;
use weldpath::run::planning;
use weldpath::run::postprocessing::postprocess;
use weldpath_tests::adversary::Random;

const PIECES: &[&str] = &["fillet", "lap", "pipe", "butt-v"];
/// Those of them that are tried whenever the tests run: two minutes of a processor go into all four.
const ALWAYS: &[&str] = &["lap", "butt-v"];
/// No false seam is as sure as this.
const SURE: f64 = 0.9;
const TROUBLESHOOTING: &str = include_str!("../../../docs/troubleshooting.md");

/// What is done to a scan.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Mistake {
    None,
    /// Every pose is off by as much as a robot's is.
    Loose,
    /// One view's camera is shifted by mm and turned by degrees.
    OneView(f64, f64),
    /// One view stands in the list twice, or its image in place of its neighbour's.
    Twice,
    NeighboursImage,
    /// Every image has the pose of the next.
    ShiftedPoses,
    /// Poses of a tool 100 mm out.
    Tool,
    DepthScale(f64),
    InvertedHandEye,
    TurnedImages,
    Degrees,
    Millimetres,
    /// A pixel far behind the work.
    StrayPixel,
    StandOff,
}

/// The words of the table, the mistake, and the states that are right for it, of which the table names the first.
const ROWS: &[(&str, Mistake, &[State])] = &[
    ("none", Mistake::None, &[State::Ready]),
    ("every pose off by 3 mm and 0.6 degrees", Mistake::Loose, &[State::Check]),
    ("one view off by 60 mm and 5 degrees", Mistake::OneView(60.0, 5.0), &[State::Check]),
    ("one view turned by 20 degrees", Mistake::OneView(0.0, 20.0), &[State::Check]),
    ("one view turned by 40 degrees", Mistake::OneView(0.0, 40.0), &[State::Check]),
    ("one image twice, with its own pose", Mistake::Twice, &[State::Check]),
    ("one image twice, with its neighbour's pose", Mistake::NeighboursImage, &[State::Check]),
    ("poses shifted by one image", Mistake::ShiftedPoses, &[State::Refused]),
    ("a tool's poses, 100 mm out, in place of the flange's", Mistake::Tool, &[State::Refused]),
    ("`depth_scale_m` ten times as large", Mistake::DepthScale(10.0), &[State::Refused]),
    ("`depth_scale_m` twice as large", Mistake::DepthScale(2.0), &[State::Refused]),
    ("`depth_scale_m` half as large", Mistake::DepthScale(0.5), &[State::Refused]),
    ("the hand-eye transform inverted", Mistake::InvertedHandEye, &[State::Refused]),
    ("images turned by 180 degrees", Mistake::TurnedImages, &[State::Refused]),
    ("degrees for radians", Mistake::Degrees, &[State::Refused]),
    ("millimetres for metres", Mistake::Millimetres, &[State::Refused]),
    ("one pixel of one image at 20 m", Mistake::StrayPixel, &[State::Ready]),
    ("a stand-off of -20 mm", Mistake::StandOff, &[State::Refused]),
];

/// A direction, evenly.
fn direction(random: &mut Random) -> Vector3<f64> {
    let (z, about) = (2.0 * random.unit() - 1.0, std::f64::consts::TAU * random.unit());
    let level = (1.0 - z * z).sqrt();
    Vector3::new(level * about.cos(), level * about.sin(), z)
}

/// Turns about the camera by degrees, and shifts it by mm.
fn moved(random: &mut Random, camera_m: &Vector3<f64>, mm: f64, deg: f64) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(direction(random) * deg.to_radians());
    let shift = camera_m - turn * camera_m + direction(random) * mm / 1e3;
    Isometry3::from_parts(Translation3::from(shift), turn)
}

/// A `scan.json` in metres with poses as six numbers.
struct Manifest {
    json: Value,
    poses: Vec<Isometry3<f64>>,
    hand_eye: Isometry3<f64>,
}

impl Manifest {
    fn read(folder: &Path) -> Self {
        let json: Value = serde_json::from_slice(&std::fs::read(folder.join("scan.json")).unwrap()).unwrap();
        let number = |value: &Value| value.as_f64().unwrap();
        let pose = |view: &Value| {
            let v: Vec<f64> = view["base_from_flange"].as_array().unwrap().iter().map(number).collect();
            Isometry3::new(Vector3::new(v[0], v[1], v[2]), Vector3::new(v[3], v[4], v[5]))
        };
        let poses = json["views"].as_array().unwrap().iter().map(pose).collect();
        let cell = |r: usize, c: usize| number(&json["flange_from_camera"][r][c]);
        let turn = Rotation3::from_matrix(&Matrix3::from_fn(cell));
        let shift = Vector3::new(cell(0, 3), cell(1, 3), cell(2, 3));
        let hand_eye = Isometry3::from_parts(shift.into(), UnitQuaternion::from_rotation_matrix(&turn));
        Self { json, poses, hand_eye }
    }

    fn camera_m(&self, k: usize) -> Vector3<f64> {
        (self.poses[k] * self.hand_eye).translation.vector
    }

    fn views(&mut self) -> &mut Vec<Value> {
        self.json["views"].as_array_mut().unwrap()
    }

    /// Without a view.
    fn without(mut self, k: usize) -> Self {
        self.poses.remove(k);
        self.views().remove(k);
        self
    }

    /// With the mistake; the view that alone is wrong, if one is.
    fn spoil(&mut self, mistake: Mistake, random: &mut Random) -> Option<usize> {
        let count = self.poses.len();
        let k = random.below(count as u64) as usize;
        let all = |poses: &mut Vec<Isometry3<f64>>, change: Isometry3<f64>| {
            poses.iter_mut().for_each(|pose| *pose *= change);
        };
        match mistake {
            Mistake::None | Mistake::StrayPixel | Mistake::StandOff => None,
            Mistake::Loose => {
                for k in 0..count {
                    self.poses[k] = moved(random, &self.camera_m(k), 3.0, 0.6) * self.poses[k];
                }
                None
            }
            Mistake::OneView(mm, deg) => {
                self.poses[k] = moved(random, &self.camera_m(k), mm, deg) * self.poses[k];
                Some(k)
            }
            Mistake::Twice => {
                let (view, pose) = (self.views()[k].clone(), self.poses[k]);
                self.views().push(view);
                self.poses.push(pose);
                Some(count)
            }
            Mistake::NeighboursImage => {
                self.views()[(k + 1) % count] = self.views()[k].clone();
                Some((k + 1) % count)
            }
            Mistake::ShiftedPoses => {
                self.poses.rotate_left(1);
                None
            }
            Mistake::Tool => {
                all(&mut self.poses, Isometry3::translation(0.0, 0.0, 0.1));
                None
            }
            Mistake::DepthScale(factor) => {
                let scale = self.json["camera"]["depth_scale_m"].as_f64().unwrap();
                self.json["camera"]["depth_scale_m"] = json!(scale * factor);
                None
            }
            Mistake::InvertedHandEye => {
                self.hand_eye = self.hand_eye.inverse();
                None
            }
            Mistake::TurnedImages => {
                self.hand_eye *= UnitQuaternion::from_scaled_axis(Vector3::z() * std::f64::consts::PI);
                None
            }
            Mistake::Degrees | Mistake::Millimetres => None,
        }
    }

    /// The file, in a folder of its own; the images stay where they are.
    fn write(mut self, mistake: Mistake, images: &Path, folder: &Path) {
        let degrees = if mistake == Mistake::Degrees { 180.0 / std::f64::consts::PI } else { 1.0 };
        let millimetres = if mistake == Mistake::Millimetres { 1e3 } else { 1.0 };
        let poses = std::mem::take(&mut self.poses);
        let hand_eye = self.hand_eye.to_homogeneous();
        for (view, pose) in self.views().iter_mut().zip(poses) {
            let (t, r) = (pose.translation.vector * millimetres, pose.rotation.scaled_axis() * degrees);
            view["base_from_flange"] = json!([t.x, t.y, t.z, r.x, r.y, r.z]);
            view["depth"] = json!(images.join(view["depth"].as_str().unwrap()));
        }
        let rows: Vec<Vec<f64>> = hand_eye.row_iter().map(|row| row.iter().copied().collect()).collect();
        self.json["flange_from_camera"] = json!(rows);
        std::fs::write(folder.join("scan.json"), self.json.to_string()).unwrap();
    }
}

/// What becomes of a scan: the verdict and the paths' score, or no plan at all.
struct Outcome {
    verdict: Result<Verdict, String>,
    score: Option<Score>,
    left_out: Vec<usize>,
    /// Of the seam that is surest.
    confidence: f64,
}

impl Outcome {
    fn state(&self) -> State {
        self.verdict.as_ref().map_or(State::Refused, |verdict| verdict.state)
    }

    /// What it says first, by id; none of a plan that is ready, or that fails with a message of its own.
    fn reasons(&self) -> Vec<ReasonId> {
        let reasons = self.verdict.iter().flat_map(|verdict| &verdict.reasons);
        reasons.filter(|reason| !reason.accepted).map(|reason| reason.id).collect()
    }
}

fn images(piece: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("fixtures").join(piece)
}

/// Plans a scan as the command does: TCP and torch are accepted as stated elsewhere, and the first pose is exact where that
/// is true.
fn planned(manifest: Manifest, piece: &str, mistake: Mistake) -> Outcome {
    let folder = tempfile::tempdir().unwrap();
    manifest.write(mistake, &images(piece), folder.path());
    let options = input::Options { allow_outside: true, ..Default::default() };
    let failed = |why: String| Outcome { verdict: Err(why), score: None, left_out: vec![], confidence: 0.0 };
    let mut scan = match input::read(folder.path(), &options) {
        Ok(scan) => scan,
        Err(error) => return failed(error.to_string()),
    };
    if mistake == Mistake::StrayPixel {
        scan.views[0].points_mm.push(Point3::new(500.0, -300.0, 20_000.0));
    }
    let stand_off = if mistake == Mistake::StandOff { "[path]\nstandoff_mm = -20\n" } else { "" };
    let anchor = if mistake == Mistake::Loose { "" } else { "[scan]\nanchor = \"first\"\n" };
    let text = format!("accept = [\"tool-not-stated\", \"torch-collision\"]\n{anchor}{stand_off}");
    let job = Job::parse(&text, Path::new("job.toml")).unwrap();
    let plan = match planning::plan(&scan, &job, &mut ()) {
        Ok(plan) => plan,
        Err(error) => return failed(error.to_string()),
    };
    let output = postprocess(&plan, &job, planning::source(&scan, &job)).unwrap();
    let csv = output.files.iter().find(|file| file.name == "path.csv").unwrap();
    let programs =
        output.files.iter().filter(|file| ["path.json", "path.script"].contains(&&*file.name)).count();
    let verdict = output.summary.verdict().clone();
    assert_eq!(programs, if verdict.state == State::Refused { 0 } else { 2 });
    let truth = Truth::read(&images(piece).join("truth.json")).unwrap();
    let paths = PathSet::parse(&csv.bytes, Path::new("path.csv")).ok();
    let left_out =
        (0..plan.derived.views.len()).filter(|&k| plan.derived.views[k].left_out.is_some()).collect();
    Outcome {
        verdict: Ok(verdict),
        score: paths.map(|paths| score(&paths, &truth, &Options::default())),
        left_out,
        confidence: plan.seams.iter().map(|seam| seam.confidence).fold(0.0, f64::max),
    }
}

/// Makes a mistake on a piece; what is wrong with what becomes of it, and its line of the printed table.
fn tried(row: &(&str, Mistake, &[State]), piece: &str, seed: u64) -> (String, Vec<String>) {
    let (words, mistake, states) = *row;
    let mut random = Random::new(seed);
    let mut manifest = Manifest::read(&images(piece));
    let wrong = manifest.spoil(mistake, &mut random);
    let outcome = planned(manifest, piece, mistake);
    let (state, false_share) = (outcome.state(), outcome.score.as_ref().map_or(0.0, |s| s.false_share));
    let mut faults = Vec::new();
    if !states.contains(&state) {
        faults.push(format!("{} in place of {}", state.name(), states[0].name()));
    }
    if state != State::Refused && false_share > 0.02 {
        faults.push(format!("{:.0} % of the path is false, and a program is written", 100.0 * false_share));
    }
    // A stand-off puts the tip elsewhere, not the seam.
    if mistake != Mistake::StandOff && false_share > 0.5 && outcome.confidence >= SURE {
        faults.push(format!("a false seam of confidence {:.2}", outcome.confidence));
    }
    if let Some(k) = wrong {
        let named =
            outcome.left_out == [k] || mistake == Mistake::NeighboursImage && outcome.left_out.len() == 1;
        if !named {
            faults.push(format!("view {k} is wrong, {:?} are left out", outcome.left_out));
        } else {
            // The image twice of two poses: either may be the one that fits.
            let without = Manifest::read(&images(piece));
            let without =
                if k < without.poses.len() { without.without(outcome.left_out[0]) } else { without };
            let rmse =
                |score: &Option<Score>| score.as_ref().and_then(|s| s.rmse_mm).unwrap_or(f64::INFINITY);
            let (with, without) = (rmse(&outcome.score), rmse(&planned(without, piece, Mistake::None).score));
            if with > without + 0.05 {
                faults.push(format!("{with:.3} mm from the truth, {without:.3} mm without the view"));
            }
        }
    }
    let ids: Vec<&str> = outcome.reasons().into_iter().map(ReasonId::name).collect();
    let why = outcome.verdict.err().map(|why| why.chars().take(60).collect::<String>()).unwrap_or_default();
    let line = format!("{piece:<8} {words:<54} {:<8} {} {why}", state.name(), ids.join(" "));
    let at = |fault: String| format!("{piece}, {words}, seed {seed}: {fault}");
    (line, faults.into_iter().map(at).collect())
}

fn all(pieces: &[&str], seeds: &[u64]) {
    let mut faults = Vec::new();
    for row in ROWS {
        for (piece, seed) in pieces.iter().flat_map(|piece| seeds.iter().map(move |seed| (piece, *seed))) {
            let (line, wrong) = tried(row, piece, seed);
            println!("{line}");
            faults.extend(wrong);
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn no_mistake_is_ready_and_no_plan_that_is_right_is_refused() {
    all(ALWAYS, &[1]);
}

#[test]
#[ignore = "takes minutes: the same on all four pieces, with three seeds"]
fn no_mistake_of_any_seed_is_ready() {
    all(PIECES, &[1, 2, 3]);
}

/// Reads the fillet with poses, hand-eye transform and images changed; what is said.
fn said(change: impl FnOnce(&mut Manifest)) -> String {
    let images = images("fillet");
    let mut manifest = Manifest::read(&images);
    change(&mut manifest);
    let folder = tempfile::tempdir().unwrap();
    for view in manifest.views() {
        view["depth"] = json!(images.join(view["depth"].as_str().unwrap()));
    }
    std::fs::write(folder.path().join("scan.json"), manifest.json.to_string()).unwrap();
    let options = input::Options { allow_outside: true, ..Default::default() };
    input::read(folder.path(), &options).map_or_else(|error| error.to_string(), |scan| scan.notes.join("; "))
}

/// Puts another value in place of each pose.
fn each_pose(manifest: &mut Manifest, pose: impl Fn(&Isometry3<f64>) -> Value) {
    let poses = manifest.poses.clone();
    for (view, given) in manifest.views().iter_mut().zip(&poses) {
        view["base_from_flange"] = pose(given);
    }
}

fn at(pose: &Isometry3<f64>) -> Vector3<f64> {
    pose.translation.vector
}

fn six(t: Vector3<f64>, r: [f64; 3]) -> Value {
    json!([t.x, t.y, t.z, r[0], r[1], r[2]])
}

fn rpy(pose: &Isometry3<f64>) -> [f64; 3] {
    let (roll, pitch, yaw) = pose.rotation.euler_angles();
    [roll, pitch, yaw]
}

fn quaternion(pose: &Isometry3<f64>, key: &str, w_first: bool) -> Value {
    let q = pose.rotation.coords;
    let four = if w_first { [q.w, q.x, q.y, q.z] } else { [q.x, q.y, q.z, q.w] };
    json!({"xyz": at(pose).as_slice(), key: four})
}

fn rows(matrix: &Matrix4<f64>) -> Value {
    json!(matrix.row_iter().map(|row| row.iter().copied().collect()).collect::<Vec<Vec<f64>>>())
}

/// Each refusal names both parts.
fn named(refusals: Vec<(String, [&str; 2])>) {
    let wrong: Vec<String> = refusals
        .into_iter()
        .filter(|(said, parts)| !parts.iter().all(|part| said.contains(part)))
        .map(|(said, parts)| format!("{parts:?}: {said}"))
        .collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn poses_that_are_written_otherwise_are_refused_by_the_reading_that_fits() {
    let right = said(|_| {});
    assert!(!right.contains("misreadings") && right.contains("units: metres"), "{right}");
    named(vec![
        (
            said(|m| each_pose(m, |p| six(at(p), rpy(p)))),
            ["RPY about x, y, z in radians", "rotation vectors"],
        ),
        (
            said(|m| each_pose(m, |p| six(at(p), rpy(p).map(f64::to_degrees)))),
            ["RPY about x, y, z in degrees", "views[0]"],
        ),
        (
            said(|m| {
                each_pose(m, |p| {
                    let [x, y, z] = rpy(p).map(f64::to_degrees);
                    six(at(p), [z, y, x])
                });
            }),
            ["A, B, C of KUKA) in degrees", "views[0]"],
        ),
        (
            said(|m| {
                each_pose(m, |p| six(at(p), (p.rotation.scaled_axis() * 180.0 / std::f64::consts::PI).into()))
            }),
            ["rotation vector is in degrees", "views[0]"],
        ),
        (
            said(|m| {
                each_pose(m, |p| {
                    let p = p * Isometry3::translation(0.0, 0.0, 0.347);
                    six(at(&p), p.rotation.scaled_axis().into())
                })
            }),
            ["a tool's tip, about 3", "\"flange_from_tcp\": [0, 0, 0.3"],
        ),
        (
            said(|m| each_pose(m, |p| quaternion(p, "quaternion_xyzw", true))),
            ["w is first", "quaternion_wxyz"],
        ),
        (
            said(|m| each_pose(m, |p| quaternion(p, "quaternion_wxyz", false))),
            ["w is last", "quaternion_xyzw"],
        ),
        (
            said(|m| {
                each_pose(m, |p| {
                    let mut turned = p.to_homogeneous();
                    let rotation = turned.fixed_view::<3, 3>(0, 0).transpose();
                    turned.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
                    rows(&turned)
                })
            }),
            ["the rotations of base_from_flange are transposed", "row by row"],
        ),
        (
            said(|m| each_pose(m, |p| rows(&p.to_homogeneous().transpose()))),
            ["column by column", "Transpose"],
        ),
    ]);
}

#[test]
fn hand_eye_depth_and_images_that_are_meant_otherwise_are_refused_by_what_fits() {
    named(vec![
        (
            said(|m| {
                m.json["units"] = json!("mm");
                each_pose(m, |p| six(at(p) * 1000.0, p.rotation.scaled_axis().into()));
            }),
            ["the translation of flange_from_camera is in metres", "1000"],
        ),
        (
            said(|m| {
                let scale = m.json["camera"]["depth_scale_m"].as_f64().unwrap();
                m.json["camera"]["depth_scale_m"] = json!(scale * 10.0);
            }),
            ["each step of the images is", "depth_scale_m"],
        ),
        (
            said(|m| {
                let mut poses = m.poses.clone();
                poses.reverse();
                m.poses = poses;
                each_pose(m, |p| six(at(p), p.rotation.scaled_axis().into()));
            }),
            ["reverse order", "round"],
        ),
        (
            said(|m| {
                m.poses.rotate_left(1);
                each_pose(m, |p| six(at(p), p.rotation.scaled_axis().into()));
            }),
            ["each image belongs to the pose before its own", "missing"],
        ),
    ]);
}

#[test]
fn views_that_no_reading_fits_are_refused_with_that() {
    let lost = said(|m| {
        let mut random = Random::new(3);
        let poses: Vec<_> =
            (0..m.poses.len()).map(|k| moved(&mut random, &m.camera_m(k), 80.0, 15.0) * m.poses[k]).collect();
        m.poses = poses;
        each_pose(m, |p| six(at(p), p.rotation.scaled_axis().into()));
    });
    assert!(lost.contains("none of the usual misreadings"), "{lost}");
}

#[test]
fn the_documented_table_is_that_of_the_mistakes() {
    let (_, section) = TROUBLESHOOTING.split_once("### Mistakes that were tried").unwrap();
    let section = section.split("\n## ").next().unwrap();
    let row = |line: &'static str| {
        let mut cells = line.strip_prefix("| ")?.split(" | ");
        Some((cells.next()?, cells.next()?))
    };
    let documented: Vec<(&str, &str)> = section.lines().filter_map(row).skip(1).collect();
    let known: Vec<(&str, &str)> = ROWS.iter().map(|(words, _, states)| (*words, states[0].name())).collect();
    assert_eq!(documented, known);
}
