//! Plans that several tests look at, each made once.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use weldpath::evaluation::Truth;
use weldpath::input::{self, Scan};
use weldpath::pipeline::{self, Config, Kept, MergeConfig, Plan, PlanError, Wishes};
use weldpath::run::job::Job;
use weldpath::simulation::{Part, Request};
use weldpath_tests::scans::{Shared, scanned};

/// The plan of a folder with `scan.json`, as the command makes it without any option.
pub(crate) fn plan(folder: &Path) -> Result<Plan, PlanError> {
    static PLANS: Shared<PathBuf, Result<Plan, PlanError>> = Shared::new();
    let read = || input::read(folder, &input::Options::default()).unwrap_or_else(|error| panic!("{error}"));
    PLANS.get(folder.into(), || plan_of(&read())).clone()
}

/// The same of a scan that one test made for itself.
pub(crate) fn plan_of(scan: &Scan) -> Result<Plan, PlanError> {
    pipeline::plan(&scan.views, &Job::default().pipeline(), &mut ())
}

/// A simulated piece, its scan, what is found in it without asking, and what is true.
pub(crate) struct Piece {
    pub(crate) part: Part,
    pub(crate) scan: Scan,
    pub(crate) truth: Truth,
    pub(crate) plan: Plan,
    kept: Kept,
}

/// All parts but the two without a seam that could be kept back.
pub(crate) static PIECES: LazyLock<Vec<Piece>> = LazyLock::new(|| {
    use Part::{Branch, ButtV, Corner, Cruciform, Fillet, Lap, Pipe, RoundLap, Saddle, Scurve};
    [Fillet, Lap, RoundLap, Corner, Pipe, ButtV, Saddle, Branch, Scurve, Cruciform].map(Piece::new).into()
});

impl Piece {
    fn new(part: Part) -> Self {
        let request = Request { width: 480, height: 360, ..Request::new(part, 1) };
        let ((scan, truth), mut kept) = (scanned(&request), Kept::default());
        let plan = pipeline::plan_from(&mut kept, &scan.views, &config(Wishes::default()), &mut ());
        Self { part, scan, truth, plan: plan.expect("a plan"), kept }
    }

    pub(crate) fn of(part: Part) -> &'static Self {
        PIECES.iter().find(|piece| piece.part == part).expect("one of the parts")
    }

    /// The plan with what a person asks for beside: the seams that show without asking are found once.
    pub(crate) fn with(&self, wishes: Wishes) -> Result<Plan, PlanError> {
        pipeline::plan_from(&mut self.kept.clone(), &self.scan.views, &config(wishes), &mut ())
    }
}

/// The first pose is exact, so that truth and plan are in one frame.
fn config(wishes: Wishes) -> Config {
    Config { merge: MergeConfig { anchor: None, ..Default::default() }, wishes, ..Config::default() }
}

#[test]
fn what_is_kept_of_a_plan_changes_nothing_in_the_next() {
    let piece = &PIECES[0];
    let asked =
        vec![piece.plan.seams[0].stations.iter().map(|station| station.position_mm).step_by(50).collect()];
    let kept_back = vec![piece.plan.seams[0].stations[0].position_mm];
    let wishes = Wishes { asked, kept_back, drawn: Vec::new() };
    let whole = pipeline::plan(&piece.scan.views, &config(wishes.clone()), &mut ()).expect("a plan");
    let from_kept = piece.with(wishes).expect("a plan");
    assert_eq!(format!("{:?}", whole.paths), format!("{:?}", from_kept.paths));
    assert_eq!(whole.said.warnings, from_kept.said.warnings);
}
