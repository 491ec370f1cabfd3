//! The firmware's own promises: it boots, it says why, and whatever breaks it turns everything off first.

use std::thread::sleep;
use std::time::{Duration, Instant};

use weldpath_core::interlock::{Fault, State};
use weldpath_tests::qemu::{Client, Clock, Inputs, Machine, PATIENCE, Panel, Seen, Wire, firmware};

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
fn a_stack_overflow_is_caught_below_the_variables_and_reports_itself() {
    fatal(b'%', 2);
}

#[test]
fn a_hang_is_ended_by_the_watchdog_and_reports_itself() {
    fatal(b'$', 3);
}

#[test]
fn an_emulator_without_a_processor_for_a_second_is_no_hang() {
    let Some((machine, panel)) = booted() else { return };
    panel.wait_for(|seen| matches!(seen, Seen::Outputs { .. })).unwrap();
    machine.starve(Duration::from_secs(1)).unwrap();
    panel.send(b'?').unwrap();
    let seen = panel.wait_for(|seen| matches!(seen, Seen::Stack(_) | Seen::Boot(_))).unwrap();
    assert!(matches!(seen, Seen::Stack(_)), "{seen:?}");
}

fn fatal(fault: u8, cause: u8) {
    let Some((machine, panel)) = booted() else { return };
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
fn a_panel_that_is_not_heard_counts_as_a_pressed_stop() {
    let Some(program) = firmware("weldpath-firmware") else { return };
    let mut machine = Machine::load(&program, Wire::Socket, Clock::Host).expect("loads");
    let mut client = Client::new(machine.open_link().unwrap());
    machine.tell("cont").unwrap();
    client.connect(1).unwrap();
    let state = client.wait_for_state(|_| true).unwrap();
    assert_eq!((state.state, state.fault), (State::Fault, Some(Fault::EStop)), "{state:?}");
}

#[test]
fn a_press_and_its_release_that_arrive_between_two_ticks_are_both_seen() {
    let Some((mut machine, panel)) = booted() else { return };
    let mut client = Client::new(machine.open_link().unwrap());
    client.connect(1).unwrap();
    client.wait_for_state(|state| state.fault.is_none()).unwrap();
    // All of it waits for the firmware, as on a host that had no time for the emulator.
    machine.tell("stop").unwrap();
    panel.set(Inputs { e_stop: true, ..Inputs::default() }).unwrap();
    panel.set(Inputs::default()).unwrap();
    machine.tell("cont").unwrap();
    client.wait_for_state(|state| state.fault == Some(Fault::EStop)).unwrap();
    machine.tell("stop").unwrap();
    panel.reset(Inputs::default()).unwrap();
    machine.tell("cont").unwrap();
    client.wait_for_state(|state| state.fault.is_none()).unwrap();
}

#[test]
fn the_stack_stays_within_4_kb_after_the_start() {
    let Some((_machine, panel)) = booted() else { return };
    panel.send(b'?').unwrap();
    let seen = panel.wait_for(|seen| matches!(seen, Seen::Stack(_))).unwrap();
    assert!(matches!(seen, Seen::Stack(1..=4096)), "{seen:?}");
}

#[test]
fn the_log_has_a_channel_of_its_own() {
    let Some((machine, _panel)) = booted() else { return };
    // It comes when it comes: the panel's first report is older than the first line.
    let end = Instant::now() + PATIENCE;
    while machine.console().unwrap().is_empty() {
        assert!(Instant::now() < end, "nothing was logged");
        sleep(Duration::from_millis(5));
    }
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
