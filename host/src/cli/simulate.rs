//! `weldpath simulate`: a scan with exact truth, so that nobody needs a robot to try.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use weldpath::files::File;
use weldpath::input;
use weldpath::simulation;
use weldpath::simulation::{
    CellErrors, Error, Format, ListedWeld, MeshRequest, Noise, Part, Pose, Request, Sensor, SensorErrors,
    Tacks,
};

use super::folder::{Folder, FolderArgs};
use super::{Exit, Failure, print, whole};

/// Simulate a multi-view scan of a workpiece, with its exact truth
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// fillet, lap, round-lap, boss, corner, pipe, square-tube, elbow, butt-v, half-v, saddle, branch, tacked, scurve,
    /// cruciform, several, vise, plate or box
    #[arg(long, required_unless_present = "mesh", conflicts_with = "mesh")]
    part: Option<Part>,
    /// Scan this STL, OBJ or PLY mesh instead, as it lies with z up on a table
    #[arg(long, value_name = "FILE")]
    mesh: Option<PathBuf>,
    /// What is to be welded of the mesh (weld_vectors.json, mm) [default: its inside corners]
    #[arg(long, value_name = "FILE", requires = "mesh")]
    welds: Option<PathBuf>,
    /// Distance of the cameras from the middle of the mesh [default: 0.75 of its plan's diagonal, 300 to 700]
    #[arg(long, value_name = "MM", requires = "mesh", allow_negative_numbers = true)]
    distance_mm: Option<f64>,
    /// Folder for scan.json, the views and truth.json
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    folder: FolderArgs,
    /// Number of views [default: as many as the part needs, 8 of a mesh]
    #[arg(long, value_name = "N", value_parser = whole::<usize>, allow_negative_numbers = true)]
    views: Option<usize>,
    /// none, low, mid or high
    #[arg(long, default_value_t = Noise::Mid)]
    noise: Noise,
    /// Sizes, places and noise follow from it
    #[arg(long, default_value_t = 1, value_parser = whole::<u64>, allow_negative_numbers = true)]
    seed: u64,
    /// How the part lies: flat, tilted, horizontal or vertical
    #[arg(long, default_value_t = Pose::Flat, conflicts_with = "mesh")]
    pose: Pose,
    /// How views are stored: png (16-bit depth) or ply
    #[arg(long, default_value_t = Format::Png)]
    format: Format,
    /// Size of a depth image
    #[arg(long, value_name = "WxH", default_value = "640x480")]
    size: Size,
    /// Included angle of a groove, between plate and web, or between the pipes of a saddle
    #[arg(long, value_name = "DEG", conflicts_with = "mesh", allow_negative_numbers = true)]
    angle_deg: Option<f64>,
    /// Length of a straight seam
    #[arg(long, value_name = "MM", conflicts_with = "mesh", allow_negative_numbers = true)]
    length_mm: Option<f64>,
    /// Distance of the members at the root; butt-v, half-v, fillet and lap only
    #[arg(long, value_name = "MM", conflicts_with = "mesh", allow_negative_numbers = true)]
    root_opening_mm: Option<f64>,
    /// Thickness of the members; butt-v, half-v, fillet and lap only
    #[arg(long, value_name = "MM", conflicts_with = "mesh", allow_negative_numbers = true)]
    thickness_mm: Option<f64>,
    /// This many tacks, 10 to 20 mm long, hold the joint already; fillet only
    #[arg(long, value_name = "N", value_parser = whole::<usize>, conflicts_with = "mesh", allow_negative_numbers = true)]
    tacks: Option<usize>,
    /// Leg of a tack
    #[arg(long, value_name = "MM", default_value_t = 4.0, requires = "tacks", allow_negative_numbers = true)]
    tack_mm: f64,
    /// Leave the work out: the table, or the vise, from the same places, for `plan --background`
    #[arg(long, conflicts_with = "mesh")]
    empty: bool,
    /// Scan badly on purpose: views that share too little; branch and tacked only
    #[arg(long, conflicts_with = "mesh")]
    weak: bool,
    #[command(flatten)]
    cell: CellArgs,
    #[command(flatten)]
    sensor: SensorArgs,
    /// Print nothing but errors
    #[arg(long, short)]
    quiet: bool,
}

/// Errors of a cell. With any of them no pose is exact; without, the first is, and the others are off by 1 to 3 mm.
#[derive(Debug, Clone, Copy, clap::Args)]
struct CellArgs {
    /// The camera is this far from where the hand-eye transform puts it
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    hand_eye_mm: Option<f64>,
    /// The camera is turned by this much
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    hand_eye_deg: Option<f64>,
    /// Standard deviation of the positions that the robot reports, each axis
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    robot_mm: Option<f64>,
    /// The same of its orientations
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    robot_deg: Option<f64>,
    /// The camera of the first view is exactly where its pose says, all the same
    #[arg(long)]
    first_exact: bool,
    /// Scans with the same number are of one cell: hand-eye transform and optical axis err alike [default: each its own]
    #[arg(long, value_name = "N", value_parser = whole::<u64>, allow_negative_numbers = true)]
    cell_seed: Option<u64>,
}

/// Errors of the camera beside noise; each option changes one of the sensor's own.
#[derive(Debug, Clone, Copy, clap::Args)]
#[command(next_help_heading = "Camera errors")]
struct SensorArgs {
    /// ideal, structured-light, stereo, tof or rough
    #[arg(long, default_value_t = Sensor::Ideal)]
    sensor: Sensor,
    /// A stereo matcher averages over this many pixels each way: rounds corners
    #[arg(long, value_name = "PX", value_parser = whole::<u32>, allow_negative_numbers = true)]
    window_px: Option<u32>,
    /// Near surfaces cover this many pixels of what is behind their edges
    #[arg(long, value_name = "PX", value_parser = whole::<u32>, allow_negative_numbers = true)]
    fattening_px: Option<u32>,
    /// Share of silhouette pixels that fly between near and far
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true)]
    flying: Option<f64>,
    /// Noise is correlated over about this many pixels
    #[arg(long, value_name = "PX", allow_negative_numbers = true)]
    correlated_px: Option<f64>,
    /// Step of the disparities
    #[arg(long, value_name = "PX", allow_negative_numbers = true)]
    disparity_step_px: Option<f64>,
    /// Step of the depths
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    depth_step_mm: Option<f64>,
    /// Light between faces brings the root of a corner nearer by this, falling off over 5 mm; negative: farther
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    interreflection_mm: Option<f64>,
    /// Faces seen within this angle of their normal shine and give no reading
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    specular_deg: Option<f64>,
    /// Angle from a face's normal at which half of the readings are lost
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    grazing_deg: Option<f64>,
    /// Amplitude of bands across the image
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    stripes_mm: Option<f64>,
    /// Standard deviation of smooth waves in the depth, other ones in each view
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    waves_mm: Option<f64>,
    /// About how far one wave is from the next, at 350 mm
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    wavelength_mm: Option<f64>,
    /// Depths are too large by this
    #[arg(long, value_name = "PERCENT", allow_negative_numbers = true)]
    depth_scale_percent: Option<f64>,
    /// The focal length is larger than scan.json says by this
    #[arg(long, value_name = "PERCENT", allow_negative_numbers = true)]
    focal_percent: Option<f64>,
    /// The optical axis is this far from where scan.json says, pixels at a width of 640
    #[arg(long, value_name = "PX", allow_negative_numbers = true)]
    centre_px: Option<f64>,
    /// Radial distortion that scan.json does not say
    #[arg(long, value_name = "K1", allow_negative_numbers = true)]
    k1: Option<f64>,
    /// So many pixels of a view read 5 to 60 m, as many are saturated, as many read nothing
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = whole::<u32>, allow_negative_numbers = true)]
    stray: u32,
}

impl SensorArgs {
    fn errors(self) -> SensorErrors {
        let own = self.sensor.errors();
        SensorErrors {
            window_px: self.window_px.unwrap_or(own.window_px),
            fattening_px: self.fattening_px.unwrap_or(own.fattening_px),
            flying: self.flying.or(own.flying),
            correlated_px: self.correlated_px.or(own.correlated_px),
            disparity_step_px: self.disparity_step_px.or(own.disparity_step_px),
            depth_step_mm: self.depth_step_mm.unwrap_or(own.depth_step_mm),
            interreflection_mm: self.interreflection_mm.unwrap_or(own.interreflection_mm),
            specular_deg: self.specular_deg.unwrap_or(own.specular_deg),
            grazing_deg: self.grazing_deg.or(own.grazing_deg),
            stripes_mm: self.stripes_mm.unwrap_or(own.stripes_mm),
            waves_mm: self.waves_mm.unwrap_or(own.waves_mm),
            wavelength_mm: self.wavelength_mm.unwrap_or(own.wavelength_mm),
            depth_scale_percent: self.depth_scale_percent.unwrap_or(own.depth_scale_percent),
            focal_percent: self.focal_percent.unwrap_or(own.focal_percent),
            centre_px: self.centre_px.unwrap_or(own.centre_px),
            k1: self.k1.unwrap_or(own.k1),
            stray_px: self.stray,
        }
    }
}

impl CellArgs {
    fn errors(self) -> Option<CellErrors> {
        let given = [self.hand_eye_mm, self.hand_eye_deg, self.robot_mm, self.robot_deg];
        let [hand_eye_mm, hand_eye_deg, robot_mm, robot_deg] = given.map(Option::unwrap_or_default);
        let any = given.iter().any(Option::is_some) || self.cell_seed.is_some();
        let first_exact = self.first_exact;
        any.then_some(CellErrors {
            hand_eye_mm,
            hand_eye_deg,
            robot_mm,
            robot_deg,
            first_exact,
            seed: self.cell_seed,
        })
    }
}

/// Columns and rows of an image.
#[derive(Debug, Clone, Copy)]
struct Size {
    width: u32,
    height: u32,
}

impl FromStr for Size {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("{text:?} is not a size; write it as 640x480");
        let (width, height) = text.split_once('x').ok_or_else(wrong)?;
        let number = |text: &str| text.parse().map_err(|_| wrong());
        Ok(Self { width: number(width)?, height: number(height)? })
    }
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    keep_real_scans(&args.out)?;
    let scan = match (args.part, &args.mesh) {
        (Some(part), _) => simulation::simulate(&request(args, part)).map_err(failure)?,
        (None, Some(mesh)) => simulation::simulate_mesh(&of_mesh(args, mesh)?).map_err(failure)?,
        (None, None) => return Err(Failure::new(Exit::Usage, "neither --part nor --mesh is given")),
    };
    let mut files = simulation::files(&scan).map_err(failure)?;
    files.push(job(args.cell.errors()));
    Folder::new(&args.out, args.folder, args.quiet).write(&files)?;
    let (out, views, seams) = (args.out.display(), scan.views.len(), scan.truth.seams.len());
    let text = format!(
        "{out}: {views} views, {seams} seams in truth.json, what is known of the cell in {JOB}\n\
         next: weldpath plan --job {} --out {}\n",
        args.out.join(JOB).display(),
        args.out.join("out").display()
    );
    if args.quiet { Ok(()) } else { print(&text) }
}

/// Least error of a cell that its job states, mm and degrees.
const LEAST_STATED: f64 = 0.01;

/// The job that belongs to a simulated scan.
pub(super) const JOB: &str = "cell.toml";

/// What nobody can see in a scan: how exact its poses are, and a torch on the flange.
pub(super) fn job(cell: Option<CellErrors>) -> File {
    let known = match cell {
        None => "anchor = \"first\"                    # the first view's pose is exact, the others are 1 to 3 mm off\n".to_owned(),
        Some(CellErrors { hand_eye_mm, hand_eye_deg, robot_mm, robot_deg, first_exact, .. }) => {
            let anchor = if first_exact { "anchor = \"first\"                    # the first view's pose is exact\n" } else { "" };
            // What is exact is stated as well as it can be.
            let [robot_mm, robot_deg, hand_eye_mm, hand_eye_deg] =
                [robot_mm, robot_deg, hand_eye_mm, hand_eye_deg].map(|value| value.max(LEAST_STATED));
            format!(
                "{anchor}robot_mm = {robot_mm}                      # one standard deviation of each axis\n\
                 robot_deg = {robot_deg}\nhand_eye_mm = {hand_eye_mm}\nhand_eye_deg = {hand_eye_deg}\n"
            )
        }
    };
    let text = format!(
        "# What a scan does not show of the cell in which it was made: here, of a simulated one.\ninput = \".\"\n\n\
         [scan]\n{known}\n\
         [tool]                              # a torch on the flange; mm, radians, kg\n\
         flange_from_tcp_mm = [0, 0, 300]\nflange_from_tcp_rotation_rad = [0, 0, 0]\npayload_kg = 2.5\npayload_centre_mm = [0, 0, 80]\n"
    );
    File::new(JOB, text)
}

fn request(args: &Args, part: Part) -> Request {
    Request {
        part,
        pose: args.pose,
        views: args.views,
        noise: args.noise,
        seed: args.seed,
        width: args.size.width,
        height: args.size.height,
        weak: args.weak,
        empty: args.empty,
        format: args.format,
        angle_deg: args.angle_deg,
        length_mm: args.length_mm,
        thickness_mm: args.thickness_mm,
        root_opening_mm: args.root_opening_mm,
        tacks: args.tacks.map(|count| Tacks { count, leg_mm: args.tack_mm }),
        cell: args.cell.errors(),
        sensor: args.sensor.errors(),
    }
}

/// Views of a mesh, if not told otherwise.
const MESH_VIEWS: usize = 8;

fn of_mesh(args: &Args, mesh: &Path) -> Result<MeshRequest, Failure> {
    let unread = |error: &dyn std::fmt::Display| Failure::new(Exit::Input, error);
    let triangles = input::triangles(mesh, &input::Options::default()).map_err(|e| unread(&e))?;
    let list = |path: &PathBuf| {
        let named = |e: &dyn std::fmt::Display| unread(&format!("{}: {e}", path.display()));
        let bytes = std::fs::read(path).map_err(|e| named(&e))?;
        ListedWeld::list(&bytes).map_err(|e| {
            named(&e).hint("a list of welds is {\"welds\": [{\"start\": {\"xyz\", \"pose\"}, \"end\": ...}]}")
        })
    };
    Ok(MeshRequest {
        name: mesh.file_stem().map_or_else(|| "mesh".into(), |stem| stem.to_string_lossy().into_owned()),
        triangles,
        welds: args.welds.as_ref().map(list).transpose()?,
        views: args.views.unwrap_or(MESH_VIEWS),
        noise: args.noise,
        seed: args.seed,
        size_px: [args.size.width, args.size.height],
        distance_mm: args.distance_mm,
        format: args.format,
        cell: args.cell.errors(),
        sensor: args.sensor.errors(),
    })
}

/// A scan without truth beside it was not simulated, and cannot be had again.
pub(super) fn keep_real_scans(out: &Path) -> Result<(), Failure> {
    if out.join("scan.json").exists() && !out.join("truth.json").exists() {
        let message = format!("{} holds a scan that was not simulated; it is left as it is", out.display());
        return Err(Failure::new(Exit::Output, message).hint("choose another folder with --out"));
    }
    Ok(())
}

fn failure(error: Error) -> Failure {
    let exit = if matches!(error, Error::Encode { .. }) { Exit::Output } else { Exit::Usage };
    Failure::new(exit, error)
}
