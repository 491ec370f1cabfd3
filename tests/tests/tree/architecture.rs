//! Rules of the tree that no compiler holds: which module of a crate may use which, who may use a library or the file
//! system, and where each equation of the paper is computed. Between crates, Cargo.toml is the rule.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::{HOST, product, read, root, sources};

/// Modules of a crate, lowest first, and those that each may use. What is not listed here may use all.
type Table = &'static [(&'static str, &'static [&'static str])];

/// Algorithms know nothing of the wire; `tasks` alone joins the two.
const CORE: Table = &[
    ("math", &[]),
    ("geometry", &["math"]),
    ("rotation", &["math"]),
    ("gesture", &["math", "rotation"]),
    ("seam", &["math"]),
    ("path", &["math", "rotation"]),
    ("interlock", &[]),
    ("wire", &["math", "path", "interlock"]),
    ("pendant", &["math", "rotation", "path", "interlock", "wire"]),
    ("sender", &["interlock", "wire"]),
    ("tasks", &["math", "gesture", "seam", "path", "wire", "pendant"]),
];

/// A step takes what an earlier one returns, as a parameter; it never calls a later one.
const METHOD: Table = &[
    ("cancellation", &[]),
    ("geometry", &["cancellation"]),
    ("input", &["geometry"]),
    ("model", &["geometry"]),
    ("seam", &["cancellation", "geometry", "model"]),
    ("weld", &["cancellation", "geometry", "seam"]),
    ("pipeline", &["cancellation", "geometry", "model", "seam", "weld"]),
];

const JOB: Table = &[("robot", &[]), ("output", &["robot"]), ("run", &["robot", "output"])];

const SIM: Table = &[("evaluation", &[]), ("simulation", &["evaluation"])];

const LAB: Table = &[("suite", &[]), ("comparison", &[])];

/// The code of a file without comments and without its unit tests, which stand last.
fn code(path: &Path) -> String {
    if path.ends_with("tests.rs") {
        return String::new();
    }
    let text = read(path);
    let lines =
        text.lines().take_while(|line| !line.trim_start_matches("pub(crate) ").starts_with("mod tests {"));
    lines.map(|line| line.split("//").next().unwrap_or_default()).flat_map(|line| [line, "\n"]).collect()
}

#[test]
fn modules_of_a_crate_use_only_those_below_them() {
    let crates = [
        ("core/src", CORE),
        ("host/method/src", METHOD),
        ("host/job/src", JOB),
        ("host/sim/src", SIM),
        ("host/lab/src", LAB),
    ];
    for (folder, table) in crates {
        for (k, (module, uses)) in table.iter().enumerate() {
            let lower: Vec<&str> = table[..k].iter().map(|(name, _)| *name).collect();
            assert!(uses.iter().all(|name| lower.contains(name)), "{folder}: {module} uses one above it");
            let src = root().join(folder);
            let own =
                |path: &Path| path.strip_prefix(&src).is_ok_and(|p| p.with_extension("").starts_with(module));
            for path in sources(folder).iter().filter(|path| own(path)) {
                let code = code(path);
                // `crate::a`, or `a` in the braces of `crate::{a, b}`.
                let named = |other: &str| {
                    let listed = code.split("crate::{").skip(1).filter_map(|rest| rest.split(';').next());
                    let mut words =
                        listed.flat_map(|list| list.split(|c: char| !c.is_alphanumeric() && c != '_'));
                    code.contains(&format!("crate::{other}")) || words.any(|word| word == other)
                };
                let others = table.iter().map(|(name, _)| *name).filter(|name| name != module);
                let wrong: Vec<&str> = others.filter(|name| !uses.contains(name) && named(name)).collect();
                assert!(wrong.is_empty(), "{}: {module} must not use {wrong:?}", path.display());
            }
        }
    }
}

#[test]
fn libraries_and_the_file_system_are_used_where_they_may_be() {
    let shells: &[&str] = &[
        "host/method/src/input",
        "host/files/src",
        "host/job/src/run/job",
        "host/sim/src/evaluation",
        "host/lab/src/suite",
        "host/src/cli",
        "host/pendant/src/emulator",
        "host/pendant/src/teleop",
        "host/pendant/src/link/saved",
    ];
    let rules: [(&str, &[&str], &[&str]); 4] = [
        ("libm::", &["core/src"], &["core/src/math.rs"]),
        ("micromath::", &["core/src"], &["core/src/math.rs"]),
        ("serialport", &HOST, &["host/pendant/src/serial.rs"]),
        ("std::fs", &HOST, shells),
    ];
    for (word, folders, homes) in rules {
        let mut used = false;
        for path in folders.iter().flat_map(|folder| sources(folder)).filter(|path| code(path).contains(word))
        {
            let at_home = |home: &&str| {
                path.starts_with(root().join(home)) || path == root().join(home).with_extension("rs")
            };
            assert!(homes.iter().any(at_home), "{} uses {word}", path.display());
            used = true;
        }
        assert!(used, "{word} is used nowhere");
    }
}

#[test]
fn core_has_no_std_no_allocation_and_no_unsafe_code() {
    let lib = read("core/src/lib.rs");
    for attribute in ["#![no_std]", "#![forbid(unsafe_code)]"] {
        assert!(lib.lines().any(|line| line == attribute), "{attribute}");
    }
    for path in sources("core/src") {
        assert!(!code(&path).contains("extern crate"), "{}", path.display());
    }
}

#[test]
fn no_module_has_an_empty_name_and_no_two_public_types_of_a_crate_have_one() {
    const EMPTY: [&str; 5] = ["utils", "common", "types", "helpers", "manager"];
    // Read with the module's name before them, as in `io::Error`.
    const BY_MODULE: [&str; 3] = ["Error", "Config", "Options"];
    for folder in HOST.iter().chain(&["core/src", "firmware/src", "tests/src"]) {
        let mut types: BTreeMap<String, usize> = BTreeMap::new();
        for path in sources(folder) {
            let stem = path.file_stem().expect("a name").to_string_lossy();
            assert!(!EMPTY.iter().any(|name| *name == stem), "{}", path.display());
            for line in code(&path).lines() {
                let mut words = line.trim().split([' ', '<', '(', ';', ':']);
                if words.next() == Some("pub")
                    && words.next().is_some_and(|kind| ["struct", "enum", "trait", "type"].contains(&kind))
                {
                    *types.entry(words.next().unwrap_or_default().to_owned()).or_default() += 1;
                }
            }
        }
        // A macro's `$name` is none.
        types.retain(|name, count| {
            *count > 1 && !BY_MODULE.contains(&name.as_str()) && !name.starts_with('$')
        });
        // The firmware has two boards of one shape, and the tests several machines.
        let is_product = folder.starts_with("host") || folder.starts_with("core");
        assert!(!is_product || types.is_empty(), "{folder}: one name for several types: {types:?}");
    }
}

/// Cells of the rows of a table in ARCHITECTURE.md, below this heading.
fn table(heading: &str) -> Vec<Vec<String>> {
    let text = read("ARCHITECTURE.md");
    let section = text.split(heading).nth(1).expect("the section").split("\n#").next().expect("its table");
    let rows = section.lines().filter(|line| line.starts_with('|')).skip(2);
    rows.map(|row| row.trim_matches('|').split('|').map(|cell| cell.trim().to_owned()).collect()).collect()
}

/// What stands in the first pair of backticks.
fn quoted(cell: &str) -> &str {
    cell.split('`').nth(1).unwrap_or_else(|| panic!("nothing in backticks: {cell}"))
}

/// The name of a function whose first line of documentation names an equation, for each equation that it names.
fn equations(text: &str) -> Vec<(u32, String)> {
    let mut found = Vec::new();
    for item in text.split("\n\n").flat_map(|block| block.split("}\n")) {
        let mut lines = item.lines().map(str::trim).skip_while(|line| !line.starts_with("///"));
        let numbers = lines.next().unwrap_or_default().split("eq. (").skip(1);
        let numbers = numbers.filter_map(|rest| rest.split(')').next()?.parse().ok());
        let code = lines.find(|line| !line.starts_with("///") && !line.starts_with("#["));
        let name = code.and_then(|line| Some(line.split_once("fn ")?.1.split(['(', '<']).next()?.to_owned()));
        found.extend(numbers.filter_map(|number| Some((number, name.clone()?))));
    }
    found
}

#[test]
fn every_equation_has_one_function_that_computes_it_and_the_product_calls_it() {
    let mut homes: BTreeMap<u32, Vec<(String, String)>> = BTreeMap::new();
    let mut product_code = Vec::new();
    for path in product() {
        let file = path.strip_prefix(root()).expect("below the root").to_string_lossy().into_owned();
        for (number, function) in equations(&read(&path)) {
            homes.entry(number).or_default().push((file.clone(), function));
        }
        product_code.push(code(&path));
    }
    let rows: Vec<_> = table("## The paper, equation by equation\n");
    let rows: Vec<_> = rows.iter().filter(|row| row.len() == 9).collect();
    assert_eq!(rows.len(), 22);
    for (number, row) in (1..).zip(rows) {
        assert_eq!(row[0], format!("({number})"));
        assert!(row.iter().all(|cell| !cell.is_empty()), "an empty cell: {row:?}");
        assert!(row[5..].iter().any(|by| by != "no"), "{row:?} is used by nothing");
        let function = quoted(&row[3]);
        let name = function.rsplit("::").next().expect("a name");
        assert_eq!(homes[&number], [(quoted(&row[2]).to_owned(), name.to_owned())], "eq. ({number})");
        let called = |code: &String| {
            code.match_indices(&format!("{name}(")).any(|(at, _)| {
                let before = &code[..at];
                let qualified = !function.contains("::") || before.ends_with(['.', ':']);
                !before.ends_with("fn ")
                    && !before.ends_with(|c: char| c.is_alphanumeric() || c == '_')
                    && qualified
            })
        };
        assert!(product_code.iter().any(called), "eq. ({number}): {function} is not called");
    }
}

#[test]
fn what_is_computed_twice_is_held_equal_by_tests_that_exist() {
    let rows = table("### What is computed twice\n");
    assert!(rows.len() >= 3);
    let all: String = product().iter().map(read).collect();
    for row in rows {
        let test = quoted(row.last().expect("a cell"));
        assert!(all.contains(&format!("#[test]\n    fn {test}()")), "{test}");
    }
}

/// Crates that the library is built from, with these features: each as `name version`.
fn crates_of_the_library(arguments: &[&str]) -> BTreeSet<String> {
    let tree = ["tree", "--package", "weldpath", "--edges", "normal", "--prefix", "none", "--no-dedupe"];
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let output = std::process::Command::new(cargo)
        .args(tree)
        .args(["--locked", "--offline"])
        .args(arguments)
        .current_dir(root())
        .output()
        .expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).expect("names are text");
    text.lines().map(|line| line.split(' ').take(2).collect::<Vec<_>>().join(" ")).collect()
}

#[test]
fn the_library_alone_is_built_without_the_command_and_from_few_crates() {
    const MOST_CRATES_OF_OTHERS: usize = 93;
    const OF_THE_COMMAND: [&str; 10] = [
        "clap",
        "clap_complete",
        "hyper",
        "indicatif",
        "serialport",
        "pcd-rs",
        "ply-rs-bw",
        "serde-saphyr",
        "lz-str",
        "tokio",
    ];
    let (alone, all) = (crates_of_the_library(&["--no-default-features"]), crates_of_the_library(&[]));
    let others = alone.iter().filter(|one| !one.starts_with("weldpath")).count();
    assert!(others <= MOST_CRATES_OF_OTHERS, "{others} crates: {alone:#?}");
    let has = |crates: &BTreeSet<String>, name| crates.iter().any(|one| one.split(' ').next() == Some(name));
    for name in OF_THE_COMMAND {
        assert!(!has(&alone, name), "{name} is in the library alone");
        assert!(has(&all, name), "{name} is not in the default build");
    }
}

#[test]
fn the_command_without_its_page_has_no_server_and_the_page_costs_few_crates() {
    const MOST_CRATES_OF_THE_PAGE: usize = 14;
    let plain = crates_of_the_library(&["--no-default-features", "--features", "cli"]);
    let with = crates_of_the_library(&["--no-default-features", "--features", "cli,open"]);
    let added: Vec<&String> = with.difference(&plain).collect();
    assert!(plain.is_subset(&with) && added.iter().any(|name| name.starts_with("hyper ")), "{added:?}");
    assert!(added.len() <= MOST_CRATES_OF_THE_PAGE, "{added:?}");
}

/// Name and version of everything that a package is built from, of a lock file.
fn built_from(lock: &str, package: &str) -> BTreeSet<(String, String)> {
    let lock: toml::Table = read(lock).parse().expect("TOML");
    let packages = lock["package"].as_array().expect("packages");
    let (mut seen, mut left) = (BTreeSet::new(), vec![package.to_owned()]);
    while let Some(name) = left.pop() {
        for found in packages.iter().filter(|found| found["name"].as_str() == Some(&name)) {
            if seen.insert((name.clone(), found["version"].as_str().expect("a version").to_owned())) {
                let needs = found.get("dependencies").and_then(toml::Value::as_array).into_iter().flatten();
                // Where several versions are locked, an entry reads `name version`.
                left.extend(needs.filter_map(|need| Some(need.as_str()?.split(' ').next()?.to_owned())));
            }
        }
    }
    seen
}

#[test]
fn core_is_built_from_the_same_versions_for_host_and_firmware() {
    let [on_host, on_board] =
        ["Cargo.lock", "firmware/Cargo.lock"].map(|lock| built_from(lock, "weldpath-core"));
    assert!(on_host.intersection(&on_board).count() > 15, "few crates are shared");
    let differs =
        |one: &&(String, String)| !on_host.contains(*one) && on_host.iter().any(|(name, _)| *name == one.0);
    let different: Vec<_> = on_board.iter().filter(differs).collect();
    assert!(different.is_empty(), "locked otherwise in Cargo.lock: {different:?}");
}

#[test]
fn the_tests_and_the_host_never_link_the_firmware() {
    for manifest in ["host/Cargo.toml", "tests/Cargo.toml"] {
        assert!(!read(manifest).contains("weldpath-firmware"), "{manifest}");
    }
}
