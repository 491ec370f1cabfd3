//! What is kept of a plan saves the next one its stages, and never changes a byte of what comes of it.

use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use weldpath::files::File;
use weldpath::pipeline::{Evidence, Observer};
use weldpath::report::{self, Recording};
use weldpath::run::job::Job;
use weldpath::run::planning::{self, Kept, Searched};
use weldpath::run::postprocessing::postprocess;
use weldpath_tests::command::{ends_well, weldpath};

/// Counts the stages, and keeps what the report shows.
#[derive(Default)]
struct Watch {
    stages: Vec<&'static str>,
    recording: Recording,
}

impl Observer for Watch {
    fn stage(&mut self, name: &'static str) {
        self.stages.push(name);
    }

    fn evidence(&mut self, evidence: &Evidence) {
        self.recording = Recording::of(evidence);
    }
}

/// The stages that began, and what was found.
fn find(job: &Job, kept: &Kept<Recording>) -> (Vec<&'static str>, Result<Arc<Searched<Recording>>, String>) {
    let mut watch = Watch::default();
    let seen = |watch: &mut Watch| std::mem::take(&mut watch.recording);
    let found = planning::find(job, false, kept, &mut watch, seen).map_err(|error| error.to_string());
    (watch.stages, found)
}

/// All files of a run. How long its stages took is left out: no two runs take the same.
fn files(found: &Searched<Recording>, job: &Job) -> Result<Vec<File>, String> {
    let mut plan = found.plan.clone();
    plan.stage_s.clear();
    let source = planning::source(&found.scan, job);
    let mut output = postprocess(&plan, job, source).map_err(|error| error.to_string())?;
    let report = report::files(&plan, &output, &found.seen, job);
    output.files.extend(report);
    Ok(output.files)
}

fn outcome(job: &Job, kept: &Kept<Recording>) -> (Vec<&'static str>, Result<Vec<File>, String>) {
    let (stages, found) = find(job, kept);
    (stages, found.and_then(|found| files(&found, job)))
}

/// A T joint in a few small views.
fn scan(home: &Path) -> Job {
    let command =
        ["simulate", "--part", "fillet", "--size", "200x150", "--views", "4", "--quiet", "--out", "scan"];
    ends_well(weldpath().args(command).current_dir(home));
    Job { input: Some(home.join("scan")), ..Job::default() }
}

fn with(job: &Job, text: &str) -> Job {
    let edited = Job::parse(text, Path::new("job.toml")).unwrap_or_else(|error| panic!("{text}: {error}"));
    Job { input: job.input.clone(), ..edited }
}

#[test]
fn an_edit_of_how_seams_are_welded_begins_no_stage_and_takes_a_twentieth_of_a_plan() {
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("fixtures/cell");
    let job = Job { input: Some(fixture), ..Job::default() };
    let kept = Kept::default();
    let begun = Instant::now();
    let (stages, found) = find(&job, &kept);
    let whole = begun.elapsed();
    assert!(
        ["scan", "normals", "reconstruction", "seam", "toolpath"].iter().all(|s| stages.contains(s)),
        "{stages:?}"
    );
    let searched = found.unwrap();
    let after = |text: &str| {
        // The least of a few: what else the machine does only adds.
        let once = |feed: u32| {
            let edited = with(&job, &format!("[path]\nfeed_mm_s = {feed}\n{text}"));
            let begun = Instant::now();
            let (stages, found) = find(&edited, &kept);
            assert_eq!(stages, [""; 0], "no stage begins");
            let found = found.unwrap();
            assert!(Arc::ptr_eq(&found, &searched));
            postprocess(&found.plan, &edited, planning::source(&found.scan, &edited)).unwrap();
            begun.elapsed()
        };
        (3..8).map(once).min().unwrap()
    };
    for (edit, text) in [
        ("stand-off and angle", "standoff_mm = 12\n[torch]\nwork_angle_deg = 5"),
        ("a weave", "[weave]\nshape = \"sine\""),
    ] {
        let least = after(text);
        let share = least.as_secs_f64() / whole.as_secs_f64();
        println!("plan {whole:.0?}, after an edit of {edit} {least:.1?}: {:.1} % of it", 100.0 * share);
        assert!(share < 0.05 || edit == "a weave", "{share}");
    }
}

#[test]
fn what_the_pipeline_is_told_or_given_begins_its_stages_again_and_undoing_it_does_not() {
    let home = tempfile::tempdir().unwrap();
    let job = scan(home.path());
    let kept = Kept::default();
    let begins = |job: &Job| find(job, &kept).0;
    assert!(begins(&job).contains(&"seam"));
    let anchored = with(&job, "[scan]\nanchor = \"first\"");
    assert!(begins(&anchored).contains(&"normals"));
    assert!(begins(&job).is_empty(), "undone");
    assert!(begins(&anchored).is_empty(), "and done again");

    // The same bytes, written anew, are the same scan; other bytes are another.
    let view = home.path().join("scan/view_000.png");
    let bytes = fs::read(&view).unwrap();
    fs::write(&view, &bytes).unwrap();
    assert!(begins(&job).is_empty());
    let json = home.path().join("scan/scan.json");
    let text = fs::read_to_string(&json).unwrap();
    fs::write(&json, text.clone() + "\n").unwrap();
    assert_eq!(begins(&job), ["scan"], "it is read again, and says the same");
    fs::write(&json, text).unwrap();
    fs::copy(home.path().join("scan/view_001.png"), &view).unwrap();
    let moved = begins(&job);
    assert!(moved.starts_with(&["scan", "normals"]), "{moved:?}");
    fs::write(&view, bytes).unwrap();
    assert_eq!(begins(&job), ["scan"], "as it was: what was found in it is kept");
}

/// xorshift64*, Vigna 2016.
struct Random(u64);

impl Random {
    fn below(&mut self, most: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) as usize % most
    }
}

/// Lines of a job file, each with what it may say; the first of each says nothing. Those at the top are what the pipeline reads.
const SAYINGS: [&[&str]; 14] = [
    &["", "units = \"m\"\n"],
    &["", "method = \"weldpath\"\n"],
    &["", "accept = [\"tool-not-stated\"]\n", "accept = [\"units\", \"base-error-over-limit\"]\n"],
    &["", "formats = [\"abb\", \"kuka\"]\n", "formats = []\n"],
    &["", "[scan]\nanchor = \"first\"\n"],
    &[
        "",
        "[exclude]\nboxes_mm = [[[-2000, -2000, -2000], [2000, 2000, 2.5]]]\n",
        "[exclude]\nboxes_mm = [[[0, 0, 0], [1, 1, 1]]]\n",
    ],
    &["", "[selection]\nseams = [1]\n", "[selection]\nseams = [7]\n"],
    &["", "[order]\nsequence = \"found\"\nair = \"safe-level\"\n"],
    &["", "[path]\nfeed_mm_s = 4.5\nstandoff_mm = 12\n", "[path]\npoints = 33\nextend_end_mm = -5\n"],
    &["", "[torch]\nwork_angle_deg = 5\ntravel_angle_deg = -8\n"],
    &["", "[weave]\nshape = \"zigzag\"\n", "[weave]\nshape = \"sine\"\namplitude_mm = 1\n"],
    &["", "[robot]\nmodel = \"ur10e\"\n", "[robot]\nmodel = \"kuka-kr10-r1420\"\n"],
    &["", "[program]\nname = \"other\"\n"],
    &["", "[[pass]]\n[[pass]]\nout_mm = 3\n", "[[seam]]\nid = 1\npath.direction = \"reverse\"\n"],
];

#[test]
fn after_random_edits_every_file_is_that_of_a_fresh_run_to_the_byte() {
    const EDITS: usize = 40;
    let home = tempfile::tempdir().unwrap();
    let job = scan(home.path());
    let json = home.path().join("scan/scan.json");
    let text = fs::read_to_string(&json).unwrap();
    let mut random = Random(0x5eed_cafe);
    let mut says = [0; SAYINGS.len()];
    let kept = Kept::default();
    let (mut spared, mut refused) = (0, 0);
    for edit in 0..EDITS {
        let at = random.below(SAYINGS.len());
        says[at] = random.below(SAYINGS[at].len());
        // Now and then the scan itself is another one: that without its last view.
        if random.below(6) == 0 {
            let mut scan: serde_json::Value = serde_json::from_str(&text).unwrap();
            if random.below(2) == 0 {
                scan["views"].as_array_mut().unwrap().pop();
            }
            fs::write(&json, scan.to_string()).unwrap();
        }
        let said: String = SAYINGS.iter().zip(says).map(|(saying, at)| saying[at]).collect();
        let edited = with(&job, &said);
        let (stages, from_kept) = outcome(&edited, &kept);
        let (_, fresh) = outcome(&edited, &Kept::default());
        spared += usize::from(stages.is_empty());
        match (from_kept, fresh) {
            (Ok(a), Ok(b)) => {
                assert_eq!(a.len(), b.len());
                for (a, b) in a.iter().zip(&b) {
                    assert!(
                        a.name == b.name && a.bytes == b.bytes,
                        "edit {edit}: {} differs:\n{said}",
                        a.name
                    );
                }
            }
            (Err(a), Err(b)) => {
                assert_eq!(a, b, "edit {edit}:\n{said}");
                refused += 1;
            }
            (a, b) => panic!("edit {edit}: {:?} and {:?}:\n{said}", a.err(), b.err()),
        }
    }
    println!("of {EDITS} plans {spared} began no stage, {refused} came to nothing");
    assert!(spared >= EDITS / 3, "{spared}");
    assert!(refused < EDITS / 2, "{refused}");
}
