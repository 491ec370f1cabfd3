//! Whether the data beside the checkout is there was asked when the tests were built; a stale answer would leave tests out.

use weldpath_tests::beside;

use crate::{read, sources};

#[test]
fn the_tests_were_built_knowing_what_lies_beside_the_checkout() {
    for (name, known) in [("data", cfg!(shared_data)), ("tools/evaluate.py", cfg!(reference_script))] {
        // Without numpy the script is of no use, so that it lies there says nothing.
        let there = beside(name).is_some() && (name == "data" || known);
        assert_eq!(there, known, "shared/{name} came or went since the build: touch tests/build.rs");
    }
}

/// Every test that asks for the data is ignored without it: the attribute stands at each.
#[test]
fn every_test_that_reads_the_data_is_ignored_without_it() {
    let mut readers = 0;
    // This file names the call that it looks for, and reads no data.
    for path in sources("tests/tests").into_iter().filter(|path| !path.ends_with("shared_data.rs")) {
        let text = read(&path);
        let asks = |test: &&str| test.lines().any(|line| line.contains("= shared_data("));
        for test in text.split("#[test]\n").skip(1).filter(asks) {
            let body = test.split("\n}\n").next().unwrap_or_default();
            if body.contains("= shared_data(") {
                assert!(
                    test.starts_with("#[cfg_attr(not(shared_data), ignore"),
                    "{}: {body}",
                    path.display()
                );
                readers += 1;
            }
        }
    }
    assert!(readers > 15, "only {readers} tests were seen to read the data");
}
