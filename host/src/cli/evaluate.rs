//! `weldpath evaluate`: a plan against the truth, as the paper's section III measures it.

use std::fmt::{Display, Write};
use std::path::{Path, PathBuf};

use clap::builder::{PossibleValuesParser, TypedValueParser};
use nalgebra::Vector3;
use serde::Serialize;
use weldpath::evaluation;
use weldpath::evaluation::{CELL_MM, Error, F1, Options, PathSet, Score, Target, Truth, align, f1, score};
use weldpath::files::File;
use weldpath::files::reading;
use weldpath::lab::comparison;
use weldpath::lab::suite::{Tally, tally};
use weldpath::report;
use weldpath::run::job::Job;
use weldpath::run::job::quantity::StandoffMm;
use weldpath::run::job::scan::AnchorName;

use super::folder::{Folder, FolderArgs, settle};
use super::{Exit, Failure, print, suite, tell};

/// Score a plan against the truth, or against a path that was taught
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Folder that `weldpath plan` wrote, or a path.csv
    #[arg(required_unless_present_any = ["paper", "suite"])]
    dir: Option<PathBuf>,
    /// truth.json of a simulated scan, or a taught path as CSV
    #[arg(long, value_name = "FILE", required_unless_present_any = ["paper", "suite"])]
    truth: Option<PathBuf>,
    /// Which line of a groove the path should follow
    #[arg(long, default_value = "apex", value_parser = PossibleValuesParser::new(["apex", "root"]).map(target))]
    target: Target,
    /// How far the path was held off the seam [default: as DIR/job.toml says]
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    standoff_mm: Option<StandoffMm>,
    /// Print the scores as JSON
    #[arg(long)]
    json: bool,
    /// Show the deviation in DIR/report.html as well
    #[arg(long)]
    report: bool,
    /// Plan every scan, mesh and cloud below this folder instead, and print what is covered and what is false
    #[arg(long, value_name = "DIR", conflicts_with_all = ["dir", "truth", "standoff_mm", "report", "paper"])]
    suite: Option<PathBuf>,
    /// With --suite: what holds the models in the base frame, as `weldpath plan --anchor`
    #[arg(long, value_enum, default_value_t, requires = "suite")]
    anchor: AnchorName,
    /// Make the paper's tables and figures instead, beside its numbers: DIR/paper.html
    #[arg(long, conflicts_with_all = ["dir", "truth", "standoff_mm", "report"])]
    paper: bool,
    /// Folder for the pages of --paper
    #[arg(long, value_name = "DIR", default_value = "paper", requires = "paper")]
    out: PathBuf,
    #[command(flatten)]
    folder: FolderArgs,
    /// Runs of each row of the run-time table of --paper
    #[arg(long, value_name = "N", default_value_t = 20, requires = "paper", value_parser = clap::value_parser!(u16).range(1..=1000))]
    runs: u16,
    /// The repository's folder of fixtures
    #[arg(long, value_name = "DIR", default_value = "fixtures", requires = "paper")]
    fixtures: PathBuf,
    /// Print nothing but errors
    #[arg(long, short, conflicts_with = "json")]
    quiet: bool,
}

fn target(name: String) -> Target {
    if name == "root" { Target::Root } else { Target::Apex }
}

/// Everything that is printed.
#[derive(Debug, Serialize)]
struct Evaluation {
    #[serde(flatten)]
    score: Score,
    /// Path points against the visible stations of the truth.
    f1: Option<F1>,
    /// How much of the visible welds is welded, and how much of the rest is named; none without `summary.json`.
    found: Option<Tally>,
    /// What the best rigid motion onto the truth leaves, which is not of the registration.
    /// None where most points belong to no seam, and a motion onto the seams means nothing.
    aligned: Option<Moved>,
    /// The largest errors that the plan states; none without `summary.json`.
    stated: Option<Stated>,
    /// Per view, as `summary.json` has them; empty without one.
    fitness: Vec<Fitness>,
}

/// The paths moved as one body onto the true seams.
#[derive(Debug, Serialize)]
struct Moved {
    moved_mm: f64,
    turned_deg: f64,
    rmse_mm: Option<f64>,
    rmse_deg: Option<f64>,
}

/// Share of path points that belong to no seam from which on the paths are not moved onto the seams.
const MOSTLY_FALSE: f64 = 0.5;

impl Moved {
    /// By the truth's own line; `standoff_mm` is taken away first.
    fn onto(truth: &Truth, paths: &PathSet, options: &Options) -> Self {
        let aligned = align(&paths.on_seams(options.standoff_mm), truth, options.target);
        let left = score(&aligned.paths, truth, &Options { standoff_mm: 0.0, ..*options });
        let evaluation::Aligned { moved_mm, turned_deg, .. } = aligned;
        Self { moved_mm, turned_deg, rmse_mm: left.rmse_mm, rmse_deg: left.rmse_deg }
    }
}

/// One standard deviation across the seam, of the seam that is worst known.
#[derive(Debug, Serialize)]
struct Stated {
    /// In the frame of the path.
    expected_mm: f64,
    within_scan_mm: f64,
}

#[derive(Debug, Serialize)]
struct Fitness {
    view: String,
    before: f64,
    after: f64,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    if let Some(folder) = &args.suite {
        return suite::run(folder, args.anchor, args.json, args.quiet);
    }
    match (&args.dir, &args.truth) {
        (Some(dir), Some(truth)) if !args.paper => against(args, dir, truth),
        _ => paper(args),
    }
}

/// The paper's section III.
fn paper(args: &Args) -> Result<(), Failure> {
    let folder = Folder::new(&args.out, args.folder, args.quiet);
    folder.check(&[])?;
    let settings = comparison::Options { fixtures: args.fixtures.clone(), runs: usize::from(args.runs) };
    let begin = &mut |what: &str| {
        if !args.quiet {
            tell(&format!("{what} ..."));
        }
    };
    let measured = comparison::measure(&settings, begin).map_err(|error| {
        Failure::new(Exit::Input, error)
            .hint("run it in the repository, or name its fixtures with --fixtures")
    })?;
    let files = measured.files();
    folder.write(&files)?;
    if args.quiet {
        return Ok(());
    }
    let page = files.iter().find(|file| file.name == if args.json { "paper.json" } else { "paper.md" });
    print(&page.map_or_else(String::new, |file| String::from_utf8_lossy(&file.bytes).into_owned()))
}

fn against(args: &Args, dir: &Path, truth: &Path) -> Result<(), Failure> {
    if dir.is_dir() {
        settle(dir)?;
    }
    let csv = if dir.is_dir() { dir.join("path.csv") } else { dir.to_path_buf() };
    let paths = PathSet::read(&csv).map_err(not_read)?;
    let truth = Truth::read(truth).map_err(not_read)?;
    let options = Options { target: args.target, standoff_mm: standoff_mm(args, dir)?, ..Options::default() };
    let points: Vec<[f64; 3]> = paths.points_mm.iter().map(|&p| p.into()).collect();
    let score = score(&paths, &truth, &options);
    let summary = summary(dir);
    let evaluation = Evaluation {
        aligned: (score.false_share < MOSTLY_FALSE).then(|| Moved::onto(&truth, &paths, &options)),
        score,
        f1: f1(&points, &truth.visible_mm(args.target), CELL_MM),
        found: named(&summary).map(|named| tally(&paths.on_seams(options.standoff_mm), &named, &truth)),
        stated: stated(&summary),
        fitness: fitness(&summary),
    };
    if args.report {
        add_to_report(args, dir, &report::deviation(&paths, &truth, &options))?;
    }
    if args.quiet {
        return Ok(());
    }
    let json = || serde_json::to_string_pretty(&evaluation).map(|text| text + "\n").unwrap_or_default();
    print(&if args.json { json() } else { table(&evaluation) })
}

/// Rewrites the page with the deviation in it.
fn add_to_report(args: &Args, dir: &Path, deviation: &str) -> Result<(), Failure> {
    let path = dir.join(report::PAGE);
    let hint = "run `weldpath plan` without --no-report, and give its folder";
    let missing =
        |error: &dyn Display| Failure::new(Exit::Input, format!("cannot read {}: {error}", path.display()));
    let page = reading::text(&path, reading::MOST_RESULT).map_err(|error| missing(&error).hint(hint))?;
    let page = report::with_deviation(&page, deviation).ok_or_else(|| missing(&"no report").hint(hint))?;
    // Nothing else in the folder has become old by it.
    Folder::new(dir, args.folder, true).write(&[File::new(report::PAGE, page)])
}

/// How far the path was held off, by the job beside it.
fn standoff_mm(args: &Args, dir: &Path) -> Result<f64, Failure> {
    let home = if dir.is_dir() { dir } else { dir.parent().unwrap_or(Path::new("")) };
    let file = home.join("job.toml");
    match (args.standoff_mm, file.is_file()) {
        (Some(given), _) => Ok(given.get()),
        (None, true) => {
            let job = Job::read(&file).map_err(|e| Failure::new(Exit::Input, &e).hint(e.hint()))?;
            let mut standoffs_mm = job.recipes().into_iter().map(|recipe| recipe.standoff_mm);
            let first = standoffs_mm.next().unwrap_or(0.0);
            if standoffs_mm.any(|other| other != first) {
                let message = format!("in {} seams or passes differ in standoff_mm", file.display());
                return Err(
                    Failure::new(Exit::Usage, message).hint("say which one counts with --standoff-mm")
                );
            }
            Ok(first)
        }
        (None, false) => Ok(0.0),
    }
}

/// The plan's summary; nothing beside a lone path.
fn summary(dir: &Path) -> serde_json::Value {
    let text = std::fs::read_to_string(dir.join("summary.json")).unwrap_or_default();
    serde_json::from_str(&text).unwrap_or_default()
}

/// Places along the corners that the plan names and does not weld.
fn named(summary: &serde_json::Value) -> Option<Vec<Vector3<f64>>> {
    let lines = summary["unwelded"].as_array()?.iter().filter_map(|corner| corner["line_mm"].as_array());
    let place = |place: &serde_json::Value| serde_json::from_value::<[f64; 3]>(place.clone()).ok();
    Some(lines.flatten().filter_map(place).map(Vector3::from).collect())
}

fn stated(summary: &serde_json::Value) -> Option<Stated> {
    let selected =
        || summary["seams"].as_array().into_iter().flatten().filter(|seam| seam["selected"] == true);
    let largest = |key: &str| selected().filter_map(|seam| seam[key].as_f64()).reduce(f64::max);
    Some(Stated { expected_mm: largest("expected_error_mm")?, within_scan_mm: largest("relative_mm")? })
}

/// Fitness per view.
fn fitness(summary: &serde_json::Value) -> Vec<Fitness> {
    let view = |view: &serde_json::Value| {
        Some(Fitness {
            view: view["name"].as_str()?.to_owned(),
            before: view["fitness_before"].as_f64()?,
            after: view["fitness_after"].as_f64()?,
        })
    };
    summary["views"].as_array().into_iter().flatten().filter_map(view).collect()
}

fn table(evaluation: &Evaluation) -> String {
    let score = &evaluation.score;
    let mut text = String::new();
    let mut line = |name: &str, value: String| {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "{name:<22} {value}");
    };
    line("position RMSE", format!("{} mm, 95 % below {} mm", number(score.rmse_mm), number(score.p95_mm)));
    if let Some(Stated { expected_mm, within_scan_mm }) = &evaluation.stated {
        line(
            "stated by the plan",
            format!(
                "up to {expected_mm:.3} mm, within the scan {within_scan_mm:.3} mm (one standard deviation)"
            ),
        );
    }
    line("orientation RMSE", format!("{} deg", number(score.rmse_deg)));
    line("coverage", format!("{:.1} % of the visible required seams", 100.0 * score.coverage));
    if let Some(Tally { weld_mm, covered, named, .. }) = &evaluation.found {
        let [welded, named, missed] =
            [*covered, *named, 1.0 - covered - named].map(|share| 100.0 * share.max(0.0));
        line(
            "visible welds",
            format!(
                "{weld_mm:.0} mm: {welded:.1} % welded, {named:.1} % named, {missed:.1} % missed without a word"
            ),
        );
    }
    line("false path points", format!("{:.1} % of {}", 100.0 * score.false_share, score.points));
    if let Some(f1) = &evaluation.f1 {
        line(
            "F1 on three rasters",
            format!("{:.3} (recall {:.3}, precision {:.3})", f1.dice, f1.recall, f1.precision),
        );
    }
    if let Some(Moved { moved_mm, turned_deg, rmse_mm, rmse_deg }) = &evaluation.aligned {
        let left = format!("{} mm, {} deg", number(*rmse_mm), number(*rmse_deg));
        line("moved as one body", format!("by {moved_mm:.3} mm, {turned_deg:.3} deg leaves {left}"));
    }
    for fitness in &evaluation.fitness {
        line(&format!("fitness {}", fitness.view), format!("{:.3} -> {:.3}", fitness.before, fitness.after));
    }
    for (name, seam) in &score.seams {
        let covered = seam.coverage.map_or("-".to_owned(), |share| format!("{:.1} %", 100.0 * share));
        line(
            &format!("true seam {name}"),
            format!("{} mm, {} deg, covered {covered}", number(seam.rmse_mm), number(seam.rmse_deg)),
        );
    }
    text
}

fn number(value: Option<f64>) -> String {
    value.map_or("-".to_owned(), |value| format!("{value:.3}"))
}

fn not_read(error: evaluation::Error) -> Failure {
    let failure = Failure::new(Exit::Input, &error);
    match error {
        Error::Read { .. } => failure.hint("give the folder that `weldpath plan` wrote, and --truth a file"),
        Error::Malformed { .. } => failure.hint(
            "--truth is the truth.json of `weldpath simulate`, or a CSV with columns x_mm, y_mm, z_mm; so is a path.csv",
        ),
    }
}
