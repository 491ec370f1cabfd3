//! Seams that are asked for by clicks: each seam of the simulated pieces kept from the search in turn, and places where none is.
//! Truth is the simulator's.

use nalgebra::Point3;
use weldpath::evaluation::Target;
use weldpath::pipeline::{Plan, Wishes};
use weldpath::seam::Seam;

use crate::planned::{PIECES, Piece};

/// A click is at most this far from the seam, mm.
const CLICK_MM: f64 = 10.0;
/// Places of a curved seam that are clicked.
const CURVED_CLICKS: usize = 9;
/// A seam whose middle is no farther from its chord is clicked at both ends, mm.
const STRAIGHT_MM: f64 = 3.0;

/// Numbers that look random, the same in every run.
struct Dice(u64);

impl Dice {
    fn below(&mut self, most: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % most
    }
}

impl Piece {
    fn asked(&self, asked: Vec<Vec<Point3<f64>>>, kept_back: Vec<Point3<f64>>) -> Plan {
        self.with(Wishes { asked, kept_back, drawn: Vec::new() }).expect("a plan")
    }

    /// A point of the cloud no farther than a click may be from a place of a seam.
    fn click(&self, at: &Point3<f64>, dice: &mut Dice) -> Point3<f64> {
        let points = (0..self.plan.model.len()).map(|k| self.plan.model.in_base_mm(k));
        let near: Vec<_> = points.filter(|p| (p - at).norm() < CLICK_MM).collect();
        near[dice.below(near.len())]
    }

    /// Where a person clicks who means this seam.
    fn clicks(&self, seam: &Seam, dice: &mut Dice) -> Vec<Point3<f64>> {
        let places: Vec<_> = seam.stations.iter().map(|station| station.position_mm).collect();
        let (first, last) = (places[0], places[places.len() - 1]);
        let chord = (last - first).normalize();
        let off_mm = |p: &Point3<f64>| (p - first - chord * (p - first).dot(&chord)).norm();
        let straight = !seam.closed && places.iter().all(|p| off_mm(p) < STRAIGHT_MM);
        let count = if straight { 2 } else { CURVED_CLICKS };
        let at = |k: usize| places[(places.len() - 1) * k / (count - 1)];
        let mut clicks: Vec<_> = (0..count).map(|k| self.click(&at(k), dice)).collect();
        if seam.closed {
            clicks[count - 1] = clicks[0];
        }
        clicks
    }

    /// The true seams.
    fn lines(&self) -> Vec<Line> {
        self.truth.seams.iter().map(|seam| Line::new(seam.line(Target::Root))).collect()
    }

    /// How far a seam is from the true ones, root mean square, mm.
    fn error_mm(&self, seam: &Seam) -> f64 {
        let lines = self.lines();
        let nearest = |p: &Point3<f64>| lines.iter().fold(f64::MAX, |best, line| line.away_mm(p, best));
        let sum: f64 = seam.stations.iter().map(|station| nearest(&station.position_mm).powi(2)).sum();
        (sum / seam.stations.len() as f64).sqrt()
    }
}

/// A polyline whose points are no farther apart than this, mm.
struct Line {
    points: Vec<Point3<f64>>,
    spacing_mm: f64,
}

impl Line {
    fn new(points: &[[f64; 3]]) -> Self {
        let points: Vec<_> = points.iter().copied().map(Point3::from).collect();
        let spacing_mm = points.windows(2).map(|pair| (pair[1] - pair[0]).norm()).fold(1e-6, f64::max);
        Self { points, spacing_mm }
    }

    /// Distance from a point; `most_mm` where it is no less. From a point of the line that is farther away, as many more are
    /// passed over as it takes to come nearer.
    fn away_mm(&self, p: &Point3<f64>, most_mm: f64) -> f64 {
        let (mut best, mut k) = (most_mm, 0);
        while let Some([a, b]) = self.points.get(k..k + 2) {
            let passed = (((p - a).norm() - best) / self.spacing_mm) as usize;
            if passed == 0 {
                let along = ((p - a).dot(&(b - a)) / (b - a).norm_squared()).clamp(0.0, 1.0);
                best = best.min((p - (a + (b - a) * along)).norm());
            }
            k += passed.max(1);
        }
        best
    }
}

/// Share of the stations of one seam that another runs beside.
fn covered(seam: &Seam, by: &Seam) -> f64 {
    let beside = seam
        .stations
        .iter()
        .filter(|s| by.stations.iter().any(|b| (s.position_mm - b.position_mm).norm() < 3.0));
    beside.count() as f64 / seam.stations.len() as f64
}

#[test]
fn seams_kept_from_the_search_are_found_where_they_are_clicked() {
    let mut dice = Dice(1);
    let (mut asked, mut found) = (0, 0);
    for piece in PIECES.iter() {
        for seam in &piece.plan.seams {
            let clicks = piece.clicks(seam, &mut dice);
            let middle = seam.stations[seam.stations.len() / 2].position_mm;
            let plan = piece.asked(vec![clicks.clone()], vec![middle]);
            asked += 1;
            let own = plan.seams.iter().find(|one| one.reason.contains("asked for"));
            let name = format!("{} {} ({:.0} mm)", piece.part.name(), seam.id, seam.length_mm());
            let Some(own) = own else {
                println!(
                    "{name}: {:?} {:?} clicks {clicks:?}",
                    plan.said.unmet,
                    plan.said.warnings.iter().filter(|w| w.contains("asked")).collect::<Vec<_>>()
                );
                continue;
            };
            let [auto_mm, own_mm] = [seam, own].map(|seam| piece.error_mm(seam));
            let share = covered(seam, own);
            println!(
                "{name}: {own_mm:.3} mm, found {auto_mm:.3} mm; {:.0} % of it, {:.0} mm; says {:.3} mm, {:?}",
                100.0 * share,
                own.length_mm(),
                own.expected_error_mm,
                own.joint
            );
            // Each of the clicks at its ends may be short of it.
            let missing_mm = (1.0 - share) * seam.length_mm();
            found += usize::from(missing_mm <= 2.0 * CLICK_MM && own_mm <= 1.2 * auto_mm);
        }
    }
    println!("{found} of {asked}");
    assert!(asked >= 20 && found as f64 >= 0.95 * asked as f64, "{found} of {asked}");
}

#[test]
fn where_no_joint_is_nothing_is_added() {
    let mut dice = Dice(2);
    for piece in PIECES.iter().step_by(2) {
        let lines = piece.lines();
        let is_far =
            |p: &Point3<f64>| lines.iter().all(|line| line.away_mm(p, 2.0 * CLICK_MM) >= 2.0 * CLICK_MM);
        let points: Vec<_> = (0..piece.plan.model.len()).map(|k| piece.plan.model.in_base_mm(k)).collect();
        let far: Vec<_> = points.into_iter().filter(is_far).collect();
        let mut pair = || {
            let first = far[dice.below(far.len())];
            let beyond: Vec<_> =
                far.iter().filter(|p| (20.0..80.0).contains(&(*p - first).norm())).copied().collect();
            (!beyond.is_empty()).then(|| vec![first, beyond[dice.below(beyond.len())]])
        };
        let asked: Vec<_> = std::iter::repeat_with(&mut pair).take(40).flatten().take(10).collect();
        assert_eq!(asked.len(), 10, "{}", piece.part.name());
        let plan = piece.asked(asked, Vec::new());
        for seam in plan.seams.iter().filter(|seam| seam.reason.contains("asked for")) {
            println!("{}: {} at {:?}", piece.part.name(), seam.reason, seam.stations[0].position_mm);
        }
        assert_eq!(plan.seams.len(), piece.plan.seams.len(), "{}: a seam is invented", piece.part.name());
        assert!(plan.said.unmet.iter().all(|words| words.contains("asked for: ")), "{:?}", plan.said.unmet);
    }
}

#[test]
fn a_seam_that_is_there_anyway_is_named_and_not_added_twice() {
    let piece = &PIECES[0];
    let clicks: Vec<_> = piece.plan.seams.iter().map(|seam| piece.clicks(seam, &mut Dice(3))).collect();
    let plan = piece.asked(clicks, Vec::new());
    assert_eq!(plan.seams.len(), piece.plan.seams.len());
    let named = plan.said.warnings.iter().filter(|words| words.contains("which is found without asking"));
    assert_eq!(named.count(), piece.plan.seams.len(), "{:?} {:?}", plan.said.warnings, plan.said.unmet);
}
