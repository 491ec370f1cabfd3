#!/bin/sh
# Runs cargo for the firmware's target, thumbv7em-none-eabihf, with whatever toolchain here can:
#
#   firmware/build.sh build --release            the emulated board; last line of stdout = folder of the programs
#   firmware/build.sh toolchain            says which, builds nothing
#   firmware/build.sh missing              Debian packages that are missing here to build and lint it, one a line
#   firmware/build.sh clippy --no-default-features --features stm32f407
#
# The order, first that fits; what was chosen is said on stderr:
#   1. the active toolchain has the target                     2. it has rust-src: build core with it
#   3. rustup may fetch the target (RUSTUP_AUTO_INSTALL is not 0)   4. Debian's packages: build core with them
# WELDPATH_FIRMWARE_TOOLCHAIN=debian goes straight to 4. Nothing but 3 ever changes a toolchain.
set -eu
target=thumbv7em-none-eabihf
cd "$(dirname "$0")"
# Called from a test, cargo's variables name the host's build.
unset RUSTC RUSTDOC CARGO RUSTFLAGS CARGO_ENCODED_RUSTFLAGS RUSTUP_TOOLCHAIN CARGO_TARGET_DIR CARGO_BUILD_TARGET

have_target() { [ -n "$(find "$(rustc --print target-libdir --target $target 2>/dev/null)" -name 'libcore-*.rlib' 2>/dev/null)" ]; }
have_source() { [ -f "$("$1" --print sysroot 2>/dev/null)/lib/rustlib/src/rust/library/core/src/lib.rs" ]; }
linker() {
    for rustc in rustc /usr/bin/rustc; do
        lld="$($rustc --print sysroot 2>/dev/null)/lib/rustlib/$(uname -m)-unknown-linux-gnu/bin/rust-lld"
        if [ -x "$lld" ]; then echo "$lld"; return; fi
    done
    command -v rust-lld || command -v ld.lld
}

# What way 4 lacks, each by itself; and its clippy, which no other toolchain's replaces.
missing() {
    [ -x /usr/bin/rustc ] || echo rustc-web
    [ -x /usr/bin/cargo ] || echo cargo-web
    have_source /usr/bin/rustc || echo rust-web-src
    linker >/dev/null || echo lld
    [ -x /usr/bin/cargo-clippy ] || echo rust-web-clippy
}

cargo=cargo
core=
way=${WELDPATH_FIRMWARE_TOOLCHAIN:-any}
if [ "$way" != debian ] && have_target; then
    way="the active toolchain"
elif [ "$way" != debian ] && have_source rustc; then
    way="the active toolchain, core built from rust-src"
    core=-Zbuild-std=core
elif [ "$way" != debian ] && [ "${RUSTUP_AUTO_INSTALL:-1}" != 0 ] && command -v rustup >/dev/null 2>&1 &&
    rustup target add $target >&2 && have_target; then
    way="the active toolchain, target added by rustup"
elif [ -x /usr/bin/cargo ] && have_source /usr/bin/rustc && ld=$(linker); then
    way="Debian's toolchain, core built from its sources"
    core=-Zbuild-std=core
    cargo=/usr/bin/cargo
    # Its clippy, too, and not rustup's.
    export PATH="/usr/bin:$PATH"
    export RUSTC=/usr/bin/rustc RUSTDOC=/usr/bin/rustdoc CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER="$ld"
else
    cargo=
fi
if [ "$1" = missing ]; then
    [ "$cargo" = cargo ] || missing
    exit
fi
if [ -z "$cargo" ]; then
    echo "firmware/build.sh: no toolchain here builds for $target. One of these makes one:" >&2
    echo "    rustup target add $target" >&2
    echo "    apt-get install $(missing | xargs)" >&2
    exit 3
fi
[ -z "$core" ] || export RUSTC_BOOTSTRAP=1
version=$("${RUSTC:-rustc}" --version)
echo "firmware: $version, $way" >&2
# One folder per compiler: the artefacts of one are rubbish to another.
CARGO_TARGET_DIR=$PWD/target/$(echo "$version" | cut -d' ' -f1-2 | tr ' ' -)
export CARGO_TARGET_DIR
command=$1
shift
[ "$command" != toolchain ] || exit 0
$cargo "$command" --target $target $core "$@" >&2
echo "$CARGO_TARGET_DIR/$target/release"
