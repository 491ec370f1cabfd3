//! The firmware's own promises: it boots, it says why, and whatever breaks it turns everything off first.

use weldpath_tests::qemu::{Machine, Panel, Seen, Wire, firmware};

fn booted() -> Option<(Machine, Panel)> {
    let program = firmware("weldpath-firmware")?;
    Some(Machine::boot(&program, Wire::Socket).expect("boots"))
}

#[test]
fn outputs_are_off_from_the_first_instruction_and_a_power_on_is_reported() {
    let Some((_machine, panel)) = booted() else { return };
    assert_eq!(panel.wait_for(|_| true).unwrap(), Seen::AllOff);
    assert_eq!(panel.wait_for(|_| true).unwrap(), Seen::Boot(0));
    let first = panel.wait_for(|_| true).unwrap();
    assert!(matches!(first, Seen::Outputs { arc: false, gas: false, motion: false, .. }), "{first:?}");
}

#[test]
fn a_panic_turns_everything_off_and_reports_itself_after_the_reset() {
    fatal(b'!', 1);
}

#[test]
#[ignore = "open fault: the outputs go off and the reset comes, but the cause is lost (Boot(0), not Boot(2))"]
fn a_stack_overflow_is_caught_below_the_variables_and_reports_itself() {
    fatal(b'%', 2);
}

#[test]
fn a_hang_is_ended_by_the_watchdog_and_reports_itself() {
    fatal(b'$', 3);
}

fn fatal(fault: u8, cause: u8) {
    let Some((machine, mut panel)) = booted() else { return };
    panel.wait_for(|seen| matches!(seen, Seen::Outputs { .. })).unwrap();
    panel.send(fault).unwrap();
    assert_eq!(panel.wait_for(|_| true).unwrap(), Seen::AllOff, "before the reset");
    assert_eq!(panel.wait_for(|_| true).unwrap(), Seen::AllOff, "the first instruction after it");
    assert_eq!(panel.wait_for(|_| true).unwrap(), Seen::Boot(cause));
    // Nobody has told the new start about the enabling switch.
    let next = panel.wait_for(|_| true).unwrap();
    assert!(matches!(next, Seen::Outputs { arc: false, gas: false, motion: false, .. }), "{next:?}");
    drop(machine);
}

#[test]
fn the_stack_stays_within_4_kb_after_the_start() {
    let Some((_machine, mut panel)) = booted() else { return };
    panel.send(b'?').unwrap();
    let seen = panel.wait_for(|seen| matches!(seen, Seen::Stack(_))).unwrap();
    assert!(matches!(seen, Seen::Stack(1..=4096)), "{seen:?}");
}

#[test]
fn the_log_has_a_channel_of_its_own() {
    let Some((machine, panel)) = booted() else { return };
    panel.wait_for(|seen| matches!(seen, Seen::Outputs { .. })).unwrap();
    assert!(!machine.console().unwrap().is_empty());
}

#[test]
fn an_emulator_that_cannot_start_is_an_error_and_not_a_hang() {
    if firmware("weldpath-firmware").is_none() {
        return;
    }
    let missing = std::path::Path::new("no-such-program");
    let error = Machine::boot(missing, Wire::Socket).err().expect("nothing to run");
    assert!(error.to_string().contains("no-such-program"), "{error}");
}
