//! What is kept of a plan saves the next one its stages, and never changes a byte of what comes of it.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use weldpath::files::{File, entries};
use weldpath::pipeline::{Evidence, Observer};
use weldpath::report::{self, Recording};
use weldpath::run::job::Job;
use weldpath::run::planning::{self, Allowed, Kept, Searched};
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
    let seen = |watch: &mut Watch| Some(std::mem::take(&mut watch.recording));
    let found =
        planning::find(job, Allowed::default(), kept, &mut watch, seen).map_err(|error| error.to_string());
    (watch.stages, found)
}

/// All files of a run. How long its stages took is left out: no two runs take the same.
fn files(found: &Searched<Recording>, job: &Job) -> Result<Vec<File>, String> {
    let mut plan = found.plan.clone();
    plan.derived.stage_s.clear();
    let source = planning::source(&found.scan, job);
    let mut output = postprocess(&plan, job, source).map_err(|error| error.to_string())?;
    let report = report::files(&plan, &output, found.seen.as_ref().unwrap(), job);
    output.files.extend(report);
    Ok(output.files)
}

fn outcome(job: &Job, kept: &Kept<Recording>) -> (Vec<&'static str>, Result<Vec<File>, String>) {
    let (stages, found) = find(job, kept);
    (stages, found.and_then(|found| files(&found, job)))
}

/// A T joint in small views.
fn scan(home: &Path) -> Job {
    scan_of("fillet", "320x240", home)
}

fn scan_of(part: &str, size: &str, home: &Path) -> Job {
    let command = ["simulate", "--part", part, "--size", size, "--quiet", "--out", "scan"];
    ends_well(weldpath().args(command).current_dir(home));
    Job { input: Some(home.join("scan")), ..Job::default() }
}

fn with(job: &Job, text: &str) -> Job {
    let edited = Job::parse(text, Path::new("job.toml")).unwrap_or_else(|error| panic!("{text}: {error}"));
    Job { input: job.input.clone(), ..edited }
}

#[test]
fn an_edit_of_how_seams_are_welded_begins_no_stage_and_takes_a_twentieth_of_a_plan() {
    // In threads of its own: those of all tests have other tests' work in their queue.
    rayon::ThreadPoolBuilder::new().build().unwrap().install(edit_how_seams_are_welded);
}

fn edit_how_seams_are_welded() {
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

/// Both ends of a line on the plate beside the first seam, so far from it, as a job says them.
fn beside(found: &Searched<Recording>, off_mm: f64) -> String {
    let stations = &found.plan.seams[0].stations;
    let place = |k: usize| {
        let station = &stations[k * (stations.len() - 1) / 10];
        let p = station.position_mm + station.faces[0] * off_mm;
        format!("[{:.1}, {:.1}, {:.1}]", p.x, p.y, p.z)
    };
    format!("[{}, {}]", place(2), place(8))
}

/// An edit, the stages that it begins, and what it makes a job say, a little different for each number.
type Kind<'a> = (&'a str, &'a [&'a str], &'a dyn Fn(usize) -> String);

#[test]
fn an_edit_of_one_seam_begins_no_stage_but_those_of_that_seam() {
    let home = tempfile::tempdir().unwrap();
    let job = scan_of("cruciform", "480x360", home.path());
    let kept = Kept::default();
    let begun = Instant::now();
    let found = find(&job, &kept).1.unwrap();
    let whole = begun.elapsed();
    let own = "[[seam]]\nid = 1\n";
    let asked: &[&str] = &["asked", "toolpath"];
    let line = |k: usize| beside(&found, 14.0 + k as f64);
    let kinds: [Kind; 6] = [
        ("an end", &[], &|k| format!("{own}path.extend_end_mm = -{k}")),
        ("a joint type", &[], &|_| format!("{own}joint = \"lap\"")),
        // The slowest: all kinds of evidence are looked through, and none makes a seam.
        ("a seam that is asked for", asked, &|k| format!("[[ask]]\nbetween_mm = {}", line(k))),
        ("a seam that is there", asked, &|k| format!("[[ask]]\nbetween_mm = {}", beside(&found, k as f64))),
        ("a line that is drawn", asked, &|k| format!("[[draw]]\nthrough_mm = {}", line(k))),
        ("a box", &["downsampling", "denoising", "seam", "toolpath"], &|k| {
            format!("[exclude]\nboxes_mm = [[[0, 0, 0], [1, 1, {k}]]]")
        }),
    ];
    for (edit, stages, text) in kinds {
        for k in 1..4 {
            let edited = with(&job, &text(k));
            let begun = Instant::now();
            let (began, found) = find(&edited, &kept);
            println!(
                "{edit}: {:.1} % of a plan",
                100.0 * begun.elapsed().as_secs_f64() / whole.as_secs_f64()
            );
            assert_eq!(began, stages, "{edit}");
            if k == 1 {
                let ours = files(&found.unwrap(), &edited);
                assert!(same(&ours, &outcome(&edited, &Kept::default()).1), "{edit}: {:?}", ours.err());
            }
        }
    }
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

/// Whether two runs came to the same files, byte by byte, or to the same words of why not.
fn same(a: &Result<Vec<File>, String>, b: &Result<Vec<File>, String>) -> bool {
    match (a, b) {
        (Ok(a), Ok(b)) => {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.name == b.name && a.bytes == b.bytes)
        }
        (Err(a), Err(b)) => a == b,
        _ => false,
    }
}

#[test]
fn after_random_edits_every_file_is_that_of_a_fresh_run_to_the_byte() {
    const EDITS: usize = 40;
    let home = tempfile::tempdir().unwrap();
    let job = scan(home.path());
    let json = home.path().join("scan/scan.json");
    let text = fs::read_to_string(&json).unwrap();
    let mut random = Random(0x5eed_cafe);
    let mut says = [0; SAYINGS.len()];
    // What a page keeps, and what one run of the command leaves for the next.
    let in_memory = Kept::default();
    let out = home.path().join("out");
    let (mut spared, mut refused, mut programs) = (0, 0, 0);
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
        let on_disk = Kept::within(&out);
        let (stages, from_memory) = outcome(&edited, &in_memory);
        let (later_stages, from_disk) = outcome(&edited, &on_disk);
        on_disk.save();
        let (_, fresh) = outcome(&edited, &Kept::default());
        assert!(
            !stages.is_empty() || later_stages.is_empty(),
            "edit {edit}: the disk holds as much:\n{said}"
        );
        spared += usize::from(stages.is_empty());
        refused += usize::from(fresh.is_err());
        programs += usize::from(fresh.iter().flatten().any(|file| file.name == "path.json"));
        for kept in [from_memory, from_disk] {
            assert!(same(&kept, &fresh), "edit {edit}: {:?} and {:?}:\n{said}", kept.err(), fresh.err());
        }
    }
    println!("of {EDITS} plans {spared} began no stage, {programs} gave programs, {refused} came to nothing");
    assert!(programs > EDITS / 3, "{programs}");
    assert!(spared >= EDITS / 3, "{spared}");
    assert!(refused < EDITS / 2, "{refused}");
}

/// What a run left in a folder, without how long its stages took, which is the one thing that differs from run to run.
fn left(folder: &Path) -> Vec<(String, String)> {
    let timeless = |text: &str| match text.split_once("\"stages\"") {
        Some((before, rest)) => format!("{before}{}", rest.split_once(']').map_or(rest, |(_, after)| after)),
        None => text.to_owned(),
    };
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut files: Vec<_> = entries
        .filter(|path| path.is_file() && !path.ends_with("weldpath-manifest.json"))
        .map(|path| {
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            (name, timeless(&String::from_utf8_lossy(&fs::read(path).unwrap())))
        })
        .collect();
    files.sort();
    assert!(files.len() >= 8, "{}", files.len());
    files
}

/// A folder in which a scan is planned by the command again and again.
struct Folder(tempfile::TempDir);

impl Folder {
    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Plans at a feed; whether it took the seams that are kept.
    fn plan(&self, feed: f64, out: &str, more: &[&str]) -> bool {
        let text = format!("input = \"scan\"\nformats = [\"ur\", \"kuka\"]\n[path]\nfeed_mm_s = {feed}\n");
        fs::write(self.path("a.toml"), text).unwrap();
        let mut command = weldpath();
        command.args(["plan", "--job", "a.toml", "--out", out]).args(more).current_dir(self.0.path());
        let done = command.output().unwrap();
        let said = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(done.status.success(), "{said}");
        said.contains("seams are from the cache of an earlier plan")
    }

    /// Whether both folders hold the same.
    fn are_same(&self, a: &str, b: &str) {
        for (a, b) in left(&self.path(a)).iter().zip(left(&self.path(b))) {
            assert!(*a == b, "{} differs", a.0);
        }
    }
}

#[test]
fn a_run_of_the_command_takes_the_seams_that_an_earlier_one_found_and_writes_what_a_fresh_one_does() {
    let folder = Folder(tempfile::tempdir().unwrap());
    scan(folder.0.path());
    assert!(!folder.plan(5.0, "out", &[]), "nothing is kept yet");
    let begun = Instant::now();
    assert!(folder.plan(6.0, "out", &[]));
    let kept = begun.elapsed();
    assert!(!folder.plan(6.0, "fresh", &["--no-cache"]));
    println!("the command {:.0?}, after an edit {kept:.0?}", begun.elapsed() - kept);
    assert!(!folder.path("fresh").join(entries::KEPT).exists());
    folder.are_same("out", "fresh");
    assert!(folder.plan(6.0, "out", &["--no-report"]));
    assert!(!folder.plan(6.0, "out", &["--no-cache"]));
    assert!(!folder.plan(6.0, "out", &["--dump-stages"]), "the clouds after each stage are kept nowhere");

    // Entries that are damaged are none, and are made again.
    for entry in
        fs::read_dir(folder.path("out").join(entries::KEPT)).unwrap().map(|entry| entry.unwrap().path())
    {
        let mut bytes = fs::read(&entry).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 0x10;
        fs::write(&entry, bytes).unwrap();
    }
    assert!(!folder.plan(6.0, "out", &[]));
    assert!(folder.plan(6.0, "out", &[]));
    folder.are_same("out", "fresh");

    // Another scan in the same folder is another scan.
    fs::copy(folder.path("scan/view_001.png"), folder.path("scan/view_000.png")).unwrap();
    assert!(!folder.plan(6.0, "out", &[]));
}
