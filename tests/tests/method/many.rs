//! A thousand seams: nothing grows without bound, nothing is silent, and whoever gives up does not wait.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use weldpath::pipeline::{Observer, PlanError};
use weldpath::run::job::Job;
use weldpath::run::planning;
use weldpath::run::postprocessing::{self, postprocess_observed};
use weldpath_tests::command::weldpath;
use weldpath_tests::solids::Solids;

/// Edge of a post, the way from one to the next, and its height, mm.
const POST_MM: [f32; 3] = [30.0, 90.0, 40.0];

/// A plate with so many square posts on it: each has four fillets around its foot.
fn posts(rows: usize, columns: usize, folder: &Path) -> PathBuf {
    let [side, pitch, height] = POST_MM;
    let plate =
        Solids::default().cuboid([0.0, 0.0, -10.0], [columns as f32 * pitch, rows as f32 * pitch, 0.0]);
    let post = |solids: Solids, place: usize| {
        let at = [place % columns, place / columns].map(|k| (k as f32 + 0.5) * pitch - 0.5 * side);
        solids.cuboid([at[0], at[1], 0.0], [at[0] + side, at[1] + side, height])
    };
    let path = folder.join("posts.stl");
    (0..rows * columns).fold(plate, post).write(&path);
    path
}

/// Wants no more after a time.
struct Watch {
    begun: Instant,
    give_up_after: Duration,
}

impl Observer for Watch {
    fn is_done(&self) -> bool {
        self.begun.elapsed() > self.give_up_after
    }
}

/// What a person takes for at once.
const AT_ONCE: Duration = Duration::from_millis(500);

/// From the file to the files, until it is given up; how long it went on after that.
fn given_up(job: &Job, give_up_after: Duration) -> Option<Duration> {
    let mut watch = Watch { begun: Instant::now(), give_up_after };
    let found = planning::find(
        job,
        planning::Allowed::default(),
        &planning::Kept::<()>::default(),
        &mut watch,
        |_| None,
    );
    let is_given_up = match &found {
        Err(planning::Error::Plan { error: PlanError::GivenUp, .. }) => true,
        Err(error) => panic!("{error}"),
        Ok(found) => {
            let source = planning::source(&found.scan, job);
            match postprocess_observed(&found.plan, job, source, &mut watch) {
                Err(postprocessing::Error::GivenUp) => true,
                Err(error) => panic!("{error}"),
                Ok(_) => false,
            }
        }
    };
    is_given_up.then(|| watch.begun.elapsed() - give_up_after)
}

#[test]
fn whoever_gives_up_a_thousand_seams_does_not_wait_for_a_stage() {
    let home = tempfile::tempdir().unwrap();
    let job = Job { input: Some(posts(12, 10, home.path())), ..Job::default() };
    let begun = Instant::now();
    assert!(given_up(&job, Duration::MAX).is_none());
    let whole = begun.elapsed();
    let times: u32 = std::env::var("WELDPATH_GIVE_UP_TIMES").map_or(6, |times| times.parse().unwrap());
    let mut worst = (Duration::ZERO, Duration::ZERO);
    for after in (0..times).map(|k| whole * k / times) {
        // What else the machine does only adds.
        let mut late = Duration::MAX;
        for _ in 0..3 {
            if late > AT_ONCE {
                late = late.min(given_up(&job, after).unwrap_or_default());
            }
        }
        println!("given up at {after:.1?}, left {late:.2?} later");
        worst = worst.max((late, after));
    }
    assert!(worst.0 < AT_ONCE, "{worst:?} of {whole:?}");
}

/// CPU time of a command that ends well, what it said on standard error, and when; its table lies beside the file.
fn run(posts: &Path, more: &[&str]) -> (Duration, Vec<(Duration, String)>) {
    let out = posts.with_file_name("out");
    let mut command = weldpath();
    command.arg("plan").arg(posts).args(["--no-report", "--no-cache", "--out"]).arg(out).args(more);
    let begun = Instant::now();
    let mut child = command.stdout(fs::File::create(posts.with_file_name("table")).unwrap()).spawn().unwrap();
    let lines = BufReader::new(child.stderr.take().unwrap()).lines();
    let said: Vec<_> = lines.map(|line| (begun.elapsed(), line.unwrap())).collect();
    // Nobody has waited for it yet: what it used can still be read.
    let stat = fs::read_to_string(format!("/proc/{}/stat", child.id())).unwrap();
    assert!(child.wait().unwrap().success(), "{said:?}");
    let fields: Vec<&str> = stat.rsplit_once(')').unwrap().1.split_whitespace().collect();
    // utime and stime are the 14th and 15th of all, in ticks of 10 ms.
    let ticks: u64 = fields[11..13].iter().map(|ticks| ticks.parse::<u64>().unwrap()).sum();
    (Duration::from_millis(10 * ticks), said)
}

#[test]
fn a_thousand_seams_are_ordered_in_ten_seconds_and_the_command_is_never_silent() {
    let home = tempfile::tempdir().unwrap();
    let posts = posts(25, 10, home.path());
    let (whole, said) = run(&posts, &[]);
    let (rest, _) = run(&posts, &["--sequence", "found"]);
    println!("{whole:?} of CPU, without an order {rest:?}; {said:?}");
    assert!(whole.saturating_sub(rest) < Duration::from_secs(10), "{whole:?} {rest:?}");
    let still = |stage: &str| said.iter().filter(|(_, line)| line.starts_with(stage)).collect::<Vec<_>>();
    let order = still("order: ");
    // A line is due after two seconds of a stage.
    let ordering = whole.saturating_sub(rest);
    assert!(!order.is_empty() || ordering < Duration::from_millis(2500), "{ordering:?}: {said:?}");
    assert!(order.windows(2).all(|w| w[1].0 - w[0].0 < Duration::from_millis(2500)), "{said:?}");
    let table = fs::read_to_string(posts.with_file_name("table")).unwrap();
    assert!(table.contains("many-seams: 1000 seams"), "{table}");
}
