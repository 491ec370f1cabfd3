//! Neighbourhoods that have to grow to the least count of eq. (11), which only the paper's way asks for.
//!
//! A thinned cloud has few of them, at lone points and at ragged borders: they are searched one by one and scored by core's
//! functions, after all others were by [`super::edges`], eight neighbours at a time.

use crate::geometry::grid::Grid;
use crate::geometry::grid::sweep::Around;
use nalgebra::Vector3;
use rayon::prelude::*;
use weldpath_core::seam::{Ball, Tensor, gradient, intensity};

/// One neighbourhood that was grown, itself left out.
struct Grown {
    slot: usize,
    /// Slot, offset and squared distance.
    near: Vec<(usize, Vector3<f32>, f32)>,
    /// Distance of the farthest.
    radius_mm: f32,
}

/// The slots of a grid with fewer than [`Ball::LEAST`] others within a radius.
pub(super) struct Sparse(Vec<Grown>);

impl Sparse {
    pub(super) fn of(grid: &Grid, radius_mm: f32) -> Self {
        let count = |slot: usize, around: &Around<0>| {
            around.from(grid.point(slot)).map(|eight| eight.inside(radius_mm)).sum::<u32>()
        };
        // Each point counts itself.
        let counts = grid.sweep(radius_mm, [], count);
        let few = (0..grid.len()).into_par_iter().filter(|&slot| counts[slot] as usize <= Ball::LEAST);
        Self(few.filter_map(|slot| grown(grid, slot, radius_mm)).collect())
    }

    /// Intensity by the radius that was needed.
    pub(super) fn rescore(&self, intensities: &mut [f32]) {
        for Grown { slot, near, radius_mm } in &self.0 {
            intensities[*slot] = intensity(near.iter().map(|n| n.1), *radius_mm);
        }
    }

    /// Gradients of the intensities.
    pub(super) fn steepen(&self, intensities: &[f32], gradients: &mut [Vector3<f32>]) {
        for Grown { slot, near, .. } in &self.0 {
            let own = intensities[*slot];
            gradients[*slot] = gradient(near.iter().map(|n| (n.1, intensities[n.0] - own)));
        }
    }

    /// Tensors of the gradients.
    pub(super) fn smooth(&self, gradients: &[Vector3<f32>], tensors: &mut [Tensor]) {
        for Grown { slot, near, .. } in &self.0 {
            let around = near.iter().map(|n| (n.2, &gradients[n.0]));
            tensors[*slot] = Tensor::smoothed(&gradients[*slot], around);
        }
    }
}

/// The nearest [`Ball::LEAST`] of a slot, or all where there are fewer; none for a point alone.
fn grown(grid: &Grid, slot: usize, radius_mm: f32) -> Option<Grown> {
    let at = grid.point(slot);
    let least = Ball::LEAST.min(grid.len() - 1);
    let (mut near, mut reach_mm) = (Vec::new(), radius_mm);
    // Doubled some forty times, any radius of a model's voxels is beyond what single precision keeps apart.
    for _ in 0..40 {
        reach_mm *= 2.0;
        near.clear();
        grid.within(&at, reach_mm, |other, d2| near.extend((other != slot).then_some((other, d2))));
        if near.len() >= least {
            break;
        }
    }
    near.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
    near.truncate(least);
    let farthest_mm = near.last()?.1.sqrt();
    let near = near.into_iter().map(|(other, d2)| (other, grid.point(other) - at, d2)).collect();
    Some(Grown { slot, near, radius_mm: if farthest_mm > radius_mm { farthest_mm } else { radius_mm } })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;
    use weldpath_core::seam::Neighbourhood;

    #[test]
    fn a_neighbourhood_grows_as_that_of_core_does() {
        let part = |k: usize, by: f32| (k as f32 * by).fract() * 30.0;
        let points: Vec<_> =
            (0..90).map(|k| Point3::new(part(k, 0.754_88), part(k, 0.569_84), part(k, 0.2))).collect();
        let radius_mm = 6.0;
        let grid = Grid::new(&points, radius_mm);
        let sparse = Sparse::of(&grid, radius_mm);
        assert!(sparse.0.len() > 10 && sparse.0.len() <= points.len(), "{}", sparse.0.len());
        let ball = Ball::new(radius_mm, Ball::LEAST).expect("a radius");
        for Grown { slot, near, radius_mm } in &sparse.0 {
            let core = Neighbourhood::<64>::of(&points, grid.index(*slot), &ball).expect("neighbours");
            let mut expected: Vec<usize> = core.indices.iter().map(|&k| usize::from(k)).collect();
            let mut found: Vec<usize> = near.iter().map(|n| grid.index(n.0)).collect();
            expected.sort_unstable();
            found.sort_unstable();
            assert_eq!(found, expected);
            assert!((radius_mm - core.radius_mm).abs() < 1e-4);
        }
    }

    #[test]
    fn a_point_alone_has_no_neighbourhood() {
        let grid = Grid::new(&[Point3::origin()], 1.0);
        assert!(Sparse::of(&grid, 1.0).0.is_empty());
    }
}
