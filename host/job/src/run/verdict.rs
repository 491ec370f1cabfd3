//! What stands against running a plan (ours): found in what the scan, the registration, the seams and the program themselves
//! say. The words of each reason, and what to do, are in `docs/troubleshooting.md`.
//!
//! Millimetres, degrees where people read them; the scan's base frame.

use std::collections::BTreeSet;

use nalgebra::{Point3, Vector3};

use crate::output::frame::PathFrame;
use crate::output::verdict::{Finding, ReasonId};
use crate::robot::dialect::Dialect;
use crate::robot::feasibility::Report;
use crate::robot::feasibility::problem::{Problem, ProblemKind};
use crate::robot::posture::Maker;
use crate::run::access;
use crate::run::job::Job;
use crate::run::selection;
use weldpath_method::geometry::cloud::PointCloud;
use weldpath_method::geometry::grid::Grid;
use weldpath_method::geometry::statistics::median;
use weldpath_method::input::{CloudFrame, DoubtKind, Scan};
use weldpath_method::pipeline::{HandEyeError, Misfit, Plan, ViewReport};
use weldpath_method::seam::Seam;
use weldpath_method::seam::measure::dimension::Quantity;
use weldpath_method::weld::SeamPath;

/// A seam whose error is larger is not welded: half of what a wire of 1.2 mm and its arc bridge on either side.
const MOST_ERROR_MM: f64 = 1.0;
/// Of a thin plate it is a third, beside which the arc still melts both members; and not less than this, which the best
/// depth cameras just reach.
const PLATE_SHARE: f64 = 1.0 / 3.0;
const LEAST_LIMIT_MM: f64 = 0.5;
/// Views that turn by less than this, degrees, show nothing of the hand-eye transform: an error of it by 100 mm moves two
/// of them apart by 17 mm, which is as far as registration pulls views together without a word.
const LEAST_TURN_DEG: f64 = 10.0;
/// From two views and this share of all that do not fit on, it is not they that are wrong: one gross error in five to eight
/// views is an accident. Poses of other images, a wrong depth scale, a turned camera and a tool in place of the flange
/// made two of six or more of them misfits on all six joints that were tried, and left the others together by chance.
const MISFITS_SHARE: f64 = 0.25;
/// Two views against one are no majority: work that ties a direction loosely, such as a groove, lets any two agree.
const LEAST_FITTING: usize = 3;
/// The tip may be so far inside what was scanned, mm: a root below the groove faces' ends and a step of the voxels are
/// no mistake.
const MOST_INSIDE_MM: f64 = 3.0;
/// So far at most a scan rounds a corner in front of its root, mm: a matcher's window of 15 mm on a right one.
const MOST_ROUNDED_MM: f64 = 3.0;
/// So many points of a pass in a row, so that a flying pixel is no work.
const INSIDE_POINTS: usize = 3;
/// A torch that touches the work finds a seam that is so far off, mm; cells of which nothing is stated leave 7 mm unknown.
const MOST_BASE_ERROR_MM: f64 = 20.0;
/// Points of the model about a place, mm.
const ABOUT_MM: f32 = 30.0;
/// A seam lies in what was scanned, and winds less often than this across it.
const OUTSIDE_MM: f64 = 10.0;
const MOST_WINDINGS: f64 = 4.0;

/// Reasons that discredit the scan as a whole: whatever is found in it lies on views that do not belong together, or are not
/// where they are said to be.
const DISCREDITING: &[ReasonId] = &[
    ReasonId::ViewsDisagree,
    ReasonId::PosesDoNotBelong,
    ReasonId::HandEyeWrong,
    ReasonId::DepthScale,
    ReasonId::Units,
    ReasonId::Angles,
    ReasonId::TransformInverted,
    ReasonId::BeyondScan,
];
/// Confidence that a seam found in such a scan keeps at most: of 67 that were found in 42 of them (seven mistakes on six
/// simulated pieces) none lay on a weld within its stated error, and (0 + 1) / (67 + 2) is what that leaves (Laplace).
const DISCREDITED_CONFIDENCE: f64 = 0.015;

/// A seam is not surer than the scan that it stands on, whatever the job accepts.
pub(crate) fn lower_confidence(plan: &mut Plan, scan: &Scan) {
    let mut found = of_doubts(scan);
    found.extend(of_views(&plan.derived.views, plan.derived.hand_eye.as_ref()));
    found.extend(beyond_scan(plan));
    if found.iter().any(|finding| DISCREDITING.contains(&finding.id)) {
        plan.seams.iter_mut().for_each(|seam| seam.confidence = seam.confidence.min(DISCREDITED_CONFIDENCE));
    }
}

/// What cannot well be true of the input.
fn of_doubts(scan: &Scan) -> Vec<Finding> {
    let doubt = |kind: DoubtKind| match kind {
        DoubtKind::Units => ReasonId::Units,
        DoubtKind::Angles => ReasonId::Angles,
        DoubtKind::DepthScale => ReasonId::DepthScale,
        DoubtKind::Direction => ReasonId::TransformInverted,
        DoubtKind::Frame => ReasonId::FrameUnknown,
        DoubtKind::CadOrScan => ReasonId::CadOrScan,
    };
    scan.doubts.iter().map(|one| Finding::new(doubt(one.kind), one.words.clone())).collect()
}

/// What the input alone says.
pub fn of_scan(scan: &Scan, job: &Job) -> Vec<Finding> {
    let mut found = of_doubts(scan);
    found.extend(match scan.frame {
        CloudFrame::Base => None,
        CloudFrame::Camera if job.dialects().is_empty() => None,
        CloudFrame::Camera => Some(Finding::new(
            ReasonId::CameraFrame,
            "the coordinates are in the camera's frame, and the robot's position in it is unknown",
        )),
        CloudFrame::Unknown => Some(Finding::new(
            ReasonId::FrameUnknown,
            "it is unknown whether the coordinates are in the robot's base frame: the input is a mesh, or a \
             cloud merged elsewhere",
        )),
    });
    found
}

impl From<CloudFrame> for PathFrame {
    fn from(frame: CloudFrame) -> Self {
        match frame {
            CloudFrame::Base => Self::Base,
            CloudFrame::Camera => Self::Camera,
            CloudFrame::Unknown => Self::Unknown,
        }
    }
}

/// What the plan says, before anything is made of it.
pub fn of_plan(plan: &Plan, job: &Job) -> Vec<Finding> {
    let mut found = of_views(&plan.derived.views, plan.derived.hand_eye.as_ref());
    found.extend(of_seams(plan));
    found.extend(plan.said.unmet.iter().map(|words| Finding::new(ReasonId::AskedNotThere, words.clone())));
    found.extend(plan.said.undrawn.iter().map(|words| Finding::new(ReasonId::DrawnNotThere, words.clone())));
    if plan.derived.orientation_assumed {
        let words = "the cloud looks nearly the same from both sides, so the open side is assumed: check that the torch is on it, or give \
                     --camera x,y,z, views with poses, or a cloud with normals";
        found.push(Finding::new(ReasonId::SideAssumed, words));
    }
    found.extend(of_base_frame(plan));
    found.extend(of_scatter(plan, job));
    if job.tool.is_none() {
        let words = "no [tool] is given: the TCP that is set on the controller has to be the tip of the wire";
        found.push(Finding::new(ReasonId::ToolNotStated, words));
    }
    found
}

/// Parts with more seams than this are rare, and mistakes of the input that make hundreds of them are not.
const MANY: usize = 100;
/// Noise makes short seams, mm.
const SHORT_MM: f64 = 25.0;

/// More seams than a part has, and what may be the cause.
pub(crate) fn many_seams(welded: &[SeamPath]) -> Option<Finding> {
    let mut lengths_mm: Vec<f64> = welded.iter().map(SeamPath::length_mm).collect();
    let half_mm = median(&mut lengths_mm);
    let cause = match half_mm {
        short if short < SHORT_MM => {
            "so short that they may be noise rather than corners: check the unit, and whether a scanned mesh \
             is taken as CAD (--as scan)"
        }
        _ => "check that the input is one part and not a whole assembly",
    };
    let words = format!(
        "{} seams are welded, half of them shorter than {half_mm:.0} mm: {cause}; --seam, --roi and [[seam]] choose among them",
        welded.len()
    );
    let values = [("seams", welded.len() as f64), ("median_length_mm", half_mm)];
    (welded.len() > MANY).then(|| Finding::new(ReasonId::ManySeams, words).with(&values))
}

/// Seams to which the torch does not get, and which the job does not name.
pub(crate) fn inside_unnamed(plan: &Plan, job: &Job) -> BTreeSet<usize> {
    let own = job.seams.iter().filter(|own| own.weld);
    let named: BTreeSet<usize> = own
        .filter_map(|own| selection::named(&plan.paths, own).ok().flatten())
        .chain(job.selection.seams.iter().copied())
        .collect();
    let is_asked = |id: &usize| named.contains(id) || job.selection.near_mm.is_some();
    access::inside(plan, job).iter().copied().filter(|id| !is_asked(id)).collect()
}

/// A seam that would be welded if the torch got there.
pub(crate) fn left_inside(path: &SeamPath) -> Finding {
    let words = format!(
        "{:.0} mm, inside: the torch does not fit there at any work angle. It is not welded; --seam {} or a \
         [[seam]] welds it anyway",
        path.length_mm(),
        path.seam
    );
    Finding::of_seam(ReasonId::LeftOut, path.seam, words).with(&[("length_mm", path.length_mm())])
}

/// Seams that are found but not welded: over the limit, or perhaps contacts with what holds the work, and not accepted.
///
/// Where all are over the limit the plan is refused, and none is left out, so that the files show what was found.
pub fn left_out(plan: &Plan, job: &Job) -> BTreeSet<usize> {
    let keeps_out = [ReasonId::SeamUncertain, ReasonId::MayBeContact];
    let out = |finding: &Finding| keeps_out.contains(&finding.id) && !job.accept.contains(&finding.id);
    of_seams(plan).into_iter().filter(out).filter_map(|finding| finding.seam).collect()
}

fn of_views(views: &[ViewReport], hand_eye: Option<&HandEyeError>) -> Vec<Finding> {
    let mut found = Vec::new();
    let fits = |view: &&ViewReport| view.misfit.is_none();
    let repeated = |view: &ViewReport| matches!(view.misfit, Some(Misfit::Repeated { .. }));
    // One that overlaps no other cannot agree with any, whatever its pose.
    let fitting = views.iter().filter(|view| fits(view) && view.complaint.is_none()).count();
    let misfits = views.iter().filter(|view| !fits(view) && !repeated(view)).count();
    let names = || {
        let out: Vec<&str> = views.iter().filter(|view| !fits(view)).map(|view| view.name.as_str()).collect();
        out.join(", ")
    };
    if views.len() > 1 && fitting < 2 {
        let words =
            format!("no two of {} views agree: check poses, hand-eye transform and depth scale", views.len());
        found.push(Finding::new(ReasonId::ViewsDisagree, words).with(&[("views", views.len() as f64)]));
    } else if misfits > 0
        && (misfits > 1 || fitting < LEAST_FITTING)
        && misfits as f64 >= MISFITS_SHARE * views.len() as f64
    {
        let words = format!(
            "{misfits} of {} views {} not fit the others ({}): the poses do not belong to the images",
            views.len(),
            if misfits == 1 { "does" } else { "do" },
            names()
        );
        let values = [("misfits", misfits as f64), ("views", views.len() as f64)];
        found.push(Finding::new(ReasonId::PosesDoNotBelong, words).with(&values));
    } else {
        found.extend(views.iter().filter_map(|view| {
            let words = format!("{} is left out: it {}", view.name, view.left_out.as_ref()?);
            Some(Finding::new(ReasonId::ViewLeftOut, words))
        }));
    }
    found.extend(views.iter().filter_map(|view| {
        Some(Finding::new(ReasonId::ViewUnregistered, format!("{} {}", view.name, view.complaint.as_ref()?)))
    }));
    found.extend(hand_eye.filter(|error| error.is_gross()).map(hand_eye_wrong));
    found.extend(hand_eye_untested(views));
    found
}

fn hand_eye_wrong(error: &HandEyeError) -> Finding {
    let words = format!(
        "the views agree best if the camera is {:.0} mm and {:.0} deg from where the hand-eye transform puts it: are TCP \
         poses given as flange poses, or is it another camera's transform?",
        error.shift_mm, error.turn_deg
    );
    let values = [("shift_mm", error.shift_mm), ("turn_deg", error.turn_deg)];
    Finding::new(ReasonId::HandEyeWrong, words).with(&values)
}

fn hand_eye_untested(views: &[ViewReport]) -> Option<Finding> {
    let turns: Vec<_> =
        views.iter().filter(|view| view.misfit.is_none()).map(|view| view.reported.rotation).collect();
    let widest = turns.iter().enumerate().flat_map(|(k, a)| turns[..k].iter().map(move |b| a.angle_to(b)));
    let widest_deg = widest.fold(0.0, f64::max).to_degrees();
    let words = format!(
        "the views turn by {widest_deg:.1} deg only: a wrong hand-eye transform, or TCP poses given as \
         flange poses, would not show"
    );
    let finding = || Finding::new(ReasonId::HandEyeUntested, words).with(&[("turn_deg", widest_deg)]);
    (turns.len() > 1 && widest_deg < LEAST_TURN_DEG).then(finding)
}

/// Largest error with which this seam is welded, mm.
fn limit_mm(seam: &Seam) -> f64 {
    let thickness = seam.dimensions.iter().find(|d| d.quantity == Quantity::SheetThickness);
    let thickness_mm = thickness.and_then(|d| d.value.as_ref().ok()).map(|measured| measured.value);
    thickness_mm.map_or(MOST_ERROR_MM, |mm| (PLATE_SHARE * mm).clamp(LEAST_LIMIT_MM, MOST_ERROR_MM))
}

/// An error of a seam that is over what it may be.
struct Excess {
    seam: usize,
    error_mm: f64,
    limit_mm: f64,
    /// Of what it is the error.
    within: &'static str,
}

impl Excess {
    fn of(seam: &Seam) -> Option<Self> {
        let excess = |error_mm, limit_mm, within| Self { seam: seam.id, error_mm, limit_mm, within };
        let (relative_mm, most_mm) = (seam.relative_error_mm, limit_mm(seam));
        if relative_mm.is_nan() || relative_mm > most_mm {
            return Some(excess(relative_mm, most_mm, "within the scan"));
        }
        // Not a number where no robot is known.
        (seam.base_error_mm > MOST_BASE_ERROR_MM)
            .then(|| excess(seam.base_error_mm, MOST_BASE_ERROR_MM, "in the robot's base frame"))
    }

    fn finding(&self, id: ReasonId, consequence: &str) -> Finding {
        let Self { seam, error_mm, limit_mm, within } = self;
        let words =
            format!("its expected error {within} of {error_mm:.2} mm is over {limit_mm:.2} mm{consequence}");
        Finding::of_seam(id, *seam, words).with(&[("error_mm", *error_mm), ("limit_mm", *limit_mm)])
    }
}

fn of_seams(plan: &Plan) -> Vec<Finding> {
    let uncertain: Vec<Excess> = plan.seams.iter().filter_map(Excess::of).collect();
    let (id, consequence) = match uncertain.len() == plan.seams.len() {
        true => (ReasonId::ErrorOverLimit, ""),
        false => (ReasonId::SeamUncertain, ": it is not welded"),
    };
    let mut found: Vec<Finding> = uncertain.iter().map(|excess| excess.finding(id, consequence)).collect();
    let contact = |seam: &Seam| {
        let words = format!("{}. It is not welded", seam.contact?.words());
        Some(Finding::of_seam(ReasonId::MayBeContact, seam.id, words))
    };
    found.extend(plan.seams.iter().filter_map(contact));
    let drawn = |seam: &Seam| {
        let words =
            "it was drawn by hand, and no measurement supports it: check that the line is where it should be";
        Finding::of_seam(ReasonId::Drawn, seam.id, words)
    };
    found.extend(plan.seams.iter().filter(|seam| seam.drawn).map(drawn));
    found.extend(beyond_scan(plan));
    found
}

/// The seam that is worst known in the base frame against its limit, where that is over the limit; none where the job takes
/// the first view's pose as the frame and others bear out the camera.
fn of_base_frame(plan: &Plan) -> Option<Finding> {
    let cell = plan.derived.base_frame.as_ref();
    if cell.is_none() && plan.derived.views.len() > 1 {
        return None;
    }
    let ratio = |seam: &&Seam| seam.base_error_mm / limit_mm(seam);
    let worst = plan.seams.iter().max_by(|a, b| ratio(a).total_cmp(&ratio(b)))?;
    let words = || {
        let of_others = match plan.seams.iter().filter(|seam| ratio(seam) > 1.0).count() {
            0 | 1 => String::new(),
            over => format!("; it is the worst of {over} seams over their limit"),
        };
        let more = match cell {
            Some(cell) if cell.is_scattered() => format!(
                "; the reported poses scatter by {:.1} mm and {:.2} deg, more than the stated accuracy of \
                 the robot",
                cell.robot_mm, cell.robot_deg
            ),
            None => "; a single view cannot show the camera's own error".into(),
            Some(_) => String::new(),
        };
        format!(
            "the tip may be off by {:.1} mm (one standard deviation) in the robot's base frame, over {:.2} mm, and by {:.2} mm \
             within the scan{of_others}{more}",
            worst.base_error_mm,
            limit_mm(worst),
            worst.relative_error_mm,
        )
    };
    let values = [
        ("base_error_mm", worst.base_error_mm),
        ("error_mm", worst.relative_error_mm),
        ("limit_mm", limit_mm(worst)),
    ];
    (ratio(&worst) > 1.0)
        .then(|| Finding::of_seam(ReasonId::BaseErrorOverLimit, worst.id, words()).with(&values))
}

/// Poses that scatter more than the job states of its robot: where the accuracy was stated, it is not chance. The stated errors follow
/// from poses that err at random, and hold no mistake that moves views in step with the flange.
fn of_scatter(plan: &Plan, job: &Job) -> Option<Finding> {
    let [stated, assumed] = [&job.scan, &Job::default().scan].map(|scan| (scan.robot_mm, scan.robot_deg));
    let cell = plan.derived.base_frame.as_ref().filter(|cell| stated != assumed && cell.is_scattered())?;
    let words = format!(
        "the views fit each other only if their poses are moved by {:.2} mm and {:.2} deg, {:.1} and {:.1} times the robot accuracy \
         stated in [scan]: either that is too optimistic, or hand-eye transform, tool or depth scale is wrong by more than stated",
        cell.robot_mm, cell.robot_deg, cell.scale_mm, cell.scale_deg
    );
    let values = [("of_stated_mm", cell.scale_mm), ("of_stated_deg", cell.scale_deg)];
    Some(Finding::new(ReasonId::PosesScatter, words).with(&values))
}

/// Seams that leave the scan, or are longer than it is wide.
fn beyond_scan(plan: &Plan) -> Vec<Finding> {
    let model = &plan.model;
    let Some(first) = model.points_mm.first().copied() else { return Vec::new() };
    let (low, high) = model.points_mm.iter().fold((first, first), |(low, high), p| (low.inf(p), high.sup(p)));
    let [low, high] = [low, high].map(|corner: Point3<f32>| model.origin_mm + corner.coords.cast::<f64>());
    let wide_mm = (high - low).norm();
    let margin = Vector3::repeat(OUTSIDE_MM);
    let (low, high) = (low - margin, high + margin);
    let outside = |p: &Point3<f64>| (0..3).any(|k| !(low[k]..=high[k]).contains(&p[k]));
    let beyond = |seam: &&Seam| {
        seam.length_mm() > MOST_WINDINGS * wide_mm || seam.stations.iter().any(|s| outside(&s.position_mm))
    };
    let finding = |seam: &Seam| {
        let words = format!(
            "it is {:.0} mm long in a scan of {wide_mm:.0} mm, or extends beyond the scan",
            seam.length_mm()
        );
        let values = [("length_mm", seam.length_mm()), ("scan_mm", wide_mm)];
        Finding::of_seam(ReasonId::BeyondScan, seam.id, words).with(&values)
    };
    plan.seams.iter().filter(beyond).map(finding).collect()
}

/// Passes whose tip is inside what was scanned; `lines` are those of the seams, which may be so themselves where the scan has rounded
/// a corner.
pub(crate) fn tips_inside(paths: &[SeamPath], lines: &[SeamPath], model: &PointCloud) -> Vec<Finding> {
    let grid = Grid::new(&model.points_mm, 0.25 * ABOUT_MM);
    let depth_mm = |place: &Point3<f64>| -> f64 {
        let place = (place - model.origin_mm.coords).cast::<f32>();
        let nearest = grid.nearest(&place, ABOUT_MM, |_| true);
        nearest.map_or(0.0, |(slot, _)| {
            let k = grid.index(slot);
            f64::from(-model.normals[k].dot(&(place - model.points_mm[k])))
        })
    };
    let deepest_mm = |path: &SeamPath| {
        let depths: Vec<f64> = path.points.iter().map(|point| depth_mm(&point.position_mm)).collect();
        let least = |run: &[f64]| run.iter().copied().fold(f64::INFINITY, f64::min);
        depths.windows(INSIDE_POINTS).map(least).fold(0.0, f64::max)
    };
    let mut found = Vec::new();
    for path in paths {
        let rounded_mm = || {
            let line = lines.iter().find(|line| line.seam == path.seam);
            line.map_or(0.0, deepest_mm).min(MOST_ROUNDED_MM)
        };
        let deepest_mm = deepest_mm(path);
        let is_inside = deepest_mm > MOST_INSIDE_MM && deepest_mm > MOST_INSIDE_MM + rounded_mm();
        if is_inside && found.iter().all(|one: &Finding| one.seam != Some(path.seam)) {
            let words =
                format!("the tip would be {deepest_mm:.1} mm inside what was scanned: check the stand-off");
            let finding = Finding::of_seam(ReasonId::TipInside, path.seam, words);
            found.push(finding.with(&[("inside_mm", deepest_mm)]));
        }
    }
    found
}

/// What stands against the program itself; of what was only tried nothing is fatal.
pub(crate) fn of_problems(problems: &[Problem], arm: &str) -> Vec<Finding> {
    let against = problems.iter().filter_map(|problem| Some((problem, reason(problem.kind)?)));
    let finding = |(problem, id): (&Problem, ReasonId)| {
        let words = problem.words(arm);
        let named = problem.seam.map(|seam| format!("seam {seam}, ")).unwrap_or_default();
        let words = words.strip_prefix(&named).unwrap_or(&words);
        Finding { seam: problem.seam, ..Finding::new(id, words) }.with(&problem.values())
    };
    against.map(finding).collect()
}

fn reason(kind: ProblemKind) -> Option<ReasonId> {
    match kind {
        ProblemKind::Collision => Some(ReasonId::TorchCollision),
        ProblemKind::OddPosture => Some(ReasonId::OddPosture),
        kind => kind.is_fatal().then_some(ReasonId::Infeasible),
    }
}

/// What the job says, or leaves open, of the arm and its controller.
pub(crate) fn of_arm(job: &Job) -> Vec<Finding> {
    let Some((robot, arm)) = job.robot.as_ref().and_then(|robot| Some((robot, robot.arm()?))) else {
        return Vec::new();
    };
    let mut found = Vec::new();
    let programs: Vec<Dialect> =
        job.dialects().into_iter().filter(|dialect| dialect.maker().is_some()).collect();
    let own = arm.counting.and_then(|counting| counting.maker);
    let others = |dialect: &&Dialect| own.is_some() && dialect.maker() != own;
    if let Some(other) = programs.iter().find(others) {
        let words = format!(
            "the program is for {}, but {} is from another maker: omit --robot and formats, or name the actual arm",
            other.maker().map(Maker::name).unwrap_or_default(),
            arm.name
        );
        found.push(Finding::new(ReasonId::DialectAndArmDiffer, words));
    }
    if robot.home_deg.is_none() && !programs.is_empty() {
        let words = "the joint move to the first waypoint is not checked, because it is unknown where the \
                     arm starts: give [robot] home_deg, or watch that move";
        found.push(Finding::new(ReasonId::FirstMoveUnchecked, words));
    }
    found
}

/// What the check of the links did not look at.
pub(crate) fn limits(report: &Report) -> Vec<String> {
    let Some(arm) = &report.robot else { return Vec::new() };
    let floor = match report.floor_mm {
        Some(floor_mm) => format!("a floor at z = {floor_mm:.0} mm"),
        None => "no floor, as stated in the job".into(),
    };
    vec![format!(
        "the links of {arm} are checked only against what was scanned and {floor}: space that no view saw \
         may not be free"
    )]
}
