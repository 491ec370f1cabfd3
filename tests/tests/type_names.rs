//! A name stands for one thing: no two public types of a crate have one name.

use std::collections::BTreeMap;
use std::path::Path;

/// Read with the module's name before them, as the language's own library does (`io::Error`, `fmt::Error`).
const BY_MODULE: &[(&str, &str)] = &[
    ("Error", "why the module's work was not done"),
    ("Config", "settings of one stage"),
    ("Options", "how one entry is called: input::Options, evaluation::Options"),
];

fn walk(folder: &Path, types: &mut BTreeMap<String, Vec<String>>) {
    for entry in std::fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display())) {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            walk(&path, types);
        } else if path.extension().is_some_and(|e| e == "rs") {
            let text = std::fs::read_to_string(&path).expect("a source");
            for name in public_types(&text) {
                types.entry(name.to_owned()).or_default().push(path.display().to_string());
            }
        }
    }
}

/// Names of the types that a file makes public.
fn public_types(text: &str) -> impl Iterator<Item = &str> {
    text.lines().filter_map(|line| {
        let mut words = line.trim().strip_prefix("pub ")?.split_whitespace();
        let kind = words.next()?;
        let name = words.next()?.split(|c: char| !c.is_alphanumeric()).next()?;
        // A macro's `$name` is none.
        (["struct", "enum", "trait", "type", "union"].contains(&kind) && !name.is_empty()).then_some(name)
    })
}

fn twice(folder: &str) -> BTreeMap<String, Vec<String>> {
    let mut types = BTreeMap::new();
    walk(&Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the workspace").join(folder), &mut types);
    assert!(types.len() > 50, "only {} types in {folder}", types.len());
    types.retain(|name, files| files.len() > 1 && BY_MODULE.iter().all(|(known, _)| known != name));
    types
}

#[test]
fn no_two_public_types_of_a_crate_have_one_name() {
    for folder in ["core/src", "host/src"] {
        let twice = twice(folder);
        assert!(twice.is_empty(), "one name for several types: {twice:#?}");
    }
}

#[test]
fn public_types_are_read_with_generics_and_without_private_ones() {
    let text = "pub struct A<'a> {\npub(crate) enum B {}\npub trait C: D {\n    pub type E = u8;\nstruct F;\npub fn g()";
    assert_eq!(public_types(text).collect::<Vec<_>>(), ["A", "C", "E"]);
}
