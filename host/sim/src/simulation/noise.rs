//! Errors of the simulated depth camera, after those measured on the scans the project was given.
//!
//! In this order: lateral jitter of each line of sight (in [`super::camera`]), a Gaussian error of the depth that
//! grows with its square and at a slant (part white, part correlated over about a pixel), flying pixels at
//! silhouettes, disparity steps, dropouts (single, grazing, small holes), outliers, range.

use super::camera::{Camera, DepthImage, RANGE_MM, Seen};
use super::named::named;
use super::random::Stream;
use super::rotation::sin_cos_deg;
use super::sensor::SensorErrors;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

named! {
    "noise":
    /// How noisy the camera is.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
    #[serde(rename_all = "kebab-case")]
    pub enum Noise {
        /// Exact depth, rounded to counts; exact poses. For tests.
        None = "none",
        /// 0.20 mm at 350 mm.
        Low = "low",
        /// 0.35 mm at 350 mm.
        Mid = "mid",
        /// 0.50 mm at 350 mm.
        High = "high",
    }
}

/// What a camera adds to what there is to see.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Imaging {
    /// What differs from image to image.
    pub noise: Noise,
    /// What does not.
    pub errors: SensorErrors,
}

impl From<Noise> for Imaging {
    fn from(noise: Noise) -> Self {
        Self { noise, errors: SensorErrors::default() }
    }
}

/// The numbers behind a [`Noise`].
#[derive(Debug, Clone, Copy)]
pub(super) struct Model {
    /// Standard deviation along the line of sight at 350 mm.
    sigma_mm: f64,
    /// Standard deviation of the line of sight itself, each way.
    pub(super) jitter_rad: f64,
    /// Standard deviation of the Gaussian window that correlates the error, pixels.
    blur_px: f64,
    /// One disparity step, pixels at a focal length of 600.
    disparity_px: f64,
    /// Share of silhouette pixels that fly between the near and the far surface.
    flying: f64,
    /// Cosine of incidence at which half of the pixels are lost.
    grazing: f64,
    /// Cosine of incidence beyond which a face shines and all are lost.
    shining: f64,
}

/// Distance at which [`Model::sigma_mm`] holds, mm.
const REFERENCE_MM: f64 = 350.0;
/// Share of the error's variance that neighbouring pixels have in common.
const CORRELATED: f64 = 0.66;
/// Distance between the two eyes of the sensor, mm: sets the disparity step.
const BASELINE_MM: f64 = 50.0;
/// A step in depth of more than this between neighbours is a silhouette, mm.
const SILHOUETTE_MM: f64 = 5.0;
/// Share of silhouette pixels that fly between the near and the far surface.
const FLYING: f64 = 0.42;
/// Share of pixels lost singly.
const LOST: f64 = 0.0026;
/// Cosine of incidence at which half of the pixels are lost.
const GRAZING: f64 = 0.214;
/// Share of pixels with a reading from nowhere, between half and 1.3 times the true depth.
const OUTLIERS: f64 = 0.0012;

impl Noise {
    pub(super) fn model(self) -> Model {
        let model = |sigma_mm, jitter_px: f64, blur_px, steps_per_px: f64| Model {
            sigma_mm,
            jitter_rad: jitter_px / 600.0,
            blur_px,
            disparity_px: 1.0 / steps_per_px,
            flying: FLYING,
            grazing: GRAZING,
            shining: f64::INFINITY,
        };
        match self {
            Self::None => model(0.0, 0.0, 1.0, f64::INFINITY),
            Self::Low => model(0.20, 0.12, 0.6, 64.0),
            Self::Mid => model(0.35, 0.20, 0.8, 32.0),
            Self::High => model(0.50, 0.30, 1.0, 32.0),
        }
    }
}

impl Model {
    /// The same with what a sensor has of its own.
    fn with(self, errors: &SensorErrors) -> Self {
        let cosine = |deg: f64| sin_cos_deg(deg).1;
        Self {
            blur_px: errors.correlated_px.unwrap_or(self.blur_px),
            disparity_px: errors.disparity_step_px.unwrap_or(self.disparity_px),
            flying: errors.flying.unwrap_or(self.flying),
            grazing: errors.grazing_deg.map_or(self.grazing, cosine),
            shining: if errors.specular_deg > 0.0 { cosine(errors.specular_deg) } else { self.shining },
            ..self
        }
    }
}

/// The depth image of what was seen.
pub(super) fn image(
    camera: &Camera,
    seen: &[Option<Seen>],
    imaging: &Imaging,
    seed: u64,
    view: u64,
) -> DepthImage {
    let width = camera.width as usize;
    let errors = &imaging.errors;
    let mut depth: Vec<f64> = match imaging.noise {
        Noise::None => seen.iter().map(|s| s.map_or(0.0, |s| s.depth_mm)).collect(),
        noise => Degradation { camera, model: noise.model().with(errors), seed, view }.degrade(seen, width),
    };
    let size = [width, depth.len() / width.max(1)];
    let waves = errors.waves(size, camera.focal_px, &Stream::new(seed, "waves", view));
    for (depth_mm, wave_mm) in depth.iter_mut().zip(waves) {
        // With the square of the depth, as a disparity errs; what was lost stays 0.
        *depth_mm += wave_mm * squared(*depth_mm / REFERENCE_MM, 1);
    }
    let count = |(i, z)| to_counts(errors.banded(z, i % width, width), camera.depth_scale_mm);
    let mut counts: Vec<u16> = depth.into_iter().enumerate().map(count).collect();
    let full_mm = f64::from(u16::MAX) * camera.depth_scale_mm;
    let mut beyond_mm = errors.strays(counts.len(), &mut Stream::new(seed, "stray", view));
    for (i, depth_mm) in &beyond_mm {
        counts[*i] = (depth_mm.min(full_mm) / camera.depth_scale_mm).round() as u16;
    }
    beyond_mm.retain(|_, depth_mm| *depth_mm > full_mm && depth_mm.is_finite());
    DepthImage { width: camera.width, height: camera.height, counts, beyond_mm }
}

fn to_counts(depth_mm: f64, scale_mm: f64) -> u16 {
    let in_range = (RANGE_MM[0]..=RANGE_MM[1]).contains(&depth_mm);
    if in_range { (depth_mm / scale_mm).round() as u16 } else { 0 }
}

struct Degradation<'a> {
    camera: &'a Camera,
    model: Model,
    seed: u64,
    view: u64,
}

impl Degradation<'_> {
    fn stream(&self, purpose: &str) -> Stream {
        Stream::new(self.seed, purpose, self.view)
    }

    fn degrade(&self, seen: &[Option<Seen>], width: usize) -> Vec<f64> {
        let clean: Vec<f64> = seen.iter().map(|s| s.map_or(0.0, |s| s.depth_mm)).collect();
        let error = self.unit_errors(width, clean.len() / width);
        let (fly, loss) = (self.stream("flying"), self.stream("loss"));
        let pixel = |i: usize| {
            let Some(surface) = seen[i] else { return 0.0 };
            let depth_mm = flown(&clean, width, i, self.model.flying, &mut fly.at(i as u64));
            // With the square of the depth, and more at a slant: the scans given to the
            // project show 1/sqrt(cos), 0.38 at 20 degrees to 0.62 at 72.
            let slant = 1.0 / surface.incidence.max(0.05).sqrt();
            let sigma_mm = self.model.sigma_mm * squared(depth_mm / REFERENCE_MM, 1) * slant;
            let noisy_mm = depth_mm + error[i] * sigma_mm;
            self.lost(self.quantised(noisy_mm), surface, &mut loss.at(i as u64))
        };
        let mut depth: Vec<f64> = (0..clean.len()).into_par_iter().map(pixel).collect();
        self.punch_holes(&mut depth, width);
        depth
    }

    /// Unit-variance errors: white plus a field blurred by a Gaussian window, scaled back to its share.
    fn unit_errors(&self, width: usize, height: usize) -> Vec<f64> {
        let field = |purpose: &str| -> Vec<f64> {
            let stream = self.stream(purpose);
            (0..width * height).into_par_iter().map(|i| stream.at(i as u64).gaussian()).collect()
        };
        let kernel = self.kernel();
        let smooth = blurred(&blurred(&field("correlated"), width, 1, &kernel), width, width, &kernel);
        let (a, b) = (CORRELATED.sqrt(), (1.0 - CORRELATED).sqrt());
        smooth.iter().zip(field("white")).map(|(s, w)| a * s + b * w).collect()
    }

    /// Window weights whose squares sum to 1, so that blurred unit noise stays unit noise. The bell curve is the
    /// limit of (1 - x/n)^n, raised by multiplication alone, for the same bytes everywhere.
    fn kernel(&self) -> Vec<f64> {
        let bell =
            |k: i32| squared(1.0 - f64::from(k * k) / (2.0 * squared(self.model.blur_px, 1) * 64.0), 6);
        let half = (3.0 * self.model.blur_px).ceil().max(3.0) as i32;
        let weights: Vec<f64> = (-half..=half).map(bell).collect();
        let norm = weights.iter().map(|w| w * w).sum::<f64>().sqrt();
        weights.iter().map(|w| w / norm).collect()
    }

    /// Depth of the nearest whole disparity step.
    fn quantised(&self, depth_mm: f64) -> f64 {
        let steps = self.camera.focal_px * BASELINE_MM / self.model.disparity_px;
        steps / (steps / depth_mm).round().max(1.0)
    }

    fn lost(&self, depth_mm: f64, surface: Seen, random: &mut Stream) -> f64 {
        let grazing = squared(self.model.grazing / surface.incidence.max(1e-3), 3);
        let shines = surface.incidence > self.model.shining;
        if random.unit() < LOST + grazing / (1.0 + grazing) || shines {
            return 0.0;
        }
        if random.unit() < OUTLIERS { depth_mm * random.between(0.5, 1.3) } else { depth_mm }
    }

    /// Up to eight round holes of 20 to 120 pixels at a width of 640.
    fn punch_holes(&self, depth: &mut [f64], width: usize) {
        let mut random = self.stream("holes");
        let scale = width as f64 / 640.0;
        let height = depth.len() / width;
        let count = (random.unit() * 9.0) as usize;
        for _ in 0..count {
            let (u, v) = (random.unit() * width as f64, random.unit() * height as f64);
            let radius = scale * random.between(2.5, 6.2);
            for row in (v - radius).max(0.0) as usize..((v + radius) as usize + 1).min(height) {
                for column in (u - radius).max(0.0) as usize..((u + radius) as usize + 1).min(width) {
                    let (du, dv) = (column as f64 - u, row as f64 - v);
                    if du * du + dv * dv < radius * radius {
                        depth[row * width + column] = 0.0;
                    }
                }
            }
        }
    }
}

/// `x` squared `times` times over. (`powi` may round differently on another machine.)
fn squared(x: f64, times: u32) -> f64 {
    (0..times).fold(x, |power, _| power * power)
}

/// Depth at pixel `i`; at a silhouette perhaps somewhere between the near and the far surface.
fn flown(depth: &[f64], width: usize, i: usize, flying: f64, random: &mut Stream) -> f64 {
    let here = depth[i];
    let (column, row) = (i % width, i / width);
    let (mut near, mut far) = (here, here);
    for r in row.saturating_sub(1)..(row + 2).min(depth.len() / width) {
        for c in column.saturating_sub(1)..(column + 2).min(width) {
            let z = depth[r * width + c];
            if z > 0.0 {
                near = near.min(z);
                far = far.max(z);
            }
        }
    }
    // A surface seen at grazing incidence has steps, too, but even ones: it has no near and far side.
    let mid_is_empty =
        far - near > SILHOUETTE_MM * (here / REFERENCE_MM) && is_uneven(depth, width, i, near, far);
    if mid_is_empty && random.unit() < flying { random.between(near, far) } else { here }
}

/// Whether the middle third of the depths around pixel `i` is empty: a jump, not a slope.
fn is_uneven(depth: &[f64], width: usize, i: usize, near: f64, far: f64) -> bool {
    let (column, row) = (i % width, i / width);
    let third = (far - near) / 3.0;
    let rows = row.saturating_sub(1)..(row + 2).min(depth.len() / width);
    let mut around = rows
        .flat_map(|r| (column.saturating_sub(1)..(column + 2).min(width)).map(move |c| depth[r * width + c]));
    !around.any(|z| z > near + third && z < far - third)
}

/// Convolution along one direction (`step` 1: rows, `step` width: columns); the image's border repeats.
fn blurred(field: &[f64], width: usize, step: usize, kernel: &[f64]) -> Vec<f64> {
    let height = field.len() / width;
    let half = (kernel.len() / 2) as isize;
    let pixel = |i: usize| {
        let (place, end) = if step == 1 { (i % width, width) } else { (i / width, height) };
        let start = i - place * step;
        let at = |k: isize| (place as isize + k).rem_euclid(end as isize) as usize;
        (-half..=half).zip(kernel).map(|(k, w)| w * field[start + at(k) * step]).sum()
    };
    (0..field.len()).into_par_iter().map(pixel).collect()
}
