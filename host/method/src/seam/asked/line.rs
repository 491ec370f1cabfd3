//! The line that a person clicked: straight from each place to the next. Millimetres, from the cloud's origin.

use nalgebra::{Point3, Vector3};

/// A clicked place is at most this far from the seam that is meant, mm.
pub(super) const REACH_MM: f32 = 10.0;
/// What a click's own place may be wrong by: the point of the cloud that is hit is beside the one that was meant, mm.
const SLACK_MM: f32 = 1.0;
/// A corner may be meant up to here, mm.
pub(super) const MEANT_MM: f32 = REACH_MM + SLACK_MM;
/// A corner is followed so far past both ends, to see whether the seam goes on there, mm.
const PAST_MM: f32 = 2.0 * REACH_MM;
/// Places nearer to each other than this show no direction, mm.
const LEAST_APART_MM: f32 = 0.1;
/// Cosine of the largest angle between the line and the seam: two clicks 25 mm apart, each 10 mm off on another side.
const ALONG: f32 = 0.75;
/// Fewest places of a loop; the last of them is the first again.
const LEAST_OF_LOOP: usize = 4;

/// Places in their order.
pub(super) struct AskedLine {
    places: Vec<Point3<f32>>,
    /// Whether the last place is the first again.
    pub(super) is_loop: bool,
}

/// Where the perpendicular from a point meets the line, or the line straight on past its ends.
struct LineFoot {
    /// From the first place, negative before it, mm.
    s_mm: f32,
    away_mm: f32,
    direction: Vector3<f32>,
}

impl AskedLine {
    /// None if the places show no direction.
    pub(super) fn new(mut places: Vec<Point3<f32>>) -> Option<Self> {
        places.dedup_by(|b, a| (*b - *a).norm() < LEAST_APART_MM);
        let (first, last) = (*places.first()?, *places.last()?);
        let is_loop = places.len() >= LEAST_OF_LOOP && (last - first).norm() <= REACH_MM;
        (places.len() > 1).then_some(Self { places, is_loop })
    }

    /// Along the places, mm.
    pub(super) fn length_mm(&self) -> f32 {
        self.places.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum()
    }

    fn foot(&self, p: &Point3<f32>) -> LineFoot {
        let last = self.places.len() - 2;
        let past_mm = if self.is_loop { 0.0 } else { PAST_MM };
        let mut from_mm = 0.0;
        let mut best = LineFoot { s_mm: 0.0, away_mm: f32::INFINITY, direction: Vector3::x() };
        for (k, pair) in self.places.windows(2).enumerate() {
            let chord = pair[1] - pair[0];
            let length_mm = chord.norm();
            let direction = chord / length_mm;
            let least = if k == 0 { -past_mm } else { 0.0 };
            let most = if k == last { length_mm + past_mm } else { length_mm };
            let along = (p - pair[0]).dot(&direction).clamp(least, most);
            let away_mm = (p - (pair[0] + direction * along)).norm();
            if away_mm < best.away_mm {
                best = LineFoot { s_mm: from_mm + along, away_mm, direction };
            }
            from_mm += length_mm;
        }
        best
    }

    /// Distance of a point from the line, or from the line straight on past its ends, mm.
    pub(super) fn away_mm(&self, p: &Point3<f32>) -> f32 {
        self.foot(p).away_mm
    }

    /// Whether a corner here, in this direction, may be of the seam that is meant.
    pub(super) fn may_mean(&self, p: &Point3<f32>, direction: &Vector3<f32>) -> bool {
        let foot = self.foot(p);
        foot.away_mm <= MEANT_MM && foot.direction.dot(direction).abs() >= ALONG
    }

    /// Share of the line, without what a click may be off at either end, beside which these stations lie.
    pub(super) fn covered(&self, stations: &[Point3<f32>]) -> f32 {
        let length_mm = self.length_mm();
        let feet = stations.iter().map(|p| self.foot(p).s_mm.clamp(0.0, length_mm));
        let (low, high) = feet.fold((f32::INFINITY, 0.0_f32), |(low, high), s| (low.min(s), high.max(s)));
        let meant_mm = (length_mm - 2.0 * REACH_MM).max(0.5 * length_mm);
        ((high - low) / meant_mm).clamp(0.0, 1.0)
    }

    /// Which of a seam's stations are asked for: all up to its own end where that is near a click, else those up to the click.
    pub(super) fn meant(&self, stations: &[Point3<f32>]) -> Vec<bool> {
        let length_mm = self.length_mm();
        let s_mm: Vec<f32> = stations.iter().map(|p| self.foot(p).s_mm).collect();
        let goes_on_before = s_mm.iter().any(|s| *s < -REACH_MM);
        let goes_on_behind = s_mm.iter().any(|s| *s > length_mm + REACH_MM);
        let meant = |s: f32| !(goes_on_before && s < 0.0 || goes_on_behind && s > length_mm);
        s_mm.into_iter().map(|s| self.is_loop || meant(s)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(places: &[[f32; 3]]) -> AskedLine {
        AskedLine::new(places.iter().map(|p| Point3::from(*p)).collect()).unwrap()
    }

    fn along_x(from_mm: i32, to_mm: i32) -> Vec<Point3<f32>> {
        (from_mm..=to_mm).map(|x| Point3::new(x as f32, 8.0, 0.0)).collect()
    }

    #[test]
    fn one_place_is_no_line_and_four_that_come_back_are_a_loop() {
        assert!(AskedLine::new(vec![Point3::origin(); 3]).is_none());
        assert!(!line(&[[0.0; 3], [50.0, 0.0, 0.0]]).is_loop);
        assert!(line(&[[0.0; 3], [50.0, 0.0, 0.0], [50.0, 50.0, 0.0], [0.0, 4.0, 0.0]]).is_loop);
    }

    #[test]
    fn a_corner_is_meant_within_ten_millimetres_and_about_along_the_line() {
        let line = line(&[[0.0; 3], [50.0, 0.0, 0.0]]);
        let at = |y: f32, direction: Vector3<f32>| line.may_mean(&Point3::new(20.0, y, 0.0), &direction);
        assert!(at(10.0, Vector3::x()) && at(-10.0, -Vector3::x()));
        assert!(!at(12.0, Vector3::x()) && !at(0.0, Vector3::y()));
    }

    #[test]
    fn a_seam_ends_where_it_ends_near_a_click_and_at_the_click_where_it_goes_on() {
        let line = line(&[[0.0; 3], [50.0, 0.0, 0.0]]);
        let count = |from, to| line.meant(&along_x(from, to)).iter().filter(|meant| **meant).count();
        assert_eq!(count(-9, 58), 68, "both ends are near a click");
        assert_eq!(count(-9, 70), 60, "beyond the second click it goes on");
        assert_eq!(count(-20, 70), 51);
    }

    #[test]
    fn what_is_covered_does_not_count_what_a_click_may_be_off() {
        let line = line(&[[0.0; 3], [100.0, 0.0, 0.0]]);
        assert_eq!(line.covered(&along_x(10, 90)), 1.0);
        assert_eq!(line.covered(&along_x(40, 80)), 0.5);
        assert_eq!(line.covered(&along_x(-30, -10)), 0.0);
    }
}
