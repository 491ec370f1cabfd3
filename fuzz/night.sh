#!/bin/sh
# A night of fuzzing: every target for SECONDS (default 2400, under eleven hours in all), guided by coverage where cargo-fuzz
# and a nightly compiler are there, else by chance. Inputs that fail are in fuzz/artifacts; put them, made small, into
# fuzz/regressions/TARGET/.
set -u
cd "$(dirname "$0")" || exit 1
seconds=${1:-2400}
seed=$(date +%j)
failed=0
guided=no
if cargo fuzz --version >/dev/null 2>&1 && cargo +nightly --version >/dev/null 2>&1; then guided=yes; fi
cargo run --quiet --release --bin mutate -- seeds corpus || exit 1
for target in ply pcd text stl obj png npy vtk hand_eye scan_json job path_json hands wire arrays plan; do
  if [ $guided = yes ]; then
    cargo +nightly fuzz run --fuzz-dir . --features coverage "$target" -- -max_total_time="$seconds" -seed="$seed" \
      -rss_limit_mb=2048 -max_len=65536 -print_final_stats=1 || failed=1
  else
    cargo run --quiet --release --bin mutate -- "$target" "$seconds" "$seed" || failed=1
  fi
done
exit $failed
