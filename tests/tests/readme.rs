//! Every command of the README does what a reader expects of it: it ends well.

use std::path::Path;
use std::process::Command;

/// The test suite would run itself.
const WHOLE_SUITE: &str = "tests/all.sh";

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the package lies in the workspace")
}

/// Lines of the fenced `sh` blocks of a Markdown text.
fn commands(markdown: &str) -> Vec<&str> {
    let mut inside = false;
    let mut commands = Vec::new();
    for line in markdown.lines() {
        match line.trim() {
            "```sh" => inside = true,
            "```" => inside = false,
            command if inside && !command.is_empty() => commands.push(command),
            _ => {}
        }
    }
    commands
}

#[test]
fn the_first_command_plans_and_the_second_runs_all_tests() {
    let readme = std::fs::read_to_string(root().join("README.md")).unwrap();
    let commands = commands(&readme);
    assert!(commands[0].starts_with("cargo run --release -p weldpath -- plan fixtures/"), "{commands:?}");
    assert_eq!(commands[1], WHOLE_SUITE);
}

#[test]
fn every_command_of_the_readme_ends_well() {
    let readme = std::fs::read_to_string(root().join("README.md")).unwrap();
    for command in commands(&readme).into_iter().filter(|&command| command != WHOLE_SUITE) {
        let output = Command::new("sh").args(["-c", command]).current_dir(root()).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "`{command}` ends with {}: {said}", output.status);
        assert!(!output.stdout.is_empty(), "`{command}` says nothing");
    }
}

#[test]
fn every_file_the_readme_links_to_is_there() {
    let readme = std::fs::read_to_string(root().join("README.md")).unwrap();
    let links: Vec<&str> = readme
        .split("](")
        .skip(1)
        .filter_map(|rest| rest.split(')').next())
        .filter(|l| !l.contains(':'))
        .collect();
    assert!(!links.is_empty());
    for link in links {
        assert!(root().join(link).exists(), "{link} is not there");
    }
}
