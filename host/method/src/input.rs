//! Reads what a camera saw: everything that turns INPUT into [`View`]s in millimetres.
//!
//! INPUT is a folder with `scan.json` (or that file), a folder of depth images with a trajectory, or one file:
//! PLY, PCD, XYZ/CSV, STL, OBJ, legacy VTK, NumPy's .npy, a 16-bit depth PNG, or, with these features, E57 and LAS/LAZ. The content
//! decides the kind, the extension only where the content has no mark of its own. This module is the only place where
//! metres appear: [`Units`] says how they are known.
//! Nothing here trusts a count in a header: it is held against the size of the file before anything is allocated.

mod arrays;
mod camera;
mod depth;
mod direction;
mod doubt;
#[cfg(feature = "e57")]
mod e57;
mod extent;
#[cfg_attr(not(any(feature = "ply", feature = "pcd")), allow(dead_code))]
mod fast;
mod foreign;
mod format;
mod frame;
mod intrinsics;
#[cfg(feature = "las")]
mod las;
mod manifest;
mod measured;
pub mod memory;
mod mesh;
mod misreading;
mod npy;
#[cfg(feature = "pcd")]
mod pcd;
#[cfg(feature = "ply")]
mod ply;
mod raster;
mod raw;
// The count of a header is checked here for every format; the rest is for the two formats alone.
#[cfg_attr(not(any(feature = "ply", feature = "pcd")), allow(dead_code))]
mod records;
mod repeated;
mod stated;
mod steps;
mod stl;
mod strays;
mod text;
mod trajectory;
mod transform;
mod units;
mod vtk;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use crate::geometry::cloud::View;
pub use arrays::{CameraPose, Coordinates, PosedViews, RawCloud, RawView, Transform};
pub use camera::{CameraPosition, Distortion, Intrinsics};
pub use doubt::{CloudFrame, Doubt, DoubtKind};
use extent::Extent;
use format::{Format, Reader};
use raw::Raw;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
pub use stated::StatedFrame;
pub use units::{Units, UnknownUnits};

/// How INPUT is read.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Unit of the coordinates in INPUT; `Auto` asks the file, then the size of what it holds.
    pub units: Units,
    /// Of depth images that come without: one alone, or a folder with a trajectory only.
    pub intrinsics: Option<Intrinsics>,
    /// Of the same images, metres per count.
    pub depth_scale_m: Option<f64>,
    /// Where the camera stood that took a cloud which does not tell, mm, in the cloud's own frame.
    pub camera_mm: Option<CameraPosition>,
    /// Whose frame the coordinates of a cloud are in that does not tell.
    pub frame: Option<StatedFrame>,
    /// Whether a file with faces is exact CAD or a scan; its data say it where this does not.
    pub mesh_as: Option<MeshAs>,
    /// Whether a `scan.json` may name files outside its folder. One that came from somebody else should not.
    pub allow_outside: bool,
    /// The most memory that reading and planning may take.
    pub memory: memory::Limit,
}

/// What a file with faces is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum MeshAs {
    /// Drawn: its faces are exact.
    Cad,
    /// Measured: its vertices are points of a scan.
    Scan,
}

/// What was read, and how it was understood. Kept on a disk it is without its points.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Scan {
    /// One per camera pose; never empty, and no view is empty.
    #[serde(skip)]
    pub views: Vec<View>,
    /// What was there before the work; empty if nothing is known of it.
    #[serde(skip)]
    pub background: Arc<[View]>,
    /// What was derived and how, such as `units: metres (extent 0.6)`.
    pub notes: Vec<String>,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// What cannot well be true of it; the warnings say so, too.
    pub doubts: Vec<Doubt>,
    /// Whose frame it is in.
    pub frame: CloudFrame,
    /// Files read, in the order of reading; those of a folder without `scan.json` that say how it is read may be missing.
    pub inputs: Vec<PathBuf>,
}

impl Scan {
    /// All that is said of it; the background is whole.
    pub fn without_points(&self) -> Self {
        let Self { views: _, background, notes, warnings, doubts, frame, inputs } = self;
        Self {
            views: Vec::new(),
            background: Arc::clone(background),
            notes: notes.clone(),
            warnings: warnings.clone(),
            doubts: doubts.clone(),
            frame: *frame,
            inputs: inputs.clone(),
        }
    }

    /// Of these views, read from one file, with nothing to be said of it.
    fn of(views: Vec<View>, frame: CloudFrame, path: &Path) -> Self {
        let background = Arc::default();
        let (notes, warnings, doubts, inputs) = (Vec::new(), Vec::new(), Vec::new(), vec![path.into()]);
        Self { views, background, notes, warnings, doubts, frame, inputs }
    }

    /// The same work, and `before` it what was there.
    ///
    /// # Errors
    /// If both are not in one frame. A cloud that does not tell is taken to be in that of the scan.
    pub fn over(self, before: Self) -> Result<Self, Error> {
        let [own, other] = [self.frame, before.frame];
        let known = [own, other].into_iter().all(|frame| frame != CloudFrame::Unknown);
        let is_camera = |frame| frame == CloudFrame::Camera;
        if known && own != other || is_camera(other) && !is_camera(own) {
            let path = before.inputs.first().cloned().unwrap_or_default();
            let [scan, background] = [own, other].map(CloudFrame::words);
            let problem = format!("its coordinates are {background}, and those of the scan are {scan}");
            let help = "Scan the background with poses as the work is scanned, or give a cloud of it in the frame of the scan";
            return Err(Error::malformed(&path, "background", problem, help));
        }
        let inputs = self.inputs.into_iter().chain(before.inputs).collect();
        let notes = before.notes.iter().map(|note| format!("background: {note}"));
        let notes = self.notes.into_iter().chain(notes).collect();
        Ok(Self { background: before.views.into(), inputs, notes, ..self })
    }
}

/// Why INPUT could not be read: the file, the place in it, and a way out.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The file system refuses.
    #[error("{path}: cannot be read: {source}. {help}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
        /// A way out.
        help: &'static str,
    },
    /// No reader knows this file.
    #[error(
        "{path}: neither its content nor its extension names a known kind. {help}",
        path = path.display()
    )]
    UnknownKind {
        /// The file.
        path: PathBuf,
        /// A way out.
        help: &'static str,
    },
    /// The file holds no point.
    #[error("{path}: holds no point: {reason}. Scan again, or check how the file was written.", path = path.display())]
    Empty {
        /// The file.
        path: PathBuf,
        /// What it holds instead.
        reason: String,
    },
    /// The header promises more than the file can hold.
    #[error(
        "{path}: {place}: {claimed} {what} are claimed, but the {available} bytes that follow hold at most \
         {possible}. The file is cut off or its header is wrong: copy or export it again.",
        path = path.display()
    )]
    Oversized {
        /// The file.
        path: PathBuf,
        /// Field of the header.
        place: String,
        /// What is counted: points, triangles, pixels.
        what: &'static str,
        /// Count in the header.
        claimed: u64,
        /// Bytes left after the header.
        available: u64,
        /// Largest count that they could hold.
        possible: u64,
    },
    /// More than a file of this size, or this machine, has room for.
    #[error(
        "{path}: {count} {what} would take {needed_mb} MB of memory, more than {most_mb} MB, {}. Give a smaller file, \
         or raise the limit with --memory-mb if that is what it is.",
        bound.words(),
        path = path.display()
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// What is counted: pixels, faces, points.
        what: &'static str,
        /// How many there are.
        count: u64,
        /// What they would take.
        needed_mb: u64,
        /// What they may.
        most_mb: u64,
        /// What sets that limit.
        bound: memory::Bound,
    },
    /// The file breaks the rules of its kind.
    #[error("{path}: {place}: {problem}. {help}", path = path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Line, byte, field or view.
        place: String,
        /// What is wrong there.
        problem: String,
        /// A way out.
        help: String,
    },
}

impl Error {
    fn malformed(
        path: &Path,
        place: impl Into<String>,
        problem: impl Into<String>,
        help: impl Into<String>,
    ) -> Self {
        let (place, problem, help) = (place.into(), problem.into(), help.into());
        let problem = problem.trim_end_matches(['.', ' ', '\n']).into();
        Self::Malformed { path: path.into(), place, problem, help }
    }

    fn empty(path: &Path, reason: impl Into<String>) -> Self {
        Self::Empty { path: path.into(), reason: reason.into() }
    }
}

/// Reads a folder or a file.
///
/// # Errors
/// Names the file, the place in it and a way out.
///
/// ```
/// use std::path::Path;
/// use weldpath_method::input::{self, Options};
///
/// let error = input::read(Path::new("no-such-scan"), &Options::default()).unwrap_err();
/// assert!(error.to_string().contains("INPUT is a folder with scan.json"));
/// ```
pub fn read(input: &Path, options: &Options) -> Result<Scan, Error> {
    whole(read_any(input, options)?, input, options)
}

/// In the frame that was stated, without strays and what places hold beyond their share, and within the memory that a plan may
/// take.
fn whole(mut scan: Scan, input: &Path, options: &Options) -> Result<Scan, Error> {
    stated::hold(options.frame, &mut scan, input)?;
    for view in &mut scan.views {
        let is_read = view.mesh.is_none();
        let far = is_read.then(|| strays::drop_far(&mut view.points_mm, &mut view.normals)).flatten();
        let repeated = repeated::thin(&mut view.points_mm, &mut view.normals);
        scan.notes.extend([far, repeated].into_iter().flatten().map(|note| format!("{}: {note}", view.name)));
    }
    options.memory.hold_plan(input, scan.views.iter().map(|view| view.points_mm.len()).sum())?;
    Ok(scan)
}

/// Files that [`read`] may look at beside those that it names in [`Scan::inputs`]: which of them are there, and what they hold,
/// decides how INPUT is understood. All of a folder and of its `depth/`, or the one file; sorted.
pub fn looked_at(input: &Path) -> Vec<PathBuf> {
    if !input.is_dir() {
        return vec![input.into()];
    }
    let files = |folder: &Path| -> Vec<PathBuf> {
        let entries = std::fs::read_dir(folder).into_iter().flatten().filter_map(Result::ok);
        entries.map(|entry| entry.path()).filter(|path| path.is_file()).collect()
    };
    let mut all = files(input);
    all.extend(files(&input.join(trajectory::IMAGES)));
    all.sort();
    all
}

fn read_any(input: &Path, options: &Options) -> Result<Scan, Error> {
    let scan_json = input.join(manifest::NAME);
    if scan_json.is_file() {
        return manifest::read(&scan_json, options);
    }
    if input.is_dir() {
        return trajectory::read_folder(input, options);
    }
    if let Some(raw) = fast::read(input, options.memory) {
        return single(raw, input, options);
    }
    let bytes = read_file(input, options.memory)?;
    if let Some(Format { reader: Reader::Manifest, .. }) = format::of(&bytes, input) {
        return manifest::read(input, options);
    }
    of_bytes(bytes, input, options)
}

/// Reads one cloud, mesh or depth image that is already in memory; `path` names it in messages and lends its extension.
///
/// # Errors
/// As [`read`]; a `scan.json` is refused, since it needs the files beside it.
///
/// ```
/// use std::path::Path;
/// use weldpath_method::input::{self, Options, Units};
///
/// let options = Options { units: Units::Metres, ..Options::default() };
/// let scan = input::read_bytes(b"0.10 0 0\n0.11 0 0\n".to_vec(), Path::new("part.xyz"), &options)?;
/// assert_eq!(scan.views[0].points_mm.len(), 2);
/// # Ok::<(), input::Error>(())
/// ```
pub fn read_bytes(bytes: Vec<u8>, path: &Path, options: &Options) -> Result<Scan, Error> {
    whole(of_bytes(without_mark(bytes), path, options)?, path, options)
}

fn of_bytes(bytes: Vec<u8>, path: &Path, options: &Options) -> Result<Scan, Error> {
    let format = format_of(&bytes, path)?;
    match format.reader {
        Reader::Views { read, .. } => read(bytes, path, options),
        _ => single(parse(bytes, format, path, options.memory)?, path, options),
    }
}

fn format_of(bytes: &[u8], path: &Path) -> Result<&'static Format, Error> {
    if bytes.is_empty() {
        return Err(Error::empty(path, "the file has 0 bytes"));
    }
    foreign::refuse(bytes, path)?;
    let unknown = || {
        let unknown = || Error::UnknownKind { path: path.into(), help: format::help(path) };
        foreign::by_name(path).unwrap_or_else(unknown)
    };
    format::of(bytes, path).ok_or_else(unknown)
}

/// The points of a PLY, PCD, XYZ/CSV, STL or OBJ file as they stand in it: its unit, its frame, nothing dropped.
///
/// # Errors
/// As [`read`].
pub fn points(path: &Path) -> Result<Vec<Point3<f32>>, Error> {
    Ok(match parsed(path, memory::Limit::default())?.positions {
        raw::Positions::Single(points) => points,
        raw::Positions::Double(points) => points.iter().map(|p| p.cast()).collect(),
    })
}

/// The triangles of an STL, OBJ or PLY mesh, mm, in the frame of the file; none of a file without triangles. Triangles
/// with a corner that is not finite are left out.
///
/// # Errors
/// As [`read`].
pub fn triangles(path: &Path, options: &Options) -> Result<Vec<[Point3<f64>; 3]>, Error> {
    let raw = parsed(path, options.memory)?;
    let (mut notes, mut warnings) = (Vec::new(), Vec::new());
    let mm_per_unit = units::decide(options.units, raw.unit, &raw.extent(), &mut notes, &mut warnings);
    let corner = |i: usize| Point3::from(raw.positions.at(i) * mm_per_unit);
    let finite = |t: &[Point3<f64>; 3]| t.iter().all(|p| p.iter().all(|c| c.abs() <= raw::FARTHEST));
    Ok(raw.triangles.iter().map(|t| t.map(corner)).filter(finite).collect())
}

/// What one file tells: its points, as they stand in it, and more.
fn parsed(path: &Path, limit: memory::Limit) -> Result<Raw, Error> {
    if let Some(raw) = fast::read(path, limit) {
        return Ok(raw);
    }
    let bytes = read_file(path, limit)?;
    let format = format_of(&bytes, path)?;
    parse(bytes, format, path, limit)
}

/// The points of one file, as they stand in it.
fn parse(bytes: Vec<u8>, format: &Format, path: &Path, limit: memory::Limit) -> Result<Raw, Error> {
    let another = |help: &str| {
        let problem = "a point cloud is needed here, this is another kind of file";
        Err(Error::malformed(path, "byte 0", problem, help))
    };
    match format.reader {
        Reader::Points { parse, .. } => parse(bytes, path, limit),
        Reader::Views { elsewhere, .. } => another(elsewhere),
        Reader::Manifest => another("Give a depth image as `depth`, a cloud as `cloud`."),
        Reader::LeftOut(feature) => Err(left_out(path, format.name, feature)),
    }
}

/// A format that this build does not read.
fn left_out(path: &Path, format: &str, feature: &str) -> Error {
    let help = format!(
        "Give the file itself as INPUT to a build with `--features {feature}`; or export it as PLY or PCD, for instance with \
         CloudCompare"
    );
    Error::malformed(path, "byte 0", format!("{format} is not read here"), help)
}

/// A single file as INPUT: its unit and its frame are for us to find out.
fn single(mut raw: Raw, path: &Path, options: &Options) -> Result<Scan, Error> {
    let mut notes = std::mem::take(&mut raw.notes);
    raw.clean(path, &mut notes)?;
    let extent = raw.extent();
    let mut warnings = Vec::new();
    let mm_per_unit = units::decide(options.units, raw.unit, &extent, &mut notes, &mut warnings);
    let mut doubts = Vec::new();
    if !raw.triangles.is_empty() {
        match mesh::taken(raw, options, &extent, mm_per_unit, path, &mut notes)? {
            mesh::Taken::Cad(view) => {
                let scan = Scan::of(vec![*view], CloudFrame::Unknown, path);
                return Ok(Scan { notes, warnings, ..scan });
            }
            mesh::Taken::Scan(cloud, doubt) => {
                raw = *cloud;
                doubts.extend(doubt);
            }
        }
        raw.clean(path, &mut notes)?;
    }
    let seen = match (options.camera_mm, options.frame) {
        (Some(at), _) => {
            let [x, y, z] = at.mm();
            notes.push(format!("frame: a camera at {x}, {y}, {z} mm (as given)"));
            Ok(vec![(raw, Vector3::from(at.mm()) / mm_per_unit)])
        }
        (None, Some(StatedFrame::Camera)) => {
            notes.push("frame: the camera's (as given)".into());
            Ok(vec![(raw, Vector3::zeros())])
        }
        _ => pictures(raw, &extent, mm_per_unit, options.frame, &mut notes),
    };
    let at_origin = |parts: &[Picture]| parts.iter().all(|(_, camera)| *camera == Vector3::zeros());
    let in_camera =
        options.frame != Some(StatedFrame::Base) && seen.as_ref().is_ok_and(|parts| at_origin(parts));
    let frame = if in_camera { CloudFrame::Camera } else { CloudFrame::Unknown };
    let views = match seen {
        Ok(parts) => {
            let names = names(&name_of(path), parts.len());
            let view = |((part, camera), name)| view_of(part, Some(camera), extent.middle, mm_per_unit, name);
            parts.into_iter().zip(names).map(view).collect()
        }
        Err((raw, doubt)) => {
            doubts.extend(doubt);
            vec![view_of(*raw, None, extent.middle, mm_per_unit, name_of(path))]
        }
    };
    warnings.extend(doubts.iter().map(|doubt| doubt.words.clone()));
    let scan = Scan::of(views, frame, path);
    Ok(Scan { notes, warnings, doubts, ..scan })
}

/// The names of the pictures in a file.
fn names(file: &str, count: usize) -> Vec<String> {
    if count == 1 { vec![file.into()] } else { (1..=count).map(|k| format!("{file}, picture {k}")).collect() }
}

/// What one camera took, and where it stood, file units.
type Picture = (Raw, Vector3<f64>);

/// The pictures that a cloud is made of. The cloud as it is, and what is to be asked of its frame, where
/// they are not known.
fn pictures(
    raw: Raw,
    extent: &Extent,
    mm_per_unit: f64,
    stated: Option<StatedFrame>,
    notes: &mut Vec<String>,
) -> Result<Vec<Picture>, (Box<Raw>, Option<Doubt>)> {
    let raw = match frame::shots_of(raw, mm_per_unit, notes) {
        Ok(parts) => return Ok(parts),
        Err(raw) => *raw,
    };
    let camera = match stated {
        Some(_) => frame::camera_in_base(&raw, extent, notes),
        None => frame::camera_of(&raw, extent, notes),
    };
    if let Some(camera) = camera {
        return Ok(vec![(raw, camera)]);
    }
    // The origin of the base frame may be where a camera was said to stand.
    let suspicion = if stated.is_none() { frame::suspicion(&raw) } else { frame::Suspicion::None };
    match suspicion {
        frame::Suspicion::None => Err((raw.into(), None)),
        frame::Suspicion::Is => {
            notes.push("frame: a camera at the origin that faces along x (its pixels are a grid)".into());
            Ok(vec![(raw, Vector3::zeros())])
        }
        frame::Suspicion::May(why) => {
            let words = format!(
                "are the coordinates in the camera's frame, not in the robot's base frame? {why}: say --frame \
                 camera, or --frame base"
            );
            Err((raw.into(), Some(Doubt { kind: DoubtKind::Frame, words })))
        }
    }
}

/// A cloud as a view whose origin is the camera or, where none is known, the middle of the cloud. File units.
fn view_of(
    raw: Raw,
    camera: Option<Vector3<f64>>,
    middle: Vector3<f64>,
    mm_per_unit: f64,
    name: String,
) -> View {
    let origin = camera.unwrap_or_else(|| whole_mm(middle, mm_per_unit));
    // Where the camera is known it tells the sides better than a file does.
    let given =
        if camera.is_none() && raw.normals.len() == raw.positions.len() { raw.normals } else { Vec::new() };
    // Not a number is not small: it would pass for a direction.
    let unit = |n: Vector3<f32>| {
        n.try_normalize(1e-6).filter(|n| n.iter().all(|c| c.is_finite())).unwrap_or_else(Vector3::zeros)
    };
    let given: Vec<Vector3<f32>> = given.into_iter().map(unit).collect();
    // Some programs write the columns and leave them empty.
    let filled = given.iter().filter(|n| **n != Vector3::zeros()).count();
    let given = if 2 * filled > given.len() { given } else { Vec::new() };
    View {
        name,
        points_mm: raw.positions.relative_mm(origin, mm_per_unit),
        normals: given,
        base_from_camera: translation(origin * mm_per_unit),
        camera_known: camera.is_some(),
        mesh: None,
        picture: None,
    }
}

/// `at` rounded so that it is a whole number of millimetres: the shift itself then costs no accuracy.
fn whole_mm(at: Vector3<f64>, mm_per_unit: f64) -> Vector3<f64> {
    at.map(|c| (c * mm_per_unit).round() / mm_per_unit)
}

fn translation(to_mm: Vector3<f64>) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::from(to_mm), UnitQuaternion::identity())
}

fn name_of(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}

/// Bytes of a `scan.json` or a calibration at most; a thousand views take a fifth of it.
const SETTINGS_BYTES: u64 = 1 << 20;

/// The whole of a file that may be as large as memory allows.
fn read_file(path: &Path, limit: memory::Limit) -> Result<Vec<u8>, Error> {
    read_held(path, |bytes| limit.hold_file(path, bytes))
}

/// The whole of a file of a kind that is never larger than `most` bytes.
fn read_at_most(path: &Path, most: u64) -> Result<Vec<u8>, Error> {
    read_held(path, |bytes| memory::hold_kind(path, bytes, most))
}

/// The whole of a regular file of a size that is taken; a device or a pipe could be endless.
fn read_held(path: &Path, hold: impl FnOnce(u64) -> Result<(), Error>) -> Result<Vec<u8>, Error> {
    let io = |source| Error::Io {
        path: path.into(),
        source,
        help: "Check the path: INPUT is a folder with scan.json, or a PLY, PCD, XYZ/CSV, STL, OBJ, VTK, .npy or depth PNG file.",
    };
    let metadata = std::fs::metadata(path).map_err(io)?;
    if !metadata.is_file() {
        return Err(io(std::io::Error::other("not a regular file")));
    }
    hold(metadata.len())?;
    let bytes = without_mark(std::fs::read(path).map_err(io)?);
    foreign::refuse(&bytes, path)?;
    Ok(bytes)
}

/// Without the mark of UTF-8 that some programs on Windows write before a text (BOM).
fn without_mark(mut bytes: Vec<u8>) -> Vec<u8> {
    const MARK: &[u8] = b"\xEF\xBB\xBF";
    if bytes.starts_with(MARK) {
        bytes.drain(..MARK.len());
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_text(text: &str) -> Result<Scan, Error> {
        read_bytes(text.into(), Path::new("cloud.xyz"), &Options::default())
    }

    #[test]
    fn a_cloud_far_from_the_origin_keeps_its_micrometres() {
        let row =
            |i: usize| format!("{:.4} {:.4} 1000000.5\n", 1e6 + i as f64 * 0.125, -2e6 + i as f64 * 0.001);
        let options = Options { units: Units::Millimetres, ..Options::default() };
        let text: String = (0..400).map(row).collect();
        let scan = read_bytes(text.into(), Path::new("far.xyz"), &options).unwrap();
        let view = &scan.views[0];
        assert!(!view.camera_known);
        for (i, point) in view.points_mm.iter().enumerate() {
            let base = view.base_from_camera * point.cast::<f64>();
            let truth = nalgebra::Point3::new(1e6 + i as f64 * 0.125, -2e6 + i as f64 * 0.001, 1_000_000.5);
            assert!((base - truth).norm() < 1e-5, "{base} {truth}");
        }
    }

    #[test]
    fn zeros_and_missing_readings_are_dropped_and_counted() {
        let scan = read_text("0 0 0\n1 2 3\nnan 0 0\n0 0 0\n4 5 inf\n1e30 0 0\n7 8 9\n").unwrap();
        assert_eq!(scan.views[0].points_mm.len(), 2);
        let note = |text: &str| scan.notes.iter().any(|note| note.starts_with(text));
        assert!(
            note("dropped 3 of 7 points without") && note("dropped 2 of 7 points at exactly"),
            "{:?}",
            scan.notes
        );
        assert_eq!(read_text("0 0 0\n1 2 3\n").unwrap().views[0].points_mm.len(), 2);
    }

    #[test]
    fn one_to_three_points_are_a_scan_and_none_is_not() {
        for text in ["1 2 3\n", "1 2 3\n1 2 3\n", "0 0 0\n1 1 1\n2 2 2\n"] {
            assert_eq!(read_text(text).unwrap().views[0].points_mm.len(), text.lines().count());
        }
        for text in ["", "nan nan nan\n", "0 0 0\n0 0 0\n", "# nothing\n"] {
            assert!(matches!(read_text(text), Err(Error::Empty { .. })), "{text:?}");
        }
    }

    #[test]
    fn an_unknown_file_and_a_missing_one_name_a_way_out() {
        let unknown =
            read_bytes(vec![1, 2, 3], Path::new("part.xyz7"), &Options::default()).unwrap_err().to_string();
        assert!(unknown.contains("part.xyz7") && unknown.contains("PLY"), "{unknown}");
        let missing = read(Path::new("no/such/cloud.ply"), &Options::default()).unwrap_err().to_string();
        assert!(missing.contains("no/such/cloud.ply") && missing.contains("INPUT"), "{missing}");
    }
}
