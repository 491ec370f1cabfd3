#!/bin/sh
# The checks of a working day, two minutes on two cores once the dependencies are built: format, lints, all unit tests, the rules
# of the tree, the fixtures end to end, the bytes of the wire. Everything else is in tests/all.sh.
set -eu
cd "$(dirname "$0")/.."
cargo fmt --all --check
cargo clippy --workspace --all-targets --quiet -- -D warnings
cargo test --workspace --exclude weldpath-benches --exclude weldpath-python --quiet --lib
cargo test --workspace --exclude weldpath-benches --exclude weldpath-python --quiet --test method fixtures::
cargo test --workspace --exclude weldpath-benches --exclude weldpath-python --quiet --test link link_golden::
cargo test --workspace --exclude weldpath-benches --exclude weldpath-python --quiet --test tree -- architecture:: documents:: shared_data::
