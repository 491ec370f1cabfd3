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
    mkdir -p "$copy/work/tests/tests/link" "$copy/work/docs"
    cp -r "$root/core" "$root/Cargo.lock" "$copy/work/"
    cp "$root/docs/protocol.md" "$copy/work/docs/"
    cp -r "$root/tests/src" "$root/tests/golden" "$copy/work/tests/"
    cp "$root"/tests/tests/link/link_*.rs "$copy/work/tests/tests/link/"
    grep '^mod link_' "$root/tests/tests/link/main.rs" > "$copy/work/tests/tests/link/main.rs"
    sed -i -E '/^pub mod /{/ (adversary|arm|bench|world);/!d}' "$copy/work/tests/src/lib.rs"
    sed 's/members = .*/members = ["core", "tests"]/; /^weldpath = /d' "$root/Cargo.toml" > "$copy/work/Cargo.toml"
    sed -E '/^weldpath(-fuzz|-benches)?( =|\.)/d' "$root/tests/Cargo.toml" > "$copy/work/tests/Cargo.toml"
}

report() {
    printf '| %-28s | %-10s | %s |\n' "$1" "$2" "$3"
}

# mutant NAME TARGET FILTER FILE SED-SCRIPT: TARGET is the test `link`, or "core" for core's own tests.
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

mutant crc-removed link bursts wire/frame.rs \
    's/if checksum\(\&\[payload\]\) == u32::from_le_bytes\(\*crc\)/if crc.len() == CRC_BYTES/'
mutant crc-weakened-to-16-bits link ten_million wire/frame.rs \
    's/if checksum\(\&\[payload\]\) == u32::from_le_bytes\(\*crc\)/if checksum(\&[payload]) as u16 == u32::from_le_bytes(*crc) as u16/'
mutant leading-delimiter-removed core delimiter wire/frame.rs \
    's/^const FIRST_CODE: usize = 1/const FIRST_CODE: usize = 0/'
mutant trailing-bytes-accepted link nonsense wire/frame.rs \
    's/Ok\(\(message, \[\]\)\) => Ok\(message\)/Ok((message, _)) => Ok(message)/'
mutant session-check-removed link session pendant.rs \
    's/let known = self.host.has\(frame.session\);/let known = self.host.session.is_some();/'
mutant second-host-accepted link second_host pendant/session.rs \
    's/let busy = !again \&\& .*/let busy = !again \&\& self.host.is_heard(self.ticks) \&\& !self.host.is_heard(self.ticks);/'
mutant hello-counts-as-life link storm pendant/session.rs \
    's/^( *)let busy = .*/\1if let Some(session) = \&mut self.host.session { session.echo = self.ticks; }\n&/'
mutant watchdog-removed link in_time pendant/session.rs \
    's/self.session.is_some_and\(\|session\| tick.wrapping_sub\(session.echo\) <= self.silence_ticks\)/self.session.is_some() \&\& tick > 0/'
mutant manual-limit-removed link manual pendant.rs 's/if panel.manual \{/if panel.manual \&\& feed_free() {/; $a fn feed_free() -> bool { false }'
mutant requests-executed-again link executed_once pendant/command.rs \
    's/if request == self.host.requests.last \{/if request == self.host.requests.last \&\& self.host.requests.reply.is_none() {/; s/if request != self.host.requests.last.wrapping_add\(1\) \{/if request < self.host.requests.last {/'
mutant reply-not-kept link lost_ten_times pendant/command.rs \
    's/^( *)self.host.requests.reply = Some\(answer\);/\1self.host.requests.reply = None;/'
mutant digest-check-removed link digest pendant/command.rs 's/if computed != digest \{/if computed == 0 \&\& digest == 1 {/'
mutant stale-resume-accepted link stale pendant/command.rs 's/ \&\& changes != now \{/ \&\& changes == now.wrapping_add(1) {/'
mutant path-id-reused link path_id pendant/path.rs 's/as i16 <= 0\)/as i16 == i16::MIN)/'
mutant dedupe-removed link doubled pendant/ring.rs 's/if self.is_stored\(chunk.first\) \{/if self.is_stored(chunk.first) \&\& chunk.path == u16::MAX {/'
mutant credit-check-removed link credit pendant/ring.rs 's/is_some_and\(\|end\| end <= limit\)/is_some()/'
mutant step-between-chunks-unseen link between_two_chunks pendant/ring.rs \
    's/^( *)first == self.next$/\1first == u32::MAX/; s/\|\| first.checked_sub\(u32::from\(self.begin.chunk\)\).*/\&\& first > 0/'
mutant limits-of-waypoints-unseen link invalid_waypoint pendant/ring.rs 's/if !waypoint.pose.is_unit\(\) \{/if waypoint.pose.is_unit() \&\& reach < 0 {/'
mutant planned-past-what-came core last_waypoint_received pendant/ring.rs 's/\(0.0, last.approach_um\)/(1.0e12, last.approach_um)/'
mutant starvation-unseen link underrun pendant/drive.rs 's/<= stop_um$/<= -1.0/'
mutant braking-too-late link clean pendant/drive.rs 's/\(root - change\).max\(0.0\)/root/'
mutant arm-survives-hold link table interlock.rs '/fn regrip\(/,/^    }/s/self.armed = false;//'
mutant arc-survives-hold link in_time interlock.rs \
    's/let power = self.state == State::Running \&\& self.armed/let power = self.state != State::Fault/; s/self.arc.cut\(\);//; s/self.arc.rest\(\&self.times\);//'
mutant released-first-removed link switch interlock.rs 's/\} else if self.released \&\& healthy \{/} else if healthy {/'
mutant e-stop-not-latched link table interlock.rs 's/\} else if reset \&\& self.state/} else if self.state/'
mutant e-stop-reset-by-host link e_stop interlock.rs '/State::Fault if self.fault.is_some_and\(Fault::is_local\) => Err/d'
mutant motion-before-the-arc link table interlock.rs 's/^( *)_ => Motion::Halt,/\1State::Running => Motion::Run,\n&/'
mutant resume-without-standstill link table interlock.rs 's/^( *)\(State::Held, _\) => self.go\(inputs\),/\1(State::Held | State::Holding, _) => self.go(inputs),/'
mutant no-resend link dropped_frames sender/upload.rs 's/overtaken \|\| age_us >= .*/overtaken \&\& age_us == 0/'

# Findings on commit c4d8c9f, part 6, by number: each rule taken out again.
mutant f1-set-points-stay-here link every_set_point pendant/robot.rs 's/let torch = torch.or\(/let torch = torch.filter(|_| false).or(/'
mutant f2-start-anywhere link elsewhere pendant/place.rs 's/if distance_um <= limits.near_um \&\&/if distance_um < u32::MAX \&\&/'
mutant f2-pose-known-at-power-on link after_power_on pendant/place.rs 's/confirmed: false, pressed: true/confirmed: true, pressed: true/'
mutant f2-pose-known-after-e-stop link e_stop_makes pendant/place.rs 's/^( *)self.robot.place.confirmed = false;/\1self.robot.place.confirmed = true;/'
mutant f2-switch-not-gripped-anew link gripped_anew interlock.rs '/fn regrip\(/,/^    }/s/self.enabled = false;//'
mutant f3-attach-to-a-live-host link goes_on pendant/session.rs 's/if self.host.is_heard\(self.ticks\) \|\| !self.stands\(\) \{/if self.host.is_heard(self.ticks) \&\& !self.stands() \&\& attach.path == u16::MAX {/'
mutant f3-attach-to-another-path link goes_on pendant/session.rs 's/self.path\(\) == Some\(attach.path\)/self.path().is_some()/'
mutant f3-attach-keeps-the-grip link goes_on interlock.rs '/fn attach\(/,/^    }/s/self.regrip\(\);//'
mutant f4-hands-while-disabled link hands_move pendant/jog.rs 's/State::Disabled => Err\(Refusal::NotEnabled\)/State::Disabled => Ok(())/'
mutant f4-hands-in-automatic link hands_move pendant/jog.rs 's/State::Idle if !self.panel.manual =>/State::Idle if self.panel.e_stop =>/'
mutant f4-the-sensors-own-clock link clock_bounds tasks.rs 's/let time_us = u64::from\(time_ms\) \* 1000;/let time_us = u64::from(hands.time_ms) * 1000;/'
mutant f4-confidence-unread link not_sure tasks.rs 's/hand.confidence_permille >= self.limits.confidence_permille/hand.confidence_permille <= u16::MAX/'
mutant f4-no-workspace link workspace tasks.rs 's/position_mm: self.inside\(\&jog.target.position_mm\)/position_mm: jog.target.position_mm/'
mutant f4-target-kept-at-disable link target_is_dropped pendant/jog.rs 's/^( *)self.robot.jogging = Jogging::default\(\);/\1let _ = Jogging::default();/'
mutant f5-repeated-ping-counts link repetition pendant/session.rs 's/let fresh = ahead .*/let fresh = ahead || age < u32::MAX;/; s/= \(ping.count, ping.echo\);/= (ping.count, tick);/'
mutant f5-time-from-the-arrival link delay pendant/session.rs 's/= \(ping.count, ping.echo\);/= (ping.count, tick);/'
mutant f5-every-frame-is-life link masquerade pendant.rs 's/^( *)HostMessage::Control \{ request, command \} => self.control/\1HostMessage::Control { request, command } if { let count = self.host.session.map_or(0, |session| session.count.wrapping_add(1)); self.host.hear(\&crate::wire::Ping { count, echo: self.ticks, token: 0 }, self.ticks); true } => self.control/; s/^( *)HostMessage::FaultSeen \{ number \} => \{/\1HostMessage::Control { .. } => Action::Idle,\n&/'
mutant f6-turns-unbounded link turns_faster pendant/ring.rs 's/let fastest_um_s = if turn_rad > 0.0 \{/let fastest_um_s = if turn_rad > 100.0 {/'
mutant f6-manual-at-250 link manual_mode pendant.rs 's/const MANUAL_DEFAULT_UM_S: u32 = 25_000;/const MANUAL_DEFAULT_UM_S: u32 = 250_000;/'
mutant f6-welded-slower link manual_mode pendant/command.rs 's/let bound = self.panel.manual \&\& self.interlock.is_armed\(\);/let bound = self.panel.manual \&\& self.panel.e_stop;/; s/Refused::TooFast => .*/Refused::TooFast => Refusal::Moving,/'
mutant f6-key-turned-unnoticed link turning_the_key interlock.rs 's/^( *)if turned \{/\1if turned \&\& self.state == State::Fault {/'
mutant f7-slow-stop-at-disable link released_switch interlock.rs 's/State::Holding if !inputs.enable \|\| self.cause == Some\(Cause::EnableLost\)/State::Holding if inputs.e_stop/'
mutant f8-one-contact-enables core only_both interlock/channels.rs 's/both: a \&\& b/both: a || b/'
mutant f8-stuck-pin-holds-the-pump core stands_still interlock/channels.rs 's/self.charge.saturating_sub\(1\)/self.charge/'
mutant f9-times-not-the-paths link own_gas_time pendant/command.rs 's/^( *)self.interlock = self.interlock.timed\(times\);/\1let _ = times;/'
mutant f9-stray-current-unnoticed link current_that_flows interlock.rs 's/^( *)self.watch_current\(inputs\);/\1let _ = inputs;/'
mutant f9-short-crater-is-finished link crater interlock.rs 's/self.cut_short \|= .*/self.cut_short \&= true;/'
mutant f9-armed-across-a-release link arming_in_held interlock.rs '/if !inputs.enable \{/,/enable_lost/s/self.armed = false;//; /fn regrip\(/,/^    }/s/self.armed = false;//'
mutant f9-jog-unbounded link workspace pendant/command.rs 's/if !fits \{/if !fits \&\& near(\&0) == false {/'
mutant port-silent-robot-starts link port_that_is_fitted pendant/command.rs 's/if self\.robot\.port\.as_ref\(\)\.is_some_and\(\|robot\| !robot\.is_ready\(\)\) \{/if false {/'
mutant port-late-robot-runs link link_port pendant/robot.rs 's/let Some\(\&Answered \{ actual, torch \}\) = self\.fresh\(\) else \{ return Some\(Cause::RobotSilent\) \};/let Some(\&Answered { actual, torch }) = self.answered.as_ref() else { return None };/'
mutant port-off-robot-runs link off_by_the_limit pendant/robot.rs 's/let off = beyond\(self\.config\.off_um, self\.config\.off_mrad\)/let off = beyond(u32::MAX, u32::MAX)/'
mutant port-old-pose-at-start core where_another_ended pendant/command.rs 's/^( *)self.robot.place.commanded = first;/\1let _ = first;/'
mutant tool-under-hands link link_port pendant/command.rs 's/ \|\| self\.robot\.jogging\.begun =>/ =>/'
mutant tool-in-held link link_port pendant/command.rs 's/Moving::Tool if self\.state\(\) == State::Held/Moving::Tool if false/'
mutant tool-not-asked-for link link_port pendant/command.rs 's/self\.robot\.port\.is_some\(\) \&\& self\.robot\.tool\.is_none\(\)/false/'
mutant tool-of-another-session link link_port pendant/session.rs 's/self\.robot\.carry\(None\);//'
mutant answers-of-another-session link link_port pendant/robot.rs 's/actual\.session == self\.session \&\& //'
mutant answers-of-another-end link link_port pendant/robot.rs 's/ \&\& \(actual\.robot == robot \|\| self\.answered\.is_none\(\)\)//'
mutant older-answers-taken link link_port pendant/robot.rs 's/\(1\.\.=MOST_AHEAD\)\.contains\(\&gap\)/true/'
mutant hands-not-supervised link link_port pendant/robot.rs 's/else \{ self\.jogging\.commanded\.as_ref\(\) \};/else { None };/'
mutant hands-need-no-new-grip link link_port interlock.rs '/fn robot\(/,/^    }/s/self\.regrip\(\);/self.state = State::Disabled; self.released = true;/'
mutant camera-runs-ahead link link_port pendant/jog.rs 's/!runs_ahead\(next\)/true/'
mutant flange-leaves-the-workspace link link_port pendant/jog.rs 's/if farther_out \{ from \} else/if false { from } else/'
mutant welds-beside-the-joint link link_port pendant/robot.rs 's/let beside = welds \&\& /let beside = false \&\& /'
mutant frozen-robot-unseen link link_port pendant/robot.rs 's/left_um > LEFT_UM \&\& /false \&\& /'
mutant set-points-run-on link link_port pendant/robot.rs 's/self\.path\.drive\.speed_um_s = 0\.0;//'
mutant error-unasked-at-start link link_port pendant/place.rs 's/\.max\(error_um\)//'
mutant one-lost-answer-holds link link_port pendant/robot.rs 's/late_ticks: 5/late_ticks: 4/'

if [ -n "$check" ] && [ "$failures" -eq 0 ]; then echo "every mutant applies" && exit; fi
[ "$failures" -eq 0 ] && echo "every mutant turns a test red" || { echo "$failures mutants do not"; exit 1; }
