//! A pendant in a thread of the test, in real time, behind a socket or a pseudo-terminal: for hosts that are real.

use std::io::{self, Read, Write};
use std::net::TcpListener;
use std::os::unix::net::UnixListener;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread;
use std::time::{Duration, Instant};

use serialport::{SerialPort, TTYPort};
use weldpath_core::interlock::State;
use weldpath_core::pendant::{Action, Panel, Pendant, Task};
use weldpath_core::tasks::{Tasks, Workspace};
use weldpath_core::wire::frame::encode;
use weldpath_core::wire::{FromPendant, HostDeframer, MAX_PENDANT_FRAME, WirePose};

use crate::adversary::Random;
use crate::world::{self, RING};

const TICK: Duration = Duration::from_millis(2);
/// How long anything may take that has no reason to take long.
const PATIENCE: Duration = Duration::from_secs(30);

/// What a test sees and sets.
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    /// The switches.
    pub panel: Panel,
    /// State of the interlock.
    pub state: State,
    /// Ticks since the start.
    pub tick: u32,
    /// Segment of the last set-point.
    pub segment: u32,
    /// Whether the arc is on.
    pub arc: bool,
    /// Tick of the last arc-on, 0 if there was none.
    pub arc_on_tick: u32,
    /// Where the torch was to be then.
    pub arc_on_pose: WirePose,
    /// Tick of the last arc-off.
    pub arc_off_tick: u32,
    /// Tick in which bytes came last.
    pub heard_tick: u32,
    /// Whether the operator confirms, while a path waits, that the torch is where the path begins.
    pub confirms: bool,
    /// Pose commanded last.
    pub pose: WirePose,
    /// Farthest from one set-point to the next, µm, whatever was between them.
    pub jump_um: f32,
    /// Whether there was a set-point yet.
    pub moved: bool,
}

enum Event {
    Joined(Box<dyn Write + Send>),
    Bytes(usize, Vec<u8>),
}

/// The pendant; dropping it ends its thread.
pub struct InProcess {
    seen: Arc<Mutex<Option<Seen>>>,
    /// What `--port` takes.
    pub port: String,
    _folder: tempfile::TempDir,
}

impl InProcess {
    /// Behind a socket that several hosts may connect to.
    pub fn on_socket() -> io::Result<Self> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("pendant");
        let listener = UnixListener::bind(&path)?;
        let hosts = std::iter::from_fn(move || listener.accept().ok());
        let halves = hosts.map_while(|(stream, _)| Some((stream.try_clone().ok()?, stream)));
        Ok(Self::run(accept(halves), format!("unix:{}", path.display()), folder, 0.0))
    }

    /// Behind a TCP port of this machine.
    pub fn on_tcp() -> io::Result<Self> {
        let listener = TcpListener::bind("127.0.0.1:0")?;
        let port = listener.local_addr()?.to_string();
        let hosts = std::iter::from_fn(move || listener.accept().ok());
        let halves = hosts.map_while(|(stream, _)| {
            stream.set_nodelay(true).ok()?;
            Some((stream.try_clone().ok()?, stream))
        });
        Ok(Self::run(accept(halves), port, tempfile::tempdir()?, 0.0))
    }

    /// Behind a pseudo-terminal on which every byte, both ways, is altered with this probability.
    pub fn on_pty(damage: f64) -> io::Result<Self> {
        // The host's end is closed again, for a host wants it for itself.
        let (mut ours, theirs) = TTYPort::pair()?;
        ours.set_timeout(Duration::from_millis(50))?;
        let port = theirs.name().ok_or_else(|| io::Error::other("a terminal without a name"))?;
        let (events, happened) = channel();
        let writer = ours.try_clone_native()?;
        events.send(Event::Joined(Box::new(writer))).map_err(|_| io::ErrorKind::BrokenPipe)?;
        thread::spawn(move || listen(ours, 0, &events));
        Ok(Self::run(happened, port, tempfile::tempdir()?, damage))
    }

    fn run(events: Receiver<Event>, port: String, folder: tempfile::TempDir, damage: f64) -> Self {
        let pendant = Pendant::new(&world::config(), 1).expect("a sound configuration");
        let seen = Arc::new(Mutex::new(Some(Seen {
            panel: Panel::default(),
            state: State::Disabled,
            tick: 0,
            segment: 0,
            arc: false,
            arc_on_tick: 0,
            arc_on_pose: WirePose::IDENTITY,
            arc_off_tick: 0,
            heard_tick: 0,
            confirms: true,
            pose: WirePose::IDENTITY,
            jump_um: 0.0,
            moved: false,
        })));
        let board = Board {
            pendant,
            tasks: Tasks::default(),
            workspace: Box::default(),
            hosts: Vec::new(),
            damage: (Random::new(1), damage),
            seen: Arc::clone(&seen),
        };
        thread::spawn(move || board.run(&events));
        Self { seen, port, _folder: folder }
    }

    fn lock(&self) -> MutexGuard<'_, Option<Seen>> {
        self.seen.lock().expect("the pendant's thread has not panicked")
    }

    /// What there is to see now.
    pub fn seen(&self) -> Seen {
        self.lock().expect("the pendant lives")
    }

    /// Releases or grips the enabling switch.
    pub fn enable(&self, held: bool) {
        if let Some(seen) = self.lock().as_mut() {
            seen.panel.enable = held;
        }
    }

    /// Turns the key switch.
    pub fn manual(&self, manual: bool) {
        if let Some(seen) = self.lock().as_mut() {
            seen.panel.manual = manual;
        }
    }

    /// Whether the operator confirms where the torch is.
    pub fn confirms(&self, confirms: bool) {
        if let Some(seen) = self.lock().as_mut() {
            seen.confirms = confirms;
        }
    }

    /// Lets the switch go for some ticks and grips it.
    pub fn grip(&self) {
        self.enable(false);
        thread::sleep(5 * TICK);
        self.enable(true);
    }

    /// Waits for something to be seen.
    ///
    /// # Panics
    /// If it is not seen.
    pub fn wait_for(&self, what: &str, wanted: impl Fn(&Seen) -> bool) -> Seen {
        let begin = Instant::now();
        loop {
            let seen = self.seen();
            if wanted(&seen) {
                return seen;
            }
            assert!(begin.elapsed() < PATIENCE, "waited for {what}: {seen:?}");
            thread::sleep(TICK);
        }
    }
}

impl Drop for InProcess {
    fn drop(&mut self) {
        *self.lock() = None;
    }
}

/// Everyone who connects is a host.
fn accept<S: Read + Write + Send + 'static>(
    hosts: impl Iterator<Item = (S, S)> + Send + 'static,
) -> Receiver<Event> {
    let (events, happened) = channel();
    thread::spawn(move || {
        for (number, (writer, reader)) in hosts.enumerate() {
            if events.send(Event::Joined(Box::new(writer))).is_err() {
                return;
            }
            let events = events.clone();
            thread::spawn(move || listen(reader, number, &events));
        }
    });
    happened
}

fn listen(mut reader: impl Read, number: usize, events: &Sender<Event>) {
    let mut buffer = [0; 512];
    loop {
        match reader.read(&mut buffer) {
            Ok(0) => return,
            Ok(count) if events.send(Event::Bytes(number, buffer[..count].to_vec())).is_err() => return,
            // A time-out, or a pseudo-terminal that no host has opened.
            Err(_) => thread::sleep(TICK),
            _ => {}
        }
    }
}

struct Board {
    pendant: Pendant<RING>,
    tasks: Tasks,
    workspace: Box<Workspace>,
    hosts: Vec<(Box<dyn Write + Send>, HostDeframer)>,
    damage: (Random, f64),
    seen: Arc<Mutex<Option<Seen>>>,
}

impl Board {
    fn run(mut self, events: &Receiver<Event>) {
        let mut due = Instant::now();
        while self.tick() {
            due += TICK;
            while let Ok(event) = events.recv_timeout(due.saturating_duration_since(Instant::now())) {
                self.take(event);
            }
        }
    }

    fn take(&mut self, event: Event) {
        match event {
            Event::Joined(writer) => self.hosts.push((writer, HostDeframer::new())),
            Event::Bytes(number, mut bytes) => {
                self.harm(&mut bytes);
                if let Some(seen) = self.seen.lock().expect("no panic while held").as_mut() {
                    seen.heard_tick = seen.tick;
                }
                bytes.into_iter().for_each(|byte| self.byte(number, byte));
            }
        }
    }

    fn byte(&mut self, number: usize, byte: u8) {
        let Some(received) = self.hosts.get_mut(number).and_then(|(_, bytes)| bytes.push(byte)) else {
            return;
        };
        let action = match self.pendant.receive(received) {
            Action::Perform { request, task } => {
                let answer = self.tasks.perform(&Task::clone(&task), &mut self.workspace);
                self.pendant.answer(request, answer)
            }
            other => other,
        };
        if let Action::Send(frame) = action {
            self.send(&frame);
        }
    }

    /// To every host: a line has no addresses.
    fn send(&mut self, frame: &FromPendant) {
        let mut out = [0; MAX_PENDANT_FRAME];
        let length = encode(frame, &mut out).expect("fits");
        self.harm(&mut out[..length]);
        for (writer, _) in &mut self.hosts {
            // A host that has gone hears nothing.
            let _ = writer.write_all(&out[..length]);
        }
    }

    fn harm(&mut self, bytes: &mut [u8]) {
        let (random, probability) = &mut self.damage;
        for byte in bytes {
            if random.chance(*probability) {
                *byte ^= 1 << random.below(8);
            }
        }
    }

    /// False when the test is over.
    fn tick(&mut self) -> bool {
        let shared = Arc::clone(&self.seen);
        let mut shared = shared.lock().expect("no panic while held");
        let Some(seen) = shared.as_mut() else { return false };
        let waits = matches!(self.pendant.state(), State::Ready | State::Loading);
        // A press of 40 ms every 80.
        seen.panel.confirm = seen.confirms && waits && seen.tick % 40 < 20;
        let tick = self.pendant.tick(&seen.panel);
        seen.tick += 1;
        seen.state = self.pendant.state();
        if let Some(point) = tick.set_point {
            let jump_um = if seen.moved { seen.pose.distance_um(&point.pose) } else { 0.0 };
            seen.jump_um = seen.jump_um.max(jump_um);
            (seen.pose, seen.moved) = (point.pose, true);
        }
        seen.segment = tick.set_point.map_or(seen.segment, |point| point.segment);
        match (seen.arc, tick.outputs.arc) {
            (false, true) => (seen.arc_on_tick, seen.arc_on_pose) = (seen.tick, seen.pose),
            (true, false) => seen.arc_off_tick = seen.tick,
            _ => {}
        }
        seen.arc = tick.outputs.arc;
        seen.panel.established = tick.outputs.arc;
        drop(shared);
        while let Some(frame) = self.pendant.transmit() {
            self.send(&frame);
        }
        true
    }
}
