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

/// The line of the section on installing.
const INSTALL: &str = "    cargo install --locked --path host";

#[test]
#[cfg_attr(debug_assertions, ignore = "it builds the release")]
fn what_the_readme_installs_runs() {
    assert!(read("README.md").lines().any(|line| line == INSTALL), "`{INSTALL}` is not in the README");
    let home = tempfile::tempdir().unwrap();
    let mut install = Command::new("sh");
    install.args(["-c", INSTALL]).current_dir(root()).env("CARGO_INSTALL_ROOT", home.path());
    ends_well(&mut install);
    let said = ends_well(Command::new(home.path().join("bin/weldpath")).arg("--version"));
    assert!(said.starts_with("weldpath "), "{said}");
}

/// One screen, then one more.
const MOST_WORDS: usize = 900;

#[test]
fn the_readme_is_short() {
    let words = read("README.md").split_whitespace().count();
    assert!(words <= MOST_WORDS, "{words} words");
}
