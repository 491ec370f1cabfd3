//! Which seam comes next, and which way it is welded (ours).
//!
//! The air way between two seams is the one that the torch really takes ([`super::air`]); each is sought once. The sum
//! of all of them is made small; where the robot comes from and goes to is not known. For few seams it is the least there
//! is (Held and Karp 1962). For more it is what local search finds: from the order found, and from the nearest neighbour
//! of every seam, by turning stretches round (2-opt), moving up to three seams elsewhere (Or-opt) and turning single seams
//! round, until nothing helps. Seams that must keep their direction keep it. Of many seams fewer ways are sought and fewer
//! starts tried, so that the time stays bounded.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use nalgebra::UnitVector3;
use rayon::prelude::*;

use super::SeamPath;
use super::air::{End, Surroundings, safe_mm};
use crate::cancellation::go_on;

/// Which way a seam may be welded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AllowedDirection {
    /// Either.
    Free,
    /// As it was found.
    Forward,
    /// Against that.
    Reverse,
}

/// A path that rises by less than this share of its length is level: sine of the 15 degrees that ISO 6947 allows PA.
const LEVEL: f64 = 0.26;

/// The way that leads uphill; free if the seam is level or closed.
pub fn uphill(path: &SeamPath, up: UnitVector3<f64>) -> AllowedDirection {
    let [first, .., last] = path.points.as_slice() else { return AllowedDirection::Free };
    let rise_mm = up.dot(&(last.position_mm - first.position_mm));
    match rise_mm {
        level if level.abs() <= LEVEL * path.length_mm() => AllowedDirection::Free,
        down if down < 0.0 => AllowedDirection::Reverse,
        _ => AllowedDirection::Forward,
    }
}

/// One seam in the order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Turn {
    /// Its place in the list that was given.
    pub index: usize,
    /// Whether it is welded from end to start.
    pub reverse: bool,
}

/// Where the air moves to and from a seam end and begin.
#[derive(Debug, Clone, PartialEq)]
pub struct Gates {
    /// Welded as it was found: the first approach and the last retract.
    pub forward: [End; 2],
    /// The same welded from end to start.
    pub reverse: [End; 2],
    /// Which way it may be welded.
    pub way: AllowedDirection,
}

impl Gates {
    fn ends(&self, reverse: bool) -> &[End; 2] {
        if reverse { &self.reverse } else { &self.forward }
    }
}

/// Lengths of the air moves, mm.
#[derive(Debug, Clone, PartialEq)]
pub struct AirWays {
    ways: Vec<AllowedDirection>,
    /// From the retract of one turn, by rows, to the approach of another.
    between_mm: Vec<f64>,
}

impl AirWays {
    /// Between all seams, in every way in which they may be welded.
    pub fn new(gates: &[Gates], around: &Surroundings) -> Self {
        let ways: Vec<AllowedDirection> = gates.iter().map(|gate| gate.way).collect();
        let turns: Vec<Turn> = every_turn(gates.len()).collect();
        let ends = |turn: &Turn| gates[turn.index].ends(turn.reverse);
        let allowed = |turn: &Turn| ways[turn.index] != opposite(turn.reverse);
        let sought = MOST_SOUGHT.min(MOST_WAYS / turns.len().max(1));
        let row = |from: &Turn| -> Vec<f64> {
            let retract = &ends(from)[1];
            let away_mm = |to: &Turn| (ends(to)[0].pose.tip_mm - retract.pose.tip_mm).norm();
            let mut nearest_mm: Vec<f64> = turns.iter().map(away_mm).collect();
            nearest_mm.sort_unstable_by(f64::total_cmp);
            let far_mm = nearest_mm.get(sought).copied().unwrap_or(f64::INFINITY);
            let way_mm = |to: &Turn| match allowed(from) && allowed(to) && from.index != to.index {
                true if away_mm(to) <= far_mm => around.way(retract, &ends(to)[0]).length_mm,
                true => safe_mm(retract, &ends(to)[0]),
                false => f64::INFINITY,
            };
            turns.iter().map(way_mm).collect()
        };
        let between_mm = turns.par_iter().flat_map_iter(row).collect();
        Self { ways, between_mm }
    }

    fn len(&self) -> usize {
        self.ways.len()
    }

    fn between_mm(&self, from: &Turn, to: &Turn) -> f64 {
        self.between_mm[place(from) * 2 * self.len() + place(to)]
    }

    /// Sum of the ways of an order.
    pub fn air_mm(&self, order: &[Turn]) -> f64 {
        order.windows(2).map(|w| self.between_mm(&w[0], &w[1])).sum()
    }
}

/// To more ends than this, the nearest ones, no shorter way is sought from one end: it counts as over the safe level.
const MOST_SOUGHT: usize = 40;
/// Nor more ways than this in all: some seconds.
const MOST_WAYS: usize = 6_000;
/// Of more seams no order is sought: the ways between all ends would take gigabytes.
pub const MOST_ORDERED: usize = 2_000;

/// All turns, each at its [`place`].
fn every_turn(count: usize) -> impl Iterator<Item = Turn> {
    (0..count).flat_map(|index| [false, true].map(|reverse| Turn { index, reverse }))
}

fn place(turn: &Turn) -> usize {
    2 * turn.index + usize::from(turn.reverse)
}

/// The way of a seam that forbids this direction.
fn opposite(reverse: bool) -> AllowedDirection {
    if reverse { AllowedDirection::Forward } else { AllowedDirection::Reverse }
}

/// The order found, each seam in the direction that it must have.
pub fn found(ways: &[AllowedDirection]) -> Vec<Turn> {
    (0..ways.len()).map(|index| Turn { index, reverse: ways[index] == AllowedDirection::Reverse }).collect()
}

/// The order with the least air way: exactly for up to nine seams, as local search finds it for more. The order found
/// where no other is shorter.
pub fn shortest(air: &AirWays) -> Vec<Turn> {
    let found = found(&air.ways);
    let best = if air.len() <= MOST_EXACT { least(air) } else { searched(air) };
    if air.air_mm(&best) < air.air_mm(&found) - GAIN_MM { best } else { found }
}

/// Most seams for which the optimum is computed: 2⁹ sets of seams by 18 ways to be at the last.
const MOST_EXACT: usize = 9;

/// The best order of every set of seams by its last turn, built from the sets with one seam less.
fn least(air: &AirWays) -> Vec<Turn> {
    let every: Vec<Turn> = (0..air.len()).flat_map(|index| turns(index, air)).collect();
    let mut best: Vec<Vec<Turn>> = every.iter().map(|turn| vec![*turn]).collect();
    for _ in 1..air.len() {
        let mut longer: HashMap<(u32, Turn), Vec<Turn>> = HashMap::new();
        go_on();
        for (order, next) in best.iter().flat_map(|order| every.iter().map(move |next| (order, next))) {
            if order.iter().any(|turn| turn.index == next.index) {
                continue;
            }
            let extended: Vec<Turn> = order.iter().chain([next]).copied().collect();
            let set = extended.iter().fold(0, |set, turn| set | 1_u32 << turn.index);
            match longer.entry((set, *next)) {
                Entry::Vacant(place) => drop(place.insert(extended)),
                Entry::Occupied(mut known) => {
                    if air.air_mm(&extended) < air.air_mm(known.get()) - GAIN_MM {
                        known.insert(extended);
                    }
                }
            }
        }
        best = longer.into_values().collect();
        // A map has no order of its own, and the result must not depend on it.
        best.sort_unstable();
    }
    let length_mm = |order: &&Vec<Turn>| air.air_mm(order);
    best.iter().min_by(|a, b| length_mm(a).total_cmp(&length_mm(b))).cloned().unwrap_or_default()
}

fn searched(air: &AirWays) -> Vec<Turn> {
    let mut tries_left = MOST_TRIES;
    let mut best = improved(found(&air.ways), air, &mut tries_left);
    for start in 0..air.len().min(MOST_STARTS) {
        if tries_left == 0 {
            break;
        }
        let other = improved(nearest_neighbours(start, air), air, &mut tries_left);
        if air.air_mm(&other) < air.air_mm(&best) - GAIN_MM {
            best = other;
        }
    }
    best
}

/// Less than this is no improvement, mm.
const GAIN_MM: f64 = 1e-6;
/// Largest number of starts of the local search: further ones cost more time than they save air moves.
const MOST_STARTS: usize = 40;
/// Most seams that are moved together.
const MOST_MOVED: usize = 3;
/// Steps that are tried in all: a second or two. A hundred seams need fewer for all their starts.
const MOST_TRIES: usize = 40_000_000;

fn nearest_neighbours(start: usize, air: &AirWays) -> Vec<Turn> {
    let reverse = air.ways[start] == AllowedDirection::Reverse;
    let mut order = vec![Turn { index: start, reverse }];
    let mut left: Vec<usize> = (0..air.len()).filter(|&index| index != start).collect();
    while !left.is_empty() {
        let candidates = left.iter().flat_map(|&index| turns(index, air));
        let here = order[order.len() - 1];
        let away = |turn: &Turn| air.between_mm(&here, turn);
        let Some(next) = candidates.min_by(|a, b| away(a).total_cmp(&away(b))) else { break };
        left.retain(|&index| index != next.index);
        order.push(next);
    }
    order
}

/// The ways in which a seam may be welded.
fn turns(index: usize, air: &AirWays) -> impl Iterator<Item = Turn> + use<> {
    let way = air.ways[index];
    let forward = (way != AllowedDirection::Reverse).then_some(Turn { index, reverse: false });
    let reverse = (way != AllowedDirection::Forward).then_some(Turn { index, reverse: true });
    forward.into_iter().chain(reverse)
}

/// Takes every step that makes the order shorter, until none does.
fn improved(order: Vec<Turn>, air: &AirWays, tries_left: &mut usize) -> Vec<Turn> {
    let mut chain = Chain::new(order, air);
    loop {
        let before_mm = chain.length_mm();
        (0..chain.order.len()).for_each(|from| chain.turn_round(from, tries_left));
        (0..chain.order.len()).for_each(|from| chain.move_from(from, tries_left));
        if chain.length_mm() > before_mm - GAIN_MM || *tries_left == 0 {
            return chain.order;
        }
    }
}

/// An order, with what makes a step cheap to try: how far each of its turns lies from the first, as it stands and turned round.
struct Chain<'a> {
    air: &'a AirWays,
    order: Vec<Turn>,
    /// To each turn, along the order, mm.
    forward_mm: Vec<f64>,
    /// From each turn back to the first, each of them turned round, mm.
    back_mm: Vec<f64>,
}

impl<'a> Chain<'a> {
    fn new(order: Vec<Turn>, air: &'a AirWays) -> Self {
        let mut chain = Self { air, order, forward_mm: Vec::new(), back_mm: Vec::new() };
        chain.measure();
        chain
    }

    fn measure(&mut self) {
        let Self { air, order, .. } = self;
        let sums = |way_mm: &dyn Fn(&Turn, &Turn) -> f64| -> Vec<f64> {
            let steps = order.windows(2).map(|w| way_mm(&w[0], &w[1]));
            let sum = |sum: &mut f64, step: f64| Some(std::mem::replace(sum, *sum + step));
            steps.chain([0.0]).scan(0.0, sum).collect()
        };
        let forward_mm = sums(&|a, b| air.between_mm(a, b));
        let back_mm = sums(&|a, b| air.between_mm(&flipped(*b, air), &flipped(*a, air)));
        (self.forward_mm, self.back_mm) = (forward_mm, back_mm);
    }

    fn length_mm(&self) -> f64 {
        self.forward_mm.last().copied().unwrap_or(0.0)
    }

    /// From the turn at one place to that at another; nothing beyond either end.
    fn way_mm(&self, from: Option<&Turn>, to: Option<&Turn>) -> f64 {
        from.zip(to).map_or(0.0, |(from, to)| self.air.between_mm(from, to))
    }

    fn before(&self, at: usize) -> Option<&Turn> {
        self.order.get(at.wrapping_sub(1))
    }

    /// Along the order between two places, both of which it has.
    fn along_mm(&self, from: usize, to: usize) -> f64 {
        self.forward_mm[to] - self.forward_mm[from]
    }

    /// Turns round every stretch from here that gains by it.
    fn turn_round(&mut self, from: usize, tries_left: &mut usize) {
        go_on();
        for to in from + 1..=self.order.len() {
            *tries_left = tries_left.saturating_sub(1);
            let (first, last) = (flipped(self.order[from], self.air), flipped(self.order[to - 1], self.air));
            let (before, after) = (self.before(from), self.order.get(to));
            let now_mm = self.way_mm(before, Some(&self.order[from]))
                + self.along_mm(from, to - 1)
                + self.way_mm(Some(&self.order[to - 1]), after);
            let then_mm = self.way_mm(before, Some(&last)) + self.back_mm[to - 1] - self.back_mm[from]
                + self.way_mm(Some(&first), after);
            if then_mm < now_mm - GAIN_MM {
                turned(&mut self.order[from..to], self.air);
                self.measure();
            }
        }
    }

    /// Moves the one, two or three turns from here to where they gain most, turned round or not.
    fn move_from(&mut self, from: usize, tries_left: &mut usize) {
        go_on();
        for to in from + 1..=(from + MOST_MOVED).min(self.order.len()) {
            let taken = [false, true].map(|turn| {
                let mut taken = self.order[from..to].to_vec();
                if turn {
                    turned(&mut taken, self.air);
                }
                taken
            });
            let inner_mm = [self.along_mm(from, to - 1), self.back_mm[to - 1] - self.back_mm[from]];
            let (before, after) = (self.before(from), self.order.get(to));
            let saved_mm = self.way_mm(before, Some(&self.order[from]))
                + inner_mm[0]
                + self.way_mm(Some(&self.order[to - 1]), after)
                - self.way_mm(before, after);
            let places = (0..from).chain(to + 1..=self.order.len());
            let costs = places.flat_map(|at| [0, 1].map(|turn| (at, turn))).map(|(at, turn)| {
                let (before, after) = (self.before(at), self.order.get(at));
                let [first, .., last] = [&taken[turn][0], &taken[turn][to - from - 1]];
                let cost_mm =
                    self.way_mm(before, Some(first)) + inner_mm[turn] + self.way_mm(Some(last), after)
                        - self.way_mm(before, after);
                (cost_mm, at, turn)
            });
            *tries_left = tries_left.saturating_sub(2 * self.order.len());
            let Some((cost_mm, at, turn)) = costs.min_by(|a, b| a.0.total_cmp(&b.0)) else { continue };
            if cost_mm < saved_mm - GAIN_MM {
                self.order.drain(from..to);
                let at = if at > from { at - (to - from) } else { at };
                self.order.splice(at..at, taken[turn].iter().copied());
                self.measure();
            }
        }
    }
}

/// Turns a stretch round, with every seam in it that may be welded both ways.
fn turned(stretch: &mut [Turn], air: &AirWays) {
    stretch.reverse();
    stretch.iter_mut().for_each(|turn| *turn = flipped(*turn, air));
}

/// The other way round, if the seam may be welded so.
fn flipped(turn: Turn, air: &AirWays) -> Turn {
    let free = air.ways[turn.index] == AllowedDirection::Free;
    Turn { reverse: turn.reverse != free, ..turn }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::weld::{PathPoint, Process};
    use nalgebra::{Point3, UnitQuaternion, Vector3};

    /// SplitMix64.
    struct Random(u64);

    impl Random {
        fn new(seed: u64) -> Self {
            Self(seed)
        }

        /// Uniform in [0, 1).
        fn unit(&mut self) -> f64 {
            self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let a = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let b = (a ^ (a >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((b ^ (b >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
        }
    }

    /// Straight ways between seams from a place to another.
    fn straight(seams: &[([Point3<f64>; 2], AllowedDirection)]) -> AirWays {
        let place = |turn: &Turn, end: usize| seams[turn.index].0[end ^ usize::from(turn.reverse)];
        let turns: Vec<Turn> = every_turn(seams.len()).collect();
        let between = |from| turns.iter().map(move |to| (place(to, 0) - place(from, 1)).norm());
        AirWays {
            ways: seams.iter().map(|(_, way)| *way).collect(),
            between_mm: turns.iter().flat_map(between).collect(),
        }
    }

    fn random_air(random: &mut Random, count: usize) -> AirWays {
        let ways = [
            AllowedDirection::Free,
            AllowedDirection::Free,
            AllowedDirection::Forward,
            AllowedDirection::Reverse,
        ];
        let mut seam = |_| {
            let mut place = || Point3::new(random.unit() * 400.0, random.unit() * 300.0, 50.0);
            let ends = [place(), place()];
            (ends, ways[(random.unit() * 3.999) as usize])
        };
        straight(&(0..count).map(&mut seam).collect::<Vec<_>>())
    }

    /// Length of the shortest of all orders, by trying every one.
    fn least_mm(air: &AirWays) -> f64 {
        fn extended(order: &mut Vec<Turn>, air: &AirWays, best: &mut f64) {
            if order.len() == air.len() {
                *best = best.min(air.air_mm(order));
            }
            for index in 0..air.len() {
                if order.iter().all(|turn| turn.index != index) {
                    for turn in turns(index, air) {
                        order.push(turn);
                        extended(order, air, best);
                        order.pop();
                    }
                }
            }
        }
        let mut best = f64::INFINITY;
        extended(&mut Vec::new(), air, &mut best);
        best
    }

    #[test]
    fn every_seam_comes_once_in_a_way_that_it_may_have() {
        let mut random = Random::new(3);
        for count in 0..12 {
            let air = random_air(&mut random, count);
            let order = shortest(&air);
            let mut seen: Vec<usize> = order.iter().map(|turn| turn.index).collect();
            seen.sort_unstable();
            assert_eq!(seen, (0..count).collect::<Vec<_>>());
            for turn in &order {
                let way = air.ways[turn.index];
                assert!(way == AllowedDirection::Free || turn.reverse == (way == AllowedDirection::Reverse));
            }
            assert!(air.air_mm(&order) <= air.air_mm(&found(&air.ways)) + 1e-9);
        }
    }

    #[test]
    fn few_seams_are_ordered_as_well_as_by_trying_every_order() {
        let mut random = Random::new(11);
        for _ in 0..60 {
            let air = random_air(&mut random, 5);
            let (found_mm, least_mm) = (air.air_mm(&shortest(&air)), least_mm(&air));
            assert!((found_mm - least_mm).abs() < 1e-6, "{found_mm} mm instead of {least_mm} mm");
        }
    }

    #[test]
    fn local_search_comes_near_to_the_least_and_never_below_it() {
        let mut random = Random::new(5);
        let (mut searched_mm, mut least_mm) = (0.0, 0.0);
        for _ in 0..30 {
            let air = random_air(&mut random, 8);
            let pair = [searched(&air), least(&air)].map(|order| air.air_mm(&order));
            assert!(pair[0] >= pair[1] - 1e-6, "the optimum is not one: {pair:?}");
            (searched_mm, least_mm) = (searched_mm + pair[0], least_mm + pair[1]);
        }
        assert!(searched_mm < 1.1 * least_mm, "{searched_mm} mm against {least_mm} mm");
    }

    #[test]
    fn parallel_seams_are_welded_there_and_back() {
        let seam = |k: usize| {
            let y_mm = 40.0 * k as f64;
            ([Point3::new(0.0, y_mm, 0.0), Point3::new(300.0, y_mm, 0.0)], AllowedDirection::Free)
        };
        let air = straight(&[2, 0, 3, 1].map(seam));
        let order = shortest(&air);
        assert!((air.air_mm(&order) - 120.0).abs() < 1e-9, "{order:?}");
        assert!(order.windows(2).all(|w| w[0].reverse != w[1].reverse));
    }

    #[test]
    fn uphill_is_against_gravity_and_level_seams_are_free() {
        let line = |end: Point3<f64>| {
            let at = |share: f64| PathPoint {
                s_mm: 0.0,
                position_mm: Point3::from(end.coords * share),
                base_from_torch: UnitQuaternion::identity(),
                process: Process::default(),
            };
            SeamPath { seam: 1, points: vec![at(0.0), at(0.5), at(1.0)] }
        };
        let up = Vector3::z_axis();
        assert_eq!(uphill(&line(Point3::new(0.0, 0.0, 90.0)), up), AllowedDirection::Forward);
        assert_eq!(uphill(&line(Point3::new(0.0, 0.0, -90.0)), up), AllowedDirection::Reverse);
        assert_eq!(uphill(&line(Point3::new(90.0, 0.0, 20.0)), up), AllowedDirection::Free);
        assert_eq!(uphill(&line(Point3::new(90.0, 0.0, -40.0)), up), AllowedDirection::Reverse);
        assert_eq!(
            uphill(&line(Point3::new(0.0, 0.0, 90.0)), -up),
            AllowedDirection::Reverse,
            "a robot that hangs"
        );
    }
}
