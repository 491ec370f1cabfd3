#!/bin/sh
# Prints the path of a rustc of the version given, as `1.89`, if one is installed; fetches nothing.
set -eu
version=$1
matches() { [ -x "$1" ] && "$1" --version 2>/dev/null | grep -q "^rustc $version\."; }
for rustc in "${RUSTUP_HOME:-$HOME/.rustup}"/toolchains/*/bin/rustc "$(command -v rustc || true)" /usr/bin/rustc; do
    if matches "$rustc"; then
        echo "$rustc"
        exit
    fi
done
exit 1
