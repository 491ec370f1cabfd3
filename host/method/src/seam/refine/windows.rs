//! Raw points of two surfaces beside a path, sorted along it and read through windows (ours).

use super::beside::Beside;
use super::face::FacePoint;
use super::path::Path;
use std::ops::Range;

/// Weight at the end of a window, and cosine of incidence from which a point counts in full. Chosen on the simulated scans.
const LEAST_WEIGHT: f64 = 1e-3;
const FULL_INCIDENCE: f32 = 0.5;
/// Points beyond the end of a seam that are noise: one of so many, and at most this many.
const NOISE_ONE_OF: usize = 200;
const MOST_NOISE: usize = 12;

/// Points by surface and along the path.
pub(super) struct Windows {
    /// Sorted along the seam.
    pub(super) points: [Vec<Beside>; 2],
    /// Half length of a window, mm.
    pub(super) half_mm: f32,
    /// Length of the path, round which windows of a loop go on.
    length_mm: f32,
    closed: bool,
    views: usize,
}

impl Windows {
    pub(super) fn new(points: [Vec<Beside>; 2], path: &Path, half_mm: f32, views: usize) -> Self {
        Self { points, half_mm, length_mm: path.length_mm(), closed: path.closed, views }
    }

    /// Points of a surface within the window about `s`, with their distance along the seam from it.
    fn window(&self, face: usize, s: f32) -> impl Iterator<Item = (&Beside, f32)> {
        let points = &self.points[face];
        let about = move |shift: f32| {
            let from = points.partition_point(|p| p.s <= s + shift - self.half_mm);
            let to = points.partition_point(|p| p.s < s + shift + self.half_mm);
            points[from..to.max(from)].iter().map(move |p| (p, p.s - shift - s))
        };
        let round = if self.closed { &[0.0, -1.0, 1.0][..] } else { &[0.0] };
        round.iter().flat_map(move |turn| about(turn * self.length_mm))
    }

    /// The same as points of a fit, weighted down toward the ends of the window.
    pub(super) fn samples(&self, face: usize, s: f32) -> Vec<FacePoint> {
        let half = f64::from(self.half_mm);
        let sample = |(p, d): (&Beside, f32)| {
            let d = f64::from(d);
            let taper = 1.0 - (d.abs() / half).powi(3).min(1.0);
            // At grazing incidence jitter along the surface shows as depth.
            let seen = f64::from(p.incidence_cos / FULL_INCIDENCE).min(1.0);
            FacePoint { d, u: f64::from(p.u), h: f64::from(p.h), w: (taper * taper + LEAST_WEIGHT) * seen }
        };
        self.window(face, s).map(sample).collect()
    }

    /// Share of each view in the window about `s`.
    pub(super) fn view_share(&self, face: usize, s: f32) -> Vec<f32> {
        let mut share = vec![0.0; self.views];
        for (p, _) in self.window(face, s) {
            share[usize::from(p.view)] += 1.0;
        }
        let total: f32 = share.iter().sum::<f32>().max(1.0);
        share.iter().map(|v| v / total).collect()
    }

    /// Where along an open path both surfaces have points, counting those of `counts`; none of a loop.
    pub(super) fn both_seen_mm(&self, counts: impl Fn(&Beside) -> bool) -> Option<Range<f32>> {
        if self.closed {
            return None;
        }
        let (mut low, mut high) = (f32::MIN, f32::MAX);
        for points in &self.points {
            let all: Vec<f32> = points.iter().filter(|p| counts(p)).map(|p| p.s).collect();
            // A few points beyond the end are noise.
            let spare = (all.len() / NOISE_ONE_OF).min(MOST_NOISE);
            if let (Some(first), Some(last)) = (all.get(spare), all.get(all.len().saturating_sub(1 + spare)))
            {
                low = low.max(*first);
                high = high.min(*last);
            }
        }
        Some(low..high)
    }

    /// Distance along the path of two stations that are `beyond` steps apart, the shorter way round a loop, mm.
    pub(super) fn apart_mm(&self, beyond: f64, step_mm: f32) -> f64 {
        let d = beyond * f64::from(step_mm);
        if !self.closed {
            return d;
        }
        let length_mm = f64::from(self.length_mm);
        (d + 1.5 * length_mm).rem_euclid(length_mm) - 0.5 * length_mm
    }
}
