//! The rules of the tree, read from the sources: which module may know which, what core may use, and that every equation
//! of the paper is found where it is computed.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Core, lowest first: a module and what it may know besides the crate's own types.
///
/// Algorithms know nothing of the wire; `tasks` alone joins the two.
const CORE: &[(&str, &[&str])] = &[
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

/// Rooms of the host, lowest first: a folder of `host/src` with the file of its name. A stage may read what an earlier
/// one hands over, as a parameter; it never calls a later one.
const HOST: &[(&str, &[&str])] = &[
    ("files", &[]),
    ("geometry", &[]),
    ("input", &["geometry"]),
    ("model", &["geometry"]),
    ("seam", &["geometry", "model"]),
    ("weld", &["geometry", "seam"]),
    ("pipeline", &["geometry", "model", "seam", "weld"]),
    ("robot", &["files", "geometry", "weld"]),
    ("output", &["geometry", "seam", "weld", "pipeline", "robot"]),
    ("run", &["files", "geometry", "input", "model", "seam", "weld", "pipeline", "robot", "output"]),
    ("pendant", &["weld"]),
    ("lab", &["files", "geometry", "input", "model", "seam", "weld", "pipeline", "output", "run", "pendant"]),
    ("report", &["files", "geometry", "seam", "weld", "pipeline", "output", "run", "lab"]),
    ("server", &["files", "input", "weld", "pipeline", "robot", "output", "run", "report"]),
];

/// Names that say nothing about what is in a module.
const EMPTY_NAMES: &[&str] = &["utils", "common", "types", "helpers", "manager"];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the package lies in the workspace")
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// All Rust files below a folder of the workspace.
fn sources(folder: &str) -> Vec<PathBuf> {
    fn walk(folder: &Path, found: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display())) {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                walk(&path, found);
            } else if path.extension().is_some_and(|e| e == "rs") {
                found.push(path);
            }
        }
    }
    let mut found = Vec::new();
    walk(&root().join(folder), &mut found);
    found.sort();
    assert!(!found.is_empty(), "{folder} holds no Rust file");
    found
}

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

/// Which of the crate's top-level modules a file belongs to.
fn module(path: &Path, src: &Path) -> String {
    let inside = path.strip_prefix(src).expect("below src");
    let first = inside.components().next().expect("a name").as_os_str();
    Path::new(first).file_stem().expect("a name").to_string_lossy().into_owned()
}

/// Modules named in `crate::a` and `crate::{a::b, c}`.
fn modules_named(code: &str) -> BTreeSet<String> {
    let identifier = |text: &str| -> String {
        text.trim_start().chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()
    };
    let mut named = BTreeSet::new();
    for rest in code.split("crate::").skip(1) {
        match rest.strip_prefix('{') {
            Some(list) => named.extend(members(list).map(identifier)),
            None => drop(named.insert(identifier(rest))),
        }
    }
    named
}

/// What stands between the commas of a brace that has been opened, up to where it closes.
fn members(list: &str) -> impl Iterator<Item = &str> {
    let mut depth = 0_i32;
    let end = list.find(|c| {
        depth += i32::from(c == '{') - i32::from(c == '}');
        depth < 0
    });
    let inside = &list[..end.unwrap_or(list.len())];
    let mut depth = 0_i32;
    inside.split(move |c| {
        depth += i32::from(c == '{') - i32::from(c == '}');
        c == ',' && depth == 0
    })
}

/// Every module that a crate's modules name, against the table.
fn hold(folder: &str, table: &[(&str, &[&str])]) {
    let allowed: BTreeMap<&str, &[&str]> = table.iter().copied().collect();
    let src = root().join(folder);
    let mut arrows = 0;
    for path in sources(folder) {
        let from = module(&path, &src);
        if ["lib", "main", "cli"].contains(&from.as_str()) {
            continue;
        }
        let known =
            allowed.get(from.as_str()).unwrap_or_else(|| panic!("{folder}: {from} is not in the table"));
        for to in modules_named(&code(&path)) {
            // Types named at the crate's root begin with a capital.
            if to == from || !allowed.contains_key(to.as_str()) && to.starts_with(char::is_uppercase) {
                continue;
            }
            assert!(known.contains(&to.as_str()), "{}: {from} must not know {to}", path.display());
            arrows += 1;
        }
    }
    assert!(arrows > 10, "{folder}: only {arrows} arrows were read");
}

#[test]
fn no_arrow_of_the_tables_goes_up() {
    for table in [CORE, HOST] {
        for (k, (module, known)) in table.iter().enumerate() {
            let lower: Vec<&str> = table[..k].iter().map(|(name, _)| *name).collect();
            for name in *known {
                assert!(lower.contains(name), "{module} -> {name}");
            }
        }
    }
}

#[test]
fn modules_of_core_know_only_those_below_them() {
    hold("core/src", CORE);
}

#[test]
fn modules_of_the_host_know_only_those_below_them() {
    hold("host/src", HOST);
}

#[test]
fn a_brace_of_modules_is_read_as_its_members() {
    let named = modules_named("use crate::{Point, wire::{self, Answer}, math};\nlet x = crate::seam::Ball;");
    let expected = ["Point", "math", "seam", "wire"].map(String::from);
    assert_eq!(named.into_iter().collect::<Vec<_>>(), expected);
}

/// Whether any code of a folder but `home` names `word`.
fn named_outside(folder: &str, home: &str, word: &str) -> Option<PathBuf> {
    let home = root().join(folder).join(home);
    sources(folder).into_iter().filter(|path| *path != home).find(|path| code(path).contains(word))
}

#[test]
fn only_math_names_the_mathematical_libraries() {
    let text = code(&root().join("core/src/math.rs"));
    assert!(text.contains("libm::") && text.contains("micromath::"));
    for library in ["libm::", "micromath::", "use libm", "use micromath"] {
        assert_eq!(named_outside("core/src", "math.rs", library), None, "{library}");
    }
}

#[test]
fn only_serial_names_the_serial_port() {
    assert_eq!(named_outside("host/src", "pendant/serial.rs", "serialport"), None);
    assert_eq!(named_outside("core/src", "serial.rs", "serialport"), None);
}

#[test]
fn algorithms_of_the_host_read_and_write_no_file() {
    let shells = [
        "input",
        "files",
        "run/job",
        "lab/evaluation",
        "lab/suite",
        "cli",
        "pendant/emulator",
        "pendant/teleop",
        "pendant/link/saved",
    ];
    let src = root().join("host/src");
    let shell = |path: &Path| {
        shells.iter().any(|shell| path.strip_prefix(&src).is_ok_and(|inside| in_room(inside, shell)))
    };
    for path in sources("host/src").iter().filter(|path| !shell(path)) {
        assert!(!code(path).contains("std::fs"), "{}", path.display());
    }
}

/// Whether a file is a room's own, `a/b.rs`, or lies in its folder, `a/b/`.
fn in_room(inside: &Path, room: &str) -> bool {
    inside.with_extension("").starts_with(room)
}

#[test]
fn the_tests_and_the_host_never_link_the_firmware() {
    for manifest in ["host/Cargo.toml", "tests/Cargo.toml"] {
        assert!(!read(&root().join(manifest)).contains("weldpath-firmware"), "{manifest}");
    }
}

#[test]
fn no_module_has_an_empty_name() {
    for folder in ["core/src", "host/src", "firmware/src", "tests/src"] {
        for path in sources(folder) {
            let parts = path.strip_prefix(root()).expect("below the root").with_extension("");
            let empty =
                parts.iter().find(|part| EMPTY_NAMES.iter().any(|name| part.eq_ignore_ascii_case(name)));
            assert_eq!(empty, None, "{}", path.display());
        }
    }
}

#[test]
fn core_has_no_std_no_allocation_and_no_unsafe_code() {
    let lib = read(&root().join("core/src/lib.rs"));
    for attribute in ["#![no_std]", "#![forbid(unsafe_code)]"] {
        assert!(lib.lines().any(|line| line == attribute), "{attribute}");
    }
    for path in sources("core/src") {
        let code = code(&path);
        for word in ["extern crate", "alloc::", "std::", "unsafe "] {
            assert!(!code.contains(word), "{} names {word}", path.display());
        }
    }
}

/// First doc line of every function of a file, with the function's line of code.
fn documented_functions(text: &str) -> Vec<(String, String)> {
    let mut first: Option<&str> = None;
    let mut functions = Vec::new();
    for line in text.lines().map(str::trim) {
        if let Some(doc) = line.strip_prefix("///") {
            first = first.or(Some(doc));
        } else if !line.starts_with("#[") {
            let words: Vec<&str> = line.split_whitespace().collect();
            if let (Some(doc), Some(_)) = (first.take(), words.iter().take(5).position(|word| *word == "fn"))
            {
                functions.push((doc.to_owned(), line.to_owned()));
            }
        }
    }
    functions
}

/// Numbers of the equations named in a line, each as `eq. (12)`.
fn equations(line: &str) -> impl Iterator<Item = u32> + '_ {
    line.split("eq. (").skip(1).filter_map(|rest| rest.split(')').next()?.parse().ok())
}

/// A row of ARCHITECTURE.md's table of equations.
struct Equation {
    number: u32,
    file: String,
    /// As it is called: `name`, or `Type::name` and `module::name` where the name alone says little.
    function: String,
    /// What uses it: by default, by the paper's way, the pendant, evaluation.
    used: Vec<String>,
}

/// Cells of a row of a table in Markdown.
fn cells(row: &str) -> Vec<&str> {
    row.trim().trim_matches('|').split('|').map(str::trim).collect()
}

/// What stands in the first pair of backticks.
fn quoted(cell: &str) -> Option<String> {
    cell.split('`').nth(1).map(str::to_owned)
}

fn equations_of_the_table() -> Vec<Equation> {
    let text = read(&root().join("ARCHITECTURE.md"));
    let head = "## The paper, equation by equation";
    let section = text.split(head).nth(1).expect("the section").split("\n### ").next().expect("its table");
    let row = |line: &str| {
        let cells = cells(line);
        let number = cells[0].strip_prefix('(')?.strip_suffix(')')?.parse().ok()?;
        assert_eq!(cells.len(), 9, "{line}");
        assert!(cells.iter().all(|cell| !cell.is_empty()), "an empty cell: {line}");
        let used = cells[5..].iter().map(|cell| (*cell).to_owned()).collect();
        Some(Equation { number, file: quoted(cells[2])?, function: quoted(cells[3])?, used })
    };
    section.lines().filter(|line| line.starts_with('|')).filter_map(row).collect()
}

/// Whether code calls a function: `name(` that is not its definition, qualified as it is written, or as a method.
fn calls(code: &str, function: &str) -> bool {
    let name = function.rsplit("::").next().expect("a name");
    let inside_a_word = |text: &str| text.ends_with(|c: char| c.is_alphanumeric() || c == '_');
    let called = |pattern: &str| {
        let mut places = code.match_indices(pattern).map(|(at, _)| &code[..at]);
        places.any(|before| !inside_a_word(before) && !before.ends_with("fn "))
    };
    called(&format!("{function}(")) || code.contains(&format!(".{name}("))
}

#[test]
fn every_equation_has_one_function_that_computes_it_and_the_product_calls_it() {
    let mut homes: BTreeMap<u32, Vec<(String, String)>> = (1..=22).map(|n| (n, Vec::new())).collect();
    let mut product = Vec::new();
    for path in sources("core/src").into_iter().chain(sources("host/src")) {
        let file = path.strip_prefix(root()).expect("below the root").to_string_lossy().into_owned();
        for (doc, function) in documented_functions(&read(&path)) {
            let name = function.split("fn ").nth(1).expect("a function").split(['(', '<']).next();
            for number in equations(&doc) {
                let homes = homes.get_mut(&number).unwrap_or_else(|| panic!("eq. ({number}) in {file}"));
                homes.push((file.clone(), name.expect("a name").to_owned()));
            }
        }
        product.push(code(&path));
    }
    let table = equations_of_the_table();
    assert_eq!(table.iter().map(|row| row.number).collect::<Vec<_>>(), (1..=22).collect::<Vec<_>>());
    for Equation { number, file, function, used } in table {
        let name = function.rsplit("::").next().expect("a name").to_owned();
        assert_eq!(homes[&number], [(file, name)], "eq. ({number}): as documented, and as in the table");
        assert!(
            product.iter().any(|code| calls(code, &function)),
            "eq. ({number}): {function} is not called"
        );
        assert!(used.iter().any(|by| by != "no"), "eq. ({number}): {function} is used by nothing");
    }
}

#[test]
fn a_definition_or_a_longer_name_is_no_call() {
    let called = |code: &str| calls(code, "solve");
    assert!(called("let x = solve(a);") && called("system.solve(a)") && called("(solve(1))"));
    assert!(!called("pub fn solve(a: u8) {}") && !called("resolve(a)") && !called("solve"));
    assert!(
        calls("point_to_plane::row(a, b)", "point_to_plane::row") && !calls("row(a)", "point_to_plane::row")
    );
}

#[test]
fn what_is_computed_twice_is_held_equal_by_tests_that_exist() {
    let text = read(&root().join("ARCHITECTURE.md"));
    let section = text.split("### What is computed twice").nth(1).expect("the section");
    let section = section.split("\n#").next().expect("its table");
    let rows = section.lines().filter(|line| line.starts_with('|')).skip(2);
    let tests: Vec<String> = rows.filter_map(|row| quoted(cells(row).last()?)).collect();
    assert!(tests.len() >= 3, "{tests:?}");
    let all: String = ["core/src", "host/src"].iter().flat_map(|f| sources(f)).map(|p| read(&p)).collect();
    for test in tests {
        assert!(all.contains(&format!("#[test]\n    fn {test}()")), "{test}");
    }
}

/// Crates that the library is built from, itself among them, with the features that `arguments` choose.
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
    // `name version (where it is from)`: two versions of a crate are two crates.
    text.lines().map(|line| line.split(' ').take(2).collect::<Vec<_>>().join(" ")).collect()
}

/// Largest number of crates that somebody who takes the library alone has to build.
const MOST_CRATES: usize = 95;

#[test]
fn the_library_alone_is_built_without_the_command_and_from_few_crates() {
    let (alone, all) = (crates_of_the_library(&["--no-default-features"]), crates_of_the_library(&[]));
    assert!(alone.len() <= MOST_CRATES, "{} crates: {alone:#?}", alone.len());
    let names = |crates: &BTreeSet<String>| -> BTreeSet<String> {
        crates.iter().filter_map(|one| one.split(' ').next()).map(str::to_owned).collect()
    };
    for name in [
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
    ] {
        assert!(!names(&alone).contains(name), "{name} is in the library alone");
        assert!(names(&all).contains(name), "{name} is not in the default build");
    }
}

/// Crates that the page of `weldpath open` adds to the command: HTTP, and what waits for it.
const MOST_CRATES_OF_THE_PAGE: usize = 14;

#[test]
fn the_command_without_its_page_has_no_server_and_the_page_costs_few_crates() {
    let features = "cli,e57,las";
    let plain = crates_of_the_library(&["--no-default-features", "--features", features]);
    let with = crates_of_the_library(&["--no-default-features", "--features", &format!("{features},open")]);
    let added: Vec<&String> = with.difference(&plain).collect();
    assert!(plain.is_subset(&with) && added.iter().any(|name| name.starts_with("hyper ")), "{added:?}");
    assert!(added.len() <= MOST_CRATES_OF_THE_PAGE, "{added:?}");
}

/// A package of a lock file: its version and the names of what it depends on.
type Locked = BTreeMap<String, Vec<(String, Vec<String>)>>;

fn locked(path: &str) -> Locked {
    let text = read(&root().join(path));
    let quoted = |line: &str| line.split('"').nth(1).unwrap_or_default().to_owned();
    let mut packages = Locked::new();
    for block in text.split("[[package]]").skip(1) {
        let of = |key: &str| {
            block.lines().find(|line| line.starts_with(key)).map(quoted).expect("name and version")
        };
        let list = block.split("dependencies = [").nth(1).unwrap_or_default();
        let names = list.lines().skip(1).take_while(|line| !line.starts_with(']')).map(quoted);
        // Where several versions are locked, an entry reads `name version`.
        let names = names.map(|name| name.split(' ').next().unwrap_or_default().to_owned()).collect();
        packages.entry(of("name = ")).or_default().push((of("version = "), names));
    }
    packages
}

/// All versions of everything that a package is built from.
fn built_from(locked: &Locked, package: &str) -> BTreeSet<(String, String)> {
    let (mut seen, mut left) = (BTreeSet::new(), vec![package.to_owned()]);
    while let Some(name) = left.pop() {
        for (version, needs) in &locked[&name] {
            if seen.insert((name.clone(), version.clone())) {
                left.extend(needs.iter().cloned());
            }
        }
    }
    seen
}

#[test]
fn core_is_built_from_the_same_versions_for_host_and_firmware() {
    let (host, firmware) = (locked("Cargo.lock"), locked("firmware/Cargo.lock"));
    let (on_host, on_board) = (built_from(&host, "weldpath-core"), built_from(&firmware, "weldpath-core"));
    let same = on_host.intersection(&on_board).count();
    assert!(same > 15, "only {same} crates are shared");
    let known =
        |others: &BTreeSet<(String, String)>, name: &str| others.iter().any(|(other, _)| other == name);
    let differ = |pair: &&(String, String)| !on_host.contains(*pair) && known(&on_host, &pair.0);
    let different: Vec<_> = on_board.iter().filter(differ).collect();
    assert!(different.is_empty(), "locked otherwise in Cargo.lock: {different:?}");
}

/// A function as it is written: how long it is and how much it must be told.
#[derive(Debug, PartialEq)]
struct Written {
    name: String,
    lines: usize,
    parameters: usize,
}

/// All functions of some code that have a body, nested ones too.
fn functions(code: &str) -> Vec<Written> {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let begins = code.match_indices("fn ").filter(|(at, _)| !code[..*at].ends_with(is_word));
    let written = |(at, _): (usize, &str)| {
        let rest = &code[at + 3..];
        let name: String = rest.chars().take_while(|c| is_word(*c)).collect();
        let open = name.len() + rest[name.len()..].find('(')?;
        let list = enclosed(&rest[open..])?;
        let after = &rest[open + list.len() + 2..];
        let body = after.find('{').filter(|body| after.find(';').is_none_or(|end| *body < end))?;
        let length = body + enclosed(&after[body..])?.len() + 2;
        let text = &rest[..open + list.len() + 2 + length];
        let parameters = at_top_level(list).filter(|part| !part.trim().is_empty()).count();
        (!name.is_empty()).then(|| Written { name, lines: text.lines().count(), parameters })
    };
    begins.filter_map(written).collect()
}

/// How a character moves the depth of brackets, an arrow's head apart.
fn deeper(before: char, c: char) -> i32 {
    match c {
        '(' | '[' | '{' | '<' => 1,
        '>' if before == '-' || before == '=' => 0,
        ')' | ']' | '}' | '>' => -1,
        _ => 0,
    }
}

/// What stands between the bracket at the beginning, round or curly, and the one that closes it.
fn enclosed(text: &str) -> Option<&str> {
    let (open, close) = if text.starts_with('(') { ('(', ')') } else { ('{', '}') };
    let mut depth = 0_i32;
    let end = text.find(|c| {
        depth += i32::from(c == open) - i32::from(c == close);
        depth == 0
    })?;
    Some(&text[1..end])
}

/// The parts of a list between commas that no bracket encloses.
fn at_top_level(list: &str) -> impl Iterator<Item = &str> {
    let (mut depth, mut before) = (0_i32, ' ');
    list.split(move |c| {
        depth += deeper(before, c);
        before = c;
        c == ',' && depth == 0
    })
}

#[test]
fn functions_are_read_with_their_lines_and_parameters() {
    let code = "pub fn a(x: (u8, u8), f: impl Fn(u8, u8) -> bool, m: BTreeMap<u8, u8>,) -> u8 {\n    1\n}\ntrait T {\n    \
                fn b(&self);\n    fn c<T: Into<u8>>(&self) { {} }\n}\n";
    let written = |name: &str, lines, parameters| Written { name: name.into(), lines, parameters };
    assert_eq!(functions(code), [written("a", 3, 3), written("c", 1, 1)]);
}

#[test]
fn no_function_is_long_and_none_of_the_method_asks_for_much() {
    const MOST_LINES: usize = 60;
    const MOST_PARAMETERS: usize = 6;
    let src = root().join("host/src");
    let rooms = ["seam", "pipeline", "model", "geometry"];
    let of_method = |path: &PathBuf| {
        path.strip_prefix(&src).is_ok_and(|path| rooms.iter().any(|room| in_room(path, room)))
    };
    let mut read = 0;
    // This file holds code as text.
    let files = ["host/src", "core/src", "tests"].iter().flat_map(|folder| sources(folder));
    for path in files.filter(|path| !path.ends_with("architecture.rs")) {
        for function in functions(&code(&path)) {
            let fits =
                function.lines <= MOST_LINES && (function.parameters <= MOST_PARAMETERS || !of_method(&path));
            assert!(fits, "{}: {function:?}", path.display());
            read += 1;
        }
    }
    assert!(read > 3000, "only {read} functions were read");
}
