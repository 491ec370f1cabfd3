//! What is scanned and is no work, on a T joint between two vise jaws. Truth is the simulator's: two seams; where the jaws touch
//! the plate there is none. Walls that a rib holds to the plate are no jaws.

use std::path::Path;
use std::sync::LazyLock;

use nalgebra::{Point3, Vector3};
use weldpath::evaluation::{Score, Truth};
use weldpath::input::{CloudFrame, Scan};
use weldpath::output::verdict::ReasonId;
use weldpath::pipeline::{Plan, PlanError};
use weldpath::run::job::Job;
use weldpath::run::planning;
use weldpath::run::postprocessing::Output;
use weldpath::seam::Seam;
use weldpath::simulation::{ListedWeld, MeshRequest, Simulated, simulate_mesh};
use weldpath_tests::scans::{Outcome, Triangle, block, of_mesh, read, written};

/// Plate and web; the seams run along x at `WEB_MM` on either side.
const WEB_MM: f64 = 4.0;
/// Where the plate ends and the jaws begin, on either side of the web.
const JAW_MM: f64 = 60.0;

fn part() -> Vec<Triangle> {
    [
        block([-100.0, -JAW_MM, 0.0], [100.0, JAW_MM, 8.0]),
        block([-100.0, -WEB_MM, 8.0], [100.0, WEB_MM, 68.0]),
    ]
    .concat()
}

/// Longer, wider and higher than the part, so that scans with and without it are placed alike.
fn jaws() -> Vec<Triangle> {
    [block([-120.0, -90.0, 0.0], [120.0, -JAW_MM, 30.0]), block([-120.0, JAW_MM, 0.0], [120.0, 90.0, 75.0])]
        .concat()
}

fn welds() -> Vec<ListedWeld> {
    let weld = |side: f64| ListedWeld {
        start_mm: Point3::new(-100.0, side * WEB_MM, 8.0),
        end_mm: Point3::new(100.0, side * WEB_MM, 8.0),
        torch: Vector3::new(0.0, side, 1.0).normalize(),
    };
    vec![weld(1.0), weld(-1.0)]
}

/// What cameras see of it; another number of views has other poses.
fn simulated(triangles: Vec<Triangle>, welds: Vec<ListedWeld>, views: usize) -> Simulated {
    let request =
        MeshRequest { welds: Some(welds), size_px: [480, 360], ..of_mesh("vise", triangles, views, 1) };
    simulate_mesh(&request).expect("a scan")
}

static CLAMPED: LazyLock<(Scan, Truth)> = LazyLock::new(|| {
    let simulated = simulated([part(), jaws()].concat(), welds(), 6);
    (read(&simulated), simulated.truth)
});
static EMPTY: LazyLock<Scan> = LazyLock::new(|| read(&simulated(jaws(), Vec::new(), 7)));
static PLAIN: LazyLock<Run> = LazyLock::new(|| Run::of(CLAMPED.0.clone(), ""));

struct Run {
    plan: Plan,
    output: Output,
    score: Score,
}

impl Run {
    fn of(scan: Scan, exclude: &str) -> Self {
        let Outcome { plan, output, score } = Outcome::of(&scan, &CLAMPED.1, &job(exclude));
        Self { plan, output, score: score.expect("path.csv is read back") }
    }

    /// The work's seams are where they are without an exclusion, the jaws' are gone, and the torch still hits the jaw.
    fn is_of_the_work_alone(&self, how: &str) {
        let own_mm = self.score.rmse_mm.expect("points on the seams");
        let plain_mm = PLAIN.score.rmse_mm.expect("points on the seams");
        println!("{how}: {own_mm:.3} mm, without {plain_mm:.3} mm; {:.3} false", self.score.false_share);
        assert_eq!((self.plan.seams.len(), self.score.false_share), (2, 0.0), "{how}");
        assert!(self.score.coverage > 0.98 && own_mm < plain_mm + 0.02, "{how}");
        assert!(self.collides(), "{how}: the jaw is in the torch's way");
    }

    fn collides(&self) -> bool {
        self.output.summary.verdict().reasons.iter().any(|reason| reason.id == ReasonId::TorchCollision)
    }

    /// Points of the model on the high jaw's top, which is the highest of the scene.
    fn jaw_points(&self) -> usize {
        let heights = || (0..self.plan.model.len()).map(|k| self.plan.model.in_base_mm(k).z);
        let top_mm = heights().fold(f64::MIN, f64::max);
        heights().filter(|height_mm| *height_mm > top_mm - 3.0).count()
    }
}

fn job(exclude: &str) -> Job {
    let text = format!("scan.anchor = \"first\"\n{exclude}");
    Job::parse(&text, Path::new("job.toml")).unwrap_or_else(|error| panic!("{error}"))
}

/// A half-space beyond the inner side of the jaw that the seam with this index faces.
fn beyond_jaw(seam: usize) -> String {
    let middle = |k: usize| {
        let line = &CLAMPED.1.seams[k].p;
        nalgebra::center(&Point3::from(line[0]), &Point3::from(line[line.len() - 1]))
    };
    let (own, other) = (middle(seam), middle(1 - seam));
    let toward = (own - other).normalize();
    let at = own + toward * (JAW_MM - WEB_MM - 1.0);
    format!(
        "[[exclude.half_space]]\nat_mm = [{}, {}, {}]\ntoward = [{}, {}, {}]\n",
        at.x, at.y, at.z, toward.x, toward.y, toward.z
    )
}

#[test]
fn jaws_that_nothing_excludes_are_named_and_welded_only_if_that_is_accepted() {
    let contacts: Vec<&Seam> = PLAIN.plan.seams.iter().filter(|seam| seam.contact.is_some()).collect();
    assert_eq!((contacts.len(), PLAIN.plan.seams.len()), (2, 4));
    assert!(contacts.iter().all(|seam| seam.confidence <= 0.5));
    let named = PLAIN.output.summary.verdict().reasons.iter().filter(|one| one.id == ReasonId::MayBeContact);
    assert_eq!(
        named.filter_map(|one| one.seam).collect::<Vec<_>>(),
        contacts.iter().map(|seam| seam.id).collect::<Vec<_>>()
    );
    assert!(PLAIN.score.coverage > 0.98 && PLAIN.score.false_share == 0.0);
    assert!(PLAIN.collides());
    let accepted = job("accept = [\"may-be-contact\"]\n");
    let (_, score) = written(&PLAIN.plan, &CLAMPED.0, &CLAMPED.1, &accepted);
    let false_share = score.expect("path.csv is read back").false_share;
    assert!(false_share > 0.3, "{false_share}");
}

/// Walls as jaws are, with a rib between them that is as high as `rib_mm`.
fn channel(rib_mm: f64) -> Vec<Triangle> {
    let wall = |low: f64| block([-120.0, low, 0.0], [120.0, low + 10.0, 50.0]);
    let plate = block([-100.0, -JAW_MM, 0.0], [100.0, JAW_MM, 8.0]);
    let rib = block([-4.0, -JAW_MM, 8.0], [4.0, JAW_MM, 8.0 + rib_mm]);
    [plate, wall(-JAW_MM - 10.0), wall(JAW_MM), rib].concat()
}

#[test]
fn walls_that_a_rib_braces_are_of_the_work() {
    let scan = read(&simulated(channel(30.0), welds(), 6));
    let plan = planning::plan(&scan, &job(""), &mut ()).expect("a plan");
    assert!(
        plan.seams.len() >= 4 && plan.seams.iter().all(|seam| seam.contact.is_none()),
        "{} seams",
        plan.seams.len()
    );
}

#[test]
fn half_spaces_leave_the_seams_of_the_work_alone() {
    let run = Run::of(CLAMPED.0.clone(), &(beyond_jaw(0) + &beyond_jaw(1)));
    run.is_of_the_work_alone("half-spaces");
    let (own, plain) = (run.jaw_points(), PLAIN.jaw_points());
    assert!(plain > 500 && own.abs_diff(plain) * 20 < plain, "the model keeps the jaw: {own} of {plain}");
}

#[test]
fn what_was_there_before_the_work_is_no_work() {
    let scan = CLAMPED.0.clone().over(EMPTY.clone()).expect("both are in the base frame");
    let run = Run::of(scan, "");
    run.is_of_the_work_alone("background");
    let derived = |name| run.plan.derived.parameters.iter().find(|row| row.name == name).expect(name).value;
    // Three deviations of two voxels' means, noise of 0.35 mm and more in each point.
    assert!((0.1..1.5).contains(&derived("background_mm")), "{}", derived("background_mm"));
    assert!(derived("excluded_points") > 1e5);
}

#[test]
fn an_excluded_seam_is_gone_and_the_other_stays_where_it_is() {
    let line = &CLAMPED.1.seams[0].p;
    let middle = nalgebra::center(&Point3::from(line[0]), &Point3::from(line[line.len() - 1]));
    let run = Run::of(CLAMPED.0.clone(), &beyond_jaw(1));
    let near_jaw =
        |seam: &Seam| seam.stations.iter().all(|station| (station.position_mm - middle).norm() > 40.0);
    assert!(run.plan.seams.iter().filter(|seam| near_jaw(seam)).count() <= 1, "one jaw is left");
    assert!(run.score.coverage > 0.98 && run.score.false_share > 0.1);
}

#[test]
fn an_exclusion_that_leaves_nothing_says_so() {
    let all = "[exclude]\nboxes_mm = [[[-1e5, -1e5, -1e5], [1e5, 1e5, 1e5]]]\n";
    let error = planning::plan(&CLAMPED.0, &job(all), &mut ()).expect_err("nothing is left");
    let PlanError::NoSeam { reason } = error else { panic!("{error}") };
    assert!(reason.contains("nothing of the scan is left") && reason.contains("[exclude]"), "{reason}");
}

#[test]
fn a_background_in_the_cameras_frame_does_not_fit_a_scan_in_the_base_frame() {
    let before = Scan { frame: CloudFrame::Camera, ..EMPTY.clone() };
    let error = CLAMPED.0.clone().over(before).expect_err("two frames").to_string();
    assert!(error.contains("background") && error.contains("its camera"), "{error}");
}
