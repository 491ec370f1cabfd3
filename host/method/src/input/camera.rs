//! What a camera makes of a ray: pinhole intrinsics and the distortion of its lens.

use std::str::FromStr;
use std::sync::OnceLock;

use crate::geometry::cloud::Picture;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Radial and tangential distortion of a lens (D. C. Brown, "Close-range camera calibration", 1971), of the ray's slopes
/// x and y, in the order and signs of OpenCV and of RealSense's `brown_conrady`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize)]
#[serde(default)]
pub struct Distortion {
    /// Radial, of the second power of the slope.
    pub k1: f64,
    /// Radial, of the fourth power.
    pub k2: f64,
    /// Tangential, along the columns.
    pub p1: f64,
    /// Tangential, along the rows.
    pub p2: f64,
    /// Radial, of the sixth power.
    pub k3: f64,
    /// Radial in the divisor (OpenCV's rational model), of the second power.
    pub k4: f64,
    /// Of the fourth.
    pub k5: f64,
    /// Of the sixth.
    pub k6: f64,
}

/// Steps of Newton's method; from the distorted slopes a lens of 120 degrees takes six.
const MOST_STEPS: usize = 20;
/// Slopes are known to this: a ten-thousandth of a pixel of a lens of 10,000 pixels.
const SLOPE_TOLERANCE: f64 = 1e-8;

impl Distortion {
    fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Slopes as the lens shows them, and the Jacobian: d(x)/dx, d(x)/dy, d(y)/dx, d(y)/dy.
    fn distorted(&self, [x, y]: [f64; 2]) -> ([f64; 2], [f64; 4]) {
        let Self { k1, k2, p1, p2, k3, k4, k5, k6 } = *self;
        let r2 = x * x + y * y;
        let (over, under) = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)));
        let radial = over / under;
        // By r2.
        let rise = |a: f64, b: f64, c: f64| a + r2 * (2.0 * b + r2 * 3.0 * c);
        let slope = (rise(k1, k2, k3) - radial * rise(k4, k5, k6)) / under;
        let shown = [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ];
        let across = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y;
        let jacobian = [
            radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x,
            across,
            across,
            radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x,
        ];
        (shown, jacobian)
    }

    /// The ray that the lens shows at these slopes; none where the polynomial folds over, as no lens does.
    fn undistorted(&self, shown: [f64; 2]) -> Option<[f64; 2]> {
        let mut ray = shown;
        for _ in 0..MOST_STEPS {
            let (at, [xx, xy, yx, yy]) = self.distorted(ray);
            let determinant = xx * yy - xy * yx;
            // Also where it is no number.
            if determinant.is_nan() || determinant <= 0.0 {
                return None;
            }
            let left = [shown[0] - at[0], shown[1] - at[1]];
            let step =
                [(yy * left[0] - xy * left[1]) / determinant, (xx * left[1] - yx * left[0]) / determinant];
            ray = [ray[0] + step[0], ray[1] + step[1]];
            if step[0].abs().max(step[1].abs()) < SLOPE_TOLERANCE {
                return Some(ray);
            }
        }
        None
    }
}

/// Pinhole intrinsics in pixels with the distortion of the lens, for images that come without.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(inline)]
#[serde(try_from = "Vec<f64>", into = "Vec<f64>")]
pub struct Intrinsics {
    /// Focal lengths, px.
    pub focal_px: [f64; 2],
    /// Where the optical axis meets the image, px.
    pub centre_px: [f64; 2],
    /// Of the lens.
    #[schemars(skip)]
    pub distortion: Distortion,
}

impl TryFrom<Vec<f64>> for Intrinsics {
    type Error = String;
    fn try_from(numbers: Vec<f64>) -> Result<Self, String> {
        let numbers: [f64; 9] = match numbers.as_slice() {
            [fx, fy, cx, cy] => [*fx, *fy, *cx, *cy, 0.0, 0.0, 0.0, 0.0, 0.0],
            [fx, fy, cx, cy, k1, k2, p1, p2] => [*fx, *fy, *cx, *cy, *k1, *k2, *p1, *p2, 0.0],
            nine => nine.try_into().map_err(|_| {
                format!(
                    "{} numbers; give fx,fy,cx,cy in pixels, then k1,k2,p1,p2 and k3 if the lens distorts",
                    nine.len()
                )
            })?,
        };
        let [fx, fy, cx, cy, k1, k2, p1, p2, k3] = numbers;
        let intrinsics = Self {
            focal_px: [fx, fy],
            centre_px: [cx, cy],
            distortion: Distortion { k1, k2, p1, p2, k3, ..Distortion::default() },
        };
        let camera = Camera::new([1, 1], &intrinsics, 0.001);
        camera.number_fault().map_or(Ok(intrinsics), |(field, problem)| Err(format!("{field}: {problem}")))
    }
}

impl From<Intrinsics> for Vec<f64> {
    fn from(Intrinsics { focal_px, centre_px, distortion }: Intrinsics) -> Self {
        let mut numbers = [focal_px, centre_px].concat();
        if !distortion.is_none() {
            let Distortion { k1, k2, p1, p2, k3, .. } = distortion;
            numbers.extend([k1, k2, p1, p2, k3]);
        }
        numbers
    }
}

impl FromStr for Intrinsics {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let number = |part: &str| part.trim().parse::<f64>().map_err(|_| format!("{part:?} is not a number"));
        text.split(',').map(number).collect::<Result<Vec<_>, _>>()?.try_into()
    }
}

/// Where a camera stood, mm, in the frame of the cloud that it took.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(inline)]
#[serde(try_from = "[f64; 3]", into = "[f64; 3]")]
pub struct CameraPosition([f64; 3]);

/// Farther from the origin than this nothing stands that looks at a weld, mm.
const FARTHEST_MM: f64 = 1e6;

impl CameraPosition {
    /// The position, mm.
    pub fn mm(self) -> [f64; 3] {
        self.0
    }
}

impl TryFrom<[f64; 3]> for CameraPosition {
    type Error = String;
    fn try_from(at_mm: [f64; 3]) -> Result<Self, String> {
        match at_mm.iter().find(|mm| mm.is_nan() || mm.abs() > FARTHEST_MM) {
            Some(mm) => Err(format!("{mm} mm: give a position of at most {FARTHEST_MM:.0} mm on each axis")),
            None => Ok(Self(at_mm)),
        }
    }
}

impl From<CameraPosition> for [f64; 3] {
    fn from(CameraPosition(at_mm): CameraPosition) -> Self {
        at_mm
    }
}

impl FromStr for CameraPosition {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let number = |part: &str| part.trim().parse::<f64>().map_err(|_| format!("{part:?} is not a number"));
        let numbers = text.split(',').map(number).collect::<Result<Vec<_>, _>>()?;
        let three: [f64; 3] =
            numbers.try_into().map_err(|all: Vec<_>| format!("{} numbers; give x,y,z in mm", all.len()))?;
        three.try_into()
    }
}

/// A depth camera: size of its image, intrinsics in pixels, size of a count.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub(super) struct Camera {
    pub width: u32,
    pub height: u32,
    pub fx: f64,
    pub fy: f64,
    pub cx: f64,
    pub cy: f64,
    /// Metres per count.
    pub depth_scale_m: f64,
    #[serde(flatten)]
    pub distortion: Distortion,
}

/// What a focal length or an image's centre can be, in pixels.
const PIXELS: std::ops::RangeInclusive<f64> = 1.0..=1e6;
/// Beyond this no coefficient of a lens lies; `k2` and `k3` of a long one are large.
const LARGEST_COEFFICIENT: f64 = 1e4;
/// Pixels a side at which the lens is tried, corners included.
const TRIED: u32 = 33;

impl Camera {
    pub(super) fn new(size_px: [u32; 2], intrinsics: &Intrinsics, depth_scale_m: f64) -> Self {
        let Intrinsics { focal_px: [fx, fy], centre_px: [cx, cy], distortion } = *intrinsics;
        Self { width: size_px[0], height: size_px[1], fx, fy, cx, cy, depth_scale_m, distortion }
    }

    /// What the ray of a pixel takes in memory where each pixel has one of its own.
    pub(super) fn ray_bytes(&self) -> u64 {
        if self.distortion.is_none() { 0 } else { size_of::<[f32; 2]>() as u64 }
    }

    /// The first field that no camera can have, and why.
    pub(super) fn fault(&self) -> Option<(&'static str, String)> {
        self.number_fault().or_else(|| self.lens_fault())
    }

    fn number_fault(&self) -> Option<(&'static str, String)> {
        let Distortion { k1, k2, p1, p2, k3, k4, k5, k6 } = self.distortion;
        let focal = [("fx", self.fx), ("fy", self.fy)].into_iter().find(|(_, v)| !PIXELS.contains(v));
        let centre =
            [("cx", self.cx), ("cy", self.cy)].into_iter().find(|(_, v)| !PIXELS.contains(&v.abs().max(1.0)));
        let lens =
            [("k1", k1), ("k2", k2), ("p1", p1), ("p2", p2), ("k3", k3), ("k4", k4), ("k5", k5), ("k6", k6)]
                .into_iter()
                .find(|(_, v)| v.is_nan() || v.abs() > LARGEST_COEFFICIENT);
        if let Some((name, value)) = focal.or(centre) {
            Some((name, format!("{value} pixels is not plausible for a lens")))
        } else if let Some((name, value)) = lens {
            Some((name, format!("{value} is not plausible for a lens")))
        } else if !(self.depth_scale_m.is_finite() && self.depth_scale_m > 0.0) {
            Some(("depth_scale_m", format!("{} is not above 0", self.depth_scale_m)))
        } else if self.depth_scale_m > 0.1 {
            Some((
                "depth_scale_m",
                format!("{} m per count is too coarse for any scanner", self.depth_scale_m),
            ))
        } else {
            None
        }
    }

    /// A pixel that no ray meets.
    fn lens_fault(&self) -> Option<(&'static str, String)> {
        if self.distortion.is_none() {
            return None;
        }
        let place = |k: u32, of: u32| f64::from(k) * f64::from(of.saturating_sub(1)) / f64::from(TRIED - 1);
        let places =
            (0..TRIED * TRIED).map(|k| [place(k % TRIED, self.width), place(k / TRIED, self.height)]);
        let folded = places.into_iter().find(|at| self.ray(*at).is_none())?;
        let [column, row] = folded.map(f64::round);
        Some(("k1", format!("with these coefficients no ray meets the pixel in column {column}, row {row}")))
    }

    /// Slopes of the ray that meets a pixel; none where the lens folds over.
    fn ray(&self, [column, row]: [f64; 2]) -> Option<[f64; 2]> {
        self.distortion.undistorted([(column - self.cx) / self.fx, (row - self.cy) / self.fy])
    }
}

/// The rays of all pixels: made once for all images of a camera, when the first of them has shown that it is as large.
#[derive(Debug, Clone)]
pub(super) struct Rays {
    pub camera: Camera,
    slopes: OnceLock<Slopes>,
}

impl Rays {
    pub(super) const fn new(camera: Camera) -> Self {
        Self { camera, slopes: OnceLock::new() }
    }

    /// What of the world a picture shows; the rays of its corners are the outermost but for what a lens bends.
    pub(super) fn picture(&self) -> Option<Picture> {
        let Camera { width, height, .. } = self.camera;
        let far = [width, height].map(|pixels| f64::from(pixels.saturating_sub(1)));
        let [low, high] = [[0.0, 0.0], far].map(|corner| self.camera.ray(corner));
        Some(Picture { low: low?.map(|slope| slope as f32), high: high?.map(|slope| slope as f32) })
    }

    /// To be asked for images of the camera's size only.
    pub(super) fn slopes(&self) -> &Slopes {
        self.slopes.get_or_init(|| Slopes::of(&self.camera))
    }
}

/// Slopes x and y of rays, per unit of depth.
#[derive(Debug, Clone)]
pub(super) enum Slopes {
    /// Of each column and each row.
    Pinhole { columns: Vec<f32>, rows: Vec<f32> },
    /// Of each pixel, row by row.
    Lens { columns: usize, all: Vec<[f32; 2]> },
}

impl Slopes {
    fn of(camera: &Camera) -> Self {
        let Camera { width, height, fx, fy, cx, cy, distortion, .. } = *camera;
        if distortion.is_none() {
            return Self::Pinhole {
                columns: (0..width).map(|u| ((f64::from(u) - cx) / fx) as f32).collect(),
                rows: (0..height).map(|v| ((f64::from(v) - cy) / fy) as f32).collect(),
            };
        }
        let pixels = (0..height).flat_map(|v| (0..width).map(move |u| [u, v].map(f64::from)));
        // A pixel that no ray meets has no point: its slopes are no numbers.
        let ray = |pixel| camera.ray(pixel).map_or([f32::NAN; 2], |ray| ray.map(|slope| slope as f32));
        Self::Lens { columns: width as usize, all: pixels.map(ray).collect() }
    }

    /// Of one pixel.
    pub(super) fn at(&self, column: usize, row: usize) -> [f32; 2] {
        match self {
            Self::Pinhole { columns, rows } => [columns[column], rows[row]],
            Self::Lens { columns, all } => all[row * columns + column],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of a D415 as its calibration prints it, and of a wide lens with a strong barrel.
    const LENSES: [Distortion; 3] = [
        Distortion { k1: 0.147, k2: -0.484, p1: 0.0008, p2: -0.0006, k3: 0.442, k4: 0.0, k5: 0.0, k6: 0.0 },
        Distortion { k1: -0.28, k2: 0.07, p1: -0.0004, p2: 0.0011, k3: 0.0, k4: 0.0, k5: 0.0, k6: 0.0 },
        // The order of size of an Azure Kinect's depth camera.
        Distortion { k1: 5.3, k2: 3.5, p1: -0.00007, p2: -0.00002, k3: 0.18, k4: 5.6, k5: 5.3, k6: 0.93 },
    ];

    #[test]
    fn a_ray_is_found_where_the_formula_of_opencv_shows_it() {
        for lens in LENSES {
            let Distortion { k1, k2, p1, p2, k3, k4, k5, k6 } = lens;
            for step in 0..400 {
                let (x, y) = (f64::from(step % 20) * 0.06 - 0.57, f64::from(step / 20) * 0.045 - 0.43);
                let r = x.hypot(y);
                let under = 1.0 + k4 * r.powi(2) + k5 * r.powi(4) + k6 * r.powi(6);
                let radial = (1.0 + k1 * r.powi(2) + k2 * r.powi(4) + k3 * r.powi(6)) / under;
                let shown = [
                    x * radial + 2.0 * p1 * x * y + p2 * (r * r + 2.0 * x * x),
                    y * radial + p1 * (r * r + 2.0 * y * y) + 2.0 * p2 * x * y,
                ];
                let found = lens.undistorted(shown).expect("within the lens");
                assert!((found[0] - x).abs() < 1e-9 && (found[1] - y).abs() < 1e-9, "{found:?}, not {x} {y}");
            }
        }
    }

    #[test]
    fn a_lens_that_folds_over_is_named() {
        let text = "600,600,320,240,-3.0,0,0,0,0";
        let intrinsics: Intrinsics = text.parse().expect("each number may be");
        let (field, problem) = Camera::new([640, 480], &intrinsics, 0.001).fault().expect("it folds");
        assert!(field == "k1" && problem.contains("column 0, row 0"), "{problem}");
    }

    #[test]
    fn intrinsics_are_read_from_four_eight_or_nine_numbers() {
        let read = |text: &str| text.parse::<Intrinsics>();
        let four = read("600, 601,320.5,-4").expect("four");
        assert_eq!((four.focal_px, four.centre_px), ([600.0, 601.0], [320.5, -4.0]));
        assert!(four.distortion.is_none());
        let nine = read("600,600,320,240,0.1,-0.2,0.001,0.002,0.05").expect("nine");
        let lens = Distortion { k1: 0.1, k2: -0.2, p1: 0.001, p2: 0.002, k3: 0.05, ..Distortion::default() };
        assert_eq!(nine.distortion, lens);
        assert_eq!(Intrinsics::try_from(Vec::from(nine)), Ok(nine));
        assert_eq!(read("600,600,320,240,0.1,-0.2,0.001,0.002").expect("eight").distortion.k3, 0.0);
        for (text, part) in [
            ("600,600,320", "3 numbers"),
            ("600,600,320,abc", "not a number"),
            ("0,600,320,240", "fx"),
            ("600,600,320,240,nan,0,0,0,0", "k1"),
        ] {
            assert!(read(text).is_err_and(|error| error.contains(part)), "{text}");
        }
    }
}
