//! Which looks see a cloud from the side whence it was scanned.

use super::looks::{Directions, LOOKS, Looks, bits};
use super::shadows::Shadows;
use crate::geometry::grid::Grid;
use crate::model::downsampling::Voxels;
use nalgebra::Vector3;
use rayon::prelude::*;
use std::cmp::Reverse;

/// Share of what a look sees that it may see from the wrong side: through the gaps between points, and at borders.
const MOST_AGAINST: f32 = 0.05;
/// The rival of a look sees this share of what that one sees at least, most of it from the other side.
const LEAST_COMMON: f32 = 0.3;
/// A look is sure if it shows more than its rival by this share of what they see from two sides at least. Chosen on 32 simulated parts
/// that stand upright over a table: wrong looks led by .15 at most.
const LEAST_LEAD: f32 = 0.2;

/// The looks among which is sought, and what each of them shows.
pub(super) struct Sides<'a> {
    looks: &'a Looks,
    normals: &'a [Vector3<f32>],
    from: Directions,
    /// Voxels that have no say: their side is known, or their normal says nothing.
    mute: Vec<bool>,
    /// Of each look, how many voxels it sees whose normal says something, and how many of them have a say.
    sees: [i64; LOOKS],
    shows: [i64; LOOKS],
    shadows: Shadows,
}

impl<'a> Sides<'a> {
    /// Those of `voxels` that look from `from`; of which ones the side is `known`, and the `shadows` on its table.
    pub(super) fn new(
        voxels: &'a Voxels,
        looks: &'a Looks,
        from: Directions,
        known: &[bool],
        shadows: Shadows,
    ) -> Self {
        let rough = rough(voxels);
        let mute: Vec<bool> = known.iter().zip(&rough).map(|(known, rough)| *known || *rough).collect();
        let [sees, shows] = [&rough, &mute].map(|without| {
            let mut counts = [0; LOOKS];
            let counted = looks.seen.iter().zip(without).filter(|(_, without)| !**without);
            counted.flat_map(|(seen, _)| bits(seen & from)).for_each(|k| counts[k] += 1);
            counts
        });
        Self { looks, normals: &voxels.cloud.normals, from, mute, sees, shows, shadows }
    }

    /// The looks that are at one on the side of what they see, and whether others that see it from its other side could be as
    /// well.
    ///
    /// A wall of which one side was scanned is seen from behind as well. But from there one sees the place where the wall hid
    /// the table from the camera, and what lies before the wall is hidden. So the look that shows most comes first. Where one
    /// from the other side shows nearly as much, it is the side from which more directions see: most that is welded protrudes.
    pub(super) fn at_one(&self) -> (Directions, bool) {
        let Some(first) = bits(self.from).max_by_key(|k| (self.value(*k), Reverse(*k))) else {
            return (self.from, true);
        };
        let one = self.at_one_with(first);
        let Some(rival) = self.rival(first) else { return (one, false) };
        let other = self.at_one_with(rival);
        let seen_by = |looks: Directions| {
            let told = self.looks.seen.iter().zip(&self.mute).filter(|(_, mute)| !**mute);
            told.map(|(seen, _)| u64::from((seen & looks).count_ones())).sum::<u64>()
        };
        (if seen_by(other) > seen_by(one) { other } else { one }, true)
    }

    /// What a look shows, less what is bare and it would have shown, voxels.
    fn value(&self, k: usize) -> i64 {
        self.shows[k] - self.shadows.bare[k]
    }

    fn is_behind(&self, voxel: usize, k: usize) -> bool {
        self.normals[voxel].dot(&self.looks.directions[k]) < 0.0
    }

    /// The best of the looks that see the same as the first from its other side, if it is nearly as good, or if it is the best of all
    /// where what of the table was scanned and is hidden counts as well. A part that hangs beside a table throws no shadow on it;
    /// one far over it hides what other views saw: neither evidence is enough alone.
    fn rival(&self, first: usize) -> Option<usize> {
        let (mut common, mut otherwise) = ([0i64; LOOKS], [0i64; LOOKS]);
        for (i, seen) in self.looks.seen.iter().enumerate() {
            if !self.mute[i] && seen >> first & 1 != 0 {
                for k in bits(seen & self.from) {
                    common[k] += 1;
                    otherwise[k] += i64::from(self.is_behind(i, k) != self.is_behind(i, first));
                }
            }
        }
        let least = LEAST_COMMON * self.shows[first] as f32;
        let sees_it_from_behind = |k: &usize| common[*k] as f32 > least && 2 * otherwise[*k] > common[*k];
        let rivals = bits(self.from).filter(sees_it_from_behind);
        let rival = rivals.max_by_key(|k| (self.value(*k), Reverse(*k)))?;
        let lead = (self.value(first) - self.value(rival)) as f32;
        let best = bits(self.from).max_by_key(|k| (self.value(*k) - self.shadows.hidden[*k], Reverse(*k)));
        let is_near = lead < LEAST_LEAD * otherwise[rival] as f32;
        if is_near { Some(rival) } else { best.filter(sees_it_from_behind) }
    }

    /// Those that are at one with the first: always the one that adds most that is new, less what it sees from the other side than
    /// is settled, and less what is bare.
    fn at_one_with(&self, first: usize) -> Directions {
        let mut settled = self.mute.clone();
        let (mut new, mut against) = (self.shows, [0i64; LOOKS]);
        let mut next = Some(first);
        while let Some(best) = next {
            for (i, seen) in self.looks.seen.iter().enumerate() {
                if seen >> best & 1 == 0 || std::mem::replace(&mut settled[i], true) {
                    continue;
                }
                for k in bits(seen & self.from) {
                    new[k] -= 1;
                    against[k] += i64::from(self.is_behind(i, k) != self.is_behind(i, best));
                }
            }
            let adds = bits(self.from).filter(|k| new[*k] > against[*k]);
            next = adds.max_by_key(|k| (new[*k] - against[*k] - self.shadows.bare[*k], Reverse(*k)));
        }
        let at_one = |k: &usize| against[*k] as f32 <= MOST_AGAINST * self.sees[*k] as f32;
        bits(self.from).filter(at_one).map(|k| 1 << k).sum()
    }
}

/// Which voxels have normals that say nothing of their side: those of their neighbours turn another way.
fn rough(voxels: &Voxels) -> Vec<bool> {
    let (points, normals) = (&voxels.cloud.points_mm, &voxels.cloud.normals);
    let reach_mm = STEADY_VOXELS * voxels.edge_mm;
    let grid = Grid::new(points, reach_mm);
    let is_rough = |i: usize| {
        let (mut alike, mut count) = (0.0, 0.0);
        grid.within(&points[i], reach_mm, |slot, _| {
            alike += normals[i].dot(&normals[grid.index(slot)]).abs();
            count += 1.0;
        });
        alike < STEADY_COSINE * count
    };
    (0..points.len()).into_par_iter().map(is_rough).collect()
}

/// Neighbours within so many voxels, and how alike theirs must be to a normal, as a mean cosine: 26 degrees.
const STEADY_VOXELS: f32 = 1.8;
const STEADY_COSINE: f32 = 0.9;
