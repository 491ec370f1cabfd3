//! The shortest way from the retract of one pass to the approach of the next that is found below the safe level (ours).
//!
//! Tried are the straight move; lower levels, by bisection; and both ends drawn farther out along their own torch axes,
//! by bisection, as out of a common corner. The found way is then cut across its corners. On the move between, on which
//! the torch turns, all of it keeps the clearance from everything seen. On the stretches to and from it the torch does
//! not turn, and no part of it comes nearer to what was seen than it is at the end of the weld, or than the clearance.

use nalgebra::{Point3, UnitVector3, Vector3};

use super::terrain::{Known, Map, STEP_MM, swept};
use super::{End, TorchPlace};

/// A turn of the torch gets at least so much way, mm.
const LEAST_MM: f64 = 5.0;
/// Bisection stops here, mm.
const EXACT_MM: f64 = 1.0;
/// A range that does not fit as a whole is halved so often.
const HALVINGS: usize = 4;
/// Shares of the move across by which a corner of the way is cut.
const CUTS: [f64; 2] = [0.3, 0.15];

/// Two ends between which a way is sought.
pub(super) struct Crossing<'a> {
    pub map: &'a Map,
    pub known: &'a Known,
    pub up: UnitVector3<f64>,
    pub safe_level_mm: f64,
    pub ends: [&'a End; 2],
}

/// Where the move across begins and ends.
pub(super) type Across = [TorchPlace; 2];

impl Crossing<'_> {
    /// The shortest that is free, of those tried; a way longer than `most_mm` is of no use.
    pub(super) fn shortest(&self, most_mm: f64) -> Option<Across> {
        let [from, to] = self.ends.map(|end| end.pose);
        let direct_mm = (to.tip_mm - from.tip_mm).norm();
        let least_mm = if direct_mm < LEAST_MM { LEAST_MM } else { 0.0 };
        if least_mm == 0.0 && self.is_free(&[from, to]) {
            return Some([from, to]);
        }
        let [low_mm, high_mm] = [f64::min, f64::max].map(|of| of(self.height_mm(&from), self.height_mm(&to)));
        let level = |rise_mm: f64| self.on_level(low_mm + rise_mm);
        let out = |by_mm: f64| self.drawn_out(by_mm);
        let over = self.least(level, least_mm, self.safe_level_mm.max(high_mm) - low_mm);
        let aside = self.least(out, least_mm, 0.5 * (most_mm - direct_mm));
        let found = over.into_iter().chain(aside).map(|across| self.cut(across));
        found.min_by(|a, b| self.length_mm(a).total_cmp(&self.length_mm(b)))
    }

    fn height_mm(&self, pose: &TorchPlace) -> f64 {
        self.up.dot(&pose.tip_mm.coords)
    }

    fn on_level(&self, level_mm: f64) -> Across {
        self.room_to_turn(self.ends.map(|end| {
            let rise_mm = (level_mm - self.height_mm(&end.pose)).max(0.0);
            end.pose.at(end.pose.tip_mm + self.up.into_inner() * rise_mm)
        }))
    }

    fn drawn_out(&self, by_mm: f64) -> Across {
        self.room_to_turn(self.ends.map(|end| end.pose.at(end.pose.tip_mm + end.pose.out_of_work() * by_mm)))
    }

    fn room_to_turn(&self, [from, to]: Across) -> Across {
        let turns = from.base_from_torch.angle_to(&to.base_from_torch) > 1e-6;
        let is_near = (to.tip_mm - from.tip_mm).norm() < LEAST_MM;
        let raised = to.at(to.tip_mm + self.up.into_inner() * LEAST_MM);
        [from, if turns && is_near { raised } else { to }]
    }

    /// The least of a family of ways that is free, between `least_mm` and `most_mm`.
    fn least(&self, way: impl Fn(f64) -> Across, least_mm: f64, most_mm: f64) -> Option<Across> {
        let free = |at_mm: f64| Some(way(at_mm)).filter(|across| self.is_free(across));
        let tops = (0..HALVINGS).map(|k| most_mm / f64::from(1 << k)).take_while(|top| *top >= least_mm);
        let (mut high_mm, mut found) = tops.into_iter().find_map(|top| Some((top, free(top)?)))?;
        let mut low_mm = least_mm;
        while high_mm - low_mm > EXACT_MM {
            let middle_mm = 0.5 * (low_mm + high_mm);
            match free(middle_mm) {
                Some(across) => (high_mm, found) = (middle_mm, across),
                None => low_mm = middle_mm,
            }
        }
        Some(found)
    }

    /// The same way with its corners cut as far as is free.
    fn cut(&self, mut across: Across) -> Across {
        for k in [0, 1] {
            let (corner, other) = (across[k], across[1 - k]);
            let cut = |share: f64| {
                let mut shorter = across;
                shorter[k] = corner.at(corner.tip_mm + (other.tip_mm - corner.tip_mm) * share);
                shorter
            };
            if let Some(shorter) = CUTS.into_iter().map(cut).find(|across| self.is_free(across)) {
                across = shorter;
            }
        }
        across
    }

    pub(super) fn length_mm(&self, [from, to]: &Across) -> f64 {
        let places = [self.ends[0].pose.tip_mm, from.tip_mm, to.tip_mm, self.ends[1].pose.tip_mm];
        places.windows(2).map(|w| (w[1] - w[0]).norm()).sum()
    }

    fn is_free(&self, across: &Across) -> bool {
        (0..2).all(|k| self.may_go(self.ends[k], &across[k].tip_mm)) && self.is_move_free(across)
    }

    /// Whether the stretch between an end and a place is free. What is free straight up and along the torch axis is known.
    fn may_go(&self, end: &End, to_mm: &Point3<f64>) -> bool {
        let step = to_mm - end.pose.tip_mm;
        let is_along =
            |axis: &Vector3<f64>| (step - axis * step.dot(axis)).norm() < 1e-6 && step.dot(axis) >= 0.0;
        match step.norm() {
            0.0 => true,
            _ if is_along(&self.up) => end.stretches.up,
            length_mm if is_along(&end.pose.out_of_work()) => length_mm <= end.stretches.out_mm,
            _ => stretch(self.map, self.known, &end.pose, &end.room_mm, *to_mm).all(|free| free),
        }
    }

    /// The move on which the torch turns.
    fn is_move_free(&self, [from, to]: &Across) -> bool {
        swept(from, to, self.map.lever_mm(), STEP_MM).all(|pose| {
            (0..self.map.balls()).all(|ball| {
                let centre_mm = self.map.centre_mm(ball, &pose);
                self.map.is_clear(ball, &centre_mm) && self.map.is_known(ball, &centre_mm, self.known)
            })
        })
    }
}

/// Which stretches from an end are free.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Stretches {
    /// Straight up, to any height: upward nothing comes nearer.
    up: bool,
    /// So far out along the torch axis, mm.
    out_mm: f64,
}

/// Farther out along its own axis a torch is not drawn, mm.
const MOST_OUT_MM: f64 = 300.0;

impl Stretches {
    /// From a pose with so much room about each ball.
    pub(super) fn of(map: &Map, known: &Known, pose: &TorchPlace, room_mm: &[f64]) -> Self {
        let free_to = |to_mm: Point3<f64>| stretch(map, known, pose, room_mm, to_mm);
        let out = free_to(pose.tip_mm + pose.out_of_work() * MOST_OUT_MM);
        let free = out.take_while(|free| *free).count();
        Self { up: free_to(pose.tip_mm).all(|free| free), out_mm: STEP_MM * free.saturating_sub(1) as f64 }
    }
}

/// Whether the torch is free on each step of the move from a pose to a place, on which it does not turn.
fn stretch<'s>(
    map: &'s Map,
    known: &'s Known,
    pose: &'s TorchPlace,
    room_mm: &'s [f64],
    to_mm: Point3<f64>,
) -> impl Iterator<Item = bool> + 's {
    swept(pose, &pose.at(to_mm), 0.0, STEP_MM).map(move |pose| {
        room_mm.iter().enumerate().all(|(ball, room_mm)| {
            let centre_mm = map.centre_mm(ball, &pose);
            let is_clear = || {
                map.is_clear(ball, &centre_mm)
                    || *room_mm > 0.0 && map.distance_mm(ball, &centre_mm) >= least_mm(map, ball, *room_mm)
            };
            map.is_known(ball, &centre_mm, known) && is_clear()
        })
    })
}

/// The least distance of a ball's centre on a stretch: that at its end, give or take the cell that distances are known
/// by; but it touches nothing that it does not touch there.
fn least_mm(map: &Map, ball: usize, room_mm: f64) -> f64 {
    (room_mm - map.cell_mm()).max(room_mm.min(map.radius_mm(ball)))
}
