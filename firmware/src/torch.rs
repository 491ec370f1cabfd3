//! What happens every 2 ms: pins in, the pendant stepped, pins out. The pendant lives here.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use static_cell::ConstStaticCell;
use weldpath_core::interlock::Fault;
use weldpath_core::interlock::channels::{Pump, TwoChannel};
use weldpath_core::pendant::{Config, Panel, Pendant, PortConfig, Slot, Tick};
use weldpath_core::wire::Firmware;
use weldpath_core::wire::port::{self, ActualDeframer};

use crate::board::{Board, Fitted, Inputs, Outputs, Shared, Straps};
use crate::serial;

/// Ticks a second: the set-point rate.
pub const TICK_HZ: u32 = 500;

/// Release and commit, as `build.rs` found them.
const FIRMWARE: Firmware = Firmware {
    version: [
        decimal(env!("CARGO_PKG_VERSION_MAJOR")) as u8,
        decimal(env!("CARGO_PKG_VERSION_MINOR")) as u8,
        decimal(env!("CARGO_PKG_VERSION_PATCH")) as u8,
    ],
    build: decimal(env!("WELDPATH_BUILD")),
};

/// A number that was checked when it was written.
const fn decimal(text: &str) -> u32 {
    match u32::from_str_radix(text, 10) {
        Ok(number) => number,
        Err(_) => panic!("no number"),
    }
}

/// Waypoints that the pendant holds.
pub const RING: usize = 512;

static TICKS: AtomicU32 = AtomicU32::new(0);
static SLOTS: ConstStaticCell<[Slot; RING]> = ConstStaticCell::new([Slot::EMPTY; RING]);
static PENDANT: Shared<Option<Lent>> = Shared::new(None);

/// A pendant whose waypoints lie in static memory.
type Lent = Pendant<RING, &'static mut [Slot]>;

/// Switches with two contacts and outputs behind charge pumps.
struct Contacts {
    estop: TwoChannel,
    enable: TwoChannel,
    arc: Pump,
    motion: Pump,
    /// What was meant in the tick before, which read-back shows now.
    meant: [bool; 2],
}

static CONTACTS: Shared<Contacts> = Shared::new(Contacts {
    estop: TwoChannel::new(),
    enable: TwoChannel::new(),
    arc: Pump::new(),
    motion: Pump::new(),
    meant: [false; 2],
});
static ROBOT_FRAME: Shared<[u8; port::SET_POINT_FRAME]> = Shared::new([0; port::SET_POINT_FRAME]);
static ROBOT_BYTES: Shared<ActualDeframer> = Shared::new(ActualDeframer::new());

/// Starts the pendant; `nonce` has to differ from start to start. Once.
///
/// # Panics
/// If the default configuration contradicts itself.
pub fn install(nonce: u32, straps: Straps) {
    let port = PortConfig { late_ticks: Fitted::LATE_TICKS, ..PortConfig::default() };
    let config = Config {
        tick_us: 1_000_000 / TICK_HZ,
        port: straps.port.then_some(port),
        can_weld: straps.clock,
        firmware: FIRMWARE,
        ..Config::default()
    };
    let pendant = Pendant::with_slots(&config, nonce, SLOTS.take().as_mut_slice());
    assert!(pendant.is_some(), "the configuration contradicts itself");
    PENDANT.with(|installed| *installed = pendant);
}

/// Uses the pendant while no tick can; none before [`install`].
pub fn with<T>(use_it: impl FnOnce(&mut Lent) -> T) -> Option<T> {
    PENDANT.with(|pendant| pendant.as_mut().map(use_it))
}

/// Ticks since the start, wrapping.
pub fn ticks() -> u32 {
    TICKS.load(Relaxed)
}

/// One tick, from the board's timer interrupt.
pub fn tick(inputs: Inputs) -> Outputs {
    TICKS.fetch_add(1, Relaxed);
    let panel = CONTACTS.with(|contacts| contacts.read(&inputs));
    hear_robot();
    let Some(tick) = with(|pendant| pendant.tick(&panel)) else { return Outputs::OFF };
    tell_robot(tick.robot.as_ref());
    CONTACTS.with(|contacts| contacts.drive(&tick))
}

impl Contacts {
    /// What the two contacts of each switch say together, and whether anything is broken.
    fn read(&mut self, inputs: &Inputs) -> Panel {
        let (stop, enable) = (self.estop.tick(inputs.estop), self.enable.tick(inputs.enable));
        let channels = (stop.broken || enable.broken).then_some(Fault::Channels);
        let readback = [inputs.arc_readback, inputs.motion_readback];
        let wrong = self.arc.reads_wrong(self.meant[0], readback[0])
            | self.motion.reads_wrong(self.meant[1], readback[1]);
        Panel {
            e_stop: stop.either,
            enable: enable.both,
            local_reset: inputs.reset,
            established: inputs.established,
            manual: inputs.manual,
            confirm: inputs.confirm,
            defect: channels.or(wrong.then_some(Fault::Readback)),
        }
    }

    fn drive(&mut self, tick: &Tick) -> Outputs {
        let (arc, motion) = (tick.outputs.arc, tick.motion);
        self.meant = [arc, motion];
        Outputs {
            arc,
            gas: tick.outputs.gas,
            motion,
            wire: tick.outputs.wire,
            arc_pump: self.arc.tick(arc),
            motion_pump: self.motion.tick(motion),
        }
    }
}

/// Bytes taken from the robot's line at once.
const TAKEN: usize = 64;

/// What has come from the robot since the last tick.
fn hear_robot() {
    let mut taken = [0; TAKEN];
    ROBOT_BYTES.with(|bytes| {
        loop {
            let mut rest = serial::ROBOT.take(&mut taken);
            if rest.is_empty() {
                break;
            }
            while !rest.is_empty() {
                let received;
                (received, rest) = bytes.feed(rest);
                if let Some(received) = received {
                    with(|pendant| pendant.receive_robot(received));
                }
            }
        }
    });
}

/// The tick's frame; one that does not fit is lost, and the robot sees the gap.
fn tell_robot(frame: Option<&port::WireSetPoint>) {
    let Some(frame) = frame else { return };
    ROBOT_FRAME.with(|out| {
        frame.write(out);
        serial::ROBOT.send(out);
    });
}
