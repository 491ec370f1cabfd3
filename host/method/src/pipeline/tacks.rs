//! Tacks in straight corners (ours): what fills the root for a short stretch is taken off, and the seam is sought again, so that
//! it is one and lies where the members meet.
//!
//! A tack stands in front of both faces of a corner, near the root and nowhere else: a rib or another member stands out
//! farther. Its points are put back on the nearer face, as if it had been ground off. Millimetres, about the scan's origin where
//! nothing else is said.

use super::result::PlanError;
use super::scale_search::{ScaleResult, ScaleSearch};
use super::stages::Stages;
use crate::geometry::cloud::Merged;
use crate::geometry::grid::Grid;
use crate::geometry::statistics::median;
use crate::model::downsampling::Scale;
use crate::seam::Seam;
use nalgebra::{Matrix3, Point3, Vector3};
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// A shorter corner does not tell its own line from a tack's, mm.
const LEAST_CORNER_MM: f32 = 40.0;
/// Stations are of a straight corner within this many times their median distance from its line, and this, mm; for as many
/// rounds.
const OF_MEDIAN: f32 = 1.5;
const LEAST_OFF_MM: f32 = 0.1;
const ROUNDS: usize = 6;
/// Median distance of the stations from the line of a corner that is straight, mm.
const STRAIGHT_MM: f32 = 0.5;
/// Cosine of seams that run alike.
const ALONG: f32 = 0.95;
/// The largest leg of a tack, mm. What stands out as far again is no tack.
const MOST_LEG_MM: f32 = 10.0;
/// Length of a tack, mm: less is spatter or noise, more is a weld.
const LENGTH_MM: RangeInclusive<f32> = 4.0..=35.0;
/// A tack is higher over both faces than this, mm, and than this many standard deviations of the points, of which the model's
/// are means, and of the waves in them: the face of one with legs of 4 mm is 2 mm over both.
const LEAST_HEIGHT_MM: f32 = 1.0;
const HEIGHT_NOISES: f32 = 1.5;
const HEIGHT_WAVES: f32 = 3.0;
/// Distance of the slices in which it is looked for, and their half thickness, in voxels.
const SLICE_VOXELS: f32 = 1.0;
const HALF_SLICE_VOXELS: f32 = 1.2;
/// Share of a slice's points that stand in front of both faces in a tack, and of those the most that stand too far out.
const TACK_SHARE: f32 = 0.12;
const FAR_SHARE: f32 = 0.2;
/// What is taken off reaches so far beyond the slices that show it, mm.
const MARGIN_MM: f32 = 2.0;
/// The root is sought anew from points of each face this far from it, mm, and no farther off the face.
const FACE_MM: RangeInclusive<f32> = 5.0..=15.0;
const OFF_FACE_MM: f32 = 1.5;
/// How often: a seam that climbs tacks has faces that lean.
const SETTLING: usize = 3;
/// How often they are looked for: what the first search makes of them may hide some.
const SEARCHES: usize = 3;
/// A seam is a tack's within this distance, mm.
const OF_SEAM_MM: f64 = 3.0;

/// A tack on a seam.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Tack {
    /// The seam's number.
    pub seam: usize,
    /// Where it begins and ends, along the seam, mm.
    pub from_mm: f64,
    /// The same.
    pub to_mm: f64,
    /// How far it stands out of the root, mm.
    pub height_mm: f64,
}

/// What is said of the tacks of each seam.
pub(super) fn words(tacks: &[Tack]) -> impl Iterator<Item = String> {
    tacks.chunk_by(|a, b| a.seam == b.seam).map(|on_seam| {
        let places: Vec<String> =
            on_seam.iter().map(|tack| format!("{:.0} to {:.0}", tack.from_mm, tack.to_mm)).collect();
        format!(
            "seam {} is tacked at {} mm along it: it runs on the joint's line, and the torch does not climb",
            on_seam[0].seam,
            places.join(", ")
        )
    })
}

/// What is found once no seam shows a tack any more, and the scan without them, if there were any.
pub(super) fn sought_without(
    search: &ScaleSearch,
    first: &Scale,
    stages: &mut Stages,
) -> Result<(ScaleResult, Option<Ground>), PlanError> {
    let mut result = search.best(first, stages)?;
    let mut ground: Option<Ground> = None;
    for _ in 0..SEARCHES {
        let here = ground.as_ref().map_or(*search, |ground| ground.in_place_of(search));
        let Some(mut further) = Ground::of(&here, &result) else { break };
        further.lumps.extend(ground.map_or_else(Vec::new, |ground| ground.lumps));
        result = further.in_place_of(search).best(first, stages)?;
        ground = Some(further);
    }
    let here = ground.as_ref().map_or(*search, |ground| ground.in_place_of(search));
    here.look_again(&mut result, stages)?;
    here.tell_borders(&mut result, stages);
    Ok((result, ground))
}

/// A scan without its tacks.
pub(super) struct Ground {
    pub(super) merged: Merged,
    pub(super) raw: Grid,
    lumps: Vec<Lump>,
}

/// What was taken off: its ends on the root, and its height.
struct Lump {
    ends: [Point3<f32>; 2],
    height_mm: f32,
}

/// A straight corner.
struct Corner {
    /// On the root.
    foot: Point3<f32>,
    along: Vector3<f32>,
    faces: [Vector3<f32>; 2],
    /// Ends of all that lies on its line, from the foot.
    ends_mm: [f32; 2],
}

impl Ground {
    /// The scan without the tacks that its seams show; none where there are none.
    pub(super) fn of(search: &ScaleSearch, result: &ScaleResult) -> Option<Self> {
        let origin_mm = search.merged.origin_mm;
        let mut longest: Vec<&Seam> = result.found.seams.iter().collect();
        longest.sort_by(|a, b| b.length_mm().total_cmp(&a.length_mm()));
        let lines: Vec<Vec<Point3<f32>>> =
            longest.iter().map(|seam| seam.stations.iter().map(|s| s.about(&origin_mm)).collect()).collect();
        let mut corners: Vec<Corner> = Vec::new();
        for (seam, line) in longest.iter().zip(&lines) {
            if corners.iter().any(|corner| corner.holds(line)) {
                continue;
            }
            corners.extend(Corner::of(seam, line));
        }
        let (noise_mm, voxel_mm) = (result.scale.noise_mm, result.scale.edge_mm);
        let waves_mm = HEIGHT_WAVES * result.found.waves_mm;
        let least_mm = LEAST_HEIGHT_MM.max(HEIGHT_NOISES * noise_mm).max(waves_mm);
        let mut ground = Self { merged: Merged::default(), raw: Grid::default(), lumps: Vec::new() };
        for corner in &mut corners {
            corner.reach_over(&lines);
            (0..SETTLING).for_each(|_| corner.settle(&result.model.index, &[]));
            let stretches = corner.stretches(&result.model.index, voxel_mm, least_mm);
            if stretches.is_empty() {
                continue;
            }
            if ground.lumps.is_empty() {
                ground.merged = search.merged.clone();
            }
            corner.settle(search.raw, &stretches);
            for stretch in stretches {
                ground.lumps.extend(corner.grind(&mut ground.merged, search.raw, stretch, 2.0 * noise_mm));
            }
        }
        if ground.lumps.is_empty() {
            return None;
        }
        ground.raw = Grid::new(&ground.merged.points_mm, search.raw.cell_mm());
        Some(ground)
    }

    /// The same search in the scan without tacks.
    pub(super) fn in_place_of<'a>(&'a self, search: &ScaleSearch<'a>) -> ScaleSearch<'a> {
        ScaleSearch { merged: &self.merged, raw: &self.raw, ..*search }
    }

    /// The tacks, each on the seam that runs through it.
    pub(super) fn on(&self, seams: &[Seam]) -> Vec<Tack> {
        let origin_mm = self.merged.origin_mm;
        let of = |lump: &Lump| {
            let places = lump.ends.map(|end| origin_mm + end.coords.cast::<f64>());
            seams.iter().find_map(|seam| {
                let [a, b] = places.map(|place| nearest(seam, &place));
                (a.1 < OF_SEAM_MM && b.1 < OF_SEAM_MM && a.0 != b.0).then(|| Tack {
                    seam: seam.id,
                    from_mm: a.0.min(b.0),
                    to_mm: a.0.max(b.0),
                    height_mm: f64::from(lump.height_mm),
                })
            })
        };
        let mut tacks: Vec<Tack> = self.lumps.iter().filter_map(of).collect();
        tacks.sort_by(|a, b| a.seam.cmp(&b.seam).then(a.from_mm.total_cmp(&b.from_mm)));
        // What was taken off in two goes is one tack.
        tacks.dedup_by(|next, one| {
            let is_same = next.seam == one.seam && next.from_mm <= one.to_mm;
            if is_same {
                one.to_mm = one.to_mm.max(next.to_mm);
                one.height_mm = one.height_mm.max(next.height_mm);
            }
            is_same
        });
        tacks
    }
}

/// How far along a seam its station nearest to a place is, and how far that is off, mm.
fn nearest(seam: &Seam, place: &Point3<f64>) -> (f64, f64) {
    let (mut along, mut best) = (0.0, (0.0, f64::INFINITY));
    let mut last: Option<Point3<f64>> = None;
    for station in &seam.stations {
        along += last.map_or(0.0, |last| (station.position_mm - last).norm());
        last = Some(station.position_mm);
        let off = (station.position_mm - place).norm();
        if off < best.1 {
            best = (along, off);
        }
    }
    best
}

impl Corner {
    /// The corner of a straight seam.
    fn of(seam: &Seam, line: &[Point3<f32>]) -> Option<Self> {
        let mut kept: Vec<usize> = (0..line.len()).collect();
        let mut corner = None;
        for _ in 0..ROUNDS {
            let points: Vec<Point3<f32>> = kept.iter().map(|&k| line[k]).collect();
            let (foot, along) = fitted_line(&points)?;
            let off = |p: &Point3<f32>| (p - foot).cross(&along).norm();
            let middle_mm = median(&mut line.iter().map(off).collect::<Vec<_>>());
            let most_mm = (OF_MEDIAN * middle_mm).max(LEAST_OFF_MM);
            kept = (0..line.len()).filter(|&k| off(&line[k]) <= most_mm).collect();
            corner = (middle_mm < STRAIGHT_MM).then_some((foot, along));
        }
        let (foot, along) = corner?;
        let face = |f: usize| {
            let sum: Vector3<f64> = kept.iter().map(|&k| seam.stations[k].faces[f]).sum();
            sum.cast::<f32>().try_normalize(1e-3)
        };
        let corner = Self { foot, along, faces: [face(0)?, face(1)?], ends_mm: [0.0; 2] };
        let ends_mm = corner.ends_of(kept.iter().map(|&k| &line[k]));
        (ends_mm[1] - ends_mm[0] >= LEAST_CORNER_MM).then_some(Self { ends_mm, ..corner })
    }

    fn ends_of<'a>(&self, points: impl Iterator<Item = &'a Point3<f32>>) -> [f32; 2] {
        points.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], p| {
            let at = self.at(p);
            [low.min(at), high.max(at)]
        })
    }

    fn at(&self, p: &Point3<f32>) -> f32 {
        (p - self.foot).dot(&self.along)
    }

    fn off_mm(&self, p: &Point3<f32>) -> f32 {
        (p - self.foot).cross(&self.along).norm()
    }

    fn heights_mm(&self, p: &Point3<f32>) -> [f32; 2] {
        self.faces.map(|face| (p - self.foot).dot(&face))
    }

    /// Whether most of a line lies along this corner, in it or at the foot of a tack.
    fn holds(&self, line: &[Point3<f32>]) -> bool {
        let Some([first, last]) = line.first().zip(line.last()).map(|(a, b)| [*a, *b]) else { return true };
        let is_near = |p: &&Point3<f32>| self.off_mm(p) < MOST_LEG_MM;
        (last - first).try_normalize(1e-3).is_some_and(|way| way.dot(&self.along).abs() > ALONG)
            && 2 * line.iter().filter(is_near).count() > line.len()
            && self.heights_mm(&line[line.len() / 2]).into_iter().all(|height| height > -STRAIGHT_MM)
    }

    /// Goes on over all lines on this one.
    fn reach_over(&mut self, lines: &[Vec<Point3<f32>>]) {
        for line in lines {
            let gap_mm = 2.0 * LENGTH_MM.end();
            let [low, high] = self.ends_of(line.iter());
            if self.holds(line) && low < self.ends_mm[1] + gap_mm && high > self.ends_mm[0] - gap_mm {
                self.ends_mm = [self.ends_mm[0].min(low), self.ends_mm[1].max(high)];
            }
        }
    }

    /// Where something stands in front of both faces near the root, from the foot: slices in a row.
    fn stretches(&self, model: &Grid, voxel_mm: f32, least_mm: f32) -> Vec<[f32; 2]> {
        let step_mm = SLICE_VOXELS * voxel_mm;
        let mut stretches: Vec<[f32; 2]> = Vec::new();
        let count = ((self.ends_mm[1] - self.ends_mm[0]) / step_mm) as usize;
        for k in 0..=count {
            let at = self.ends_mm[0] + k as f32 * step_mm;
            if !self.is_filled(model, at, HALF_SLICE_VOXELS * voxel_mm, least_mm) {
                continue;
            }
            match stretches.last_mut() {
                Some(last) if at - last[1] < 2.5 * step_mm => last[1] = at,
                _ => stretches.push([at, at]),
            }
        }
        stretches.retain(|[from, to]| LENGTH_MM.contains(&(to - from + step_mm)));
        stretches
    }

    /// Whether the slice there holds a tack.
    fn is_filled(&self, model: &Grid, at: f32, half_mm: f32, least_mm: f32) -> bool {
        let centre = self.foot + self.along * at;
        let (mut all, mut near, mut far) = (0.0f32, 0.0f32, 0.0f32);
        model.within(&centre, 2.0 * MOST_LEG_MM, |slot, _| {
            let p = model.point(slot);
            if (self.at(&p) - at).abs() > half_mm {
                return;
            }
            let [low, high] = in_order(self.heights_mm(&p));
            let is_in_front = low > least_mm;
            all += f32::from(u8::from(high < MOST_LEG_MM));
            near += f32::from(u8::from(is_in_front && high <= MOST_LEG_MM));
            far += f32::from(u8::from(is_in_front && high > MOST_LEG_MM));
        });
        near > 0.0 && near >= TACK_SHARE * all && far <= FAR_SHARE * near
    }

    /// Puts faces and root where the points beside the tacks are.
    fn settle(&mut self, raw: &Grid, stretches: &[[f32; 2]]) {
        let [from, to] = self.ends_mm;
        let mut on_face: [Vec<Point3<f32>>; 2] = Default::default();
        let count = ((to - from) / FACE_MM.end()) as usize;
        for k in 0..=count {
            let centre = self.foot + self.along * (from + k as f32 * FACE_MM.end());
            raw.within(&centre, 1.5 * FACE_MM.end(), |slot, _| {
                let p = raw.point(slot);
                let at = self.at(&p);
                let is_by_tack = stretches.iter().any(|[a, b]| at > a - MARGIN_MM && at < b + MARGIN_MM);
                if is_by_tack || at < from || at > to {
                    return;
                }
                let heights = self.heights_mm(&p);
                for f in 0..2 {
                    if heights[f].abs() < OFF_FACE_MM && FACE_MM.contains(&heights[1 - f]) {
                        on_face[f].push(p);
                    }
                }
            });
        }
        let planes = [0, 1].map(|f| fitted_plane(&on_face[f], &self.faces[f]));
        let [Some(a), Some(b)] = planes else { return };
        let across = Matrix3::from_rows(&[a.1.transpose(), b.1.transpose(), self.along.transpose()]);
        let heights = Vector3::new((a.0 - self.foot).dot(&a.1), (b.0 - self.foot).dot(&b.1), 0.0);
        if let Some(inverse) = across.try_inverse() {
            self.foot += inverse * heights;
            self.faces = [a.1, b.1];
            self.along = a.1.cross(&b.1).normalize() * a.1.cross(&b.1).dot(&self.along).signum();
        }
    }

    /// Puts what stands in front of both faces onto the nearer.
    fn grind(&self, merged: &mut Merged, raw: &Grid, [from, to]: [f32; 2], least_mm: f32) -> Option<Lump> {
        let (from, to) = (from - MARGIN_MM, to + MARGIN_MM);
        let centre = self.foot + self.along * (0.5 * (from + to));
        let mut heights: Vec<f32> = Vec::new();
        raw.within(&centre, 0.5 * (to - from) + 2.0 * MOST_LEG_MM, |slot, _| {
            let p = raw.point(slot);
            let (at, heights_mm) = (self.at(&p), self.heights_mm(&p));
            let [low, high] = in_order(heights_mm);
            if at < from || at > to || low < least_mm || high > MOST_LEG_MM {
                return;
            }
            let face = self.faces[usize::from(heights_mm[1] < heights_mm[0])];
            merged.points_mm[raw.index(slot)] = p - face * low;
            heights.push(self.off_mm(&p));
        });
        let height_mm = median(&mut heights);
        (height_mm > 0.0).then(|| Lump { ends: [from, to].map(|at| self.foot + self.along * at), height_mm })
    }
}

fn in_order([a, b]: [f32; 2]) -> [f32; 2] {
    [a.min(b), a.max(b)]
}

/// A place on the line that fits points best, and its direction.
fn fitted_line(points: &[Point3<f32>]) -> Option<(Point3<f32>, Vector3<f32>)> {
    let (centre, scatter) = scattered(points)?;
    let eigen = scatter.symmetric_eigen();
    Some((centre, eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned()))
}

/// The same of a plane and its normal, on the side of `toward`.
fn fitted_plane(points: &[Point3<f32>], toward: &Vector3<f32>) -> Option<(Point3<f32>, Vector3<f32>)> {
    let (centre, scatter) = scattered(points)?;
    let eigen = scatter.symmetric_eigen();
    let normal = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    Some((centre, normal * normal.dot(toward).signum()))
}

/// Mean and scatter of points.
fn scattered(points: &[Point3<f32>]) -> Option<(Point3<f32>, Matrix3<f32>)> {
    if points.len() < 3 {
        return None;
    }
    let share = 1.0 / points.len() as f32;
    let centre = Point3::from(points.iter().map(|p| p.coords * share).sum::<Vector3<f32>>());
    let scatter = points.iter().map(|p| (p - centre) * (p - centre).transpose() * share).sum();
    Some((centre, scatter))
}

#[cfg(test)]
mod tests {
    use super::*;

    const VOXEL_MM: f32 = 1.2;

    /// A plate, z = 0, y > 0, and a web, y = 0, z > 0, 120 mm along x, in voxels, and what `fills` their corner: its height over
    /// both at a place along x.
    fn corner_filled(fills: impl Fn(f32) -> f32, far_mm: f32) -> Grid {
        let mut points = Vec::new();
        for k in 0..100 {
            let x = 1.2 * k as f32;
            let leg = fills(x);
            for j in 0..20 {
                let off = 0.6 + 1.2 * j as f32;
                if off > leg {
                    points.push(Point3::new(x, off, 0.0));
                    points.push(Point3::new(x, 0.0, off));
                } else {
                    points.push(Point3::new(x, off, leg - off));
                }
                if leg > 0.0 && off < far_mm {
                    points.push(Point3::new(x, off, off.max(leg)));
                }
            }
        }
        Grid::new(&points, 4.0)
    }

    fn corner(lean_rad: f32) -> Corner {
        let lean = nalgebra::Rotation3::from_axis_angle(&Vector3::x_axis(), lean_rad);
        Corner {
            foot: Point3::new(60.0, 0.4, 0.2),
            along: Vector3::x(),
            faces: [lean * Vector3::z(), lean.inverse() * Vector3::y()],
            ends_mm: [-60.0, 58.0],
        }
    }

    fn tacked(x: f32) -> f32 {
        if (30.0..42.0).contains(&x) || (80.0..95.0).contains(&x) { 4.5 } else { 0.0 }
    }

    #[test]
    fn faces_that_lean_by_a_tack_are_put_right_and_the_tacks_found() {
        let model = corner_filled(tacked, 0.0);
        let mut corner = corner(0.06);
        (0..SETTLING).for_each(|_| corner.settle(&model, &[]));
        let lean_deg =
            corner.faces[0].angle(&Vector3::z()).max(corner.faces[1].angle(&Vector3::y())).to_degrees();
        assert!(
            lean_deg < 0.2 && corner.foot.y.abs() < 0.05 && corner.foot.z.abs() < 0.05,
            "{lean_deg} {}",
            corner.foot
        );
        let found = corner.stretches(&model, VOXEL_MM, LEAST_HEIGHT_MM);
        assert_eq!(found.len(), 2, "{found:?}");
        for ([from, to], [first, last]) in found.into_iter().zip([[30.0, 42.0], [80.0, 95.0]]) {
            assert!((from + 60.0 - first).abs() < 2.5 && (to + 60.0 - last).abs() < 2.5, "{from} {to}");
        }
    }

    #[test]
    fn what_is_taken_off_lies_on_the_faces_and_all_else_where_it_was() {
        let raw = corner_filled(tacked, 0.0);
        let mut merged =
            Merged { points_mm: (0..raw.len()).map(|slot| raw.point(slot)).collect(), ..Merged::default() };
        let raw = Grid::new(&merged.points_mm, 4.0);
        let corner = Corner { foot: Point3::new(60.0, 0.0, 0.0), ..corner(0.0) };
        let before = merged.points_mm.clone();
        let lump = corner.grind(&mut merged, &raw, [-30.0, -18.0], 0.3).expect("a tack");
        assert!((2.0..4.5).contains(&lump.height_mm), "{}", lump.height_mm);
        for (before, after) in before.iter().zip(&merged.points_mm) {
            let is_of_tack = (28.0..44.0).contains(&before.x) && before.y.min(before.z) > 0.3;
            let moved = (after - before).norm() > 1e-6;
            assert!(moved == is_of_tack && (!moved || after.y.min(after.z).abs() < 1e-5), "{before} {after}");
        }
    }

    #[test]
    fn a_rib_a_whole_bead_and_a_bare_corner_are_no_tacks() {
        let found = |fills: fn(f32) -> f32, far_mm| {
            corner(0.0).stretches(&corner_filled(fills, far_mm), VOXEL_MM, LEAST_HEIGHT_MM)
        };
        assert!(found(|_| 0.0, 0.0).is_empty());
        assert!(found(|_| 5.0, 0.0).is_empty(), "welded already");
        assert!(
            found(|x| if (50.0..58.0).contains(&x) { 4.0 } else { 0.0 }, 24.0).is_empty(),
            "a rib stands out farther"
        );
    }
}
