//! A few points with their neighbour lists: the edge scores where no spatial index fits.

use super::gradient::Steepest;
use super::tensor::Spread;
use super::{Ball, Neighbourhood, RatioThreshold, Tensor, intensity};
use crate::{Point, Vector, math};
use heapless::Vec;

/// Up to `P` points, each with up to `K` neighbours.
///
/// ```
/// use weldpath_core::Point;
/// use weldpath_core::seam::{Ball, Patch, RatioThreshold};
///
/// // Two faces that meet at right angles in the line y = 0, z = 0.
/// let corner = (0..96).map(|k| {
///     let (x, v) = ((k % 8) as f32, (k / 16) as f32 + 0.5);
///     if k / 8 % 2 == 0 { Point::new(x, v, 0.0) } else { Point::new(x, 0.0, v) }
/// });
/// let mut patch = Patch::<96, 32>::empty();
/// let ball = Ball::new(2.2, Ball::LEAST).expect("a radius above zero");
/// assert!(patch.load(corner, &ball));
/// let t = RatioThreshold::new(53.0).expect("above 27");
/// let [beside, amid] = [4, 52].map(|k| patch.score(k, t).expect("in range").intensity);
/// assert!(beside > 2.0 * amid);
/// ```
#[derive(Debug, Clone, Default)]
pub struct Patch<const P: usize, const K: usize> {
    points: Vec<Point, P>,
    neighbours: Vec<Neighbourhood<K>, P>,
    intensity: Vec<f32, P>,
    gradient: Vec<Vector, P>,
    /// Of eq. (17), per mm².
    falloff: Vec<f32, P>,
}

/// What a point's neighbourhood says about an edge there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgeScore {
    /// Eq. (12).
    pub intensity: f32,
    /// `Tr³/Det` of eq. (16).
    pub ratio: f32,
    /// Whether the ratio reaches the threshold.
    pub is_edge: bool,
}

impl<const P: usize, const K: usize> Patch<P, K> {
    /// A patch without points.
    pub const fn empty() -> Self {
        Self {
            points: Vec::new(),
            neighbours: Vec::new(),
            intensity: Vec::new(),
            gradient: Vec::new(),
            falloff: Vec::new(),
        }
    }

    /// Finds the neighbours of every point by brute force. `None` for more than `P` points, or for fewer than two.
    pub fn new(points: &[Point], ball: &Ball) -> Option<Self> {
        let mut patch = Self::empty();
        patch.load(points.iter().copied(), ball).then_some(patch)
    }

    /// As [`Self::new`] in the place of what was here: a microcontroller's stack does not hold a patch. Left empty,
    /// and false, where `new` gives none.
    pub fn load(&mut self, points: impl IntoIterator<Item = Point>, ball: &Ball) -> bool {
        let all = self.find(points, ball);
        if all {
            self.measure();
        }
        all
    }

    /// First half of [`Self::load`]: the points with the neighbours of each.
    pub(crate) fn find(&mut self, points: impl IntoIterator<Item = Point>, ball: &Ball) -> bool {
        self.clear();
        let all = points.into_iter().all(|point| self.points.push(point).is_ok()) && self.search(ball);
        if !all {
            self.clear();
        }
        all
    }

    /// The neighbours of every point; false if one has none.
    fn search(&mut self, ball: &Ball) -> bool {
        let near = |centre| Neighbourhood::of(&self.points, centre, ball);
        (0..self.points.len()).all(|centre| near(centre).is_some_and(|n| self.neighbours.push(n).is_ok()))
    }

    fn clear(&mut self) {
        self.points.clear();
        self.neighbours.clear();
        self.intensity.clear();
        self.gradient.clear();
        self.falloff.clear();
    }

    /// Second half of [`Self::load`]: intensities of all points, then gradients, which need their neighbours'
    /// intensities, and the Gaussians' widths.
    pub(crate) fn measure(&mut self) {
        for (point, near) in self.points.iter().zip(&self.neighbours) {
            let value = intensity(near.offsets_mm(&self.points, point), near.radius_mm);
            let _ = self.intensity.push(value);
        }
        for ((point, near), &own) in self.points.iter().zip(&self.neighbours).zip(&self.intensity) {
            // One square root of each distance serves both.
            let (mut steepest, mut spread) = (Steepest::default(), Spread::default());
            for (k, distance_mm2) in near.by_distance() {
                let (Some(other), Some(&theirs)) = (self.points.get(k), self.intensity.get(k)) else {
                    continue;
                };
                let distance_mm = math::sqrt(distance_mm2);
                spread.add(distance_mm, distance_mm2);
                steepest.add(&(other - point), distance_mm, theirs - own);
            }
            let _ = self.gradient.push(steepest.0);
            let _ = self.falloff.push(spread.falloff_per_mm2());
        }
    }

    /// Score of one point; `None` for an index out of range.
    ///
    /// ```
    /// use weldpath_core::Point;
    /// use weldpath_core::seam::{Ball, Patch, RatioThreshold};
    ///
    /// // A level face that meets an upright one at x = 0: 5 by 9 points on each, 1 mm apart.
    /// let level = (0..5).flat_map(|x| (0..9).map(move |y| Point::new(x as f32, y as f32, 0.0)));
    /// let upright = (1..5).flat_map(|z| (0..9).map(move |y| Point::new(0.0, y as f32, z as f32)));
    /// let mut patch = Patch::<96, 32>::empty();
    /// assert!(patch.load(level.chain(upright), &Ball::new(2.1, 4).unwrap()));
    /// let threshold = RatioThreshold::new(53.0).unwrap();
    /// let [in_the_corner, on_the_face] = [4, 22].map(|index| patch.score(index, threshold).unwrap());
    /// assert!(in_the_corner.intensity > on_the_face.intensity);
    /// ```
    pub fn score(&self, index: usize, threshold: RatioThreshold) -> Option<EdgeScore> {
        let (near, own) = (self.neighbours.get(index)?, self.gradient.get(index)?);
        let per_mm2 = *self.falloff.get(index)?;
        let mut tensor = Tensor::outer(own);
        for (k, distance_mm2) in near.by_distance() {
            let Some(gradient) = self.gradient.get(k) else { continue };
            tensor.add(distance_mm2 * per_mm2, gradient);
        }
        Some(EdgeScore {
            intensity: *self.intensity.get(index)?,
            ratio: tensor.ratio(),
            is_edge: tensor.is_edge(threshold),
        })
    }

    /// Number of neighbours of a point; 0 for an index out of range.
    pub fn neighbours(&self, index: usize) -> usize {
        self.neighbours.get(index).map_or(0, |near| near.indices.len())
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two 8x4 lattices that meet in the line y = 0, the second turned up by 90 degrees.
    fn corner() -> [Point; 64] {
        core::array::from_fn(|k| {
            let (x, v) = ((k % 8) as f32, (k / 16) as f32 + 0.5);
            if k / 8 % 2 == 0 { Point::new(x, v, 0.0) } else { Point::new(x, 0.0, v) }
        })
    }

    #[test]
    fn points_beside_the_corner_are_more_intense_than_amid_a_face() {
        let patch = Patch::<64, 32>::new(&corner(), &Ball::new(2.2, 8).expect("valid")).expect("fits");
        let t = RatioThreshold::new(53.0).expect("above the floor");
        let score = |k: usize| patch.score(k, t).expect("in range").intensity;
        // Index 4: beside the corner amid its length; index 36: two rows into the first face.
        assert!(score(4) > 2.0 * score(36), "{} {}", score(4), score(36));
        assert!(patch.score(64, t).is_none());
    }

    #[test]
    fn too_many_points_are_refused_and_too_few() {
        let ball = Ball::new(2.0, 4).expect("valid");
        assert!(Patch::<32, 16>::new(&corner(), &ball).is_none());
        assert!(Patch::<64, 16>::new(&corner()[..1], &ball).is_none());
        let mut patch = Patch::<64, 16>::new(&corner(), &ball).expect("fits");
        assert!(!patch.load(corner().into_iter().take(1), &ball) && patch.is_empty());
    }
}
