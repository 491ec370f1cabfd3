#!/usr/bin/env bash
# Deliberate bugs in the link: each mutant breaks one mechanism in a copy of core and tests, and a test has to turn red.
#
# On demand, about ten minutes: tests/mutants.sh [NAME...]. Prints a table; fails if a mutant survives, does not apply or
# does not compile. tests/mutants.txt is the output of the last run. `--check` only sees that each applies and that the
# copy compiles; tests/all.sh runs that.
set -euo pipefail

root=$(cd "$(dirname "$0")/.." && pwd)
copy=$(mktemp -d)
trap 'rm -rf "$copy"' EXIT
export CARGO_TARGET_DIR="${MUTANTS_TARGET_DIR:-$copy/target}"
export RUST_BACKTRACE=0
check=
if [ "${1:-}" = --check ]; then check=1 && shift; fi
wanted=("$@")
failures=0

# Only core and the tests of the link: the host has no part in it.
fresh_copy() {
    rm -rf "$copy/work"
    mkdir -p "$copy/work/tests/tests" "$copy/work/docs"
    cp -r "$root/core" "$root/Cargo.lock" "$copy/work/"
    cp "$root/docs/protocol.md" "$copy/work/docs/"
    cp -r "$root/tests/src" "$root/tests/golden" "$copy/work/tests/"
    cp "$root"/tests/tests/link_*.rs "$copy/work/tests/tests/"
    sed -i -E '/^pub mod /{/ (adversary|bench|world);/!d}' "$copy/work/tests/src/lib.rs"
    sed 's/members = .*/members = ["core", "tests"]/; /^weldpath = /d' "$root/Cargo.toml" > "$copy/work/Cargo.toml"
    sed -E '/^weldpath(-fuzz)?( =|\.)/d' "$root/tests/Cargo.toml" > "$copy/work/tests/Cargo.toml"
}

report() {
    printf '| %-28s | %-10s | %s |\n' "$1" "$2" "$3"
}

# mutant NAME TARGET FILTER FILE SED-SCRIPT: TARGET is a test file, or "core" for core's own tests.
mutant() {
    local name=$1 target=$2 filter=$3 file=$4 script=$5 select
    if [ ${#wanted[@]} -gt 0 ] && [[ " ${wanted[*]} " != *" $name "* ]]; then return; fi
    fresh_copy
    sed -i -E "$script" "$copy/work/core/src/$file"
    if cmp -s "$root/core/src/$file" "$copy/work/core/src/$file"; then
        report "$name" "NO MATCH" "the patch does not apply to $file"
        failures=$((failures + 1))
        return
    fi
    if [ -n "$check" ]; then return; fi
    select=(-p weldpath-tests --test "$target")
    if [ "$target" = core ]; then select=(-p weldpath-core --lib); fi
    cd "$copy/work"
    if ! cargo test -q "${select[@]}" --no-run >"$copy/log" 2>&1; then
        report "$name" "NO BUILD" "$(grep -m1 '^error' "$copy/log" || true)"
        failures=$((failures + 1))
    elif timeout 300 cargo test -q "${select[@]}" -- "$filter" >"$copy/log" 2>&1; then
        report "$name" "SURVIVED" "$target $filter"
        failures=$((failures + 1))
    else
        report "$name" "red" "$(red_tests)"
    fi
}

red_tests() {
    { grep -E "^    [a-z0-9_:]+$" "$copy/log" || echo "    (timed out)"; } | sort -u | head -2 | xargs
}

if [ -n "$check" ]; then
    fresh_copy
    (cd "$copy/work" && cargo check --quiet -p weldpath-tests --tests)
fi
report mutant outcome "tests that turn red (first two)"
report "----" "----" "----"

mutant crc-removed link_damage bursts wire/frame.rs \
    's/if CRC.checksum\(payload\) == u32::from_le_bytes\(\*crc\)/if crc.len() == CRC_BYTES/'
mutant crc-weakened-to-16-bits link_damage ten_million wire/frame.rs \
    's/if CRC.checksum\(payload\) == u32::from_le_bytes\(\*crc\)/if CRC.checksum(payload) as u16 == u32::from_le_bytes(*crc) as u16/'
mutant leading-delimiter-removed core delimiter wire/frame.rs \
    "s/^const COBS_START: usize = 1/const COBS_START: usize = 0/; /framer.append\\(0\\)\\?;\$/d"
mutant trailing-bytes-accepted link_directed nonsense wire/frame.rs \
    's/Ok\(\(message, \[\]\)\) => Ok\(message\)/Ok((message, _)) => Ok(message)/'
mutant session-check-removed link_directed session pendant.rs \
    's/is_none_or\(\|session\| session.id != frame.session\)/is_none()/'
mutant second-host-accepted link_directed second_host pendant.rs \
    's/\(!same \&\& \(alive \|\| !self.stands\(\)\)\)/(!same \&\& alive \&\& !self.is_heard())/'
mutant hello-counts-as-life link_directed storm pendant.rs \
    's/^( *)if let Some\(why\) = self.refuse_hello\(hello\) \{/\1self.silent_ticks = 0;\n&/'
mutant watchdog-removed link_timing in_time pendant.rs \
    's/self.session.is_some\(\) \&\& self.silent_ticks <= .*/self.session.is_some()/'
mutant manual-limit-removed link_directed manual pendant.rs 's/if panel.manual \{/if panel.manual \&\& feed_free() {/; $a fn feed_free() -> bool { false }'
mutant requests-executed-again link_directed executed_once pendant/command.rs \
    's/if request == self.requests.last \{/if request == self.requests.last \&\& self.requests.reply.is_none() {/; s/if request != self.requests.last.wrapping_add\(1\) \{/if request < self.requests.last {/'
mutant reply-not-kept link_directed lost_ten_times pendant/command.rs \
    's/^( *)self.requests.reply = Some\(answer\);/\1self.requests.reply = None;/'
mutant digest-check-removed link_directed digest pendant/command.rs 's/if computed != digest \{/if computed == 0 \&\& digest == 1 {/'
mutant stale-resume-accepted link_directed stale pendant/command.rs 's/ \&\& changes != now \{/ \&\& changes == now.wrapping_add(1) {/'
mutant path-id-reused link_directed path_id pendant/command.rs 's/as i16 <= 0\)/as i16 == i16::MIN)/'
mutant dedupe-removed link_faults doubled pendant/ring.rs 's/if self.is_stored\(chunk.first\) \{/if self.is_stored(chunk.first) \&\& chunk.path == u16::MAX {/'
mutant credit-check-removed link_directed credit pendant/ring.rs 's/is_some_and\(\|end\| end <= limit\)/is_some()/'
mutant step-between-chunks-unseen link_directed between_two_chunks pendant/ring.rs \
    's/^( *)first == self.next$/\1first == u32::MAX/; s/\|\| first.checked_sub\(u32::from\(self.begin.chunk\)\).*/\&\& first > 0/'
mutant limits-of-waypoints-unseen link_directed invalid_waypoint pendant/ring.rs 's/if !waypoint.pose.is_unit\(\) \{/if waypoint.pose.is_unit() \&\& reach < 0 {/'
mutant planned-past-what-came core last_waypoint_received pendant/ring.rs 's/\(0.0, last.approach_um\)/(1.0e12, last.approach_um)/'
mutant starvation-unseen link_directed underrun pendant/drive.rs 's/<= stop_um$/<= -1.0/'
mutant braking-too-late link_faults clean pendant/drive.rs 's/\(root - change\).max\(0.0\)/root/'
mutant arm-survives-hold link_model table interlock.rs '/fn hold\(/,/^    }/s/self.armed = false;//'
mutant arc-survives-hold link_timing in_time interlock.rs \
    's/let power = self.state == State::Running \&\& self.armed/let power = self.state != State::Fault/; s/self.arc.cut\(\);//; s/self.arc.rest\(\&self.times\);//'
mutant released-first-removed link_directed switch interlock.rs 's/\} else if self.released \&\& !inputs.e_stop \{/} else if !inputs.e_stop {/'
mutant e-stop-not-latched link_model table interlock.rs 's/\} else if reset \&\& self.state/} else if self.state/'
mutant e-stop-reset-by-host link_directed e_stop interlock.rs '/State::Fault if self.fault == Some\(Fault::EStop\) => Err/d'
mutant motion-before-the-arc link_model table interlock.rs 's/^( *)_ => Motion::Halt,/\1State::Running => Motion::Run,\n&/'
mutant resume-without-standstill link_model table interlock.rs 's/^( *)\(State::Held, _\) => self.go\(\),/\1(State::Held | State::Holding, _) => self.go(),/'
mutant no-resend link_faults dropped_frames sender/upload.rs 's/overtaken \|\| age_us >= .*/overtaken \&\& age_us == 0/'

if [ -n "$check" ] && [ "$failures" -eq 0 ]; then echo "every mutant applies" && exit; fi
[ "$failures" -eq 0 ] && echo "every mutant turns a test red" || { echo "$failures mutants do not"; exit 1; }
