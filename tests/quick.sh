#!/bin/sh
# The checks of a working day, under three minutes on two cores once the dependencies are built: format, lints, all unit
# tests, the rules of the tree, the fixtures end to end, the bytes of the wire. Everything else is in tests/all.sh.
set -eu
cd "$(dirname "$0")/.."
cargo fmt --all --check
cargo clippy --workspace --all-targets --quiet -- -D warnings
cargo test --workspace --quiet --lib --test architecture --test import_graph --test type_names --test documents \
    --test shared_data --test fixtures --test link_golden
