//! A run that is killed leaves all of its old files or all of its new ones: at every operation of the writer, and the
//! program itself at random times.
#![cfg(unix)]

use std::collections::BTreeMap;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use weldpath::files::{self, File, STAGING, Writer, interrupt};
use weldpath_tests::adversary::Random;
use weldpath_tests::command::weldpath;

/// Names and numbers of the signals that end programs.
const SIGNALS: [(&str, i32); 3] = [("KILL", 9), ("INT", 2), ("TERM", 15)];

fn tree(directory: &Path) -> BTreeMap<String, Vec<u8>> {
    fn walk(root: &Path, folder: &Path, found: &mut BTreeMap<String, Vec<u8>>) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(root).unwrap().to_str().unwrap().to_owned();
            match path.is_dir() {
                true if name == STAGING => {}
                true => walk(root, &path, found),
                false => drop(found.insert(name, std::fs::read(&path).unwrap())),
            }
        }
    }
    let mut found = BTreeMap::new();
    walk(directory, directory, &mut found);
    found
}

fn old() -> Vec<File> {
    ["path.csv", "path.script", "stages/01.ply"].map(|name| File::new(name, format!("old {name}"))).into()
}

fn new() -> Vec<File> {
    ["path.csv", "path.json", "stages/01.ply", "more/a"]
        .map(|name| File::new(name, format!("new {name}")))
        .into()
}

/// Not a test by itself: the process that is killed, by its own watcher.
#[test]
#[ignore = "run by the tests of this file, in a process of its own"]
fn writer_that_is_killed() {
    let of = |name: &str| std::env::var(format!("WELDPATH_TEST_{name}"));
    let (Ok(folder), Ok(at), Ok(signal)) = (of("FOLDER"), of("AT"), of("SIGNAL")) else { return };
    let at: usize = at.parse().unwrap();
    let number = SIGNALS.iter().find(|(name, _)| *name == signal).unwrap().1;
    interrupt::arm().unwrap();
    let count = AtomicUsize::new(0);
    let watch = |_: files::Operation<'_>| {
        if count.fetch_add(1, Ordering::SeqCst) == at {
            // To this thread: one sent to the process may come after all is written, on a busy machine.
            signal_hook::low_level::raise(number).unwrap();
        }
        Ok(())
    };
    let result = Writer::new(Path::new(&folder)).watched(&watch).write(&new());
    // Code 9 says that no operation was left to be killed at.
    std::process::exit(if count.into_inner() <= at { 9 } else { i32::from(result.is_err()) });
}

fn killed_at(folder: &Path, at: usize, signal: &str) -> ExitStatus {
    Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "outputs_killed::writer_that_is_killed", "--ignored", "--nocapture"])
        .env("WELDPATH_TEST_FOLDER", folder)
        .env("WELDPATH_TEST_AT", at.to_string())
        .env("WELDPATH_TEST_SIGNAL", signal)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .unwrap()
}

#[test]
fn a_kill_at_any_operation_leaves_all_old_files_or_all_new_ones() {
    let home = tempfile::tempdir().unwrap();
    let make = |name: &str, runs: &[Vec<File>]| {
        let folder = home.path().join(name);
        runs.iter().for_each(|files| files::write(&folder, files).unwrap());
        folder
    };
    let all = [tree(&make("old", &[old()])), tree(&make("new", &[old(), new()]))];
    for (signal, number) in SIGNALS {
        let mut states = [0, 0];
        for at in 0.. {
            let folder = make(&format!("{signal}-{at}"), &[old()]);
            let status = killed_at(&folder, at, signal);
            if status.code() == Some(9) {
                assert!(at > 15, "{signal}: only {at} operations");
                break;
            }
            assert_eq!(status.signal(), Some(number), "{signal} at operation {at}: {status:?}");
            // Only what nothing can hold off needs the next run.
            if signal == "KILL" {
                files::settle(&folder).unwrap();
            }
            assert!(!folder.join(STAGING).exists(), "{signal} at operation {at}");
            let now = tree(&folder);
            let state = all.iter().position(|whole| *whole == now);
            states[state.unwrap_or_else(|| panic!("{signal} at operation {at}: {:?}", now.keys()))] += 1;
        }
        assert!(states.iter().all(|count| *count > 0), "{signal}: {states:?} old and new");
    }
}

fn simulate(out: &Path, seed: &str) -> Command {
    let mut command = weldpath();
    command.args([
        "simulate", "--part", "fillet", "--size", "160x120", "--views", "3", "--quiet", "--seed", seed,
    ]);
    command.arg("--out").arg(out).stdout(Stdio::null()).stderr(Stdio::null());
    command
}

#[test]
fn twenty_kills_of_the_program_at_random_times_leave_one_scan_or_the_other() {
    let home = tempfile::tempdir().unwrap();
    let seeds = ["1", "2"];
    let whole = seeds.map(|seed| {
        let folder = home.path().join(seed);
        assert!(simulate(&folder, seed).status().unwrap().success());
        tree(&folder)
    });
    assert_ne!(whole[0], whole[1]);
    let out = home.path().join("out");
    let began = Instant::now();
    assert!(simulate(&out, seeds[0]).status().unwrap().success());
    let mut usual = began.elapsed();
    let seed = u64::from(std::process::id());
    println!("seed {seed}, a run takes {usual:?}");
    let mut random = Random::new(seed);
    let (mut killed, mut changed) = (0, 0);
    for k in 0..20 {
        let (signal, _) = SIGNALS[k % 3];
        let before = tree(&out);
        let began = Instant::now();
        let mut child = simulate(&out, seeds[(k + 1) % 2]).spawn().unwrap();
        // Most of a run is work; its files are written in the last part.
        std::thread::sleep(
            usual.mul_f64(random.below(1200) as f64 / 1000.0) + Duration::from_micros(random.below(500)),
        );
        Command::new("kill")
            .args(["-s", signal, &child.id().to_string()])
            .stderr(Stdio::null())
            .status()
            .unwrap();
        match child.wait().unwrap().signal() {
            Some(_) => killed += 1,
            // Runs take less time on a machine that has less else to do.
            None => usual = usual.min(began.elapsed()),
        }
        files::settle(&out).unwrap();
        let now = tree(&out);
        assert!(whole.contains(&now), "seed {seed}, kill {k} by {signal}: {:?}", now.keys());
        changed += usize::from(now != before);
    }
    println!("{killed} of 20 killed, {changed} times the new scan was whole");
    assert!(killed >= 5, "{killed}");
}
