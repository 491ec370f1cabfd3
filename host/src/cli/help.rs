//! What `--help` shows first: the common cases, as commands that can be typed. And an example where arguments are
//! missing.

use std::ffi::OsString;

use clap::error::ErrorKind;
use clap::{CommandFactory, FromArgMatches};

use super::{Cli, Exit, tell};

/// Examples before usage, options and the rest.
const TEMPLATE: &str = "{about-with-newline}\n{before-help}{usage-heading} {usage}\n\n{all-args}{after-help}";

/// By subcommand, the most common first; those of "" stand over `weldpath --help`.
const EXAMPLES: &[(&str, &[(&str, &str)])] = &[
    (
        "",
        &[
            ("weldpath simulate --part fillet --out scan", "a scan to try with, where there is none"),
            ("weldpath plan scan --out out", "all seams of a scan: paths, a robot program, a summary"),
            ("weldpath plan part.ply --robot abb", "one cloud; a program for an ABB robot"),
            ("weldpath evaluate out --truth scan/truth.json", "how far the plan is from the truth"),
        ],
    ),
    (
        "plan",
        &[
            ("weldpath plan scan", "all seams; results in out/"),
            ("weldpath plan part.ply --near 120,-35,8", "one cloud; the seam nearest to a place"),
            (
                "weldpath plan scan --standoff-mm 12 --feed-mm-s 6 --robot kuka",
                "and a program for a KUKA robot",
            ),
            ("weldpath plan --job out/job.toml --seam 2 --out again", "as before, but seam 2 only"),
            ("weldpath plan scan4 --calibration calibration.toml", "with what `weldpath calibrate` found"),
            ("weldpath plan scan --json", "for scripts: summary.json on standard output"),
        ],
    ),
    #[cfg(feature = "open")]
    (
        "open",
        &[
            ("weldpath open scan", "plan a scan, and choose and correct in the browser; results in out/"),
            ("weldpath open out", "go on with the job of an earlier run"),
            ("weldpath open out --no-browser", "only print the address"),
        ],
    ),
    (
        "simulate",
        &[
            ("weldpath simulate --part fillet --out scan", "a T joint, as a good depth camera sees it"),
            (
                "weldpath simulate --part butt-v --pose vertical --noise high --seed 7 --out scan",
                "a harder one",
            ),
        ],
    ),
    (
        "calibrate",
        &[
            ("weldpath calibrate scan1 scan2 scan3", "three parts that the same cell scanned"),
            ("weldpath calibrate scan1 scan2 --out cell.toml", "to a file of another name"),
        ],
    ),
    ("refit", &[("weldpath refit out new_scan --out refitted", "the saved program, where the part is now")]),
    ("doctor", &[("weldpath doctor > doctor.txt", "to send along with a question")]),
    ("schema", &[("weldpath schema > job.schema.json", "for an editor that completes and checks job files")]),
    (
        "evaluate",
        &[
            ("weldpath evaluate out --truth scan/truth.json", "a plan against a simulated scan's truth"),
            (
                "weldpath evaluate out/path.csv --truth taught.csv --json",
                "against a taught path; for scripts",
            ),
        ],
    ),
    (
        "stream",
        &[
            ("weldpath stream out --port /dev/ttyACM0 --no-arc", "a dry run: move without the arc"),
            ("weldpath stream out --port /dev/ttyACM0 --back-mm 5", "weld; a resume overlaps by 5 mm"),
        ],
    ),
    (
        "monitor",
        &[("weldpath monitor --port /dev/ttyACM0", "a line when something changes, and every second")],
    ),
    ("pendant", &[("weldpath pendant --sim", "prints the port to stream to")]),
    (
        "scan",
        &[
            ("weldpath scan --make-hands hands.csv", "a recording to try with"),
            ("weldpath scan --hands hands.csv --sim --out scan", "played to a simulated pendant"),
        ],
    ),
    ("score", &[("weldpath score scan --near 400,-300,20 --sim", "16 points, by a simulated pendant")]),
    (
        "completions",
        &[
            ("weldpath completions bash > ~/.local/share/bash-completion/completions/weldpath", "bash"),
            ("weldpath completions zsh > ~/.zfunc/_weldpath", "zsh, with ~/.zfunc in fpath"),
            ("weldpath completions fish > ~/.config/fish/completions/weldpath.fish", "fish"),
        ],
    ),
];

/// The whole command line, with its examples.
pub(super) fn command() -> clap::Command {
    let with = |command: clap::Command, name: &str| {
        let examples =
            examples(name).map(|(line, what)| format!("  {line}\n      {what}\n")).collect::<String>();
        command.help_template(TEMPLATE).before_help(format!("Examples:\n{}", examples.trim_end()))
    };
    let command = with(Cli::command(), "");
    let names: Vec<String> = command.get_subcommands().map(|sub| sub.get_name().to_owned()).collect();
    names.iter().fold(command, |command, name| command.mut_subcommand(name, |sub| with(sub, name)))
}

fn examples(name: &str) -> impl Iterator<Item = (&'static str, &'static str)> {
    let found = EXAMPLES.iter().find(|(of, _)| *of == name);
    found.into_iter().flat_map(|(_, examples)| examples.iter().copied())
}

/// What `weldpath` alone prints.
const START: [(&str, &str); 3] = [
    ("weldpath plan SCAN", "seams, torch paths and a robot program for a scan: a folder, a cloud or a mesh"),
    if cfg!(feature = "open") {
        ("weldpath open", "no scan yet? an example in the browser; `weldpath open SCAN` plans yours there")
    } else {
        ("weldpath simulate --part fillet --out scan", "no scan yet? this makes one to try")
    },
    ("weldpath --help", "all commands; `weldpath COMMAND --help` explains one"),
];

/// The arguments of a run; what is wrong with them is told, and the exit code returned.
pub(super) fn parse(arguments: &[OsString]) -> Result<Cli, u8> {
    if arguments.len() < 2 {
        let wide = START.iter().map(|(command, _)| command.len()).max().unwrap_or_default();
        START.iter().for_each(|(command, about)| tell(&format!("{command:wide$}  {about}")));
        return Err(Exit::Usage as u8);
    }
    let parsed =
        command().try_get_matches_from(arguments).and_then(|matches| Cli::from_arg_matches(&matches));
    parsed.map_err(|error| {
        // Without a terminal to write to there is nobody to tell.
        let _ = error.print();
        let subcommand = arguments.get(1).map(|word| word.to_string_lossy()).unwrap_or_default();
        let missing = error.kind() == ErrorKind::MissingRequiredArgument;
        if let Some((example, _)) = examples(&subcommand).next().filter(|_| missing) {
            tell(&format!("  hint: for example `{example}`"));
        }
        if error.use_stderr() { Exit::Usage as u8 } else { 0 }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_well_formed() {
        command().debug_assert();
    }

    #[test]
    fn every_subcommand_shows_examples_that_parse() {
        let command = command();
        for name in command.get_subcommands().map(clap::Command::get_name).chain([""]) {
            assert!(examples(name).next().is_some(), "{name} has no example");
            for (line, _) in examples(name) {
                let words = line.split(" > ").next().unwrap().split_whitespace();
                let parsed = command.clone().try_get_matches_from(words);
                assert!(parsed.is_ok(), "{line}: {}", parsed.unwrap_err());
                assert!(name.is_empty() || line.starts_with(&format!("weldpath {name}")), "{line}");
            }
        }
    }

    #[test]
    fn examples_stand_before_usage_and_options() {
        let help = command().find_subcommand_mut("plan").unwrap().render_long_help().to_string();
        let place = |word: &str| help.find(word).unwrap_or_else(|| panic!("no {word:?} in {help}"));
        assert!(place("Examples:") < place("Usage:") && place("Usage:") < place("Options:"));
    }
}
