//! Which seam comes next, and which way it is welded (ours).
//!
//! The air way between two seams is the one that the torch really takes: out to the safe level above everything that
//! was scanned, across, and down. What lies between a seam's end and the safe level is the same in every order, so
//! the sum of the ways across is made small. For few seams it is the least there is (Held and Karp 1962). For more it is
//! what local search finds: from the order found, and from the nearest neighbour of every seam, by turning stretches
//! round (2-opt), moving up to three seams elsewhere (Or-opt) and turning single seams round, until nothing helps.
//! Seams that must keep their direction keep it.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use nalgebra::{Point3, UnitVector3};

use super::SeamPath;
use super::air::Surroundings;
use super::program::Motion;

/// Which way a seam may be welded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
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
pub fn uphill(path: &SeamPath, up: UnitVector3<f64>) -> Way {
    let [first, .., last] = path.points.as_slice() else { return Way::Free };
    let rise_mm = up.dot(&(last.position_mm - first.position_mm));
    match rise_mm {
        level if level.abs() <= LEVEL * path.length_mm() => Way::Free,
        down if down < 0.0 => Way::Reverse,
        _ => Way::Forward,
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

/// Where the air moves of a seam leave for and come from the safe level, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gates {
    /// Above its start.
    pub start_mm: Point3<f64>,
    /// Above its end.
    pub end_mm: Point3<f64>,
    /// Which way it may be welded.
    pub way: Way,
}

impl Gates {
    /// Of a path in its surroundings; none for a path of fewer than two points.
    pub fn new(path: &SeamPath, way: Way, around: &Surroundings, motion: &Motion) -> Option<Self> {
        let [first, .., last] = path.points.as_slice() else { return None };
        let gate = |point: &super::PathPoint, off_mm: f64| {
            let off_seam_mm = point.position_mm + point.out_of_work() * off_mm;
            let way_out = around.way_out(off_seam_mm, point.out_of_work(), off_mm);
            way_out.via_mm.last().copied().unwrap_or(off_seam_mm)
        };
        Some(Self { start_mm: gate(first, motion.approach_mm), end_mm: gate(last, motion.retract_mm), way })
    }

    fn ends_mm(&self, reverse: bool) -> (Point3<f64>, Point3<f64>) {
        if reverse { (self.end_mm, self.start_mm) } else { (self.start_mm, self.end_mm) }
    }
}

/// The order found, each seam in the direction that it must have.
pub fn found(gates: &[Gates]) -> Vec<Turn> {
    (0..gates.len()).map(|index| Turn { index, reverse: gates[index].way == Way::Reverse }).collect()
}

/// The order with the least air way: exactly for up to nine seams, as local search finds it for more. The order found
/// where no other is shorter.
pub fn shortest(gates: &[Gates]) -> Vec<Turn> {
    let found = found(gates);
    let best = if gates.len() <= MOST_EXACT { least(gates) } else { searched(gates) };
    if air_mm(&best, gates) < air_mm(&found, gates) - GAIN_MM { best } else { found }
}

/// Most seams for which the optimum is computed: 2⁹ sets of seams by 18 ways to be at the last.
const MOST_EXACT: usize = 9;

/// The best order of every set of seams by its last turn, built from the sets with one seam less.
fn least(gates: &[Gates]) -> Vec<Turn> {
    let every: Vec<Turn> = (0..gates.len()).flat_map(|index| turns(index, gates)).collect();
    let mut best: Vec<Vec<Turn>> = every.iter().map(|turn| vec![*turn]).collect();
    for _ in 1..gates.len() {
        let mut longer: HashMap<(u32, Turn), Vec<Turn>> = HashMap::new();
        for (order, next) in best.iter().flat_map(|order| every.iter().map(move |next| (order, next))) {
            if order.iter().any(|turn| turn.index == next.index) {
                continue;
            }
            let extended: Vec<Turn> = order.iter().chain([next]).copied().collect();
            let set = extended.iter().fold(0, |set, turn| set | 1_u32 << turn.index);
            match longer.entry((set, *next)) {
                Entry::Vacant(place) => drop(place.insert(extended)),
                Entry::Occupied(mut known) => {
                    if air_mm(&extended, gates) < air_mm(known.get(), gates) - GAIN_MM {
                        known.insert(extended);
                    }
                }
            }
        }
        best = longer.into_values().collect();
        // A map has no order of its own, and the result must not depend on it.
        best.sort_unstable();
    }
    let length_mm = |order: &&Vec<Turn>| air_mm(order, gates);
    best.iter().min_by(|a, b| length_mm(a).total_cmp(&length_mm(b))).cloned().unwrap_or_default()
}

fn searched(gates: &[Gates]) -> Vec<Turn> {
    let mut best = improved(found(gates), gates);
    for start in 0..gates.len().min(MOST_STARTS) {
        let other = improved(nearest_neighbours(start, gates), gates);
        if air_mm(&other, gates) < air_mm(&best, gates) - GAIN_MM {
            best = other;
        }
    }
    best
}

/// Sum of the ways across, mm.
pub fn air_mm(order: &[Turn], gates: &[Gates]) -> f64 {
    let ends = |turn: &Turn| gates[turn.index].ends_mm(turn.reverse);
    order.windows(2).map(|w| (ends(&w[1]).0 - ends(&w[0]).1).norm()).sum()
}

/// Less than this is no improvement, mm.
const GAIN_MM: f64 = 1e-6;
/// Beyond so many seams more starts cost more than they bring.
const MOST_STARTS: usize = 40;
/// Most seams that are moved together.
const MOST_MOVED: usize = 3;
/// Rounds of improvement; each is shorter than the one before, and real parts need a few.
const MOST_ROUNDS: usize = 200;

fn nearest_neighbours(start: usize, gates: &[Gates]) -> Vec<Turn> {
    let reverse = gates[start].way == Way::Reverse;
    let mut order = vec![Turn { index: start, reverse }];
    let mut left: Vec<usize> = (0..gates.len()).filter(|&index| index != start).collect();
    while !left.is_empty() {
        let candidates = left.iter().flat_map(|&index| turns(index, gates));
        let here = order[order.len() - 1];
        let away = |turn: &Turn| air_mm(&[here, *turn], gates);
        let Some(next) = candidates.min_by(|a, b| away(a).total_cmp(&away(b))) else { break };
        left.retain(|&index| index != next.index);
        order.push(next);
    }
    order
}

/// The ways in which a seam may be welded.
fn turns(index: usize, gates: &[Gates]) -> impl Iterator<Item = Turn> + use<> {
    let way = gates[index].way;
    let forward = (way != Way::Reverse).then_some(Turn { index, reverse: false });
    let reverse = (way != Way::Forward).then_some(Turn { index, reverse: true });
    forward.into_iter().chain(reverse)
}

/// Takes the first improvement of each round until there is none.
fn improved(mut order: Vec<Turn>, gates: &[Gates]) -> Vec<Turn> {
    for _ in 0..MOST_ROUNDS {
        let length_mm = air_mm(&order, gates);
        let shorter = neighbours(&order, gates).find(|other| air_mm(other, gates) < length_mm - GAIN_MM);
        match shorter {
            Some(shorter) => order = shorter,
            None => break,
        }
    }
    order
}

/// Orders that differ by one step from this one.
fn neighbours<'a>(order: &'a [Turn], gates: &'a [Gates]) -> impl Iterator<Item = Vec<Turn>> + 'a {
    let count = order.len();
    let stretches = (0..count).flat_map(move |from| (from + 1..=count).map(move |to| (from, to)));
    let turned = stretches.clone().map(move |(from, to)| {
        let mut other = order.to_vec();
        other[from..to].reverse();
        other[from..to].iter_mut().for_each(|turn| *turn = flipped(*turn, gates));
        other
    });
    let moved = stretches.filter(|(from, to)| to - from <= MOST_MOVED).flat_map(move |(from, to)| {
        (0..=count - (to - from)).flat_map(move |at| {
            [false, true].map(|flip| {
                let mut rest = order.to_vec();
                let mut taken: Vec<Turn> = rest.drain(from..to).collect();
                if flip {
                    taken.reverse();
                    taken.iter_mut().for_each(|turn| *turn = flipped(*turn, gates));
                }
                rest.splice(at..at, taken);
                rest
            })
        })
    });
    turned.chain(moved)
}

/// The other way round, if the seam may be welded so.
fn flipped(turn: Turn, gates: &[Gates]) -> Turn {
    let free = gates[turn.index].way == Way::Free;
    Turn { reverse: turn.reverse != free, ..turn }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::toolpath::{PathPoint, Process};
    use nalgebra::{UnitQuaternion, Vector3};

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

    fn random_gates(random: &mut Random, count: usize) -> Vec<Gates> {
        let ways = [Way::Free, Way::Free, Way::Forward, Way::Reverse];
        (0..count)
            .map(|_| {
                let mut place = || Point3::new(random.unit() * 400.0, random.unit() * 300.0, 50.0);
                let (start_mm, end_mm) = (place(), place());
                let way = ways[(random.unit() * 3.999) as usize];
                Gates { start_mm, end_mm, way }
            })
            .collect()
    }

    /// Length of the shortest of all orders, by trying every one.
    fn least_mm(gates: &[Gates]) -> f64 {
        fn extended(order: &mut Vec<Turn>, gates: &[Gates], best: &mut f64) {
            if order.len() == gates.len() {
                *best = best.min(air_mm(order, gates));
            }
            for index in 0..gates.len() {
                if order.iter().all(|turn| turn.index != index) {
                    for turn in turns(index, gates) {
                        order.push(turn);
                        extended(order, gates, best);
                        order.pop();
                    }
                }
            }
        }
        let mut best = f64::INFINITY;
        extended(&mut Vec::new(), gates, &mut best);
        best
    }

    #[test]
    fn every_seam_comes_once_in_a_way_that_it_may_have() {
        let mut random = Random::new(3);
        for count in 0..12 {
            let gates = random_gates(&mut random, count);
            let order = shortest(&gates);
            let mut seen: Vec<usize> = order.iter().map(|turn| turn.index).collect();
            seen.sort_unstable();
            assert_eq!(seen, (0..count).collect::<Vec<_>>());
            for turn in &order {
                let way = gates[turn.index].way;
                assert!(way == Way::Free || turn.reverse == (way == Way::Reverse));
            }
            assert!(air_mm(&order, &gates) <= air_mm(&found(&gates), &gates) + 1e-9);
        }
    }

    #[test]
    fn few_seams_are_ordered_as_well_as_by_trying_every_order() {
        let mut random = Random::new(11);
        for _ in 0..60 {
            let gates = random_gates(&mut random, 5);
            let (found_mm, least_mm) = (air_mm(&shortest(&gates), &gates), least_mm(&gates));
            assert!((found_mm - least_mm).abs() < 1e-6, "{found_mm} mm instead of {least_mm} mm");
        }
    }

    #[test]
    fn local_search_comes_near_to_the_least_and_never_below_it() {
        let mut random = Random::new(5);
        let (mut searched_mm, mut least_mm) = (0.0, 0.0);
        for _ in 0..30 {
            let gates = random_gates(&mut random, 8);
            let pair = [searched(&gates), least(&gates)].map(|order| air_mm(&order, &gates));
            assert!(pair[0] >= pair[1] - 1e-6, "the optimum is not one: {pair:?}");
            (searched_mm, least_mm) = (searched_mm + pair[0], least_mm + pair[1]);
        }
        assert!(searched_mm < 1.1 * least_mm, "{searched_mm} mm against {least_mm} mm");
    }

    #[test]
    fn parallel_seams_are_welded_there_and_back() {
        let gate = |k: usize| Gates {
            start_mm: Point3::new(0.0, 40.0 * k as f64, 0.0),
            end_mm: Point3::new(300.0, 40.0 * k as f64, 0.0),
            way: Way::Free,
        };
        let gates: Vec<Gates> = [2, 0, 3, 1].map(gate).to_vec();
        let order = shortest(&gates);
        assert!((air_mm(&order, &gates) - 120.0).abs() < 1e-9, "{order:?}");
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
        assert_eq!(uphill(&line(Point3::new(0.0, 0.0, 90.0)), up), Way::Forward);
        assert_eq!(uphill(&line(Point3::new(0.0, 0.0, -90.0)), up), Way::Reverse);
        assert_eq!(uphill(&line(Point3::new(90.0, 0.0, 20.0)), up), Way::Free);
        assert_eq!(uphill(&line(Point3::new(90.0, 0.0, -40.0)), up), Way::Reverse);
        assert_eq!(uphill(&line(Point3::new(0.0, 0.0, 90.0)), -up), Way::Reverse, "a robot that hangs");
    }
}
