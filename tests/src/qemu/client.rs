//! A host on the emulated line, in real time: core's sender between a port and a test.

use std::io;
use std::time::{Duration, Instant};

use weldpath::pendant::serial::Line;
use weldpath_core::sender::{self, Notice, Sender};
use weldpath_core::wire::frame::{self, Received};
use weldpath_core::wire::{
    Answer, Command, FromPendant, HelloRefusal, HelloRefused, MAX_HOST_FRAME, PendantDeframer,
    PendantMessage, Sample, Telemetry, WireWaypoint,
};

use super::PATIENCE;
use crate::adversary::Random;

/// The host end with everything it was told.
pub struct Client {
    line: Line,
    /// The protocol's host end.
    pub sender: Sender,
    bytes: PendantDeframer,
    begin: Instant,
    damage: Option<(Random, f64)>,
    path: Vec<WireWaypoint>,
    /// Latest state.
    pub telemetry: Option<Telemetry>,
    /// Executed set-points so far.
    pub samples: Vec<Sample>,
    refused: Vec<HelloRefused>,
}

impl Client {
    /// A host that has not said anything.
    pub fn new(line: Line) -> Self {
        Self {
            line,
            sender: Sender::new(&sender::Config::default()),
            bytes: PendantDeframer::new(),
            begin: Instant::now(),
            damage: None,
            path: Vec::new(),
            telemetry: None,
            samples: Vec::new(),
            refused: Vec::new(),
        }
    }

    /// Every byte, both ways, is altered with this probability.
    pub fn damage(&mut self, probability: f64) {
        self.damage = Some((Random::new(1), probability));
    }

    /// Opens a session; the pendant's boot nonce.
    pub fn connect(&mut self, nonce: u32) -> io::Result<u32> {
        self.sender.open(nonce);
        self.wait_for("a session", |_, notice| match notice {
            Notice::Connected(ack) => Some(ack.boot),
            _ => None,
        })
    }

    /// Executes a command and gives its answer.
    pub fn ask(&mut self, command: Command) -> io::Result<Answer> {
        let asked =
            self.sender.request(command).map_err(|_| io::Error::other("no session or too many commands"))?;
        self.wait_for("an answer", |_, notice| match notice {
            Notice::Answered { ticket, answer } if *ticket == asked => Some(*answer),
            _ => None,
        })
    }

    /// Sends a whole path.
    pub fn load(&mut self, begin: weldpath_core::wire::Begin, path: &[WireWaypoint]) -> io::Result<()> {
        self.path = path.to_vec();
        assert!(self.sender.load(begin, path), "no load is under way");
        self.wait_for("the load", |_, notice| match notice {
            Notice::Loaded => Some(Ok(())),
            Notice::LoadRefused(_) | Notice::ChunkRefused(_) => {
                Some(Err(io::Error::other(format!("{notice:?}"))))
            }
            _ => None,
        })?
    }

    /// Why another Hello with this nonce was refused.
    pub fn wait_for_refusal(&mut self, nonce: u32) -> io::Result<HelloRefusal> {
        let end = Instant::now() + PATIENCE;
        while Instant::now() < end {
            self.turn(true)?;
            if let Some(found) = self.refused.iter().find(|refused| refused.nonce == nonce) {
                return Ok(found.why);
            }
        }
        Err(io::Error::other(format!("waited for a refusal of {nonce:x}; seen {:?}", self.refused)))
    }

    /// Goes on until the state satisfies `wanted`.
    pub fn wait_for_state(&mut self, wanted: impl Fn(&Telemetry) -> bool) -> io::Result<Telemetry> {
        self.wait_for("a state", |client, _| client.telemetry.filter(|state| wanted(state)))
    }

    /// Goes on until `wanted` makes something of a notice.
    pub fn wait_for<T>(&mut self, what: &str, wanted: impl Fn(&Self, &Notice) -> Option<T>) -> io::Result<T> {
        let end = Instant::now() + PATIENCE;
        while Instant::now() < end {
            for notice in self.turn(true)? {
                if let Some(found) = wanted(self, &notice) {
                    return Ok(found);
                }
            }
        }
        Err(io::Error::new(
            io::ErrorKind::TimedOut,
            format!("waited for {what}; last state {:?}", self.telemetry),
        ))
    }

    /// For this long: reads, and sends only if `speaks`.
    pub fn run_for(&mut self, time: Duration, speaks: bool) -> io::Result<()> {
        let end = Instant::now() + time;
        while Instant::now() < end {
            self.turn(speaks)?;
        }
        Ok(())
    }

    /// Sends what is due, then reads what has come.
    fn turn(&mut self, speaks: bool) -> io::Result<Vec<Notice>> {
        while let Some(message) = speaks.then(|| self.sender.poll(self.now_us(), &self.path)).flatten() {
            let mut frame = [0; MAX_HOST_FRAME];
            let length = frame::encode(&message, &mut frame).expect("the buffer fits every message");
            self.write(&mut frame[..length])?;
        }
        let mut buffer = [0; 512];
        let count = match self.line.reader.read(&mut buffer) {
            Err(e) if matches!(e.kind(), io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock) => 0,
            other => other?,
        };
        damage(&mut self.damage, &mut buffer[..count]);
        let mut notices = Vec::new();
        for &byte in &buffer[..count] {
            let Some(Received::Payload(payload)) = self.bytes.push(byte) else { continue };
            let Ok(message) = frame::decode::<FromPendant>(payload) else { continue };
            if let PendantMessage::HelloRefused(refused) = &message.message {
                self.refused.push(*refused);
            }
            let now_us = self.begin.elapsed().as_micros() as u64;
            let notice = self.sender.receive(message, now_us);
            match &notice {
                Notice::Telemetry(state) => self.telemetry = Some(*state),
                Notice::Samples(samples) => self.samples.extend_from_slice(samples),
                _ => {}
            }
            notices.push(notice);
        }
        Ok(notices)
    }

    /// Bytes as they are, damaged like all others.
    pub fn write(&mut self, bytes: &mut [u8]) -> io::Result<()> {
        damage(&mut self.damage, bytes);
        self.line.writer.write_all(bytes)
    }

    fn now_us(&self) -> u64 {
        self.begin.elapsed().as_micros() as u64
    }
}

fn damage(how: &mut Option<(Random, f64)>, bytes: &mut [u8]) {
    let Some((random, probability)) = how else { return };
    for byte in bytes {
        if random.chance(*probability) {
            *byte ^= 1 << random.below(8);
        }
    }
}
