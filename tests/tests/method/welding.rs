//! `docs/welding.md`: every example plans, does what stands beside it, replays, and looks as its picture shows.

use std::path::{Path, PathBuf};

use weldpath::run::job::Job;
use weldpath::run::postprocessing::postprocess;
use weldpath_tests::command::{commands_of, weldpath};
use weldpath_tests::markdown::blocks;
use weldpath_tests::pictures::{From, picture};
use weldpath_tests::plans;

/// Set to write the pictures anew.
const WRITE: &str = "WELDPATH_WRITE_PICTURES";

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap()
}

fn page() -> String {
    std::fs::read_to_string(root().join("docs/welding.md")).unwrap()
}

/// An example with a picture.
struct Example {
    name: String,
    toml: String,
    from: From,
    bent: bool,
}

/// `![...](pictures/NAME.svg "from FROM, bent")` and the `toml` block that follows it.
fn examples() -> Vec<Example> {
    let page = page();
    let pictures: Vec<&str> = page.split("](pictures/").skip(1).collect();
    pictures
        .iter()
        .map(|rest| {
            let (name, rest) = rest.split_once(".svg \"").unwrap();
            let (how, rest) = rest.split_once("\")").unwrap();
            let toml = blocks(rest, "toml")[0];
            let from = match how.split(',').next().unwrap() {
                "aslant" => From::Aslant,
                "from behind" => From::Behind,
                "from the side" => From::Side,
                "along the torch" => From::Torch,
                other => panic!("{name}: {other}"),
            };
            Example { name: name.into(), toml: toml.into(), from, bent: how.ends_with("bent") }
        })
        .collect()
}

fn job(text: &str) -> Job {
    Job::parse(text, Path::new("welding.md")).unwrap()
}

fn file(name: &str) -> PathBuf {
    root().join("docs/pictures").join(format!("{name}.svg"))
}

#[test]
fn every_picture_is_what_the_planner_makes_of_the_example_below_it() {
    let examples = examples();
    assert!(examples.len() >= 17, "{}", examples.len());
    for example in &examples {
        let drawn = picture(&job(&example.toml), example.bent, example.from);
        if std::env::var_os(WRITE).is_some() {
            std::fs::write(file(&example.name), &drawn).unwrap();
        }
        let committed = std::fs::read_to_string(file(&example.name)).unwrap_or_default();
        assert!(committed == drawn, "docs/pictures/{}.svg differs; {WRITE}=1 writes it anew", example.name);
    }
    let files = std::fs::read_dir(root().join("docs/pictures")).unwrap();
    // Those of the page are held by the tests of the guide's pictures.
    let drawings = files.filter(|file| file.as_ref().unwrap().path().extension() == Some("svg".as_ref()));
    assert_eq!(drawings.count(), examples.len(), "a picture that nothing shows");
}

#[test]
fn every_example_changes_the_program_and_replays_to_the_same_bytes() {
    for example in examples() {
        let plan = plans::corner_of_plates(example.bent);
        let run = |job: &Job| postprocess(&plan, job, Default::default()).unwrap();
        let (plain, modified) = (run(&Job::default()), run(&job(&example.toml)));
        assert!(plain.program != modified.program, "{}", example.name);
        let again = run(&job(&job(&example.toml).to_toml()));
        for (a, b) in modified.files.iter().zip(&again.files) {
            assert!(a.bytes == b.bytes, "{}: {} differs", example.name, a.name);
        }
    }
}

#[test]
fn every_block_of_the_page_is_a_job() {
    let page = page();
    let blocks = blocks(&page, "toml");
    assert!(blocks.len() > examples().len(), "some have no picture");
    for block in blocks {
        job(block);
    }
}

#[test]
fn every_command_of_the_page_ends_well() {
    let page = page();
    let home = tempfile::tempdir().unwrap();
    let commands = commands_of(&page);
    assert!(commands.len() >= 3);
    std::os::unix::fs::symlink(root().join("fixtures"), home.path().join("fixtures")).unwrap();
    for command in commands {
        let words: Vec<&str> = command.split_whitespace().collect();
        assert_eq!(words[0], "weldpath", "{command}");
        let output = weldpath().args(&words[1..]).current_dir(home.path()).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "`{command}`: {said}");
    }
}
