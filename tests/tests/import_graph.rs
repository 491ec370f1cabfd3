//! The graph of the host's files, read from their sources: which file uses what another defines. A re-export is followed
//! to the file that defines the name, and is itself no use of it unless the file's own code says the name.
//!
//! Two rules. No circle of files leaves one folder, where `a.rs` counts as part of `a/`. Inside a folder, only the part
//! `a/b.rs` and the file `a.rs` it is a part of may know each other, and only where the list says why.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// A file below `host/src` without its ending, as the names of its modules.
type Module = Vec<String>;

/// Folders whose parts use words of the file above them, and why these stand there.
const CIRCLES: &[(&str, &str)] = &[
    (
        "files",
        "one Error and one record of what was there, for the journal that switches and the manifest that asks",
    ),
    ("geometry/mesh", "the mesh that is closed into shells"),
    ("seam/facets", "bounds on gaps and openings, said once for all of its steps"),
    ("input", "one Error for all readers, and the Scan that each fills; the file above tries them in turn"),
    ("model/agreement", "which views fit, which its parts judge and describe"),
    ("model/reconstruction", "settings and result of the registration that the solver fills"),
    ("pipeline", "settings, clock and error of the method, for the search over voxel sizes"),
    ("robot/feasibility", "the check of a waypoint, and what is wrong with it"),
    ("run/job", "the job whose mistakes the refusals name"),
    ("run/refit", "bounds of the search, said once for all of its steps"),
    ("lab/evaluation", "one Error for all its files; the score that each part adds to"),
    ("lab/simulation", "the simulated scan that is written to files"),
    ("lab/simulation/workpiece", "the piece and its true seams, for each family of pieces"),
    ("lab/comparison", "what was measured, for the page that shows it"),
    ("report/picture", "the projection that the pixels are drawn in"),
    ("weld/air", "the pose of the torch and the end of a way, for the search across the terrain"),
    ("cli", "exit codes and failures of all subcommands; the file above chooses between them"),
];

/// Circles between files that are not a file and its parts; empty when every room is in order.
const BESIDE: &[(&[&str], &str)] = &[(
    &[
        "robot/feasibility/arm",
        "robot/feasibility/catalogue",
        "robot/feasibility/offset_wrist",
        "robot/feasibility/spherical_wrist",
    ],
    "an arm is named from the catalogue, which is made of arms",
)];

/// The files with their code: no comments, no unit tests.
struct Sources {
    code: BTreeMap<Module, String>,
    /// Names that a file's `use` lines bring in, and the paths they stand for.
    uses: BTreeMap<Module, Vec<(String, Vec<String>)>>,
}

impl Sources {
    fn of(src: &Path) -> Self {
        let mut code = BTreeMap::new();
        walk(src, &mut Vec::new(), &mut code);
        let uses = code.iter().map(|(module, text)| (module.clone(), uses(text))).collect();
        Self { code, uses }
    }

    fn child(&self, module: &[String], name: &str) -> Option<Module> {
        let child: Module = module.iter().cloned().chain([name.to_owned()]).collect();
        self.code.contains_key(&child).then_some(child)
    }

    /// Where a path that stands in `from` begins, and what is left of it; `None` for another crate's.
    fn begin(&self, from: &Module, path: &[String], depth: u8) -> Option<(Module, Vec<String>)> {
        let (first, rest) = path.split_first()?;
        match first.as_str() {
            "crate" => Some((Module::new(), rest.to_vec())),
            "self" => Some((from.clone(), rest.to_vec())),
            "super" => {
                let ups = path.iter().take_while(|name| *name == "super").count();
                Some((from[..from.len().checked_sub(ups)?].to_vec(), path[ups..].to_vec()))
            }
            name if self.child(from, name).is_some() => Some((from.clone(), path.to_vec())),
            name => {
                let known = self.uses[from].iter().find(|(known, whole)| known == name && whole != path)?;
                let whole = [known.1.as_slice(), rest].concat();
                (depth > 0).then(|| self.begin(from, &whole, depth - 1)).flatten()
            }
        }
    }

    /// The file that defines what a path in `from` names.
    fn defines(&self, from: &Module, path: &[String], depth: u8) -> Option<Module> {
        let (mut module, mut rest) = self.begin(from, path, depth)?;
        while let Some((name, below)) = rest.clone().split_first() {
            match self.child(&module, name) {
                Some(child) => (module, rest) = (child, below.to_vec()),
                None => break,
            }
        }
        let re_exported = rest.first().and_then(|name| {
            let found = self.uses.get(&module)?.iter().find(|(known, _)| known == name)?;
            (depth > 0 && module != *from).then(|| self.defines(&module, &found.1, depth - 1)).flatten()
        });
        Some(re_exported.unwrap_or(module))
    }

    /// From each file to those that it uses.
    fn graph(&self) -> BTreeMap<&Module, BTreeSet<Module>> {
        let edges = |module: &Module| {
            let passed_on = names_passed_on(&self.code[module]);
            let used = self.uses[module].iter().filter(|(name, _)| !passed_on.contains(name));
            let used = used.map(|(_, path)| path.clone());
            let named = paths(&self.code[module]);
            let defined = used.chain(named).filter_map(|path| self.defines(module, &path, 8));
            defined.filter(|to| to != module && !to.is_empty()).collect()
        };
        self.code.keys().filter(|module| !module.is_empty()).map(|module| (module, edges(module))).collect()
    }
}

fn walk(folder: &Path, above: &mut Module, code: &mut BTreeMap<Module, String>) {
    for entry in std::fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display())) {
        let path = entry.expect("an entry").path();
        let name = path.file_stem().expect("a name").to_string_lossy().into_owned();
        if path.is_dir() {
            above.push(name);
            walk(&path, above, code);
            above.pop();
        } else if path.extension().is_some_and(|e| e == "rs") && !["main", "tests"].contains(&name.as_str()) {
            let module = if name == "lib" { Module::new() } else { [above.clone(), vec![name]].concat() };
            code.insert(module, code_of(&path));
        }
    }
}

fn code_of(path: &Path) -> String {
    let text = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let lines =
        text.lines().take_while(|line| !line.trim_start_matches("pub(crate) ").starts_with("mod tests {"));
    lines.map(|line| line.split("//").next().unwrap_or_default()).flat_map(|line| [line, "\n"]).collect()
}

/// Names and paths of all `use` declarations.
fn uses(code: &str) -> Vec<(String, Vec<String>)> {
    let mut found = Vec::new();
    for statement in code.split(';') {
        let Some(at) = statement.rfind("use ") else { continue };
        let before = statement[..at].chars().next_back();
        if before.is_none_or(|c| c.is_whitespace()) {
            leaves("", &statement[at + 4..], &mut found);
        }
    }
    found
}

/// Names that the code makes public by `pub use` and does not say otherwise.
fn names_passed_on(code: &str) -> BTreeSet<String> {
    let (mut passed_on, mut own) = (BTreeSet::new(), BTreeSet::new());
    for statement in code.split_inclusive(';') {
        let imports = uses(statement);
        if imports.is_empty() {
            let words = statement.split(|c: char| !(c.is_alphanumeric() || c == '_'));
            own.extend(words.map(str::to_owned));
        } else if statement.contains("pub use ") || statement.contains("pub(crate) use ") {
            passed_on.extend(imports.into_iter().map(|(name, _)| name));
        }
    }
    passed_on.retain(|name| !own.contains(name));
    passed_on
}

/// The paths of a tree of `use`, one by one.
fn leaves(above: &str, tree: &str, found: &mut Vec<(String, Vec<String>)>) {
    let tree = tree.trim();
    let Some((stem, list)) = tree.split_once('{') else {
        let (path, name) = tree.split_once(" as ").map_or((tree, None), |(path, name)| (path, Some(name)));
        let whole = format!("{above}{path}");
        let mut path: Vec<String> = whole.split("::").map(|part| part.trim().to_owned()).collect();
        if path.len() > 1 && path.last().is_some_and(|last| last == "self") {
            path.pop();
        }
        let last = path.last().cloned().unwrap_or_default();
        return found.push((name.map_or(last, |name| name.trim().to_owned()), path));
    };
    let list = list.rsplit_once('}').map_or(list, |(inside, _)| inside);
    let mut depth = 0;
    let parts = list.split(|c| {
        depth += i32::from(c == '{') - i32::from(c == '}');
        c == ',' && depth == 0
    });
    for part in parts.filter(|part| !part.trim().is_empty()) {
        leaves(&format!("{above}{stem}"), part, found);
    }
}

/// Every `a::b::c` of the code.
fn paths(code: &str) -> Vec<Vec<String>> {
    let words = code.split(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':'));
    let chains = words.filter(|word| word.contains("::") && !word.starts_with("::") && !word.ends_with("::"));
    chains.map(|word| word.split("::").filter(|part| !part.is_empty()).map(str::to_owned).collect()).collect()
}

/// Groups of nodes each of which is reached from each other of its group; groups of one left out.
fn circles(graph: &BTreeMap<&Module, BTreeSet<Module>>) -> Vec<BTreeSet<Module>> {
    let reached = |from: &Module| {
        let (mut seen, mut left) = (BTreeSet::new(), vec![from.clone()]);
        while let Some(here) = left.pop() {
            for next in graph.get(&here).into_iter().flatten() {
                if seen.insert(next.clone()) {
                    left.push(next.clone());
                }
            }
        }
        seen
    };
    let all: BTreeMap<&Module, BTreeSet<Module>> = graph.keys().map(|from| (*from, reached(from))).collect();
    let circle = |from: &Module| -> BTreeSet<Module> {
        all[from].iter().filter(|to| all.get(to).is_some_and(|back| back.contains(from))).cloned().collect()
    };
    let found: BTreeSet<_> = graph.keys().map(|from| circle(from)).filter(|group| group.len() > 1).collect();
    found.into_iter().collect()
}

fn name(module: &Module) -> String {
    module.join("/")
}

/// Whether `part` lies below the file `whole`: `a/b` or `a/b/c` below `a`.
fn is_part_of(part: &Module, whole: &Module) -> bool {
    part.len() > whole.len() && part.starts_with(whole)
}

fn host() -> Sources {
    Sources::of(&Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the workspace").join("host/src"))
}

/// The folder that all files of a circle lie in, `a.rs` counting as part of `a/`.
fn folder(circle: &BTreeSet<Module>) -> Option<Module> {
    let lowest = circle.iter().min_by_key(|module| module.len()).expect("a circle has files");
    let inside = |folder: &Module| {
        circle.iter().all(|module| module == folder || module[..module.len() - 1] == folder[..])
    };
    [lowest.clone(), lowest[..lowest.len() - 1].to_vec()].into_iter().find(inside)
}

#[test]
fn circles_stay_inside_a_folder_and_are_listed_with_a_reason() {
    let sources = host();
    let mut graph = sources.graph();
    let arrows: usize = graph.values().map(BTreeSet::len).sum();
    assert!(arrows > 400, "only {arrows} arrows were read");
    let whole = circles(&graph);
    let folders: BTreeSet<String> = whole.iter().filter_map(folder).map(|folder| name(&folder)).collect();
    let outside: Vec<Vec<String>> = whole
        .iter()
        .filter(|circle| folder(circle).is_none())
        .map(|circle| circle.iter().map(name).collect())
        .collect();
    assert!(outside.is_empty(), "circles across folders: {outside:#?}");
    let listed: BTreeSet<&str> = CIRCLES.iter().map(|(folder, _)| *folder).collect();
    let unlisted: Vec<_> = folders.iter().filter(|folder| !listed.contains(folder.as_str())).collect();
    assert!(unlisted.is_empty(), "circles in folders that the list has no reason for: {unlisted:?}");
    let idle: Vec<_> = listed.iter().filter(|folder| !folders.contains(**folder)).collect();
    assert!(idle.is_empty(), "folders in the list that have no circle: {idle:?}");

    // Without the arrows from a part to its whole nothing may be left but what stands in `BESIDE`.
    for (from, to) in &mut graph {
        to.retain(|to| !is_part_of(from, to));
    }
    let known: BTreeSet<BTreeSet<String>> =
        BESIDE.iter().map(|(files, _)| files.iter().map(|file| (*file).to_owned()).collect()).collect();
    let left: Vec<BTreeSet<String>> =
        circles(&graph).iter().map(|circle| circle.iter().map(name).collect()).collect();
    let new: Vec<_> = left.iter().filter(|circle| !known.contains(*circle)).collect();
    assert!(new.is_empty(), "circles between files that are no parts of each other: {new:#?}");
}

#[test]
fn a_circle_is_found_across_a_re_export_and_a_listed_reason_is_not_empty() {
    let code = [
        ("a", "mod b; pub use b::Thing; fn f() { b::make() }"),
        ("a/b", "use crate::c::{d::Other, Same as Else};"),
        ("c", "pub mod d; pub struct Same;"),
        ("c/d", "use crate::a::Thing;"),
        ("e", "use std::fmt; use super::a;"),
    ];
    let module = |path: &str| -> Module { path.split('/').map(str::to_owned).collect() };
    let mut files: BTreeMap<Module, String> =
        code.iter().map(|(path, text)| (module(path), (*text).to_owned())).collect();
    files.insert(Module::new(), String::new());
    let uses = files.iter().map(|(path, text)| (path.clone(), uses(text))).collect();
    let sources = Sources { code: files, uses };
    let graph = sources.graph();
    assert_eq!(graph[&module("e")], BTreeSet::from([module("a")]));
    assert_eq!(graph[&module("a/b")], BTreeSet::from([module("c"), module("c/d")]));
    let found = circles(&graph);
    // `c/d` names a thing that `a` only passes on: the circle is with `a/b`, and `a` is not in it.
    assert_eq!(found, [BTreeSet::from([module("a/b"), module("c/d")])]);
    assert_eq!(folder(&found[0]), None);
    assert!(CIRCLES.iter().all(|(_, reason)| reason.len() > 20));
}
