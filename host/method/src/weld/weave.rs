//! Weave (ours): the tip swings about the seam's line while it travels along it.
//!
//! Everything is said in the plane of the section at the place that the travel has reached: across to the right of it,
//! and out of the work. Between corners there is a whole number of waves, the nearest to what was asked for, so a
//! weave begins and ends on the line and passes every corner there. The travel along the seam keeps the feed: the
//! tip itself moves faster, as it goes a longer way.

use std::f64::consts::TAU;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::resampling::{keep_signs, runs_between_corners, without_repeats};
use super::{PathPoint, Process, SeamPath, at};

/// How the tip swings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
#[schemars(rename = "WeaveShape")]
pub enum Shape {
    /// Not at all.
    #[default]
    None,
    /// Across as a sine of the way.
    Sine,
    /// Straight from side to side.
    Zigzag,
    /// From the line to the left, to the right, and back; both sides raised out of the work by `height_mm`.
    Triangle,
    /// Round in circles.
    Circle,
}

/// A weave.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Weave {
    /// How the tip swings.
    pub shape: Shape,
    /// From the line to the farthest place on either side, mm.
    pub amplitude_mm: f64,
    /// Travel in one swing to both sides, mm.
    pub wavelength_mm: f64,
    /// How far both sides of [`Shape::Triangle`] are out of the work, mm.
    pub height_mm: f64,
    /// Standing still at the left of the travel, s.
    pub dwell_left_s: f64,
    /// Standing still at the right of it, s.
    pub dwell_right_s: f64,
}

/// Shortest way that a speed is derived from, mm.
const MIN_TRAVEL_MM: f64 = 1e-6;

/// A place within a wave, by its phase 0..1.
struct Swing {
    phase: f64,
    along_mm: f64,
    across_mm: f64,
    out_mm: f64,
    dwell_s: f64,
}

/// The path with the weave on it. Orientations are those of the line; `s_mm` is the travel along it.
pub fn weave(path: &SeamPath, weave: &Weave) -> SeamPath {
    if weave.shape == Shape::None {
        return path.clone();
    }
    let line = without_repeats(&path.points);
    if line.len() < 2 {
        return path.with(line);
    }
    let swings = swings(weave);
    let mut points: Vec<PathPoint> = Vec::new();
    for (a, b) in runs_between_corners(&line) {
        points.extend(run(&line[a..=b], weave.wavelength_mm, &swings));
    }
    points.extend(line.last());
    let points = with_speeds(points);
    path.with(points)
}

/// One wave.
fn swings(weave: &Weave) -> Vec<Swing> {
    let Weave { amplitude_mm, height_mm, dwell_left_s, dwell_right_s, .. } = *weave;
    let round = |count: u32| (0..count).map(move |k| f64::from(k) / f64::from(count));
    let dwell = |phase: f64| match phase {
        0.25 => dwell_left_s,
        0.75 => dwell_right_s,
        _ => 0.0,
    };
    let flat = |phase: f64, along_mm, across_mm| Swing {
        phase,
        along_mm,
        across_mm,
        out_mm: 0.0,
        dwell_s: dwell(phase),
    };
    let corner =
        |phase, across_mm, dwell_s| Swing { phase, along_mm: 0.0, across_mm, out_mm: height_mm, dwell_s };
    match weave.shape {
        Shape::None => Vec::new(),
        Shape::Sine => round(16).map(|phase| flat(phase, 0.0, -amplitude_mm * (TAU * phase).sin())).collect(),
        Shape::Zigzag => vec![flat(0.25, 0.0, -amplitude_mm), flat(0.75, 0.0, amplitude_mm)],
        Shape::Triangle => vec![
            flat(0.0, 0.0, 0.0),
            corner(1.0 / 3.0, -amplitude_mm, dwell_left_s),
            corner(2.0 / 3.0, amplitude_mm, dwell_right_s),
        ],
        Shape::Circle => round(24)
            .map(|phase| {
                let angle = TAU * phase;
                flat(phase, amplitude_mm * (angle.cos() - 1.0), -amplitude_mm * angle.sin())
            })
            .collect(),
    }
}

/// The weave over a stretch without a corner, from its first point up to, but not with, its last.
fn run(line: &[PathPoint], wavelength_mm: f64, swings: &[Swing]) -> Vec<PathPoint> {
    let (from_mm, to_mm) = (line[0].s_mm, line[line.len() - 1].s_mm);
    let waves = ((to_mm - from_mm) / wavelength_mm).round();
    if waves < 1.0 {
        return line[..line.len() - 1].to_vec();
    }
    let wave_mm = (to_mm - from_mm) / waves;
    let starts_on_line = swings.first().is_some_and(|swing| swing.phase == 0.0);
    let mut points: Vec<PathPoint> = line.first().filter(|_| !starts_on_line).copied().into_iter().collect();
    for wave in 0..waves as usize {
        let places = swings.iter().filter_map(|swing| {
            let on_line = at(line, from_mm + wave_mm * (wave as f64 + swing.phase))?;
            Some(swung(&on_line, swing))
        });
        points.extend(places);
    }
    points
}

fn swung(on_line: &PathPoint, swing: &Swing) -> PathPoint {
    let off_mm = on_line.along_travel() * swing.along_mm
        + on_line.right_of_travel() * swing.across_mm
        + on_line.out_of_work() * swing.out_mm;
    let dwell_s = (swing.dwell_s > 0.0).then_some(swing.dwell_s).or(on_line.process.dwell_s);
    PathPoint {
        position_mm: on_line.position_mm + off_mm,
        process: Process { dwell_s, ..on_line.process },
        ..*on_line
    }
}

/// Speeds that keep the travel at the feed.
fn with_speeds(mut points: Vec<PathPoint>) -> Vec<PathPoint> {
    for k in 1..points.len() {
        let (before, here) = (points[k - 1], &mut points[k]);
        let way_mm = (here.position_mm - before.position_mm).norm();
        here.process.feed_factor *= (way_mm / (here.s_mm - before.s_mm).max(MIN_TRAVEL_MM)).max(1.0);
    }
    keep_signs(&mut points);
    points
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};

    /// Along +x on a level table, 40 mm; right of the travel is -y.
    fn line() -> SeamPath {
        let axes = Matrix3::from_columns(&[-Vector3::y(), Vector3::x(), Vector3::z()]);
        let base_from_torch = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        let at = |i: i32| PathPoint {
            s_mm: 2.0 * f64::from(i),
            position_mm: Point3::new(2.0 * f64::from(i), 0.0, 0.0),
            base_from_torch,
            process: Process::default(),
        };
        SeamPath { seam: 1, points: (0..=20).map(at).collect() }
    }

    fn weave_of(shape: Shape) -> Weave {
        Weave {
            shape,
            amplitude_mm: 2.5,
            wavelength_mm: 4.2,
            height_mm: 1.5,
            dwell_left_s: 0.2,
            dwell_right_s: 0.3,
        }
    }

    const SHAPES: [Shape; 4] = [Shape::Sine, Shape::Zigzag, Shape::Triangle, Shape::Circle];
    /// 40 mm hold ten waves, the nearest to 4.2 mm.
    const WAVE_MM: f64 = 4.0;

    #[test]
    fn a_weave_begins_and_ends_on_the_line_and_reaches_the_amplitude_on_both_sides() {
        for shape in SHAPES {
            let woven = weave(&line(), &weave_of(shape));
            let ends = [woven.points[0].position_mm, woven.points[woven.points.len() - 1].position_mm];
            assert_eq!(ends, [Point3::new(0.0, 0.0, 0.0), Point3::new(40.0, 0.0, 0.0)], "{shape:?}");
            let across = |f: fn(f64, f64) -> f64| woven.points.iter().map(|p| p.position_mm.y).fold(0.0, f);
            assert!(
                (across(f64::max) - 2.5).abs() < 1e-9 && (across(f64::min) + 2.5).abs() < 1e-9,
                "{shape:?}"
            );
        }
    }

    #[test]
    fn a_sine_is_a_sine_and_a_circle_a_circle() {
        for p in weave(&line(), &weave_of(Shape::Sine)).points {
            let left_mm = 2.5 * (TAU * p.position_mm.x / WAVE_MM).sin();
            assert!((p.position_mm.y - left_mm).abs() < 1e-9, "left of the travel first");
        }
        for p in weave(&line(), &weave_of(Shape::Circle)).points {
            // The centre travels along the line, one radius behind it.
            let from_centre = Vector3::new(p.position_mm.x - p.s_mm + 2.5, p.position_mm.y, p.position_mm.z);
            assert!((from_centre.norm() - 2.5).abs() < 1e-9);
        }
    }

    #[test]
    fn a_triangle_has_its_corners_on_the_line_and_raised_at_both_sides() {
        let woven = weave(&line(), &weave_of(Shape::Triangle));
        let first: Vec<Point3<f64>> = woven.points[..4].iter().map(|p| p.position_mm).collect();
        let third = WAVE_MM / 3.0;
        let expected =
            [[0.0; 3], [third, 2.5, 1.5], [2.0 * third, -2.5, 1.5], [WAVE_MM, 0.0, 0.0]].map(Point3::from);
        assert!(first.iter().zip(&expected).all(|(a, b)| (a - b).norm() < 1e-9), "{first:?}");
    }

    #[test]
    fn the_torch_dwells_left_and_right_and_nowhere_else() {
        for shape in [Shape::Sine, Shape::Zigzag, Shape::Triangle] {
            let woven = weave(&line(), &weave_of(shape));
            let mut dwells = 0;
            for p in woven.points {
                let expected = match p.position_mm.y {
                    y if (y - 2.5).abs() < 1e-9 => Some(0.2),
                    y if (y + 2.5).abs() < 1e-9 => Some(0.3),
                    _ => None,
                };
                assert_eq!(p.process.dwell_s, expected, "{shape:?} at {}", p.position_mm);
                dwells += usize::from(expected.is_some());
            }
            assert_eq!(dwells, 20, "{shape:?}");
        }
    }

    #[test]
    fn the_travel_along_the_seam_keeps_its_feed() {
        for shape in SHAPES {
            let woven = weave(&line(), &weave_of(shape));
            let took: f64 = woven
                .points
                .windows(2)
                .map(|w| (w[1].position_mm - w[0].position_mm).norm() / (8.0 * w[1].process.feed_factor))
                .sum();
            assert!((took - 40.0 / 8.0).abs() < 1e-9, "{shape:?}: {took} s");
        }
    }

    #[test]
    fn a_corner_is_passed_on_the_line() {
        let mut bend = line();
        bend.points.extend((1..=10).map(|i| {
            let y = 2.0 * f64::from(i);
            PathPoint { s_mm: 40.0 + y, position_mm: Point3::new(40.0, y, 0.0), ..line().points[0] }
        }));
        for shape in SHAPES {
            let woven = weave(&bend, &weave_of(shape));
            let corner = Point3::new(40.0, 0.0, 0.0);
            assert!(woven.points.iter().any(|p| (p.position_mm - corner).norm() < 1e-9), "{shape:?}");
        }
    }

    #[test]
    fn a_stretch_shorter_than_half_a_wave_is_not_woven() {
        let wide = Weave { wavelength_mm: 90.0, ..weave_of(Shape::Sine) };
        let woven = weave(&line(), &wide);
        assert!(woven.points.iter().all(|p| p.position_mm.y == 0.0));
        assert_eq!(woven.points.len(), line().points.len());
    }
}
