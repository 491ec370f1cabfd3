//! `weldpath plan` as a process, from files to files, by number of points and threads, as a table:
//! `cargo bench -p weldpath-benches --bench command`.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use std::time::Instant;

use wait4::Wait4;

const RUNS: usize = 3;
const POINTS: [usize; 4] = [10_000, 100_000, 300_000, 1_000_000];

/// One run of the command.
#[derive(Clone, Copy)]
struct Spent {
    cpu_s: f64,
    wall_s: f64,
    peak_bytes: f64,
}

fn main() {
    let folder = tempfile::tempdir().expect("a folder");
    let idle = plan(folder.path(), &few_points(folder.path()), 1);
    println!(
        "| points | threads | CPU s | wall s | points per CPU second | CPU ns per point | peak, bytes per point |"
    );
    println!("|---:|---:|---:|---:|---:|---:|---:|");
    for points in POINTS {
        let cloud = folder.path().join("cloud.ply");
        std::fs::write(&cloud, clouds::ply(&clouds::butt_joint(points))).expect("it is written");
        for threads in [1, 2] {
            let spent = median(|| plan(folder.path(), &cloud, threads));
            let n = points as f64;
            let bytes = (spent.peak_bytes - idle.peak_bytes) / n;
            println!(
                "| {points} | {threads} | {:.3} | {:.3} | {:.0} | {:.0} | {bytes:.0} |",
                spent.cpu_s,
                spent.wall_s,
                n / spent.cpu_s,
                1e9 * spent.cpu_s / n
            );
        }
    }
    println!(
        "\nWithout a cloud to speak of the process peaks at {:.1} MB, which is taken off.",
        idle.peak_bytes / 1e6
    );
}

/// The command, built as users build it.
fn command() -> &'static Path {
    static COMMAND: OnceLock<PathBuf> = OnceLock::new();
    COMMAND.get_or_init(|| {
        let cargo = std::env::var_os("CARGO").unwrap_or("cargo".into());
        let built = Command::new(cargo)
            .args(["build", "--release", "--quiet", "-p", "weldpath"])
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .status();
        assert!(built.is_ok_and(|status| status.success()), "weldpath cannot be built");
        let bench = std::env::current_exe().expect("a bench is a file");
        bench.ancestors().nth(2).expect("target/release/deps").join("weldpath")
    })
}

/// A cloud in which there is nothing to find.
fn few_points(folder: &Path) -> PathBuf {
    let path = folder.join("few.ply");
    std::fs::write(&path, clouds::ply(&clouds::butt_joint(10))).expect("it is written");
    path
}

fn plan(folder: &Path, cloud: &Path, threads: usize) -> Spent {
    let begin = Instant::now();
    let mut child = Command::new(command())
        .args(["plan", "--quiet", "--no-cache", "--out"])
        .arg(folder.join("out"))
        .arg(cloud)
        .env("RAYON_NUM_THREADS", threads.to_string())
        .stderr(std::process::Stdio::null())
        .spawn()
        .expect("the command runs");
    let used = child.wait4().expect("it ends").rusage;
    Spent {
        cpu_s: (used.utime + used.stime).as_secs_f64(),
        wall_s: begin.elapsed().as_secs_f64(),
        peak_bytes: used.maxrss as f64,
    }
}

fn median(run: impl Fn() -> Spent) -> Spent {
    let mut all: Vec<Spent> = (0..RUNS).map(|_| run()).collect();
    all.sort_by(|a, b| a.cpu_s.total_cmp(&b.cpu_s));
    all[RUNS / 2]
}
