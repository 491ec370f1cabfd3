//! Root opening: how far from each other the faces of a joint end, and the angle between them.
//!
//! In a tight joint every ray that can reach the root ends on the first of the two faces it pierces. In an open one the
//! rays next to the root go on: to what backs a groove, or under a web to the plate it stands off. So the opening is
//! where along the face the points change from lying on it to lying behind it (or missing): for each width that is
//! possible, the squared misses of both parts are summed over the seam, and the least sum wins. How fast the sum grows
//! about its least is the uncertainty from noise; to it comes the distance of the points at the edge.

use super::evidence::JointEvidence;
use super::sight::{Faces, Pierced, SightRay, sights};
use crate::geometry::statistics::{median, robust_deviation};
use crate::seam::Joint;
use crate::seam::input::Input;
use crate::seam::measure::dimension::Value;
use crate::seam::refine::ACUTE_DEG;
use crate::seam::refine::Refined;
use crate::seam::refine::face::{self, FacePoint};
use crate::seam::refine::frame::Frame;
use std::ops::Range;

/// What there is at the root.
pub(super) struct Opening {
    /// Angle between the faces through the air, degrees.
    pub(super) angle_deg: Value,
    /// Distance of the members, mm, or why it cannot be told.
    pub(super) width_mm: Result<Value, &'static str>,
}

// Chosen on the simulated scans, unless told otherwise.

/// Length of seam whose points share one fit, mm.
const STRETCH_MM: f32 = 30.0;
/// Most points of one seam that are looked at.
const MOST_POINTS: usize = 30_000;
/// Step between the widths that are tried, mm.
const STEP_MM: f32 = 0.05;
/// Share of a face next to the root in which it may end, and the most of it, mm.
const ROOT_SHARE: f32 = 0.45;
const ROOT_MOST_MM: f32 = 6.0;
/// Points miss by at most so many standard deviations.
const CLAMP: f32 = 3.0;
/// Rise of the sum of squared misses at two standard deviations: 4, times the points that share one error (a camera's
/// noise is alike in neighbouring pixels).
const RISE: f64 = 12.0;
/// Uncertainty from the distance of the points at the edge, voxels: about half of that distance.
const EDGE_VOXELS: f64 = 0.3;
/// The same from the blur of the root of a groove, which looks like a floor: standard deviations of the points. Closed
/// grooves of other seeds and poses than those that the rest was tried on ask for it.
const BLUR_NOISES: f64 = 1.5;
/// Fewer points than this beside the root show nothing, and fewer on a face make no fit.
const LEAST_POINTS: usize = 60;
/// Share of the usual points below which a place misses some.
const SOME: f64 = 0.35;
/// Error of a camera's rays square to themselves, voxels: about a fifth of a pixel. How far the angle of a groove
/// would turn were it none tells how unsure that makes the angle, times this.
const LATERAL_VOXELS: f32 = 0.1;
const LATERAL_UNSURE: f64 = 1.6;
/// Share of the part in which a face may end from which on it ends beyond.
const NEAR_END: f32 = 0.9;
/// How much farther to look for the end of a face that ends beyond where it may.
const ONWARD: f32 = 1.3;
/// Part of a bevel next to its end that its fit leaves out, voxels.
const END_VOXELS: f32 = 0.8;
/// Error of an angle that is read off the tangents of two curved faces, degrees.
const CURVED_DEG: f64 = 1.5;
/// Ends of an open seam that are left out, mm, and the most of it: what lies beyond an end is behind the faces, too.
const ENDS_MM: f32 = 4.0;
const ENDS_SHARE: f32 = 0.1;
/// Two standard deviations, of an expected error that holds 1.4.
const STANDARD: f64 = 1.43;

/// Rounds in which faces are fitted anew; and standard deviations beyond which a point is on no face.
const REFITS: usize = 3;
const WILD_DEVIATIONS: f32 = 8.0;
/// Least noise that is assumed, mm, and least variance to divide by, mm².
const LEAST_SIGMA_MM: f32 = 0.01;
const LEAST_VARIANCE_MM2: f32 = 1e-9;
/// What a missing point weighs, in squared misses.
const MISSING: f64 = 2.0;

/// Error of the angle of a joint from points under its web, degrees per mm of opening.
const PULL_DEG_MM: f64 = 0.8;

const NO_CAMERA: &str = "the camera's position is unknown";
const HIDDEN: &str = "no view sees down to the root";
const UNBACKED: &str =
    "behind the edges of a corner joint an opening cannot be distinguished from missing readings";

/// The opening of a joint.
pub(super) fn opening(evidence: &JointEvidence) -> Opening {
    // An angle between two faces errs twice as much as the direction between them.
    let unsure_deg = 2.0 * STANDARD * evidence.expected.orientation_rad.to_degrees();
    let curved_deg = if evidence.joint == Joint::Saddle { CURVED_DEG } else { 0.0 };
    let unsure_deg = unsure_deg.hypot(curved_deg);
    let angle_deg = Value { value: mean_angle_deg(evidence.seam), uncertainty: unsure_deg };
    if !evidence.input.scan.cameras_known {
        return Opening { angle_deg, width_mm: Err(NO_CAMERA) };
    }
    let stretches = stretches(evidence.input, evidence.seam);
    let edge_mm = EDGE_VOXELS * f64::from(evidence.input.model.voxel_mm());
    // Near the root the balance between two faces moves by twice what they are out of place.
    let edge_mm = edge_mm.hypot(2.0 * STANDARD * evidence.expected.position_mm);
    let opening = match evidence.joint {
        Joint::ButtV => of_groove(evidence, &stretches, angle_deg, edge_mm),
        _ => of_foot(evidence, &stretches, angle_deg, edge_mm),
    };
    opening.unwrap_or(Opening { angle_deg, width_mm: Err(HIDDEN) })
}

/// Between two bevels, whose faces are fitted anew.
fn of_groove(
    evidence: &JointEvidence,
    stretches: &[Vec<SightRay>],
    frames_deg: Value,
    edge_mm: f64,
) -> Option<Opening> {
    let seam = evidence.seam;
    let lateral_mm = LATERAL_VOXELS * evidence.input.model.voxel_mm();
    let rough = sections(stretches, seam, Some(FaceRefit { from_mm: None, lateral_mm }));
    let end = least(&rough, &[0, 1], RootStretch::groove, edge_mm)?;
    // All of the bevels but what is next to their ends: the longer, the surer their slope.
    let from_mm = Some(end.value as f32 + END_VOXELS * evidence.input.model.voxel_mm());
    let fine = sections(stretches, seam, Some(FaceRefit { from_mm, lateral_mm }));
    let still = sections(stretches, seam, Some(FaceRefit { from_mm, lateral_mm: 0.0 }));
    let noise_mm = fine.iter().map(|s| f64::from(s.sigma_mm)).sum::<f64>() / fine.len() as f64;
    let end = least(&fine, &[0, 1], RootStretch::groove, edge_mm.hypot(BLUR_NOISES * noise_mm))?;
    let turn_deg = turn_deg(&fine);
    let lateral_deg = LATERAL_UNSURE * (turn_deg - self::turn_deg(&still));
    let angle_deg =
        Value { value: frames_deg.value - turn_deg, uncertainty: frames_deg.uncertainty.hypot(lateral_deg) };
    // Both faces end at the same depth, so far from each other.
    let spread = 2.0 * (0.5 * angle_deg.value).to_radians().sin();
    let width_mm = Value { value: spread * end.value, uncertainty: spread * end.uncertainty };
    Some(Opening { angle_deg, width_mm: Ok(width_mm) })
}

/// Under the face that ends before it meets the other.
fn of_foot(
    evidence: &JointEvidence,
    stretches: &[Vec<SightRay>],
    frames_deg: Value,
    edge_mm: f64,
) -> Option<Opening> {
    let mut angle_deg = frames_deg;
    if evidence.joint == Joint::Corner {
        return Some(Opening { angle_deg, width_mm: Err(UNBACKED) });
    }
    let sections = sections(stretches, evidence.seam, None);
    let of = |face: usize| least(&sections, &[face], |section| section.foot(face), edge_mm);
    let (a, b) = (of(0)?, of(1)?);
    let width_mm = if a.value > b.value { a } else { b };
    // Points under an edge pull the fit of the face that ends there.
    angle_deg.uncertainty += PULL_DEG_MM * (width_mm.value - width_mm.uncertainty).max(0.0);
    Some(Opening { angle_deg, width_mm: Ok(width_mm) })
}

/// Where the bevels of a groove end, from where they would meet, if that is surely not there, mm.
pub(crate) fn groove_end_mm(input: &Input, seam: &Refined) -> Option<f32> {
    if mean_angle_deg(seam) > f64::from(ACUTE_DEG) || !input.scan.cameras_known {
        return None;
    }
    let lateral_mm = LATERAL_VOXELS * input.model.voxel_mm();
    let sections = sections(&stretches(input, seam), seam, Some(FaceRefit { from_mm: None, lateral_mm }));
    let end = least(&sections, &[0, 1], RootStretch::groove, 0.0)?;
    // A face that ends where nobody looks any more ends farther out.
    let most_mm = sections.iter().map(|s| s.most_mm).fold(f32::INFINITY, f32::min);
    let end_mm = end.value as f32;
    let end_mm = if end_mm > NEAR_END * most_mm { ONWARD * end_mm } else { end_mm };
    (end.value > end.uncertainty).then_some(end_mm)
}

/// Mean angle between the faces through the air, degrees.
fn mean_angle_deg(seam: &Refined) -> f64 {
    let angle = |frame: &Frame| 180.0 - f64::from(frame.faces[0].angle(&frame.faces[1])).to_degrees();
    seam.frames.iter().map(angle).sum::<f64>() / seam.frames.len().max(1) as f64
}

/// How much the refitted faces close the angle between them, degrees.
fn turn_deg(sections: &[RootStretch]) -> f64 {
    let turn = |s: &RootStretch| f64::from(s.faces.slope[0] + s.faces.slope[1]).to_degrees();
    sections.iter().map(turn).sum::<f64>() / sections.len().max(1) as f64
}

/// Mean cosine of the angle between the faces' normals.
fn cosine(seam: &Refined) -> f32 {
    seam.frames.iter().map(|f| f.faces[0].dot(&f.faces[1])).sum::<f32>() / seam.frames.len() as f32
}

/// How faces are fitted anew.
#[derive(Clone, Copy)]
struct FaceRefit {
    /// Nearest to the root that points count; not in the part where a face may end unless told otherwise, mm.
    from_mm: Option<f32>,
    /// Standard deviation of the rays square to themselves, mm.
    lateral_mm: f32,
}

/// The stretches of a seam that show its root; their faces fitted anew if asked for.
fn sections(stretches: &[Vec<SightRay>], seam: &Refined, refit: Option<FaceRefit>) -> Vec<RootStretch> {
    stretches.iter().filter_map(|sights| RootStretch::of(sights, seam, refit)).collect()
}

/// The points of a seam, by stretch.
fn stretches(input: &Input, seam: &Refined) -> Vec<Vec<SightRay>> {
    let reach_mm = seam.reach_mm[0].max(seam.reach_mm[1]);
    let length_mm = seam.step_mm * seam.frames.len() as f32;
    let ends_mm = ENDS_MM.min(ENDS_SHARE * length_mm);
    let count = (length_mm / STRETCH_MM).round().max(1.0);
    let mut stretches = vec![Vec::new(); count as usize];
    for sight in sights(input.scan.merged, seam, reach_mm, MOST_POINTS) {
        if !seam.closed && !(ends_mm..length_mm - ends_mm).contains(&sight.s) {
            continue;
        }
        let k = (sight.s / length_mm * count).clamp(0.0, count - 1.0) as usize;
        stretches[k].push(sight);
    }
    stretches
}

/// The rays of one stretch against its faces.
struct RootStretch {
    faces: Faces,
    /// Those that pierce the part of a face in which it may end.
    root: Vec<Pierced>,
    /// Standard deviation of points along rays square to a face, mm.
    sigma_mm: f32,
    /// Rays that pierce each face, per mm of it.
    density: [f32; 2],
    /// Length of that part, mm.
    most_mm: f32,
}

impl RootStretch {
    fn of(sights: &[SightRay], seam: &Refined, refit: Option<FaceRefit>) -> Option<Self> {
        let mut faces = Faces { cosine: cosine(seam), ..Faces::default() };
        let reach_mm = seam.reach_mm[0].min(seam.reach_mm[1]);
        let most_mm = (ROOT_SHARE * reach_mm).min(ROOT_MOST_MM);
        if let Some(refit) = refit {
            let from_mm = refit.from_mm.map_or(most_mm, |from_mm| from_mm.min(most_mm));
            for _ in 0..REFITS {
                faces = refitted(sights, &faces, from_mm..reach_mm, seam.sigma_mm as f32, refit.lateral_mm)?;
            }
        }
        let pierced: Vec<Pierced> = sights.iter().filter_map(|s| faces.pierced(s)).collect();
        let beyond = |p: &&Pierced| (most_mm..reach_mm).contains(&p.u_mm);
        let mut misses: Vec<f32> =
            pierced.iter().filter(beyond).map(|p| p.behind_mm.abs() * p.ray_off.sqrt()).collect();
        if misses.len() < LEAST_POINTS {
            return None;
        }
        let sigma_mm = (robust_deviation(&mut misses)).max(LEAST_SIGMA_MM);
        let density = [0, 1].map(|k| {
            pierced.iter().filter(beyond).filter(|p| p.face == k).count() as f32 / (reach_mm - most_mm)
        });
        let root: Vec<Pierced> = pierced.into_iter().filter(|p| (0.0..most_mm).contains(&p.u_mm)).collect();
        Some(Self { faces, root, sigma_mm, density, most_mm })
    }

    /// Number of places at which a face may end.
    fn places(&self) -> usize {
        (self.most_mm / STEP_MM) as usize + 1
    }

    fn place(&self, p: &Pierced) -> usize {
        ((p.u_mm / STEP_MM) as usize).min(self.places() - 1)
    }

    /// Points that lie on these faces, by place.
    fn counts(&self, faces: &[usize]) -> Vec<f64> {
        let mut counts = vec![0.0; self.places()];
        let on_face = |p: &&Pierced| faces.contains(&p.face) && self.misses(p, p.behind_mm).abs() < CLAMP;
        self.root.iter().filter(on_face).for_each(|p| counts[self.place(p)] += 1.0);
        counts
    }

    /// A distance along the ray of a point in standard deviations, which grow at a slant.
    fn misses(&self, p: &Pierced, distance_mm: f32) -> f32 {
        distance_mm * p.ray_off.sqrt() / self.sigma_mm
    }

    /// The same squared, of no more than counts.
    fn squared_miss(&self, p: &Pierced, distance_mm: f32) -> f32 {
        squared(self.misses(p, distance_mm).abs().min(CLAMP))
    }

    /// Sum of squared misses for each place at which `face` may end: beyond it points lie on the face, before it on
    /// the other one, which goes on behind the first.
    fn foot(&self, face: usize) -> Vec<f64> {
        let mut change = vec![0.0; self.places()];
        for p in self.root.iter().filter(|p| p.face == face) {
            let in_front = self.misses(p, p.behind_mm) < -CLAMP;
            let behind = self.squared_miss(p, p.before_other_mm) - self.squared_miss(p, p.behind_mm);
            change[self.place(p)] += f64::from(if in_front { 0.0 } else { behind });
        }
        // To end at a place moves all points before it from one part to the other.
        let before = change.iter().scan(0.0, |sum, change| {
            let so_far = *sum;
            *sum += change;
            Some(so_far)
        });
        before.collect()
    }

    /// The same for both faces of a groove: between their ends points lie on a floor of any height.
    fn groove(&self) -> Vec<f64> {
        let mut sorted = self.root.clone();
        sorted.sort_unstable_by(|a, b| a.u_mm.total_cmp(&b.u_mm));
        (0..self.places())
            .map(|place| {
                let inside = &sorted[..sorted.partition_point(|p| self.place(p) < place)];
                if inside.is_empty() {
                    return 0.0;
                }
                let floor_mm = median(&mut inside.iter().map(|p| p.up_mm).collect::<Vec<_>>());
                let off = |p: &Pierced| self.squared_miss(p, (p.up_mm - floor_mm) / p.ray_up);
                inside.iter().map(|p| f64::from(off(p) - self.squared_miss(p, p.behind_mm))).sum()
            })
            .collect()
    }
}

fn squared(x: f32) -> f32 {
    x * x
}

/// Where the faces end by all sections together, along the face, mm.
fn least(
    sections: &[RootStretch],
    faces: &[usize],
    costs: impl Fn(&RootStretch) -> Vec<f64>,
    sure_mm: f64,
) -> Option<Value> {
    let places = sections.iter().map(RootStretch::places).min()?;
    let mut sum = vec![0.0; places];
    let mut counts = vec![0.0; places];
    for section in sections {
        sum.iter_mut().zip(costs(section)).for_each(|(sum, cost)| *sum += cost);
        counts.iter_mut().zip(section.counts(faces)).for_each(|(sum, count)| *sum += count);
    }
    let usual: f64 =
        sections.iter().flat_map(|s| faces.iter().map(|&k| f64::from(s.density[k] * STEP_MM))).sum();
    // On a face there would be points: none are as telling as some in the wrong place.
    let mut missing = 0.0;
    for (place, count) in counts.iter().enumerate().rev() {
        missing += MISSING * (SOME * usual - count).max(0.0);
        sum[place] += missing;
    }
    let best = (0..places).min_by(|&a, &b| sum[a].total_cmp(&sum[b])).unwrap_or(0);
    let likely = |place: &usize| sum[*place] < sum[best] + RISE;
    let first = (0..places).find(likely).unwrap_or(best);
    let last = (0..places).rev().find(likely).unwrap_or(best);
    let step_mm = f64::from(STEP_MM);
    let noise_mm = (best - first).max(last - best) as f64 * step_mm;
    Some(Value { value: best as f64 * step_mm, uncertainty: noise_mm.hypot(sure_mm) })
}

/// The faces fitted to the points of a stretch that pierce them in a range of distances from the root.
fn refitted(
    sights: &[SightRay],
    faces: &Faces,
    range_mm: Range<f32>,
    sigma_mm: f32,
    lateral_mm: f32,
) -> Option<Faces> {
    let middle = sights.iter().map(|s| s.s).sum::<f32>() / sights.len().max(1) as f32;
    let mut on_faces: [Vec<(f32, Pierced)>; 2] = [Vec::new(), Vec::new()];
    for sight in sights {
        let Some(p) = faces.pierced(sight) else { continue };
        if range_mm.contains(&p.u_mm) && p.behind_mm.abs() < WILD_DEVIATIONS * sigma_mm {
            on_faces[p.face].push((sight.s - middle, p));
        }
    }
    let mut fitted = *faces;
    for (k, points) in on_faces.iter().enumerate() {
        let lateral = lateral_share(points, lateral_mm);
        let sample = |(d, p): &(f32, Pierced)| {
            // Errors of `u` that go with those of `h` would turn the face. Those along the ray leave the place where it
            // pierces the face as it is; those square to it do not.
            let steep = p.ray_off * p.ray_off + lateral * p.ray_along * p.ray_along;
            let u_mm = p.u_mm - p.behind_mm * p.ray_along * lateral / steep;
            let h_mm = -p.behind_mm * p.ray_off;
            FacePoint { d: f64::from(*d), u: f64::from(u_mm), h: f64::from(h_mm), w: 1.0 }
        };
        let samples: Vec<FacePoint> = points.iter().map(sample).collect();
        let fit = face::fit(&samples, 0.0, f64::MAX, &mut face::Scratch::default())?;
        fitted.moved(faces, k, fit.offset as f32, fit.slope as f32);
    }
    Some(fitted)
}

/// Variance of points square to their rays over that along them.
fn lateral_share(points: &[(f32, Pierced)], lateral_mm: f32) -> f32 {
    if points.is_empty() {
        return 0.0;
    }
    let mut misses: Vec<f32> = points.iter().map(|(_, p)| p.behind_mm.abs()).collect();
    let all = squared(robust_deviation(&mut misses));
    let slant: f32 = points.iter().map(|(_, p)| squared(p.ray_along / p.ray_off)).sum();
    let lateral = squared(lateral_mm);
    // What the error square to the ray puts along it is not of the depth.
    lateral / (all - lateral * slant / points.len() as f32).max(lateral).max(LEAST_VARIANCE_MM2)
}
