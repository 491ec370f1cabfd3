//! Which views belong together (ours; the paper takes every view as it comes).
//!
//! A view is judged by three things: how far the registration had to move it against what the robot reported, whether it
//! lies on what the others see, and whether the others look through what it shows. The worst of those that do not
//! fit is left out and the rest is registered anew, until all that are left fit. The first view that fits keeps the frame.

mod hand_eye;
mod report;
mod sight;

use crate::geometry::cloud::View;
use crate::geometry::depth_map::DepthMap;
use crate::geometry::table;
use crate::model::normals::Patches;
use crate::model::reconstruction::{self, ReconstructionConfig, Registration};
pub use hand_eye::HandEyeError;
use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;
pub use report::ViewReport;
use serde::{Deserialize, Serialize};
use sight::{APART_MM, Sight, depth_map, sight};
use std::borrow::Cow;

/// How far from what the robot reported a view may come to lie, in multiples of one standard deviation of a reported pose:
/// of three coordinates that are normal, one in a thousand is farther out.
const MOST_SIGMAS: f64 = 4.0;
/// One standard deviation of a reported pose that nobody stated: a hand-eye calibration and an arm of everyday quality.
const POSE_MM: f64 = 2.0;
const POSE_DEG: f64 = 0.5;
/// Share of what a view shows, among what others judge, that they look through: beyond it the view is elsewhere.
const MOST_THROUGH: f64 = 0.10;
/// The same of what stands out of the largest plane. A table covers itself however it is moved along itself, and is most of what
/// is judged: poses that put a part at five places of it leave 95 % of all patches on what others see. Of the 70 scans with
/// right poses that were tried, made by two simulators, others look through 1 % of what stands out as a rule and 9 % of
/// a hundred patches at most; with poses 20 mm and more off, through 20 to 98 %.
const MOST_STANDING_THROUGH: f64 = 0.15;
/// Share of a view's overlapping patches that lie on other views: below it the view lies on nothing.
const LEAST_FITNESS: f64 = 0.5;
/// Share of a view's patches near those of others below which their fitness tells nothing: that such a view could not be
/// registered is said by the registration.
const LEAST_OVERLAP: f64 = 0.05;
/// Patches of a view that are asked.
const ASKED: usize = 3000;
/// Fewer judged patches than this tell nothing about a pair of views.
const LEAST_JUDGED: usize = 60;

/// Views that fit each other, and those that do not.
#[derive(Debug)]
pub struct Agreement {
    /// Indices of the views that fit, ascending; all views where nothing can be said.
    pub kept: Vec<usize>,
    /// The others, in the order in which they were found out.
    pub left_out: Vec<LeftOut>,
    /// Registration of the views that fit, in the order of `kept`.
    pub registration: Registration,
    /// What all views together say of the hand-eye transform; none of fewer than three, and where no poses are reported.
    pub hand_eye: Option<HandEyeError>,
}

/// A view that is not used.
#[derive(Debug, Clone, PartialEq)]
pub struct LeftOut {
    /// Index of the view.
    pub view: usize,
    /// Why.
    pub misfit: Misfit,
}

/// What is wrong with a view.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Misfit {
    /// The same image as that of another view.
    Repeated {
        /// Index of the other view.
        of: usize,
    },
    /// It fits only far from where the robot reported it.
    Moved {
        /// Of the camera, against the views that fit, mm.
        shift_mm: f64,
        /// Of the camera, degrees.
        turn_deg: f64,
    },
    /// Others look through what it shows.
    Through {
        /// Share of what others judge.
        share: f64,
    },
    /// Others look through what stands out of the largest plane in it.
    StandingThrough {
        /// Share of what others judge of that.
        share: f64,
    },
    /// It does not lie on what others see.
    Apart {
        /// Share of the overlapping patches that lie on other views.
        fitness: f64,
    },
}

impl Misfit {
    /// In words, after the view's name; `names` are those of all views.
    pub fn words(&self, names: &[&str]) -> String {
        match self {
            Self::Repeated { of } => format!("is the same image as {}", names[*of]),
            Self::Moved { shift_mm, turn_deg } => format!(
                "fits the other views only {shift_mm:.0} mm and {turn_deg:.1} deg from where the robot reported it"
            ),
            Self::Through { share } => {
                format!("shows surfaces where other views see free space ({:.0} % of it)", 100.0 * share)
            }
            Self::StandingThrough { share } => format!(
                "shows surfaces where other views see free space ({:.0} % of what is outside its largest plane)",
                100.0 * share
            ),
            Self::Apart { fitness } => {
                format!(
                    "matches the other views on only {:.0} % of the surface that it shares with them",
                    100.0 * fitness
                )
            }
        }
    }
}

/// Registers the views that fit each other.
///
/// Views without a camera, such as clouds merged elsewhere, are taken as they come.
pub(crate) fn agreeing(views: &[View], patches: &[Patches], config: &ReconstructionConfig) -> Agreement {
    let kept: Vec<usize> = (0..views.len()).collect();
    let mut agreement = Agreement::of_all(registered(&kept, views, patches, config));
    if !views.iter().all(|view| view.camera_known) {
        return agreement;
    }
    if config.prior_mm.is_finite() {
        let reported: Vec<Isometry3<f64>> = views.iter().map(|view| view.base_from_camera).collect();
        agreement.hand_eye = hand_eye::error(&reported, &agreement.registration.base_from_camera);
    }
    while agreement.kept.len() > 1 {
        let misfit = agreement.worst(views, patches, config).or_else(|| agreement.repeated(views));
        let Some((place, misfit)) = misfit else { break };
        agreement.left_out.push(LeftOut { view: agreement.kept.remove(place), misfit });
        agreement.registration = registered(&agreement.kept, views, patches, config);
    }
    agreement
}

fn registered(
    kept: &[usize],
    views: &[View],
    patches: &[Patches],
    config: &ReconstructionConfig,
) -> Registration {
    let (views, patches) = (subset(kept, views), subset(kept, patches));
    reconstruction::register(&views, &patches, config)
}

/// Those of `all` that are kept; nothing is copied where that is all of them.
fn subset<'a, T: Clone>(kept: &[usize], all: &'a [T]) -> Cow<'a, [T]> {
    if kept.len() == all.len() {
        return Cow::Borrowed(all);
    }
    kept.iter().map(|&k| all[k].clone()).collect::<Vec<T>>().into()
}

impl Agreement {
    /// Of views that are all taken as they are.
    pub fn of_all(registration: Registration) -> Self {
        Self {
            kept: (0..registration.base_from_camera.len()).collect(),
            left_out: Vec::new(),
            registration,
            hand_eye: None,
        }
    }

    /// What belongs to the views that fit, of what there is of all views.
    pub fn of<'a, T: Clone>(&self, all: &'a [T]) -> Cow<'a, [T]> {
        subset(&self.kept, all)
    }

    /// The view that fits least of those that do not fit, by its place in `kept`; of equals the later one.
    fn worst(
        &self,
        views: &[View],
        patches: &[Patches],
        config: &ReconstructionConfig,
    ) -> Option<(usize, Misfit)> {
        let moved = self.moved(views, config);
        let through = through(self, patches);
        let fitness = |k: usize| {
            let last = self.registration.fitness[k].last().copied();
            last.filter(|_| self.registration.overlap[k] >= LEAST_OVERLAP).unwrap_or(1.0)
        };
        let misfits = (0..self.kept.len()).flat_map(|k| {
            let (shift_mm, turn_deg) = moved[k];
            let ([share, standing], fitness) = (through[k], fitness(k));
            [
                (sigmas(shift_mm, turn_deg) / MOST_SIGMAS, k, Misfit::Moved { shift_mm, turn_deg }),
                (share / MOST_THROUGH, k, Misfit::Through { share }),
                (standing / MOST_STANDING_THROUGH, k, Misfit::StandingThrough { share: standing }),
                (LEAST_FITNESS / fitness.max(1e-3), k, Misfit::Apart { fitness }),
            ]
        });
        let worst = misfits.filter(|(score, ..)| *score > 1.0).max_by(|a, b| a.0.total_cmp(&b.0));
        worst.map(|(_, k, misfit)| (k, misfit))
    }

    /// Motion of each camera that the registration made against the motion that most made, mm and degrees.
    ///
    /// Where all others moved alike, the first view, which keeps the frame, is the one that was reported wrongly.
    fn moved(&self, views: &[View], config: &ReconstructionConfig) -> Vec<(f64, f64)> {
        let poses = &self.registration.base_from_camera;
        if !config.prior_mm.is_finite() {
            return vec![(0.0, 0.0); poses.len()];
        }
        let reported = self.kept.iter().map(|&k| views[k].base_from_camera);
        let corrections: Vec<Isometry3<f64>> =
            poses.iter().zip(reported).map(|(pose, reported)| pose * reported.inverse()).collect();
        relative(&corrections, poses)
    }

    /// A view with the very points of one before it.
    fn repeated(&self, views: &[View]) -> Option<(usize, Misfit)> {
        (1..self.kept.len()).rev().find_map(|place| {
            let points = &views[self.kept[place]].points_mm;
            let of = self.kept[..place].iter().find(|&&k| views[k].points_mm == *points)?;
            Some((place, Misfit::Repeated { of: *of }))
        })
    }
}

/// A motion in multiples of one standard deviation of a reported pose.
fn sigmas(shift_mm: f64, turn_deg: f64) -> f64 {
    (shift_mm / POSE_MM).max(turn_deg / POSE_DEG)
}

/// Each camera's own motion against that of the view whose motion is most like those of the others, mm and degrees.
fn relative(corrections: &[Isometry3<f64>], poses: &[Isometry3<f64>]) -> Vec<(f64, f64)> {
    let against = |r: usize| -> Vec<(f64, f64)> {
        let back = corrections[r].inverse();
        let own = |(correction, pose): (&Isometry3<f64>, &Isometry3<f64>)| {
            let rest = correction * back;
            let camera = Point3::from(pose.translation.vector);
            ((camera - rest.inverse() * camera).norm(), rest.rotation.angle().to_degrees())
        };
        corrections.iter().zip(poses).map(own).collect()
    };
    let typical = |r: usize| {
        let mut sizes: Vec<f64> = against(r).iter().map(|(mm, deg)| sigmas(*mm, *deg)).collect();
        sizes.sort_by(f64::total_cmp);
        sizes[sizes.len() / 2]
    };
    let reference = (0..corrections.len()).min_by(|&a, &b| typical(a).total_cmp(&typical(b)));
    reference.map_or_else(Vec::new, against)
}

/// Shares of what each view shows, among what others judge, that they look through, or that it looks through of theirs: of all, and of
/// what stands out of the largest plane.
fn through(found: &Agreement, patches: &[Patches]) -> Vec<[f64; 2]> {
    let kept = &found.kept;
    let maps: Vec<DepthMap> = kept.par_iter().map(|&k| depth_map(&patches[k])).collect();
    let pairs: Vec<(usize, usize)> =
        (0..kept.len()).flat_map(|i| (0..kept.len()).filter(move |&j| j != i).map(move |j| (i, j))).collect();
    let poses = &found.registration.base_from_camera;
    let asked: Vec<Vec<Asked>> = asked(found, patches);
    let judged: Vec<[Judged; 2]> =
        pairs.par_iter().map(|&(i, j)| judged(&asked[i], &maps[j], &poses[j].inverse().cast())).collect();
    let mut counts = vec![[Judged::default(); 2]; kept.len()];
    for ((i, j), judged) in pairs.into_iter().zip(judged) {
        for k in [i, j] {
            counts[k].iter_mut().zip(&judged).for_each(|(count, judged)| count.add(judged));
        }
    }
    counts.iter().map(|count| count.map(|judged| judged.share())).collect()
}

/// A patch that others are asked about.
struct Asked {
    /// In the base frame, mm.
    place: Point3<f32>,
    /// Whether it stands out of the largest plane.
    stands: bool,
}

/// Of each view, what the others are asked about.
fn asked(found: &Agreement, patches: &[Patches]) -> Vec<Vec<Asked>> {
    let places = |(&k, pose): (&usize, &Isometry3<f64>)| -> Vec<Point3<f32>> {
        let (points, base_from_camera) = (&patches[k].cloud.points_mm, pose.cast::<f32>());
        let step = (points.len() / ASKED).max(1);
        points.iter().step_by(step).map(|p| base_from_camera * p).collect()
    };
    let places: Vec<Vec<_>> =
        found.kept.iter().zip(&found.registration.base_from_camera).map(places).collect();
    let plane = table::largest_plane(&places.concat(), 0.5 * APART_MM);
    let stands = |place: &Point3<f32>| {
        plane.is_some_and(|(normal, level_mm)| (normal.dot(&place.coords) - level_mm).abs() > APART_MM)
    };
    let asked = |place: Point3<f32>| Asked { stands: stands(&place), place };
    places.into_iter().map(|places| places.into_iter().map(asked).collect()).collect()
}

/// How many patches lie on what another view sees, and how many it looks through.
#[derive(Debug, Clone, Copy, Default)]
struct Judged {
    at: usize,
    through: usize,
}

impl Judged {
    fn add(&mut self, other: &Self) {
        self.at += other.at;
        self.through += other.through;
    }

    fn share(self) -> f64 {
        match self.at + self.through {
            judged if judged < LEAST_JUDGED => 0.0,
            judged => self.through as f64 / judged as f64,
        }
    }
}

/// What another view says of these patches: of all, and of those that stand out.
fn judged(asked: &[Asked], map: &DepthMap, map_from_base: &Isometry3<f32>) -> [Judged; 2] {
    let mut counts = [Judged::default(); 2];
    for patch in asked {
        let one = match sight(map, &(map_from_base * patch.place)) {
            Sight::At => Judged { at: 1, through: 0 },
            Sight::Through => Judged { at: 0, through: 1 },
            Sight::Unknown => continue,
        };
        counts.iter_mut().take(1 + usize::from(patch.stands)).for_each(|count| count.add(&one));
    }
    counts
}
