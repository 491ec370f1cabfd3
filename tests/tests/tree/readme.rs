//! Every command of the README does what a reader expects of it: it ends well.

use std::process::Command;

use weldpath_tests::command::{commands_of, ends_well};

use crate::{read, root};

/// The test suite would run itself.
const WHOLE_SUITE: &str = "tests/all.sh";

#[test]
fn the_first_command_plans_and_the_second_runs_all_tests() {
    let readme = read("README.md");
    let commands = commands_of(&readme);
    assert!(commands[0].starts_with("cargo run --release -p weldpath -- plan fixtures/"), "{commands:?}");
    assert_eq!(commands[1], WHOLE_SUITE);
}

#[test]
fn every_command_of_the_readme_ends_well() {
    let readme = read("README.md");
    let commands = commands_of(&readme);
    for &command in commands.iter().filter(|&&command| command != WHOLE_SUITE) {
        let said = ends_well(Command::new("sh").args(["-c", command]).current_dir(root()));
        assert!(!said.is_empty(), "`{command}` says nothing");
        if command == commands[0] {
            assert!(said.contains("verdict: ready\n"), "what a newcomer sees first is not ready: {said}");
        }
    }
}

#[test]
fn every_file_and_heading_the_readme_links_to_is_there() {
    let readme = read("README.md");
    let links: Vec<&str> = readme
        .split("](")
        .skip(1)
        .filter_map(|rest| rest.split(')').next())
        .filter(|l| !l.contains(':'))
        .collect();
    assert!(!links.is_empty());
    for link in links {
        let (file, heading) = link.split_once('#').unwrap_or((link, ""));
        assert!(root().join(file).exists(), "{link} is not there");
        if !heading.is_empty() {
            let text = read(file);
            assert!(text.lines().any(|line| is_heading(line, heading)), "{link}: no such heading");
        }
    }
}

/// Whether a line is the heading of this anchor: in lower case, words joined by hyphens.
fn is_heading(line: &str, anchor: &str) -> bool {
    let words = line.trim_start_matches('#').trim().to_lowercase().replace(' ', "-");
    line.starts_with('#') && words == anchor
}
