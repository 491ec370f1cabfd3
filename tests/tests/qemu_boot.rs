//! The firmware's own promises: it boots, it says why, and whatever breaks it turns everything off first.

use std::io;

use weldpath_tests::qemu::{Machine, Panel, Seen, Wire, firmware, read_all};

fn booted() -> Option<(Machine, Panel)> {
    let program = firmware("weldpath-firmware")?;
    Some(Machine::boot(&program, Wire::Socket).expect("boots"))
}

/// Lights the motion lamp, so that there is something to turn off.
fn moving(panel: &mut Panel) -> io::Result<Seen> {
    panel.set_inputs(false, true, false)?;
    panel.wait_for(|seen| matches!(seen, Seen::Outputs { motion: true, .. }))
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
fn a_stack_overflow_is_caught_below_the_variables_and_reports_itself() {
    fatal(b'%', 2);
}

#[test]
fn a_hang_is_ended_by_the_watchdog_and_reports_itself() {
    fatal(b'$', 3);
}

fn fatal(fault: u8, cause: u8) {
    let Some((machine, mut panel)) = booted() else { return };
    moving(&mut panel).unwrap();
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
fn bytes_go_both_ways_over_a_pty_and_a_socket() {
    let Some(program) = firmware("weldpath-firmware") else { return };
    for wire in [Wire::Pty, Wire::Socket] {
        let (machine, _panel) = Machine::boot(&program, wire).unwrap();
        let mut link = machine.open_link().unwrap();
        let sent: Vec<u8> = (0..=255).collect();
        link.write_all(&sent).unwrap();
        let mut back = vec![0; 256];
        read_all(link.as_mut(), &mut back).unwrap();
        assert_eq!(back, sent, "{wire:?}");
    }
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
