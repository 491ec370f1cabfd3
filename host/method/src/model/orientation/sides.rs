//! Which looks see a cloud from the side whence it was scanned.

use super::looks::{Directions, LOOKS, Looks, Tally, bits};
use super::shadows::Shadows;
use super::sums;
use crate::model::downsampling::Voxels;
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
    /// Which of them each voxel faces.
    faced: &'a [Directions],
    from: Directions,
    /// Voxels that have no say: their side is known, or their normal says nothing.
    mute: Vec<bool>,
    /// Of each look, how many voxels it sees whose normal says something, and how many of them have a say.
    sees: [i64; LOOKS],
    shows: [i64; LOOKS],
    shadows: Shadows,
}

impl<'a> Sides<'a> {
    /// Those of `voxels`, which are `faced` by some, that look from `from`; of which ones the side is `known`, and the `shadows` on its table.
    pub(super) fn new(
        voxels: &'a Voxels,
        looks: &'a Looks,
        faced: &'a [Directions],
        from: Directions,
        known: &[bool],
        shadows: Shadows,
    ) -> Self {
        let rough = rough(voxels);
        let mute: Vec<bool> = known.iter().zip(&rough).map(|(known, rough)| *known || *rough).collect();
        let [sees, shows] = [&rough, &mute].map(|without| {
            let counted = looks.seen.iter().zip(without).filter(|(_, without)| !**without);
            Tally::of(counted.map(|(seen, _)| seen & from))
        });
        Self { looks, faced, from, mute, sees, shows, shadows }
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

    /// Which of the looks that see a voxel see it from its other side than look `k`.
    fn otherwise(&self, voxel: usize, k: usize) -> Directions {
        let faced = self.faced[voxel];
        let of_other_side = if faced >> k & 1 == 0 { faced } else { !faced };
        self.looks.seen[voxel] & self.from & of_other_side
    }

    /// The best of the looks that see the same as the first from its other side, if it is nearly as good, or if it is the best of all
    /// where what of the table was scanned and is hidden counts as well. A part that hangs beside a table throws no shadow on it;
    /// one far over it hides what other views saw: neither evidence is enough alone.
    fn rival(&self, first: usize) -> Option<usize> {
        let seen = &self.looks.seen;
        let of_first = || (0..seen.len()).filter(|&i| !self.mute[i] && seen[i] >> first & 1 != 0);
        let common = Tally::of(of_first().map(|i| seen[i] & self.from));
        let otherwise = Tally::of(of_first().map(|i| self.otherwise(i, first)));
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
            let (mut seen_too, mut otherwise) = (Tally::default(), Tally::default());
            for (i, seen) in self.looks.seen.iter().enumerate() {
                if seen >> best & 1 != 0 && !std::mem::replace(&mut settled[i], true) {
                    seen_too.add(seen & self.from);
                    otherwise.add(self.otherwise(i, best));
                }
            }
            let (seen_too, otherwise) = (seen_too.counts(), otherwise.counts());
            for k in 0..LOOKS {
                new[k] -= seen_too[k];
                against[k] += otherwise[k];
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
    let ones = vec![1.0; voxels.cloud.len()];
    let sums = sums(voxels, STEADY_VOXELS, &ones, |alike, one| [alike.abs(), one]);
    sums.into_iter().map(|[alike, count]| alike < STEADY_COSINE * count).collect()
}

/// Neighbours within so many voxels, and how alike theirs must be to a normal, as a mean cosine: 26 degrees.
const STEADY_VOXELS: f32 = 1.8;
const STEADY_COSINE: f32 = 0.9;
