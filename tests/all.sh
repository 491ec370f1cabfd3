#!/bin/sh
# Every check of weldpath. `.ci/run` calls this and nothing else.
#
#   tests/all.sh             everything
#   tests/all.sh --no-apt    the same, and never calls apt-get
#
# Needs Rust (rustup's stable is enough), chromium for the report, and, for the firmware in an emulator, qemu-system-arm
# and a toolchain for the Cortex-M4F. As root on Debian it fetches what is missing by apt-get and prints what; otherwise it prints the command.
# shellcheck disable=SC2086 # lists of arguments are split on purpose
set -eu
cd "$(dirname "$0")/.."
# What is compiled once needs no store for the next time: it would double the room on the disk.
export CARGO_INCREMENTAL="${CARGO_INCREMENTAL:-0}"
# Names a part, and at the end says how long each took.
first=$(date +%s)
begun=$first
parts=
part=
say() {
    now=$(date +%s)
    [ -z "$part" ] || parts="$parts$(printf '%5d s  %s' $((now - begun)) "$part")
"
    begun=$now part="$*"
    printf '\n== %s\n' "$*"
}
# Which part failed, and what the others took.
ended() {
    code=$?
    [ $code -eq 0 ] || printf '\n== failed: %s\n%s' "$part" "$parts" >&2
}
trap ended EXIT

missing=
need() { missing="$missing $*"; }
command -v qemu-system-arm >/dev/null || need qemu-system-arm
command -v valgrind >/dev/null || need valgrind
command -v chromium >/dev/null || need chromium
command -v python3 >/dev/null || need python3
command -v cc >/dev/null || need gcc libc6-dev
command -v cargo >/dev/null || need rustc-web cargo-web
# rustup puts a stand-in on the path for a component that is not installed: only a tool that runs is there.
for tool in fmt:rustfmt-web:rustfmt clippy:rust-web-clippy:clippy; do
    cargo "${tool%%:*}" --version >/dev/null 2>&1 && continue
    component=${tool##*:} package=${tool#*:} package=${package%:*}
    if ! command -v rustup >/dev/null 2>&1; then
        need "$package"
    elif [ "${RUSTUP_AUTO_INSTALL:-1}" != 0 ]; then
        rustup component add "$component"
    else
        echo "tests/all.sh needs a component of the toolchain; run: rustup component add $component" >&2
        exit 1
    fi
done
for package in $(firmware/build.sh missing 2>/dev/null); do
    case " $missing " in *" $package "*) ;; *) need "$package" ;; esac
done
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

mkdir -p target
# Starts a part beside the others; `joined` waits for it, shows what it said, and fails if it did.
beside() {
    "$1" >"target/$1.txt" 2>&1 &
    eval "$1=$!"
}
joined() {
    code=0
    eval "wait \$$1" || code=$?
    cat "target/$1.txt"
    return $code
}

firmware() {
    firmware/build.sh build --release
    firmware/build.sh clippy --release -- -D warnings
    firmware/build.sh clippy --release --no-default-features --features stm32f407 -- -D warnings
    firmware/build.sh build --release --no-default-features --features stm32f407
}
# All but the benches, whose libraries change the features of the product's, so that it would be built twice.
packages="--workspace --exclude weldpath-benches --exclude weldpath-python"

say "format"
cargo fmt --all --check
(cd firmware && cargo fmt --check)
beside firmware

say "licences, versions and sources of the dependencies"
if command -v cargo-deny >/dev/null; then
    cargo deny --log-level error check licenses bans sources
    cargo deny --log-level error --manifest-path firmware/Cargo.toml --config deny.toml check licenses bans sources
else
    echo "!! NOT CHECKED: cargo-deny is not installed (cargo install cargo-deny --locked)"
fi

say "lints"
cargo clippy --workspace --all-targets --quiet -- -D warnings

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

say "core with checks of overflow, which the product leaves out"
cargo test -p weldpath-core --quiet --lib

say "mutants apply"
MUTANTS_TARGET_DIR="$PWD/target" tests/mutants.sh --check

say "build of the product and of all tests, as it is shipped"
cargo test $packages --release --no-run

say "links of the arm, by a peer in Python"
peer=target/peer
if python3 -m venv $peer && $peer/bin/pip install --quiet numpy scipy ur-analytic-ik==0.1.0.post3 py-opw-kinematics==1.3.0 &&
    $peer/bin/python -c 'import tomllib; from scipy.spatial.transform import RigidTransform'; then
    $peer/bin/python tests/arm_links_peer.py target/release/weldpath
else
    echo "!! NOT CHECKED: it needs Python 3.11, python3 -m venv, and the peer's packages from pip"
fi

say "package for Python: its wheel, its types, its tests"
code=0
tests/python.sh || code=$?
case $code in
0) ;;
77) echo "!! NOT CHECKED: it needs Python 3.10 or newer, python3 -m venv, and packages from pip" ;;
*) exit $code ;;
esac

say "firmware, begun beside the lints: emulated board, STM32F407, lints"
joined firmware

say "tests: units, properties, every reader, fixtures, link, report in Chromium; after them, firmware in QEMU and pendants"
export WELDPATH_REQUIRE_QEMU=1 WELDPATH_REQUIRE_CHROMIUM=1
computing=
for folder in tests/tests/*/; do
    name=$(basename "$folder")
    [ "$name" = live ] || computing="$computing --test $name"
done
failed=
cargo test $packages --release --no-fail-fast --lib --bins --test command --test examples --test library $computing || failed=1
cargo test $packages --release --doc || failed=1
# What runs in real time runs alone: beside what computes it waited for up to half a second, even at a lower priority of that.
cargo test $packages --release --test live || failed=1
[ -z "$failed" ] || exit 1

say "all passed"
printf '%s%5d s  in all\n' "$parts" $((begun - first))
