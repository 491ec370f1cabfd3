//! `scan.json`: views with the robot's poses and the hand-eye transform, eq. (1)'s right-hand side.
//!
//! Poses are those of the flange in the base, hand-eye that of the camera in the flange, each in any form that
//! [`transform`] reads, or the inverse under its own name; lengths are in `units`, except for names that end in `_m`. A
//! view is a `depth` image or a `cloud` in the camera's frame, or a cloud with `"frame": "base"` and `camera_m`. A key
//! that is not known is refused: a misspelt one would be silently ignored otherwise.

mod readings;

use std::path::{Component, Path, PathBuf};

use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;
use serde::Deserialize;
use serde_json::Value;

use super::camera::{Camera, Rays};
use super::depth;
use super::direction::Trial;
use super::memory::Limit;
use super::misreading::{self, Reading, Told};
use super::raw::Raw;
use super::transform::Mount;
use super::units::Unit;
use super::{
    CloudFrame, Doubt, DoubtKind, Error, Options, Scan, direction, name_of, parsed, read_at_most, read_file,
    transform, translation, view_of,
};
use crate::geometry::cloud::View;

/// Name of the file in its folder.
pub(super) const NAME: &str = "scan.json";

const KEYS: &[&str] =
    &["units", "camera", "flange_from_camera", "camera_from_flange", "flange_from_tcp", "views"];
const CAMERA_KEYS: &[&str] = &[
    "width",
    "height",
    "fx",
    "fy",
    "cx",
    "cy",
    "depth_scale_m",
    "k1",
    "k2",
    "p1",
    "p2",
    "k3",
    "k4",
    "k5",
    "k6",
];
const VIEW_KEYS: &[&str] = &[
    "depth",
    "cloud",
    "frame",
    "camera_m",
    "base_from_flange",
    "flange_from_base",
    "base_from_tcp",
    "base_from_camera",
    "camera_from_base",
];

/// Farther from its base no flange is, mm; beyond it the unit is wrong.
const LONGEST_REACH_MM: f64 = 50_000.0;
/// Farther from the flange no camera is, mm.
const LONGEST_MOUNT_MM: f64 = 5_000.0;

#[derive(Debug, Default, Deserialize)]
pub(super) struct Manifest {
    pub units: Option<FileUnit>,
    pub camera: Option<Camera>,
    pub flange_from_camera: Option<Value>,
    pub camera_from_flange: Option<Value>,
    pub flange_from_tcp: Option<Value>,
    pub views: Vec<Entry>,
    /// What the views hold, one for each, where they are no files.
    #[serde(skip)]
    pub held: Vec<Held>,
}

/// What a view holds in memory.
#[derive(Debug, Clone)]
pub(super) enum Held {
    /// The points of a depth image, mm, in the frame of the camera that took it.
    Depth { points_mm: Vec<Point3<f32>>, rays: Rays },
    /// A cloud in the camera's frame.
    Cloud(Raw),
}

#[derive(Debug, Clone, Copy, Deserialize)]
pub(super) enum FileUnit {
    #[serde(rename = "m")]
    Metre,
    #[serde(rename = "mm")]
    Millimetre,
}

#[derive(Debug, Default, Deserialize)]
pub(super) struct Entry {
    pub depth: Option<PathBuf>,
    pub cloud: Option<PathBuf>,
    pub frame: Option<Frame>,
    pub camera_m: Option<[f64; 3]>,
    pub base_from_flange: Option<Value>,
    pub flange_from_base: Option<Value>,
    pub base_from_tcp: Option<Value>,
    pub base_from_camera: Option<Value>,
    pub camera_from_base: Option<Value>,
}

impl Entry {
    /// The poses that are given, by their keys; one of them is enough.
    fn poses(&self) -> Vec<(&'static str, &Value)> {
        let all = [
            ("base_from_flange", &self.base_from_flange),
            ("flange_from_base", &self.flange_from_base),
            ("base_from_tcp", &self.base_from_tcp),
            ("base_from_camera", &self.base_from_camera),
            ("camera_from_base", &self.camera_from_base),
        ];
        all.into_iter().filter_map(|(key, value)| Some((key, value.as_ref()?))).collect()
    }

    /// Whether the pose is the camera's own, without a flange.
    fn is_fixed(&self) -> bool {
        self.base_from_camera.is_some() || self.camera_from_base.is_some()
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Frame {
    Base,
    Camera,
}

impl Manifest {
    /// Whose frame the views are put into: without any pose they stay in that of their camera.
    fn frame(&self) -> CloudFrame {
        let posed = |entry: &Entry| entry.frame == Some(Frame::Base) || !entry.poses().is_empty();
        if self.views.iter().any(posed) { CloudFrame::Base } else { CloudFrame::Camera }
    }
}

/// Reads `scan.json` and every file that it names.
pub(super) fn read(path: &Path, options: &Options) -> Result<Scan, Error> {
    let manifest = load(path)?;
    if !options.allow_outside {
        refuse_outside(&manifest, path)?;
    }
    views(&manifest, path, options)
}

/// Reads all views of a manifest, whether it names files or holds them; `path` names it in messages.
pub(super) fn views(manifest: &Manifest, path: &Path, options: &Options) -> Result<Scan, Error> {
    let mut scan = Scan::of(Vec::new(), manifest.frame(), path);
    let unit = unit(manifest, options, &mut scan);
    let hand_eye = hand_eye(manifest, unit, path, &mut scan)?;
    let (rays, limit) = (manifest.camera.map(Rays::new), options.memory);
    let job = Job { path, unit, hand_eye, rays, limit, manifest };
    let read: Vec<_> = (0..manifest.views.len()).into_par_iter().map(|i| job.view(i)).collect();
    for (i, view) in read.into_iter().enumerate() {
        let (view, file, notes) = view?;
        scan.inputs.push(file);
        scan.notes.extend(notes.into_iter().map(|note| format!("view {i} ({}): {note}", view.name)));
        match view.points_mm.is_empty() {
            true => scan.warnings.push(format!("view {i} ({}) sees nothing and is left out", view.name)),
            false => scan.views.push(view),
        }
    }
    if scan.views.is_empty() {
        return Err(Error::empty(path, format!("none of its {} views sees anything", manifest.views.len())));
    }
    scan.doubts = doubts(manifest, &scan.views);
    check_direction(manifest, unit, hand_eye, &mut scan, path)?;
    scan.warnings.extend(scan.doubts.iter().map(|doubt| doubt.words.clone()));
    Ok(scan)
}

fn load(path: &Path) -> Result<Manifest, Error> {
    let bytes = read_at_most(path, super::SETTINGS_BYTES)?;
    let bad = |e: serde_json::Error| {
        let place = format!("line {}, column {}", e.line(), e.column());
        Error::malformed(
            path,
            place,
            e.to_string(),
            "It needs `units`, `camera` for depth images, `flange_from_camera` and `views`",
        )
    };
    let value: Value = serde_json::from_slice(&bytes).map_err(bad)?;
    check_keys(&value, "", KEYS, path)?;
    check_keys(&value["camera"], "camera.", CAMERA_KEYS, path)?;
    for (i, view) in value["views"].as_array().into_iter().flatten().enumerate() {
        check_keys(view, &format!("views[{i}]."), VIEW_KEYS, path)?;
    }
    let manifest: Manifest = serde_json::from_slice(&bytes).map_err(bad)?;
    if let Some((field, problem)) = manifest.camera.as_ref().and_then(Camera::fault) {
        return Err(Error::malformed(
            path,
            format!("camera.{field}"),
            problem,
            if field == "depth_scale_m" {
                "Give the metres in one step of the image, often 0.001"
            } else {
                "Give the intrinsics in pixels"
            },
        ));
    }
    if manifest.views.is_empty() {
        return Err(Error::empty(path, "`views` is an empty list"));
    }
    Ok(manifest)
}

/// Refuses a key that means nothing, and says which one was probably meant.
fn check_keys(value: &Value, place: &str, known: &[&str], path: &Path) -> Result<(), Error> {
    let keys = value.as_object().into_iter().flat_map(|object| object.keys());
    let Some(unknown) = keys.into_iter().find(|key| !known.contains(&key.as_str())) else { return Ok(()) };
    let nearest = known.iter().min_by_key(|name| strsim::damerau_levenshtein(name, unknown));
    Err(Error::malformed(
        path,
        format!("{place}{unknown}"),
        format!("unknown key, did you mean `{}`?", nearest.copied().unwrap_or_default()),
        format!("Known here are {}", known.join(", ")),
    ))
}

/// Refuses names of files that are not below the folder of `scan.json`: who gets a scan from others does not expect that it
/// reads something else, and shows it in a report.
fn refuse_outside(manifest: &Manifest, path: &Path) -> Result<(), Error> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let root = folder.canonicalize().unwrap_or_else(|_| folder.into());
    let by_name =
        |name: &Path| name.components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
    // A link may lead out, too. What is not there is told when it is read.
    let by_link = |name: &Path| folder.join(name).canonicalize().is_ok_and(|file| !file.starts_with(&root));
    let eye = [
        ("flange_from_camera", &manifest.flange_from_camera),
        ("camera_from_flange", &manifest.camera_from_flange),
    ];
    let eye = eye
        .into_iter()
        .filter_map(|(key, value)| Some((key.to_owned(), Path::new(value.as_ref()?.as_str()?))));
    let files = manifest.views.iter().enumerate().flat_map(|(i, view)| {
        let named = [("depth", &view.depth), ("cloud", &view.cloud)];
        let named = named.into_iter().filter_map(|(key, name)| Some((key, name.as_deref()?)));
        let fixed = view.base_from_camera.as_ref().and_then(Value::as_str).map(Path::new);
        let fixed = fixed.into_iter().map(|name| ("base_from_camera", name));
        named.chain(fixed).map(move |(key, name)| (format!("views[{i}].{key}"), name))
    });
    match files.chain(eye).find(|(_, name)| !by_name(name) || by_link(name)) {
        Some((place, name)) => {
            let problem = format!("{} is outside the folder of scan.json", name.display());
            let help = "Put the file into the folder, or say --allow-outside if that is meant";
            Err(Error::malformed(path, place, problem, help))
        }
        None => Ok(()),
    }
}

fn unit(manifest: &Manifest, options: &Options, scan: &mut Scan) -> Unit {
    let stated = manifest.units.map(|unit| match unit {
        FileUnit::Metre => Unit::Metre,
        FileUnit::Millimetre => Unit::Millimetre,
    });
    let (unit, why) = match (Unit::chosen(options.units), stated) {
        (Some(unit), stated) => {
            if stated.is_some_and(|stated| stated != unit) {
                scan.warnings.push(format!("--units {} overrules `units` in scan.json", options.units));
            }
            (unit, "as given by --units")
        }
        (None, Some(unit)) => (unit, "as stated in scan.json"),
        (None, None) => {
            let words = match manifest.held.is_empty() {
                true => "scan.json has no `units`: taken as metres; add \"units\": \"m\" or \"mm\"",
                false => {
                    "the unit of the views and their poses is not stated: taken as metres; say --units m or \
                     --units mm"
                }
            };
            scan.warnings.push(words.into());
            (Unit::Metre, "the default of views")
        }
    };
    scan.notes.push(format!("units: {} ({why})", unit.name()));
    unit
}

/// `flange_from_camera` in mm, from either key; a string is the name of an easy_handeye file beside scan.json.
fn hand_eye(
    manifest: &Manifest,
    unit: Unit,
    path: &Path,
    scan: &mut Scan,
) -> Result<Option<Isometry3<f64>>, Error> {
    let (key, value, inverted) = match (&manifest.flange_from_camera, &manifest.camera_from_flange) {
        (Some(value), None) => ("flange_from_camera", value, false),
        (None, Some(value)) => ("camera_from_flange", value, true),
        (None, None) => return Ok(None),
        (Some(_), Some(_)) => {
            let problem = "flange_from_camera is given too, and one is the inverse of the other";
            return Err(Error::malformed(path, "camera_from_flange", problem, "Keep one of them"));
        }
    };
    let given = match value.as_str() {
        Some(name) => {
            let file = transform::file_beside(path, name);
            scan.inputs.push(file.clone());
            transform::of_file(&file, Mount::Flange)?
        }
        None => transform::parse(value, unit)
            .map_err(|(problem, help)| Error::malformed(path, key, problem, help))?,
    };
    let at_mm = given.translation.vector.norm();
    if at_mm > LONGEST_MOUNT_MM {
        let problem = format!("the camera would be {at_mm:.0} mm from the flange");
        return Err(Error::malformed(path, key, problem, "Its translation is in `units`: check them"));
    }
    Ok(Some(if inverted { given.inverse() } else { given }))
}

/// What a view can be.
const A_VIEW: &str = "A view is {\"depth\" or \"cloud\", \"base_from_flange\" or, of a camera on a stand, \"base_from_camera\"} or \
                      {\"cloud\", \"frame\": \"base\", \"camera_m\"}";
/// The same in memory.
const A_HELD_VIEW: &str =
    "Give each view its pose: base_from_camera, or base_from_flange with a hand-eye transform";

/// What every view needs to be read.
struct Job<'a> {
    path: &'a Path,
    unit: Unit,
    hand_eye: Option<Isometry3<f64>>,
    rays: Option<Rays>,
    limit: Limit,
    manifest: &'a Manifest,
}

type Read = (View, PathBuf, Vec<String>);

impl Job<'_> {
    fn view(&self, i: usize) -> Result<Read, Error> {
        let entry = &self.manifest.views[i];
        match (&entry.depth, &entry.cloud, entry.frame) {
            (Some(depth), None, None | Some(Frame::Camera)) => self.depth_view(i, depth),
            (None, Some(cloud), None | Some(Frame::Camera)) => self.cloud_view(i, cloud),
            (None, Some(cloud), Some(Frame::Base)) => self.base_view(i, cloud),
            (Some(_), None, Some(Frame::Base)) => {
                self.bad(i, "frame", "a depth image is in the camera's frame")
            }
            (Some(_), Some(_), _) => self.bad(i, "depth", "`depth` and `cloud` exclude each other"),
            (None, None, _) => self.bad(i, "depth", "neither `depth` nor `cloud` is given"),
        }
    }

    fn bad<T>(&self, i: usize, field: &str, problem: impl Into<String>) -> Result<T, Error> {
        let help = if self.manifest.held.is_empty() { A_VIEW } else { A_HELD_VIEW };
        Err(Error::malformed(self.path, format!("views[{i}].{field}"), problem, help))
    }

    /// A path in scan.json is relative to its folder.
    fn file(&self, name: &Path) -> PathBuf {
        self.path.parent().unwrap_or(Path::new("")).join(name)
    }

    fn depth_view(&self, i: usize, name: &Path) -> Result<Read, Error> {
        if let Some(Held::Depth { points_mm, rays }) = self.manifest.held.get(i) {
            let base_from_camera = self.base_from_camera(i)?;
            let view = View { base_from_camera, ..depth::view(name_of(name), points_mm.clone(), rays) };
            return Ok((view, name.into(), Vec::new()));
        }
        let Some(rays) = &self.rays else {
            let help = "Add \"camera\": {width, height, fx, fy, cx, cy, depth_scale_m}";
            return Err(Error::malformed(
                self.path,
                "camera",
                "it is missing, and depth images need it",
                help,
            ));
        };
        let base_from_camera = self.base_from_camera(i)?;
        let file = self.file(name);
        let points_mm = depth::points_mm(&read_file(&file, self.limit)?, rays, &file, self.limit)?;
        let view = View { base_from_camera, ..depth::view(name_of(&file), points_mm, rays) };
        Ok((view, file, Vec::new()))
    }

    fn cloud_view(&self, i: usize, name: &Path) -> Result<Read, Error> {
        let base_from_camera = self.base_from_camera(i)?;
        let (view, file, notes) = match self.manifest.held.get(i) {
            Some(Held::Cloud(raw)) => self.cloud_of(raw.clone(), name.into(), Vector3::zeros())?,
            _ => self.cloud(name, Vector3::zeros())?,
        };
        Ok((View { base_from_camera, ..view }, file, notes))
    }

    fn base_view(&self, i: usize, name: &Path) -> Result<Read, Error> {
        let entry = &self.manifest.views[i];
        let Some(camera_m) = entry.camera_m else {
            return self.bad(
                i,
                "camera_m",
                "a cloud in the base frame needs the camera's position, [x, y, z] in metres",
            );
        };
        if !entry.poses().is_empty() {
            return self.bad(i, "base_from_flange", "a cloud in the base frame needs no pose");
        }
        let at_mm = Vector3::from(camera_m) * 1000.0;
        self.check_reach(i, "camera_m", at_mm)?;
        self.cloud(name, at_mm)
    }

    /// A cloud whose camera stood at `camera_mm` in the cloud's own axes.
    fn cloud(&self, name: &Path, camera_mm: Vector3<f64>) -> Result<Read, Error> {
        let file = self.file(name);
        self.cloud_of(parsed(&file, self.limit)?, file, camera_mm)
    }

    fn cloud_of(&self, mut raw: Raw, file: PathBuf, camera_mm: Vector3<f64>) -> Result<Read, Error> {
        raw.triangles.clear();
        if let Some(other) = raw.unit.filter(|unit| *unit != self.unit) {
            raw.notes.push(format!("the file states {}; read as {}", other.name(), self.unit.name()));
        }
        let mut notes = std::mem::take(&mut raw.notes);
        match raw.clean(&file, &mut notes) {
            Ok(()) | Err(Error::Empty { .. }) => {}
            Err(other) => return Err(other),
        }
        let mm = self.unit.mm();
        let mut view = view_of(raw, Some(camera_mm / mm), Vector3::zeros(), mm, name_of(&file));
        view.base_from_camera = translation(camera_mm);
        Ok((view, file, notes))
    }

    /// Pose of the camera, eq. (1): the reported pose of the flange times the hand-eye transform.
    fn base_from_camera(&self, i: usize) -> Result<Isometry3<f64>, Error> {
        let entry = &self.manifest.views[i];
        if entry.camera_m.is_some() {
            return self.bad(i, "camera_m", "it belongs to a cloud with \"frame\": \"base\"");
        }
        let given = entry.poses();
        let (key, value) = match given[..] {
            [one] => one,
            [] => {
                let form = "it is missing: [x, y, z, rx, ry, rz], rotation vector in rad";
                return self.bad(i, "base_from_flange", form);
            }
            [(first, _), (second, _), ..] => {
                return self.bad(i, second, format!("{first} is given too; keep one of them"));
            }
        };
        if entry.is_fixed() {
            return self.fixed_camera(i, key, value);
        }
        let Some(flange_from_camera) = self.hand_eye else {
            let help = "Add the hand-eye calibration, as a 4x4 matrix or the name of its file; if the poses are the camera's, \
                        call them base_from_camera";
            return Err(Error::malformed(self.path, "flange_from_camera", "it is missing", help));
        };
        let place = format!("views[{i}].{key}");
        let pose = transform::parse(value, self.unit)
            .map_err(|(problem, help)| Error::malformed(self.path, place, problem, help))?;
        self.check_reach(i, key, pose.translation.vector)?;
        let base_from_flange = match key {
            "flange_from_base" => pose.inverse(),
            "base_from_tcp" => pose * self.tcp_from_flange()?,
            _ => pose,
        };
        Ok(base_from_flange * flange_from_camera)
    }

    /// The pose of a camera that stands beside the robot, or is known however it moves; a string is the name of a file beside
    /// scan.json.
    fn fixed_camera(&self, i: usize, key: &str, value: &Value) -> Result<Isometry3<f64>, Error> {
        let place = format!("views[{i}].{key}");
        // A calibration's file says where the camera stands, never the inverse.
        let given = match value.as_str().filter(|_| key == "base_from_camera") {
            Some(name) => transform::of_file(&transform::file_beside(self.path, name), Mount::Stand)?,
            None => transform::parse(value, self.unit)
                .map_err(|(problem, help)| Error::malformed(self.path, place, problem, help))?,
        };
        let pose = if key == "camera_from_base" { given.inverse() } else { given };
        self.check_reach(i, key, pose.translation.vector)?;
        Ok(pose)
    }

    /// What the controller's TCP is set to, the other way round.
    fn tcp_from_flange(&self) -> Result<Isometry3<f64>, Error> {
        let bad = |problem: String, help: &str| Error::malformed(self.path, "flange_from_tcp", problem, help);
        let help = "Give the TCP that is set at the controller, as in [x, y, z, rx, ry, rz], or the flange's pose as \
                    base_from_flange";
        let value = self.manifest.flange_from_tcp.as_ref();
        let value = value.ok_or_else(|| bad("it is missing, and base_from_tcp needs it".into(), help))?;
        let given = transform::parse(value, self.unit).map_err(|(problem, help)| bad(problem, help))?;
        let away_mm = given.translation.vector.norm();
        if away_mm > LONGEST_MOUNT_MM {
            return Err(bad(
                format!("the TCP would be {away_mm:.0} mm from the flange"),
                "It is in `units`: check them",
            ));
        }
        Ok(given.inverse())
    }

    fn check_reach(&self, i: usize, field: &str, at_mm: Vector3<f64>) -> Result<(), Error> {
        if at_mm.norm() <= LONGEST_REACH_MM {
            return Ok(());
        }
        self.bad(
            i,
            field,
            format!("it is {:.0} mm from the base, which no robot reaches: check `units`", at_mm.norm()),
        )
    }
}

/// Refuses, or warns of, a hand-eye transform or poses that fit much better the other way round.
fn check_direction(
    manifest: &Manifest,
    unit: Unit,
    hand_eye: Option<Isometry3<f64>>,
    scan: &mut Scan,
    path: &Path,
) -> Result<(), Error> {
    if manifest.views.iter().all(Entry::is_fixed) {
        return check_fixed(manifest, scan, path);
    }
    let in_base = |entry: &Entry| entry.frame == Some(Frame::Base) || entry.is_fixed();
    let Some(hand_eye) = hand_eye.filter(|_| !manifest.views.iter().any(in_base)) else { return Ok(()) };
    let flange = |view: &View| view.base_from_camera * hand_eye.inverse();
    let poses: Vec<Isometry3<f64>> = scan.views.iter().map(flange).collect();
    let Some(found) = direction::better(&scan.views, &poses, &hand_eye) else {
        return check_readings(manifest, scan, path, |views, trial| {
            readings::readings(manifest, unit, hand_eye, views, trial)
        });
    };
    let inverse =
        |key: &'static str, other: &'static str, given: bool| if given { [key, other] } else { [other, key] };
    let eye = inverse("flange_from_camera", "camera_from_flange", manifest.flange_from_camera.is_some());
    let forward =
        manifest.views.iter().any(|entry| entry.base_from_flange.is_some() || entry.base_from_tcp.is_some());
    let pose = inverse("base_from_flange", "flange_from_base", forward);
    let wrong: Vec<[&str; 2]> = [(found.invert_hand_eye, eye), (found.invert_poses, pose)]
        .into_iter()
        .filter(|w| w.0)
        .map(|w| w.1)
        .collect();
    tell_direction(&found, &wrong, scan, path)
}

/// The same of poses that are the camera's own: Open3D's `extrinsic`, for one, is the inverse of a pose.
fn check_fixed(manifest: &Manifest, scan: &mut Scan, path: &Path) -> Result<(), Error> {
    let poses: Vec<Isometry3<f64>> = scan.views.iter().map(|view| view.base_from_camera).collect();
    let keys = ["base_from_camera", "camera_from_base"];
    let is_inverse = manifest.views.iter().all(|entry| entry.camera_from_base.is_some());
    let Some(found) = direction::better(&scan.views, &poses, &Isometry3::identity()) else {
        let key = keys[usize::from(is_inverse)];
        return check_readings(manifest, scan, path, |views, _| {
            readings::readings_of_cameras(manifest, key, views)
        });
    };
    let wrong = if is_inverse { [keys[1], keys[0]] } else { keys };
    tell_direction(&found, &[wrong], scan, path)
}

/// Refuses, or warns of, what fits better the other way round: each key, and that of its inverse.
fn tell_direction(
    found: &direction::Better,
    wrong: &[[&str; 2]],
    scan: &mut Scan,
    path: &Path,
) -> Result<(), Error> {
    let names = |k: usize| wrong.iter().map(|pair| pair[k]).collect::<Vec<_>>().join(" and ");
    let problem = format!(
        "the views agree {:.0} times better when {} is inverted ({:.1} mm apart instead of {:.1} mm): is it {}?",
        found.times(),
        names(0),
        found.better_mm,
        found.given_mm,
        names(1)
    );
    if found.times() >= direction::REFUSED {
        return Err(Error::malformed(path, names(0), problem, format!("Rename the key to {}", names(1))));
    }
    scan.doubts.push(Doubt { kind: DoubtKind::Direction, words: problem });
    Ok(())
}

/// Refuses what is read otherwise than it was meant, where trying shows how it was meant.
fn check_readings(
    manifest: &Manifest,
    scan: &mut Scan,
    path: &Path,
    readings: impl FnOnce(&[View], &Trial) -> Vec<Reading>,
) -> Result<(), Error> {
    // A view that sees nothing is left out, and which pose belongs to which is not known then.
    if scan.views.len() != manifest.views.len() {
        return Ok(());
    }
    let given: Vec<Isometry3<f64>> = scan.views.iter().map(|view| view.base_from_camera).collect();
    let told = misreading::told(&scan.views, &given, |trial| readings(&scan.views, trial));
    match told {
        Told::Agree => Ok(()),
        Told::One { problem, help } => Err(Error::malformed(path, "views", problem, help)),
        Told::Several { problem } => {
            let help = "Look up which of them it is: \"Which pose do you have?\" in docs/scan.md";
            Err(Error::malformed(path, "views", problem, help))
        }
        Told::None { given_mm } => {
            scan.notes.push(format!(
                "the views are {given_mm:.1} mm apart as given, and none of the usual misreadings makes them agree: the inverse of \
                 poses or hand-eye, a TCP for the flange, angles of other kinds, orders of quaternions and images, units of depth and \
                 hand-eye"
            ));
            Ok(())
        }
    }
}

/// Warns of poses and depths that are possible, but probably in a wrong unit.
fn doubts(manifest: &Manifest, views: &[View]) -> Vec<Doubt> {
    let mut doubts = Vec::new();
    let mut doubt = |kind, words| doubts.push(Doubt { kind, words });
    // A rotation vector is the end of a list of six, or has a name of its own.
    let turned_rad = |pose: &Option<Value>| -> Option<f64> {
        let value = pose.as_ref()?;
        let list = value.get("rotation_vector_rad").unwrap_or(value);
        let numbers: Vec<f64> = serde_json::from_value(list.clone()).ok()?;
        matches!(numbers.len(), 3 | 6)
            .then(|| Vector3::from_column_slice(&numbers[numbers.len() - 3..]).norm())
    };
    let doubtful = manifest.views.iter().enumerate().find_map(|(i, entry)| {
        let poses =
            [("base_from_flange", &entry.base_from_flange), ("flange_from_base", &entry.flange_from_base)];
        let whole_turn_rad = 2.01 * std::f64::consts::PI;
        let turns = |pose| turned_rad(pose).is_some_and(|rad| rad > whole_turn_rad);
        poses.into_iter().find(|(_, pose)| turns(pose)).map(|(name, _)| format!("views[{i}].{name}"))
    });
    if let Some(place) = doubtful {
        doubt(DoubtKind::Angles, format!("{place} turns by more than a whole turn: is it in degrees?"));
    }
    let at_mm = |view: &View| view.base_from_camera.translation.vector;
    let near = views.iter().all(|view| at_mm(view).norm() < 10.0);
    // A camera whose frame is taken for the base's stands in its origin.
    let of_flange = manifest.views.iter().any(|entry| !entry.poses().is_empty() && !entry.is_fixed());
    let moves = manifest.views.iter().all(Entry::is_fixed)
        && views.windows(2).any(|two| at_mm(&two[0]) != at_mm(&two[1]));
    if near && (of_flange || moves) {
        let words = "all cameras are within 10 mm of the base's origin: check `units`";
        doubt(DoubtKind::Units, words.into());
    }
    let median_mm = |view: &View| {
        let mut depths: Vec<f32> = view.points_mm.iter().step_by(97).map(|p| p.coords.norm()).collect();
        depths.sort_unstable_by(f32::total_cmp);
        depths.get(depths.len() / 2).copied().unwrap_or(0.0)
    };
    for view in views {
        let depth = median_mm(view);
        if !(20.0..=20_000.0).contains(&depth) {
            let words = format!(
                "{} is {depth:.1} mm from its camera at the median: check `units` and `depth_scale_m`",
                view.name
            );
            doubt(DoubtKind::DepthScale, words);
        }
    }
    doubts
}

#[cfg(test)]
mod tests {
    use super::super::read_bytes;
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    const IDENTITY: &str = "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]";

    /// Reads a scan.json beside a cloud of one point, (0.1, 0.2, 0.5) in `units`.
    fn scan(json: &str) -> Result<Scan, Error> {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.xyz"), "0.1 0.2 0.5\n").unwrap();
        std::fs::write(folder.path().join("blind.xyz"), "nan nan nan\n").unwrap();
        std::fs::write(folder.path().join(NAME), json).unwrap();
        super::super::read(folder.path(), &Options::default())
    }

    fn posed(hand_eye: &str, pose: &str) -> String {
        format!(
            "{{\"units\": \"m\", \"flange_from_camera\": {hand_eye}, \
             \"views\": [{{\"cloud\": \"a.xyz\", \"base_from_flange\": {pose}}}]}}"
        )
    }

    fn first_in_base(scan: &Scan) -> Point3<f64> {
        let view = &scan.views[0];
        assert!(view.camera_known);
        view.base_from_camera * view.points_mm[0].cast::<f64>()
    }

    #[test]
    fn a_point_goes_from_camera_to_flange_to_base() {
        // Hand-eye: x and y swap roles, 30 mm along z. Pose: a quarter turn about x, then (1, 2, 3) m.
        let json =
            posed("[[0,-1,0,0],[1,0,0,0],[0,0,1,0.03],[0,0,0,1]]", &format!("[1,2,3,{FRAC_PI_2},0,0]"));
        let scan = scan(&json).unwrap();
        assert!((first_in_base(&scan) - Point3::new(800.0, 1470.0, 3100.0)).norm() < 1e-3);
        assert_eq!((scan.warnings.len(), scan.inputs.len()), (0, 2));
    }

    #[test]
    fn a_pose_of_the_tcp_is_that_of_the_flange_with_the_tcp_taken_off() {
        let eye = "[[0,-1,0,0],[1,0,0,0],[0,0,1,0.03],[0,0,0,1]]";
        let flange = scan(&posed(eye, "[1,2,3,0,0,0]")).unwrap();
        // The torch stands out by 350 mm along the flange's z, turned by a quarter about x.
        let tcp = |tcp: &str, view: &str| {
            format!(
                "{{\"units\": \"m\", \"flange_from_camera\": {eye}, {tcp} \"views\": [{{\"cloud\": \"a.xyz\", {view}}}]}}"
            )
        };
        let set = format!("\"flange_from_tcp\": [0,0,0.35,{FRAC_PI_2},0,0],");
        let pose = format!("\"base_from_tcp\": [1,2,3.35,{FRAC_PI_2},0,0]");
        let same = scan(&tcp(&set, &pose)).unwrap();
        assert!((first_in_base(&same) - first_in_base(&flange)).norm() < 1e-3);
        let missing = scan(&tcp("", &pose)).unwrap_err().to_string();
        assert!(missing.contains("flange_from_tcp") && missing.contains("it is missing"), "{missing}");
        let both = scan(&tcp(&set, &format!("{pose}, \"base_from_flange\": [1,2,3,0,0,0]")))
            .unwrap_err()
            .to_string();
        assert!(both.contains("base_from_flange is given too"), "{both}");
    }

    #[test]
    fn files_outside_the_folder_are_read_only_if_that_is_allowed() {
        let home = tempfile::tempdir().unwrap();
        let folder = home.path().join("scan");
        std::fs::create_dir(&folder).unwrap();
        std::fs::write(home.path().join("secret.xyz"), "0.1 0.2 0.5\n").unwrap();
        let absolute = home.path().join("secret.xyz").display().to_string();
        for name in ["../secret.xyz", &absolute, "x/../../secret.xyz"] {
            let view = format!(r#"{{"cloud": "{name}", "frame": "base", "camera_m": [0, 0, 1]}}"#);
            std::fs::write(folder.join(NAME), format!(r#"{{"units": "m", "views": [{view}]}}"#)).unwrap();
            let error = super::super::read(&folder, &Options::default()).unwrap_err().to_string();
            assert!(error.contains("views[0].cloud") && error.contains("--allow-outside"), "{error}");
        }
        let view = r#"{"cloud": "../secret.xyz", "frame": "base", "camera_m": [0, 0, 1]}"#;
        std::fs::write(folder.join(NAME), format!(r#"{{"units": "m", "views": [{view}]}}"#)).unwrap();
        let allowed = Options { allow_outside: true, ..Options::default() };
        assert_eq!(super::super::read(&folder, &allowed).unwrap().views.len(), 1);
    }

    #[test]
    fn a_cloud_in_the_base_frame_stays_there_and_has_its_camera_at_the_origin() {
        let scan = scan(
            r#"{"units": "m", "views": [{"cloud": "a.xyz", "frame": "base", "camera_m": [0.1, 0.2, 1.5]}]}"#,
        )
        .unwrap();
        assert!((first_in_base(&scan) - Point3::new(100.0, 200.0, 500.0)).norm() < 1e-3);
        assert!((scan.views[0].points_mm[0] - Point3::new(0.0, 0.0, -1000.0)).norm() < 1e-3);
    }

    #[test]
    fn a_view_that_sees_nothing_is_left_out_with_a_warning() {
        let blind = r#"{"cloud": "blind.xyz", "frame": "base", "camera_m": [0, 0, 1]}"#;
        let seeing = r#"{"cloud": "a.xyz", "frame": "base", "camera_m": [0, 0, 1]}"#;
        let read = scan(&format!("{{\"units\": \"m\", \"views\": [{blind}, {seeing}]}}")).unwrap();
        assert_eq!(read.views.len(), 1);
        assert!(read.warnings[0].contains("blind.xyz"));
        assert!(matches!(scan(&format!("{{\"views\": [{blind}]}}")), Err(Error::Empty { .. })));
    }

    #[test]
    fn errors_name_the_field() {
        let pose = "[0,0,1,0,0,0]";
        for (json, place) in [
            (posed(IDENTITY, pose).replace("cloud", "clod"), "did you mean `cloud`"),
            (posed(IDENTITY, pose).replace("\"units\"", "\"unit\""), "did you mean `units`"),
            (posed(IDENTITY, pose).replace("\"m\"", "\"inch\""), "line 1"),
            (posed(IDENTITY, pose).replace("a.xyz", "b.xyz"), "b.xyz"),
            (posed("[[1,0,0,0],[0,1,0,0],[0,0,-1,0],[0,0,0,1]]", pose), "reflection"),
            (posed("[[2,0,0,0],[0,2,0,0],[0,0,2,0],[0,0,0,1]]", pose), "not a rotation"),
            (posed("[[1,0,0,60],[0,1,0,0],[0,0,1,0],[0,0,0,1]]", pose), "60000 mm from the flange"),
            (posed("[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,2]]", pose), "last row"),
            (posed(IDENTITY, "[400,0,300,0,0,0]"), "views[0].base_from_flange"),
            (posed(IDENTITY, "[0,0,1,0,0]"), "views[0].base_from_flange"),
            (posed("\"eye.yaml\"", pose), "eye.yaml"),
            (
                posed(IDENTITY, "\"../eye.yaml\"").replace("base_from_flange", "camera_from_base"),
                "camera_from_base: not a form",
            ),
            (posed(IDENTITY, "[0,0,1e999,0,0,0]"), "line 1"),
            (posed(IDENTITY, pose).replace("flange_from_camera", "camera"), "line 1"),
            (r#"{"units": "m", "views": [{"cloud": "a.xyz"}]}"#.into(), "views[0].base_from_flange"),
            (r#"{"units": "m", "views": [{"cloud": "a.xyz", "frame": "base"}]}"#.into(), "views[0].camera_m"),
            (r#"{"units": "m", "views": [{}]}"#.into(), "neither"),
            (r#"{"units": "m", "views": []}"#.into(), "views"),
            ("{".into(), "line 1"),
        ] {
            let error = scan(&json).unwrap_err().to_string();
            let other = ["b.xyz", "eye.yaml"].contains(&place);
            assert!(error.contains(place) && (error.contains(NAME) || other), "{json}\n{error}");
        }
    }

    #[test]
    fn doubtful_units_draw_a_warning() {
        let json = posed(IDENTITY, "[0.4,0,0.3,0,0,0]").replace("\"m\"", "\"mm\"");
        let warnings = scan(&json).unwrap().warnings;
        assert!(warnings.iter().all(|w| w.contains("units")) && warnings.len() == 2, "{warnings:?}");
        let degrees = scan(&posed(IDENTITY, "[0.4,0,0.3,0,180,0]")).unwrap();
        assert!(degrees.warnings[0].contains("degrees"));
        let named = r#"{"xyz": [0.4, 0, 0.3], "rotation_vector_rad": [0, 180, 0]}"#;
        let degrees = scan(&posed(IDENTITY, named)).unwrap();
        assert!(degrees.warnings[0].contains("base_from_flange turns"), "{:?}", degrees.warnings);
    }

    #[test]
    fn text_of_windows_is_read_and_utf_16_is_named() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.xyz"), "\u{feff}0.1 0.2 0.5\r\n").unwrap();
        let json = format!("\u{feff}{}", posed(IDENTITY, "[0,0,1,0,0,0]").replace(',', ",\r\n"));
        let read = |bytes: &[u8]| {
            std::fs::write(folder.path().join(NAME), bytes).unwrap();
            super::super::read(folder.path(), &Options::default())
        };
        assert_eq!(read(json.as_bytes()).unwrap().views[0].points_mm.len(), 1);
        let utf16: Vec<u8> = json.encode_utf16().flat_map(u16::to_le_bytes).collect();
        let error = read(&utf16).unwrap_err().to_string();
        assert!(error.contains(NAME) && error.contains("UTF-16"), "{error}");
    }

    #[test]
    fn scan_json_in_memory_says_that_it_needs_its_folder() {
        let error = read_bytes(b"{}".to_vec(), Path::new(NAME), &Options::default()).unwrap_err().to_string();
        assert!(error.contains(NAME), "{error}");
    }
}
