//! `weldpath plan` as a process, from files to files, by number of points and threads: the table and the plot in
//! docs/performance.md. `cargo bench -p weldpath --bench command` prints the one, and writes the other where asked:
//! `cargo bench -p weldpath --bench command -- plot.svg`.

use std::fmt::Write;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use wait4::Wait4;

#[allow(dead_code)]
mod clouds;

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
    let mut rows = Vec::new();
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
            if threads == 1 {
                rows.push((n, 1e9 * spent.cpu_s / n, bytes));
            }
        }
    }
    println!(
        "\nWithout a cloud to speak of the process peaks at {:.1} MB, which is taken off.",
        idle.peak_bytes / 1e6
    );
    if let Some(path) = std::env::args().skip(1).find(|word| word.ends_with(".svg")) {
        std::fs::write(path, plot(&rows)).expect("the plot is written");
    }
}

/// A cloud in which there is nothing to find.
fn few_points(folder: &Path) -> std::path::PathBuf {
    let path = folder.join("few.ply");
    std::fs::write(&path, clouds::ply(&clouds::butt_joint(10))).expect("it is written");
    path
}

fn plan(folder: &Path, cloud: &Path, threads: usize) -> Spent {
    let begin = Instant::now();
    let mut child = Command::new(env!("CARGO_BIN_EXE_weldpath"))
        .args(["plan", "--quiet", "--out"])
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

/// CPU time and peak memory per point over the number of points, both relative to the worst.
fn plot(rows: &[(f64, f64, f64)]) -> String {
    let worst = rows.iter().fold((0f64, 0f64), |(a, b), row| (a.max(row.1), b.max(row.2)));
    let x = |n: f64| 60.0 + 250.0 * (n.log10() - 4.0);
    let y = |share: f64| 260.0 - 220.0 * share;
    let mut svg = String::from(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"640\" height=\"330\" font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"640\" height=\"330\" fill=\"white\"/>\n<path d=\"M60 30V260H580\" fill=\"none\" stroke=\"black\"/>\n",
    );
    let line = |values: Vec<(f64, f64)>| {
        values.iter().map(|(n, share)| format!("{:.1},{:.1} ", x(*n), y(*share))).collect::<String>()
    };
    let time = line(rows.iter().map(|r| (r.0, r.1 / worst.0)).collect());
    let bytes = line(rows.iter().map(|r| (r.0, r.2 / worst.1)).collect());
    for (points, colour) in [(time, "#0060c0"), (bytes, "#c04000")] {
        let _ = writeln!(
            svg,
            "<polyline points=\"{points}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\"/>"
        );
    }
    for &(n, time, bytes) in rows {
        let (a, b) = (y(time / worst.0) - 6.0, y(bytes / worst.1) + 16.0);
        let _ =
            writeln!(svg, "<text x=\"{:.0}\" y=\"{a:.0}\" fill=\"#0060c0\">{time:.0} ns</text>", x(n) + 4.0);
        let _ =
            writeln!(svg, "<text x=\"{:.0}\" y=\"{b:.0}\" fill=\"#c04000\">{bytes:.0} B</text>", x(n) + 4.0);
        let _ = writeln!(svg, "<text x=\"{:.0}\" y=\"278\">{:.0}k</text>", x(n) - 10.0, n / 1e3);
    }
    svg + "<text x=\"60\" y=\"310\">weldpath plan, one thread, over the number of points: CPU time per point (blue), peak memory per \
           point (red)</text>\n</svg>\n"
}
