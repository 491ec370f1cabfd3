//! The usual misreadings of poses, images and depths, each tried where the views do not agree as given: if one makes them agree, it
//! is named with the line to write.

use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::direction::{FITS_MM, REFUSED, Trial};
use crate::geometry::cloud::View;

/// Another way to read the same scan.
pub(super) struct Reading {
    /// What it would be, to follow "the views agree if".
    pub says: String,
    /// What to write then.
    pub write: String,
    /// Of the cameras, one for each view.
    pub poses: Vec<Isometry3<f64>>,
    /// Depths as they would be, as a share of what they are.
    pub scale: f32,
}

impl Reading {
    pub(super) fn new(says: impl Into<String>, write: impl Into<String>, poses: Vec<Isometry3<f64>>) -> Self {
        Self { says: says.into(), write: write.into(), poses, scale: 1.0 }
    }
}

/// What trying them told.
pub(super) enum Told {
    /// The views agree as they are given, or there is but one.
    Agree,
    /// They do not, and no reading makes them.
    None { given_mm: f64 },
    /// One does: what to say and what to write.
    One { problem: String, help: String },
    /// Several do.
    Several { problem: String },
}

/// As much better than the next has to be what is named alone.
const ALONE: f64 = 1.5;

/// Tries the readings of views whose cameras are given at `poses`.
pub(super) fn told(
    views: &[View],
    poses: &[Isometry3<f64>],
    readings: impl FnOnce(&Trial) -> Vec<Reading>,
) -> Told {
    let Some(trial) = Trial::new(views, 1.0) else { return Told::Agree };
    let given_mm = trial.apart_mm(poses);
    if given_mm <= FITS_MM {
        return Told::Agree;
    }
    let tried = readings(&trial).into_iter().filter(|reading| reading.poses.len() == views.len());
    let apart = |reading: Reading| {
        let scaled = (reading.scale != 1.0).then(|| Trial::new(views, reading.scale)).flatten();
        (scaled.as_ref().unwrap_or(&trial).apart_mm(&reading.poses), reading)
    };
    let mut fits: Vec<(f64, Reading)> =
        tried.map(apart).filter(|(mm, _)| *mm <= FITS_MM && given_mm >= REFUSED * mm.max(0.1)).collect();
    fits.sort_by(|a, b| a.0.total_cmp(&b.0));
    let least_mm = fits.first().map_or(f64::INFINITY, |best| best.0);
    fits.retain(|(mm, _)| *mm <= ALONE * least_mm.max(0.1));
    match &fits[..] {
        [] => Told::None { given_mm },
        [(mm, one)] => Told::One {
            problem: format!("the views are {given_mm:.1} mm apart, and agree ({mm:.1} mm) if {}", one.says),
            help: one.write.clone(),
        },
        several => {
            let says: Vec<&str> = several.iter().map(|(_, reading)| reading.says.as_str()).collect();
            Told::Several {
                problem: format!(
                    "the views are {given_mm:.1} mm apart, and agree if one of these is so: {}",
                    says.join("; or ")
                ),
            }
        }
    }
}

/// The orders that images may have come in, other than that of their poses.
pub(super) fn orders(names: &[String], poses: &[Isometry3<f64>]) -> Vec<Reading> {
    let count = poses.len();
    let of = |says: &str, write: &str, from: &dyn Fn(usize) -> usize| {
        Reading::new(says, write, (0..count).map(|k| poses[from(k)]).collect())
    };
    let last = count.saturating_sub(1);
    let turn = "Turn the order of the poses round, or that of the images";
    let shift = "See which image or pose is missing at one end, and put each image to its own pose";
    let mut all = vec![
        of("the images are in the reverse order of their poses", turn, &|k| last - k),
        of("each image belongs to the pose before its own", shift, &|k| (k + last) % count),
        of("each image belongs to the pose after its own", shift, &|k| (k + 1) % count),
    ];
    let number = |name: &String| {
        let digits: String =
            name.chars().rev().skip_while(|c| !c.is_ascii_digit()).take_while(char::is_ascii_digit).collect();
        digits.chars().rev().collect::<String>().parse::<u64>().ok()
    };
    let numbers: Option<Vec<u64>> = names.iter().map(number).collect();
    let rank = |less: &dyn Fn(usize, usize) -> bool| -> Vec<usize> {
        (0..count).map(|k| (0..count).filter(|&other| less(other, k)).count()).collect()
    };
    if let Some(numbers) = numbers.filter(|_| names.len() == count) {
        let by_number = rank(&|a, b| (numbers[a], a) < (numbers[b], b));
        let by_text = rank(&|a, b| (&names[a], a) < (&names[b], b));
        // Where both orders are the same, nothing was mixed up.
        if by_number != by_text {
            let pad = "Name the images with as many digits each, such as 002 and 010";
            let says = "the images are sorted as text (10 before 2) and their poses by number";
            all.push(of(says, pad, &|k| by_number[k]));
            let says = "the poses are sorted as text (10 before 2) and the images by number";
            all.push(of(says, pad, &|k| by_text[k]));
        }
    }
    // Readings that change nothing.
    all.retain(|reading| reading.poses != poses);
    all
}

/// Three angles read as other things than a rotation vector in rad.
pub(super) fn angles(three: [f64; 3]) -> [(&'static str, UnitQuaternion<f64>); 5] {
    let [a, b, c] = three;
    let euler = |[r, p, y]: [f64; 3]| UnitQuaternion::from(Rotation3::from_euler_angles(r, p, y));
    let rad = three.map(f64::to_radians);
    [
        ("the three angles are RPY about x, y, z in radians", euler([a, b, c])),
        ("the three angles are RPY about x, y, z in degrees", euler(rad)),
        ("the three angles are about z, y', x'' (A, B, C of KUKA) in radians", euler([c, b, a])),
        (
            "the three angles are about z, y', x'' (A, B, C of KUKA) in degrees",
            euler([rad[2], rad[1], rad[0]]),
        ),
        ("the rotation vector is in degrees", UnitQuaternion::from_scaled_axis(Vector3::from(rad))),
    ]
}

/// A tool that stands out along the flange's z, mm: the length at which poses of its tip agree best.
pub(super) fn tool(trial: &Trial, cameras: &dyn Fn(f64) -> Vec<Isometry3<f64>>) -> f64 {
    /// Torches and grippers.
    const LENGTHS_MM: std::ops::RangeInclusive<i32> = 2..=30;
    const STEP_MM: f64 = 20.0;
    let apart = |mm: f64| trial.apart_mm(&cameras(mm));
    let best = |lengths: Vec<f64>| {
        let tried = lengths.into_iter().map(|mm| (apart(mm), mm));
        tried.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(0.0, |(_, mm)| mm)
    };
    let coarse = best(LENGTHS_MM.map(|k| f64::from(k) * STEP_MM).collect());
    // Views slide along their faces before they part: more than its tens the length does not show.
    best((-2..=2).map(|k| coarse + f64::from(k) * STEP_MM / 2.0).collect())
}

/// Moved along its own z.
pub(super) fn along_z(mm: f64) -> Isometry3<f64> {
    Translation3::new(0.0, 0.0, mm).into()
}
