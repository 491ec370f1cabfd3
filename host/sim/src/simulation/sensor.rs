//! What real depth cameras do wrong beside noise: each error by itself, and presets of kinds of sensor.
//!
//! Sources of the presets:
//! * stereo: Keselman, Woodfill, Grunnet-Jepsen, Bhowmik, "Intel RealSense Stereoscopic Depth Cameras", CVPR workshops 2017
//!   (matching over 7 x 7 pixels, foreground fattened by the window, errors correlated over it), and the D400 series' data sheet
//!   (depth in steps of 1 mm, disparities in 1/32 pixel, 2 % of the depth at most).
//! * structured light: Khoshelham and Elberink, "Accuracy and Resolution of Kinect Depth Data", Sensors 2012 (intrinsics after
//!   calibration, bands across the image); Gupta et al., "Structured Light 3D Scanning in the Presence of Global
//!   Illumination", CVPR 2011 (grooves filled by interreflection).
//! * time of flight: Azure Kinect DK hardware specification (systematic error 11 mm + 0.1 % of the distance, mostly an offset
//!   that a user calibrates away; no multipath); Freedman et al., "SRA", ECCV 2014 (corners seen too deep by multipath).
//! * rough: ours, of what users' scans show together (`--sensor rough` is the hardest case that a plan should survive): a matcher
//!   finds little texture on metal, so that surfaces wave by 1 mm over 10 to 50 mm, otherwise in each view.

use super::camera::{Camera, Seen};
use super::named::named;
use super::random::Stream;
use super::rotation::sin_cos_deg;
use super::scene::Scene;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use std::collections::BTreeMap;

named! {
    "sensor":
    /// A kind of depth camera.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub enum Sensor {
        /// Noise and nothing else.
        Ideal = "ideal",
        /// A projector of stripes and a camera.
        StructuredLight = "structured-light",
        /// Two cameras and a matcher of windows.
        Stereo = "stereo",
        /// Time of flight of modulated light.
        Tof = "tof",
        /// A cheap matcher of windows with all that goes wrong close to a bare metal part, together.
        Rough = "rough",
    }
}

/// What a depth camera does wrong beside noise, alike in every image unless said. Nothing, unless said.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorErrors {
    /// Disparities are means over so many pixels each way on one surface: rounds corners.
    pub window_px: u32,
    /// Near surfaces cover so many pixels of what is behind their edges.
    pub fattening_px: u32,
    /// Share of silhouette pixels that fly between near and far; 0.42 if not given.
    pub flying: Option<f64>,
    /// Standard deviation of the window that noise is correlated over, pixels; as the noise has it if not given.
    pub correlated_px: Option<f64>,
    /// Disparities come in steps of this, pixels; as the noise has it if not given.
    pub disparity_step_px: Option<f64>,
    /// Depths come in steps of this, mm.
    pub depth_step_mm: f64,
    /// Light from one face of a right-angled corner on the other brings the root nearer by this, mm (farther if negative); it
    /// falls off by e every [`REACH_MM`].
    pub interreflection_mm: f64,
    /// Faces seen within this angle of their normal shine and give no reading, degrees.
    pub specular_deg: f64,
    /// Angle from the normal at which half of the readings are lost, degrees; 77.6 if not given.
    pub grazing_deg: Option<f64>,
    /// Amplitude of bands across the image, mm.
    pub stripes_mm: f64,
    /// Standard deviation of waves in the depth, smooth across the image and other ones in each, mm.
    pub waves_mm: f64,
    /// About how far one wave is from the next, mm at 350 mm.
    pub wavelength_mm: f64,
    /// Depths are too large by this, percent.
    pub depth_scale_percent: f64,
    /// The focal length is larger than stated by this, percent.
    pub focal_percent: f64,
    /// The optical axis is this far from where it is stated, pixels at a width of 640; its direction follows from the seed.
    pub centre_px: f64,
    /// First radial distortion (Brown-Conrady) that nobody stated.
    pub k1: f64,
    /// So many pixels of each view read from 5 to 60 m, as many are saturated (65535), and as many read nothing.
    pub stray_px: u32,
}

impl Default for SensorErrors {
    fn default() -> Self {
        Self {
            window_px: 0,
            fattening_px: 0,
            flying: None,
            correlated_px: None,
            disparity_step_px: None,
            depth_step_mm: 0.0,
            interreflection_mm: 0.0,
            specular_deg: 0.0,
            grazing_deg: None,
            stripes_mm: 0.0,
            waves_mm: 0.0,
            wavelength_mm: 25.0,
            depth_scale_percent: 0.0,
            focal_percent: 0.0,
            centre_px: 0.0,
            k1: 0.0,
            stray_px: 0,
        }
    }
}

/// Distance from a corner's root at which interreflection has fallen to 1/e, mm.
pub const REACH_MM: f64 = 5.0;
/// Farther than this from another face there is no interreflection worth a ray, mm.
const DARK_MM: f64 = 6.0 * REACH_MM;
/// Where stray pixels read something, mm.
const STRAY_MM: [f64; 2] = [5e3, 60e3];
/// Directions in which a face looks for others, this far above itself.
const DIRECTIONS: u32 = 8;
const LIFTED_DEG: f64 = 10.0;
/// A window averages what is nearer in depth to its middle than this, at [`REFERENCE_MM`]: one surface and its neighbour.
const SURFACE_MM: f64 = 10.0;
const REFERENCE_MM: f64 = 350.0;
/// Standard deviation of a field of unit numbers on a lattice, interpolated by smoothstep both ways: the mean over a cell of the sum
/// of the squared weights is 26/35 each way.
const INTERPOLATED: f64 = 26.0 / 35.0;
/// Bands across an image of any width.
const BANDS: f64 = 24.0;

impl Sensor {
    /// What it does wrong.
    pub fn errors(self) -> SensorErrors {
        let none = SensorErrors::default();
        match self {
            Self::Ideal => none,
            Self::StructuredLight => SensorErrors {
                window_px: 1,
                interreflection_mm: 0.5,
                specular_deg: 3.0,
                stripes_mm: 0.05,
                depth_scale_percent: 0.1,
                focal_percent: 0.1,
                centre_px: 0.5,
                k1: 0.002,
                ..none
            },
            Self::Stereo => SensorErrors {
                window_px: 3,
                fattening_px: 2,
                correlated_px: Some(3.0),
                disparity_step_px: Some(1.0 / 32.0),
                depth_step_mm: 1.0,
                depth_scale_percent: 0.3,
                focal_percent: 0.2,
                centre_px: 1.0,
                k1: 0.005,
                ..none
            },
            Self::Tof => SensorErrors {
                window_px: 1,
                flying: Some(0.9),
                depth_step_mm: 1.0,
                interreflection_mm: -2.0,
                grazing_deg: Some(70.0),
                depth_scale_percent: 0.1,
                focal_percent: 0.2,
                centre_px: 1.0,
                k1: 0.005,
                ..none
            },
            Self::Rough => SensorErrors {
                flying: Some(0.9),
                grazing_deg: Some(70.0),
                waves_mm: 1.0,
                ..Self::Stereo.errors()
            },
        }
    }
}

impl SensorErrors {
    /// The camera that takes the images, where `stated` is the one that is written.
    pub(super) fn true_camera(&self, stated: &Camera, seed: u64) -> Camera {
        let aside = Stream::new(seed, "optical axis", 0).direction();
        let length = f64::max(aside.xy().norm(), 1e-9);
        let off_px = self.centre_px * f64::from(stated.width) / 640.0 / length;
        Camera {
            focal_px: stated.focal_px * (1.0 + 0.01 * self.focal_percent),
            centre_px: [stated.centre_px[0] + off_px * aside.x, stated.centre_px[1] + off_px * aside.y],
            // A depth that is written too large has smaller counts' worth.
            depth_scale_mm: stated.depth_scale_mm / (1.0 + 0.01 * self.depth_scale_percent),
            k1: self.k1,
            ..*stated
        }
    }

    /// Lays over what was seen what a matcher of windows makes of it.
    pub(super) fn matched(&self, mut seen: Vec<Option<Seen>>, width: usize) -> Vec<Option<Seen>> {
        if self.fattening_px > 0 {
            seen = per_pixel(&seen, |i| fattened(&seen, width, i, self.fattening_px as usize));
        }
        if self.window_px > 0 {
            seen = per_pixel(&seen, |i| averaged(&seen, width, i, self.window_px as usize));
        }
        seen
    }

    /// Depths that some pixels report for no surface at all, mm by pixel: far off, saturated (no number), or none (0).
    pub(super) fn strays(&self, pixels: usize, random: &mut Stream) -> BTreeMap<usize, f64> {
        let kinds = [Some(STRAY_MM), None, Some([0.0; 2])];
        let all = kinds.into_iter().flat_map(|kind| (0..self.stray_px).map(move |_| kind));
        all.map(|kind| {
            let pixel = (random.unit() * pixels as f64) as usize;
            (pixel, kind.map_or(f64::INFINITY, |[low, high]| random.between(low, high)))
        })
        .collect()
    }

    /// How much too far each pixel of an image reads for its waves, mm at the reference distance; empty without waves. `focal_px`
    /// turns lengths at that distance into pixels.
    pub(super) fn waves(&self, [width, height]: [usize; 2], focal_px: f64, lattice: &Stream) -> Vec<f64> {
        if self.waves_mm == 0.0 {
            return Vec::new();
        }
        // Half a wave from knot to knot.
        let knots_px = f64::max(0.5 * self.wavelength_mm * focal_px / REFERENCE_MM, 1.0);
        let columns = (width as f64 / knots_px) as u64 + 2;
        let knot = |column: u64, row: u64| lattice.at(row * columns + column).gaussian();
        let pixel = |i: usize| {
            let [x, y] = [i % width, i / width].map(|at| at as f64 / knots_px);
            let (column, row) = (x as u64, y as u64);
            let step = |t: f64| t * t * (3.0 - 2.0 * t);
            let (right, down) = (step(x.fract()), step(y.fract()));
            let along = |row: u64| knot(column, row) * (1.0 - right) + knot(column + 1, row) * right;
            self.waves_mm / INTERPOLATED * (along(row) * (1.0 - down) + along(row + 1) * down)
        };
        (0..width * height).into_par_iter().map(pixel).collect()
    }

    /// A reading with bands and steps, mm.
    pub(super) fn banded(&self, depth_mm: f64, column: usize, width: usize) -> f64 {
        // A triangle wave in place of a sine, for the same bytes on every machine.
        let phase = (column as f64 * BANDS / width as f64).fract();
        let wave = 4.0 * (phase - 0.5).abs() - 1.0;
        let stepped = depth_mm + self.stripes_mm * wave;
        let step = self.depth_step_mm;
        if step > 0.0 { (stepped / step).round() * step } else { stepped }
    }
}

fn per_pixel(seen: &[Option<Seen>], of: impl Fn(usize) -> Option<Seen> + Sync + Send) -> Vec<Option<Seen>> {
    (0..seen.len()).into_par_iter().map(of).collect()
}

/// Pixels within `half` columns and rows of pixel `i`.
fn around(len: usize, width: usize, i: usize, half: usize) -> impl Iterator<Item = usize> {
    let (column, row) = (i % width, i / width);
    let rows = row.saturating_sub(half)..(row + half + 1).min(len / width);
    rows.flat_map(move |r| {
        (column.saturating_sub(half)..(column + half + 1).min(width)).map(move |c| r * width + c)
    })
}

/// The nearest surface around, where it is another than the pixel's own.
fn fattened(seen: &[Option<Seen>], width: usize, i: usize, half: usize) -> Option<Seen> {
    let own = seen[i]?;
    let near = around(seen.len(), width, i, half).filter_map(|k| seen[k]);
    let nearest = near.min_by(|a, b| a.depth_mm.total_cmp(&b.depth_mm)).unwrap_or(own);
    let jump_mm = SURFACE_MM * own.depth_mm / REFERENCE_MM;
    Some(if own.depth_mm - nearest.depth_mm > jump_mm { nearest } else { own })
}

/// The mean disparity of the window about a pixel.
fn averaged(seen: &[Option<Seen>], width: usize, i: usize, half: usize) -> Option<Seen> {
    let own = seen[i]?;
    let jump_mm = SURFACE_MM * own.depth_mm / REFERENCE_MM;
    let (mut sum, mut count) = (0.0, 0.0);
    for near in around(seen.len(), width, i, half).filter_map(|k| seen[k]) {
        if (near.depth_mm - own.depth_mm).abs() < jump_mm {
            sum += 1.0 / near.depth_mm;
            count += 1.0;
        }
    }
    Some(Seen { depth_mm: count / sum, ..own })
}

/// How much light a place on a face gets from other faces, 1 at the root of a right-angled corner.
pub(super) fn lit_by_others(scene: &Scene, place: Point3<f64>, normal: &Vector3<f64>) -> f64 {
    let aside = if normal.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
    let first = (aside - normal * aside.dot(normal)).normalize();
    let second = normal.cross(&first);
    let (lift, along) = sin_cos_deg(LIFTED_DEG);
    let start = place + normal * 0.01;
    let of = |k: u32| {
        let (sin, cos) = sin_cos_deg(360.0 * f64::from(k) / f64::from(DIRECTIONS));
        let hit = scene.cast(start, (first * cos + second * sin) * along + normal * lift)?;
        // An opposite face lights more than one that leans away.
        let facing = (1.0 - hit.normal.dot(normal)).clamp(0.0, 1.5);
        (hit.distance < DARK_MM).then(|| facing * decayed(hit.distance * along / REACH_MM))
    };
    (0..DIRECTIONS).filter_map(of).fold(0.0, f64::max)
}

/// exp(-x) by multiplication alone, for the same bytes on every machine.
fn decayed(x: f64) -> f64 {
    (0..8).fold(1.0 - x / 256.0, |power, _| power * power)
}
