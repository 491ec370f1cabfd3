//! Lines that are drawn on the surface (`[[draw]]`): beads on a plate, a chain along fillets, and what is refused. Truth is the
//! simulator's geometry.

use nalgebra::{Point3, Vector3};
use weldpath::evaluation::Target;
use weldpath::output::verdict::{ReasonId, State};
use weldpath::pipeline::{Plan, PlanError, Wishes};
use weldpath::run::job::Job;
use weldpath::run::planning;
use weldpath::run::postprocessing::{Output, postprocess};
use weldpath::seam::{Joint, Seam};
use weldpath::simulation::Part;

use crate::planned::Piece;

impl Piece {
    fn drawn(&self, drawn: Vec<Vec<Point3<f64>>>) -> Result<Plan, PlanError> {
        self.with(Wishes { drawn, ..Default::default() })
    }

    /// The true root of the seam on the camera's side, with the normals of plate and web.
    fn root(&self) -> ([Point3<f64>; 2], [Vector3<f64>; 2]) {
        let seam = self.truth.seams.iter().find(|seam| seam.required).expect("a seam");
        let line = seam.line(Target::Root);
        let ends = [line[0], line[line.len() - 1]].map(Point3::from);
        (ends, [seam.normal_a[0], seam.normal_b[0]].map(Vector3::from))
    }

    /// Which of the two faces is the plate's: the piece lies flat.
    fn plate(&self) -> (Vector3<f64>, Vector3<f64>) {
        let (_, [a, b]) = self.root();
        if a.z > b.z { (a, b) } else { (b, a) }
    }
}

fn own(plan: &Plan) -> Vec<&Seam> {
    plan.seams.iter().filter(|seam| seam.drawn).collect()
}

/// Root mean square over the stations.
fn rms(seam: &Seam, of: impl Fn(&Point3<f64>) -> f64) -> f64 {
    let squared: f64 = seam.stations.iter().map(|station| of(&station.position_mm).powi(2)).sum();
    (squared / seam.stations.len() as f64).sqrt()
}

/// Root mean square of the angle between torch and truth.
fn torch_off_deg(seam: &Seam, torch: &Vector3<f64>) -> f64 {
    let off = |faces: &[Vector3<f64>; 2]| (faces[0] + faces[1]).angle(torch).to_degrees().powi(2);
    let squared: f64 = seam.stations.iter().map(|station| off(&station.faces)).sum();
    (squared / seam.stations.len() as f64).sqrt()
}

#[test]
fn a_bead_on_a_plate_lies_on_it_with_the_torch_square_to_it_and_says_how_sure_it_is() {
    let fillet = Piece::of(Part::Fillet);
    let ([a, b], _) = fillet.root();
    let (plate, web) = fillet.plate();
    let along = (b - a).normalize();
    // 40 mm in front of the web, its places 4 mm over and under the plate: a bend of 30 mm.
    let at = |along_mm: f64, out_mm: f64, up_mm: f64| a + along * along_mm + web * out_mm + plate * up_mm;
    let places = vec![at(60.0, 40.0, 4.0), at(150.0, 40.0, -4.0), at(200.0, 70.0, 3.0)];
    let planned = fillet.drawn(vec![places.clone()]).expect("a plan");
    let found = own(&planned);
    let [bead] = found[..] else { panic!("{:?} {:?}", planned.said.undrawn, planned.seams) };
    let height_mm = rms(bead, |p| (p - a).dot(&plate));
    let flat = |p: &Point3<f64>| p - plate * (p - a).dot(&plate);
    let line: Vec<Point3<f64>> = places.iter().map(flat).collect();
    let off = |p: &Point3<f64>| line.windows(2).map(|pair| away_mm(&flat(p), pair)).fold(f64::MAX, f64::min);
    let beside_mm = rms(bead, off);
    println!(
        "{height_mm:.3} mm off the plate, {beside_mm:.3} mm off the line; says {:.3}",
        bead.expected_error_mm
    );
    assert!(height_mm < 0.25 && beside_mm < 0.4, "{height_mm} {beside_mm}");
    assert!(height_mm.hypot(beside_mm) < bead.expected_error_mm && bead.expected_error_mm < 1.0);
    let off_deg = torch_off_deg(bead, &plate);
    assert!(off_deg < bead.expected_error_deg, "{off_deg} {}", bead.expected_error_deg);
    let length_mm: f64 = line.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
    assert!((bead.length_mm() - length_mm).abs() < 2.0, "{} of {length_mm}", bead.length_mm());
    assert_eq!((bead.joint, bead.id), (Joint::ButtV, planned.seams.len()));
}

fn away_mm(p: &Point3<f64>, pair: &[Point3<f64>]) -> f64 {
    let along =
        ((p - pair[0]).dot(&(pair[1] - pair[0])) / (pair[1] - pair[0]).norm_squared()).clamp(0.0, 1.0);
    (p - (pair[0] + (pair[1] - pair[0]) * along)).norm()
}

#[test]
fn a_chain_of_places_beside_a_fillet_lies_in_its_root_with_the_torch_on_the_bisector() {
    let fillet = Piece::of(Part::Fillet);
    let ([a, b], [first, second]) = fillet.root();
    let (plate, web) = fillet.plate();
    let along = (b - a).normalize();
    // A click is on one face or the other, up to 2 mm beside the root.
    let clicks = [(20.0, web * 1.5), (100.0, plate * 2.0), (180.0, web * 2.0), (280.0, plate * 1.0)];
    let places = clicks.map(|(mm, off)| a + along * mm + off).to_vec();
    let planned = fillet.drawn(vec![places]).expect("a plan");
    let found = own(&planned);
    let [seam] = found[..] else { panic!("{:?}", planned.said.undrawn) };
    let off_mm = rms(seam, |p| away_mm(p, &[a, b]));
    println!("{off_mm:.3} mm off the root; says {:.3}", seam.expected_error_mm);
    assert!(off_mm < 0.3 && off_mm < seam.expected_error_mm, "{off_mm} {}", seam.expected_error_mm);
    let off_deg = torch_off_deg(seam, &(first + second));
    assert!(off_deg < seam.expected_error_deg, "{off_deg} {}", seam.expected_error_deg);
    assert_eq!(seam.joint, Joint::Fillet);
    // It is the seam that was found anyway, and says so.
    assert!(seam.warnings.iter().any(|words| words.contains("drawn along seam")), "{:?}", seam.warnings);
}

#[test]
fn a_line_that_comes_back_to_its_first_place_is_closed() {
    let fillet = Piece::of(Part::Fillet);
    let ([a, b], _) = fillet.root();
    let (plate, web) = fillet.plate();
    let middle = a + (b - a) * 0.5 + web * 40.0;
    let (x, y) = ((b - a).normalize(), web);
    let at = |k: usize| {
        let (sin, cos) = (k as f64 / 24.0 * std::f64::consts::TAU).sin_cos();
        middle + (x * cos + y * sin) * 20.0
    };
    let mut places: Vec<Point3<f64>> = (0..24).map(at).collect();
    places.push(places[0]);
    let planned = fillet.drawn(vec![places]).expect("a plan");
    let found = own(&planned);
    let [ring] = found[..] else { panic!("{:?}", planned.said.undrawn) };
    let off_mm = rms(ring, |p| ((p - middle) - plate * (p - middle).dot(&plate)).norm() - 20.0);
    assert!(ring.closed && off_mm < 0.4, "{off_mm}");
    assert!((ring.length_mm() - 20.0 * std::f64::consts::TAU).abs() < 2.0, "{}", ring.length_mm());
}

#[test]
fn a_line_round_a_pipe_follows_its_wall_though_its_places_are_far_apart() {
    let pipe = Piece::of(Part::Pipe);
    let foot = &pipe.truth.seams[0];
    let line: Vec<Point3<f64>> = foot.line(Target::Root).iter().map(|p| Point3::from(*p)).collect();
    let centre = Point3::from(line.iter().map(|p| p.coords).sum::<Vector3<f64>>() / line.len() as f64);
    let radius_mm = (line[0] - centre).norm();
    // A third of the way round, amid the part of the foot that most stations beside it are seen of.
    let third = line.len() / 3;
    let seen = |from: usize| (0..third).filter(|k| foot.visible[(from + k) % line.len()] > 0).count();
    let from = (0..line.len()).max_by_key(|from| seen(*from)).expect("a foot");
    let place = |k: usize| line[(from + third * k / 4) % line.len()] + Vector3::z() * 30.0;
    let planned = pipe.drawn(vec![(0..=4).map(place).collect()]).expect("a plan");
    let found = own(&planned);
    let [bead] = found[..] else { panic!("{:?}", planned.said.undrawn) };
    let off_mm = rms(bead, |p| (p - centre).xy().norm() - radius_mm);
    println!("{off_mm:.3} mm off a pipe of {radius_mm:.0} mm; says {:.3}", bead.expected_error_mm);
    assert!(off_mm < 0.3 && off_mm < bead.expected_error_mm, "{off_mm} {}", bead.expected_error_mm);
    // The chord of two places is farther off: it is the surface that is followed.
    let sagitta_mm = radius_mm * (1.0 - (std::f64::consts::TAU / 24.0).cos());
    assert!(sagitta_mm > 1.0, "{sagitta_mm}");
    let square = |(p, faces): (Point3<f64>, [Vector3<f64>; 2])| {
        let out = (p - centre).xy().normalize();
        (faces[0] + faces[1]).normalize().xy().dot(&out).clamp(-1.0, 1.0).acos().to_degrees()
    };
    let worst = bead.stations.iter().map(|s| square((s.position_mm, s.faces))).fold(0.0, f64::max);
    assert!(worst < 8.0, "{worst} degrees");
}

#[test]
fn what_the_scan_does_not_bear_is_refused_with_its_place_and_nothing_else_changes() {
    let fillet = Piece::of(Part::Fillet);
    let ([a, b], _) = fillet.root();
    let (plate, web) = fillet.plate();
    let along = (b - a).normalize();
    let plain = fillet.drawn(Vec::new()).expect("a plan");
    // Off the plate and over the table; into the air; so near to the web that a torch square to the plate would be in it.
    let into_the_void = vec![a + along * 100.0 + web * 40.0, a + along * 100.0 + web * 3000.0];
    let in_the_air = vec![a + plate * 300.0 + web * 200.0, b + plate * 300.0 + web * 200.0];
    let hugging = vec![a + along * 60.0 + web * 3.4, b - along * 60.0 + web * 3.4];
    let planned = fillet.drawn(vec![into_the_void, in_the_air, hugging]).expect("a plan");
    println!("{:#?}", planned.said.undrawn);
    assert!(own(&planned).is_empty(), "{:?}", planned.said.undrawn);
    let whys = [
        "nothing was scanned within",
        "nothing was scanned within 15.0 mm of",
        "where the torch's tip would be",
    ];
    for (undrawn, why) in planned.said.undrawn.iter().zip(whys) {
        assert!(undrawn.starts_with("no seam is drawn between ") && undrawn.contains(why), "{undrawn}");
    }
    let stations = |plan: &Plan| plan.seams.iter().map(|seam| seam.stations.clone()).collect::<Vec<_>>();
    assert_eq!(stations(&plain), stations(&planned));
}

fn outcome(text: &str) -> Output {
    let fillet = Piece::of(Part::Fillet);
    let job = Job::parse(text, std::path::Path::new("job.toml")).unwrap_or_else(|error| panic!("{error}"));
    let plan = planning::plan(&fillet.scan, &job, &mut ()).expect("a plan");
    postprocess(&plan, &job, planning::source(&fillet.scan, &job)).expect("files")
}

#[test]
fn a_drawn_seam_is_never_ready_whatever_is_accepted() {
    let fillet = Piece::of(Part::Fillet);
    let ([a, b], _) = fillet.root();
    let (_, web) = fillet.plate();
    let [a, b] = [a, b].map(|p| p + web * 40.0);
    let all: Vec<&str> = ReasonId::ALL.iter().filter(|id| id.may_be_accepted()).map(|id| id.name()).collect();
    let accepted = format!("accept = {all:?}\n");
    assert_eq!(outcome(&accepted).summary.verdict().state, State::Ready);
    let draw = format!(
        "{accepted}[[draw]]\nthrough_mm = [[{}, {}, {}], [{}, {}, {}]]\n",
        a.x + 30.0,
        a.y,
        a.z,
        b.x - 30.0,
        b.y,
        b.z
    );
    let output = outcome(&draw);
    let verdict = output.summary.verdict();
    assert_eq!(verdict.state, State::Check, "{:?}", verdict.reasons);
    let open: Vec<_> = verdict.reasons.iter().filter(|reason| !reason.accepted).collect();
    assert!(open.len() == 1 && open[0].id == ReasonId::Drawn && open[0].seam.is_some(), "{open:?}");
    let error =
        Job::parse("accept = [\"drawn\"]\n", std::path::Path::new("job.toml")).unwrap_err().to_string();
    assert!(error.contains("cannot be accepted"), "{error}");
}
