#!/bin/sh
# Every check of weldpath, in the order in which they fail fastest. `.ci/run` calls this and nothing else.
#
#   tests/all.sh             everything
#   tests/all.sh --no-apt    the same, and never calls apt-get
#
# Needs Rust (rustup's stable is enough), chromium for the report, and, for the firmware in an emulator, qemu-system-arm
# and a toolchain for the Cortex-M4F. As root on Debian it fetches what is missing by apt-get and prints what; otherwise it prints the command.
set -eu
cd "$(dirname "$0")/.."
# What is compiled once needs no store for the next time: it would double the room on the disk.
export CARGO_INCREMENTAL="${CARGO_INCREMENTAL:-0}"
# Names a part, and at the end says how long each took.
begun=$(date +%s)
parts=
part=
say() {
    now=$(date +%s)
    [ -z "$part" ] || parts="$parts$(printf '%5d s  %s' $((now - begun)) "$part")
"
    begun=$now part="$*"
    printf '\n== %s\n' "$*"
}

missing=
need() { missing="$missing $*"; }
command -v qemu-system-arm >/dev/null || need qemu-system-arm
command -v valgrind >/dev/null || need valgrind
command -v chromium >/dev/null || need chromium
command -v python3 >/dev/null || need python3
command -v cc >/dev/null || need gcc libc6-dev
command -v cargo >/dev/null || need rustc-web cargo-web
command -v cargo-fmt >/dev/null || need rustfmt-web
command -v cargo-clippy >/dev/null || need rust-web-clippy
if ! firmware/build.sh toolchain >/dev/null 2>&1; then need rustc-web cargo-web rust-web-src rust-web-clippy lld; fi
if [ -n "$missing" ]; then
    install="apt-get install --yes --no-install-recommends$missing"
    if [ "${1:-}" != --no-apt ] && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        say "installing:$missing"
        apt-get update -qq
        $install
    else
        echo "tests/all.sh needs these packages; run, as root: $install" >&2
        exit 1
    fi
fi

say "format"
cargo fmt --all --check
(cd firmware && cargo fmt --check)

say "licences, versions and sources of the dependencies"
if command -v cargo-deny >/dev/null; then
    cargo deny --log-level error check licenses bans sources
    cargo deny --log-level error --manifest-path firmware/Cargo.toml --config deny.toml check licenses bans sources
else
    echo "!! NOT CHECKED: cargo-deny is not installed (cargo install cargo-deny --locked)"
fi

say "lints, every reader"
cargo clippy --workspace --all-targets --quiet -- -D warnings

say "lints, as a user builds it"
cargo clippy -p weldpath --quiet -- -D warnings

say "lints of the library alone: no command, no optional reader"
cargo clippy -p weldpath --no-default-features --quiet -- -D warnings

say "documentation"
RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --quiet

declared=$(sed -n 's/^rust-version = "\(.*\)"/\1/p' Cargo.toml)
say "oldest compiler, $declared"
if compiler=$(tests/compiler.sh "$declared"); then
    RUSTC=$compiler CARGO_TARGET_DIR=target/oldest cargo check --workspace --quiet
else
    echo "!! NOT CHECKED: no rustc $declared here (rustup toolchain install $declared); the lints name what its library lacks"
fi

say "firmware: emulated board, STM32F407, lints"
firmware/build.sh build --release
firmware/build.sh clippy --release -- -D warnings
firmware/build.sh clippy --release --no-default-features --features stm32f407 -- -D warnings
firmware/build.sh build --release --no-default-features --features stm32f407

say "mutants apply"
MUTANTS_TARGET_DIR="$PWD/target" tests/mutants.sh --check

say "tests: units, properties, every reader, fixtures, link, firmware in QEMU, report in Chromium"
WELDPATH_REQUIRE_QEMU=1 WELDPATH_REQUIRE_CHROMIUM=1 cargo test --workspace

say "all passed"
printf '%s' "$parts"
