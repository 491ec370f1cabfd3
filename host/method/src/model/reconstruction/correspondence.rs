//! Nearest points that are searched again only when a view has moved far enough to change them.
//!
//! A search also tells how far the next nearest point is. Until the query has moved by half of the difference, no other
//! point can be the nearest, so that the late, small steps of an ICP search almost nothing.

use crate::geometry::grid::Grid;
use nalgebra::Point3;

const NONE: u32 = u32::MAX;

/// The partner of one point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Match {
    slot: u32,
    /// The partner itself, so that a match that stands touches no memory but its own.
    hit: Point3<f32>,
    /// Where it was searched from, and how far from there it stays the nearest.
    from: Point3<f32>,
    slack_mm: f32,
}

impl Match {
    /// Not searched yet.
    pub(super) const NEW: Self = {
        let origin = Point3::new(0.0, 0.0, 0.0);
        Self { slot: NONE, hit: origin, from: origin, slack_mm: -1.0 }
    };

    /// The accepted point nearest to `q` and nearer than `gate_mm`: its slot and where it is.
    ///
    /// `gate_mm` must not grow from call to call. What `accept` says is taken as long as the match stands.
    #[inline]
    pub(super) fn find(
        &mut self,
        grid: &Grid,
        q: &Point3<f32>,
        gate_mm: f32,
        accept: impl FnMut(usize) -> bool,
    ) -> Option<(usize, Point3<f32>)> {
        let stands = self.slack_mm > 0.0 && (q - self.from).norm_squared() < self.slack_mm * self.slack_mm;
        if !stands {
            self.search(grid, q, gate_mm, accept);
        }
        let near = self.slot != NONE && (self.hit - q).norm_squared() < gate_mm * gate_mm;
        near.then_some((self.slot as usize, self.hit))
    }

    fn search(&mut self, grid: &Grid, q: &Point3<f32>, gate_mm: f32, accept: impl FnMut(usize) -> bool) {
        // A little farther than asked, so that what lies just outside needs no search at the next step.
        let (found, alone_mm) = grid.nearest_alone(q, gate_mm + 0.5 * grid.cell_mm(), accept);
        self.from = *q;
        (self.slot, self.hit, self.slack_mm) = match found {
            Some((slot, d2)) => (slot as u32, grid.point(slot), 0.5 * (alone_mm - d2.sqrt())),
            None => (NONE, self.hit, alone_mm - gate_mm),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_match_that_stands_is_what_a_search_finds() {
        let points: Vec<Point3<f32>> = (0..900)
            .map(|i| {
                let (u, v) = ((i % 30) as f32, (i / 30) as f32);
                Point3::new(u + 0.3 * (v * 1.7).sin(), v + 0.3 * (u * 2.3).sin(), (0.4 * u).sin())
            })
            .collect();
        let grid = Grid::new(&points, 2.0);
        let mut searched = 0;
        let mut found = Match::NEW;
        for k in 0..2000 {
            let t = 0.002 * k as f32;
            let q = Point3::new(t, 14.0 + 8.0 * t.sin(), 2.0 * (0.7 * t).cos());
            let gate = if k < 1000 { 3.0 } else { 1.2 };
            let before = found.from;
            let now = found.find(&grid, &q, gate, |_| true).map(|(slot, _)| slot);
            searched += usize::from(found.from != before);
            assert_eq!(now, grid.nearest(&q, gate, |_| true).map(|(slot, _)| slot), "step {k}");
        }
        assert!(searched < 1000, "{searched}");
    }
}
