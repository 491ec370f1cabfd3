//! A path that somebody taught, as truth: its polyline at 1 mm spacing, with its torch frames.

use super::Error;
use super::path_set::PathSet;
use super::truth::{MAX_STATIONS, Truth, TruthSeam};
use nalgebra::{Matrix3, Vector3};
use std::path::Path;

/// Spacing of the stations between taught points, mm.
const SPACING_MM: f64 = 1.0;
/// A taught path is a weld, not a plan of a city: longest distance between two of its points, mm.
const MAX_STEP_MM: f64 = 1000.0;
/// A path is closed if its last point is as near to its first as this share of its mean spacing.
const CLOSED: f64 = 0.5;

/// The truth that a taught path states.
pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<Truth, Error> {
    let malformed =
        |place: &str, reason: String| Error::Malformed { path: path.into(), place: place.into(), reason };
    let taught = PathSet::parse(bytes, path)?;
    let Some(frames) = &taught.frames else {
        return Err(malformed(
            "header",
            "a taught path needs qw,qx,qy,qz or rx,ry,rz to serve as truth".into(),
        ));
    };
    let runs = taught.runs();
    let count = runs.iter().max().map_or(0, |last| last + 1);
    let mut seams = Vec::new();
    for run in 0..count {
        let members: Vec<usize> = (0..runs.len()).filter(|&i| runs[i] == run).collect();
        let points: Vec<(Vector3<f64>, Matrix3<f64>)> =
            members.iter().map(|&i| (taught.points_mm[i], frames[i])).collect();
        let name = match (&taught.seams, members.first()) {
            (Some(names), Some(&first)) => names[first].clone(),
            _ => (run + 1).to_string(),
        };
        seams.push(
            seam(name.clone(), &points).map_err(|reason| malformed(&format!("seam `{name}`"), reason))?,
        );
    }
    if seams.is_empty() {
        return Err(malformed("rows", "there is no point in it".into()));
    }
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Ok(Truth { name, kind: "taught".into(), seams, ..Truth::default() })
}

fn seam(name: String, taught: &[(Vector3<f64>, Matrix3<f64>)]) -> Result<TruthSeam, String> {
    let length: f64 = taught.windows(2).map(|w| (w[1].0 - w[0].0).norm()).sum();
    if length / SPACING_MM + taught.len() as f64 > MAX_STATIONS as f64 {
        return Err(format!("is {length:.0} mm long with {} points: too much for one seam", taught.len()));
    }
    let (Some(first), Some(last)) = (taught.first(), taught.last()) else {
        return Err("has no point".into());
    };
    let closed = taught.len() > 3 && (last.0 - first.0).norm() < CLOSED * length / (taught.len() - 1) as f64;
    let mut seam = TruthSeam { name, closed, required: true, ..TruthSeam::default() };
    for pair in taught.windows(2) {
        let step = (pair[1].0 - pair[0].0).norm();
        if step > MAX_STEP_MM {
            return Err(format!("has a step of {step:.0} mm; are its positions in millimetres?"));
        }
        let parts = (step / SPACING_MM).ceil().max(1.0);
        (0..parts as usize).for_each(|k| seam.push(&pair[0], &pair[1], k as f64 / parts));
    }
    if !closed {
        seam.push(last, last, 0.0);
    }
    Ok(seam)
}

impl Truth {
    /// Reads a `truth.json`, or a taught path (`.csv`, the columns of [`PathSet`] with an orientation), each of
    /// whose seams then counts as visible and required all along.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let bytes = weldpath_files::reading::bytes(path, weldpath_files::reading::MOST_RESULT)
            .map_err(|source| Error::Read { path: path.into(), source })?;
        let is_csv = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("csv"));
        if is_csv { parse(&bytes, path) } else { Self::parse(&bytes, path) }
    }
}

impl TruthSeam {
    /// Adds the station at `share` of the way from `a` to `b`.
    fn push(&mut self, a: &(Vector3<f64>, Matrix3<f64>), b: &(Vector3<f64>, Matrix3<f64>), share: f64) {
        let between = |from: Vector3<f64>, to: Vector3<f64>| from * (1.0 - share) + to * share;
        let axis = |i: usize| between(a.1.column(i).into(), b.1.column(i).into());
        // Half a turn between two taught points has no middle: the first point's frame holds.
        let normal = axis(2).try_normalize(1e-6).unwrap_or_else(|| a.1.column(2).into());
        let travel = (axis(1) - normal * normal.dot(&axis(1))).try_normalize(1e-6);
        let fallback = a.1.column(1) - normal * normal.dot(&a.1.column(1));
        let travel = travel.unwrap_or_else(|| fallback.normalize());
        let place = between(a.0, b.0);
        self.p.push(place.into());
        self.p_root.push(place.into());
        self.n.push(normal.into());
        self.t.push(travel.into());
        self.visible.push(1);
    }
}
