//! Planes through points by their moments (eq. (9)): scatter about the mean, its least eigenvalue, its normal.
//!
//! Lengths are millimetres, relative to a centre of the caller's choice.

use nalgebra::Vector3;
use wide::f64x2;

/// Count, sum and second moments of points relative to a centre.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Moments {
    pub(crate) count: f32,
    pub(crate) sum: Vector3<f32>,
    /// xx xy xz yy yz zz
    pub(crate) second: [f32; 6],
}

/// A fitted plane relative to the centre of its moments.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plane {
    pub(crate) mean: Vector3<f32>,
    pub(crate) normal: Vector3<f32>,
    /// Variance about the plane.
    pub(crate) variance_mm2: f32,
}

impl Moments {
    pub(crate) fn add(&mut self, d: Vector3<f32>) {
        self.count += 1.0;
        self.sum += d;
        let s = &mut self.second;
        s[0] += d.x * d.x;
        s[1] += d.x * d.y;
        s[2] += d.x * d.z;
        s[3] += d.y * d.y;
        s[4] += d.y * d.z;
        s[5] += d.z * d.z;
    }

    pub(crate) fn plane(&self) -> Plane {
        let n = self.count.max(1.0);
        let mean = self.sum / n;
        let c = |k: usize, a: usize, b: usize| f64::from(self.second[k] / n - mean[a] * mean[b]);
        Plane::new(mean, [c(0, 0, 0), c(1, 0, 1), c(2, 0, 2), c(3, 1, 1), c(4, 1, 2), c(5, 2, 2)], n)
    }
}

impl Plane {
    /// From the scatter (xx xy xz yy yz zz) of so many points about their mean.
    fn new(mean: Vector3<f32>, scatter: [f64; 6], points: f32) -> Self {
        let fit = Scatter::new(scatter, points);
        Self { mean, normal: fit.normal(), variance_mm2: fit.variance_mm2 }
    }
}

/// How points scatter about their mean; the normal, which few need, is found when it is asked for.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scatter {
    /// xx xy xz yy yz zz
    matrix: [f64; 6],
    least: f64,
    /// Variance about the fitted plane.
    pub(crate) variance_mm2: f32,
    /// Variance along the narrower direction in the plane.
    pub(crate) middle_mm2: f32,
    pub(crate) points: f32,
}

impl Scatter {
    pub(crate) fn new(matrix: [f64; 6], points: f32) -> Self {
        let [fit, _] = Self::of_two([matrix; 2], [points; 2]);
        fit
    }

    /// Of two matrices, for little more than the price of one.
    pub(crate) fn of_two(matrices: [[f64; 6]; 2], points: [f32; 2]) -> [Self; 2] {
        let [left, right] = matrices;
        let [least, middle] = lesser_eigenvalues(std::array::from_fn(|k| f64x2::new([left[k], right[k]])));
        let (least, middle) = (least.to_array(), middle.to_array());
        [0, 1].map(|k| Self {
            matrix: matrices[k],
            least: least[k],
            variance_mm2: least[k].max(1e-9) as f32,
            middle_mm2: middle[k].max(1e-6) as f32,
            points: points[k],
        })
    }

    /// Unit normal of the fitted plane, eq. (9): the eigenvector of the least eigenvalue. Its sign is arbitrary.
    pub(crate) fn normal(&self) -> Vector3<f32> {
        eigenvector(&self.matrix, self.least).cast()
    }
}

/// The least and the middle eigenvalue of each of two matrices.
///
/// The characteristic polynomial of the matrix less its mean, scaled, is `x³ - 3x - det` (Smith 1961); its other two roots
/// solve a quadratic.
fn lesser_eigenvalues([a, b, c, d, e, f]: [f64x2; 6]) -> [f64x2; 2] {
    let [two, three, zero] = [2.0, 3.0, 0.0].map(f64x2::splat);
    let mean = (a + d + f) / three;
    let (p, q, r) = (a - mean, d - mean, f - mean);
    let spread = (p * p + q * q + r * r + two * (b * b + c * c + e * e)) / 6.0;
    let scale = spread.sqrt();
    let per = 1.0 / scale;
    let (p, q, r, s, t, u) = (p * per, q * per, r * per, b * per, c * per, e * per);
    let det = p * (q * r - u * u) - s * (s * r - u * t) + t * (s * u - q * t);
    let root = least_root(det.fast_max(-two).fast_min(two));
    let middle = root + (12.0 - three * root * root).fast_max(zero).sqrt();
    // A multiple of 1 has no direction, and what was scaled by its spread is no number.
    let even = scale.simd_le(1e-12 * mean.abs()) | scale.simd_eq(zero);
    [mean + scale * root, mean - 0.5 * scale * middle].map(|value| even.select(mean, value))
}

/// Unit eigenvector of an eigenvalue: the longest cross product of two rows of the matrix less it; z for a multiple of 1.
fn eigenvector([a, b, c, d, e, f]: &[f64; 6], value: f64) -> Vector3<f64> {
    let rows =
        [Vector3::new(a - value, *b, *c), Vector3::new(*b, d - value, *e), Vector3::new(*c, *e, f - value)];
    let crosses = [rows[0].cross(&rows[1]), rows[0].cross(&rows[2]), rows[1].cross(&rows[2])];
    let longest = crosses.into_iter().max_by(|x, y| x.norm_squared().total_cmp(&y.norm_squared()));
    longest.and_then(|v| v.try_normalize(0.0)).unwrap_or_else(Vector3::z)
}

/// Least root of `x³ - 3x - det`, for `det` between -2 and 2: two steps of Newton's from a start that is right to 1.5e-4.
///
/// With `s² = 2 - det` the root is `-1 - s g(s)`, where `g` is smooth also at the double root, `s = 0`, and a cubic fits it.
/// The error of the start is proportional to `s`, as is the slope, so that the steps converge there, too.
fn least_root(det: f64x2) -> f64x2 {
    let splat = f64x2::splat;
    let s = (2.0 - det).sqrt();
    let g = 0.577_263_773 + s * (-0.054_589_266 + s * (0.010_810_3 - s * 0.001_424_887));
    let slope = |x: f64x2| (3.0 * (x * x - 1.0)).fast_max(splat(f64::MIN_POSITIVE));
    let step = |x: f64x2| x - (x * (x * x - 3.0) - det) / slope(x);
    let start = -1.0 - s * g;
    s.simd_lt(splat(1e-7)).select(start, step(step(start)))
}
