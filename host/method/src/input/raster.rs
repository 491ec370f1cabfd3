//! Where the cameras stood, from the order of a file's points (ours).
//!
//! Programs write the points of a depth image pixel by pixel. However wrong a depth is, its point lies on the ray of its pixel: the
//! points of a row lie in one plane through the camera, also after a rigid motion. The planes of all rows meet in a line
//! through the camera, along the rows. In that line the camera is where neighbours in a row are one pixel apart
//! at every depth. A file of several pictures changes its line where the next one begins. What was thinned, filtered by neighbourhoods or
//! sorted has no such rows.

use super::raw::Positions;
use crate::geometry::statistics::median;
use nalgebra::{Matrix3, Vector3};
use std::ops::Range;

/// Consecutive points are of one row while they are this near to each other, usual steps: over a pixel that is missing.
const SAME_ROW: f64 = 4.0;
/// Steps that tell the usual one.
const STEPS: usize = 30_000;
/// Points of the shortest row that has a plane.
const LEAST_POINTS: usize = 12;
/// The plane of a row is known if its angle is, as one standard deviation: half of a small pixel.
const KNOWN_RAD: f64 = 1e-3;
/// Rows that tell a line, and rows among which the end of a picture is sought.
const LEAST_ROWS: usize = 24;
const RUN: usize = 8;
const _: () = assert!(RUN < LEAST_ROWS);
/// A plane meets the camera if it passes it within this many pixels; so do this share of the planes of a picture.
const MEETS_PIXELS: f64 = 1.0;
const LEAST_MEETING: f64 = 0.8;
/// The least deviation of a plane from the line, steps: lenses are not quite without distortion.
const OFF_STEPS: f64 = 0.02;
/// Rounds of leaving out what does not fit.
const ROUNDS: usize = 6;
/// Standard deviations beyond which a plane is left out.
const OUTLIER: f64 = 3.0;
/// Nearer to the origin than this share of its distance from the points, a camera is at the origin.
const AT_ORIGIN: f64 = 0.005;

/// A part of a cloud that one camera took.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Shot {
    /// Which points.
    pub(super) points: Range<usize>,
    /// Where the camera stood, file units.
    pub(super) camera: Vector3<f64>,
}

/// The pictures that a cloud was made of, in their order; none where its points are in no such order.
pub(super) fn shots(positions: &Positions) -> Option<Vec<Shot>> {
    let step = usual_step(positions)?;
    let rows = runs(positions, SAME_ROW * step).into_iter().filter_map(|run| Row::of(positions, run));
    let rows: Vec<Row> = rows.filter(|row| row.turn_rad < KNOWN_RAD).collect();
    // Of each picture where it begins.
    let mut pictures: Vec<(usize, Camera)> = Vec::new();
    let mut begin = 0;
    while begin < rows.len() {
        if rows.len() - begin < LEAST_ROWS && !pictures.is_empty() {
            break;
        }
        let (end, line) = picture(&rows, begin, step)?;
        // Rows that a lens bends, or that are no rows, may part a picture.
        if pictures.last().is_some_and(|(_, before)| before.rows.is_of(&rows[begin..end], step)) {
            begin = end;
            continue;
        }
        let camera = Camera::on(line, positions, &rows[begin..end])?;
        // A run of rows is taken as a whole, and there may be rows between whose planes are not known.
        let first = pictures.last().map_or(0, |(_, before)| {
            let between = rows[begin - RUN].points.start..rows[begin + RUN].points.start;
            change(positions, between, before, &camera)
        });
        pictures.push((first, camera));
        begin = end;
    }
    let ends: Vec<usize> =
        pictures.iter().skip(1).map(|(first, _)| *first).chain([positions.len()]).collect();
    let shot = |((first, Camera { rows, .. }), end): (&(usize, Camera), usize)| {
        let apart = (positions.at(*first) - rows.at).norm();
        let camera = if rows.at.norm() < AT_ORIGIN * apart { Vector3::zeros() } else { rows.at };
        Shot { points: *first..end, camera }
    };
    (!pictures.is_empty()).then(|| pictures.iter().zip(ends).map(shot).collect())
}

/// The median distance of consecutive points.
fn usual_step(positions: &Positions) -> Option<f64> {
    let last = positions.len().checked_sub(1)?;
    let every = last / STEPS + 1;
    let mut steps: Vec<f64> =
        (0..last).step_by(every).map(|i| (positions.at(i + 1) - positions.at(i)).norm()).collect();
    (!steps.is_empty()).then(|| median(&mut steps)).filter(|step| *step > 0.0)
}

/// Neighbouring points of one row of pixels, and the plane that they lie in.
struct Row {
    points: Range<usize>,
    normal: Vector3<f64>,
    middle: Vector3<f64>,
    /// One standard deviation of the plane's angle about the row, rad.
    turn_rad: f64,
}

/// Points that follow each other at most this far apart: rows of pixels, or parts of them.
fn runs(positions: &Positions, reach: f64) -> Vec<Range<usize>> {
    let mut runs = Vec::new();
    let mut begin = 0;
    for end in 1..=positions.len() {
        if end == positions.len() || (positions.at(end) - positions.at(end - 1)).norm() >= reach {
            runs.push(begin..end);
            begin = end;
        }
    }
    runs
}

impl Row {
    fn of(positions: &Positions, points: Range<usize>) -> Option<Self> {
        let count = points.len() as f64;
        if points.len() < LEAST_POINTS {
            return None;
        }
        let middle = points.clone().map(|i| positions.at(i)).sum::<Vector3<f64>>() / count;
        let spread = points.clone().fold(Matrix3::zeros(), |sum, i| {
            let off = positions.at(i) - middle;
            sum + off * off.transpose()
        });
        let eigen = (spread / count).symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        let [off, across] = [order[0], order[1]].map(|k| eigen.eigenvalues[k]);
        // What the last digit of a coordinate leaves.
        let digit = f64::from(f32::EPSILON) * middle.amax();
        let turn_rad = (off.max(digit * digit) / (count * across.max(f64::MIN_POSITIVE))).sqrt();
        Some(Self { points, normal: eigen.eigenvectors.column(order[0]).into_owned(), middle, turn_rad })
    }
}

/// Where the planes of a picture's rows meet.
struct Line {
    at: Vector3<f64>,
    /// Unit.
    along: Vector3<f64>,
}

/// From row `begin` on, where the rows of one picture end, and where their planes meet.
fn picture(rows: &[Row], begin: usize, step: f64) -> Option<(usize, Line)> {
    let mut end = (begin + LEAST_ROWS).min(rows.len());
    if end - begin < LEAST_ROWS {
        return None;
    }
    loop {
        let line = Line::through(&rows[begin..end], step)?;
        if !line.is_of(&rows[begin..end], step) {
            return None;
        }
        // Twice as many rows tell the line better, and so where it ends.
        let ahead = &rows[end..rows.len().min(2 * end - begin)];
        let runs = ahead.chunks(RUN).take_while(|run| line.is_of(run, step));
        let known: usize = runs.map(<[Row]>::len).sum();
        end += known;
        if known < ahead.len() || ahead.is_empty() {
            end += rows[end..].iter().take_while(|row| line.meets(row, step)).count();
            let line = Line::through(&rows[begin..end], step)?;
            return Some((end, line));
        }
    }
}

impl Line {
    /// The line that is nearest to all planes, each as sure as its angle is.
    fn through(rows: &[Row], step: f64) -> Option<Self> {
        let from = rows.iter().map(|row| row.middle).sum::<Vector3<f64>>() / rows.len() as f64;
        let mut line: Option<Self> = None;
        let mut fits = vec![true; rows.len()];
        for _ in 0..ROUNDS {
            let deviation = |row: &Row| {
                let apart = line.as_ref().map_or(1.0, |line| (line.at - row.middle).norm());
                let least = if line.is_some() { OFF_STEPS * step } else { 0.0 };
                (row.turn_rad * apart).hypot(least)
            };
            let (mut normal_matrix, mut right) = (Matrix3::zeros(), Vector3::zeros());
            for (row, _) in rows.iter().zip(&fits).filter(|(_, fits)| **fits) {
                let weight = deviation(row).powi(-2);
                normal_matrix += row.normal * row.normal.transpose() * weight;
                right += row.normal * (weight * row.normal.dot(&(row.middle - from)));
            }
            let eigen = normal_matrix.symmetric_eigen();
            let free = eigen.eigenvalues.imin();
            let across = (0..3).filter(|k| *k != free);
            let mut at = from;
            for k in across {
                let axis = eigen.eigenvectors.column(k);
                at += axis * (axis.dot(&right) / eigen.eigenvalues[k]);
            }
            if !at.iter().all(|c| c.is_finite()) {
                return None;
            }
            let along = eigen.eigenvectors.column(free).into_owned();
            let found = Self { at, along };
            let mut off: Vec<f64> = Vec::with_capacity(rows.len());
            off.extend(rows.iter().map(|row| found.off(row) / deviation(row)));
            let most = OUTLIER * median(&mut off.clone()).max(1.0);
            fits = off.iter().map(|off| *off <= most).collect();
            line = Some(found);
        }
        line
    }

    /// How far the plane of a row passes it.
    fn off(&self, row: &Row) -> f64 {
        row.normal.dot(&(self.at - row.middle)).abs()
    }

    fn meets(&self, row: &Row, step: f64) -> bool {
        self.off(row) < MEETS_PIXELS * step
    }

    /// Whether rows are of its picture.
    fn is_of(&self, rows: &[Row], step: f64) -> bool {
        let meeting = rows.iter().filter(|row| self.meets(row, step)).count();
        meeting as f64 >= LEAST_MEETING * rows.len() as f64
    }
}

/// The camera that took a picture.
struct Camera {
    /// Where the planes of its rows meet; `at` is where it stood.
    rows: Line,
    /// By how much the tangents of neighbouring pixels along a row differ.
    pixel: f64,
}

impl Camera {
    /// On this line there is one place whence the tangents of neighbouring pixels in a row differ by the same everywhere.
    fn on(line: Line, positions: &Positions, rows: &[Row]) -> Option<Self> {
        /// A pixel that is missing makes twice the step.
        const ONE_PIXEL: f64 = 0.3;
        let mut camera = Self { rows: line, pixel: 0.0 };
        for _ in 0..ROUNDS {
            let (mut product, mut square) = (0.0, 0.0);
            let mut pixels = Vec::with_capacity(rows.len());
            for row in rows {
                let pairs = row.points.start..row.points.end - 1;
                let mut steps: Vec<[f64; 2]> = pairs.map(|i| camera.step(positions, i)).collect();
                let pixel = median(&mut steps.iter().map(|step| step[0]).collect::<Vec<_>>());
                pixels.push(pixel);
                steps.retain(|step| (step[0] - pixel).abs() < ONE_PIXEL * pixel.abs());
                let mean = |k: usize| steps.iter().map(|step| step[k]).sum::<f64>() / steps.len() as f64;
                let means = [mean(0), mean(1)];
                for [step, inverse] in &steps {
                    product += (step - means[0]) * (inverse - means[1]);
                    square += (inverse - means[1]) * (inverse - means[1]);
                }
            }
            let further = product / square;
            if !further.is_finite() {
                return None;
            }
            camera.rows.at += camera.rows.along * further;
            camera.pixel = median(&mut pixels);
        }
        Some(camera)
    }

    /// From a point to the next one: by how much their rays' tangents along the rows differ, and by how much their inverse distances from
    /// the line do.
    fn step(&self, positions: &Positions, i: usize) -> [f64; 2] {
        let seen = |i: usize| {
            let ray = positions.at(i) - self.rows.at;
            let x = ray.dot(&self.rows.along);
            let apart = (ray - self.rows.along * x).norm();
            [x / apart, 1.0 / apart]
        };
        let (from, to) = (seen(i), seen(i + 1));
        [to[0] - from[0], to[1] - from[1]]
    }

    /// How far from one pixel along a row such a step is, and how far from the row: pixels, each at most one.
    fn misfit(&self, positions: &Positions, i: usize) -> f64 {
        let along = self.step(positions, i)[0] / self.pixel - 1.0;
        let [from, to] = [i, i + 1].map(|i| (positions.at(i) - self.rows.at).cross(&self.rows.along));
        let across = from.cross(&to).norm() / (from.norm() * to.norm()) / self.pixel;
        along.abs().min(1.0) + across.abs().min(1.0)
    }
}

/// From which point on one camera explains the steps better than the other before it.
fn change(positions: &Positions, between: Range<usize>, before: &Camera, after: &Camera) -> usize {
    let (mut first, mut gain, mut most) = (between.start, 0.0, 0.0);
    for i in between.start..between.end - 1 {
        gain += after.misfit(positions, i) - before.misfit(positions, i);
        if gain > most {
            (first, most) = (i + 2, gain);
        }
    }
    first
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, Point3, Rotation3, Translation3};

    const WIDE: usize = 160;
    const HIGH: usize = 120;

    /// From -0.5 to 0.5, by number.
    fn chance(k: usize) -> f64 {
        ((k as f64 * 12.9898).sin() * 43_758.547).rem_euclid(1.0) - 0.5
    }

    /// What a camera sees of a box on a table 600 mm away with noise of 0.3 mm, a tenth of its pixels lost, and moved, in single precision.
    fn picture_from(pose: &Isometry3<f64>, seed: usize) -> Vec<Point3<f32>> {
        let pixel = |k: usize| {
            let ray = Vector3::new((k % WIDE) as f64 - 70.0, (k / WIDE) as f64 - 55.0, 200.0) / 200.0;
            let on_box = ray * (540.0 + 0.1 * 540.0 * ray.x);
            let depth = if on_box.x.abs() < 120.0 && on_box.y.abs() < 90.0 { on_box.z } else { 600.0 };
            (chance(k + 5 * seed) < 0.4).then(|| ray * (depth + chance(k + seed)))
        };
        let points = (0..WIDE * HIGH).filter_map(pixel);
        points.map(|p| (pose * Point3::from(p)).cast::<f32>()).collect()
    }

    fn pose(at: [f64; 3], turn: [f64; 3]) -> Isometry3<f64> {
        let turn = Rotation3::from_euler_angles(turn[0], turn[1], turn[2]);
        Isometry3::from_parts(Translation3::from(Vector3::from(at)), turn.into())
    }

    fn found(points: Vec<Point3<f32>>) -> Option<Vec<Shot>> {
        shots(&Positions::Single(points))
    }

    #[test]
    fn cameras_are_found_in_any_frame_where_each_picture_begins() {
        let poses = [
            pose([0.0; 3], [0.0; 3]),
            pose([700.0, -200.0, 900.0], [2.6, 0.2, 0.4]),
            pose([-300.0, 400.0, 650.0], [-2.9, 0.4, -1.0]),
        ];
        let pictures: Vec<Vec<Point3<f32>>> =
            (0..).zip(&poses).map(|(k, pose)| picture_from(pose, k)).collect();
        for (pose, picture) in poses.iter().zip(&pictures) {
            let [one] = &found(picture.clone()).unwrap()[..] else { panic!("several") };
            assert!(
                (one.camera - pose.translation.vector).norm() < 0.5,
                "{} {}",
                one.camera,
                pose.translation
            );
        }
        let shots = found(pictures.concat()).unwrap();
        assert_eq!(shots.len(), 3);
        let mut begin = 0;
        for ((shot, pose), picture) in shots.iter().zip(&poses).zip(&pictures) {
            assert_eq!(shot.points, begin..begin + picture.len());
            assert!((shot.camera - pose.translation.vector).norm() < 0.5);
            begin += picture.len();
        }
        assert_eq!(shots[0].camera, Vector3::zeros(), "what is as good as the origin is the origin");
    }

    #[test]
    fn a_picture_that_is_written_column_by_column_tells_its_camera_as_well() {
        let pose = pose([700.0, -200.0, 900.0], [2.6, 0.2, 0.4]);
        let pixel = |k: usize| {
            let ray = Vector3::new((k / HIGH) as f64 - 80.0, (k % HIGH) as f64 - 60.0, 200.0) / 200.0;
            (pose * Point3::from(ray * (600.0 - 80.0 * ray.y.abs() + chance(k)))).cast::<f32>()
        };
        let [one] = &found((0..WIDE * HIGH).map(pixel).collect()).unwrap()[..] else { panic!("several") };
        assert!((one.camera - pose.translation.vector).norm() < 0.5, "{}", one.camera);
    }

    #[test]
    fn points_in_another_order_tell_no_camera() {
        let picture = picture_from(&pose([700.0, -200.0, 900.0], [2.6, 0.2, 0.4]), 1);
        let shuffled = (0..picture.len()).map(|k| picture[k * 7919 % picture.len()]).collect();
        assert_eq!(found(shuffled), None);
        // Profiles of a laser line: parallel planes.
        let profile = |k: usize| {
            let (x, y) = ((k % WIDE) as f64, (k / WIDE) as f64);
            Point3::new(x, y, 0.2 * x.min(80.0) + chance(k)).cast::<f32>()
        };
        let profiles: Vec<Point3<f32>> = (0..WIDE * HIGH).map(profile).collect();
        let far = |shot: &Shot| shot.camera.norm() > 1e4;
        assert!(found(profiles).is_none_or(|shots| shots.iter().all(far)));
        assert_eq!(found(vec![Point3::new(1.0, 2.0, 3.0); 500]), None);
        assert_eq!(found(Vec::new()), None);
    }
}
