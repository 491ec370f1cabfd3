//! From a plan to what a run leaves behind: selection, path modifiers, the program, and the files.

use std::collections::{BTreeMap, BTreeSet};

use crate::output::frame::PathFrame;
use crate::output::summary::{self, Source, Summary};
use crate::output::verdict::{Finding, State, Verdict};
use crate::output::{csv, feasibility as feasibility_csv, json, ply, views};
use crate::robot::dialect::{ProgramSetup, moves};
use crate::robot::feasibility;
use crate::robot::feasibility::Report;
use crate::robot::feasibility::suggestion::Change;
use crate::run::access;
use crate::run::job::layer::{Direction, Weld};
use crate::run::job::resume::ResumeSettings;
use crate::run::job::robot::RobotSettings;
use crate::run::job::{ASSUMED_TCP_MM, AirMoves, Job, Sequence};
use crate::run::resuming;
use crate::run::selection;
use crate::run::selection::select;
use crate::run::verdict;
use weldpath_files::File;
use weldpath_method::cancellation::unless_given_up;
use weldpath_method::geometry::surface::Surface;
use weldpath_method::pipeline::{Method, Observer, Plan, Stages};
use weldpath_method::seam::Joint;
use weldpath_method::weld::SeamPath;
use weldpath_method::weld::air::terrain::{Ball, Terrain};
use weldpath_method::weld::air::{End, Surroundings};
use weldpath_method::weld::ends::reverse;
use weldpath_method::weld::ordering;
use weldpath_method::weld::ordering::{AirWays, AllowedDirection, Gates, MOST_ORDERED, Turn, uphill};
use weldpath_method::weld::program::{Pass, Program, Waypoint, program};
use weldpath_method::weld::recipe::{Recipe, apply};

/// What a run leaves behind.
#[derive(Debug)]
pub struct Output {
    /// The selected seams' paths, one for each pass, in the order in which they are welded.
    pub paths: Vec<SeamPath>,
    /// The complete program.
    pub program: Program,
    /// What was found and how.
    pub summary: Summary,
    /// Whether robot and torch can run the program; none if the job has neither.
    pub feasibility: Option<Report>,
    /// The files of the run, the summary among them.
    pub files: Vec<File>,
    /// Names of those that are the program; none of a plan that is refused.
    pub program_files: Vec<String>,
}

/// Why a plan leads to no files.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The selection leaves nothing.
    #[error(transparent)]
    Selection(#[from] selection::Error),
    /// No such rest of a weld.
    #[error(transparent)]
    Resuming(#[from] resuming::Error),
    /// A seam that is too long for one of the robots' programs.
    #[error(transparent)]
    TooLong(#[from] moves::TooLong),
    /// More welded points than a program may have.
    #[error("seam {seam} brings the job to {points} welded points, and a program may have {MOST_POINTS}")]
    TooMany {
        /// [`weldpath_method::seam::Seam::id`].
        seam: usize,
        /// Of it and the seams before it.
        points: usize,
    },
    /// [`Observer::is_done`] said so.
    #[error("the plan was given up")]
    GivenUp,
}

/// Welded points of all passes of a job. No controller loads a program of this length (some 25 MB of URScript); beyond it
/// time and memory of a plan would be those of its files alone.
pub const MOST_POINTS: usize = 100_000;

/// Everything that follows from `plan` and `job`; writes nothing.
///
/// # Errors
/// If the selection leaves nothing, or too much for a program.
pub fn postprocess(plan: &Plan, job: &Job, source: Source) -> Result<Output, Error> {
    postprocess_observed(plan, job, source, &mut ())
}

/// As [`postprocess`]; the observer is told of the stages `order`, `air` and `torch`, and may give them up.
///
/// # Errors
/// Those of [`postprocess`], and if the observer wants no more.
pub fn postprocess_observed(
    plan: &Plan,
    job: &Job,
    source: Source,
    observer: &mut dyn Observer,
) -> Result<Output, Error> {
    unless_given_up(|| output(plan, job, source, &mut Stages::new(observer))).unwrap_or(Err(Error::GivenUp))
}

fn output(plan: &Plan, job: &Job, source: Source, stages: &mut Stages) -> Result<Output, Error> {
    let frame = source.frame;
    // Found here, where it may be given up, for all that ask for it below.
    stages.stage("torch", || access::inside(plan, job));
    let left_out = verdict::left_out(plan, job);
    let mut selected = chosen(plan, job)?;
    let mut inside = wanted(plan, job)?;
    inside.retain(|path| selected.iter().all(|chosen| chosen.seam != path.seam));
    selected.retain(|path| !left_out.contains(&path.seam));
    let resume = job.resume.as_ref();
    let ordered = stages.stage("order", || ordered(selected, plan, job))?;
    let seams = resuming::seams(ordered, resume)?;
    let whole = seams.iter().flat_map(|(path, weld)| passes(path, weld, job.method, &[])).collect();
    let passes = resuming::passes(whole, resume)?;
    let terrain = terrain(&passes, plan, job);
    let program = stages.stage("air", || program(&passes, &terrain));
    let mut warnings = plan.said.warnings.clone();
    warnings.extend(passes.iter().filter_map(shortened_away));
    warnings.extend(program.warnings.iter().cloned());
    warnings.extend(tool_warning(job));
    warnings.extend(order_warning(seams.len(), job));
    let feasibility = stages.stage("torch", || feasibility(plan, job, &seams, &terrain));
    warnings.extend(feasibility.iter().flat_map(Report::warnings));
    let paths: Vec<SeamPath> = passes.into_iter().map(|pass| pass.path).collect();
    let free = undirected(&seams);
    let lines: Vec<SeamPath> = seams.into_iter().map(|(path, _)| path).collect();
    let mut found = source.findings.clone();
    found.extend(verdict::of_plan(plan, job));
    found.extend(of_paths(plan, &lines, &paths, &inside));
    let verdict = || verdict_on(&program.waypoints, plan.surface(), job, feasibility.as_ref(), found);
    let verdict = stages.stage("torch", verdict);
    let summary = Summary::new(plan, source, &lines, &paths, job.order.up.get(), warnings)
        .with_joints(plan, &stated_joints(plan, job)?, &lines, job.order.up.get())
        .with_downhill(&free)
        .with_feasibility(feasibility.as_ref())
        .with_verdict(verdict);
    let mut files = vec![File::new("path.csv", csv::write(&paths, frame))];
    let mut program_names = Vec::new();
    if summary.verdict().state != State::Refused {
        let posture = feasibility.as_ref().and_then(|report| report.posture.clone());
        let remarks =
            resume.map(ResumeSettings::words).into_iter().chain(summary.verdict().lines()).collect();
        let setup = ProgramSetup { posture, remarks, ..job.program_setup() };
        let programs = program_files(&program.waypoints, frame, job, &setup)?;
        program_names.extend(programs.iter().map(|file| file.name.clone()));
        files.extend(programs);
    }
    files.push(File::new("model.ply", ply::write(&plan.model, frame)));
    if !plan.derived.views.is_empty() {
        files.push(File::new("views.json", views::write(&plan.derived.views)));
    }
    files.push(File::new("job.toml", job.to_toml()));
    files.push(File::new(summary::FILE, summary.to_json()));
    if let Some(report) = &feasibility {
        files.push(File::new("feasibility.csv", feasibility_csv::csv(&program.waypoints, report)));
    }
    Ok(Output { paths, program, summary, feasibility, files, program_files: program_names })
}

fn order_warning(seams: usize, job: &Job) -> Option<String> {
    (job.order.sequence == Sequence::Shortest && seams > MOST_ORDERED).then(|| {
        format!(
            "{seams} seams are welded in the order in which they were found: the order is optimised only for up to {MOST_ORDERED}"
        )
    })
}

/// The program, in the coordinates of `frame`, in every form in which it is written.
pub fn program_files(
    waypoints: &[Waypoint],
    frame: PathFrame,
    job: &Job,
    setup: &ProgramSetup,
) -> Result<Vec<File>, moves::TooLong> {
    let mut files = vec![File::new("path.json", json::write(waypoints, frame))];
    for dialect in job.dialects().into_iter().collect::<BTreeSet<_>>() {
        files.extend(dialect.write(waypoints, setup)?);
    }
    Ok(files)
}

/// The seams that the job chooses and does not switch off, whatever the verdict says of them; of those to which its torch does
/// not get, only what it names.
///
/// # Errors
/// If that is none, or the job names a seam that there is not.
pub fn chosen(plan: &Plan, job: &Job) -> Result<Vec<SeamPath>, selection::Error> {
    let mut paths = wanted(plan, job)?;
    let inside = verdict::inside_unnamed(plan, job);
    // Where there is nothing else, its collisions say what is wrong.
    if paths.iter().any(|path| !inside.contains(&path.seam)) {
        paths.retain(|path| !inside.contains(&path.seam));
    }
    Ok(paths)
}

/// The seams that the job chooses and does not switch off, wherever its torch gets.
///
/// # Errors
/// If that is none, or the job names a seam that there is not.
pub(crate) fn wanted(plan: &Plan, job: &Job) -> Result<Vec<SeamPath>, selection::Error> {
    let mut paths = select(&plan.paths, &job.selection)?;
    for own in job.seams.iter().filter(|own| !own.weld) {
        let off = selection::named(&plan.paths, own)?;
        paths.retain(|path| Some(path.seam) != off);
        if paths.is_empty() {
            return Err(selection::Error::NoneLeft);
        }
    }
    Ok(paths)
}

/// Ids of the seams in the order in which the job's `[[seam]]` list them.
///
/// # Errors
/// If one of these names a seam that there is not.
pub fn listed(plan: &Plan, job: &Job) -> Result<Vec<usize>, selection::Error> {
    let ids = job.seams.iter().map(|own| selection::named(&plan.paths, own));
    Ok(ids.collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect())
}

/// The seams in the order and direction in which they are welded, each with its settings.
fn ordered(mut paths: Vec<SeamPath>, plan: &Plan, job: &Job) -> Result<Vec<(SeamPath, Weld)>, Error> {
    if job.order.sequence == Sequence::Listed {
        let listed = listed(plan, job)?;
        let place = |path: &SeamPath| listed.iter().position(|&id| id == path.seam);
        // Stable, and in the order found before.
        paths.sort_by_key(|path| place(path).unwrap_or(usize::MAX));
    }
    let mut seams = Vec::with_capacity(paths.len());
    let mut points = 0;
    for path in paths {
        let weld = weld(&path, plan, job)?;
        let of_pass = |pass: &Pass| pass.path.points.len();
        points += passes(&path, &weld, job.method, &[]).iter().map(of_pass).sum::<usize>();
        if points > MOST_POINTS {
            return Err(Error::TooMany { seam: path.seam, points });
        }
        seams.push((path, weld));
    }
    let ways: Vec<AllowedDirection> = seams.iter().map(|(path, weld)| way(path, weld, job)).collect();
    let order = match job.order.sequence {
        Sequence::Shortest if (2..=MOST_ORDERED).contains(&seams.len()) => shortest(&seams, &ways, plan, job),
        _ => ordering::found(&ways),
    };
    let turned = |Turn { index, reverse: turn }| {
        let (path, weld) = &seams[index];
        (if turn { reverse(path) } else { path.clone() }, weld.clone())
    };
    Ok(order.into_iter().map(turned).collect())
}

/// The order with the least air way; that in which they were found if one of them is not welded at all.
fn shortest(seams: &[(SeamPath, Weld)], ways: &[AllowedDirection], plan: &Plan, job: &Job) -> Vec<Turn> {
    let both = |(path, weld): &(SeamPath, Weld)| {
        [path.clone(), reverse(path)].map(|path| passes(&path, weld, job.method, &[]))
    };
    let runs: Vec<[Vec<Pass>; 2]> = seams.iter().map(both).collect();
    let all: Vec<Pass> = runs.iter().flatten().flatten().cloned().collect();
    let terrain = terrain(&all, plan, job);
    let around = Surroundings::new(&terrain, &all);
    let gates = |(runs, way): (&[Vec<Pass>; 2], &AllowedDirection)| {
        let [forward, reverse] = [gate(&runs[0], &around)?, gate(&runs[1], &around)?];
        Some(Gates { forward, reverse, way: *way })
    };
    match runs.iter().zip(ways).map(gates).collect::<Option<Vec<Gates>>>() {
        Some(gates) => ordering::shortest(&AirWays::new(&gates, &around)),
        None => ordering::found(ways),
    }
}

/// The approach of the first pass and the retract of the last.
fn gate(passes: &[Pass], around: &Surroundings) -> Option<[End; 2]> {
    let mut run = passes.iter().filter_map(|pass| Some((pass.ends()?, &pass.motion)));
    let ([first, end], motion) = run.next()?;
    let ([_, last], last_motion) = run.next_back().unwrap_or(([first, end], motion));
    Some([around.end(first, motion.approach_mm), around.end(last, last_motion.retract_mm)])
}

/// What the air moves stay clear of: the greatest clearance of all passes holds for all.
fn terrain<'a>(passes: &[Pass], plan: &'a Plan, job: &Job) -> Terrain<'a> {
    let clearance_mm = passes.iter().map(|pass| pass.motion.clearance_mm).fold(0.0, f64::max);
    let torch: Option<Vec<Ball>> = match job.order.air {
        AirMoves::Shortest => Some(job.torch_body().balls()),
        AirMoves::SafeLevel => None,
    };
    Terrain::new(plan.surface(), passes.iter().map(|pass| &pass.path), clearance_mm, torch.as_deref())
}

/// Joint types that the job states, by the ids of the seams; of several for one seam the last holds.
///
/// # Errors
/// If the job names a seam that there is not.
fn stated_joints(plan: &Plan, job: &Job) -> Result<BTreeMap<usize, Joint>, selection::Error> {
    let mut stated = BTreeMap::new();
    for own in &job.seams {
        if let (Some(joint), Some(id)) = (own.joint, selection::named(&plan.paths, own)?) {
            stated.insert(id, joint);
        }
    }
    Ok(stated)
}

/// The job's settings with those of the joint type and then of the seam on top; of several that name it the later ones lie above.
///
/// # Errors
/// If the job names a seam that there is not.
pub fn weld(path: &SeamPath, plan: &Plan, job: &Job) -> Result<Weld, selection::Error> {
    let mut weld = job.weld();
    let found = plan.seams.iter().find(|seam| seam.id == path.seam).map(|seam| seam.joint);
    let joint = stated_joints(plan, job)?.get(&path.seam).copied().or(found);
    if let Some(of_joint) = joint.and_then(|joint| job.joints.get(&joint)) {
        weld = of_joint.on(&weld);
    }
    for own in &job.seams {
        if selection::named(&plan.paths, own)? == Some(path.seam) {
            weld = own.weld().on(&weld);
        }
    }
    Ok(weld)
}

fn way(path: &SeamPath, weld: &Weld, job: &Job) -> AllowedDirection {
    match weld.direction() {
        Direction::Free if job.order.sequence == Sequence::Shortest => AllowedDirection::Free,
        Direction::Free => AllowedDirection::Forward,
        Direction::Forward => AllowedDirection::Forward,
        Direction::Reverse => AllowedDirection::Reverse,
        Direction::Up => uphill(path, job.order.up.get()),
        Direction::Down => uphill(path, -job.order.up.get()),
    }
}

/// Ids of the seams of which nobody said which way they are welded.
fn undirected(seams: &[(SeamPath, Weld)]) -> Vec<usize> {
    let free = seams.iter().filter(|(_, weld)| weld.direction() == Direction::Free);
    free.map(|(path, _)| path.seam).collect()
}

/// What stands against the paths: `inside` are those that the torch does not get to.
fn of_paths(plan: &Plan, lines: &[SeamPath], paths: &[SeamPath], inside: &[SeamPath]) -> Vec<Finding> {
    let left = inside.iter().map(verdict::left_inside);
    let tips = verdict::tips_inside(paths, &plan.paths, &plan.model);
    verdict::many_seams(lines).into_iter().chain(left).chain(tips).collect()
}

/// The passes of a seam, with the changes that name it.
fn passes(path: &SeamPath, weld: &Weld, method: Method, changes: &[(usize, Change)]) -> Vec<Pass> {
    let own = || changes.iter().filter(|(seam, _)| *seam == path.seam).map(|(_, change)| change);
    let turned = own().filter(|change| change.reverses()).count() % 2 == 1;
    let path = if turned { reverse(path) } else { path.clone() };
    // The paper's edge points come in no order that could be sampled anew.
    let recipe = |recipe: Recipe| match method {
        Method::Paper => Recipe { sampling: None, ..recipe },
        Method::Weldpath => recipe,
    };
    let changed = |first: Recipe| own().fold(first, |recipe, change| change.on(recipe));
    let pass = |(own, motion)| Pass { path: apply(&path, &recipe(changed(own))), motion };
    weld.passes().into_iter().map(pass).collect()
}

fn shortened_away(pass: &Pass) -> Option<String> {
    let text = format!(
        "seam {} is not welded: extend_start_mm and extend_end_mm shorten it by more than its length",
        pass.path.seam
    );
    pass.path.points.is_empty().then_some(text)
}

/// Reach, joints and torch, if the job says with what.
fn feasibility(plan: &Plan, job: &Job, seams: &[(SeamPath, Weld)], terrain: &Terrain) -> Option<Report> {
    let rewelded = |changes: &[(usize, Change)]| {
        let run = |(path, weld): &(SeamPath, Weld)| passes(path, weld, job.method, changes);
        let whole = seams.iter().flat_map(run).collect();
        program(&resuming::passes(whole, job.resume.as_ref()).unwrap_or_default(), terrain).waypoints
    };
    Some(feasibility::assess(&rewelded, plan.surface(), &job.feasibility()?))
}

/// What `found` and torch and arm say of a program; a torch of usual size is held against the scan where the job says
/// nothing of one.
pub(super) fn verdict_on(
    program: &[Waypoint],
    work: &Surface,
    job: &Job,
    feasibility: Option<&Report>,
    mut found: Vec<Finding>,
) -> Verdict {
    found.extend(match feasibility {
        Some(report) => verdict::of_problems(&report.problems, report.robot.as_deref().unwrap_or_default()),
        None => verdict::of_problems(&feasibility::collisions(program, work, job.torch_body()), ""),
    });
    found.extend(verdict::of_arm(job));
    let limits = feasibility.map(verdict::limits).unwrap_or_default();
    Verdict::new(found, &job.accept).with_limits(limits)
}

fn tool_warning(job: &Job) -> Option<String> {
    let text = "the robot program uses the TCP and payload that are set on the controller; give them as [tool] in a job file";
    let assumed = if job.robot.as_ref().and_then(RobotSettings::arm).is_some() {
        format!(
            "; for the feasibility check the tip is taken {ASSUMED_TCP_MM} mm straight ahead of the flange"
        )
    } else {
        String::new()
    };
    job.tool.is_none().then(|| format!("{text}{assumed}"))
}
