//! What a table tells of the looks: where it is bare, something stood before it, and what was scanned was not hidden.

use super::looks::{Directions, LOOKS, Looks, Picture, bits};
use super::table::Places;
use crate::geometry::columns::Columns;
use crate::model::downsampling::Voxels;
use nalgebra::Point3;
use rayon::prelude::*;

/// What of a table speaks against each direction, voxels: what is bare and seen, and what was scanned and is hidden.
pub(super) struct Shadows {
    pub(super) bare: [i64; LOOKS],
    pub(super) hidden: [i64; LOOKS],
}

impl Default for Shadows {
    fn default() -> Self {
        Self { bare: [0; LOOKS], hidden: [0; LOOKS] }
    }
}

impl Shadows {
    /// Those of `places`: the bare ones that each look of `from` sees, and the scanned ones that the voxels which are not `of_table`
    /// hide from it; of each less the least.
    pub(super) fn on(
        places: &Places,
        voxels: &Voxels,
        of_table: &[bool],
        looks: &Looks,
        from: Directions,
    ) -> Self {
        let mut shadows = Self::default();
        let standing = voxels.cloud.points_mm.iter().zip(of_table).filter(|(_, of_table)| !**of_table);
        let standing: Vec<Point3<f32>> = standing.map(|(p, _)| *p).collect();
        if standing.is_empty() {
            return shadows;
        }
        let standing = Columns::new(&standing);
        let count = |k: usize| {
            let picture = Picture::new(&standing, voxels.edge_mm, &looks.directions[k]);
            let bare = places.bare.iter().filter(|place| picture.shows(place)).count();
            let hidden = places.scanned.iter().filter(|place| !picture.shows(place)).count();
            [bare, hidden].map(|count| places.voxels * count as i64)
        };
        let all: Vec<_> = bits(from).collect::<Vec<_>>().into_par_iter().map(|k| (k, count(k))).collect();
        let least = [0, 1].map(|of| all.iter().map(|(_, counts)| counts[of]).min().unwrap_or(0));
        for (k, [bare, hidden]) in all {
            (shadows.bare[k], shadows.hidden[k]) = (bare - least[0], hidden - least[1]);
        }
        shadows
    }
}
