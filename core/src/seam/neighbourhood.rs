//! Adaptive bounded neighbourhood (paper II-E, eq. (11)).
//!
//! All points within a radius, but no fewer than `least` and no more than the capacity. The radius that results is
//! the distance of the farthest member where it had to grow, and the set radius otherwise.

use core::cell::Cell;

use crate::{Point, Vector, math};
use heapless::Vec;

/// The rule of eq. (11).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ball {
    radius_mm: f32,
    least: usize,
}

impl Ball {
    /// The paper gives no number for the least count `m`; 12 keeps eqs. (12)-(17) meaningful.
    pub const LEAST: usize = 12;

    /// `None` unless the radius is positive and finite.
    pub fn new(radius_mm: f32, least: usize) -> Option<Self> {
        (radius_mm > 0.0 && radius_mm.is_finite()).then_some(Self { radius_mm, least })
    }

    /// The radius of a neighbourhood that need not grow, mm.
    pub fn radius_mm(&self) -> f32 {
        self.radius_mm
    }

    /// The least number of neighbours.
    pub fn least(&self) -> usize {
        self.least
    }
}

/// The neighbours of one point, itself left out, nearest first.
#[derive(Debug, Clone, Default)]
pub struct Neighbourhood<const K: usize> {
    /// Indices of the neighbours.
    pub indices: Vec<u16, K>,
    /// Their squared distances, mm², ascending.
    distances_mm2: Vec<f32, K>,
    /// Effective radius, mm.
    pub radius_mm: f32,
}

impl<const K: usize> Neighbourhood<K> {
    /// Neighbours of `points[centre]`, eq. (11). `None` for an index out of range, for no other point, or for more
    /// points than `u16` can number.
    ///
    /// Keeps the `K` nearest where more fall into the ball. Points that coincide with the centre are neighbours.
    pub fn of(points: &[Point], centre: usize, ball: &Ball) -> Option<Self> {
        let middle = points.get(centre)?;
        u16::try_from(points.len()).ok()?;
        let limit_mm2 = ball.radius_mm * ball.radius_mm;
        let mut found = Self { indices: Vec::new(), distances_mm2: Vec::new(), radius_mm: ball.radius_mm };
        for (index, point) in points.iter().enumerate() {
            let distance_mm2 = (point - middle).norm_squared();
            let nearer = || found.distances_mm2.last().is_some_and(|&d| d > limit_mm2 && distance_mm2 < d);
            let needed = distance_mm2 < limit_mm2 || found.indices.len() < ball.least.min(K) || nearer();
            if index != centre && needed {
                found.insert(index as u16, distance_mm2);
            }
        }
        found.trim(ball);
        (!found.indices.is_empty()).then_some(found)
    }

    /// Puts a neighbour where it belongs by distance; drops the farthest when full.
    fn insert(&mut self, index: u16, distance_mm2: f32) {
        if self.indices.is_full() {
            if self.distances_mm2.last().is_none_or(|&d| distance_mm2 >= d) {
                return;
            }
            self.indices.pop();
            self.distances_mm2.pop();
        }
        // Neither fails: there is room.
        let _ = self.indices.push(index);
        let _ = self.distances_mm2.push(distance_mm2);
        self.settle();
    }

    /// Moves the last neighbour to where it belongs. By cells, for the optimiser sees no panic in them.
    fn settle(&mut self) {
        let indices = Cell::from_mut(self.indices.as_mut_slice()).as_slice_of_cells();
        let distances_mm2 = Cell::from_mut(self.distances_mm2.as_mut_slice()).as_slice_of_cells();
        for (distances, indices) in distances_mm2.windows(2).zip(indices.windows(2)).rev() {
            let ([near, far], [near_index, far_index]) = (distances, indices) else { return };
            if near.get() <= far.get() {
                return;
            }
            near.swap(far);
            near_index.swap(far_index);
        }
    }

    /// Drops what lies outside the ball and is not needed, and settles the radius.
    fn trim(&mut self, ball: &Ball) {
        let limit_mm2 = ball.radius_mm * ball.radius_mm;
        let inside = self.distances_mm2.partition_point(|&d| d < limit_mm2);
        let keep = inside.max(ball.least.min(self.indices.len()));
        self.indices.truncate(keep);
        self.distances_mm2.truncate(keep);
        let farthest_mm = self.distances_mm2.last().map_or(0.0, |&d| math::sqrt(d));
        if keep > inside || self.indices.is_full() {
            self.radius_mm = if farthest_mm > 0.0 { farthest_mm } else { ball.radius_mm };
        }
    }

    /// Index and squared distance, mm², of the neighbours, nearest first.
    pub fn by_distance(&self) -> impl Iterator<Item = (usize, f32)> + Clone + '_ {
        self.indices.iter().map(|&k| usize::from(k)).zip(self.distances_mm2.iter().copied())
    }

    /// Offsets of the neighbours from the point, mm.
    pub fn offsets_mm<'a>(
        &'a self,
        points: &'a [Point],
        centre: &'a Point,
    ) -> impl Iterator<Item = Vector> + 'a {
        self.indices.iter().filter_map(move |&k| Some(points.get(usize::from(k))? - centre))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line() -> [Point; 9] {
        core::array::from_fn(|k| Point::new(k as f32, 0.0, 0.0))
    }

    #[test]
    fn a_dense_neighbourhood_has_the_set_radius() {
        let n = Neighbourhood::<8>::of(&line(), 4, &Ball::new(2.5, 2).expect("valid")).expect("found");
        assert_eq!(n.indices.len(), 4);
        assert_eq!(n.radius_mm, 2.5);
    }

    #[test]
    fn a_sparse_neighbourhood_grows_to_the_least_count() {
        let n = Neighbourhood::<8>::of(&line(), 0, &Ball::new(1.5, 3).expect("valid")).expect("found");
        assert_eq!(n.indices.as_slice(), [1, 2, 3]);
        assert_eq!(n.radius_mm, 3.0);
    }

    #[test]
    fn a_full_neighbourhood_keeps_the_nearest() {
        let n = Neighbourhood::<3>::of(&line(), 4, &Ball::new(10.0, 1).expect("valid")).expect("found");
        assert_eq!(n.indices.len(), 3);
        assert!(n.indices.contains(&3) && n.indices.contains(&5));
        assert_eq!(n.radius_mm, 2.0);
    }

    #[test]
    fn one_point_and_a_wrong_index_have_no_neighbourhood() {
        let ball = Ball::new(1.0, 3).expect("valid");
        assert!(Neighbourhood::<4>::of(&[Point::origin()], 0, &ball).is_none());
        assert!(Neighbourhood::<4>::of(&line(), 99, &ball).is_none());
    }

    #[test]
    fn a_ball_needs_a_positive_radius() {
        assert!([0.0, -1.0, f32::NAN, f32::INFINITY].iter().all(|&r| Ball::new(r, 3).is_none()));
    }
}
