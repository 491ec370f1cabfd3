//! The rest of a program, for a pendant that does not remember where it held; and the way to where a path begins.

use nalgebra::{Isometry3, UnitQuaternion};

use weldpath_method::weld::program::{Kind, Waypoint};

/// The lead-in begins this far off the rest's first point, along the torch axis, mm.
const LEAD_IN_MM: f64 = 20.0;
/// Speed of the lead-in and of the approach, mm/s: slower than anything that manual mode bounds.
const SLOW_MM_S: f64 = 20.0;
/// An approach that is not farther than this needs no retract of its own, mm.
const NEAR_MM: f64 = 20.0;

/// Why there is no such rest.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// No such waypoint, or nothing after it.
    #[error("waypoint {at} (counted from 0) is not before the last one of the program's {count}")]
    Waypoint {
        /// As asked for.
        at: usize,
        /// Waypoints of the program.
        count: usize,
    },
    /// Not on the path.
    #[error("{at_mm} mm is not on the path, which is {length_mm:.1} mm long")]
    Length {
        /// As asked for.
        at_mm: f64,
        /// Of the whole path.
        length_mm: f64,
    },
}

/// A program, or the rest of one.
#[derive(Debug, Clone, PartialEq)]
pub struct Rest {
    /// Of a rest: a lead-in along the torch axis, the place to go on from, and the waypoints after it.
    pub waypoints: Vec<Waypoint>,
    /// The waypoint of the whole program at which, or on whose move, it goes on, counted from 0.
    pub at: usize,
    lead_in: usize,
}

impl Rest {
    /// All of it.
    pub fn all(program: Vec<Waypoint>) -> Self {
        Self { waypoints: program, at: 0, lead_in: 0 }
    }

    /// The waypoint of the whole program at which, or on whose move, a waypoint of the rest stands.
    pub fn whole(&self, index: usize) -> usize {
        self.at + index.saturating_sub(self.lead_in)
    }
}

/// The program from waypoint `at` on, counted from 0 as `path.json` has them.
pub fn from_waypoint(program: &[Waypoint], at: usize) -> Result<Rest, Error> {
    let rest = program.get(at..).filter(|rest| rest.len() > 1);
    let rest = rest.ok_or(Error::Waypoint { at, count: program.len() })?;
    Ok(Rest { waypoints: led_in(rest[0], &rest[1..]), at, lead_in: 1 })
}

/// The program from so far along its path on, mm.
pub fn from_mm(program: &[Waypoint], at_mm: f64) -> Result<Rest, Error> {
    let mut passed_mm = 0.0;
    for (index, pair) in program.windows(2).enumerate() {
        let way_mm = (pair[1].position_mm - pair[0].position_mm).norm();
        if (passed_mm..passed_mm + way_mm).contains(&at_mm) {
            let share = (at_mm - passed_mm) / way_mm;
            let first = between(&pair[0], &pair[1], share);
            return Ok(Rest { waypoints: led_in(first, &program[index + 1..]), at: index, lead_in: 1 });
        }
        passed_mm += way_mm;
    }
    Err(Error::Length { at_mm, length_mm: passed_mm })
}

/// A point of a move: of the seam, if both its ends are.
fn between(from: &Waypoint, to: &Waypoint, share: f64) -> Waypoint {
    Waypoint {
        position_mm: from.position_mm + (to.position_mm - from.position_mm) * share,
        base_from_torch: turned(&from.base_from_torch, &to.base_from_torch, share),
        feed_mm_s: to.feed_mm_s,
        weld: from.weld && to.weld && from.seam == to.seam,
        seam: to.seam,
        kind: to.kind,
        dwell_s: None,
    }
}

fn turned(from: &UnitQuaternion<f64>, to: &UnitQuaternion<f64>, share: f64) -> UnitQuaternion<f64> {
    from.try_slerp(to, share, 1e-9).unwrap_or(*to)
}

fn led_in(first: Waypoint, rest: &[Waypoint]) -> Vec<Waypoint> {
    let away = Waypoint { weld: false, kind: Kind::Approach, dwell_s: None, feed_mm_s: SLOW_MM_S, ..first };
    let away = lifted(&away, LEAD_IN_MM);
    let first = Waypoint { feed_mm_s: SLOW_MM_S, ..first };
    [away, first].into_iter().chain(rest.iter().copied()).collect()
}

/// Off the work along the torch axis.
fn lifted(waypoint: &Waypoint, by_mm: f64) -> Waypoint {
    let out = waypoint.base_from_torch * nalgebra::Vector3::z();
    Waypoint { position_mm: waypoint.position_mm + out * by_mm, ..*waypoint }
}

/// A slow way from where the torch is to where a program begins: off the work along the torch axis first, then across at
/// the greater of both heights, then down along the torch axis. Nothing is welded.
pub fn approach(here: &Isometry3<f64>, program: &[Waypoint]) -> Vec<Waypoint> {
    let Some(first) = program.first() else { return Vec::new() };
    let at = |position_mm, base_from_torch| Waypoint {
        position_mm,
        base_from_torch,
        feed_mm_s: SLOW_MM_S,
        weld: false,
        seam: None,
        kind: Kind::Air,
        dwell_s: None,
    };
    let from = at(here.translation.vector.into(), here.rotation);
    let to = at(first.position_mm, first.base_from_torch);
    let way_mm = (to.position_mm - from.position_mm).norm();
    if way_mm <= NEAR_MM {
        return vec![from, lifted(&from, NEAR_MM), lifted(&to, NEAR_MM), to];
    }
    vec![from, lifted(&from, way_mm.min(2.0 * NEAR_MM)), lifted(&to, 2.0 * NEAR_MM), to]
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    fn seam() -> Vec<Waypoint> {
        let at = |x: f64, weld| Waypoint {
            position_mm: Point3::new(x, 0.0, 0.0),
            base_from_torch: UnitQuaternion::identity(),
            feed_mm_s: 10.0,
            weld,
            seam: weld.then_some(1),
            kind: if weld { Kind::Weld } else { Kind::Air },
            dwell_s: None,
        };
        [at(-50.0, false)].into_iter().chain((0..=10).map(|k| at(f64::from(k) * 10.0, true))).collect()
    }

    #[test]
    fn the_rest_begins_off_the_work_and_welds_from_where_it_was_asked_to() {
        let part = from_waypoint(&seam(), 4).unwrap();
        assert_eq!([0, 1, 2, 3].map(|index| part.whole(index)), [4, 4, 5, 6], "as the whole counts");
        let rest = part.waypoints;
        assert_eq!(rest[0].position_mm, Point3::new(30.0, 0.0, 20.0));
        assert!(!rest[0].weld && rest[1].weld && rest[1].position_mm.x == 30.0);
        assert_eq!(rest[1].feed_mm_s, SLOW_MM_S, "slowly in");
        assert_eq!(rest[2..], seam()[5..], "and then as planned");
        let part = from_mm(&seam(), 50.0 + 34.0).unwrap();
        assert_eq!([1, 2].map(|index| part.whole(index)), [4, 5]);
        let rest = part.waypoints;
        assert!((rest[1].position_mm.x - 34.0).abs() < 1e-9 && rest[1].weld);
        assert_eq!(rest[2..], seam()[5..]);
    }

    #[test]
    fn all_of_a_program_counts_as_it_is() {
        let all = Rest::all(seam());
        assert_eq!([0, 1, 11].map(|index| all.whole(index)), [0, 1, 11]);
    }

    #[test]
    fn what_is_not_on_the_path_is_refused_with_its_length() {
        assert_eq!(from_waypoint(&seam(), 11), Err(Error::Waypoint { at: 11, count: 12 }));
        assert_eq!(from_mm(&seam(), 151.0), Err(Error::Length { at_mm: 151.0, length_mm: 150.0 }));
        assert!(from_mm(&seam(), -1.0).is_err());
    }

    #[test]
    fn an_approach_leaves_the_work_along_the_torch_and_welds_nothing() {
        let here = Isometry3::translation(70.0, 0.0, 0.0);
        let way = approach(&here, &seam());
        assert_eq!(way[0].position_mm, Point3::new(70.0, 0.0, 0.0));
        assert!(way[1].position_mm.x == 70.0 && way[1].position_mm.z > 0.0, "retracted first");
        assert_eq!(way.last().unwrap().position_mm, Point3::new(-50.0, 0.0, 0.0));
        assert!(way.iter().all(|waypoint| !waypoint.weld && waypoint.feed_mm_s <= 25.0));
    }
}
