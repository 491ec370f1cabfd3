//! The documents name files of the tree: each is there, and so is every target of a link between them.

use std::path::{Path, PathBuf};

use weldpath_tests::markdown::{anchors, blocks, code, links};

use crate::{HOST, read, root};

/// Everything that a reader is led to: the documents at the root, and those in `docs/`.
fn documents() -> Vec<PathBuf> {
    let at =
        |folder: PathBuf| std::fs::read_dir(folder).expect("a folder").map(|entry| entry.unwrap().path());
    let all = at(root().to_path_buf()).chain(at(root().join("docs")));
    let mut found: Vec<PathBuf> = all.filter(|path| path.extension().is_some_and(|e| e == "md")).collect();
    // What was noticed of past versions names what was there then.
    found.retain(|path| !path.ends_with("CHANGELOG.md"));
    found.sort();
    found
}

/// Words of its code that are paths from the root of the tree.
fn paths_named(text: &str) -> Vec<String> {
    let tops = ["core/", "host/", "firmware/", "tests/", "fixtures/", "docs/"];
    let shell = blocks(text, "sh").into_iter().map(str::to_owned);
    let code: Vec<String> = code(text).into_iter().chain(shell).collect();
    let word = |word: &&str| tops.iter().any(|top| word.starts_with(top));
    let plain = |word: &&str| word.chars().all(|c| c.is_ascii_alphanumeric() || "/._-".contains(c));
    let words = code.iter().flat_map(|code| code.split_whitespace());
    words.filter(word).filter(plain).map(str::to_owned).collect()
}

/// Where something that a command of the documents builds or writes will be.
fn is_made(path: &str) -> bool {
    path.contains("/target/") || path.starts_with("fixtures/") && path.ends_with("/out")
}

#[test]
fn every_path_link_and_heading_that_the_documents_name_is_there() {
    let (mut named, mut missing) = (0, Vec::new());
    for document in documents() {
        let text = std::fs::read_to_string(&document).expect("a document");
        let here = document.parent().expect("a folder");
        let paths = paths_named(&text).into_iter().filter(|path| !is_made(path));
        let links = links(&text).into_iter().filter(|link| !link.contains("://"));
        let places = paths.map(|path| root().join(path)).chain(links.map(|link| here.join(link)));
        for place in places {
            named += 1;
            let place = place.to_string_lossy();
            let (path, heading) = place.split_once('#').unwrap_or((&place, ""));
            let path = if path.ends_with('/') && !heading.is_empty() { &document } else { Path::new(path) };
            let has_heading =
                || anchors(&std::fs::read_to_string(path).unwrap_or_default()).contains(heading);
            if !path.exists() || !heading.is_empty() && !has_heading() {
                missing.push(format!("{}: {place}", document.display()));
            }
        }
    }
    assert!(named > 60, "only {named} paths were read");
    assert!(missing.is_empty(), "{missing:#?}");
}

#[test]
fn the_map_of_the_host_is_the_listing_of_its_folders() {
    let map = read("ARCHITECTURE.md");
    let rows = map.split("## The crates of host/\n").nth(1).and_then(|rest| rest.split("\n## ").next());
    let rows = rows.expect("the table of the crates").lines().filter_map(|line| line.strip_prefix("| `"));
    let stem =
        |row: &str| Some(Path::new(row.split('`').next()?).with_extension("").to_string_lossy().into_owned());
    let mut drawn: Vec<String> = rows.filter_map(stem).collect();
    let mut there = Vec::new();
    for folder in HOST {
        for entry in std::fs::read_dir(root().join(folder)).expect("the crate") {
            let stem = entry.unwrap().path().with_extension("");
            there.push(stem.strip_prefix(root()).expect("in the tree").to_string_lossy().into_owned());
        }
    }
    // A crate of one module is its lib.rs, and its parts are its own affair.
    let flat = ["host/files/src/", "host/pendant/src/"];
    there.retain(|path| !path.ends_with("/main") && !flat.iter().any(|crate_| path.starts_with(crate_)));
    there.retain(|path| !path.ends_with("/lib"));
    there.extend(flat.map(|folder| folder.trim_end_matches("/src/").to_owned()));
    there.sort();
    there.dedup();
    drawn.sort();
    assert_eq!(drawn, there);
}
