#!/bin/sh
# Before a release: the packages for Python as they would be published, into target/packages/. Not part of tests/all.sh.
#
#   tests/packages.sh
#
# 1. The source package, built and tried in an environment without a network, from a wheelhouse.
# 2. A wheel for every Linux with glibc 2.28 or newer (2018), linked by zig, its size, and what it links against.
# Needs Python 3.10 with venv and pip, and a package index; about fifteen minutes.
set -eu
cd "$(dirname "$0")/.."
out=$PWD/target/packages
rm -rf "$out"
mkdir -p "$out"
python3 -m venv "$out/tools"
"$out/tools/bin/pip" install --quiet 'maturin>=1.9,<2' ziglang
"$out/tools/bin/pip" download --quiet --dest "$out/wheelhouse" 'maturin>=1.9,<2' 'numpy>=1.23'

echo "== source package, without a network"
(cd python && "$out/tools/bin/maturin" sdist --out "$out/dist")
cargo fetch --locked --quiet
python3 -m venv "$out/clean"
CARGO_NET_OFFLINE=true CARGO_TARGET_DIR="$out/build" \
    "$out/clean/bin/pip" install --quiet --no-index --find-links "$out/wheelhouse" "$out"/dist/weldpath-*.tar.gz
tried='import weldpath
run = weldpath.plan(weldpath.samples.cell(), job=weldpath.samples.cell_job())
assert run.verdict.state == "ready" and len(run.paths) == 1, run
print(weldpath.__version__, run)'
"$out/clean/bin/python" -c "$tried"
"$out/clean/bin/weldpath" --version

echo "== wheel for glibc 2.28"
# maturin finds zig as the module ziglang of the environment on the path.
(cd python && PATH="$out/tools/bin:$PATH" CARGO_TARGET_DIR="$out/build" \
    maturin build --release --locked --zig --compatibility manylinux_2_28 --out "$out/dist")
wheel=$(ls "$out"/dist/weldpath-*manylinux_2_28*.whl)
python3 -m venv "$out/wheel"
"$out/wheel/bin/pip" install --quiet --no-index --find-links "$out/wheelhouse" "$wheel"
"$out/wheel/bin/python" -c "$tried"
# Samples are two and a half of these.
most=11
size=$(wc -c <"$wheel")
echo "$wheel: $((size / 1000000)).$((size / 100000 % 10)) MB of $most"
[ "$size" -le $((most * 1000000)) ]
rm -rf "$out/build" "$out/clean" "$out/wheel" "$out/tools"
ls -l "$out/dist"
