//! The line that a refinement starts from: stations at equal steps, resampled, smoothed and continued beyond its ends.

use super::Refined;
use super::beside::StationLine;
use super::frame::Frame;
use super::smooth::{Curve, Samples};
use crate::geometry::polyline::arc_lengths;
use crate::seam::trace::{Chain, ChainLink};
use nalgebra::{Point3, Rotation3, Vector3};

/// Stiffness with which a chain is smoothed before it is first fitted, mm³ per unit weight. Chosen on the simulated scans.
const LIGHTLY: f64 = 3e2;
/// Stations from the end of a path over which it is told how it bends there.
const LOOK_BACK: usize = 6;
/// Fewest steps of a path.
const LEAST_STEPS: usize = 4;
/// Shorter steps have no length to divide by, mm.
const LEAST_STEP_MM: f64 = 1e-12;

/// A place on a path and the normals of the faces there, on their way to a [`Frame`]: neither unit nor square.
#[derive(Debug, Clone, Copy)]
pub(super) struct PathPoint {
    pub(super) position_mm: Vector3<f64>,
    pub(super) faces: [Vector3<f64>; 2],
}

impl From<&ChainLink> for PathPoint {
    fn from(link: &ChainLink) -> Self {
        Self { position_mm: link.position.coords.cast(), faces: link.faces.map(|n| n.cast()) }
    }
}

impl From<&Frame> for PathPoint {
    fn from(frame: &Frame) -> Self {
        Self { position_mm: frame.position.coords.cast(), faces: frame.faces.map(|n| n.cast()) }
    }
}

impl PathPoint {
    /// What is smoothed of it: position, first and second normal.
    fn values(&self) -> [f64; 9] {
        let [a, b] = self.faces;
        let p = self.position_mm;
        [p.x, p.y, p.z, a.x, a.y, a.z, b.x, b.y, b.z]
    }

    fn from_values(v: [f64; 9]) -> Self {
        let vector = |k: usize| Vector3::new(v[k], v[k + 1], v[k + 2]);
        Self { position_mm: vector(0), faces: [vector(3), vector(6)] }
    }

    /// At a share of the way from one to another.
    pub(super) fn mixed(a: &Self, b: &Self, share: f64) -> Self {
        let mix = |a: &Vector3<f64>, b: &Vector3<f64>| a * (1.0 - share) + b * share;
        Self {
            position_mm: mix(&a.position_mm, &b.position_mm),
            faces: [mix(&a.faces[0], &b.faces[0]), mix(&a.faces[1], &b.faces[1])],
        }
    }
}

/// Stations at equal steps.
pub(super) struct Path {
    pub(super) frames: Vec<Frame>,
    pub(super) step_mm: f32,
    pub(super) closed: bool,
}

impl Path {
    /// A chain, lightly smoothed, at about `step_mm`.
    pub(super) fn along(chain: &Chain, step_mm: f32) -> Option<Self> {
        let points: Vec<PathPoint> = chain.links.iter().map(PathPoint::from).collect();
        if points.len() < 2 {
            return None;
        }
        let (points, step_mm) = resampled(&points, chain.closed, step_mm);
        let values: Vec<[f64; 9]> = points.iter().map(PathPoint::values).collect();
        let weights = vec![1.0; values.len()];
        let samples =
            Samples { values: &values, weights: &weights, step_mm: f64::from(step_mm), closed: chain.closed };
        let smooth = samples.smooth(Curve::Spline(LIGHTLY));
        let points: Vec<PathPoint> = smooth.into_iter().map(PathPoint::from_values).collect();
        let frames = frames(&points, chain.closed)?;
        Some(Self { frames, step_mm, closed: chain.closed })
    }

    /// The path of a refined seam, to be refined again.
    pub(super) fn of(seam: &Refined) -> Self {
        Self { frames: seam.frames.clone(), step_mm: seam.step_mm, closed: seam.closed }
    }

    /// The station nearest to a place along it, mm.
    pub(super) fn station_at(&self, s_mm: f32) -> usize {
        ((s_mm / self.step_mm).round().max(0.0) as usize).min(self.frames.len() - 1)
    }

    /// Its stations, to find feet on.
    pub(super) fn line(&self) -> StationLine<'_> {
        StationLine { frames: &self.frames, step_mm: self.step_mm, closed: self.closed }
    }

    /// Length of its steps, with one more than there are between the ends of an open path, mm.
    pub(super) fn length_mm(&self) -> f32 {
        self.step_mm * self.frames.len() as f32
    }

    /// Continues an open path, bending on as it bends, to find where the seam ends.
    pub(super) fn extend(&mut self, stations: usize) {
        if self.closed {
            return;
        }
        let after = onward(&self.frames, self.step_mm, stations);
        let reversed: Vec<Frame> = self.frames.iter().rev().map(Frame::reversed).collect();
        let before = onward(&reversed, self.step_mm, stations);
        let before = before.iter().rev().map(Frame::reversed);
        self.frames = before.chain(self.frames.iter().copied()).chain(after).collect();
    }
}

/// Frames after the last of an open path, each turned against the one before as the path turns at its end.
fn onward(frames: &[Frame], step_mm: f32, stations: usize) -> Vec<Frame> {
    let (Some(last), Some(earlier)) =
        (frames.last().copied(), frames.len().checked_sub(1 + LOOK_BACK).and_then(|k| frames.get(k)))
    else {
        return Vec::new();
    };
    let turn = Rotation3::rotation_between(&earlier.tangent, &last.tangent).unwrap_or_default();
    let (step, half) = (turn.powf(1.0 / LOOK_BACK as f32), turn.powf(0.5 / LOOK_BACK as f32));
    let mut frame = last;
    let mut after = Vec::with_capacity(stations);
    for _ in 0..stations {
        let position = frame.position + half * frame.tangent * step_mm;
        frame = Frame { position, tangent: step * frame.tangent, faces: frame.faces.map(|n| step * n) };
        after.push(frame);
    }
    after
}

/// Points at equal steps of the arc length, and that step, mm.
pub(super) fn resampled(points: &[PathPoint], closed: bool, step_mm: f32) -> (Vec<PathPoint>, f32) {
    let mut points = points.to_vec();
    if closed {
        points.push(points[0]);
    }
    let at = arc_lengths(&points, |a, b| (b.position_mm - a.position_mm).norm());
    let length = at[at.len() - 1];
    let steps = ((length / f64::from(step_mm)).round() as usize).max(LEAST_STEPS);
    let mut out = Vec::with_capacity(steps + 1);
    let mut k = 0;
    for i in 0..steps + usize::from(!closed) {
        let s = length * i as f64 / steps as f64;
        while k + 2 < points.len() && at[k + 1] < s {
            k += 1;
        }
        let share = ((s - at[k]) / (at[k + 1] - at[k]).max(LEAST_STEP_MM)).clamp(0.0, 1.0);
        out.push(PathPoint::mixed(&points[k], &points[k + 1], share));
    }
    (out, (length / steps as f64) as f32)
}

/// Of so many stations `among` the one that is nearest to the `k`th of `count` resampled ones.
pub(super) fn nearest(k: usize, count: usize, among: usize) -> usize {
    (k * among / count).min(among - 1)
}

/// Frames of points of a path, the tangent by central differences.
pub(super) fn frames(points: &[PathPoint], closed: bool) -> Option<Vec<Frame>> {
    let n = points.len();
    let place = |k: usize| Point3::from(points[k].position_mm.cast::<f32>());
    (0..n)
        .map(|k| {
            // At an end the parabola through the last three keeps the tangent of a curved seam.
            let onward = |a: usize, b: usize, c: usize| (place(b) - place(a)) * 4.0 - (place(c) - place(a));
            let tangent = match (closed, k) {
                (true, _) => place((k + 1) % n) - place((k + n - 1) % n),
                (false, 0) if n > 2 => onward(0, 1, 2),
                (false, _) if k + 1 == n && n > 2 => -onward(k, k - 1, k - 2),
                _ => place((k + 1).min(n - 1)) - place(k.saturating_sub(1)),
            };
            Frame::new(place(k), tangent, points[k].faces.map(|normal| normal.cast()))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_single_place_is_no_path() {
        let link = ChainLink {
            position: Point3::origin(),
            direction: Vector3::x(),
            faces: [Vector3::y(), Vector3::z()],
        };
        let chain = |links: usize| Chain { links: vec![link; links], ..Chain::default() };
        assert!((0..2).all(|links| Path::along(&chain(links), 1.0).is_none()));
    }
}
