//! Structure tensor of the intensity and the edge test on it (paper II-E, eqs. (14)-(17)).
//!
//! Departures: one point's `H` has rank one, so the test is meant for the smoothed tensor; a point's own weight is 1,
//! and the constant factor of the Gaussian, which cancels in the ratio, is left out. `H` is divided by its trace
//! before the comparison, else single precision over- or underflows.

use crate::{Vector, math};

/// Threshold `t` of eq. (16).
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct RatioThreshold(f32);

impl RatioThreshold {
    /// `Tr³/Det` of an isotropic tensor, and by AM-GM its least value: at or below it everything is an edge.
    pub const FLOOR: f32 = 27.0;

    /// `None` at or below [`Self::FLOOR`].
    ///
    /// ```
    /// use weldpath_core::seam::RatioThreshold;
    ///
    /// assert!(RatioThreshold::new(53.0).is_some(), "the paper's own");
    /// assert!(RatioThreshold::new(27.0).is_none(), "everything would be an edge");
    /// ```
    pub fn new(t: f32) -> Option<Self> {
        (t.is_finite() && t > Self::FLOOR).then_some(Self(t))
    }

    /// The number.
    pub fn get(self) -> f32 {
        self.0
    }
}

/// Symmetric 3x3 matrix: xx xy xz yy yz zz.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tensor([f32; 6]);

impl Tensor {
    /// From its components in the order xx xy xz yy yz zz.
    pub const fn new(components: [f32; 6]) -> Self {
        Self(components)
    }

    /// Outer product of a gradient with itself: the quadratic form of eq. (14), the matrix of eq. (15).
    pub fn outer(g: &Vector) -> Self {
        Self([g.x * g.x, g.x * g.y, g.x * g.z, g.y * g.y, g.y * g.z, g.z * g.z])
    }

    /// Smoothed tensor: the point's own, and its neighbours' by the weights of eq. (17).
    ///
    /// `neighbours` yields squared distance, mm², and gradient; it is read twice.
    pub fn smoothed<'a, I>(own: &Vector, neighbours: I) -> Self
    where
        I: IntoIterator<Item = (f32, &'a Vector)> + Clone,
    {
        let mut spread = Spread::default();
        neighbours.clone().into_iter().for_each(|(d2, _)| spread.add(math::sqrt(d2), d2));
        let per_mm2 = spread.falloff_per_mm2();
        let mut sum = Self::outer(own);
        neighbours.into_iter().for_each(|(d2, gradient)| sum.add(d2 * per_mm2, gradient));
        sum
    }

    /// A neighbour with the weight `exp(-falloff)`.
    #[inline]
    pub(super) fn add(&mut self, falloff: f32, g: &Vector) {
        let weight = math::exp_of_negative(falloff);
        let (x, y, z) = (weight * g.x, weight * g.y, weight * g.z);
        let h = &mut self.0;
        h[0] += x * g.x;
        h[1] += x * g.y;
        h[2] += x * g.z;
        h[3] += y * g.y;
        h[4] += y * g.z;
        h[5] += z * g.z;
    }

    /// Trace.
    pub fn trace(&self) -> f32 {
        self.0[0] + self.0[3] + self.0[5]
    }

    /// `Tr³ >= t Det`, eq. (16), without a division by the determinant. Never for a tensor without gradient.
    pub fn is_edge(&self, threshold: RatioThreshold) -> bool {
        let trace = self.trace();
        trace > 0.0 && 1.0 >= threshold.0 * self.unit_determinant(trace)
    }

    /// `Tr³/Det` itself: 27 for an isotropic tensor, infinite for one of rank two or less, 0 without gradient.
    pub fn ratio(&self) -> f32 {
        let trace = self.trace();
        if trace > 0.0 { 1.0 / self.unit_determinant(trace).max(0.0) } else { 0.0 }
    }

    /// Determinant of the tensor divided by its trace.
    fn unit_determinant(&self, trace: f32) -> f32 {
        let [a, b, c, d, e, f] = self.0.map(|h| h / trace);
        a * (d * f - e * e) - b * (b * f - e * c) + c * (b * e - d * c)
    }
}

/// How the neighbours' distances vary.
#[derive(Default)]
pub(super) struct Spread {
    count: f32,
    sum_mm: f32,
    squares_mm2: f32,
}

impl Spread {
    #[inline]
    pub(super) fn add(&mut self, distance_mm: f32, distance_mm2: f32) {
        self.count += 1.0;
        self.sum_mm += distance_mm;
        self.squares_mm2 += distance_mm2;
    }

    /// `1 / (2 σ²)` of the Gaussian, σ the distances' standard deviation; 0, hence weight 1, where they do not vary.
    pub(super) fn falloff_per_mm2(&self) -> f32 {
        let count = self.count.max(1.0);
        let mean_mm = self.sum_mm / count;
        let variance = self.squares_mm2 / count - mean_mm * mean_mm;
        if variance > 1e-6 * mean_mm * mean_mm { 0.5 / variance } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn from_eigenvalues(l: [f32; 3]) -> Tensor {
        Tensor([l[0], 0.0, 0.0, l[1], 0.0, l[2]])
    }

    #[test]
    fn an_isotropic_tensor_has_the_least_ratio() {
        assert!((from_eigenvalues([2.0, 2.0, 2.0]).ratio() - RatioThreshold::FLOOR).abs() < 1e-3);
        assert!(RatioThreshold::new(27.0).is_none());
        assert!(RatioThreshold::new(f32::NAN).is_none());
    }

    #[test]
    fn the_ratio_is_that_of_the_eigenvalues() {
        let expected = (4.0f32 + 2.0 + 1.0).powi(3) / (4.0 * 2.0);
        assert!((from_eigenvalues([4.0, 2.0, 1.0]).ratio() - expected).abs() < 1e-3);
    }

    #[test]
    fn the_test_agrees_with_the_ratio_at_any_scale() {
        let t = RatioThreshold::new(53.0).expect("above the floor");
        for scale in [1e-15, 1.0, 1e15] {
            assert!(from_eigenvalues([8.0, 1.0, 1.0].map(|l| l * scale)).is_edge(t));
            assert!(!from_eigenvalues([2.0, 1.0, 1.0].map(|l| l * scale)).is_edge(t));
        }
    }

    #[test]
    fn one_gradient_has_rank_one_and_no_gradient_is_no_edge() {
        let t = RatioThreshold::new(53.0).expect("above the floor");
        assert!(Tensor::outer(&Vector::new(1.0, 2.0, 3.0)).is_edge(t));
        assert!(!Tensor::default().is_edge(t));
        assert_eq!(Tensor::default().ratio(), 0.0);
    }

    #[test]
    fn smoothing_weighs_near_neighbours_more() {
        let (x, y) = (Vector::x(), Vector::y());
        let smoothed = Tensor::smoothed(&Vector::zeros(), [(1.0, &x), (9.0, &y)]);
        // Distances 1 and 3 have standard deviation 1: weights exp(-1/2) and exp(-9/2).
        assert!((smoothed.0[0] - libm::expf(-0.5)).abs() < 1e-6);
        assert!((smoothed.0[3] - libm::expf(-4.5)).abs() < 1e-6);
    }
}
