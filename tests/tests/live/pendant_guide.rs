//! Every command of `docs/pendant.md` does what the guide says, in its order, against the firmware in the emulator.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};
use std::{env, fs, thread};

use weldpath_tests::command::{PATIENCE, Running, commands_of, weldpath};
use weldpath_tests::qemu::firmware;
use weldpath_tests::simulated::Simulated;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the package lies in the workspace")
}

fn guide() -> PathBuf {
    root().join("docs/pendant.md")
}

/// A folder like a checkout, where the commands may write, and a shell that finds `weldpath`.
struct Shell(tempfile::TempDir);

impl Shell {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        for name in ["fixtures", "firmware"] {
            std::os::unix::fs::symlink(root().join(name), folder.path().join(name)).unwrap();
        }
        Self(folder)
    }

    fn start(&self, command: &str) -> Running {
        let weldpath = PathBuf::from(weldpath().get_program());
        let first = weldpath.parent().unwrap().to_path_buf();
        let rest = env::var_os("PATH").unwrap_or_default();
        let path = env::join_paths(std::iter::once(first).chain(env::split_paths(&rest))).unwrap();
        // `exec`, so that ending the shell ends the command.
        let command = format!("exec {command}");
        Running::start(Command::new("sh").args(["-c", &command]).current_dir(self.0.path()).env("PATH", path))
    }
}

#[test]
fn every_command_of_the_guide_does_what_it_says() {
    let Some(program) = firmware("weldpath-firmware") else { return };
    let text = fs::read_to_string(guide()).unwrap();
    let shell = Shell::new();
    let mut pendant = None;
    let mut said = BTreeMap::new();
    for command in commands_of(&text) {
        if command == "weldpath pendant --sim" {
            pendant = Some(Simulated::start(&program));
            continue;
        }
        let port = pendant.as_ref().map(|pendant| pendant.port.clone()).unwrap_or_default();
        let mut running = shell.start(&command.replace("PORT", &port));
        if let (true, Some(pendant)) = (command.starts_with("weldpath stream"), &mut pendant) {
            pendant.operate(&mut running, &["finished"]);
        }
        if let (true, Some(pendant)) = (command.starts_with("weldpath scan --hands"), &mut pendant) {
            pendant.operate(&mut running, &["poses are the host's own"]);
        }
        let ended = running.end();
        assert_eq!(ended.code, Some(0), "`{command}`: {}", ended.said);
        assert!(!ended.said.is_empty(), "`{command}` says nothing");
        let name: Vec<&str> = command.split(' ').take(3).collect();
        said.insert(name.join(" "), ended.said);
    }
    pendant.expect("the guide starts one").quit();
    assert!(said["weldpath monitor --port"].contains(" s "), "{said:?}");
    assert!(said["weldpath score fixtures/butt-v"].ends_with("0 of 8 scores differ"), "{said:?}");
    assert!(said["weldpath plan scan"].contains("butt-v"), "{said:?}");
    assert_scanned(&text, &said["weldpath scan --hands"]);
}

/// More keys than the lamps and answers of which a socket holds unread.
const KEYS: usize = 600;

#[test]
fn an_operator_who_reads_nothing_is_heard_all_the_same() {
    let Some(program) = firmware("weldpath-firmware") else { return };
    let pendant = Simulated::start(&program);
    let mut deaf = pendant.operator();
    deaf.write_all(&[b'm'; KEYS]).unwrap();
    deaf.write_all(b"e").unwrap();
    let mut hearing = pendant.operator();
    let said = BufReader::new(hearing.try_clone().unwrap()).lines().map(Result::unwrap);
    let mut answers = said.filter(|line| line.starts_with("emergency stop"));
    let begin = Instant::now();
    let mut press = || {
        hearing.write_all(b"e").unwrap();
        answers.next().unwrap()
    };
    // Pressed by the other, it is released by this one.
    while press() != "emergency stop: released" {
        assert!(begin.elapsed() < PATIENCE, "the key of the operator who reads nothing is not heard");
        press();
        thread::sleep(Duration::from_millis(200));
    }
    pendant.quit();
}

/// Six views, every pose the host's own, and the guide's table of motions.
fn assert_scanned(guide: &str, said: &str) {
    println!("{said}");
    // What the operator was asked for comes first.
    let before = said.split_once(" frames").expect("the count of frames").0;
    let frames = before.split_whitespace().next_back().expect("a number");
    assert!(said.contains(&format!("{frames} poses are the host's own")), "{said}");
    assert!(said.contains(": 6 views"), "{said}");
    let measured: Vec<Vec<&str>> = rows(said, "motion").collect();
    let written: Vec<Vec<&str>> = rows(guide, "| motion").map(|cells| cells[1..7].to_vec()).collect();
    let what_holds = |rows: &[Vec<&str>]| -> Vec<[String; 3]> {
        rows.iter().map(|cells| [0, 1, 5].map(|i| cells[i].to_string())).collect()
    };
    assert_eq!(what_holds(&measured).len(), 7);
    assert!(measured.iter().all(|cells| cells[1].parse::<u32>().unwrap() > 100), "over 100 actions each");
    if env::var_os("WELDPATH_REGENERATE").is_some() {
        regenerate(guide, &measured);
    } else {
        assert_eq!(what_holds(&measured), what_holds(&written), "docs/pendant.md");
    }
}

/// Cells of the lines after the heading up to one that is no row.
fn rows<'a>(text: &'a str, heading: &str) -> impl Iterator<Item = Vec<&'a str>> {
    let after = text.lines().skip_while(move |line| !line.starts_with(heading)).skip(1);
    let lines: Vec<&str> = after.filter(|line| !line.starts_with("|-")).take(7).collect();
    lines.into_iter().map(|line| match line.starts_with('|') {
        true => line.split('|').map(str::trim).collect(),
        false => line.split_whitespace().collect(),
    })
}

fn regenerate(text: &str, measured: &[Vec<&str>]) {
    let written = rows(text, "| motion").map(|cells| cells.join(" | "));
    let new = measured.iter().map(|cells| format!(" | {} | ", cells.join(" | ")));
    let text =
        written.zip(new).fold(text.to_string(), |text, (old, new)| text.replace(old.trim(), new.trim()));
    fs::write(guide(), text).unwrap();
}
