//! The guide's commands run as they stand, and what the help pages quote is what the program says.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::process::Command;

use weldpath_tests::command::weldpath;
use weldpath_tests::markdown::{blocks, code};

use crate::{product, read, root};

const SUBCOMMANDS: [&str; 14] = [
    "calibrate",
    "plan",
    "open",
    "simulate",
    "refit",
    "schema",
    "evaluate",
    "stream",
    "monitor",
    "pendant",
    "scan",
    "score",
    "completions",
    "doctor",
];

/// Pages for users, beside README.md.
const PAGES: [&str; 10] = [
    "../README.md",
    "accuracy.md",
    "feasibility.md",
    "formats.md",
    "guide.md",
    "pendant.md",
    "programs.md",
    "scan.md",
    "troubleshooting.md",
    "welding.md",
];

fn doc(name: &str) -> String {
    std::fs::read_to_string(root().join("docs").join(name)).unwrap()
}

fn help(subcommand: &str) -> String {
    let output = weldpath().args([subcommand, "--help"]).output().unwrap();
    assert!(output.status.success(), "{subcommand}");
    String::from_utf8(output.stdout).unwrap()
}

/// Long options in a text.
fn options(text: &str) -> BTreeSet<&str> {
    let end = |c: char| !(c.is_ascii_alphanumeric() || c == '-');
    text.split([' ', '`', ',', '\n', '[', '='])
        .filter(|word| word.starts_with("--") && word.len() > 2)
        .map(|word| word.split(end).next().unwrap_or_default())
        .filter(|word| word.len() > 2)
        .collect()
}

#[test]
fn every_block_of_the_guide_ends_well_and_says_something() {
    let (guide, home) = (doc("guide.md"), tempfile::tempdir().unwrap());
    let program = PathBuf::from(weldpath().get_program());
    let mut path = vec![program.parent().unwrap().to_path_buf()];
    path.extend(std::env::split_paths(&std::env::var_os("PATH").unwrap_or_default()));
    let blocks = blocks(&guide, "sh");
    assert!(blocks.len() > 5);
    for block in blocks {
        let mut shell = Command::new("sh");
        shell.args(["-e", "-c", block]).current_dir(home.path());
        let output = shell.env("PATH", std::env::join_paths(&path).unwrap()).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{block}\nends with {}: {said}", output.status);
        assert!(!output.stdout.is_empty(), "{block}\nsays nothing");
    }
    for file in ["robot/weldpath.mod", "robot/weldpath.src", "robot/weldpath.ls", "scores.json"] {
        assert!(home.path().join(file).exists(), "{file}");
    }
}

#[test]
fn every_option_that_the_pages_name_exists() {
    let helps: Vec<String> = SUBCOMMANDS.iter().map(|subcommand| help(subcommand)).collect();
    let known: BTreeSet<&str> = helps
        .iter()
        .flat_map(|help| options(help))
        .chain(["--release", "--test", "--features", "--no-default-features", "--locked", "--path"])
        .collect();
    for page in PAGES {
        let page_text = doc(page);
        let unknown: Vec<&str> =
            options(&page_text).into_iter().filter(|option| !known.contains(option)).collect();
        let foreign = |option: &&str| page == "programs.md" && ["--once", "--yaml-file"].contains(option);
        assert!(unknown.iter().all(foreign), "{page}: {unknown:?}");
    }
}

#[test]
fn every_message_of_the_troubleshooting_page_is_in_the_sources() {
    // String literals that go over several lines are one.
    let whole = |path| read(path).split("\\\n").map(str::trim_start).collect::<String>();
    let sources: String = product().into_iter().map(whole).collect();
    let page = doc("troubleshooting.md");
    let rows = page.lines().filter(|line| line.starts_with("| ") && !line.starts_with("| symptom"));
    let messages: Vec<String> =
        rows.filter_map(|row| code(row.split(" | ").nth(1)?).into_iter().next()).collect();
    assert!(messages.len() > 25);
    for message in messages {
        assert!(sources.contains(&message), "{message:?} is said nowhere");
    }
}

#[test]
fn the_documented_exit_codes_are_those_of_the_help_and_of_the_source() {
    let page = doc("formats.md");
    let table = page.split("## Exit codes").nth(1).unwrap().split("\n## ").next().unwrap();
    let rows: BTreeSet<u8> =
        table.lines().filter_map(|line| line.strip_prefix("| ")?.split(' ').next()?.parse().ok()).collect();
    let source = read("host/src/cli.rs");
    let body = source.split("enum Exit {").nth(1).unwrap().split('}').next().unwrap();
    let named =
        body.lines().filter_map(|line| line.trim().trim_end_matches(',').split(" = ").nth(1)?.parse().ok());
    let exits: BTreeSet<u8> = named.chain([0]).collect();
    assert_eq!(rows, exits);
    let output = weldpath().arg("--help").output().unwrap();
    let said = String::from_utf8(output.stdout).unwrap().replace('\n', " ");
    let list = said.split("Exit codes: ").nth(1).unwrap();
    let told: BTreeSet<u8> =
        list.split("; ").filter_map(|part| part.split_whitespace().next()?.parse().ok()).collect();
    assert_eq!(told, exits);
}

#[test]
fn completions_know_every_subcommand_and_option() {
    for shell in ["bash", "zsh", "fish"] {
        let output = weldpath().args(["completions", shell]).output().unwrap();
        let script = String::from_utf8(output.stdout).unwrap();
        for word in SUBCOMMANDS.iter().chain(&["standoff-mm", "robot", "completions"]) {
            assert!(script.contains(word), "{shell} does not know {word}");
        }
    }
}

#[test]
fn help_begins_with_what_a_command_is_for_and_examples() {
    for subcommand in SUBCOMMANDS {
        let help = help(subcommand);
        let place = |word: &str| help.find(word).unwrap_or_else(|| panic!("{subcommand}: no {word}"));
        assert!(place("Examples:") < place("Usage:"), "{subcommand}");
        assert!(help.contains(&format!("\n  weldpath {subcommand} ")), "{subcommand}");
    }
}
